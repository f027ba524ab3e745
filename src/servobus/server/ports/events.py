"""What has happened on the ports, told to everybody who is connected, and kept for those who come later."""

import json
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from servobus.core.values import frozen

KEPT = 200
"""Events that a client which joins can ask for."""


@frozen
class Event:
    """Something that has happened.

    number  grows by 1 from event to event
    time    s since 1970, when
    what    its kind: appeared, lost, alarm, restarted, moved, lease, stopped, resumed, refused, gone, back, opened,
            closed, saved
    bus     the bus; empty for what concerns all of them
    servo   key of the servo; empty for what concerns none
    by      name of who did it; empty for what happened by itself
    data    more, as JSON
    """

    number: int
    time: float
    what: str
    bus: str = ""
    servo: str = ""
    by: str = ""
    data: str = "{}"


class Events:
    """Tells listeners what has happened."""

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self._clock = clock
        self._listeners: list[Callable[[Event], object]] = []
        self._past: deque[Event] = deque(maxlen=KEPT)
        self._number = 0

    def listen(self, listener: Callable[[Event], object]) -> Callable[[], None]:
        """Have a listener told of every event; give what ends that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def tell(self, what: str, *, bus: str = "", servo: str = "", by: str = "", **data: Any) -> None:
        """Tell all listeners. `data` must be values of JSON."""
        self._number += 1
        event = Event(self._number, round(self._clock(), 3), what, bus, servo, by, json.dumps(data))
        self._past.append(event)
        for listener in list(self._listeners):
            listener(event)

    def past(self, after: int = 0) -> list[Event]:
        """Give the kept events with a higher number, the oldest first."""
        return [event for event in self._past if event.number > after]
