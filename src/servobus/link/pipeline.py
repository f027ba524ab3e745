"""Several questions under way at once: how far apart they must be, and when one at a time is better.

On one wire (Dynamixel, LewanSoul) a question goes out when the answer to the last is here, or must have left the
servo: an adapter that hands answers over late costs its delay once and not with each servo.

On two (HerkuleX) questions go out while answers come in. Answers are longer than questions and share one wire, so the
questions are kept apart by bytes that no servo takes for part of a packet; they space them to the bit, which no clock
of a computer could. Assumption: real servos skip such bytes before a header as the manual's packet format suggests.

Two answers stay apart as long as servos are equally slow to begin. Where one is slower than the next, theirs meet: both
are garbled. So behind each servo a gap is kept, which doubles when both answers beside it were garbled, or one of them
twice running, and shrinks while all goes well: fast as long as nothing ever happened, slowly afterwards. That the delay
of a servo changes little is an assumption. Where no gap helps, questions are asked one after the other for a while.
"""

import math
from collections.abc import Sequence
from typing import Any

from servobus.core.exchange import Batch, Exchange, Gathering
from servobus.core.ids import BROADCAST
from servobus.errors import BusError, DuplicateId, Garbled, NoReply, Refused
from servobus.link.link import BITS_PER_BYTE, SLOW, Link, Receive, Waits

APART = 0.002
"""s that questions on one wire keep from each other beyond an answer that did not come: assumption, USB adapters send
in frames of 1 ms, so that two requests can come closer by one."""
DEPTH = 32
"""Questions under way at once, at most."""
GAP = 100e-6
"""s behind each answer at first; assumption: servos of one model begin to answer equally late, within that."""
LEAST = 2
"""Bytes behind each answer at least; assumption."""
FAST, SLOWLY = 0.9, 0.9995
"""What a gap shrinks to with each clean salvo: before the first collision, and after it."""
LIMIT = 8
"""Garbled salvos after which questions are asked one after the other. So many times a gap doubles from LEAST to the
longest delay."""
CALM = 0.25
"""Garbled salvos that a clean one outweighs."""
ALONE, LONGEST = 200, 20_000
"""Questions that must then be answered one after the other before several are tried again: at first, and at most; twice
as many each time that it did not last."""


class PipelinedLink(Link):
    """A link that keeps several questions under way at once."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._gaps: dict[int, float] = {}
        """Id -> s that must pass behind its answer before the next begins."""
        self._collided: set[int] = set()
        """Ids whose answer has met the next one before."""
        self._suspected: set[int] = set()
        """Ids behind which one answer was garbled in the last salvo: the next one's, or noise."""
        self._trouble = 0.0
        self._alone = 0.0
        """Questions yet to be answered one after the other."""
        self._span = float(ALONE)

    def _batch(self, volley: Batch) -> Waits[list[Any]]:
        results: list[Any] = []
        rest = volley.exchanges
        while rest:
            count = self._together(rest)
            some, rest = rest[:count], rest[count:]
            if count == 1:
                result = yield from self._caught(some[0], again=volley.again)
                self._calm(result)
                results.append(result)
            else:
                results += yield from self._send_batch(some, again=volley.again)
        return results

    def _together(self, exchanges: Sequence[Exchange[Any]]) -> int:
        """Tell how many of these may be under way at once, from the first on: never two to one servo."""
        if self.echo is None or self._alone:
            return 1
        ids: set[int] = set()
        for exchange in exchanges[:DEPTH]:
            if (
                exchange.reply is None
                or exchange.id == BROADCAST
                or exchange.id in ids
                or exchange.framing is not exchanges[0].framing
                or self._late_replies.confusable(exchange)
            ):
                break
            ids.add(exchange.id)
        return max(len(ids), 1)

    def _send_batch(self, exchanges: Sequence[Exchange[Any]], *, again: bool) -> Waits[list[Any]]:
        """Send several questions without waiting for each answer; ask again singly what did not come through."""
        doubled: dict[int, BusError] = {}
        try:
            yield from self._ready(exchanges[0])
        except DuplicateId as error:
            doubled[0] = error
        except BusError as error:
            return [error for _ in exchanges]
        for n, exchange in enumerate(exchanges):
            if (found := self._doubled.pop(exchange.id, None)) is not None:
                doubled[n] = found
        gathering = Gathering(exchanges, echo=self.echo is True)
        try:
            # An echo of the bytes in between could not be told from noise.
            if exchanges[0].framing.filler and not self.echo:
                yield from self._stream(gathering)
            else:
                yield from self._space(gathering)
        finally:
            for n, exchange in enumerate(exchanges):
                if not gathering.answered(n):
                    self._missed(exchange)  # it may still come; even if who asked gave up
            if gathering.answered(len(exchanges) - 1):
                self._clear_at = 0.0  # what is answered has left
            self._review()
        results = gathering.results()
        self._count(gathering, results)
        self._learn(gathering, results)
        for n, twin in doubled.items():
            results[n] = twin
        self._unquiet = self._unquiet or gathering.noisy
        self._review()
        if again:
            for n, exchange in enumerate(exchanges):
                if exchange.repeatable and isinstance(results[n], BusError) and _unheard(results[n]):
                    self.stats[exchange.id].retries += 1
                    results[n] = yield from self._caught(exchange, again=True)
        return results

    def _stream(self, gathering: Gathering) -> Waits[None]:
        """Full duplex: one stream of questions, with bytes between them that keep the answers apart."""
        exchanges = gathering.exchanges
        byte_time = BITS_PER_BYTE / self.transport.baud
        data = bytearray()
        sizes = []
        free = 0.0  # bytes from the start until the next answer may begin, less the delay that all have
        for exchange in exchanges:
            data += exchange.framing.filler * math.ceil(free - len(data) - len(exchange.request))
            data += exchange.request
            sizes.append(len(data))
            gap = max(self._gaps.get(exchange.id, GAP) / byte_time, LEAST)
            free = len(data) + SLOW * exchange.reply_size + gap
            self.stats[exchange.id].sent += 1
        self.stats[exchanges[-1].id].sent -= 1
        self._send(exchanges[-1], bytes(data))
        begun = self._clear_at - len(data) * byte_time
        yield from self._gather(gathering, self._deadline, [begun + size * byte_time for size in sizes])

    def _space(self, gathering: Gathering) -> Waits[None]:
        """One wire: each question waits until the answer to the last is here, or must have left the servo."""
        byte_time = BITS_PER_BYTE / self.transport.baud
        left: list[float] = []
        for n, exchange in enumerate(gathering.exchanges):
            if n:
                last = gathering.exchanges[n - 1]
                answered = SLOW * (last.typical_delay + last.reply_size * byte_time)
                yield from self._gather(gathering, self._clear_at + answered + APART, left, wanted=n - 1)
                yield from self._until(self._clear_at)
            self._send(exchange, exchange.request)
            left.append(self._clear_at)
        yield from self._gather(gathering, self._deadline, left)

    def _gather(
        self, gathering: Gathering, until: float, left: Sequence[float], wanted: int | None = None
    ) -> Waits[None]:
        """Receive until this time, or until all answers are here, or the one that is wanted.

        `left` are the times at which the requests have left.
        """
        while not gathering.done and (seconds := until - self.transport.now()) > 0:
            if wanted is not None and gathering.answered(wanted):
                return
            for n, packet in gathering.feed((yield Receive(seconds))):
                self._accept(gathering.exchanges[n], packet, left[n])

    # What it teaches

    def _count(self, gathering: Gathering, results: Sequence[Any]) -> None:
        for stranger in gathering.strangers:
            self._stray(stranger)
        for exchange, result in zip(gathering.exchanges, results, strict=True):
            counts = self.stats[exchange.id]
            counts.timeouts += isinstance(result, NoReply)
            counts.doubled += isinstance(result, DuplicateId)
        self.stats[BROADCAST].checksum += gathering.corrupt  # whose answers they were nobody knows
        self.stats[BROADCAST].junk += gathering.junk

    def _learn(self, gathering: Gathering, results: Sequence[Any]) -> None:
        """Fit the gaps to what was garbled, and find out whether to ask one after the other."""
        exchanges = gathering.exchanges
        garbled = {n for n, result in enumerate(results) if _unheard(result)} if gathering.noisy else set()
        least = LEAST * BITS_PER_BYTE / self.transport.baud
        met: set[int] = set()
        suspected: set[int] = set()
        for n in garbled - {0}:
            before = exchanges[n - 1].id
            (met if n - 1 in garbled or before in self._suspected else suspected).add(before)
        for exchange in exchanges:
            gap = self._gaps.get(exchange.id, GAP)
            if exchange.id in met:
                gap = min(max(2 * gap, least), exchange.max_delay)
            else:
                gap = max(gap * (SLOWLY if exchange.id in self._collided else FAST), least)
            self._gaps[exchange.id] = gap
        self._suspected = suspected
        self._collided |= met
        if garbled:
            self._trouble += 1
        else:
            self._trouble = max(0.0, self._trouble - CALM)
            self._span = max(ALONE, 0.99 * self._span)
        if self._trouble >= LIMIT:
            self._alone, self._span = self._span, min(2 * self._span, LONGEST)

    def _calm(self, result: Any) -> None:
        """Count a question that was asked alone; begin anew with several when enough went well."""
        if not self._alone or isinstance(result, Garbled):
            return
        self._alone = max(0, self._alone - 1)
        if not self._alone:
            self._trouble = 0.0
            self._gaps.clear()
            self._collided.clear()


def _unheard(result: Any) -> bool:
    """Tell whether this is an error that says that no answer was understood."""
    return isinstance(result, BusError) and not isinstance(result, Refused | DuplicateId)
