"""The web process as a client of the process that owns the ports.

One session for all that pages and API do: it is watched, and its sign of life comes from the event loop. So where the
loop hangs, or the process dies, the owner of the ports makes safe what was set in motion from here.
"""

import asyncio
import json
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from typing import Any

from servobus.bus.asyncio import AsyncBus
from servobus.remote.address import Address
from servobus.remote.client import Client
from servobus.remote.managing import CloseBus, Happened, OpenBus, Resume, SaveBox, StopServos, WatchEvents
from servobus.remote.port import RemotePort

DEADMAN = 1.0
"""s after which this process is taken for hung. Its loop has been seen to stand still for 55 ms."""
BEAT = 0.2
"""s between two signs of life."""
SESSION = "web"
"""How the owner of the ports calls this process; who of its users asks is known here alone."""


class OwnerLink:
    """The connection to the process that owns the ports."""

    def __init__(self, host: str, port: int, token: str) -> None:
        self._host, self._port, self._token = host, port, token
        self._client: Client
        self._beating: asyncio.Task[None] | None = None
        self.ended = asyncio.Event()
        """Set when the owner of the ports has gone: then this process has nothing to serve."""

    async def connect(self, told: Callable[[Happened], object]) -> dict[str, str]:
        """Connect; `told` is told of events from now on. Gives name -> port of the buses. Raises PortError."""
        self._client = await Client.connect(
            self._host, self._port, self._token, name=SESSION, client="web", deadman=DEADMAN
        )
        self.ended = self._client.ended
        self._client.listen(Happened, told)
        self._beating = asyncio.get_running_loop().create_task(self._beat())
        await self._client.ask(WatchEvents)
        return {info.name: info.port for info in self._client.welcome.buses}

    async def close(self) -> None:
        """End the connection: what was set in motion from here is made safe."""
        if self._beating is not None:
            self._beating.cancel()
            with suppress(asyncio.CancelledError):
                await self._beating
            await self._client.close()

    async def bus(self, name: str) -> AsyncBus:
        """Give the driver of a bus, in the session of this process. Raises PortError."""
        address = Address(self._host, self._port, name)
        make = partial(
            RemotePort, address, name=SESSION, session=self._client.welcome.session, deadman=0.0, token=self._token
        )
        return AsyncBus(await asyncio.to_thread(make))

    async def open_bus(self, name: str, port: str) -> None:
        """Have a port opened as a bus. Raises UsageError, PortError."""
        await self._client.ask(OpenBus, bus=name, port=port)

    async def close_bus(self, name: str) -> None:
        """Have a bus closed."""
        await self._client.ask(CloseBus, bus=name)

    async def stop(self, bus: str = "", servos: Iterable[str] = ()) -> None:
        """Stop servos, or all of a bus, or all. Raises StopFailed."""
        await self._client.ask(StopServos, bus=bus, servos=tuple(servos))

    async def resume(self, bus: str) -> None:
        """Allow motion again."""
        await self._client.ask(Resume, bus=bus)

    async def save_box(self, bus: str, why: str) -> str:
        """Have the last minute of a bus saved; gives the path of the recording."""
        return str((await self._client.ask(SaveBox, bus=bus, why=why)).text)

    async def _beat(self) -> None:
        while not self._client.why:
            self._client.beat()
            await asyncio.sleep(BEAT)


def event_data(event: Happened) -> dict[str, Any]:
    """Give what an event says beyond its kind, for the clients of this process."""
    try:
        more = json.loads(event.data)
    except ValueError:
        more = {}
    said = {"bus": event.bus or None, "servo": event.servo or None, "by": event.by or None}
    return {name: value for name, value in said.items() if value is not None} | dict(more)
