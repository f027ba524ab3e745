"""A bus operation is a value.

An `Exchange` is one request and what must come back; it holds bytes and functions, no port and no clock.
Jobs of several steps are generators of them (`Procedure`), so that the blocking and the asynchronous
driver carry out the same code:

    def read_twice(first, second):
        a = yield from first
        b = yield from second
        return a, b
"""

from collections.abc import Callable, Generator, Sequence
from typing import Any, Generic, TypeAlias, TypeVar

from servobus.core.framing import INCOMPLETE, Corrupt, Decoder, Event, Framing, Noise, Packet
from servobus.core.values import frozen
from servobus.errors import BadChecksum, BrokenEcho, BusError, DuplicateId, Garbled, NoReply, ShortReply, WrongReply

T = TypeVar("T")
S = TypeVar("S")


@frozen
class Reply:
    """What a reply must look like to be one.

    id      the servo that must answer; None takes any (a broadcast that one servo answers)
    code    the command byte it must carry; None takes any (Dynamixel: it is the error byte)
    sizes   data lengths in bytes that can be an answer. The first is the full one; others are refusals.
    starts  bytes with which a full answer begins: what it repeats of the question
    """

    id: int | None
    code: int | None
    sizes: tuple[int, ...]
    starts: bytes = b""

    def fits(self, packet: Packet) -> bool:
        data = packet.data
        return (
            (packet.id == self.id or self.id is None)
            and (self.code is None or packet.code == self.code)
            and (data.startswith(self.starts) if len(data) == self.sizes[0] else len(data) in self.sizes)
        )

    def could_be(self, other: "Reply") -> bool:
        """Tell whether a full answer of the other kind, if it came late, could be taken for this one."""
        return (
            (self.id == other.id or self.id is None or other.id is None)
            and (self.code == other.code or self.code is None or other.code is None)
            # An answer without data, as to a PING, could be a refusal of any read.
            and (self.starts == other.starts if self.sizes[0] == other.sizes[0] else other.sizes[0] in self.sizes)
        )

    def strict(self) -> "Reply":
        """Give the shape of the full answer alone, without refusals."""
        return Reply(self.id, self.code, self.sizes[:1], self.starts)


class Exchange(Generic[T]):
    """One request and its reply, as a value: nobody changes it.

    what        for people: "RX-28 id 1: read present_position"
    interpret   turns the reply's packet into the result; raises Refused. Where nothing answers it is given an
                empty packet.
    reply       the shape of the answer; None where the servo stays silent
    alarms      reads the alarm bits that stand beside the data in the packet
    turnaround  longest time in seconds between the request's last bit and the reply's first
    usual       the time that it usually takes at most; the same, if not given
    repeatable  whether it may be sent again if no answer comes: what only asks, and what sets RAM to a value
    """

    __slots__ = (
        "alarms",
        "framing",
        "id",
        "interpret",
        "max_delay",
        "repeatable",
        "reply",
        "reply_size",
        "request",
        "typical_delay",
        "what",
    )  # fmt: skip

    def __init__(
        self,
        what: str,
        framing: Framing,
        request: bytes,
        interpret: Callable[[Packet], T],
        reply: Reply | None = None,
        alarms: Callable[[Packet], int] | None = None,
        max_delay: float = 0.0,
        *,
        typical_delay: float | None = None,
        repeatable: bool = False,
    ) -> None:
        self.typical_delay = max_delay if typical_delay is None else typical_delay
        self.what, self.framing, self.request, self.interpret = what, framing, request, interpret
        self.reply, self.alarms, self.max_delay, self.repeatable = reply, alarms, max_delay, repeatable
        self.id = framing.unframe(request)[0].id
        """The servo that is asked."""
        self.reply_size = 0 if reply is None else framing.overhead + max(reply.sizes)
        """Longest reply in bytes on the wire."""

    def __repr__(self) -> str:
        return f"<{self.what}>"

    def __iter__(self) -> "Procedure[T]":
        """Be a procedure of one step, so that `value = yield from exchange` reads as it does for procedures."""
        result: T = yield self
        return result

    def mapped(self, interpret: Callable[[Packet], S]) -> "Exchange[S]":
        """Make the same question with another way to read the answer."""
        return Exchange(
            self.what, self.framing, self.request, interpret, self.reply, self.alarms, self.max_delay,
            typical_delay=self.typical_delay, repeatable=self.repeatable,
        )  # fmt: skip

    def no_retry(self) -> "Exchange[T]":
        """Make the same question, never to be asked again."""
        single = self.mapped(self.interpret)
        single.repeatable = False
        return single

    def looks_like_its_reply(self) -> bool:
        """Tell whether the request could be taken for its own answer, so that an echo would be one.

        It is so of a Dynamixel PING: it looks like a status packet with a voltage error.
        """
        packet, _ = self.framing.unframe(self.request)
        return self.reply is not None and self.reply.fits(packet)


@frozen
class SetBaud:
    """Step of a procedure: talk at this speed from now on."""

    baud: int


@frozen
class Pause:
    """Step of a procedure: let this many seconds pass. `shared` lets others use the line meanwhile."""

    seconds: float
    shared: bool = False


class Now:
    """Step of a procedure: `now = yield Now()` gives the time of the port's clock, in seconds.

    Only differences of two such times mean something: the clock may be virtual.
    """

    __slots__ = ()


@frozen
class Batch:
    """Step of a procedure: several questions of one family, each sent before the answer to the last is in.

    They keep so far apart that no two answers, or on one wire a question and an answer, can meet. The step
    gives a list: for each exchange its result, or the BusError that came of it.

    again   whether what did not come through is asked again, if it is repeatable
    """

    exchanges: Sequence[Exchange[Any]]
    again: bool = True


Step: TypeAlias = Exchange[Any] | SetBaud | Pause | Now | Batch
Procedure: TypeAlias = Generator[Step, Any, T]
Job: TypeAlias = Exchange[T] | Procedure[T]


def ack_only(_: Packet) -> None:
    """Interpret a reply that only says that the request arrived."""


class Collector(Generic[T]):
    """Picks the reply to one exchange out of what is heard. No port, no clock.

    `echo` tells whether the line gives back what was sent; None finds out from the first bytes. `sent` is what
    was sent, if not just the request, `longest` how long other packets can be that may come first.
    """

    __slots__ = ("_decoder", "_seen", "echo", "exchange", "heard", "packet", "sent")

    def __init__(self, exchange: Exchange[T], echo: bool | None = False, sent: bytes = b"", longest: int = 0) -> None:
        self.exchange = exchange
        self.echo = echo
        self.sent = sent or exchange.request
        self.packet: Packet | None = None
        self.heard = bytearray()
        self._seen: list[Event] = []
        self._decoder = Decoder(exchange.framing, max(exchange.reply_size, longest))

    @property
    def done(self) -> bool:
        """True when there is nothing more to wait for."""
        if self.exchange.reply is not None:
            return self.packet is not None
        # Nothing answers; but an echo must be out of the way before the next request.
        return self.echo is False or len(self.heard) >= len(self.sent)

    @property
    def strangers(self) -> list[Packet]:
        """Good packets that are not the reply."""
        return [event for event in self._seen if isinstance(event, Packet) and event is not self.packet]

    @property
    def corrupt(self) -> int:
        """Count the packets with a wrong checksum."""
        return sum(isinstance(event, Corrupt) for event in self._seen)

    @property
    def junk(self) -> int:
        """Count the bytes that were no packet."""
        return sum(len(event.raw) for event in self._seen if isinstance(event, Noise))

    @property
    def broken_echo(self) -> bool:
        """Whether the line, known to give back what is sent, gave back something else."""
        return self.echo is True and bool(self.heard) and not self.heard.startswith(self.sent)

    def feed(self, chunk: bytes) -> None:
        """Take bytes in; `done` turns true when the reply is among them."""
        request, before = self.sent, len(self.heard)
        self.heard += chunk
        if self.echo is None and not request.startswith(bytes(self.heard[: len(request)])):
            self.echo = False
            before = 0
        if self.echo is False:
            self._sort(self._decoder.feed(bytes(self.heard[before:])))
        elif len(self.heard) >= len(request):
            self.echo = True
            self._sort(self._decoder.feed(bytes(self.heard[max(before, len(request)) :])))

    def quiet(self) -> None:
        """Say that nothing more comes: look through what is left."""
        if self.echo is None and self.heard:
            # Only the start of what we sent came back: it was no echo.
            self._sort(self._decoder.feed(bytes(self.heard)))
        if self.echo is None:
            self.echo = False
        self._sort(self._decoder.flush())

    def result(self, older: int = 0) -> T:
        """Interpret the reply. Raises Refused, or the BusError that says what went wrong instead.

        `older` answers to the same question may come besides.
        """
        if self.broken_echo:
            raise self._broken_echo(bytes(self.heard[: len(self.sent)]))
        reply = self.exchange.reply
        if reply is None:
            return self.exchange.interpret(Packet(0, 0))
        if self.packet is None:
            raise self.failure()
        if sum(map(reply.fits, self.strangers)) > older:
            raise self.duplicate()
        return self.exchange.interpret(self.packet)

    def duplicate(self) -> DuplicateId:
        """Make the error for a question that was answered twice."""
        id = self.packet.id if self.packet is not None else self.exchange.reply and self.exchange.reply.id
        said = f"two answers came: two servos with id {id}, or one that came twice or late, or an echo"
        hint = "if there are two, connect one of them alone and give it another id"
        return DuplicateId(f"{self.exchange.what}: {said}; {hint}", bytes(self.heard))

    def failure(self) -> BusError:
        """Say what was heard instead of the reply."""
        exchange = self.exchange
        what, request = exchange.what, self.sent
        heard = bytes(self.heard[len(request) :] if self.echo else self.heard)
        events = exchange.framing.decode(heard)
        for event in events:
            if isinstance(event, Corrupt):
                if _differences(event.raw, request) in (1, 2):
                    return self._broken_echo(event.raw)
                said = f"the reply's checksum is wrong ({_hex(event.raw)}): noise, or two servos with one id?"
                return BadChecksum(f"{what}: {said}", heard)
        if strangers := {event.id for event in events if isinstance(event, Packet)}:
            ids = ", ".join(map(str, sorted(strangers)))
            return WrongReply(f"{what}: an answer came that does not fit, from id {ids} ({_hex(heard)})", heard)
        if short := _cut_short(exchange.framing, heard):
            return ShortReply(f"{what}: the reply ends too soon ({_hex(heard)}, {short}): a byte was lost", heard)
        if heard:
            hint = "wrong baud, noise, or two servos with one id?"
            return Garbled(f"{what}: {len(heard)} bytes that are no packet ({_hex(heard)}): {hint}", heard)
        return NoReply(f"{what}: no reply")

    def _broken_echo(self, heard: bytes) -> BrokenEcho:
        said = f"{_hex(heard)} came back of {_hex(self.sent)}"
        return BrokenEcho(
            f"{self.exchange.what}: the echo is broken: {said}; a short circuit, or who else sends?", heard
        )

    def _sort(self, events: Sequence[Event]) -> None:
        reply = self.exchange.reply
        for event in events:
            if isinstance(event, Packet) and self.packet is None and reply is not None and reply.fits(event):
                self.packet = event
        self._seen += events


class Gathering:
    """Sorts what is heard after several questions: whose answer is it? No port, no clock.

    All questions are of one protocol, each to another servo. `echo` tells whether the line gives back what was sent.
    """

    def __init__(self, exchanges: Sequence[Exchange[Any]], *, echo: bool = False) -> None:
        self.exchanges = exchanges
        self.heard = bytearray()
        self.strangers: list[Packet] = []
        """Good packets that answer nothing that was asked."""
        self.corrupt = self.junk = 0
        """Packets with a wrong checksum, and bytes that were no packet."""
        self._packets: list[Packet | None] = [None] * len(exchanges)
        self._open = len(exchanges)
        self._doubled: set[int] = set()
        self._places = {exchange.id: n for n, exchange in enumerate(exchanges)}
        self._echoes = [exchange.request for exchange in exchanges] if echo else []
        longest = max(max(exchange.reply_size, len(exchange.request)) for exchange in exchanges)
        self._decoder = Decoder(exchanges[0].framing, longest)

    @property
    def done(self) -> bool:
        return not self._open

    @property
    def noisy(self) -> bool:
        """Whether something was heard that is no packet, or a broken one."""
        return bool(self.corrupt or self.junk)

    def answered(self, n: int) -> bool:
        """Tell whether the question with this number has its answer."""
        return self._packets[n] is not None

    def feed(self, chunk: bytes) -> list[tuple[int, Packet]]:
        """Take bytes in; give the answers that are complete now, with the numbers of their questions."""
        self.heard += chunk
        return self._sort(self._decoder.feed(chunk))

    def results(self) -> list[Any]:
        """Say that nothing more comes: give each exchange's result, or the BusError that came of it."""
        self._sort(self._decoder.flush())
        return [self._result(n) for n in range(len(self.exchanges))]

    def _sort(self, events: Sequence[Event]) -> list[tuple[int, Packet]]:
        answers = []
        for event in events:
            if isinstance(event, Corrupt):
                self.corrupt += 1
            elif isinstance(event, Noise):
                self.junk += len(event.raw)
            elif self._echoes and (frame := self.exchanges[0].framing.frame(event)) in self._echoes:
                self._echoes.remove(frame)
            elif (n := self._asked(event)) is None:
                self.strangers.append(event)
            elif self._packets[n] is None:
                self._packets[n] = event
                self._open -= 1
                answers.append((n, event))
            else:
                self._doubled.add(n)
        return answers

    def _asked(self, packet: Packet) -> int | None:
        """Find the question that a packet answers."""
        n = self._places.get(packet.id)
        reply = None if n is None else self.exchanges[n].reply
        return n if reply is not None and reply.fits(packet) else None

    def _result(self, n: int) -> Any:
        exchange, packet = self.exchanges[n], self._packets[n]
        if n in self._doubled:
            collector = Collector(exchange)
            collector.packet = packet
            return collector.duplicate()
        try:
            if packet is not None:
                return exchange.interpret(packet)
        except BusError as error:
            return error
        if self.noisy:
            hint = "or two servos with one id?"
            return Garbled(f"{exchange.what}: no clear answer, while others were asked too: noise, {hint}")
        return NoReply(f"{exchange.what}: no reply")


def _cut_short(framing: Framing, heard: bytes) -> str:
    """Say how much of a packet came, if what was heard is the beginning of one."""
    start = heard.find(framing.header)
    if start < 0:
        return ""
    have, size = len(heard) - start, framing.size(heard, start)
    if size == INCOMPLETE:
        return f"{have} bytes"
    return f"{have} of {size} bytes" if have < size else ""


def _differences(one: bytes, other: bytes) -> int:
    """Count the bytes in which two runs of the same length differ; -1 if the lengths do."""
    return sum(a != b for a, b in zip(one, other, strict=True)) if len(one) == len(other) else -1


def _hex(data: bytes, most: int = 16) -> str:
    return data[:most].hex(" ").upper() + (" ..." if len(data) > most else "")
