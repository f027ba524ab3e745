"""The process that owns the ports, as its clients see it: an event loop, buses by name, and who is connected.

    async with AsyncBus(...) as bus:
        service = Service({"arm": bus}, {token: "operator"})
        server = await service.listen("127.0.0.1", 0)
        await server.serve_forever()

What clients may ask beyond the steps of procedures is a table, `Service.handlers`: class of messages -> function of the
connection and the message. A function that needs time answers through `Connection.begin`.
"""

import asyncio
import hmac
import secrets
import ssl
from collections.abc import Callable, Coroutine, Mapping
from typing import Any, TypeAlias

from servobus.bus.asyncio import AsyncBus
from servobus.errors import ServobusError, UnknownName, UsageError
from servobus.remote.faults import fault
from servobus.remote.messages import LONGEST, VERSION, Malformed, encode
from servobus.remote.protocol import (
    KINDS_OF_CLIENTS,
    Beat,
    Beaten,
    BusInfo,
    Failed,
    Hello,
    Refused,
    Release,
    RequestReader,
    SentRequest,
    Supersede,
    Welcome,
)
from servobus.server.ports.gate import Gate, PermitAll
from servobus.server.ports.steps import BusSteps, Exchanges, log_failure

GREETING = 5.0
"""s within which a client must have said its first words."""
FIRST_WORDS = 4096
"""Bytes that these may have."""
MOST_CONNECTIONS = 256
MOST_RATE = 10_000
"""Messages a second that one connection may send."""
MOST_UNREAD = 4 << 20
"""Bytes that may wait for a client that does not read; then it is closed."""
CROWDED = 64 << 10
"""Bytes from which on a client gets no more of what it can do without."""
LONGEST_NAME = 80
LONGEST_DEADMAN = 60.0


class Session:
    """One client, by however many connections: what holds leases and has a deadman.

    name     what people know it by
    client   what it is; one of KINDS_OF_CLIENTS
    role     what it may do; one of ROLES
    deadman  s after which it is taken for hung; 0 if nothing hangs on that
    silent   whether it is taken for hung now
    """

    def __init__(self, hello: Hello, role: str) -> None:
        self.id = secrets.token_hex(8)
        self.name, self.client, self.role, self.deadman = hello.name, hello.client, role, hello.deadman
        self.token = hello.token
        self.connections: list[Connection] = []
        """The first one began it, and ends it by its end."""
        self.heard = 0.0
        """When something was last heard of it, by the clock of the event loop."""
        self.silent = False

    def __repr__(self) -> str:
        return f"<session of {self.name}, {self.client}, {self.role}>"


Handler: TypeAlias = Callable[["Connection", Any], None]


class Service:
    """Buses, and the clients that share them.

    buses     name -> bus; buses may come and go
    tokens    token -> what it lets a client do; see ROLES
    gate      decides which requests go out
    handlers  class of messages -> what is done with one
    sessions  id -> session
    """

    def __init__(self, buses: Mapping[str, AsyncBus], tokens: Mapping[str, str], gate: Gate | None = None) -> None:
        self.buses = dict(buses)
        self.tokens = dict(tokens)
        self.gate: Gate = PermitAll() if gate is None else gate
        self.sessions: dict[str, Session] = {}
        self.connections: set[Connection] = set()
        self.exchanges = Exchanges()
        self.handlers: dict[type, Handler] = {
            Beat: _beat,
            SentRequest: _step,
            Release: _release,
            Supersede: _supersede,
        }
        self.gone: set[str] = set()
        """Names of the buses whose ports are gone for now."""

    async def listen(self, host: str, port: int, tls: ssl.SSLContext | None = None) -> asyncio.Server:
        """Begin to listen for clients."""
        loop = asyncio.get_running_loop()
        return await loop.create_server(lambda: Connection(self), host, port, ssl=tls)

    def close(self, why: str = "the server ends") -> None:
        """End all connections."""
        for connection in list(self.connections):
            connection.close(why)

    def infos(self) -> tuple[BusInfo, ...]:
        """Tell which buses there are."""
        return tuple(
            BusInfo(
                name,
                bus.transport.name,
                bus.transport.lasting_name,
                bus.transport.baud_elsewhere,
                name not in self.gone and not bus.safety.closed,
            )
            for name, bus in self.buses.items()
        )

    def bus(self, name: str) -> AsyncBus:
        """Give a bus. Raises UnknownName."""
        bus = self.buses.get(name)
        if bus is None:
            raise UnknownName(f"no bus {name!r:.60} here; there are: {', '.join(self.buses) or 'none'}")
        return bus

    def role(self, token: str) -> str | None:
        """Give what a token lets a client do; None if it is none of ours."""
        given = token.encode()
        found = [role for known, role in self.tokens.items() if hmac.compare_digest(known.encode(), given)]
        return found[0] if found else None


class Connection(asyncio.Protocol):
    """One connection of a client."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self.session: Session | None = None
        self.at_end: list[Callable[[], object]] = []
        """Called when the connection has ended."""
        self._loop = asyncio.get_running_loop()
        self._transport: asyncio.Transport | None = None
        self._buffer = b""
        self._reader = RequestReader()
        self._closing = False
        self._last = 0
        """The number of the last request."""
        self._buses: dict[str, BusSteps] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._timer: asyncio.TimerHandle | None = None
        self._budget = float(MOST_RATE)
        """Messages that it may send right now."""
        self._counted_at = 0.0

    # For those who answer

    @property
    def who(self) -> Session:
        """The session whose request is answered."""
        assert self.session is not None
        return self.session

    def tell(self, message: Any) -> None:
        """Send a message. A client that does not read what it is sent is closed."""
        if self._transport is None or self._closing:
            return
        if self._transport.get_write_buffer_size() > MOST_UNREAD:
            self._transport.abort()
            return
        self._transport.write(encode(message))

    @property
    def crowded(self) -> bool:
        """Whether the client is behind with reading: then only what it must have is sent."""
        return self._transport is not None and self._transport.get_write_buffer_size() > CROWDED

    def begin(self, n: int, work: Coroutine[Any, Any, Any]) -> asyncio.Task[None]:
        """Begin work that ends with the connection; its result is the answer to request `n`, or its error is."""

        async def answered() -> None:
            try:
                self.tell(await work)
            except Exception as error:  # noqa: BLE001 - a client must not end what serves the others
                self._fail(n, error)

        task = self._loop.create_task(answered())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def steps(self, name: str) -> BusSteps:
        """Give what this connection does on a bus. Raises UnknownName."""
        bus = self.service.bus(name)
        steps = self._buses.get(name)
        if steps is None or steps.bus is not bus:
            assert self.session is not None
            service = self.service
            steps = BusSteps(self.session, name, bus, service.gate, service.exchanges, self.tell)
            self._buses[name] = steps
        return steps

    def close(self, why: str) -> None:
        """End the connection, and say why."""
        self.tell(Refused(why))
        self._closing = True
        if self._transport is not None:
            self._transport.close()

    # What comes

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._counted_at = self._loop.time()
        if len(self.service.connections) >= MOST_CONNECTIONS:
            self.close(f"there are {MOST_CONNECTIONS} connections already")
            return
        self.service.connections.add(self)
        self._timer = self._loop.call_later(GREETING, self.close, "no hello came")

    def data_received(self, data: bytes) -> None:
        *lines, self._buffer = (self._buffer + data).split(b"\n") if self._buffer else data.split(b"\n")
        for line in lines:
            if self._closing:
                return
            if len(line) > (LONGEST if self.session is not None else FIRST_WORDS):
                self.close("the line is too long")
                return
            self._take(line)
        if len(self._buffer) > (LONGEST if self.session is not None else FIRST_WORDS):
            self.close("the line is too long")

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - whatever the reason
        self._closing = True
        self.service.connections.discard(self)
        if self._timer is not None:
            self._timer.cancel()
        for steps in self._buses.values():
            steps.break_off("its client has gone")
        for task in list(self._tasks):
            task.cancel()
        for end in self.at_end:
            end()
        session = self.session
        if session is None:
            return
        first = session.connections[0] is self
        session.connections.remove(self)
        if first:
            self.service.sessions.pop(session.id, None)
            self.service.gate.left(session)
            for other in list(session.connections):
                other.close("its session has ended")

    def _take(self, line: bytes) -> None:
        now = self._loop.time()
        self._budget = min(self._budget + (now - self._counted_at) * MOST_RATE, MOST_RATE) - 1
        self._counted_at = now
        if self._budget < 0:
            self.close(f"more than {MOST_RATE} messages a second")
            return
        try:
            message = self._reader.read(line)
        except Malformed as error:
            if self.session is None:
                self.close(f"that was no hello: {error}")
            else:
                self.tell(Failed(0, fault(UsageError(f"not understood: {error}"))))
            return
        session = self.session
        if session is None:
            self._greet(message)
            return
        if session.connections[0] is self:
            session.heard, session.silent = now, False
        handler = self.service.handlers.get(type(message))
        n = getattr(message, "n", None)
        if handler is None:
            self.tell(Failed(n or 0, fault(UsageError(f"{type(message).__name__} is nothing that a server is asked"))))
            return
        if isinstance(n, int):
            if n <= self._last:
                self.close(f"request {n} came after request {self._last}")
                return
            self._last = n
        try:
            handler(self, message)
        except Exception as error:  # noqa: BLE001 - a fault here must not stop all that its client drives
            self._fail(n or 0, error)

    def _fail(self, n: int, error: Exception) -> None:
        """Answer a request with the error that came of it."""
        if not isinstance(error, ServobusError):
            log_failure(f"request {n} of {self.session.name if self.session else 'nobody'} failed", error)
        self.tell(Failed(n, fault(error)))

    # The first words

    def _greet(self, hello: Any) -> None:
        service = self.service
        role = service.role(hello.token) if isinstance(hello, Hello) else None
        if not isinstance(hello, Hello):
            self.close("a client says hello first")
        elif hello.version != VERSION:
            self.close(f"version {VERSION} of the protocol is spoken here, not {hello.version}")
        elif role is None:
            self.close("the token is not one of this server; SERVOBUS_TOKEN gives it to programs")
        elif hello.client not in KINDS_OF_CLIENTS or len(hello.name) > LONGEST_NAME:
            self.close("a client has a name and is one of " + ", ".join(KINDS_OF_CLIENTS))
        elif not 0 <= hello.deadman <= LONGEST_DEADMAN:
            self.close(f"a deadman of {hello.deadman:g} s is not within 0 .. {LONGEST_DEADMAN:g} s")
        elif (session := self._session(hello, role)) is None:
            self.close("there is no such session")
        else:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            self.session = session
            session.connections.append(self)
            if session.connections[0] is self and session.deadman:
                self._watch()
            self.tell(Welcome(session.id, session.role, self._loop.time(), service.infos()))

    def _session(self, hello: Hello, role: str) -> Session | None:
        """Give the session that a client begins, or belongs to; None if there is no such session."""
        sessions = self.service.sessions
        if hello.session:
            session = sessions.get(hello.session)
            return session if session is not None and hmac.compare_digest(session.token, hello.token) else None
        session = Session(hello, role)
        session.heard = self._loop.time()
        sessions[session.id] = session
        return session

    def _watch(self) -> None:
        """Look whether the session is still heard of."""
        session = self.session
        assert session is not None
        left = session.heard + session.deadman - self._loop.time()
        if left <= 0 and not session.silent:
            session.silent = True
            self.service.gate.silent(session)
        self._timer = self._loop.call_later(left if left > 0 else session.deadman / 4, self._watch)


def _beat(connection: Connection, beat: Beat) -> None:
    connection.tell(Beaten(beat.time, asyncio.get_running_loop().time()))


def _step(connection: Connection, request: SentRequest) -> None:
    if not connection.steps(request.bus).put(request):
        connection.close(f"too many requests wait for bus {request.bus}")


def _release(connection: Connection, release: Release) -> None:
    connection.steps(release.bus).release()


def _supersede(connection: Connection, supersede: Supersede) -> None:
    connection.steps(supersede.bus).break_off("interrupted: the line was needed to make the servos safe")
