"""Exchanges and the other steps of a procedure as values that can be sent, and what came of them.

What turns a reply into a result stays with the client, and so do alarms: an exchange goes as its bytes, the pattern of
its reply and its times. What comes back is the packet, or the error that came of it.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from servobus.core.exchange import (
    Batch,
    Exchange,
    GroupExchange,
    LateAnswers,
    Lateness,
    Pause,
    ReplyPattern,
    Settle,
    Step,
    ack_only,
    ack_packet,
)
from servobus.core.framing import Framing, Packet
from servobus.core.ids import BROADCAST
from servobus.core.values import frozen
from servobus.errors import BusError, UsageError
from servobus.families import registry
from servobus.remote.faults import Fault, fault
from servobus.remote.messages import message

LONGEST_DELAY = 1.0
"""s that a servo may need for its answer, at most; a step that asks for more is refused."""
LONGEST_PAUSE = 2.0
"""s that one pause with the line held may last; a client that pauses for longer asks again."""
LONGEST_REQUEST = 1 << 16
"""Bytes of a request with what goes before it; at 9600 baud these take a minute."""


@message("exchange")
@frozen
class SentExchange:
    """An `Exchange`; see there.

    joins  whether it may be joined with others of its family
    acks   whether its reply only says that the request arrived
    """

    what: str
    family: str
    request: bytes
    reply: ReplyPattern | None
    max_delay: float
    typical_delay: float
    repeatable: bool = False
    anyway: bool = False
    joins: bool = False
    acks: bool = False


@message("group")
@frozen
class SentGroup:
    """A `GroupExchange`."""

    what: str
    family: str
    request: bytes
    parts: tuple[SentExchange, ...]


@message("batch")
@frozen
class SentBatch:
    """A `Batch`."""

    exchanges: tuple[SentExchange, ...]
    again: bool = True
    yields: bool = False


@message("pause")
@frozen
class SentPause:
    """A `Pause` with the line held, s."""

    seconds: float


@message("settle")
@frozen
class SentSettle:
    """A `Settle`."""

    family: str


@message("late_answers")
@frozen
class SentLateAnswers:
    """A `LateAnswers`, s."""

    wait: float


SentStep: TypeAlias = SentExchange | SentGroup | SentBatch | SentPause | SentSettle | SentLateAnswers


@frozen
class SentPacket:
    """A `Packet`, without its place in the stream."""

    id: int
    code: int
    data: bytes


@frozen
class SentLateness:
    """A `Lateness`. Servos are named by family and id."""

    usual: float
    servos: tuple[tuple[str, int], ...]
    longest: float


Outcome: TypeAlias = SentPacket | Fault


# The client's side


def sent(step: Step) -> SentStep:
    """Give what is sent of a step."""
    if isinstance(step, GroupExchange):
        parts = tuple(_sent_exchange(part) for part in step.parts)
        return SentGroup(step.what, step.framing.name, step.request, parts)
    if isinstance(step, Exchange):
        return _sent_exchange(step)
    if isinstance(step, Batch):
        if any(isinstance(one, GroupExchange) for one in step.exchanges):
            raise UsageError("a batch of groups cannot be sent: ask one group after the other")
        return SentBatch(tuple(_sent_exchange(one) for one in step.exchanges), step.again, step.yields)
    if isinstance(step, Pause):
        return SentPause(step.seconds)
    if isinstance(step, Settle):
        return SentSettle(step.framing.name)
    if isinstance(step, LateAnswers):
        return SentLateAnswers(step.wait)
    raise UsageError(f"{step!r:.60} is no step that can be sent")


def _sent_exchange(exchange: Exchange[Any]) -> SentExchange:
    return SentExchange(
        exchange.what,
        exchange.framing.name,
        exchange.request,
        exchange.reply,
        exchange.max_delay,
        exchange.typical_delay,
        exchange.repeatable,
        exchange.anyway,
        exchange.joins is not None,
        exchange.interpret is ack_only,
    )


def packet_of(found: SentPacket) -> Packet:
    """Make the packet that was sent."""
    return Packet(found.id, found.code, found.data)


def lateness_of(found: SentLateness) -> Lateness:
    """Make the lateness that was sent; families that are not known here are left out."""
    known = _framings()
    servos = frozenset((known[name], id) for name, id in found.servos if name in known)
    return Lateness(found.usual, servos, found.longest)


# The side of the process that owns the port


def step_of(found: SentStep) -> Step:
    """Make the step that was sent; the results of its exchanges are packets. Raises UsageError for one that is none."""
    if isinstance(found, SentExchange):
        return exchange_of(found)
    if isinstance(found, SentGroup):
        return _group_of(found)
    if isinstance(found, SentBatch):
        exchanges = [exchange_of(one) for one in found.exchanges]
        if any(one.framing is not exchanges[0].framing for one in exchanges):
            raise UsageError("a batch of several families: each is asked by itself")
        return Batch(exchanges, found.again, found.yields)
    if isinstance(found, SentPause):
        return Pause(_within("a pause", found.seconds, LONGEST_PAUSE))
    if isinstance(found, SentSettle):
        return Settle(_framing(found.family))
    return LateAnswers(_within("a wait", found.wait, LONGEST_PAUSE))


def exchanges_in(step: Step) -> tuple[Exchange[Any], ...]:
    """Give the requests that a step sends."""
    if isinstance(step, Exchange):
        return (step,)
    return tuple(step.exchanges) if isinstance(step, Batch) else ()


def exchange_of(found: SentExchange) -> Exchange[Packet]:
    """Make the exchange that was sent; its result is the packet. Raises UsageError for bytes that are no request."""
    framing = _framing(found.family)
    before, request = _request(found.what, framing, found.request)
    reply = found.reply
    if reply is not None:
        _check_reply(found.what, framing, reply)
    exchange = Exchange(
        found.what,
        framing,
        request,
        ack_packet if found.acks else _as_it_is,
        reply,
        None,
        _within(found.what, found.max_delay, LONGEST_DELAY),
        typical_delay=_within(found.what, found.typical_delay, LONGEST_DELAY),
        repeatable=found.repeatable,
        joins=_joins(found.family) if found.joins else None,
    )
    exchange.anyway = found.anyway
    return exchange.behind(before) if before else exchange


def outcome_of(came: Any) -> Outcome:
    """Give what is sent of the outcome of an exchange."""
    if isinstance(came, BusError):
        return fault(came)
    return SentPacket(came.id, came.code, came.data)


def _group_of(found: SentGroup) -> GroupExchange[Packet]:
    framing = _framing(found.family)
    before, request = _request(found.what, framing, found.request)
    parts = [exchange_of(part) for part in found.parts]
    if before or not parts or any(part.framing is not framing or part.reply is None for part in parts):
        raise UsageError(f"{found.what}: no group of requests that are answered, of one family")
    return GroupExchange(found.what, framing, request, parts)


def _as_it_is(packet: Packet) -> Packet:
    return packet


def _joins(name: str) -> Callable[[Sequence[Exchange[Any]]], GroupExchange[Any]] | None:
    family = registry.FAMILIES.entries.get(name)
    return None if family is None else family.joins


def _framings() -> dict[str, Framing]:
    """Give name -> framing, of all families and of the protocols that may be met on their lines."""
    families = registry.FAMILIES.values()
    met = [question.framing for family in families for question in family.strangers()]
    return {framing.name: framing for framing in [*met, *(family.framing for family in families)]}


def _framing(name: str) -> Framing:
    family = registry.FAMILIES.entries.get(name)
    framing = _framings().get(name) if family is None else family.framing
    if framing is None:
        raise UsageError(f"no family {name!r:.40} here: {', '.join(registry.FAMILIES)}")
    return framing


def _request(what: str, framing: Framing, data: bytes) -> tuple[bytes, bytes]:
    """Take a request apart: what goes before it, and its packet. What a request does is judged by that packet."""
    if len(data) > LONGEST_REQUEST:
        raise UsageError(f"{what}: {len(data)} bytes are no request")
    start = data.find(framing.header)
    packet = data[max(start, 0) :]
    if start < 0 or framing.whole(packet) is None:
        raise UsageError(f"{what}: {packet[:16].hex(' ').upper()} is no request of {framing.name}")
    return data[:start], packet


def _check_reply(what: str, framing: Framing, reply: ReplyPattern) -> None:
    if (
        not reply.sizes
        or not all(0 <= size <= framing.max_size for size in reply.sizes)
        or not (reply.id is None or 0 <= reply.id <= BROADCAST)
        or not (reply.code is None or 0 <= reply.code <= 255)
        or len(reply.prefix) > reply.sizes[0]
    ):
        raise UsageError(f"{what}: no reply looks like {reply}")


def _within(what: str, seconds: float, most: float) -> float:
    if not 0 <= seconds <= most:
        raise UsageError(f"{what}: {seconds:g} s are not within 0 .. {most:g} s")
    return seconds
