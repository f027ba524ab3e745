"""One port in use: what is sent when, how long to listen, and what may still be coming.

`Link` carries out the steps of a job as generators of waits; a driver only lets time pass, blocking or awaiting. A
generator may be closed at any of its waits: a task was cancelled, Ctrl-C came. The link then still knows what it had
sent, so that the next question is not answered by the last.

Theory of operation. On a serial bus nothing in a reply says which request it answers. A driver that just sends and
reads takes a late reply for the next one, and gives a wrong value without any error. Five rules prevent that:

- A packet is taken for the reply only if it fits the question, and does not come sooner than its bits can.
- After any trouble nothing is sent until the line is quiet: a request that meets leftovers is lost or misread.
- A reply that did not come may come late. Adapters and computers that stall deliver all at once, but in order. So
  before a question to which a late reply could be taken for the answer, another one is asked whose answer cannot be
  mistaken (a fence). When that is answered, everything before it has come or never will, but for what does not keep the
  order: that is waited out.
- A copy of what was sent is an echo, or a broken one, never a reply.
- A second reply to one question is reported: two servos have one id.

The state of a link says what may come next:

    state     what is under way              what may come             next request
    IDLE      nothing                        nothing                   may go the fast path
    CAREFUL   nothing, or a request that     late replies, echoes      goes the long way: waits for the wire, asks a
              nothing answers                                          fence where a late reply could be mistaken
    WAITING   a request that is answered     its reply                 waits for the outcome
    UNSURE    nothing                        bytes that belong to no   waits until the line is quiet
                                             request

    from      event                                                    to
    IDLE      fast path: a request is sent                             WAITING
    WAITING   its reply came, and there is nothing to be careful of    IDLE
    WAITING   its reply came, or did not, or the wait was closed       CAREFUL, as long as a reply may come late, a
                                                                       request is still leaving, an echo is to be taken
                                                                       out, or a second reply is still to be reported
    WAITING   what came was garbled, doubled or foreign                UNSURE
    CAREFUL   bytes are there before a request is sent                 UNSURE
    UNSURE    the line was quiet                                       CAREFUL
    CAREFUL   a request is sent                                        WAITING

A stop for safety may take the line over in any state and from another thread: `supersede` gives a new link, in UNSURE,
and the old one sends nothing more. That is a flag of its own, so that no change of state undoes it.
"""

from collections.abc import Callable, Collection, Sequence
from enum import Enum
from time import monotonic
from typing import Any, Final, TypeVar

from servobus.core.exchange import (
    Batch,
    Exchange,
    GroupExchange,
    Job,
    LateAnswers,
    Now,
    Pause,
    ReplyPattern,
    SetBaud,
    Settle,
    Step,
)
from servobus.core.framing import Framing, Packet
from servobus.core.ids import BROADCAST
from servobus.core.replies import ReplyCollector
from servobus.errors import BrokenEcho, BusError, LineBusy, ServobusError, Stopped
from servobus.link.asking import Asking
from servobus.link.fence import fenced
from servobus.link.line_clock import LineClock, Timing
from servobus.link.overheard import Overheard
from servobus.link.pipeline import Pipeline
from servobus.link.reply_log import ReplyLog
from servobus.link.stats import Counts, Stats
from servobus.link.waits import Receive, Rest, Waits
from servobus.transports.base import Transport

T = TypeVar("T")

GAP = 0.005
"""s of silence after which what was heard is over."""
NOT_FAST: Final = object()
"""What `try_fast_receive` gives where a longer look is needed."""


class LinkState(Enum):
    """What may come on the line; see the table at the head of this module."""

    IDLE = "idle"
    CAREFUL = "careful"
    WAITING = "waiting"
    UNSURE = "unsure"


IDLE, CAREFUL, WAITING, UNSURE = LinkState.IDLE, LinkState.CAREFUL, LinkState.WAITING, LinkState.UNSURE


class Link:
    """A port in use: its speed, its echo, its delays, and what may still be under way on it.

    heard    is told of a reply with alarm bits, and of every reply as long as `alarmed` is not empty
    fences   gives harmless questions to a servo whose answers differ in shape
    alarmed  servos whose last reply had an alarm in it: that it is over must be told too
    stats    counters to go on with
    contended  tells whether another job waits for the line
    """

    def __init__(
        self,
        transport: Transport,
        *,
        echo: bool | None,
        heard: Callable[[Exchange[Any], Packet], None],
        fences: Callable[[Framing, int], Sequence[Exchange[Any]]],
        alarmed: Collection[object] = (),
        stats: Stats | None = None,
        contended: Callable[[], bool] = lambda: False,
    ) -> None:
        self.transport = transport
        self.state = CAREFUL
        self.superseded = False
        """Whether a stop for safety has taken the line over: then nothing is sent here any more."""
        self.echo = echo
        """Whether the adapter gives back what it sends; None as long as that is not known."""
        self._fences = fences
        self._clock = LineClock(transport)
        self.log = ReplyLog(transport, self._clock, heard, alarmed, stats)
        self.latency = self.log.latency
        self._pipeline = Pipeline()
        self._overheard = Overheard()
        self._asking = Asking(
            transport,
            self._clock,
            self.log,
            self._pipeline,
            self._attempt,
            contended,
            echo_known=lambda: self.echo is not None,
        )
        self._contended = contended
        self._probing = False
        """Whether a request that looks like its own reply came back: from now on a probe goes before such requests."""
        self._under_way: Sequence[Exchange[Any]] = ()
        """What was sent last; its replies may still come if the state is WAITING."""
        self._deadline = 0.0
        """Time at which the last reply must be here."""
        self._began = 0.0
        """Time at which the fast path sent its request."""
        self._timings: dict[Exchange[Any], Timing] = {}
        self._timing = Timing((), 0.0, 0.0, 0.0, Counts())

    @property
    def stats(self) -> Stats:
        """What happened on this line, in numbers."""
        return self.log.stats

    # Whole jobs

    def run(self, job: Job[T]) -> Waits[T]:
        """Carry out a job, at the speed in use now; each SetBaud step changes it for the rest of the job.

        What else uses the line meanwhile, in a shared pause or in a callback of the job, may leave it at another speed.
        """
        if isinstance(job, Exchange):
            return (yield from self.transact(job))
        baud = self.transport.baud
        try:
            step = next(job)
            while True:
                try:
                    if isinstance(step, SetBaud):
                        baud = step.baud
                    if not isinstance(step, Pause | Now):
                        yield from self.set_baud(baud)
                    result = yield from self._step(step)
                except ServobusError as error:  # a lost port too: what was begun can say how far it came
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
            return (yield from self._asking.batch(step))
        if isinstance(step, SetBaud):
            return self.transport.baud_elsewhere
        if isinstance(step, Now):
            return self.transport.now()
        if isinstance(step, LateAnswers):
            wait = 0.0 if self.latency.answers else step.wait
            yield from self._listen_late(self.transport.now() + wait)
            return self.log.take_late()
        if isinstance(step, Settle):
            yield from self._until(self._clock.clear_at)
            yield from self._end_foreign(step.framing, "the end of the requests to other families")
        if isinstance(step, Pause):
            yield from self._until(self._clock.clear_at)
            yield Rest(step.seconds, step.shared)
        return None

    def transact(self, exchange: Exchange[T], begun: bytes | None = None) -> Waits[T]:
        """Ask, and ask again where that is allowed. `begun` is what was heard if it is sent already."""
        return self._asking.until_answered(exchange, begun)

    def set_baud(self, baud: int) -> Waits[None]:
        """Talk at this speed from now on, if need be after our last bytes have left."""
        if baud == self.transport.baud:
            return
        yield from self._until(self._clock.settled_at)
        self.check()
        self.transport.set_baud(baud)
        self._overheard.forget()
        self._timings.clear()
        self._clock.note_baud()

    def check(self) -> None:
        """Raise Stopped if a stop has taken the line over."""
        if self.superseded:
            raise Stopped("interrupted: the line was needed to make the servos safe")

    def supersede(self) -> "Link":
        """Have the exchange under way fail with Stopped, and all later ones; give a link that has the line instead.

        The new link lets what was under way come in before it sends anything, and takes its reply for a late one.
        """
        self.superseded = True
        log = self.log
        link = Link(
            self.transport,
            echo=self.echo,
            heard=log.heard,
            fences=self._fences,
            alarmed=log.alarmed,
            stats=log.stats,
            contended=self._contended,
        )
        link.state = UNSURE
        link.log.follow(log)
        link.latency, link._probing = log.latency, self._probing
        link._overheard = self._overheard
        link._clock.follow(self._clock, log.latency.reply_margin)
        if self.state is WAITING:
            link.log.note_under_way(self._under_way)
        return link

    def _until(self, moment: float) -> Waits[None]:
        if (seconds := moment - self.transport.now()) > 0:
            yield Rest(seconds)

    # The fast path: an idle line, one write, one read

    def try_fast_send(self, exchange: Exchange[Any]) -> float:
        """Send at once if nothing stands against it; give the seconds to listen, or 0 if it takes the long way."""
        if self.state is not IDLE or self.superseded or self.transport.pending():
            return 0.0
        framing, overheard = exchange.framing, self._overheard
        if framing is not overheard.last and overheard.padding(framing, self.transport.now(), exchange.request):
            return 0.0
        timing = self._timings.get(exchange)
        if timing is None:
            if exchange.reply is None or not exchange.repeatable:
                return 0.0
            timing = self._time(exchange)
        self._under_way = timing.exchanges
        self.state = WAITING  # before the write: if Ctrl-C ends it, the next question knows of this one
        self._began = monotonic()
        self.transport.write(exchange.request)
        overheard.note(self._began + timing.wire, framing, exchange.request)
        self._timing = timing  # what follows costs no time: the servo is at work
        timing.counts.sent += 1
        return timing.window + self.latency.reply_margin

    def try_fast_receive(self, exchange: Exchange[T], chunk: bytes) -> T | object:
        """Give the result if what came is the reply and nothing else; NOT_FAST if it takes more than a look."""
        packet = exchange.framing.whole(chunk)
        if packet is None or not exchange.reply.fits(packet) or chunk == exchange.request:  # type: ignore[union-attr] # try_fast_send has seen to it
            return NOT_FAST
        timing = self._timing
        late = monotonic() - self._began - timing.wire
        if late < 0 and self.latency.impossible(late, timing.wire):
            return NOT_FAST
        self.state = IDLE
        counts = timing.counts
        counts.received += 1
        if late > counts.worst:  # noqa: PLR1730 - max() takes three times as long
            counts.worst = late
        self.latency.note(late)
        self.log.answered = exchange
        alarms = exchange.alarms
        if alarms is not None and (alarms(packet) or self.log.alarmed):
            self.log.heard(exchange, packet)
        return exchange.interpret(packet)  # type: ignore[no-any-return] # it is a T: this is no GroupExchange

    def abandon(self) -> None:
        """Say that the wait for the reply to what `try_fast_send` sent has ended: the reply may still come."""
        self._clock.note_began(self._began, sum(len(exchange.request) for exchange in self._under_way))
        self._clock.note_broken_off(self._began + self._timing.window)
        self.log.note_under_way(self._under_way)
        self._settle()

    def _time(self, exchange: Exchange[Any]) -> Timing:
        """Work out the times of an exchange at the present speed, once."""
        if len(self._timings) > 1000:
            self._timings.clear()  # the program makes its questions anew each time
        soon = self._pipeline.answered_within(exchange, self._clock.byte_time)
        timing = self._clock.timing(exchange, self.log.counts(exchange, exchange.id), soon)
        self._timings[exchange] = timing
        return timing

    # The long way: one attempt at one or several questions

    def _attempt(
        self,
        exchanges: Sequence[Exchange[Any]],
        begun: bytes | None = None,
        *,
        fence: bool = False,
        yields: bool = False,
    ) -> Waits[list[Any]]:
        """Send one or several questions and wait for their replies; give a result or a BusError for each.

        Where the fast path ends before all are asked, the list is shorter. Raises the BusError that kept them from
        being sent. See `Attempt`.
        """
        looked: list[Any] = []
        if begun is None and not fence:
            looked, begun = yield from self._at_a_look(exchanges)
            if looked and begun is None:
                return looked
            exchanges = exchanges[len(looked) :]
        refused: dict[int, BusError] = {}
        if begun is None:
            refused = yield from self._ready(exchanges, fence=fence)
        longest = max(map(self.log.late_replies.longest, exchanges))
        collector = ReplyCollector(exchanges, self.echo, self._with_probe(exchanges, begun), longest)
        for n, error in refused.items():
            collector.give_up(n, error)
        if refused and collector.done:
            return collector.outcomes()
        older = [self.log.late_replies.count(*expected) for expected in collector.expected]
        left: list[float] = []
        unsure = False
        try:
            yield from self._send_all(collector, begun, left, yields=yields)
            yield from self._receive(collector, self._deadline, left)
            outcomes, unsure = self._judge(collector, older, left)
            return [*looked, *outcomes]
        finally:
            # They may still come, even if the wait for them was closed.
            broken = len(exchanges) == 1 and collector.noisy and not collector.strangers
            for n in collector.missing:
                exchange, reply = collector.expected[n]
                owner = collector.owners[n]
                due = left[owner] if owner < len(left) else self._clock.clear_at
                self.log.note_missed(exchange, reply, due, broken=broken)
            if collector.packets and collector.packets[-1] is not None:
                self._clock.note_answered()
            elif not collector.done:
                self._clock.note_broken_off(self._deadline - self.latency.reply_margin)
            self._settle(unsure=unsure)

    def _with_probe(self, exchanges: Sequence[Exchange[Any]], begun: bytes | None) -> bytes:
        """Put the probe before a request that could be its own reply, as long as an echo is possible.

        If the probe comes back, so does the request, and it is no reply.
        """
        exchange = exchanges[0]
        doubtful = self.echo is None or (self._probing and not self.echo)
        if len(exchanges) == 1 and begun is None and doubtful and exchange.looks_like_its_reply():
            return exchange.framing.probe + exchange.request
        return exchange.request

    def _at_a_look(self, exchanges: Sequence[Exchange[Any]]) -> Waits[tuple[list[Any], bytes | None]]:
        """Ask one after the other on the fast path, as far as it goes; give their outcomes.

        And what was heard of the next one, if that was sent and its reply takes more than a look. It is given up so
        soon that the long way still sends the others before that reply is overdue.
        """
        outcomes: list[Any] = []
        several = len(exchanges) > 1
        if several and (exchanges[0].framing.filler or not self._pipeline.settled):
            return outcomes, None  # they are better asked all at once, or there is something to learn from them
        yield from self._calm_down()
        for exchange in exchanges:
            if not (window := self.try_fast_send(exchange)):
                break
            if several:
                window = min(window, self._timing.soon)
            try:
                heard = yield Receive(window)
            except BaseException:
                self.abandon()
                raise
            try:
                outcome = self.try_fast_receive(exchange, heard)
            except BusError as error:
                outcome = error
                if self.log.note_outcomes((exchange,), (error,)):
                    self.state = UNSURE
            if outcome is NOT_FAST:
                return outcomes, heard
            outcomes.append(outcome)
        return outcomes, None

    def _calm_down(self) -> Waits[None]:
        """Let a request leave that nothing answers, such as goals to many servos: then the fast path is open again."""
        if self.state is CAREFUL and self.echo is False and not self.log.uneasy:
            yield from self._until(self._clock.clear_at)
            self.state = IDLE

    def _send_all(
        self, collector: ReplyCollector, begun: bytes | None, left: list[float], *, yields: bool
    ) -> Waits[None]:
        """Send the questions so that no two replies can meet; note when each request has left.

        Where the first is sent already, `begun` is what was heard of it. With `yields` those that are left are not sent
        as soon as another job waits for the line.
        """
        exchanges, clock = collector.exchanges, self._clock
        self._under_way = exchanges
        if begun is not None:
            clock.note_began(self._began, len(collector.sent))
            self._deadline = self._began + self._timing.window + self.latency.reply_margin
            left.append(clock.clear_at)
            self._take(collector, begun, left)
        elif len(exchanges) > 1 and exchanges[0].framing.filler and not self.echo:
            # An echo of the fillers could not be told from noise.
            data, ends = self._pipeline.stream(exchanges, clock.byte_time)
            self._send(exchanges, data)
            left += [clock.clear_at - (len(data) - end) * clock.byte_time for end in ends]
        else:
            self._send(exchanges[:1], collector.sent)
            left.append(clock.clear_at)
        for n in range(len(left), len(exchanges)):
            due = clock.clear_at + self._pipeline.answered_within(exchanges[n - 1], clock.byte_time)
            yield from self._receive(collector, due, left, wanted=n - 1)
            yield from self._until(clock.clear_at)
            if yields and n > 1 and self._contended():
                collector.cut(n)
                break
            self._send(exchanges[n : n + 1], exchanges[n].request)
            left.append(clock.clear_at)

    def _send(self, exchanges: Sequence[Exchange[Any]], data: bytes) -> None:
        """Send, and work out when to give up."""
        self.check()
        self.latency.review()
        last = exchanges[-1]
        for exchange in exchanges:
            self.log.note_sent(exchange)
        now = self.transport.now()
        self.state = WAITING
        self.transport.write(data)
        clock = self._clock
        clock.note_sent(now, len(data), answered=bool(last.replies))
        if last.id == BROADCAST and last.repeatable and not last.replies:
            self.log.note_asked_all(last)
        if last.replies:
            self._deadline = clock.clear_at + clock.longest_answer(last) + self.latency.reply_margin
        else:
            self._deadline = clock.clear_at if self.echo is False else clock.settled_at
        self._overheard.note(clock.clear_at, last.framing, data)

    def _receive(
        self, collector: ReplyCollector, until: float, left: Sequence[float], wanted: int | None = None
    ) -> Waits[None]:
        """Receive until this time, or until all replies are here, or the one that is wanted.

        When time is up the reply may be here all the same, if this computer stalled: it looks once more. No reply of a
        group comes behind one that stays silent.
        """
        exchange, clock, seconds = collector.exchanges[-1], self._clock, 1.0
        heard = max(self.transport.now(), clock.clear_at)
        while not collector.done and seconds > 0 and (wanted is None or collector.packets[wanted] is None):
            if isinstance(exchange, GroupExchange):
                self._deadline = min(until, heard + clock.longest_wait(exchange) + self.latency.reply_margin)
                seconds = self._deadline - self.transport.now()
            else:
                seconds = until - self.transport.now()
            if chunk := (yield Receive(max(seconds, 0.0))):
                heard = max(self.transport.now(), clock.clear_at)
            self._take(collector, chunk, left)

    def _take(self, collector: ReplyCollector, chunk: bytes, left: Sequence[float]) -> None:
        """Take bytes in, and take note of the packets in them."""
        arrivals = collector.feed(chunk)
        if not self._is_new_echo(collector):
            self._sort_arrivals(collector, arrivals, left)

    def _sort_arrivals(
        self, collector: ReplyCollector, arrivals: Sequence[tuple[int | None, Packet]], left: Sequence[float]
    ) -> None:
        """Take note of packets, and refuse those that come sooner than they can."""
        framing, byte_time = collector.exchanges[0].framing, self._clock.byte_time
        for n, packet in arrivals:
            if n is None:
                self.log.note_stray(framing, packet)
                continue
            (exchange, reply), owner, size = collector.expected[n], collector.owners[n], collector.size_until(n)
            sent = owner < len(left)
            late = self.transport.now() - left[owner] - size * byte_time if sent else 0.0
            if not sent or self.latency.impossible(late, (len(exchange.request) + size) * byte_time):
                collector.reject(n)  # an older reply, or one more to what was asked before
                self.log.note_stray(framing, packet)
            else:
                self.log.note_reply(exchange, reply, packet, collector.later_than_before(owner, late))

    def _judge(self, collector: ReplyCollector, older: Sequence[int], left: Sequence[float]) -> tuple[list[Any], bool]:
        """Give the outcomes of what was collected, and whether bytes may come that belong to no request."""
        if not collector.done:
            self._sort_arrivals(collector, collector.end(), left)
        exchanges = collector.exchanges
        if collector.noisy:
            rest = self.log.without_late(bytes(collector.heard), exchanges[0].framing)
            if len(rest) < len(collector.heard):
                collector.replace_heard(rest)
        if self._is_new_echo(collector):
            collector.reject(0)  # the reply is still to come
            self.echo = None
            self._probing = True  # a servo may answer so, such as one with a voltage error
            said = "the line echoes what is sent; it did not before"
            outcomes: list[Any] = [BrokenEcho(f"{exchanges[0].what}: {said}")]
        else:
            self.echo = collector.echo if collector.echo is not None else self.echo
            outcomes = collector.outcomes(older)
        several = len(collector.expected) > 1
        # Of several questions it is unknown whose reply the broken bytes were.
        counts = self.log.counts(exchanges[0], BROADCAST if several else exchanges[0].id)
        counts.checksum += collector.corrupt
        counts.junk += collector.junk
        if len(exchanges) > 1:
            self._pipeline.learn(exchanges, outcomes, self._clock.byte_time, noisy=collector.noisy)
        troubled = self.log.note_outcomes(exchanges, outcomes)
        return outcomes, troubled or (several and collector.noisy)

    def _is_new_echo(self, collector: ReplyCollector) -> bool:
        """Tell whether what looks like the reply is the request, on a line that was thought not to echo."""
        return self.echo is False and collector.could_be_echo

    # Before a request

    def _ready(self, exchanges: Sequence[Exchange[Any]], *, fence: bool) -> Waits[dict[int, BusError]]:
        """Wait until nothing stands against sending, and no late reply can be taken for the ones to come.

        Gives the errors of those replies, by number, for which a late one could still be taken. Before a fence no other
        fence is asked: even an older reply to it proves that what was asked before it has come.
        """
        self.check()
        if self.state is WAITING:  # the fast path was broken off before it could say so
            self.abandon()
        until = self._clock.clear_at
        if not all(exchange.repeatable for exchange in exchanges):
            # What is not sent twice must not meet a servo that still takes bytes of another speed for a packet.
            until = max(until, self._clock.forgotten_at(exchanges[0].framing))
        yield from self._until(until)
        if exchanges[0].anyway:
            self.state = UNSURE  # whatever comes now belongs to nothing
            return {}
        yield from self._quiet(exchanges[0].framing, exchanges[0].what)
        if exchanges[0].framing is not self._overheard.last:
            yield from self._end_foreign(exchanges[0].framing, exchanges[0].what, exchanges[0].request)
        refused: dict[int, BusError] = {}
        asked = [(exchange, reply) for exchange in exchanges for reply in exchange.replies or (None,)]
        for n, (exchange, reply) in enumerate(asked):
            id = exchange.id if reply is None or reply.id is None else reply.id
            error: BusError | None = self.log.second_replies.pop((exchange.framing, id), None)
            if error is None and reply is not None and not fence and self.log.uneasy:
                error = yield from self._fenced(exchange, reply, id)
            if error is not None:
                refused[n] = error
        if refused and len(asked) == 1:
            raise refused[0]
        if refused and len(refused) < len(asked):
            yield from self._quiet(exchanges[0].framing, exchanges[0].what)
        return refused

    def _end_foreign(self, framing: Framing, what: str, request: bytes = b"") -> Waits[None]:
        """End the packet that servos of this kind wait for since they heard what was meant for another family."""
        padding = self._overheard.padding(framing, self.transport.now(), request)
        if not padding:
            return
        self.check()
        self.state = UNSURE  # some servos answer that the packet was wrong, and an adapter may echo
        self.transport.write(padding)
        self._clock.note_sent(self.transport.now(), len(padding), answered=False)
        self._overheard.note(self._clock.clear_at, framing, padding)
        yield from self._until(self._clock.clear_at)
        yield from self._quiet(framing, what)

    def _quiet(self, framing: Framing, what: str) -> Waits[None]:
        """Take out what came although nothing was asked, and wait until no more comes. Raises LineBusy if it does."""
        if leftover := self.transport.discard():
            self.log.note_leftover(leftover, framing)
            self.state = UNSURE
        if self.state is not UNSURE:
            return
        gap = min(self.latency.reply_margin, GAP)
        abandon = self.transport.now() + 0.25
        heard = bytearray()
        while chunk := (yield Receive(gap)):
            heard += chunk
            if self.transport.now() > abandon:
                said = f"{len(heard)} bytes came in 0.25 s although nothing was asked: another master, or noise?"
                raise LineBusy(f"{what}: not sent, the line is never quiet: {said}", bytes(heard))
        if heard:
            self.log.note_leftover(bytes(heard), framing)
        self.state = CAREFUL

    def _fenced(self, exchange: Exchange[Any], reply: ReplyPattern, id: int) -> Waits[BusError | None]:
        def fences() -> Sequence[Exchange[Any]]:
            return self._fences(exchange.framing, id) if id != BROADCAST else ()

        def ask(fence: Exchange[Any]) -> Waits[Any]:
            return self._asking.once(fence, fence=True)

        def listen(until: float, over: Callable[[], bool]) -> Waits[None]:
            return self._listen(until, over, exchange.framing)

        return (yield from fenced(exchange, reply, fences, self.log, ask, listen, self.transport.now))

    def _listen_late(self, until: float) -> Waits[None]:
        """Take note of replies that come late, until this time or until none may come any more."""
        late = self.log.late_replies
        if framings := late.framings():
            yield from self._listen(until, lambda: not late, next(iter(framings)))

    def _listen(self, until: float, over: Callable[[], bool], framing: Framing) -> Waits[None]:
        """Take note of what comes although nothing is asked, until this time or until it is over."""
        heard = bytearray()
        while True:
            seconds = max(until - self.transport.now(), 0.0)
            chunk = yield Receive(min(seconds, GAP) if heard else seconds)
            heard += chunk
            if not chunk and heard:
                self.log.note_leftover(bytes(heard), framing)
                heard.clear()
            if not seconds or (not heard and over()):
                break
        if heard:
            self.log.note_leftover(bytes(heard), framing)

    def _settle(self, *, unsure: bool = False) -> None:
        """Leave WAITING."""
        careful = self.echo is not False or self.log.uneasy or self._clock.clear_at
        self.state = UNSURE if unsure else CAREFUL if careful else IDLE
