"""The web process as a client of the process that owns the ports.

One session for all that pages and API do: it is watched, and its sign of life comes from the event loop. So where the
loop hangs, or the process dies, the owner of the ports makes safe what was set in motion from here.
"""

import asyncio
import json
from collections.abc import Callable, Iterable
from typing import Any

from servobus.bus.asyncio import AsyncBus
from servobus.remote.address import Address
from servobus.remote.managing import (
    Bench,
    CloseBus,
    Happened,
    LookAtBench,
    OpenBus,
    Resume,
    SaveBox,
    SetBench,
    StopServos,
    Traffic,
    WatchEvents,
    WatchTraffic,
)
from servobus.remote.port import RemotePort
from servobus.remote.session import RemoteSession

SESSION = "web"
"""Name of the session of this process."""
DEADMAN = 1.0
"""s after which this process is taken for hung. Its loop has been seen to stand still for 55 ms."""


class OwnerLink:
    """The connection to the process that owns the ports."""

    def __init__(self, host: str, port: int, token: str) -> None:
        self._host, self._port = host, port
        self._session = RemoteSession(
            Address(host, port, ""), name=SESSION, client="web", deadman=DEADMAN, beats=True, token=token
        )
        self._happened: Callable[[Happened], object] = _ignore
        self._traffic: dict[str, Callable[[Traffic], object]] = {}
        """Bus -> who is told of its bytes."""
        self.ended = asyncio.Event()
        """Set when the owner of the ports has gone: then this process has nothing to serve."""

    async def connect(self, told: Callable[[Happened], object]) -> dict[str, str]:
        """Connect; `told` is told of events from now on. Gives name -> port of the buses. Raises PortError."""
        self._happened = told
        self._session.told = self._told
        self._session.ended = self._ended
        await self._session.open()
        await self._session.ask(WatchEvents)
        return {info.name: info.port for info in self._session.welcome.buses}

    async def close(self) -> None:
        """End the connection: what was set in motion from here is made safe."""
        await self._session.close()

    async def bus(self, name: str) -> AsyncBus:
        """Give the driver of a bus, in the session of this process. Raises PortError."""
        return AsyncBus(await asyncio.to_thread(self.port, name))

    def port(self, name: str) -> RemotePort:
        """Open a bus in the session of this process; waits for the owner, so it belongs into a thread."""
        return self._session.port(name)

    def address(self, name: str) -> str:
        """Give the name of a bus as a port for other programs of ours."""
        return str(Address(self._host, self._port, name))

    async def open_bus(self, name: str, port: str) -> None:
        """Have a port opened as a bus. Raises UsageError, PortError."""
        await self._session.ask(OpenBus, bus=name, port=port)

    async def close_bus(self, name: str) -> None:
        """Have a bus closed."""
        await self._session.ask(CloseBus, bus=name)

    async def stop(self, bus: str = "", servos: Iterable[str] = ()) -> None:
        """Stop servos, or all of a bus, or all. Raises StopFailed."""
        await self._session.ask(StopServos, bus=bus, servos=tuple(servos))

    async def resume(self, bus: str) -> None:
        """Allow motion again."""
        await self._session.ask(Resume, bus=bus)

    async def save_box(self, bus: str, why: str) -> str:
        """Have the last minute of a bus saved; gives the path of the recording."""
        return str((await self._session.ask(SaveBox, bus=bus, why=why)).text)

    async def watch_traffic(self, bus: str, told: Callable[[Traffic], object]) -> None:
        """Have somebody told of the bytes on a bus from now on, in place of whoever was. Raises UsageError."""
        self._traffic[bus] = told
        await self._session.ask(WatchTraffic, bus=bus, on=True)

    async def forget_traffic(self, bus: str) -> None:
        """Tell nobody of the bytes on a bus any more."""
        self._traffic.pop(bus, None)
        await self._session.ask(WatchTraffic, bus=bus, on=False)

    async def bench(self, bus: str) -> Bench:
        """Give the virtual servos of a bus. Raises UsageError for a bus of real ones."""
        bench: Bench = await self._session.ask(LookAtBench, bus=bus)
        return bench

    async def set_bench(self, bus: str, **changes: Any) -> Bench:
        """Change what surrounds virtual servos; see `SetBench`. Raises BadValue, UsageError."""
        bench: Bench = await self._session.ask(SetBench, bus=bus, **changes)
        return bench

    def _told(self, message: Any) -> None:
        if isinstance(message, Happened):
            self._happened(message)
        elif isinstance(message, Traffic) and message.bus in self._traffic:
            self._traffic[message.bus](message)

    def _ended(self, _why: str) -> None:
        self.ended.set()


def _ignore(_: Happened) -> None:
    """Pass over what happens before somebody wants to know."""


def event_data(event: Happened) -> dict[str, Any]:
    """Give what an event says beyond its kind, for the clients of this process."""
    try:
        more = json.loads(event.data)
    except ValueError:
        more = {}
    said = {"bus": event.bus or None, "servo": event.servo or None, "by": event.by or None}
    return {name: value for name, value in said.items() if value is not None} | dict(more)
