"""Which of the packets that come are the replies to what was asked. No port, no clock.

A `ReplyCollector` is made for the questions that are under way, one or several, and is fed with what is heard. It
takes the echo of the requests out, assigns each good packet to the reply that it is, and says in the end for each
reply what it means or what went wrong. It never takes a packet that does not fit, and never drops one without a word:
what is no reply is handed back as a stranger.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

from servobus.core.exchange import Exchange, GroupExchange
from servobus.core.framing import INCOMPLETE, Corrupt, Decoder, Event, Framing, Noise, Packet
from servobus.errors import (
    BadChecksum,
    BrokenEcho,
    BusError,
    DuplicateId,
    Garbled,
    NoReply,
    OtherProtocol,
    ShortReply,
    WrongReply,
)

Arrival: TypeAlias = tuple[int | None, Packet]
"""A good packet, with the number of the reply that it is; None for a stranger."""


class ReplyCollector:
    """Picks the replies to one or more exchanges out of what is heard.

    exchanges  all of one protocol, no two of which the same servo answers
    echo       whether the line gives back what was sent; None finds out from the first bytes, which works for one
               exchange alone
    sent       what was sent, if there was more than the request of the one exchange
    longest    size in bytes of other packets that may come first: late replies
    """

    def __init__(
        self, exchanges: Sequence[Exchange[Any]], echo: bool | None = False, sent: bytes = b"", longest: int = 0
    ) -> None:
        self.exchanges = exchanges
        self.echo = echo
        self.sent = sent or exchanges[0].request
        self.heard = bytearray()
        self.expected = [(exchange, reply) for exchange in exchanges for reply in exchange.replies]
        """The replies that may come, each with its exchange; what is told by number is told by place in here."""
        self.owners = [n for n, exchange in enumerate(exchanges) for _ in exchange.replies]
        """The number of the exchange that each of them belongs to."""
        self.packets: list[Packet | None] = [None] * len(self.expected)
        """What has come of them."""
        self.strangers: list[Packet] = []
        """Good packets that are none of the replies, or a second one to the same question."""
        self.corrupt = self.junk = 0
        """Packets with a wrong checksum, and bytes that were no packet."""
        self._last: int | None = None
        """The number of the packet that came last."""
        self._noise_last = False
        self._beside_noise: set[int] = set()
        """Numbers of the replies right before or behind something that is no packet."""
        self._lateness: dict[int, float] = {}
        """Number of an exchange -> s by which the latest of its replies so far came later than its bits allow."""
        self._open = len(self.expected)
        self._given_up: dict[int, BusError] = {}
        self._places: dict[int | None, list[int]] = {}
        for n, (_, reply) in enumerate(self.expected):
            self._places.setdefault(reply.id, []).append(n)
        # Several requests go out between the replies, so their echoes are looked for among the packets. The echo of
        # one request is what comes first, byte by byte: so it shows if it is broken.
        self._echoes = [exchange.request for exchange in exchanges] if echo and len(exchanges) > 1 else []
        sizes = [exchange.framing.overhead + max(reply.sizes) for exchange, reply in self.expected]
        self._decoder = Decoder(exchanges[0].framing, max([*sizes, longest, *map(len, self._echoes)]))

    @property
    def done(self) -> bool:
        """True when there is nothing more to wait for."""
        if self.expected:
            return not self._open
        # Nothing answers; but an echo must be out of the way before the next request.
        return self.echo is False or len(self.heard) >= len(self.sent)

    @property
    def noisy(self) -> bool:
        """Whether something was heard that is no packet, or a broken one."""
        return bool(self.corrupt or self.junk)

    @property
    def broken_echo(self) -> bool:
        """Whether the line, known to give back what is sent, gave back something else."""
        return self._leading and self.echo is True and bool(self.heard) and not self.heard.startswith(self.sent)

    @property
    def could_be_echo(self) -> bool:
        """Whether the only reply came as the first thing heard, and may be the request itself, given back."""
        return (
            len(self.expected) == 1
            and self.packets[0] is not None
            and self.heard.startswith(self.sent)
            and self.exchanges[0].looks_like_its_reply()
        )

    @property
    def missing(self) -> list[int]:
        """The numbers of the replies that have not come; after a broken echo none counts as come."""
        broken = self.broken_echo
        return [n for n, packet in enumerate(self.packets) if packet is None or broken]

    def feed(self, chunk: bytes) -> list[Arrival]:
        """Take bytes in; give the good packets that are complete now, in the order in which they came."""
        request, before = self.sent, len(self.heard)
        self.heard += chunk
        if not self._leading:
            return self._sort(self._decoder.feed(chunk))
        if self.echo is None and not request.startswith(bytes(self.heard[: len(request)])):
            self.echo = False
            before = 0
        if self.echo is False:
            return self._sort(self._decoder.feed(bytes(self.heard[before:])))
        if len(self.heard) >= len(request):
            self.echo = True
            return self._sort(self._decoder.feed(bytes(self.heard[max(before, len(request)) :])))
        return []

    def end(self) -> list[Arrival]:
        """Say that nothing more comes: look through what is left."""
        arrivals = []
        if self.echo is None:
            if self.heard:  # only the start of what was sent came back: it was no echo
                arrivals = self._sort(self._decoder.feed(bytes(self.heard)))
            self.echo = False
        return arrivals + self._sort(self._decoder.flush())

    def reject(self, n: int) -> None:
        """Count a packet that came for this reply as a stranger: it cannot be the reply."""
        packet = self.packets[n]
        if packet is not None:
            self.packets[n] = None
            self._open += 1
            self.strangers.append(packet)

    def replace_heard(self, heard: bytes) -> None:
        """Go by this instead of what was heard, when all is over: without what is known to be no answer to this."""
        self.heard[:] = heard
        events = self.exchanges[0].framing.decode(heard[len(self.sent) if self.echo else 0 :])
        self.corrupt = sum(isinstance(event, Corrupt) for event in events)
        self.junk = sum(len(event.raw) for event in events if isinstance(event, Noise))

    def give_up(self, n: int, error: BusError) -> None:
        """Expect this reply no more: what comes for it is a stranger, and its outcome is this error."""
        self._given_up[n] = error
        self._open -= 1

    def cut(self, sent: int) -> None:
        """Expect nothing of the exchanges from this number on: they were not sent."""
        kept = sum(owner < sent for owner in self.owners)
        self.exchanges = self.exchanges[:sent]
        for listed in (self.expected, self.owners, self.packets):
            del listed[kept:]
        self._places = {id: [n for n in places if n < kept] for id, places in self._places.items()}
        self._open = sum(packet is None and n not in self._given_up for n, packet in enumerate(self.packets))

    def size_until(self, n: int) -> int:
        """Give the size in bytes of a reply that came, with those of the same exchange that came before it."""
        exchange = self.expected[n][0]
        numbers = range(len(self.packets)) if isinstance(exchange, GroupExchange) else (n,)
        packets = [self.packets[k] for k in numbers if self.expected[k][0] is exchange]
        return sum(exchange.framing.overhead + len(packet.data) for packet in packets if packet is not None)

    def later_than_before(self, owner: int, late: float) -> float | None:
        """Tell how much later a reply of this exchange came, in s, than the replies before it made it come.

        `late` is how much later than its bits allow. None if it came in one piece with one before it.
        """
        before = self._lateness.get(owner)
        self._lateness[owner] = late if before is None else max(late, before)
        if before is None:
            return late
        return late - before if late >= before else None

    # What it means

    def outcomes(self, older: Sequence[int] = ()) -> list[Any]:
        """Give for each exchange its result, or the BusError that came of it; of a `GroupExchange` a list of them.

        `older` says for each reply how many more of the same may come, because it was asked for in vain before.
        """
        if self.broken_echo:
            error = self._broken_echo(bytes(self.heard[: len(self.sent)]))
            return [error for _ in self.exchanges]
        outcomes: list[Any] = []
        n = 0
        for exchange in self.exchanges:
            found = [self._outcome(k, older[k] if older else 0) for k, _ in enumerate(exchange.replies, n)]
            n += len(found)
            if isinstance(exchange, GroupExchange):
                outcomes.append(found)
            else:
                outcomes.append(found[0] if found else exchange.interpret(Packet(0, 0)))
        return outcomes

    def result(self) -> Any:
        """Give the result of the only exchange. Raises the BusError that came of it instead."""
        (outcome,) = self.outcomes()
        if isinstance(outcome, BusError):
            raise outcome
        return outcome

    def duplicate(self, n: int) -> DuplicateId:
        """Make the error for a question that was answered twice."""
        exchange, reply = self.expected[n]
        packet = self.packets[n]
        id = packet.id if packet is not None else reply.id
        return duplicate(exchange, id, bytes(self.heard))

    def _outcome(self, n: int, older: int) -> Any:
        exchange, reply = self.expected[n]
        packet = self.packets[n]
        if n in self._given_up:
            return self._given_up[n]
        if packet is None:
            return self._failure() if len(self.expected) == 1 else self._failure_among_several(n)
        if sum(map(reply.fits, self.strangers)) > older:
            return self.duplicate(n)
        if len(self.exchanges) > 1 and self.noisy and n in self._beside_noise:
            # Two replies that met can leave one that fits its checksum by chance, and the rest of the other.
            said = "an answer and noise right beside it, while others were asked too: two answers that met?"
            return Garbled(f"{self._name(n)}: {said}", bytes(self.heard))
        try:
            return exchange.interpreter(reply)(packet)
        except BusError as error:
            return error

    def _failure_among_several(self, n: int) -> BusError:
        """Say why a reply is missing while others were under way too: it is unknown whose the broken bytes were."""
        what = self._name(n)
        if self.noisy:
            hint = "or two servos with one id?"
            return Garbled(f"{what}: no clear answer, while others were asked too: noise, {hint}")
        return NoReply(f"{what}: no reply")

    def _name(self, n: int) -> str:
        exchange, reply = self.expected[n]
        return f"{exchange.what}: id {reply.id}" if isinstance(exchange, GroupExchange) else exchange.what

    def _failure(self) -> BusError:
        """Say what was heard instead of the only reply."""
        (exchange, _), request = self.expected[0], self.sent
        what = self._name(0)
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
        if foreign := exchange.framing.foreign_in(heard):
            return OtherProtocol(f"{what}: the answer is one of {foreign} ({_hex(heard)})", heard)
        if short := _cut_short(exchange.framing, heard):
            return ShortReply(f"{what}: the reply ends too soon ({_hex(heard)}, {short}): a byte was lost", heard)
        if heard:
            hint = "wrong baud, noise, or two servos with one id?"
            return Garbled(f"{what}: {len(heard)} bytes that are no packet ({_hex(heard)}): {hint}", heard)
        return NoReply(f"{what}: no reply")

    def _broken_echo(self, heard: bytes) -> BrokenEcho:
        said = f"{_hex(heard)} came back of {_hex(self.sent)}"
        what = self.exchanges[0].what
        return BrokenEcho(f"{what}: the echo is broken: {said}; a short circuit, or who else sends?", heard)

    # Sorting

    @property
    def _leading(self) -> bool:
        """Whether an echo, if there is one, is what comes first."""
        return len(self.exchanges) == 1

    def _sort(self, events: Sequence[Event]) -> list[Arrival]:
        arrivals: list[Arrival] = []
        for event in events:
            if isinstance(event, Corrupt | Noise):
                if isinstance(event, Corrupt):
                    self.corrupt += 1
                else:
                    self.junk += len(event.raw)
                self._noise_last = True
                if self._last is not None:
                    self._beside_noise.add(self._last)
            elif self._echoes and (frame := self.exchanges[0].framing.frame(event)) in self._echoes:
                self._echoes.remove(frame)
            else:
                self._last = self._assign(event)
                if self._noise_last and self._last is not None:
                    self._beside_noise.add(self._last)
                self._noise_last = False
                arrivals.append((self._last, event))
        return arrivals

    def _assign(self, packet: Packet) -> int | None:
        """Note a packet as the reply that it is, and give the number of that; None for a stranger."""
        for n in self._places.get(packet.id, []) + self._places.get(None, []):
            if self.packets[n] is None and n not in self._given_up and self.expected[n][1].fits(packet):
                self.packets[n] = packet
                self._open -= 1
                return n
        self.strangers.append(packet)
        return None


def duplicate(exchange: Exchange[Any], id: int | None, heard: bytes) -> DuplicateId:
    """Make the error for a question that the servo with this id answered twice."""
    said = f"two answers came: two servos with id {id}, or one that came twice or late, or an echo"
    hint = "if there are two, connect one of them alone and give it another id"
    return DuplicateId(f"{exchange.what}: {said}; {hint}", heard)


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
