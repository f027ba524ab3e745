"""The events on a line, and what is counted of them.

request     a packet to servos
answer      a packet of a servo, with the question that it answers where there is one
probe       a byte that servos skip, sent to find out whether the adapter echoes
padding     bytes that servos skip, sent to keep requests apart
other       a packet of another family than the one that is looked for
echo        what was sent, given back by the adapter
corrupt     bytes of the right shape whose checksum is wrong, or an answer that ends too soon
noise       bytes that are no packet
silence     the end of the wait for an answer
speed       the line's speed changed
"""

from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum

from servobus.core.ids import BROADCAST
from servobus.families.base import Family
from servobus.traffic.recording import Direction

GRAIN = 1e-5
"""s; latencies are counted in steps of this."""


UNASKED = "NOBODY ASKED for this: "
"""Stands before the words of an answer without a question."""


class EventKind(StrEnum):
    REQUEST = "request"
    ANSWER = "answer"
    PROBE = "probe"
    PADDING = "padding"
    OTHER = "other"
    ECHO = "echo"
    CORRUPT = "corrupt"
    NOISE = "noise"
    SILENCE = "silence"
    SPEED = "speed"


class Trouble(StrEnum):
    CHECKSUM = "bad checksum"
    CUT = "cut short"
    JUNK = "junk"
    SILENT = "no answer"
    LATE = "late answer"
    STRANGER = "answer of a stranger"
    MISFIT = "answer that does not fit"
    UNASKED = "answer without a question"


@dataclass(frozen=True, slots=True)
class TrafficEvent:
    """One event on the line.

    time     s: when its first byte was carried or heard; of a silence, when the wait was over
    id       of the servo that it is to or from, as far as that is known
    latency  s between the end of the request and the first bytes of this answer, as this computer saw them; None
             where that cannot be told
    """

    time: float
    direction: Direction
    kind: EventKind
    text: str
    family: Family | None = None
    id: int | None = None
    raw: bytes = b""
    latency: float | None = None
    trouble: Trouble | None = None


@dataclass(slots=True)
class ServoTraffic:
    """What one servo did; id 254 stands for requests to all."""

    family: Family
    id: int
    requests: int = 0
    answers: int = 0
    answered: int = 0
    """Questions to this servo that were answered."""
    failed: int = 0
    """Questions to this servo that were not, or not well."""
    missing: int = 0
    corrupt: int = 0
    other: int = 0
    """Answers that were late, did not fit, or belong to no question."""
    latencies: Counter[int] = field(default_factory=Counter)

    @property
    def broadcast(self) -> bool:
        return self.id == BROADCAST

    @property
    def median(self) -> float | None:
        """Median of the latencies, s."""
        half = self.latencies.total() / 2
        for step in sorted(self.latencies):
            half -= self.latencies[step]
            if half <= 0:
                return step * GRAIN
        return None

    @property
    def worst(self) -> float | None:
        """Highest latency, s."""
        return max(self.latencies) * GRAIN if self.latencies else None

    @property
    def error_rate(self) -> float | None:
        """Share of the questions that got no good answer; None if nothing was asked."""
        asked = self.answered + self.failed
        return self.failed / asked if asked else None
