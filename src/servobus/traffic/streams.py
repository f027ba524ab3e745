"""Packets of all families out of one stream of bytes, each with its time.

Families that share a line share its bytes, and the header of one may be that of another: Dynamixel and HerkuleX packets
both begin with FF FF. So each place is read as every family would. A packet whose checksum fits is taken before all
else; what is left over is then read as damaged packets, of the family that is likeliest there, and the rest is noise.
"""

import math
import re
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from servobus.core.framing import INCOMPLETE, NOT_A_FRAME, Corrupt, Event, Noise, Packet
from servobus.families.base import Family
from servobus.traffic.recording import Chunk, Direction

PADDING = b"\0"
"""What drivers send between packets, since no packet begins with it: probes and fillers of all families."""


@dataclass(slots=True)
class Mark:
    """A chunk of a stream: the positions of its bytes, when it came and when its first bit was on the wire."""

    start: int
    end: int
    time: float
    wire: float


@dataclass(frozen=True, slots=True)
class Piece:
    """What a few bytes of a stream are. `family` is None for noise; `start` is the position of the first byte."""

    family: Family | None
    start: int
    raw: bytes
    event: Event


class Stream:
    """Packets of all families in one direction, with the times of their bytes. No byte is in two of its pieces.

    preferred  gives the families that are likeliest now, the likeliest first: they decide between readings that are as
               good as each other
    """

    def __init__(
        self, families: Sequence[Family], direction: Direction, preferred: Callable[[], Sequence[Family]]
    ) -> None:
        self.direction = direction
        self.last = -math.inf
        """s: when the last bytes came."""
        self._families, self._preferred = families, preferred
        self._headers = tuple(dict.fromkeys(family.framing.header for family in families))
        # One search for all of them ends at the first; one for each would go to the end for those that never come.
        self._header = re.compile(b"|".join(map(re.escape, self._headers)))
        self._longest = max(family.framing.max_size for family in families)
        self._marks: deque[Mark] = deque()
        self._buffer = bytearray()
        self._base = 0
        """Position of the first byte in the buffer."""
        self._looked = 0
        """Bytes of the buffer at which no good packet begins."""

    @property
    def pending(self) -> int:
        """Bytes kept because they may still become a packet, or noise goes on."""
        return len(self._buffer)

    @property
    def begun(self) -> bytes:
        """What is kept because it may still become a packet."""
        return bytes(self._buffer[self._looked :])

    def feed(self, chunk: Chunk, wire: float) -> list[Piece]:
        """Take the next bytes in and give what is complete now."""
        start = self._base + len(self._buffer)
        self._marks.append(Mark(start, start + len(chunk.data), chunk.time, wire))
        self.last = chunk.time
        while self._marks[0].end < self._base - 2 * self._longest:
            self._marks.popleft()
        self._buffer += chunk.data
        return self._cut(ended=False)

    def flush(self) -> list[Piece]:
        """Say that the line went quiet: what is incomplete stays so."""
        return self._cut(ended=True)

    def at(self, position: int) -> Mark:
        """Give the chunk that a byte came in."""
        return next((mark for mark in self._marks if position < mark.end), self._marks[-1])

    def _cut(self, *, ended: bool) -> list[Piece]:
        pieces: list[Piece] = []
        while (at := self._next_header(self._looked, ended=ended)) is not None:
            self._looked = at
            found, waits = self._packet_at(at)
            if found is not None:
                family, packet, raw = found
                pieces += self._left_over(ended=True)
                packet.end = self._base + len(raw)
                pieces.append(Piece(family, self._base, raw, packet))
                self._drop(len(raw))
            elif waits and not ended:
                break
            else:
                self._looked = at + 1
        # What padding belongs to tells what comes behind it.
        whole = self._looked == len(self._buffer) and bool(self._buffer.strip(PADDING))
        return pieces + self._left_over(ended=ended or whole)

    def _next_header(self, start: int, *, ended: bool) -> int | None:
        """Find where a packet may begin; None, with all looked at, if there is no such place."""
        buffer = self._buffer
        if found := self._header.search(buffer, start):
            return found.start()
        half = not ended and buffer and any(buffer[-1] == header[0] for header in self._headers)
        self._looked = max(start, len(buffer) - 1) if half else len(buffer)
        return None

    def _packet_at(self, at: int) -> tuple[tuple[Family, Packet, bytes] | None, bool]:
        """Give the good packet that begins here, if there is one, and tell whether more bytes may make one."""
        good: dict[Family, tuple[Family, Packet, bytes]] = {}
        waits = False
        for family in self._families:
            framing = family.framing
            if not self._buffer.startswith(framing.header, at):
                continue
            size = framing.size(self._buffer, at)
            if size == NOT_A_FRAME:
                continue
            if size == INCOMPLETE or len(self._buffer) - at < size:
                waits = True
                continue
            raw = bytes(self._buffer[at : at + size])
            packet, fits = framing.unframe(raw)
            if fits:
                good[family] = family, packet, raw
        if len(good) > 1:
            likeliest = next((family for family in self._preferred() if family in good), None)
            if likeliest is not None:
                return good[likeliest], waits
        return next(iter(good.values()), None), waits

    def _left_over(self, *, ended: bool) -> list[Piece]:
        """Read what was looked at and is no good packet: damaged packets, and noise. That goes on, unless it ended."""
        pieces: list[Piece] = []
        start = at = 0
        while (next_at := self._next_left(at)) is not None:
            at = next_at
            damaged = self._damaged_at(at)
            if damaged is None:
                at += 1
                continue
            if start < at:
                pieces.append(self._noise(start, at))
            family, corrupt = damaged
            at += len(corrupt.raw)
            pieces.append(Piece(family, self._base + at - len(corrupt.raw), corrupt.raw, corrupt))
            start = at
        if ended and start < self._looked:
            pieces.append(self._noise(start, self._looked))
            start = self._looked
        self._drop(start)
        return pieces

    def _next_left(self, start: int) -> int | None:
        found = self._header.search(self._buffer, start, self._looked)
        return None if found is None else found.start()

    def _damaged_at(self, at: int) -> tuple[Family, Corrupt] | None:
        """Give the damaged packet that begins here and ends before the next good one, in its likeliest reading."""
        for family in dict.fromkeys((*self._preferred(), *self._families)):
            framing = family.framing
            if not self._buffer.startswith(framing.header, at):
                continue
            size = framing.size(self._buffer, at)
            if size > 0 and at + size <= self._looked:
                raw = bytes(self._buffer[at : at + size])
                packet, _ = framing.unframe(raw)
                packet.end = self._base + at + size
                return family, Corrupt(packet, raw)
        return None

    def _noise(self, start: int, end: int) -> Piece:
        raw = bytes(self._buffer[start:end])
        return Piece(None, self._base + start, raw, Noise(raw))

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self._base += count
        self._looked = max(self._looked - count, 0)


def good_bytes(data: bytes, families: Sequence[Family]) -> int:
    """Count the bytes that stand in good packets."""
    stream = Stream(families, Direction.UNKNOWN, tuple)
    pieces = stream.feed(Chunk(0.0, Direction.UNKNOWN, data), 0.0) + stream.flush()
    return sum(len(piece.raw) for piece in pieces if isinstance(piece.event, Packet))
