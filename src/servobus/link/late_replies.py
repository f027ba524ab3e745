"""Replies that were given up and may still come: which of them could be taken for the reply to a new question.

A reply that comes late is dangerous if a question of the same kind is under way by then: an old value would be taken
for the new one. An adapter or a computer that stalled delivers all at once, but in order. So when a servo answers a
question, the replies to all that it was asked before have come by then, or never will.

That is so of adapters; a network or a servo could let the answer to a later question go first. Nothing in a packet
tells that. So where a reply was seen to come after later ones, one that was overtaken is still expected for a while,
its horizon: each reply that is lost then costs that much. Where none was, a lost reply costs no more than its time-out.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

from servobus.core.exchange import Exchange, ReplyPattern, ack_only, ack_packet
from servobus.core.framing import Framing, Packet
from servobus.core.values import frozen, replace

SLOWEST = 2.0
"""s; assumption: no servo answers later than this, whatever it does. Adapters may, but in order."""

OVERTAKEN = 0.0
"""s after it was given up for which an overtaken reply is still expected, as long as none was seen to come."""

Sender: TypeAlias = tuple[Framing, int | None]
"""Servo that a reply comes from: two families may share a line, and the same id is then two servos."""


@frozen
class MissedReply:
    """A reply that was given up and may still come."""

    reply: ReplyPattern
    request: bytes
    due: float
    """Time at which it should have come."""
    given_up: float
    """Time at which it was last given up."""
    times: int = 1
    """How often it was asked for in vain."""
    broken: bool = False
    """Whether something was heard that must have been it."""
    overtaken: bool = False
    """Whether the servo has answered a later question since."""


class LateReplies:
    """Replies that may come late, by the servo that they would come from, in the order they were asked for. No clock.

    A reply that any servo may give, as to a broadcast, is kept under the id None.
    """

    def __init__(self) -> None:
        self._missed: dict[Sender, list[MissedReply]] = {}
        self._until = 0.0
        """Time after which no servo can be so late; only an adapter, and that keeps the order."""
        self.horizon = OVERTAKEN
        """s after it was given up for which an overtaken reply is still expected."""
        self._written_off: dict[Sender, float] = {}
        """When the last reply of a servo was given up that is not expected any more."""

    def __bool__(self) -> bool:
        return bool(self._missed)

    def copy(self) -> "LateReplies":
        """Make another that knows the same."""
        other = LateReplies()
        other._missed, other._until = {sender: list(missed) for sender, missed in self._missed.items()}, self._until
        other.horizon, other._written_off = self.horizon, dict(self._written_off)
        return other

    def add(
        self, exchange: Exchange[Any], reply: ReplyPattern, due: float, now: float, *, broken: bool = False
    ) -> None:
        """Remember a reply that did not come: when it was due, and that it was given up now."""
        missed = self._missed.setdefault((exchange.framing, reply.id), [])
        for n, old in enumerate(missed):
            if old.reply == reply and old.request == exchange.request:
                missed[n] = replace(
                    old, given_up=now, times=old.times + 1, broken=broken and old.broken, overtaken=False
                )
                break
        else:
            missed.append(MissedReply(reply, exchange.request, due, now, broken=broken))
        self._until = now + SLOWEST

    # What could be mistaken

    def confusable(self, exchange: Exchange[Any], reply: ReplyPattern) -> list[MissedReply]:
        """Give the late replies, not overtaken yet, that could be taken for this reply to a question.

        A question that only asks whether a servo is there may be answered by an older answer to the same question: it
        says the same.
        """
        return [old for old in self._like(exchange, reply) if not old.overtaken]

    def overtaken(self, exchange: Exchange[Any], reply: ReplyPattern) -> list[MissedReply]:
        """Give the overtaken ones that could be taken for this reply to a question."""
        return [old for old in self._like(exchange, reply) if old.overtaken]

    def expected_until(self, overtaken: Sequence[MissedReply]) -> float:
        """Give the time from which on these are not expected any more."""
        return max(old.given_up for old in overtaken) + self.horizon

    def ambiguous(self, fence: Exchange[Any], confusable: Sequence[MissedReply]) -> bool:
        """Tell whether the reply to a fence could itself be an older one, so that it would prove nothing."""
        shape = fence.reply
        return shape is None or any(
            shape.could_be(old.reply) for old in (*confusable, *self._of(fence.framing, fence.id)) if not old.overtaken
        )

    def later_requests(self, sender: Sender, confusable: Sequence[MissedReply]) -> list[bytes]:
        """Give the requests to a servo that were sent after all the confusable ones, the last one first.

        Whichever reply to one of them comes, it comes after those.
        """
        requests = [old.request for old in self._missed.get(sender, ()) if not old.overtaken]
        last = max((requests.index(old.request) for old in confusable if old.request in requests), default=-1)
        return requests[:last:-1]

    def longest(self, exchange: Exchange[Any]) -> int:
        """Give the size of the longest packet that may come late from the servos asked, in bytes; 0 if none may."""
        if not self._missed:
            return 0
        ids = [reply.id for reply in exchange.replies] or [exchange.id]
        sizes = [max(old.reply.sizes) for id in ids for old in self._of(exchange.framing, id)]
        return exchange.framing.overhead + max(sizes) if sizes else 0

    # What came

    def count(self, exchange: Exchange[Any], reply: ReplyPattern) -> int:
        """Tell how often this reply to this very question was waited for in vain."""
        missed = self._missed.get((exchange.framing, reply.id), ())
        return sum(old.times for old in missed if old.request == exchange.request)

    def expects(self, framing: Framing, packet: Packet) -> bool:
        """Tell whether a packet may be one of the late replies of its sender."""
        return any(old.reply.fits(packet) for old in self._missed.get((framing, packet.id), ()))

    def match(self, framing: Framing, packet: Packet) -> MissedReply | None:
        """Give the late reply that a packet is, and expect it no more."""
        for sender in ((framing, packet.id), (framing, None)):
            missed = self._missed.get(sender, [])
            for n, old in enumerate(missed):
                if old.reply.fits(packet):
                    rest = [replace(old, times=old.times - 1)] if old.times > 1 else []
                    self._keep(sender, [*missed[:n], *rest, *missed[n + 1 :]])
                    return old
        return None

    def resolve_before(self, framing: Framing, id: int, reply: ReplyPattern, now: float) -> None:
        """Take note that this servo has answered with this reply: what was asked before is overtaken, or forgotten.

        If the reply may itself be the late one to an older question of its kind, what was asked after that question is
        still open.
        """
        if now > self._until:
            self._missed.clear()
        for sender in ((framing, id), (framing, None)):
            if (missed := self._missed.get(sender)) is not None:
                alike = (n for n, old in enumerate(missed) if not old.overtaken and reply.could_be(old.reply))
                first = next(alike, len(missed))
                passed = [replace(old, overtaken=True) for old in missed[:first] if not old.broken]
                self._keep(sender, [*passed, *missed[first:]])
        self.expire(now)

    def expire(self, now: float) -> None:
        """Forget those that were overtaken so long ago that they are not expected any more."""
        for sender, missed in list(self._missed.items()):
            if any(old.overtaken for old in missed):
                old = [one for one in missed if one.overtaken and now >= one.given_up + self.horizon]
                if old:
                    self._written_off[sender] = old[-1].given_up
                    self._keep(sender, [one for one in missed if one not in old])

    def note_overtaken(self, framing: Framing, id: int, given_up: float | None, now: float) -> None:
        """Learn from a reply of this servo that others had overtaken, perhaps one that was not expected any more."""
        if given_up is None:
            given_up = self._written_off.get((framing, id), -SLOWEST)
        if now - given_up <= SLOWEST:
            self.horizon = max(self.horizon, min(1.5 * (now - given_up), SLOWEST))

    def forget(self, framing: Framing, id: int) -> None:
        """Expect no late reply of this servo any more."""
        for sender in ((framing, id), (framing, None)):
            self._missed.pop(sender, None)

    def framings(self) -> set[Framing]:
        """Give the kinds of framing of which a reply may come late."""
        return {framing for framing, _ in self._missed}

    def _like(self, exchange: Exchange[Any], reply: ReplyPattern) -> list[MissedReply]:
        if not self._missed:
            return []
        same = exchange.request if exchange.interpret in (ack_only, ack_packet) else None
        return [
            old for old in self._of(exchange.framing, reply.id) if reply.could_be(old.reply) and old.request != same
        ]

    def _of(self, framing: Framing, id: int | None) -> list[MissedReply]:
        of_any = self._missed.get((framing, None), [])
        return of_any if id is None else [*self._missed.get((framing, id), ()), *of_any]

    def _keep(self, sender: Sender, missed: list[MissedReply]) -> None:
        if missed:
            self._missed[sender] = missed
        else:
            del self._missed[sender]
