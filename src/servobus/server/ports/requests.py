"""The requests of a program that knows nothing of us: cut from its bytes, and made into exchanges.

A program of another make writes the packets of its family to a port and reads the answers there. What it writes is cut
by the framings of all families, for it need not say which one it speaks. HerkuleX and Dynamixel packets begin with the
same two bytes, so which of them it is only the whole packet tells: where its checksum is right for both, the family
counts that the program has spoken last.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import Any

from servobus.core.effect import Effect
from servobus.core.exchange import Exchange, GroupExchange, ReplyPattern
from servobus.core.framing import INCOMPLETE, NOT_A_FRAME, Framing, Packet
from servobus.core.ids import BROADCAST, LAST_ID
from servobus.core.values import frozen, replace
from servobus.families.base import Answers, Family
from servobus.families.change import policy_register

DEAF = 1.0
"""s for which no answer is awaited to what a servo leaves unanswered, before it is tried again. Assumption: who changes
what a servo answers does not mind such a while."""
ENOUGH = 2
"""Answers running that must be missing before none are awaited."""


@frozen
class Request:
    """One whole request: its packet, and the bytes that it came in."""

    family: Family
    packet: Packet
    raw: bytes


class RequestCutter:
    """Cuts whole requests from what one program writes, in any pieces.

    families  gives the families that the program may speak, the likeliest first
    garbage   bytes so far that were part of no request
    """

    def __init__(self, families: Callable[[], Iterable[Family]]) -> None:
        self._families = families
        self._buffer = bytearray()
        self._spoken: Family | None = None
        """The family of the last request."""
        self.garbage = 0

    @property
    def begun(self) -> bool:
        """Whether the beginning of a request waits for its rest."""
        return bool(self._buffer)

    def feed(self, data: bytes) -> list[Request]:
        """Take bytes in; give the requests that are whole now.

        A program writes a request in one piece: so one that begins with these bytes ends the wait for the rest of
        another.
        """
        families = self._in_order()
        if self._buffer and self._whole_at(data, 0, families)[0] is not None:
            self.drop()
        self._buffer += data
        found: list[Request] = []
        at = 0
        while at < len(self._buffer):
            request, incomplete = self._whole_at(self._buffer, at, families)
            if request is not None:
                found.append(request)
                self._spoken = request.family
                families = self._in_order()
                at += len(request.raw)
            elif incomplete:
                break
            else:
                at += 1
                self.garbage += 1
        del self._buffer[:at]
        return found

    def drop(self) -> None:
        """Give up what is not whole: its rest has not come for too long."""
        self.garbage += len(self._buffer)
        self._buffer.clear()

    def forget(self) -> None:
        """Begin anew: another program will write."""
        self.drop()
        self._spoken = None

    def _in_order(self) -> list[Family]:
        others = [family for family in self._families() if family is not self._spoken]
        return others if self._spoken is None else [self._spoken, *others]

    def _whole_at(self, buffer: bytes | bytearray, at: int, families: Sequence[Family]) -> tuple[Request | None, bool]:
        """Give the request that begins here, and whether one may begin here that is not whole yet."""
        whole: list[Request] = []
        incomplete = False
        for family in families:
            size = _size(family.framing, buffer, at)
            if size == INCOMPLETE or (size != NOT_A_FRAME and len(buffer) - at < size):
                incomplete = True
            elif size != NOT_A_FRAME:
                raw = bytes(buffer[at : at + size])
                packet, good = family.framing.unframe(raw)
                if good:
                    whole.append(Request(family, packet, raw))
        # Of two readings the one is right behind which nothing is left, or another packet begins.
        rest = [one for one in whole if self._fits_before(buffer, at + len(one.raw), families)]
        if rest or not incomplete:
            return next(iter(rest or whole), None), incomplete
        return None, True

    def _fits_before(self, buffer: bytes | bytearray, at: int, families: Sequence[Family]) -> bool:
        return at == len(buffer) or any(_size(family.framing, buffer, at) != NOT_A_FRAME for family in families)


def _size(framing: Framing, buffer: bytes | bytearray, at: int) -> int:
    """Tell the size of the packet that begins here, INCOMPLETE or NOT_A_FRAME."""
    header = framing.header
    begun = bytes(buffer[at : at + len(header)])
    if not header.startswith(begun):
        return NOT_A_FRAME
    return framing.size(buffer, at) if len(begun) == len(header) else INCOMPLETE


class AnswerHabits:
    """Which servos answer what sets something, as far as their answers and what is written to them tell.

    Whether a servo answers more than questions is a setting of its own. To wait for an answer that never comes would
    hold up the line for everybody.
    """

    def __init__(self) -> None:
        self._missed: dict[tuple[Family, int], int] = {}
        """How many answers running have not come."""
        self._deaf_until: dict[tuple[Family, int], float] = {}

    def expects(self, family: Family, id: int, known: Answers | None, now: float) -> bool:
        """Tell whether to wait for an answer that need not come; `known` is what the bus knows of the servo."""
        until = self._deaf_until.get((family, id))
        if until is None:
            return known is None or known is Answers.EVERYTHING
        return now >= until

    def note(self, family: Family, id: int, answered: bool, now: float) -> None:
        """Take note that an answer which need not come has come, or has not."""
        servo = family, id
        if answered:
            self._missed.pop(servo, None)
            self._deaf_until[servo] = now
            return
        missed = self._missed[servo] = self._missed.get(servo, 0) + 1
        if missed >= ENOUGH:
            self._deaf_until[servo] = now + DEAF

    def note_written(self, family: Family, effect: Effect, now: float) -> None:
        """Take note of a request that tells servos what to answer from now on."""
        for touch in effect.touches:
            for row, raw in touch.written.items():
                if row.owner is not None and row is policy_register(row.owner):
                    self._missed.pop((family, touch.id), None)
                    answers = raw >= Answers.EVERYTHING
                    self._deaf_until[family, touch.id] = now if answers else now + DEAF


def exchange_of(request: Request, *, reads: bool, awaited: bool) -> Exchange[Any]:
    """Make the exchange that carries a request out; its result is the packet that answers, or a list of such.

    reads    whether it only asks
    awaited  whether to wait for an answer that need not come

    It is sent once: to ask again is the program's business. Servos are given the time that their tables allow at most.
    """
    return _exchange(request.family, request.raw, reads, awaited)


@lru_cache(maxsize=1024)
def _exchange(family: Family, raw: bytes, reads: bool, awaited: bool) -> Exchange[Any]:
    packet, _ = family.framing.unframe(raw)
    replies = family.replies_to(packet)
    if replies is None:  # an instruction that nobody knows: a servo may say so, in the shape of an answer to a ping
        shapes = _ping(family, packet.id).replies if packet.id <= LAST_ID else ()
        replies = tuple(replace(reply, certain=False) for reply in shapes)
    replies = tuple(reply for reply in replies if reply.certain or awaited)
    if len(replies) > 1:  # what an adapter says in the name of all of them is not waited for
        replies = tuple(reply for reply in replies if reply.id is not None)
    what = f"{raw.hex(' ').upper()} to {'all' if packet.id == BROADCAST else f'id {packet.id}'}"
    if len(replies) > 1:
        parts = [_one(family, what, _ping(family, reply.id).request, reply, repeatable=False) for reply in replies]
        return GroupExchange(what, family.framing, raw, parts)
    return _one(family, what, raw, replies[0] if replies else None, repeatable=reads)


def _one(family: Family, what: str, raw: bytes, reply: ReplyPattern | None, *, repeatable: bool) -> Exchange[Packet]:
    like = _ping(family, None)  # all requests of a family are answered within the same time
    return Exchange(
        what, family.framing, raw, _itself, reply, like.alarms, like.max_delay,
        typical_delay=like.typical_delay, repeatable=repeatable,
    )  # fmt: skip


def _ping(family: Family, id: int | None) -> Exchange[None]:
    return family.ping(0 if id is None or id > LAST_ID else id)


def _itself(packet: Packet) -> Packet:
    return packet
