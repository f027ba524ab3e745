"""A session of a server for asyncio: what is asked beside the servos, and what the server tells by itself.

    async with RemoteSession(address, name="a page", client="page", deadman=0.3) as session:
        session.told = show                              # telemetry, events
        answer = await session.ask(Lease, bus="arm", servos=("dynamixel:1@57600",))
        async with AsyncBus(session.port("arm")) as bus: # it acts for this session
            ...

Signs of life are the caller's to give, by `beat`, unless `beats` is true: a page's stand for the person before it.
"""

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from types import TracebackType
from typing import Any, Self

from servobus.errors import PortError, PortLost
from servobus.remote.address import Address
from servobus.remote.faults import error_of
from servobus.remote.messages import LONGEST, decode, encode
from servobus.remote.port import CONNECT, RemotePort, where
from servobus.remote.protocol import Beat, Beaten, Failed, Hello, Refused, Welcome


class RemoteSession:
    """A session of a server; see the head of this module.

    token    what lets it in; by default that of the environment, or of the runtime file of a server here
    told     gets each message that answers nothing
    ended    called with the reason when the connection has ended
    delay    s that the last sign of life took there and back
    """

    def __init__(
        self,
        address: Address,
        *,
        name: str,
        client: str = "program",
        deadman: float = 0.0,
        beats: bool = False,
        token: str = "",
    ) -> None:
        self.address, self._token = address, token
        self.told: Callable[[Any], object] = _ignore
        self.ended: Callable[[str], object] = _ignore
        self.delay = 0.0
        self.welcome: Welcome
        self._hello = Hello("", name, client, deadman)
        self._beats = beats
        self._numbers = count(1)
        self._awaited: dict[int, asyncio.Future[Any]] = {}
        self._writer: asyncio.StreamWriter | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._why = ""

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    @property
    def id(self) -> str:
        """What the server calls this session."""
        return self.welcome.session

    async def open(self) -> None:
        """Connect. Raises PortError."""
        address = self.address
        host, port, token = (address.host, address.port, self._token) if self._token else where(address)
        hello = self._hello
        try:
            async with asyncio.timeout(CONNECT):
                reader, self._writer = await asyncio.open_connection(host, port, limit=LONGEST + 1)
                self._writer.write(encode(Hello(token, hello.name, hello.client, hello.deadman)))
                said = decode(await reader.readline())
        except (OSError, ValueError) as error:  # a line that is no message is a ValueError
            self._hang_up()
            raise PortError(f"{self.address}: no server of servobus answers at {host}:{port} ({error})") from error
        if not isinstance(said, Welcome):
            self._hang_up()
            raise PortError(f"{self.address}: {said.why if isinstance(said, Refused) else 'no welcome came'}")
        self.welcome, self._why = said, ""
        self._tasks = [asyncio.create_task(self._listen(reader))]
        if self._beats:
            self._tasks.append(asyncio.create_task(self._live()))

    async def close(self) -> None:
        """End the session: the server ends its leases, and makes safe what it drives."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks = []
        self._hang_up()

    def port(self, name: str) -> RemotePort:
        """Open a bus as a port that acts for this session: `AsyncBus(session.port("arm"))`. It takes a moment."""
        address = self.address
        place = Address(address.host, address.port, name)
        return RemotePort(place, name=self._hello.name, session=self.id, deadman=0.0, token=self._token)

    def tell(self, message: Any) -> None:
        """Send a message that is not answered. Raises PortLost."""
        if self._writer is None or self._writer.is_closing():
            raise PortLost(f"{self.address}: {self._why or 'the server has ended the connection'}")
        self._writer.write(encode(message))

    async def ask(self, kind: Callable[..., Any], **fields: Any) -> Any:
        """Send a request and give its answer. Raises the error that comes instead, or PortLost.

        `kind` is a class of messages with a number `n`, `fields` its other fields.
        """
        n = next(self._numbers)
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._awaited[n] = answer
        try:
            self.tell(kind(n=n, **fields))
            said = await answer
        finally:
            self._awaited.pop(n, None)
        if isinstance(said, Failed):
            raise error_of(said.fault)
        return said

    def beat(self) -> None:
        """Give a sign of life. Raises PortLost."""
        self.tell(Beat(time.monotonic()))

    async def _live(self) -> None:
        while True:
            await asyncio.sleep((self._hello.deadman or 1.0) / 4)
            with suppress(PortLost):
                self.beat()

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        try:
            while line := await reader.readline():
                self._sort(decode(line))
        except (OSError, ValueError) as error:
            self._why = self._why or str(error)
        self._end(self._why or "the server has ended the connection")

    def _sort(self, said: Any) -> None:
        if isinstance(said, Beaten):
            self.delay = time.monotonic() - said.time
        elif isinstance(said, Refused):
            self._why = said.why
        elif (answer := self._awaited.get(getattr(said, "n", 0))) is not None and not answer.done():
            answer.set_result(said)
        else:
            self.told(said)

    def _end(self, why: str) -> None:
        self._hang_up()
        self._why = why
        for answer in self._awaited.values():
            if not answer.done():
                answer.set_exception(PortLost(f"{self.address}: {why}"))
        self.ended(why)

    def _hang_up(self) -> None:
        if self._writer is not None:
            self._writer.close()


def _ignore(_: Any) -> None:
    """Pass over what is of no use."""
