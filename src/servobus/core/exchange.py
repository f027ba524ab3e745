"""A bus operation is a value.

An `Exchange` is one request and the replies that must come back; it holds bytes and functions, no port and no clock.
Jobs of several steps are generators of them (`Procedure`), so that the blocking and the asynchronous
driver carry out the same code:

    def read_twice(first, second):
        a = yield from first
        b = yield from second
        return a, b
"""

from collections.abc import Callable, Generator, Sequence
from typing import Any, Generic, Self, TypeAlias, TypeVar

from servobus.core.framing import Framing, Packet
from servobus.core.values import frozen, replace
from servobus.errors import BusError, Garbled, NoReply

T = TypeVar("T")
S = TypeVar("S")
U = TypeVar("U")


@frozen
class ReplyPattern:
    """What a packet must look like to be the reply.

    id       the servo that must answer; None takes any (a broadcast that one servo answers)
    code     the command byte it must carry; None takes any (Dynamixel: it is the error byte)
    sizes    data lengths in bytes that can be an answer. The first is the full one; others are refusals.
    prefix   bytes with which a full answer begins: what it repeats of the question
    certain  whether it comes whatever the servo is set to; else its Status Return Level or ACK Policy decides
    """

    id: int | None
    code: int | None
    sizes: tuple[int, ...]
    prefix: bytes = b""
    certain: bool = True

    def fits(self, packet: Packet) -> bool:
        data = packet.data
        return (
            (packet.id == self.id or self.id is None)
            and (self.code is None or packet.code == self.code)
            and (data.startswith(self.prefix) if len(data) == self.sizes[0] else len(data) in self.sizes)
        )

    def could_be(self, other: "ReplyPattern") -> bool:
        """Tell whether a full reply of the other pattern, if it came late, could be taken for this one."""
        return (
            (self.id == other.id or self.id is None or other.id is None)
            and (self.code == other.code or self.code is None or other.code is None)
            # An answer without data, as to a PING, could be a refusal of any read.
            and (self.prefix == other.prefix if self.sizes[0] == other.sizes[0] else other.sizes[0] in self.sizes)
        )

    def strict(self) -> "ReplyPattern":
        """Give the pattern of the full reply alone, without refusals."""
        return replace(self, sizes=self.sizes[:1])


class Exchange(Generic[T]):
    """One request and its reply, as a value that is never changed.

    what        for people: "RX-28 id 1: read present_position"
    interpret   turns a reply's packet into the result; raises Refused or WrongReply. Where nothing answers it
                is given an empty packet.
    replies     the pattern of the reply; none where the servo stays silent. A `GroupExchange` has several
    alarms      reads the alarm bits that stand beside the data in the packet
    max_delay   longest time in seconds between the request's last bit and the reply's first
    typical_delay  the time that it usually takes at most; the same, if not given
    repeatable  whether it may be sent again if no answer comes: what only asks, and what sets RAM to a value
    anyway      whether it is sent although the line is not quiet
    joins       makes one request of the first of several exchanges that have the same function here, as many as one
                packet holds; None if it is asked alone
    """

    __slots__ = (
        "alarms",
        "anyway",
        "framing",
        "id",
        "interpret",
        "joins",
        "max_delay",
        "repeatable",
        "replies",
        "reply",
        "reply_size",
        "request",
        "typical_delay",
        "what",
    )  # fmt: skip

    interpret: Callable[[Packet], Any]
    joins: "Callable[[Sequence[Exchange[Any]]], GroupExchange[Any]] | None"

    def __init__(
        self,
        what: str,
        framing: Framing,
        request: bytes,
        interpret: Callable[[Packet], T],
        reply: ReplyPattern | None = None,
        alarms: Callable[[Packet], int] | None = None,
        max_delay: float = 0.0,
        *,
        typical_delay: float | None = None,
        repeatable: bool = False,
        joins: "Callable[[Sequence[Exchange[T]]], GroupExchange[T]] | None" = None,
    ) -> None:
        self.what, self.framing, self.request, self.interpret = what, framing, request, interpret
        self.alarms, self.max_delay, self.repeatable, self.anyway = alarms, max_delay, repeatable, False
        self.joins = joins
        self.typical_delay = max_delay if typical_delay is None else typical_delay
        self.id = framing.unframe(request)[0].id
        """The id in the request: the servo that is asked, or the broadcast id."""
        self.reply = reply
        """The pattern of the reply; None where the servo stays silent, and of a `GroupExchange`."""
        self._expect(() if reply is None else (reply,))

    def _expect(self, replies: tuple[ReplyPattern, ...]) -> None:
        self.replies = replies
        self.reply_size = sum(self.framing.overhead + max(reply.sizes) for reply in replies)
        """Bytes on the wire that the replies have at most, together."""

    def __repr__(self) -> str:
        return f"<{self.what}>"

    def __iter__(self) -> "Procedure[T]":
        """Be a procedure of one step, so that `value = yield from exchange` reads as it does for procedures."""
        result: T = yield self
        return result

    def mapped(self, interpret: Callable[[Packet], S]) -> "Exchange[S]":
        """Make the same question with another way to read the answer."""
        return self._changed(interpret=interpret)  # type: ignore[return-value] # it is now of that type

    def no_retry(self) -> Self:
        """Make the same question, never to be asked again."""
        return self._changed(repeatable=False)

    def told(self) -> "Exchange[None]":
        """Make the same request, to be sent at once whatever is on the line, and without a wait for an answer."""
        nothing: Any = {"replies": (), "reply": None, "reply_size": 0}
        return self._changed(interpret=ack_only, repeatable=True, anyway=True, **nothing)  # type: ignore[return-value] # as above

    def behind(self, bytes_: bytes) -> Self:
        """Make the same request with bytes before it that are no part of a packet."""
        return self._changed(request=bytes_ + self.request)

    def strict(self) -> "Exchange[None]":
        """Make the same question, to which only a full reply counts, and that it came: a fence."""
        replies = tuple(reply.strict() for reply in self.replies)
        reply = None if self.reply is None else self.reply.strict()
        return self._changed(interpret=ack_only, replies=replies, reply=reply)  # type: ignore[return-value] # as above

    def interpreter(self, reply: ReplyPattern) -> Callable[[Packet], Any]:  # noqa: ARG002 - there is one at most
        """Give what turns the packet that is this reply into the result."""
        return self.interpret

    def looks_like_its_reply(self) -> bool:
        """Tell whether the request could be taken for its own answer, so that an echo would be one.

        It is so of a Dynamixel PING: it looks like a status packet with a voltage error.
        """
        packet, _ = self.framing.unframe(self.request)
        return any(reply.fits(packet) for reply in self.replies)

    def _changed(self, **changes: Any) -> Self:
        copy = object.__new__(type(self))
        for name in Exchange.__slots__:
            setattr(copy, name, changes[name] if name in changes else getattr(self, name))
        return copy


class GroupExchange(Exchange[list[S | BusError]], Generic[S]):
    """One request that several servos answer, one behind the other: bulk read, sync read.

    Its result is a list: for each of its parts the result, or the BusError that came of it. A reply that is lost costs
    itself alone. Errors of the line as a whole are raised: LineBusy, BrokenEcho.

    A servo begins to answer when the one before has answered. So after a silence longer than any of them may take, none
    of those that are left answers any more; they had no turn, and their parts are asked.

    parts  what asks each of the servos alone, and is answered in the same way, in the order in which they answer
    """

    __slots__ = ("parts",)

    def __init__(self, what: str, framing: Framing, request: bytes, parts: Sequence[Exchange[S]]) -> None:
        first, *_ = parts
        super().__init__(
            what, framing, request, first.interpret, None, first.alarms,
            max(part.max_delay for part in parts),
            typical_delay=max(part.typical_delay for part in parts),
            repeatable=all(part.repeatable for part in parts),
        )  # fmt: skip
        self.parts = tuple(parts)
        self._expect(tuple(reply for part in parts for reply in part.replies))

    def mapped(self, interpret: Callable[[Packet], U]) -> "GroupExchange[U]":  # type: ignore[override] # a list of these
        """Make the same question with another way to read each reply."""
        return self._changed(parts=tuple(part.mapped(interpret) for part in self.parts))  # type: ignore[return-value] # it is now of that type

    def interpreter(self, reply: ReplyPattern) -> Callable[[Packet], Any]:
        """Give what turns the packet that is this reply into the result of its part."""
        return self.parts[self.replies.index(reply)].interpret

    def silent(self, outcomes: Sequence[Any]) -> list[int]:
        """Give the numbers of the parts at the end that nobody answered."""
        answered = [n for n, outcome in enumerate(outcomes) if not isinstance(outcome, NoReply | Garbled)]
        return list(range(max(answered, default=-1) + 1, len(self.parts)))

    def turnless(self, outcomes: Sequence[Any]) -> list[int]:
        """Give the numbers of the parts that had no turn: all behind the first that is silent, or all if none spoke."""
        silent = self.silent(outcomes)
        return silent if len(silent) == len(self.parts) else silent[1:]

    def _changed(self, **changes: Any) -> Self:
        copy = super()._changed(**changes)
        copy.parts = changes.get("parts", self.parts)
        return copy


def joined(exchanges: Sequence[Exchange[Any]]) -> list[GroupExchange[Any]]:
    """Make groups, of two and more, of those that can be joined; what is in none is asked alone.

    No two of them may be for one servo.
    """
    alike: dict[Callable[..., GroupExchange[Any]], list[Exchange[Any]]] = {}
    for exchange in exchanges:
        if exchange.joins is not None:
            alike.setdefault(exchange.joins, []).append(exchange)
    groups = []
    for joins, some in alike.items():
        rest = some
        while len(rest) > 1:
            groups.append(joins(rest))
            rest = rest[len(groups[-1].parts) :]
    return groups


@frozen
class SetBaud:
    """Step of a procedure: talk at this speed from here on, to the end of the job or the next such step.

    The result tells whether the speed on the wire is set elsewhere, so that all speeds are the same here.
    """

    baud: int


@frozen
class Pause:
    """Step of a procedure: let this many seconds pass. `shared` lets others use the line meanwhile."""

    seconds: float
    shared: bool = False


@frozen
class Settle:
    """Step of a procedure: have servos of this kind be done with what they heard that was meant for another family.

    What is sent to them ends that by itself. To end it before the line falls quiet spares them an alarm.
    """

    framing: Framing


class Now:
    """Step of a procedure: `now = yield Now()` gives the time of the port's clock, in seconds.

    Only differences of two such times mean something: the clock may be virtual.
    """

    __slots__ = ()


@frozen
class Lateness:
    """How late answers come on a port.

    usual   s by which they usually come later than their bits allow
    servos  the servos, as (framing, id), that have answered after they were given up
    longest s by which the latest of those since the last such step came later than its bits and its servo allow
    """

    usual: float
    servos: frozenset[tuple[Framing, int]]
    longest: float


@frozen
class LateAnswers:
    """Step of a procedure: give the `Lateness` of this port, with the servos that came late since the last such step.

    As long as nothing has been heard on the port, it listens for late answers first, for `wait` s; later on the link
    knows how long they take, and has waited already.
    """

    wait: float = 0.0


@frozen
class Batch:
    """Step of a procedure: several questions of one family, each sent before the answer to the last is in.

    They keep so far apart that no two answers, or on one wire a question and an answer, can meet. Those that can be
    joined go out as one request. The step gives a list: for each exchange its result, or the BusError that came of it.

    again   whether what did not come through is asked again, if it is repeatable
    yields  whether it ends early where another job waits for the line: then the list is shorter, and the exchanges
            without an outcome were not sent. None are joined then
    """

    exchanges: Sequence[Exchange[Any]]
    again: bool = True
    yields: bool = False


Step: TypeAlias = Exchange[Any] | SetBaud | Pause | Settle | Now | LateAnswers | Batch
Procedure: TypeAlias = Generator[Step, Any, T]
Job: TypeAlias = Exchange[T] | Procedure[T]


def told(job: Procedure[Any]) -> Procedure[None]:
    """Send what a job sends at once, whatever is on the line. Nothing is waited for, so the job must not ask."""
    for step in job:
        yield step.told() if isinstance(step, Exchange) else step


def ack_only(_: Packet) -> None:
    """Interpret a reply that only says that the request arrived."""


def ack_packet(packet: Packet) -> Packet:
    """Hand on a reply that only says that the request arrived, to where it is interpreted."""
    return packet
