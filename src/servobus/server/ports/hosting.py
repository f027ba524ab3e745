"""Opening ports for others: buses by name, the service that shares them, and the file by which programs find it."""

import os
import secrets
import ssl
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager

from servobus.bus.asyncio import AsyncBus
from servobus.connect import open_async
from servobus.errors import UsageError
from servobus.remote.runtime import RuntimeFile, Server
from servobus.server.ports.gate import Gate
from servobus.server.ports.service import Service

HOST = "127.0.0.1"


class Host:
    """A service that others find.

    service  what clients talk to
    server   what the runtime file says of it
    """

    def __init__(self, service: Service, server: Server) -> None:
        self.service, self.server = service, server
        self._file = RuntimeFile(server)

    def tell(self, *, http: str | None = None) -> None:
        """Tell others of the buses that there are now, and of the address of the pages if there is a new one."""
        old = self.server
        buses = tuple((name, bus.transport.name) for name, bus in self.service.buses.items())
        self.server = Server(old.pid, old.host, old.port, old.token, old.http if http is None else http, buses)
        self._file.tell(self.server)

    def close(self) -> None:
        """Be found no more."""
        self._file.close()


@asynccontextmanager
async def hosting(
    ports: Mapping[str, str],
    *,
    address: tuple[str, int] = (HOST, 0),
    gate: Callable[[Mapping[str, AsyncBus]], Gate] | None = None,
    tls: ssl.SSLContext | None = None,
) -> AsyncIterator[Host]:
    """Share ports, name -> port, while the block runs; on the way out servos that are driven are made safe.

    Programs of this user are let in as operators by the token of the runtime file. `gate` makes what decides which
    requests go out. Raises PortError, UsageError for a port on a virtual clock: its time passes only while its one
    owner waits.
    """
    async with AsyncExitStack() as stack:
        buses: dict[str, AsyncBus] = {}
        for name, port in ports.items():
            bus = buses[name] = await stack.enter_async_context(open_async(port))
            if not bus.transport.blocking():
                raise UsageError(f"{port}: its clock is virtual, and several cannot share it; leave clock=virtual out")
        token = secrets.token_urlsafe(32)
        service = Service(buses, {token: "operator"}, None if gate is None else gate(buses))
        listener = await service.listen(*address, tls)
        stack.callback(listener.close)
        host, port_number = listener.sockets[0].getsockname()[:2]
        told = tuple((name, bus.transport.name) for name, bus in buses.items())
        found = Host(service, Server(os.getpid(), host, port_number, token, "", told))
        stack.callback(found.close)
        try:
            yield found
        finally:
            service.close()
            for bus in service.buses.values():
                await bus.make_safe(interrupt=True)
