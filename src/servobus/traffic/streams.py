"""Packets out of pieces of a stream, each with its time; and the family they are of."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from servobus.core.framing import Corrupt, Decoder, Event, Noise, Packet
from servobus.families.base import Family
from servobus.families.registry import FAMILIES
from servobus.traffic.recording import Chunk, Direction


@dataclass(slots=True)
class Mark:
    """A piece of a stream: the positions of its bytes, when it came and when its first bit was on the wire."""

    start: int
    end: int
    time: float
    wire: float


class Stream:
    """Packets of one family in one direction, with the times of their bytes."""

    def __init__(self, family: Family, direction: Direction) -> None:
        self.family, self.direction = family, direction
        self.decoder = Decoder(family.framing)
        self.last = -math.inf
        self._marks: deque[Mark] = deque()
        self._told = 0

    def feed(self, chunk: Chunk, wire: float) -> list[tuple[int, bytes, Event]]:
        start = self.decoder.position
        self._marks.append(Mark(start, start + len(chunk.data), chunk.time, wire))
        self.last = chunk.time
        while self._marks[0].end < start - 2 * self.family.framing.max_size:
            self._marks.popleft()
        return self._placed(self.decoder.feed(chunk.data))

    def flush(self) -> list[tuple[int, bytes, Event]]:
        return self._placed(self.decoder.flush())

    def at(self, position: int) -> Mark:
        """Give the piece that a byte came in."""
        return next((mark for mark in self._marks if position < mark.end), self._marks[-1])

    def _placed(self, events: Sequence[Event]) -> list[tuple[int, bytes, Event]]:
        """Give each event with its start and its bytes."""
        placed = []
        for event in events:
            match event:
                case Noise(raw):
                    start = self._told  # noise is what lies between packets
                case Corrupt(packet, raw):
                    start = packet.end - len(raw)
                case Packet():
                    raw = self.family.framing.frame(event)
                    start = event.end - len(raw)
            self._told = max(self._told, start + len(raw))
            placed.append((start, raw, event))
        return placed


# Which family


def best_family(chunks: Sequence[Chunk]) -> Family | None:
    """Choose the family that finds most bytes of good packets; None if there are none."""
    scores = {family: _score(family, chunks) for family in FAMILIES.values()}
    family = max(scores, key=lambda one: scores[one])
    return family if scores[family] else None


def certain_family(chunks: Sequence[Chunk]) -> Family | None:
    """Choose as `best_family` does; None where two are as good."""
    first, second, *_ = sorted((_score(family, chunks) for family in FAMILIES.values()), reverse=True)
    return best_family(chunks) if first > second else None


def _score(family: Family, chunks: Sequence[Chunk]) -> int:
    streams = dict.fromkeys(Direction, b"")
    for chunk in chunks:
        streams[chunk.direction] += chunk.data
    return sum(good_bytes(family, data) for data in streams.values())


def good_bytes(family: Family, data: bytes) -> int:
    """Count the bytes that stand in good packets of a family."""
    overhead = family.framing.overhead
    return sum(overhead + len(event.data) for event in family.framing.decode(data) if isinstance(event, Packet))
