"""Ports for programs of other makes, which share a bus without knowing it.

Each is a port of its own for one program at a time: a pseudo terminal, which the program opens like a serial port, or a
TCP port. Whole requests are taken from it and put on the line in turn with everybody's, at the speed that the program
has set; only the answers to its own requests go back, and only as long as it surely waits for them. What is refused,
not answered, or answered too late meets with silence, as from a servo that is not there. It is sent once: to ask again
is the program's business.
"""

import asyncio
import socket
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from servobus.bus.asyncio import AsyncBus
from servobus.core.effect import Effect, Kind
from servobus.core.exchange import Batch, Exchange, Procedure
from servobus.core.framing import BITS_PER_BYTE, Packet
from servobus.core.operation import Priority
from servobus.errors import NoReply, PortError, ServobusError
from servobus.families import registry
from servobus.families.base import Answers, Family, Model
from servobus.link.link import Link
from servobus.server.ports.gate import Gate
from servobus.server.ports.requests import AnswerHabits, Request, RequestCutter, exchange_of
from servobus.transports.pty import PseudoTerminal

PARTIAL = 0.1
"""s after which the rest of a request is not waited for any more; servos do it so too (RX-28 manual, appendix)."""
MOST_WAITING = 64
"""Requests of one program that may wait for the line; if more come, the oldest are dropped."""
ANSWERED_WITHIN = 0.015
"""s within which an answer must be there, beyond what its bits and the port take. A program that has given up may take
what comes later for the answer to its next question: the DYNAMIXEL SDK gives up after 34 ms and drops nothing that it
has not read, pylx16a after 20 ms."""
HELD_BACK = 0.016
"""s for which an adapter may usually hold bytes back: the latency timer of an FTDI chip, as it comes."""
LOOK = 0.02
"""s between two looks whether a program has opened a pseudo terminal: until then it cannot be waited for."""
CHUNK = 4096


@dataclass
class Counts:
    """What happened on one port so far."""

    requests: int = 0
    answered: int = 0
    silent: int = 0
    """Requests whose answer was awaited and did not come."""
    refused: int = 0
    """Requests that were not sent, as somebody else holds the servo, or a stop forbids it."""
    outdated: int = 0
    """Questions and answers that the program did not wait for any more: too late, or behind its next question."""
    dropped: int = 0
    """Requests that were never sent, as too many came after them."""
    garbage: int = 0
    """Bytes that were part of no request."""


@dataclass(frozen=True)
class _Waiting:
    """A request on its way: which it is in the program's order, of which program, and when it came."""

    request: Request
    number: int
    program: int
    asked: float


class ForeignPort(ABC):
    """A port for one program of another make at a time, on one bus. To be opened by `async with`.

    name      what people know the program by: where it is served
    bus       the bus that it shares; bus_name is its name
    refused   told of each request that the gate does not let through, with the error

    It is what holds leases for the program: its `role` is that of an operator, and it has no deadman.
    """

    client = "foreign"
    role = "operator"
    deadman = 0.0

    def __init__(
        self,
        bus: AsyncBus,
        bus_name: str,
        gate: Gate,
        name: str,
        refused: Callable[["ForeignPort", Exchange[Any], ServobusError], object] = lambda *_: None,
    ) -> None:
        self.name, self.bus, self.bus_name = name, bus, bus_name
        self._gate, self._refused = gate, refused
        self.counts = Counts()
        self._cutter = RequestCutter(self._families)
        self._habits = AnswerHabits()
        self._waiting: deque[_Waiting | None] = deque()
        """None says that the program has gone."""
        self._woken = asyncio.Event()
        self._number = self._program = 0
        self._partial: asyncio.TimerHandle | None = None
        self._worker: asyncio.Task[None] | None = None

    def __repr__(self) -> str:
        return f"<{self.name}: {self.counts.requests} requests>"

    @property
    @abstractmethod
    def port(self) -> str:
        """What the program opens."""

    async def __aenter__(self) -> Self:
        self._loop = asyncio.get_running_loop()
        registry.load_installed()  # now, not when the first request waits
        await self._open()
        self._worker = self._loop.create_task(self._work())
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._partial is not None:
            self._partial.cancel()
        if self._worker is not None:
            self._worker.cancel()
            await asyncio.wait({self._worker})
        await self._close()
        self._gate.left(self)

    # What a kind of port does

    @abstractmethod
    async def _open(self) -> None:
        """Begin to listen. Raises PortError."""

    @abstractmethod
    async def _close(self) -> None:
        """Be no port any more."""

    @abstractmethod
    def _send(self, data: bytes) -> None:
        """Give bytes to the program; they are lost if it has gone, or does not read. Never waits."""

    @abstractmethod
    def _baud(self) -> int:
        """Give the speed at which the program wants to talk, bit/s."""

    def _catch_up(self) -> None:  # noqa: B027 - what the system tells of by itself needs no look
        """Take in what the program has written up to now."""

    def _heard(self, data: bytes) -> None:
        """Take in what the program has written."""
        requests = self._cutter.feed(data)
        self.counts.garbage = self._cutter.garbage
        if self._partial is not None:
            self._partial.cancel()
            self._partial = None
        if self._cutter.begun:
            self._partial = self._loop.call_later(PARTIAL, self._give_up)
        for request in requests:
            self._number += 1
            self.counts.requests += 1
            if len(self._waiting) >= MOST_WAITING:
                self.counts.dropped += self._waiting.popleft() is not None
            self._waiting.append(_Waiting(request, self._number, self._program, self._loop.time()))
        if requests:
            self._woken.set()

    def _left(self) -> None:
        """Take note that the program has closed the port: it ends when what it had asked for is done."""
        self._cutter.forget()
        self._program += 1
        self._waiting.append(None)
        self._woken.set()

    def _give_up(self) -> None:
        self._partial = None
        self._cutter.drop()
        self.counts.garbage = self._cutter.garbage

    # Its requests, one after the other

    async def _work(self) -> None:
        while True:
            while not self._waiting:
                self._woken.clear()
                await self._woken.wait()
            waiting = self._waiting.popleft()
            try:
                if waiting is None:
                    self._gate.left(self)
                else:
                    await self._carry_out(waiting)
            except Exception as error:  # noqa: BLE001 - one request must not end the port
                _log(f"{self.name}: a request failed", error)

    async def _carry_out(self, waiting: _Waiting) -> None:
        """Do what a request asks for, and give its answer back."""
        request, family = waiting.request, waiting.request.family
        baud = self._baud()
        effect = family.effect(request.packet, lambda one: self._model(family, one, baud))
        reads = effect.only_reads
        if reads and self._waited_no_more(waiting):
            self.counts.outdated += 1
            return
        awaited = self._habits.expects(
            family, request.packet.id, self._answers(family, request.packet.id, baud), self._now
        )
        exchange = exchange_of(request, reads=reads, awaited=awaited)
        deadline = self._deadline(waiting, exchange, baud)
        if reads and self._now > deadline:
            self.counts.outdated += 1
            return
        priority = _priority(effect)
        try:
            self._gate.admit(self, self.bus_name, exchange, baud, waiting.asked, priority)
        except ServobusError as error:
            self.counts.refused += 1
            self._refused(self, exchange, error)
            return
        outcome: Any
        try:
            outcome = await self._ask(exchange, baud, priority)
        except ServobusError as error:
            outcome = error
        self._gate.carried_out(self, self.bus_name, exchange, baud, outcome)
        self._learn(request, exchange, effect, outcome)
        if exchange.replies:
            self._answer(waiting, outcome if isinstance(outcome, list) else [outcome], deadline)

    async def _ask(self, exchange: Exchange[Any], baud: int, priority: Priority) -> Any:
        """Send a request once. A question goes as a batch of one, which is not asked again."""
        if not exchange.repeatable:
            return await self.bus.do(exchange, baud, priority=priority)
        (outcome,) = await self.bus.do(_once(exchange), baud, priority=priority)
        return outcome

    def _learn(self, request: Request, exchange: Exchange[Any], effect: Effect, outcome: Any) -> None:
        """Take note of who answers what."""
        family = request.family
        if exchange.reply is not None and not exchange.reply.certain and isinstance(outcome, Packet | NoReply):
            self._habits.note(family, request.packet.id, isinstance(outcome, Packet), self._now)
        self._habits.note_written(family, effect, self._now)

    def _deadline(self, waiting: _Waiting, exchange: Exchange[Any], baud: int) -> float:
        """Give the time after which the program may have given up."""
        bits = (len(exchange.request) + exchange.reply_size) * BITS_PER_BYTE
        turns = max(len(exchange.replies) - 1, 0) * exchange.typical_delay
        # An adapter that holds bytes back would do so if the program had it for itself.
        held_back = self.bus.link.latency.usual_delay if isinstance(self.bus.link, Link) else 0.0
        return waiting.asked + bits / baud + turns + min(held_back, HELD_BACK) + ANSWERED_WITHIN

    def _answer(self, waiting: _Waiting, outcomes: list[Any], deadline: float) -> None:
        packets = [outcome for outcome in outcomes if isinstance(outcome, Packet)]
        # An answer that comes behind the next question would be taken for the answer to that.
        self._catch_up()
        if not packets:
            self.counts.silent += 1
        elif self._waited_no_more(waiting) or self._now > deadline:
            self.counts.outdated += 1
        else:
            self.counts.answered += 1
            frame = waiting.request.family.framing.frame
            self._send(b"".join(map(frame, packets)))

    def _waited_no_more(self, waiting: _Waiting) -> bool:
        """Tell whether the program has gone, or sent something else: it waits for no older answer then."""
        return waiting.program != self._program or waiting.number != self._number

    @property
    def _now(self) -> float:
        return self._loop.time()

    # What the bus knows

    def _families(self) -> Iterator[Family]:
        """Give the families that the program may speak: those of the known servos come first."""
        known = dict.fromkeys(servo.family for servo in self.bus)
        yield from known
        yield from (family for family in registry.FAMILIES.values() if family not in known)

    def _model(self, family: Family, id: int, baud: int) -> type[Model] | None:
        known = (servo.model for servo in self.bus if servo.id == id and servo.baud == baud and servo.family is family)
        return next(known, None) or registry.unknown(family)

    def _answers(self, family: Family, id: int, baud: int) -> Answers | None:
        known = (servo for servo in self.bus if servo.id == id and servo.baud == baud and servo.family is family)
        return next((servo.target.answers for servo in known), None)

    def _usual_baud(self) -> int:
        """Give the speed of the first servo that is known, or else that of the line."""
        return next((servo.baud for servo in self.bus), self.bus.transport.baud)


class ForeignPty(ForeignPort):
    """A pseudo terminal for a program; the program sets its speed as on a serial port.

    `link` is a symbolic link that is made to the terminal, and has a name that stays.
    """

    def __init__(self, bus: AsyncBus, bus_name: str, gate: Gate, link: Path | None = None, **more: Any) -> None:
        super().__init__(bus, bus_name, gate, f"the program on {link or 'a terminal'}", **more)
        self._link = link
        self._terminal = PseudoTerminal(self._usual_baud(), link)
        self._listening = False
        self._timer: asyncio.TimerHandle | None = None
        self._had_program = False

    @property
    def port(self) -> str:
        """What the program opens."""
        return self._terminal.name

    async def _open(self) -> None:
        self._terminal.__enter__()
        if self._link is None:
            self.name = f"the program on {self._terminal.name}"
        self._look()

    async def _close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._listen(on=False)
        self._terminal.__exit__()

    def _send(self, data: bytes) -> None:
        self._terminal.write(data)

    def _baud(self) -> int:
        return round(self._terminal.baud())

    def _catch_up(self) -> None:
        if self._listening:
            self._look()

    def _look(self) -> None:
        """See what is there to read, and whether there is a program at all."""
        data = self._terminal.read()
        if data:
            self._heard(data)
        here = self._terminal.has_client
        if self._had_program and not here:
            self._left()
        self._had_program = here
        self._listen(on=here)
        if not here:
            self._timer = self._loop.call_later(LOOK, self._look)

    def _listen(self, *, on: bool) -> None:
        """Have the event loop tell when there is something to read: without a program there always is."""
        if on is self._listening:
            return
        self._listening = on
        if on:
            self._loop.add_reader(self._terminal.fileno(), self._look)
        else:
            self._loop.remove_reader(self._terminal.fileno())


class ForeignTcp(ForeignPort):
    """A TCP port for a program, which carries bytes alone; another program may come when the first has gone.

    `baud` is the speed at which it talks, as nothing in TCP tells one; that of the first known servo by default.
    """

    def __init__(
        self, bus: AsyncBus, bus_name: str, gate: Gate, host: str, port: int, baud: int | None = None, **more: Any
    ) -> None:
        super().__init__(bus, bus_name, gate, f"the program on {_shown(host, port)}", **more)
        self._address, self._fixed_baud = (host, port), baud
        self._server: asyncio.Server | None = None
        self._client: asyncio.Transport | None = None

    @property
    def port(self) -> str:
        """What the program opens."""
        return f"socket://{_shown(*self._address)}"

    async def _open(self) -> None:
        host, port = self._address
        try:
            self._server = await self._loop.create_server(lambda: _Client(self), host, port)
        except (OSError, OverflowError) as error:
            raise PortError(f"cannot listen on {_shown(host, port)}: {error}; port 0 takes any free one") from error
        self._address = host, self._server.sockets[0].getsockname()[1]
        self.name = f"the program on {_shown(*self._address)}"

    async def _close(self) -> None:
        if self._server is not None:
            self._server.close()
        if self._client is not None:
            self._client.abort()

    def _send(self, data: bytes) -> None:
        if self._client is not None and self._client.get_write_buffer_size() < CHUNK:
            self._client.write(data)

    def _baud(self) -> int:
        return self._fixed_baud or self._usual_baud()

    def came(self, client: asyncio.Transport) -> bool:
        """Take a client, if there is none."""
        if self._client is not None:
            return False
        self._client = client
        return True

    def went(self, client: asyncio.Transport) -> None:
        """Take note that a client has gone."""
        if client is self._client:
            self._client = None
            self._left()

    def heard(self, client: asyncio.Transport, data: bytes) -> None:
        """Take in what a client has sent."""
        if client is self._client:
            self._heard(data)


class _Client(asyncio.Protocol):
    """One connection to a TCP port."""

    def __init__(self, port: ForeignTcp) -> None:
        self._port = port
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        if not self._port.came(transport):
            transport.abort()
            return
        sock = transport.get_extra_info("socket")
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # A client that lost its network must not keep others out for ever.
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    def data_received(self, data: bytes) -> None:
        assert self._transport is not None
        self._port.heard(self._transport, data)

    def connection_lost(self, _: Exception | None) -> None:
        assert self._transport is not None
        self._port.went(self._transport)


def _priority(effect: Effect) -> Priority:
    """Tell what a request is for. Torque off is no stop: an arm that another program holds would fall."""
    if effect.only_reads:
        return Priority.READ
    return Priority.STOP if effect.kinds is Kind.STOPS else Priority.MOTION


def _once(exchange: Exchange[Any]) -> Procedure[list[Any]]:
    outcomes: list[Any] = yield Batch((exchange,), again=False)
    return outcomes


def _shown(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _log(what: str, error: Exception) -> None:
    import logging  # noqa: PLC0415 - seldom wanted

    logging.getLogger("servobus").error(what, exc_info=error)
