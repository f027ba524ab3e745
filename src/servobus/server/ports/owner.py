"""The process that owns the ports: what its clients may ask beyond the steps of procedures, and how ports come and go.

    owner = PortOwner({token: "operator"})
    owner.open_bus("arm", "/dev/ttyUSB0")
    server = await owner.service.listen("127.0.0.1", 0)
    ...
    await owner.close()                                 # leaves every servo as its safe action says

A stop goes before everything: it is begun while its message is being read, in a thread that waits for nobody but the
job that has the line, and for that no longer than a stop waits.
"""

import asyncio
from collections.abc import Callable, Coroutine, Hashable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from servobus import connect
from servobus.bus.asyncio import AsyncBusServo
from servobus.bus.servo import Servo
from servobus.core.operation import Priority
from servobus.core.present import si_value
from servobus.errors import PortError, ServobusError, StopFailed, UsageError
from servobus.families import registry
from servobus.families.record import SafeAction
from servobus.remote.managing import (
    CloseBus,
    Done,
    EndLease,
    Happened,
    Introduce,
    ListServos,
    OpenBus,
    Resume,
    SaveBox,
    Seen,
    ServoInfo,
    Servos,
    StopServos,
    Subscribe,
    TakeLease,
    Telemetry as TelemetryMessage,
    Traffic,
    Unsubscribe,
    WatchEvents,
    WatchTraffic,
)
from servobus.safety.safe_stop import ACTIONS, check_safe_action
from servobus.server.ports.control import Control, require
from servobus.server.ports.events import Event, Events
from servobus.server.ports.served_bus import ServedBus, key_of
from servobus.server.ports.service import Connection, Service
from servobus.server.ports.telemetry import Telemetry, Values, Wish, check_wish, overview
from servobus.traffic.recording import Chunk, Line

LOOK = 1.0
"""s between two tries to open a port again that is gone."""
MOST_BUSES = 32


class PortOwner:
    """The buses of a server, and all who use them.

    tokens  token -> what it lets a client do
    boxes   folder for the black boxes that are saved
    record  folder for recordings that go on all the time; none are made without it
    opened  opens a port by its name
    """

    def __init__(
        self,
        tokens: Mapping[str, str],
        *,
        boxes: Path,
        record: Path | None = None,
        opened: Callable[[str], Any] = connect.transport,
    ) -> None:
        self.events = Events()
        self.buses: dict[str, ServedBus] = {}
        self.control = Control(self.buses, self.events)
        self.service = Service({}, tokens, self.control)
        self._boxes, self._record, self._opened = boxes, record, opened
        self._telemetry: dict[str, Telemetry] = {}
        self._tasks: dict[str, list[asyncio.Task[None]]] = {}
        self._watching: dict[Connection, dict[Hashable, Callable[[], object]]] = {}
        """Connection -> what it watches -> what ends that."""
        self.events.listen(self._keep)
        self.service.on_leave = self._left
        self.service.handlers.update(
            {
                TakeLease: self._take_lease,
                EndLease: self._end_lease,
                StopServos: self._stop,
                Resume: self._resume,
                ListServos: self._list,
                Introduce: self._introduce,
                OpenBus: self._open,
                CloseBus: self._close,
                Subscribe: self._subscribe,
                Unsubscribe: self._unsubscribe,
                WatchTraffic: self._watch_traffic,
                WatchEvents: self._watch_events,
                SaveBox: self._save,
            }
        )

    # Buses

    def open_bus(self, name: str, port: str, *, by: str = "") -> ServedBus:
        """Open a port as a bus. Asks nothing, moves nothing. Raises UsageError, PortError."""
        if name in self.buses:
            raise UsageError(f"there is a bus {name!r} already")
        if not name.isprintable() or not 0 < len(name) <= 60 or "/" in name:
            raise UsageError(f"{name!r:.70} is no name of a bus: up to 60 letters, without a slash")
        if len(self.buses) >= MOST_BUSES:
            raise UsageError(f"{MOST_BUSES} buses are open already")
        record = None if self._record is None else self._record / f"{name}.rec"
        served = ServedBus(name, self._opened(port), record=record)
        self.buses[name] = self.service.buses_served[name] = served  # type: ignore[attr-defined]
        telemetry = self._telemetry[name] = Telemetry(served.bus, partial(self._deliver, served))
        loop = asyncio.get_running_loop()
        self._tasks[name] = [loop.create_task(telemetry.run()), loop.create_task(self._attend(served))]
        self.events.tell("opened", bus=name, by=by, port=port)
        return served

    async def close_bus(self, name: str, *, by: str = "") -> None:
        """Make safe what is driven on a bus, and give its port back."""
        served = self._bus(name)
        for task in self._tasks.pop(name):
            task.cancel()
        del self._telemetry[name]
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(None, partial(served.bus.safety.end, safe=True))
        del self.buses[name], self.service.buses[name]
        served.close()
        self.events.tell("closed", bus=name, by=by)

    async def close(self) -> None:
        """Leave every servo as its safe action says, and end."""
        self.service.close()
        await self.control.settled()
        await asyncio.gather(*(self.close_bus(name) for name in list(self.buses)), return_exceptions=True)
