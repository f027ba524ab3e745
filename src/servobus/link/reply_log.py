"""What came on a line, what did not, and what may therefore still come: the memory of a link. It sends nothing."""

from collections.abc import Callable, Collection, Sequence
from typing import Any

from servobus.core.exchange import Exchange, GroupExchange, Lateness, ReplyPattern
from servobus.core.framing import Framing, Noise, Packet
from servobus.core.ids import BROADCAST
from servobus.core.replies import duplicate
from servobus.errors import BrokenEcho, BusError, DuplicateId, NoReply, Refused
from servobus.link.late_replies import SLOWEST, LateReplies
from servobus.link.latency import Latency
from servobus.link.line_clock import LineClock
from servobus.link.stats import Counts, Stats
from servobus.transports.base import Transport


class ReplyLog:
    """What a link knows of replies: counters, delays, those that may come late, and second ones.

    heard    is told of a reply with alarm bits, and of every reply as long as `alarmed` is not empty
    alarmed  servos whose last reply had an alarm in it: that it is over must be told too
    """

    def __init__(
        self,
        transport: Transport,
        clock: LineClock,
        heard: Callable[[Exchange[Any], Packet], None],
        alarmed: Collection[object],
        stats: Stats | None,
    ) -> None:
        self.stats = Stats() if stats is None else stats
        self.latency = Latency(transport)
        self.late_replies = LateReplies()
        self.second_replies: dict[tuple[Framing, int], DuplicateId] = {}
        """Second replies that came after their question was done; reported when the servo is asked next."""
        self.answered: Exchange[Any] | None = None
        """The last question that was answered."""
        self.came_late: set[tuple[Framing, int]] = set()
        """Servos that have answered after they had been given up."""
        self.longest_delay = 0.0
        """s by which the latest answer came later than its bits and its servo allow, since `take_late`."""
        self._asked_all: dict[Framing, float] = {}
        """Until when answers may come to a question to all servos, for which none is waited."""
        self.heard, self.alarmed = heard, alarmed
        self._transport, self._clock = transport, clock

    def follow(self, other: "ReplyLog") -> None:
        """Go on with what another link on the same line has learned and may still get."""
        self.latency, self.late_replies = other.latency, other.late_replies.copy()
        self.came_late = set(other.came_late)

    @property
    def uneasy(self) -> bool:
        """Whether a reply may come late, or a second one is still to be reported."""
        return bool(self.late_replies or self.second_replies)

    def doubtful(self, exchange: Exchange[Any]) -> bool:
        """Tell whether a late reply could be taken for the answer to this, or a second one is to be reported."""
        return self.uneasy and (
            (exchange.framing, exchange.id) in self.second_replies
            or any(
                self.late_replies.confusable(exchange, reply) or self.late_replies.overtaken(exchange, reply)
                for reply in exchange.replies
            )
        )

    def counts(self, exchange: Exchange[Any], id: int) -> Counts:
        """Give the counters of a servo of the kind that is asked, at the present speed."""
        return self.stats.servo(exchange.framing.name, id, self._transport.baud)

    # What came

    def note_asked_all(self, exchange: Exchange[Any]) -> None:
        """Take note of a question to all servos that need not be answered, such as a PING: some models do."""
        self._asked_all[exchange.framing] = self._transport.now() + SLOWEST

    def note_sent(self, exchange: Exchange[Any]) -> None:
        """Take note of a request, which counts for each servo that it asks."""
        several = isinstance(exchange, GroupExchange)
        for id in [reply.id for reply in exchange.replies] if several else [exchange.id]:
            self.counts(exchange, exchange.id if id is None else id).sent += 1

    def note_reply(self, exchange: Exchange[Any], reply: ReplyPattern, packet: Packet, late: float | None) -> None:
        """Take note of a reply that came this many seconds later than its bits allow, if that is known."""
        counts = self.counts(exchange, packet.id)
        counts.received += 1
        if late is not None:
            counts.worst = max(counts.worst, late)
            self._note_delay(late, exchange.typical_delay)
        self.answered = exchange
        if self.late_replies:
            self.late_replies.resolve_before(exchange.framing, packet.id, reply, self._transport.now())
        if exchange.alarms is not None and (exchange.alarms(packet) or self.alarmed):
            self.heard(exchange, packet)

    def note_stray(self, framing: Framing, packet: Packet) -> None:
        """Take note of a packet that is no reply to what was asked: a late one, or one that nothing asked for."""
        counts = self.stats.servo(framing.name, packet.id, self._transport.baud)
        old = self.late_replies.match(framing, packet)
        if old is None:
            counts.strangers += 1
        else:
            counts.late += 1
            now = self._transport.now()
            late = now - old.due
            counts.worst = max(counts.worst, late)
            self._note_delay(late)
            self.came_late.add((framing, packet.id))
            if old.overtaken:
                self.late_replies.note_overtaken(framing, packet.id, old.given_up, now)

    def note_leftover(self, leftover: bytes, framing: Framing) -> None:
        """Look through bytes that came when nothing was asked; `framing` is what was or is about to be asked."""
        last = self.answered
        if last is not None:
            framing = last.framing
        leftover = self.without_late(leftover, framing)
        for event in framing.decode(leftover):
            if isinstance(event, Packet):
                asked = self._transport.now() < self._asked_all.get(framing, 0.0)
                known = asked or self.late_replies.expects(framing, event)
                if last is not None and not known and any(reply.fits(event) for reply in last.replies):
                    self.counts(last, event.id).doubled += 1
                    self.late_replies.note_overtaken(framing, event.id, None, self._transport.now())
                    self.second_replies[framing, event.id] = duplicate(last, event.id, leftover)
                else:
                    self.note_stray(framing, event)
            elif isinstance(event, Noise):
                self.stats.servo(framing.name, BROADCAST, self._transport.baud).junk += len(event.raw)

    def without_late(self, heard: bytes, own: Framing) -> bytes:
        """Take note of the late replies of other families in what was heard, and give the rest of it."""
        for framing in self.late_replies.framings() - {own}:
            rest, done = bytearray(), 0
            for event in framing.decode(heard):
                if isinstance(event, Packet) and self.late_replies.expects(framing, event):
                    self.note_stray(framing, event)
                    rest += heard[done : event.end - framing.overhead - len(event.data)]
                    done = event.end
            heard = bytes(rest) + heard[done:]
        return heard

    def take_late(self) -> Lateness:
        """Tell how late answers come, and of which servos they came too late since the last call."""
        came, self.came_late = self.came_late, set()
        longest, self.longest_delay = self.longest_delay, 0.0
        return Lateness(self.latency.usual_delay, frozenset(came), longest)

    def _note_delay(self, late: float, typical: float = 0.0) -> None:
        self.latency.note(late)
        self.longest_delay = max(self.longest_delay, late - typical)

    # What did not come

    def note_missed(self, exchange: Exchange[Any], reply: ReplyPattern, due: float, *, broken: bool = False) -> None:
        """Remember a reply that did not come, and may come late; its request had left when it was due.

        `broken` says that something was heard that must have been it.
        """
        self.late_replies.add(exchange, reply, due, self._transport.now(), broken=broken)

    def note_under_way(self, exchanges: Sequence[Exchange[Any]]) -> None:
        """Remember all replies to questions that were dropped without a word."""
        for exchange in exchanges:
            for reply in exchange.replies:
                self.note_missed(exchange, reply, self._clock.clear_at)

    def note_outcomes(self, exchanges: Sequence[Exchange[Any]], outcomes: Sequence[Any]) -> bool:
        """Count what went wrong, and tell whether any of it was more than silence or a refusal."""
        troubled = False
        for exchange, outcome in zip(exchanges, outcomes, strict=True):
            several = isinstance(exchange, GroupExchange) and isinstance(outcome, list)
            ids = [exchange.id if reply.id is None else reply.id for reply in exchange.replies] if several else ()
            for id, error in zip(ids or [exchange.id], outcome if several else [outcome], strict=True):
                if isinstance(error, BusError):
                    counts = self.counts(exchange, id)
                    counts.timeouts += isinstance(error, NoReply)
                    counts.echo += isinstance(error, BrokenEcho)
                    counts.doubled += isinstance(error, DuplicateId)
                    troubled = troubled or not isinstance(error, NoReply | Refused)
        return troubled
