"""A server of buses in a thread of the test, and clients of it."""

import asyncio
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from servobus import Bus
from servobus.bus.asyncio import AsyncBus
from servobus.connect import transport
from servobus.remote.address import Address
from servobus.remote.port import RemotePort
from servobus.server.ports.gate import Gate
from servobus.server.ports.owner import PortOwner
from servobus.server.ports.service import Service
from servobus.transports.base import Transport

TOKEN, VIEWER = "open sesame", "only look"
PATIENCE = 30.0
"""s; a limit against hanging, and never a measurement."""


class Hosted:
    """Serves buses while it is open: name -> the name of a port, or a port."""

    def __init__(self, ports: Mapping[str, str | Transport], gate: Gate | None = None) -> None:
        self._ports, self._gate = ports, gate
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()))
        self.service: Service
        self.port = 0
        self._loop: asyncio.AbstractEventLoop
        self._over: asyncio.Event

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._ready.wait(PATIENCE)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

    def address(self, name: str) -> Address:
        return Address("127.0.0.1", self.port, name)

    def bus(self, name: str, **how: Any) -> Bus:
        """Open a bus of it."""
        return Bus(RemotePort(self.address(name), name="a test"), **how)

    def async_bus(self, name: str, **how: Any) -> AsyncBus:
        """Open a bus of it for asyncio."""
        return AsyncBus(RemotePort(self.address(name)), **how)

    def told(self, work: Callable[[], Any]) -> Any:
        """Give what work in the server's loop gives."""

        async def done() -> Any:
            return work()

        return asyncio.run_coroutine_threadsafe(done(), self._loop).result(PATIENCE)

    def add(self, port: Transport, *, echo: bool | None = None) -> str:
        """Serve one more port from now on; give its name."""
        name = f"bus{len(self.service.buses)}"

        def work() -> None:
            self.service.buses[name] = AsyncBus(port, echo=echo)

        self.told(work)
        return name

    async def _serve(self) -> None:
        self._loop, self._over = asyncio.get_running_loop(), asyncio.Event()
        buses = {
            name: AsyncBus(transport(port) if isinstance(port, str) else port) for name, port in self._ports.items()
        }
        self.service = Service(buses, {TOKEN: "operator"}, self._gate)
        server = await self.service.listen("127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()
        await self._over.wait()
        self.service.close()
        server.close()
        await server.wait_closed()
        for bus in self.service.buses.values():
            bus.close()


class Owned(Hosted):
    """As `Hosted`, with all that the owner of the ports does for its clients."""

    def __init__(self, ports: Mapping[str, str], boxes: Path) -> None:
        super().__init__(ports)
        self._boxes = boxes
        self.owner: PortOwner

    async def _serve(self) -> None:
        self._loop, self._over = asyncio.get_running_loop(), asyncio.Event()
        self.owner = PortOwner({TOKEN: "operator", VIEWER: "viewer"}, boxes=self._boxes)
        self.service = self.owner.service
        for name, port in self._ports.items():
            assert isinstance(port, str)
            self.owner.open_bus(name, port)
        server = await self.service.listen("127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()
        await self._over.wait()
        server.close()
        await self.owner.close()
        await server.wait_closed()
