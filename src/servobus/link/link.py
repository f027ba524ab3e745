"""One port, less the waiting: when to send, how long to listen, and what may still be coming.

`Link` carries out the steps of a job as generators of waits; a driver only lets time pass, blocking or
awaiting. Five rules keep it from ever giving a wrong answer:

- An answer is taken only if it fits the question, and comes in its time.
- After any trouble nothing is sent until the line is quiet.
- An answer that did not come may come late: an adapter or a computer that stalled delivers all at once, in order.
  So before the same kind of question is asked again, another one whose answer cannot be mistaken is asked
  (a marker). When that is answered, everything before it has come or never will.
- What comes back of our own is an echo, or broken, never an answer.
- A second answer to one question is told: two servos have one id.
"""

from collections.abc import Callable, Generator, Sequence
from time import monotonic
from typing import Any, Final, TypeAlias, TypeVar

from servobus.core.exchange import Batch, Collector, Exchange, Job, Now, Pause, SetBaud, Step, ack_only
from servobus.core.framing import Framing, Noise, Packet
from servobus.core.ids import BROADCAST
from servobus.core.values import frozen
from servobus.errors import BrokenEcho, BusError, DuplicateId, LineBusy, NoReply, Refused, Stopped
from servobus.link.late_replies import SLOWEST, LateReplies, MissedReply
from servobus.link.latency import Latency
from servobus.link.stats import Counts, Stats
from servobus.transports.base import Transport

T = TypeVar("T")

BITS_PER_BYTE = 10
"""Start bit, eight data bits, stop bit: 8N1, as all three families use."""
FORGOTTEN = 0.21
"""s after a change of speed in which servos that took what they heard at the old one for the start of a packet
forget it (HerkuleX, Packet Garbage Check Period: 201.6 ms)."""
SLOW = 1.03
"""A servo's speed may be 3 % off (RX-28 manual 3-4-1)."""
TRIES = 2
"""How often a question is asked at most."""
DEADLINE = 0.5
"""s after which a question is not asked again."""


@frozen
class Receive:
    """Wait: up to this many seconds for bytes; the generator is sent what came."""

    seconds: float


@frozen
class Rest:
    """Wait: let this many seconds pass. `shared` lets others use the line meanwhile."""

    seconds: float
    shared: bool = False


Waits: TypeAlias = Generator[Receive | Rest, bytes, T]

NOT_FAST: Final = object()
"""What `try_fast_receive` gives where a longer look is needed."""


@frozen
class _Pace:
    """What the shortest way needs to know of an exchange at one speed."""

    window: float
    """s from the first bit of the request to the last of the answer, at most."""
    wire: float
    """s of these that the bits take."""
    counts: Counts


class Link:
    """A port in use: its speed, its echo, its delays, and what may still be under way on it.

    heard    is told of every reply, for the alarms in it
    markers  gives harmless questions to a servo whose answers differ in shape
    """

    def __init__(
        self,
        transport: Transport,
        *,
        echo: bool | None,
        heard: Callable[[Exchange[Any], Packet], None],
        fences: Callable[[Framing, int], Sequence[Exchange[Any]]],
    ) -> None:
        self.transport = transport
        self.echo = echo
        """Whether the adapter gives back what it sends; None as long as that is not known."""
        self._echo_doubted = False
        """Whether a request has come back, so that from now on a byte goes before those that are like their answers."""
        self.stats = Stats()
        self.latency = Latency(transport)
        self._heard, self._fences = heard, fences
        self._late_replies = LateReplies()
        self._doubled: dict[int, DuplicateId] = {}
        """Second answers that were found too late to tell who had asked."""
        self._unquiet = False
        """Whether bytes may be coming that nobody waits for."""
        self._answered: Exchange[Any] | None = None
        self.alarming: set[tuple[Framing, int, int]] = set()
        """Servos whose last reply had an alarm in it: family, id and speed."""
        self._used_speed = False
        """Whether anything was sent since the speed last changed."""
        self._quiet_at = 0.0
        """Time at which every servo has forgotten what it heard at another speed."""
        self._clear_at = 0.0
        """Time at which the last of our bytes has left."""
        self._sent_at = 0.0
        """Time from which on a change of speed cannot spoil them any more."""
        self._deadline = 0.0
        self._slow_path = True
        """Whether the next question must take the long way."""
        self.superseded = False
        """Whether somebody else has taken the line over: then nothing is sent here any more."""
        self._paces: dict[Exchange[Any], _Pace] = {}
        self._pace_now = _Pace(0.0, 0.0, Counts())
        self._began = 0.0

    # Whole jobs

    def run(self, job: Job[T]) -> Waits[T]:
        """Carry out a job."""
        if isinstance(job, Exchange):
            return (yield from self.transact(job))
        try:
            step = next(job)
            while True:
                try:
                    result = yield from self._step(step)
                except BusError as error:
                    step = job.throw(error)
                else:
                    step = job.send(result)
        except StopIteration as stop:
            done: T = stop.value
            return done
        finally:
            job.close()

    def _step(self, step: Step) -> Waits[Any]:
        if isinstance(step, Exchange):
            return (yield from self.transact(step))
        if isinstance(step, Batch):
            return (yield from self._batch(step))
        if isinstance(step, Now):
            return self.transport.now()
        if isinstance(step, SetBaud):
            yield from self.set_baud(step.baud)
        else:
            yield from self._pause(step)
        return None

    def set_baud(self, baud: int) -> Waits[None]:
        """Talk at this speed from now on, if need be after our last bytes have left."""
        transport = self.transport
        if baud == transport.baud:
            return
        yield from self._until(self._sent_at)
        self.check()
        transport.set_baud(baud)
        self._paces.clear()
        if self._used_speed:
            # Servos hear what is sent at another speed as garbage. One that took it for the start of a packet
            # misses the next request, until it has been quiet for a while.
            self._quiet_at = transport.now() + FORGOTTEN
            self._used_speed = False

    def _pause(self, pause: Pause) -> Waits[None]:
        yield from self._until(self._clear_at)
        baud = self.transport.baud
        yield Rest(pause.seconds, pause.shared)
        if pause.shared:  # others may have used the line at their own speed
            yield from self.set_baud(baud)

    def _until(self, moment: float) -> Waits[None]:
        if (seconds := moment - self.transport.now()) > 0:
            yield Rest(seconds)

    # The shortest way: a calm line, one write, one read

    def try_fast_send(self, exchange: Exchange[Any]) -> float:
        """Send at once if nothing stands against it; give the seconds to listen, or 0 if it takes the long way."""
        if self._slow_path or self.transport.pending():
            return 0.0
        pace = self._paces.get(exchange)
        if pace is None:
            if exchange.reply is None or not exchange.repeatable:
                return 0.0
            pace = self._pace(exchange)
        self._began = monotonic()
        self.transport.write(exchange.request)
        self._pace_now = pace  # what follows costs no time: the servo is at work
        pace.counts.sent += 1
        return pace.window + self.latency.reply_margin

    def try_fast_receive(self, exchange: Exchange[T], chunk: bytes) -> T | object:
        """Give the result if what came is the answer and nothing else; NOT_FAST if it takes more than a look."""
        packet = exchange.framing.whole(chunk)
        if packet is None or not exchange.reply.fits(packet) or chunk == exchange.request:  # type: ignore[union-attr] # begin has seen to it
            return NOT_FAST
        pace = self._pace_now
        late = monotonic() - self._began - pace.wire
        if late < 0 and self.latency.impossible(late, pace.wire):
            return NOT_FAST
        counts = pace.counts
        counts.received += 1
        counts.worst = max(counts.worst, late)
        self.latency.note(late)
        self._answered = exchange
        alarms = exchange.alarms
        if alarms is not None and (alarms(packet) or self.alarming):
            self._tell_alarms(exchange, packet)
        return exchange.interpret(packet)

    def abandon(self, exchange: Exchange[Any]) -> None:
        """Say that nobody waits for the answer to what `try_fast_send` sent: it may still come."""
        self._missed(exchange)
        self._review()

    def supersede(self) -> "Link":
        """Have the exchange under way fail with Stopped, and all later ones; give a link that has the line instead.

        It lets what was under way come in before it sends anything.
        """
        self.superseded = self._slow_path = True
        link = type(self)(self.transport, echo=self.echo, heard=self._heard, fences=self._fences)
        link.stats, link.latency, link._late_replies = self.stats, self.latency, self._late_replies.copy()
        link.alarming = self.alarming
        link._quiet_at, link._used_speed, link._unquiet = self._quiet_at, True, True
        link._clear_at = link._sent_at = self.transport.now() + self.latency.reply_margin
        return link

    def check(self) -> None:
        """Raise Stopped if somebody else has taken the line over."""
        if self.superseded:
            raise Stopped("interrupted: the line was needed to make the servos safe")

    def _pace(self, exchange: Exchange[Any]) -> _Pace:
        """Work out the times of an exchange at the present speed, once."""
        if len(self._paces) > 1000:
            self._paces.clear()  # somebody makes his questions anew each time
        byte_time = BITS_PER_BYTE / self.transport.baud
        request, reply = len(exchange.request) * byte_time, exchange.reply_size * byte_time
        window = request + SLOW * (exchange.max_delay + reply)
        pace = self._paces[exchange] = _Pace(window, request + reply, self.stats[exchange.id])
        self._used_speed = True
        return pace

    def _review(self) -> None:
        """Find out whether the next question may take the shortest way."""
        self._slow_path = (
            self.superseded
            or self.echo is not False
            or bool(self._late_replies or self._doubled or self._unquiet or self._clear_at)
        )

    # One exchange

    def transact(self, exchange: Exchange[T], begun: bytes | None = None) -> Waits[T]:
        """Ask, and ask again where that is allowed. `begun` is what was heard if it is sent already."""
        started = self.transport.now()
        first: BusError | None = None
        for attempt in range(TRIES):
            if attempt:
                self.stats[exchange.id].retries += 1
                yield from self._until(self._quiet_at)
            try:
                return (yield from self._attempt(exchange, begun))
            except (Refused, DuplicateId):
                raise
            except BusError as error:
                if first is None or not isinstance(error, NoReply):
                    first = error  # of two errors, silence says less
                if not exchange.repeatable or self.transport.now() - started > DEADLINE:
                    break
                begun = None
        assert first is not None
        raise first

    def _attempt(self, exchange: Exchange[T], begun: bytes | None = None, *, fencing: bool = False) -> Waits[T]:
        transport = self.transport
        request = exchange.request
        if begun is None:
            yield from self._ready(exchange, fencing=fencing)
            unsure = self.echo is None or (self._echo_doubted and not self.echo)
            if unsure and exchange.looks_like_its_reply():
                # Before such a request goes a byte that servos skip: if it comes back, the rest is an echo too.
                request = b"\x00" + request
            self._send(exchange, request)
        else:
            self._deadline = self._began + self._pace_now.window + self.latency.reply_margin
            self._clear_at = self._began + len(request) * BITS_PER_BYTE / transport.baud
        collector = Collector(exchange, self.echo, request, self._late_replies.longest(exchange))
        chunk = begun or b""
        left = 1.0
        try:
            while True:
                collector.feed(chunk)
                if collector.packet is not None and self._too_soon(exchange, collector.packet):
                    collector.packet = None  # a stranger: an older answer, or one more to what was asked before
                if collector.done or left <= 0:
                    break
                # When time is up the answer may be here all the same, if this computer stalled: look once more.
                left = self._deadline - transport.now()
                chunk = yield Receive(max(left, 0.0))
            return self._judge(collector)
        finally:
            if collector.packet is None or collector.broken_echo:
                self._missed(exchange)  # it may still come; even if who asked gave up
            self._review()

    def _ready(self, exchange: Exchange[Any], *, fencing: bool = False) -> Waits[None]:
        """Wait until nothing stands against sending, and nothing that comes can be mistaken for the answer.

        A marker is asked all the same: an older answer to it tells enough.
        """
        self.check()
        # What can be asked again need not wait for the servos to forget.
        yield from self._until(self._clear_at if exchange.repeatable else max(self._clear_at, self._quiet_at))
        if leftover := self.transport.discard():
            self._sort(leftover, exchange.framing)
            self._unquiet = True
        if self._unquiet:
            yield from self._drain(exchange)
        if (error := self._doubled.pop(exchange.id, None)) is not None:
            raise error
        if not fencing and (confusable := self._late_replies.confusable(exchange)):
            yield from self._fence(exchange, confusable)

    def _send(self, exchange: Exchange[Any], request: bytes) -> None:
        """Send, and work out when to give up."""
        self.check()
        transport = self.transport
        self.latency.review()
        self._used_speed = True
        self.stats[exchange.id].sent += 1
        now = transport.now()
        transport.write(request)
        byte_time = BITS_PER_BYTE / transport.baud
        self._clear_at = self._sent_at = max(now, self._clear_at) + len(request) * byte_time
        if exchange.reply is not None:
            longest = SLOW * (exchange.max_delay + exchange.reply_size * byte_time)
            self._deadline = self._clear_at + longest + self.latency.reply_margin
        else:
            # Where nothing answers nobody tells when the adapter has really sent it.
            self._sent_at += transport.latency
            self._deadline = self._clear_at if self.echo is False else self._sent_at

    def _judge(self, collector: Collector[T]) -> T:
        """Turn what was collected into the result, or raise."""
        exchange, packet = collector.exchange, collector.packet
        counts = self.stats[exchange.id]
        if not collector.done:
            collector.quiet()
        if self.echo is False and collector.heard.startswith(collector.sent) and exchange.looks_like_its_reply():
            self.echo = collector.packet = packet = None  # the answer is still to come
            self._echo_doubted = True  # a servo may answer so, such as one with a voltage error
            error: BusError | None = BrokenEcho(f"{exchange.what}: the line echoes what is sent; it did not before")
        else:
            self.echo = collector.echo if collector.echo is not None else self.echo
            error = None
        counts.checksum += collector.corrupt
        counts.junk += collector.junk
        older = self._late_replies.count(exchange)
        for stranger in collector.strangers:
            self._stray(stranger)
        if packet is not None:
            self._accept(exchange, packet, self._clear_at)
            self._clear_at = 0.0  # what is answered has left
        try:
            if error is not None:
                raise error
            return collector.result(older)
        except BusError as error:
            counts.timeouts += isinstance(error, NoReply)
            counts.echo += isinstance(error, BrokenEcho)
            counts.doubled += isinstance(error, DuplicateId)
            self._unquiet = self._unquiet or not isinstance(error, NoReply | Refused)
            raise

    def _lateness(self, exchange: Exchange[Any], packet: Packet, left: float) -> float:
        """Tell how much later than its bits allow an answer has come, s, to a request that had left at that time."""
        size = exchange.framing.overhead + len(packet.data)
        return self.transport.now() - left - size * BITS_PER_BYTE / self.transport.baud

    def _too_soon(self, exchange: Exchange[Any], packet: Packet) -> bool:
        size = len(exchange.request) + exchange.framing.overhead + len(packet.data)
        late = self._lateness(exchange, packet, self._clear_at)
        return self.latency.impossible(late, size * BITS_PER_BYTE / self.transport.baud)

    def _accept(self, exchange: Exchange[Any], packet: Packet, left: float) -> None:
        """Take note of an answer to a request that had left at that time."""
        now, late = self.transport.now(), self._lateness(exchange, packet, left)
        counts = self.stats[packet.id]
        counts.received += 1
        counts.worst = max(counts.worst, late)
        self.latency.note(late)
        self._answered = exchange
        if self._late_replies:
            self._late_replies.resolve_before(packet.id, exchange, now)
        if exchange.alarms is not None and (exchange.alarms(packet) or self.alarming):
            self._tell_alarms(exchange, packet)

    def _tell_alarms(self, exchange: Exchange[Any], packet: Packet) -> None:
        """Tell of alarms that are there, or that ended."""
        alarms = exchange.alarms is not None and exchange.alarms(packet)
        servo = exchange.framing, packet.id, self.transport.baud
        if alarms or servo in self.alarming:
            (self.alarming.add if alarms else self.alarming.discard)(servo)
            self._heard(exchange, packet)

    # What may still come

    def _missed(self, exchange: Exchange[Any]) -> None:
        """Remember an answer that did not come, and may come late."""
        self._late_replies.add(exchange, self._clear_at, self.transport.now())

    def _fence(self, exchange: Exchange[Any], confusable: Sequence[MissedReply]) -> Waits[None]:
        """Ask something else, whose answer ends all doubts about what comes late."""
        id = exchange.id
        reply_margin = self.latency.reply_margin
        fences = [_strict(fence) for fence in self._fences(exchange.framing, id)] if id != BROADCAST else []
        for fence in fences:
            if self._late_replies.ambiguous(fence, confusable):
                continue
            try:
                yield from self._attempt(fence, fencing=True)
            except NoReply as error:
                if self.latency.reply_margin > reply_margin:
                    reply_margin = self.latency.reply_margin  # what came late has taught us to wait longer
                    continue
                if exchange.request == fences[0].request:
                    return  # a servo that answers nothing else may still answer this
                raise NoReply(f"{exchange.what}: no reply", error.heard) from None
            return
        # All of them were asked in vain. Whichever answer to the last of them comes, it comes behind the suspects.
        for request in self._late_replies.later_requests(id, confusable):
            if (last := next((fence for fence in fences if fence.request == request), None)) is not None:
                try:
                    yield from self._attempt(last, fencing=True)
                except NoReply as error:
                    raise NoReply(f"{exchange.what}: no reply", error.heard) from None
                return
        if fences and self.transport.now() <= max(old.given_up for old in confusable) + SLOWEST:
            raise NoReply(f"{exchange.what}: not asked: an older answer could still come and be taken for this one")
        self._late_replies.forget(id)  # nobody has answered for long: begin anew

    def _stray(self, packet: Packet) -> None:
        """Take note of a packet that is no answer to what was asked: a late one, or a stranger's."""
        counts = self.stats[packet.id]
        old = self._late_replies.match(packet)
        if old is None:
            counts.strangers += 1
        else:
            counts.late += 1
            self.latency.note(self.transport.now() - old.due)

    def _sort(self, leftover: bytes, framing: Framing) -> None:
        """Look through bytes that came when nobody waited for any."""
        last = self._answered
        for event in (last.framing if last is not None else framing).decode(leftover):
            if isinstance(event, Packet):
                known = self._late_replies.expects(event)
                if last is not None and last.reply is not None and last.reply.fits(event) and not known:
                    self.stats[event.id].doubled += 1
                    collector = Collector(last)
                    collector.feed(leftover)
                    self._doubled[event.id] = collector.duplicate()
                else:
                    self._stray(event)
            elif isinstance(event, Noise):
                self.stats[BROADCAST].junk += len(event.raw)

    def _drain(self, exchange: Exchange[Any]) -> Waits[None]:
        """Receive until the line is quiet. Raises LineBusy if it never is."""
        gap = min(self.latency.reply_margin, 0.005)
        abandon = self.transport.now() + 0.25
        heard = bytearray()
        while chunk := (yield Receive(gap)):
            heard += chunk
            if self.transport.now() > abandon:
                said = f"{len(heard)} bytes came in 0.25 s although nobody was asked: another master, or noise?"
                raise LineBusy(f"{exchange.what}: not sent, the line is never quiet: {said}", bytes(heard))
        if heard:
            self._sort(bytes(heard), exchange.framing)
        self._unquiet = False

    # Several at once

    def _batch(self, volley: Batch) -> Waits[list[Any]]:
        """Ask one after the other; servobus.link.pipeline does better."""
        results = []
        for exchange in volley.exchanges:
            results += [(yield from self._caught(exchange, again=volley.again))]
        return results

    def _caught(self, exchange: Exchange[Any], *, again: bool) -> Waits[Any]:
        """Ask, and give what went wrong instead of raising it."""
        try:
            return (yield from (self.transact(exchange) if again else self._attempt(exchange)))
        except BusError as error:
            return error


def _strict(fence: Exchange[Any]) -> Exchange[None]:
    """Make a marker of a question: only its full answer counts, for what looks like a refusal may be older."""
    strict = fence.mapped(ack_only)
    if strict.reply is not None:
        strict.reply = strict.reply.strict()
    return strict
