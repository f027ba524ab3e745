"""What a port carries, as values; a transport that tells them of another one, and one that plays them back.

    recorded = []
    with Bus(TapTransport(transport("/dev/ttyUSB0"), recorded.append)) as bus:
        ...
    Bus(ReplayTransport(recorded)) answers the same requests with the same bytes after the same time

The file format for these values is servobus.traffic.recording.
"""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeAlias

from servobus.errors import UsageError
from servobus.transports.base import Transport

DIGITS = 6
"""Decimals of a time: microseconds."""
FIRST_BAUD = 115_200


class Direction(StrEnum):
    """Where bytes went."""

    OUT = ">"
    IN = "<"
    UNKNOWN = "-"


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes that came together; `time` in s. It is kept to the microsecond, so that a recording has the same."""

    time: float
    direction: Direction
    data: bytes

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", round(self.time, DIGITS))


@dataclass(frozen=True, slots=True)
class Speed:
    """The line's speed from here on, bit/s."""

    time: float
    baud: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", round(self.time, DIGITS))


@dataclass(frozen=True, slots=True)
class TapEnd:
    """Nothing more came until this time, and then the line was watched no longer."""

    time: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", round(self.time, DIGITS))


Entry: TypeAlias = Chunk | Speed | TapEnd


class _Inner:
    """An attribute that a tap has from the transport behind it; setting it sets it there."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, tap: "TapTransport | None", owner: type) -> Any:
        return self if tap is None else getattr(tap.inner, self._name)

    def __set__(self, tap: "TapTransport", value: object) -> None:
        setattr(tap.inner, self._name, value)


class TapTransport(Transport):
    """A transport that passes everything on to `inner`, and tells `told` what was written, read and set.

    Times are s since the tap was made, on the clock of `inner`: of bytes sent when they were handed over, of bytes
    received when they were read. `heard` is the direction of what is read: UNKNOWN for a tap that only listens.
    `told` is called in the thread that reads or writes, so it should be quick; what it raises ends the read or write.
    """

    name: Any = _Inner()
    baud: Any = _Inner()
    has_speed: Any = _Inner()
    latency: Any = _Inner()
    timed: Any = _Inner()
    lasting_name: Any = _Inner()

    def __init__(self, inner: Transport, told: Callable[[Entry], object], *, heard: Direction = Direction.IN) -> None:
        self.inner = inner
        self._told = told
        self._heard = heard
        self._began = inner.now()

    def elapsed(self) -> float:
        """Give the s since the tap was made: the time of an entry made now."""
        return self.inner.now() - self._began

    def write(self, data: bytes) -> None:
        time = self.elapsed()
        self.inner.write(data)
        if data:
            self._told(Chunk(time, Direction.OUT, bytes(data)))

    def read(self, timeout: float) -> bytes:
        return self._hear(self.inner.read(timeout))

    def discard(self) -> bytes:
        return self._hear(self.inner.discard())

    def set_baud(self, baud: int) -> None:
        old = self.inner.baud
        self.inner.set_baud(baud)
        if self.inner.baud != old:
            self._told(Speed(self.elapsed(), self.inner.baud))

    def close(self) -> None:
        self.inner.close()

    def reopen(self) -> None:
        self.inner.reopen()

    def pending(self) -> bool:
        return self.inner.pending()

    def fileno(self) -> int | None:
        return self.inner.fileno()

    def blocking(self) -> bool:
        return self.inner.blocking()

    def now(self) -> float:
        return self.inner.now()

    def sleep(self, seconds: float) -> None:
        self.inner.sleep(seconds)

    def __getattr__(self, name: str) -> Any:
        # What only some transports have, such as `adapter` or `servos`, is reached through the tap as well.
        if name == "inner":  # not set yet: looking for it there would never end
            raise AttributeError(name)
        return getattr(self.inner, name)

    def _hear(self, data: bytes) -> bytes:
        if data:
            self._told(Chunk(self.elapsed(), self._heard, data))
        return data


class ReplayTransport(Transport):
    """A transport that plays back what another one carried. Its clock starts at 0 and runs only while it is waited on.

    What is written must be what was written then, byte for byte, in pieces of any size; else `write` raises
    UsageError. What was received then comes as long after the bytes sent before it as it came then. Bytes of unknown
    direction count as received.
    """

    def __init__(self, entries: Iterable[Entry], name: str = "replay", baud: int = FIRST_BAUD) -> None:
        self.name, self.baud = name, baud
        self._entries = deque(entry for entry in entries if isinstance(entry, Chunk))
        self._now = 0.0
        self._behind = 0.0
        """s that the replay is behind the recording."""
        self._expected = b""
        """What is still to be written of the piece that is being written."""
        self._arriving: deque[tuple[float, bytes]] = deque()
        self._take_answers()

    @property
    def finished(self) -> bool:
        """Whether all was written and read that the recording holds."""
        return not (self._entries or self._expected or self._arriving)

    def write(self, data: bytes) -> None:
        left = bytes(data)
        while left:
            if not self._expected:
                self._take_answers()
                if not self._entries:
                    raise UsageError(f"{self.name}: {_hex(left)} was written, but the recording has no more requests")
                chunk = self._entries.popleft()
                self._expected, self._behind = chunk.data, self._now - chunk.time
            size = min(len(left), len(self._expected))
            if left[:size] != self._expected[:size]:
                raise UsageError(
                    f"{self.name}: {_hex(left)} was written where the recording has {_hex(self._expected)}"
                )
            left, self._expected = left[size:], self._expected[size:]
        if not self._expected:
            self._take_answers()

    def read(self, timeout: float) -> bytes:
        until = self._now + max(timeout, 0.0)
        if self._arriving and self._arriving[0][0] <= until:
            due, data = self._arriving.popleft()
            self._now = max(self._now, due)
            return data
        self._now = until
        return b""

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    def close(self) -> None:
        pass

    def blocking(self) -> bool:
        return False

    def now(self) -> float:
        return self._now

    def sleep(self, seconds: float) -> None:
        self._now += max(seconds, 0.0)

    def _take_answers(self) -> None:
        """Let arrive what was received before the next bytes were sent."""
        while self._entries and self._entries[0].direction is not Direction.OUT:
            chunk = self._entries.popleft()
            self._arriving.append((max(chunk.time + self._behind, self._now), chunk.data))


def _hex(data: bytes) -> str:
    return data.hex(" ").upper()
