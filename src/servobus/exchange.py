"""A bus operation is a value.

An `Exchange` is one request and what must come back; it holds bytes and functions, no port and no clock.
Jobs of several steps are generators of them (`Procedure`), so that the blocking and the asynchronous
driver carry out the same code:

    def read_twice(first, second):
        a = yield from ask(first)
        b = yield from ask(second)
        return a, b
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeAlias, TypeVar

from servobus.errors import BadChecksum, BusError, Garbled, NoReply, WrongReply
from servobus.framing import Corrupt, Decoder, Event, Framing, Packet

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Reply:
    """What a reply must look like to be one.

    id      the servo that must answer; None takes any (a broadcast that one servo answers)
    code    the command byte it must carry; None takes any (Dynamixel: it is the error byte)
    sizes   data lengths in bytes that can be an answer. The first is the full one; others are refusals.
    """

    id: int | None
    code: int | None
    sizes: tuple[int, ...]

    def fits(self, packet: Packet) -> bool:
        return (
            (self.id is None or packet.id == self.id)
            and (self.code is None or packet.code == self.code)
            and len(packet.data) in self.sizes
        )


@dataclass(frozen=True, slots=True)
class Exchange(Generic[T]):
    """One request and its reply, as a value.

    what        for people: "RX-28 id 1: read present_position"
    interpret   turns the reply's packet into the result; raises Refused. Where nothing answers it is given an
                empty packet.
    reply       the shape of the answer; None where the servo stays silent
    alarms      reads the alarm bits that stand beside the data in the packet
    turnaround  longest time in seconds between the request's last bit and the reply's first
    repeatable  whether it may be sent again if no answer comes: what only asks, and what sets RAM to a value
    """

    what: str
    framing: Framing
    request: bytes
    interpret: Callable[[Packet], T]
    reply: Reply | None = None
    alarms: Callable[[Packet], int] | None = None
    turnaround: float = 0.0
    repeatable: bool = False

    @property
    def reply_size(self) -> int:
        """Longest reply in bytes on the wire."""
        if self.reply is None:
            return 0
        return self.framing.overhead + max(self.reply.sizes)

    def looks_like_its_reply(self) -> bool:
        """Tell whether the request could be taken for its own answer, so that an echo would be one.

        It is so of a Dynamixel PING: it looks like a status packet with a voltage error.
        """
        packet, _ = self.framing.unframe(self.request)
        return self.reply is not None and self.reply.fits(packet)


@dataclass(frozen=True, slots=True)
class SetBaud:
    """Step of a procedure: talk at this speed from now on."""

    baud: int


@dataclass(frozen=True, slots=True)
class Pause:
    """Step of a procedure: let this many seconds pass."""

    seconds: float


Step: TypeAlias = Exchange[Any] | SetBaud | Pause
Procedure: TypeAlias = Generator[Step, Any, T]
Job: TypeAlias = Exchange[T] | Procedure[T]


def ask(job: Job[T]) -> Procedure[T]:
    """Carry out one job inside a procedure: `value = yield from ask(job)`."""
    if isinstance(job, Exchange):
        result: T = yield job
        return result
    return (yield from job)


def sent(_: Packet) -> None:
    """Interpret a reply that only says that the request arrived."""


@dataclass(slots=True)
class Collector(Generic[T]):
    """Picks the reply to one exchange out of what is heard. No port, no clock.

    `echo` tells whether the line gives back what was sent; None finds out from the first bytes.
    """

    exchange: Exchange[T]
    echo: bool | None = False
    packet: Packet | None = None
    heard: bytearray = field(default_factory=bytearray)
    _decoder: Decoder = field(init=False)

    def __post_init__(self) -> None:
        self._decoder = Decoder(self.exchange.framing, self.exchange.reply_size)

    @property
    def done(self) -> bool:
        """True when there is nothing more to wait for."""
        if self.exchange.reply is not None:
            return self.packet is not None
        # Nothing answers; but an echo must be out of the way before the next request.
        return self.echo is False or len(self.heard) >= len(self.exchange.request)

    def feed(self, chunk: bytes) -> None:
        """Take bytes in; `done` turns true when the reply is among them."""
        self.heard += chunk
        if self.echo is not False:
            request = self.exchange.request
            ours = bytes(self.heard[: len(request)])
            if self.echo is None and not request.startswith(ours):
                self.echo = False
                chunk = bytes(self.heard)
            elif len(ours) < len(request):
                return
            else:
                echoed = len(self.heard) - len(chunk) < len(request)
                self.echo = True
                if echoed:
                    chunk = bytes(self.heard[len(request) :])
        self._sort(self._decoder.feed(chunk))

    def quiet(self) -> None:
        """Say that nothing more comes: look through what is left."""
        if self.echo is None and self.heard:
            # Only the start of what we sent came back: it was no echo.
            self._sort(self._decoder.feed(bytes(self.heard)))
        if self.echo is None:
            self.echo = False
        self._sort(self._decoder.flush())

    def result(self) -> T:
        """Interpret the reply. Raises Refused, or the BusError that says what went wrong instead."""
        if self.exchange.reply is None:
            return self.exchange.interpret(Packet(0, 0))
        if self.packet is None:
            raise self.failure()
        return self.exchange.interpret(self.packet)

    def failure(self) -> BusError:
        """Say what was heard instead of the reply."""
        what, heard = self.exchange.what, bytes(self.heard)
        if self.echo:
            heard = heard[len(self.exchange.request) :]
        events = self.exchange.framing.decode(heard)
        if corrupt := [event for event in events if isinstance(event, Corrupt)]:
            return BadChecksum(f"{what}: the reply's checksum is wrong ({_hex(corrupt[0].raw)})", heard)
        if strangers := {event.id for event in events if isinstance(event, Packet)}:
            ids = ", ".join(map(str, sorted(strangers)))
            return WrongReply(f"{what}: an answer came that does not fit, from id {ids} ({_hex(heard)})", heard)
        if heard:
            hint = "wrong baud, noise, or two servos with one id?"
            return Garbled(f"{what}: {len(heard)} bytes that are no packet ({_hex(heard)}): {hint}", heard)
        return NoReply(f"{what}: no reply")

    def _sort(self, events: Sequence[Event]) -> None:
        reply = self.exchange.reply
        for event in events:
            if isinstance(event, Packet) and self.packet is None and reply is not None and reply.fits(event):
                self.packet = event


def _hex(data: bytes, most: int = 16) -> str:
    return data[:most].hex(" ").upper() + (" ..." if len(data) > most else "")
