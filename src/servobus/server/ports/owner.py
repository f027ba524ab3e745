"""The ports of a server: how they are opened, watched, and left.

owner = PortOwner({token: "operator"}, boxes=folder)
owner.open_bus("arm", "/dev/ttyUSB0")
server = await owner.service.listen("127.0.0.1", 0)
...
await owner.close()                                 # leaves every servo as its safe action says
"""

import asyncio
from collections.abc import Callable, Hashable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

from servobus import connect
from servobus.bus.servo import Servo
from servobus.errors import PortError, ServobusError, UsageError
from servobus.server.ports.control import Control
from servobus.server.ports.desk import Desk
from servobus.server.ports.events import Event, Events
from servobus.server.ports.served_bus import ServedBus, key_of
from servobus.server.ports.service import Connection, Service
from servobus.server.ports.telemetry import Values
from servobus.transports.base import Transport

LOOK = 1.0
"""s between two looks whether a port is still there, and two tries to open one again that is gone."""
MOST_BUSES = 32
LONGEST_NAME = 60


class PortOwner:
    """The buses of a server, and all who use them.

    tokens  token -> what it lets a client do; see `servobus.remote.protocol.ROLES`
    boxes   folder for the black boxes that are saved
    record  folder for recordings that go on all the time; without it there are none
    opened  opens a port by its name
    """

    def __init__(
        self,
        tokens: Mapping[str, str],
        *,
        boxes: Path,
        record: Path | None = None,
        opened: Callable[[str], Transport] = connect.transport,
    ) -> None:
        self.events = Events()
        self.buses: dict[str, ServedBus] = {}
        self.control = Control(self.buses, self.events)
        self.service = Service({}, tokens, self.control)
        self.boxes, self._record, self._opened = boxes, record, opened
        self._tasks: dict[str, list[asyncio.Task[None]]] = {}
        self.desk = Desk(self)
        self.events.listen(self._keep)

    def open_bus(self, name: str, port: str, *, by: str = "") -> ServedBus:
        """Open a port as a bus. Asks nothing, moves nothing. Raises UsageError, PortError."""
        if name in self.buses:
            raise UsageError(f"there is a bus {name!r} already")
        if not name.isprintable() or not 0 < len(name) <= LONGEST_NAME or "/" in name:
            raise UsageError(f"{name!r:.70} is no name of a bus: up to {LONGEST_NAME} letters, without a slash")
        if len(self.buses) >= MOST_BUSES:
            raise UsageError(f"{MOST_BUSES} buses are open already")
        record = None if self._record is None else self._record / f"{name}.rec"
        served = ServedBus(name, self._opened(port), partial(self._deliver, name), record=record)
        self.buses[name], self.service.buses[name] = served, served.bus
        loop = asyncio.get_running_loop()
        self._tasks[name] = [loop.create_task(served.telemetry.run()), loop.create_task(self._attend(served))]
        self.events.tell("opened", bus=name, by=by, port=port)
        return served

    async def close_bus(self, name: str, *, by: str = "") -> None:
        """Make safe what is driven on a bus, and give its port back. Raises UsageError for a bus that is not there."""
        served = self.control.bus(name)
        for task in self._tasks.pop(name):
            task.cancel()
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(None, partial(served.bus.safety.end, safe=True))
        del self.buses[name], self.service.buses[name]
        self.service.gone.discard(name)
        served.close()
        self.events.tell("closed", bus=name, by=by)

    async def close(self) -> None:
        """Leave every servo as its safe action says, and end."""
        self.service.close()
        await self.control.settled()
        await asyncio.gather(*(self.close_bus(name) for name in list(self.buses)), return_exceptions=True)

    # What goes on by itself

    def _keep(self, event: Event) -> None:
        """Keep an event in the black box of its bus."""
        served = self.buses.get(event.bus)
        if served is not None:
            served.box.note(event.what, {"servo": event.servo, "by": event.by, "more": event.data})

    def _deliver(
        self,
        name: str,
        client: Hashable,
        now: float,
        seen: Mapping[Servo, Values],
        lost: Mapping[Servo, str],
    ) -> None:
        served = self.buses[name]
        for servo, values in seen.items():
            served.box.note("telemetry", {"servo": key_of(servo), "values": dict(values)})
        assert isinstance(client, Connection)
        self.desk.show(client, served, now, seen, lost)

    async def _attend(self, served: ServedBus) -> None:
        """See whether the port is there, and open it again when it is back."""
        gone = self.service.gone
        while True:
            await asyncio.sleep(LOOK)
            if served.name not in gone:
                try:
                    served.tap.pending()
                except PortError as error:
                    gone.add(served.name)
                    self.events.tell("gone", bus=served.name, why=str(error))
                continue
            with suppress(ServobusError, OSError):
                report = await served.bus.reopen()
                gone.discard(served.name)
                self.events.tell("back", bus=served.name, text=str(report))
