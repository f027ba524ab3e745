"""Answers that were given up and may still come: what could be mistaken for what.

An adapter or a computer that stalled delivers all at once, but in order. So when a servo answers a question, what it
was asked before has been answered by then, or never will be.
"""

from collections.abc import Sequence
from typing import Any

from servobus.core.exchange import Exchange, Reply, ack_only
from servobus.core.framing import Packet
from servobus.core.values import frozen, replace

SLOWEST = 2.0
"""s; assumption: no servo answers later than this, whatever it does. Adapters may, but in order."""


@frozen
class MissedReply:
    """An answer that was given up and may still come."""

    reply: Reply
    request: bytes
    due: float
    """Time at which it should have come."""
    given_up: float
    """Time at which it was last given up."""
    times: int = 1
    """How often it was asked for in vain."""


class LateReplies:
    """Answers that may come late, by the id they would come from, in the order they were asked for. No clock."""

    def __init__(self) -> None:
        self._lost: dict[int | None, list[MissedReply]] = {}
        self._until = 0.0
        """Time after which no servo can be so late; only an adapter, and that keeps the order."""

    def __bool__(self) -> bool:
        return bool(self._lost)

    def copy(self) -> "LateReplies":
        """Make another that knows the same."""
        other = LateReplies()
        other._lost, other._until = {id: list(lost) for id, lost in self._lost.items()}, self._until
        return other

    def add(self, exchange: Exchange[Any], due: float, now: float) -> None:
        """Remember an answer that did not come: when it was due, and that it was given up now."""
        reply = exchange.reply
        if reply is None:
            return
        lost = self._lost.setdefault(reply.id, [])
        for n, old in enumerate(lost):
            if old.reply == reply and old.request == exchange.request:
                lost[n] = replace(old, given_up=now, times=old.times + 1)
                break
        else:
            lost.append(MissedReply(reply, exchange.request, due, now))
        self._until = now + SLOWEST

    # What could be mistaken

    def confusable(self, exchange: Exchange[Any]) -> list[MissedReply]:
        """Give the late answers that could be mistaken for the answer to this question."""
        reply = exchange.reply
        if reply is None or not self._lost:
            return []
        lost = self._lost.get(reply.id, []) + (self._lost.get(None, []) if reply.id is not None else [])
        # Whether somebody is there may be told by an older answer as well.
        same = exchange.request if exchange.interpret is ack_only else None
        return [old for old in lost if reply.could_be(old.reply) and old.request != same]

    def ambiguous(self, fence: Exchange[Any], confusable: Sequence[MissedReply]) -> bool:
        """Tell whether the answer to a marker could itself be mistaken for an older one."""
        shape = fence.reply
        return shape is None or any(shape.could_be(old.reply) for old in (*confusable, *self._of(fence.id)))

    def later_requests(self, id: int, confusable: Sequence[MissedReply]) -> list[bytes]:
        """Give the requests to this id that were sent behind the suspects and are open, the last one first."""
        requests = [old.request for old in self._lost.get(id, ())]
        last = max((requests.index(old.request) for old in confusable if old.request in requests), default=-1)
        return requests[:last:-1]

    def longest(self, exchange: Exchange[Any]) -> int:
        """Give the size of the longest packet that may come late, in bytes; 0 if none may."""
        lost = self._of(exchange.id)
        return exchange.framing.overhead + max(max(old.reply.sizes) for old in lost) if lost else 0

    # What came

    def count(self, exchange: Exchange[Any]) -> int:
        """Tell how often this very question was asked in vain."""
        return sum(old.times for old in self._lost.get(exchange.id, ()) if old.request == exchange.request)

    def expects(self, packet: Packet) -> bool:
        """Tell whether a packet may be one of the late answers of its sender."""
        return any(old.reply.fits(packet) for old in self._lost.get(packet.id, ()))

    def match(self, packet: Packet) -> MissedReply | None:
        """Give the late answer that a packet is, and expect it no more."""
        for key in (packet.id, None):
            for n, old in enumerate(self._lost.get(key, ())):
                if old.reply.fits(packet):
                    rest = [replace(old, times=old.times - 1)] if old.times > 1 else []
                    self._keep(key, [*self._lost[key][:n], *rest, *self._lost[key][n + 1 :]])
                    return old
        return None

    def resolve_before(self, id: int, exchange: Exchange[Any], now: float) -> None:
        """Forget what cannot come any more now that this servo has answered a later question."""
        if now > self._until:
            self._lost.clear()
        reply = exchange.reply
        for key in (id, None):
            if key in self._lost and reply is not None:
                # If this may be the answer to an older question of its kind, what was asked behind that is still open.
                lost = self._lost[key]
                first = next((n for n, old in enumerate(lost) if reply.could_be(old.reply)), len(lost))
                self._keep(key, lost[first:])

    def forget(self, id: int) -> None:
        """Expect no late answer of this servo any more."""
        for key in (id, None):
            self._lost.pop(key, None)

    def _of(self, id: int) -> list[MissedReply]:
        return [*self._lost.get(id, ()), *self._lost.get(None, ())]

    def _keep(self, key: int | None, lost: list[MissedReply]) -> None:
        if lost:
            self._lost[key] = lost
        else:
            del self._lost[key]
