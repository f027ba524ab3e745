"""Fences: questions that are asked only to be sure that no late reply can come any more.

A servo answers in order, and so do adapters deliver. So when the reply to a fence is here, the replies to all that was
asked before it have come or never will. What does not keep the order is waited out: for a while after it was overtaken
a reply is still expected, and a question to which it could be the answer is not asked.
"""

from collections.abc import Callable, Sequence
from typing import Any

from servobus.core.exchange import Exchange, ReplyPattern
from servobus.errors import BusError, NoReply
from servobus.link.late_replies import SLOWEST
from servobus.link.reply_log import ReplyLog
from servobus.link.waits import Waits


def fenced(
    exchange: Exchange[Any],
    reply: ReplyPattern,
    fences: Callable[[], Sequence[Exchange[Any]]],
    log: ReplyLog,
    ask: Callable[[Exchange[Any]], Waits[Any]],
    listen: Callable[[float, Callable[[], bool]], Waits[None]],
    now: Callable[[], float],
) -> Waits[BusError | None]:
    """Make sure that no late reply can be taken for this one. Gives why that could not be; None if it is sure.

    fences  makes questions to the servo that could serve, none for a broadcast; every servo answers the first one
    ask     asks one of them, and gives its result or the BusError that came of it
    listen  takes note of what comes until a time, s, or until something is so
    """
    error = yield from _in_order(exchange, reply, fences, log, ask, now)
    late = log.late_replies
    if error is None and (overtaken := late.overtaken(exchange, reply)):
        yield from listen(late.expected_until(overtaken), lambda: not late.overtaken(exchange, reply))
        late.expire(now())
    return error


def _in_order(
    exchange: Exchange[Any],
    reply: ReplyPattern,
    fences: Callable[[], Sequence[Exchange[Any]]],
    log: ReplyLog,
    ask: Callable[[Exchange[Any]], Waits[Any]],
    now: Callable[[], float],
) -> Waits[BusError | None]:
    """Make sure of it as far as all keep the order."""
    late, latency = log.late_replies, log.latency
    id = exchange.id if reply.id is None else reply.id
    confusable = late.confusable(exchange, reply)
    if not confusable:
        return None
    strict = [fence.strict() for fence in fences()]  # what looks like a refusal of a fence may be an older reply
    reply_margin = latency.reply_margin
    for fence in strict:
        if late.ambiguous(fence, confusable):
            continue
        outcome = yield from ask(fence)
        if not isinstance(outcome, NoReply):
            return outcome if isinstance(outcome, BusError) else None
        if latency.reply_margin > reply_margin:
            reply_margin = latency.reply_margin  # what came late has taught us to wait longer
            continue
        if exchange.request == strict[0].request:
            return None  # a servo that answers nothing else may still answer this
        return NoReply(f"{exchange.what}: no reply", outcome.heard)
    # All of them were asked in vain. Whichever reply to the last of them comes, it comes behind the late ones.
    for request in late.later_requests((exchange.framing, id), confusable):
        if (last := next((fence for fence in strict if fence.request == request), None)) is not None:
            outcome = yield from ask(last)
            if isinstance(outcome, NoReply):
                return NoReply(f"{exchange.what}: no reply", outcome.heard)
            return outcome if isinstance(outcome, BusError) else None
    if strict and now() <= max(old.given_up for old in confusable) + SLOWEST:
        return NoReply(f"{exchange.what}: not asked: an older answer could still come and be taken for this one")
    late.forget(exchange.framing, id)  # the servo has been silent for so long that nothing can come any more
    return None
