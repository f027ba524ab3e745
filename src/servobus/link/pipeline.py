"""How many questions may be under way at once, and how far apart they must be.

On one wire (Dynamixel, LewanSoul) a question goes out when the reply to the last is here, or must have left the
servo: an adapter that hands replies over late costs its delay once and not with each servo. Where replies are garbled
because a servo took longer, the next question waits longer for it, as the gaps below tell.

On two wires (HerkuleX) questions go out while replies come in. Replies are longer than questions and share one wire,
so the questions are kept apart by filler bytes, which no servo takes for part of a packet; they space the questions to
the bit, which no clock of a computer could. Assumption: real servos skip such bytes before a header as the manual's
packet format suggests.

Two replies stay apart as long as their servos are equally slow to begin. Where a servo is slower than the next, the two
replies meet and both are garbled. So a gap is kept behind each servo. It doubles when both replies beside it were
garbled, or one of them twice running, and shrinks while all goes well: fast as long as the servo's reply never met
another, slowly afterwards. That the delay of a servo changes little is an assumption. Where no gap helps, questions are
asked one after the other for a while.

The pipeline only counts and learns: no port, no clock. The link sends.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from servobus.core.exchange import Exchange
from servobus.core.framing import Framing
from servobus.core.ids import BROADCAST
from servobus.errors import BusError, DuplicateId, Garbled, Refused

APART = 0.002
"""s that questions on one wire keep from each other beyond a reply that did not come, at least: assumption, USB
adapters send in frames of 1 ms, so that two requests can come closer by one."""
APART_AT_MOST = 0.032
"""The same where replies met: assumption, a servo that is slower still answers better when asked alone."""
DEPTH = 32
"""Questions under way at once, at most."""
GAP = 100e-6
"""s behind each reply at first; assumption: servos of one model begin to answer equally late, within that."""
LEAST = 2
"""Bytes behind each reply at least; assumption."""
FAST, SLOWLY = 0.9, 0.9995
"""What a gap shrinks to with each clean batch: before the first collision, and after it."""
LIMIT = 8
"""Garbled batches after which questions are asked one after the other. So many times a gap doubles from LEAST to the
longest delay."""
CALM = 0.25
"""Garbled batches that a clean one outweighs."""
ALONE, LONGEST = 200, 20_000
"""Questions that must then be answered one after the other before several are tried again: at first, and at most; twice
as many each time that it did not last."""

Servo: TypeAlias = tuple[Framing, int]
"""Whose reply it is: two families may share a line, and the same id is then two servos."""


class Pipeline:
    """What a line has taught about questions that are under way together.

    alone    questions yet to be answered one after the other before several are tried again; 0 if several may go
    settled  whether batches that go well teach nothing more: no gap is wider than it must be, no trouble still counts
    """

    def __init__(self) -> None:
        self._gaps: dict[Servo, float] = {}
        """Servo -> s that must pass behind its reply before the next begins."""
        self._collided: set[Servo] = set()
        """Servos whose reply has met the next one before."""
        self._suspected: set[Servo] = set()
        """Servos behind which one reply was garbled in the last batch: by their own reply, or by noise."""
        self._trouble = 0.0
        self.alone = 0.0
        self.settled = True
        self._span = float(ALONE)

    def together(self, exchanges: Sequence[Exchange[Any]], doubtful: Callable[[Exchange[Any]], bool]) -> int:
        """Tell how many of these may be under way at once, from the first on: never two to one servo.

        DEPTH bounds those that cannot be joined. A `doubtful` question, for whose reply a late one could be taken,
        needs a fence before it, and so goes alone.
        """
        if self.alone:
            return 1
        ids: set[int] = set()
        separate = 0
        for exchange in exchanges:
            separate += exchange.joins is None
            if (
                separate > DEPTH
                or exchange.reply is None
                or exchange.id == BROADCAST
                or exchange.id in ids
                or exchange.framing is not exchanges[0].framing
                or doubtful(exchange)
            ):
                break
            ids.add(exchange.id)
        return max(len(ids), 1)

    def stream(self, exchanges: Sequence[Exchange[Any]], byte_time: float) -> tuple[bytes, list[int]]:
        """Put requests into one stream, with fillers between them that keep the replies apart.

        Gives the bytes, and for each request how many of them there are up to its end.
        """
        data = bytearray()
        ends = []
        free = 0.0  # bytes from the start until the next reply may begin, less the delay that all have
        for exchange in exchanges:
            framing = exchange.framing
            data += framing.filler * math.ceil(free - len(data) - len(exchange.request))
            data += exchange.request
            ends.append(len(data))
            gap = max(self._gaps.get((framing, exchange.id), GAP) / byte_time, LEAST)
            free = len(data) + (1 + framing.baud_tolerance) * exchange.reply_size + gap
        return bytes(data), ends

    def answered_within(self, exchange: Exchange[Any], byte_time: float) -> float:
        """Give the s after which the reply to a request that has left is no longer on the wire."""
        size = exchange.reply_size * byte_time
        gap = max(self._gaps.get((exchange.framing, exchange.id), APART), APART)
        return (1 + exchange.framing.baud_tolerance) * (exchange.typical_delay + size) + gap

    def learn(
        self, exchanges: Sequence[Exchange[Any]], outcomes: Sequence[Any], byte_time: float, *, noisy: bool
    ) -> None:
        """Fit the gaps to what was garbled, and find out whether to ask one after the other."""
        garbled = {n for n, outcome in enumerate(outcomes) if is_lost(outcome)} if noisy else set()
        servos = [(exchange.framing, exchange.id) for exchange in exchanges]
        met: set[Servo] = set()
        suspected: set[Servo] = set()
        narrow = True
        for n in garbled - {0}:
            before = servos[n - 1]
            collided = n - 1 in garbled or before in self._suspected
            (met if collided else suspected).add(before)
        for exchange, servo in zip(exchanges, servos, strict=True):
            two_wires = bool(exchange.framing.filler)
            least, most = (LEAST * byte_time, exchange.max_delay) if two_wires else (APART, APART_AT_MOST)
            gap = self._gaps.get(servo, GAP)
            if servo in met:
                self._gaps[servo] = min(max(2 * gap, least), most)
            else:
                self._gaps[servo] = max(gap * (SLOWLY if servo in self._collided else FAST), least)
            narrow = narrow and self._gaps[servo] <= least
        self._suspected = suspected
        self._collided |= met
        self._weigh(garbled=bool(garbled))
        self.settled = narrow and not (suspected or self._trouble)

    def learn_alone(self, outcome: Any) -> None:
        """Count a question that was asked alone; begin anew with several when enough went well."""
        if not self.alone or isinstance(outcome, Garbled):
            return
        self.alone = max(0, self.alone - 1)
        if not self.alone:
            self._trouble = 0.0
            self._gaps.clear()
            self._collided.clear()

    def _weigh(self, *, garbled: bool) -> None:
        """Count garbled batches against clean ones."""
        if garbled:
            self._trouble += 1
        else:
            self._trouble = max(0.0, self._trouble - CALM)
            self._span = max(ALONE, 0.99 * self._span)
        if self._trouble >= LIMIT:
            self.alone, self._span = self._span, min(2 * self._span, LONGEST)


def is_lost(outcome: Any) -> bool:
    """Tell whether this is an error that says that no reply was understood."""
    return isinstance(outcome, BusError) and not isinstance(outcome, Refused | DuplicateId)
