"""Letting time pass, the blocking way: how the steps of a job get their waits.

`Bus` carries out its jobs with it. An `AsyncBus` uses it in a thread beside the event loop, to make its servos safe.
"""

from typing import TypeVar

from servobus.errors import PortError
from servobus.link.base import BaseLink
from servobus.link.ownership import LineOwnership, Turn
from servobus.link.waits import Receive, Rest, Waits
from servobus.transports.base import Transport

T = TypeVar("T")

SLICE = 0.05
"""s after which a pause looks whether the line was taken over: a stop must not wait for the end of a long pause."""


def run_blocking(
    link: BaseLink, waits: Waits[T], line: LineOwnership, turn: Turn, wait: Receive | Rest | None = None
) -> T:
    """Wait as asked until the job is done; give its result. `wait` is where a job stands that was begun before.

    In shared pauses the turn gives way. Raises Stopped if the line was taken over meanwhile.
    """
    transport = link.transport
    heard = b""
    try:
        wait = wait or next(waits)
        while True:
            if isinstance(wait, Receive):
                try:
                    heard = transport.read(wait.seconds)
                except PortError as error:
                    wait = waits.throw(error)  # a job that has begun a change can say how far it came
                    continue
            elif wait.shared:
                line.give_way(turn)
                _rest(link, transport, wait.seconds)
                line.acquire(turn)
            else:
                _rest(link, transport, wait.seconds)
            link.check()
            wait = waits.send(heard)
    except StopIteration as stop:
        done: T = stop.value
        return done
    finally:
        waits.close()


def _rest(link: BaseLink, transport: Transport, seconds: float) -> None:
    if not transport.blocking():
        transport.sleep(seconds)
        return
    end = transport.now() + seconds
    while seconds > 0 and not link.superseded:
        transport.sleep(min(seconds, SLICE))
        seconds = end - transport.now()
