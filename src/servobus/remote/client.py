"""A client of a server's process that owns the ports, for asyncio: leases, stops, telemetry and events.

    async with await Client.connect("127.0.0.1", 7381, token, name="page of Anna", deadman=0.3) as client:
        client.listen(Telemetry, print)
        await client.ask(Subscribe, bus="arm", servos=(), period=0.1)
        client.beat()

Reads, writes and moves go through a bus (servobus.remote.port) that belongs to the same session.
"""

import asyncio
import ssl
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from types import TracebackType
from typing import Any, Self, TypeVar

from servobus.errors import PortError, PortLost
from servobus.remote.faults import error_of
from servobus.remote.messages import LONGEST, Malformed, decode, encode
from servobus.remote.protocol import Beat, Failed, Hello, Refused, Welcome

M = TypeVar("M")

CONNECT = 5.0
"""s within which a server must have answered the first words."""


class Client:
    """One connection to a server, and the session that it begins or belongs to.

    welcome  what the server said at first
    why      why the connection has ended; empty as long as it stands
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self.welcome: Welcome
        self.why = ""
        self._numbers = count(1)
        self._awaited: dict[int, asyncio.Future[Any]] = {}
        self._listeners: dict[type, list[Callable[[Any], object]]] = {}
        self._task: asyncio.Task[None] | None = None
        self.ended = asyncio.Event()
        """Set when the connection has ended."""

    @classmethod
    async def connect(
        cls,
        host: str,
        port: int,
        token: str,
        *,
        name: str,
        client: str = "program",
        deadman: float = 0.0,
        session: str = "",
        tls: ssl.SSLContext | None = None,
    ) -> Self:
        """Connect, and say who it is; see `Hello`. Raises PortError."""
        try:
            async with asyncio.timeout(CONNECT):
                streams = await asyncio.open_connection(host, port, limit=LONGEST, ssl=tls)
                made = cls(*streams)
                made._send(Hello(token, name, client, deadman, session))
                first = decode(await made._reader.readline() or b"{}")
        except (OSError, TimeoutError, Malformed) as error:
            raise PortError(f"{host}:{port}: no server answers there: {error}") from error
        if not isinstance(first, Welcome):
            made._writer.close()
            raise PortError(f"{host}:{port}: {first.why if isinstance(first, Refused) else 'not understood'}")
        made.welcome = first
        made._task = asyncio.get_running_loop().create_task(made._read())
        return made

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """End the connection, and with it the session that it began: its servos are made safe."""
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task
        self._end("closed")
        with suppress(OSError):
            self._writer.close()
            await self._writer.wait_closed()

    async def ask(self, kind: Callable[..., M], /, **fields: Any) -> Any:
        """Send a request, and give the message that answers it. Raises its error, or PortLost."""
        if self.why:
            raise PortLost(f"the connection to the server has ended: {self.why}")
        n = next(self._numbers)
        answer = self._awaited[n] = asyncio.get_running_loop().create_future()
        try:
            self._send(kind(n=n, **fields))
            return await answer
        finally:
            self._awaited.pop(n, None)

    def beat(self) -> None:
        """Give a sign of life: without one in time the session is taken for hung."""
        if not self.why:
            self._send(Beat(asyncio.get_running_loop().time()))

    def listen(self, kind: type[M], listener: Callable[[M], object]) -> None:
        """Have a listener told of all messages of a kind that come by themselves."""
        self._listeners.setdefault(kind, []).append(listener)

    def _send(self, message: Any) -> None:
        self._writer.write(encode(message))

    async def _read(self) -> None:
        why = "the server has gone"
        try:
            while line := await self._reader.readline():
                message = decode(line)
                if isinstance(message, Refused):
                    why = message.why
                else:
                    self._take(message)
        except (OSError, ValueError) as error:  # a line that is too long, or no message, too
            why = str(error)
        self._end(why)

    def _take(self, message: Any) -> None:
        answer = self._awaited.get(getattr(message, "n", 0))
        if answer is None:
            for listener in self._listeners.get(type(message), ()):
                listener(message)
        elif not answer.done():
            if isinstance(message, Failed):
                answer.set_exception(error_of(message.fault))
            else:
                answer.set_result(message)

    def _end(self, why: str) -> None:
        self.why = self.why or why
        for answer in self._awaited.values():
            if not answer.done():
                answer.set_exception(PortLost(f"the connection to the server has ended: {self.why}"))
        self.ended.set()
