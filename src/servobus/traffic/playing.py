"""A recording played into a port: the same requests at the same times, and what is answered now beside what was then.

It is meant for virtual servos: what a real arm met is met again on a desk. Time is that of the port's clock, so a
virtual clock plays an hour in seconds.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from servobus.traffic.recording import Chunk, Direction, Entry, Speed, TapEnd
from servobus.transports.base import Transport

LAST = 0.1
"""s that the answer to the last request of a recording without an end is waited for."""


@dataclass(frozen=True, slots=True)
class Played:
    """One request that was played. `time` is in s since the beginning, `recorded` what followed it then."""

    time: float
    request: bytes
    recorded: bytes
    heard: bytes

    @property
    def same(self) -> bool:
        """Whether the answer is the same, byte for byte."""
        return self.recorded == self.heard


def play(entries: Iterable[Entry], port: Transport) -> Iterator[Played]:
    """Send what was sent, when it was sent; give each request when the next one is due.

    Bytes of unknown direction count as received. Raises PortError.
    """
    steps = list(_steps(entries))
    began = port.now()
    for n, step in enumerate(steps):
        _wait(port, began + step.time)
        if step.baud is not None:
            port.set_baud(step.baud)
            continue
        port.discard()  # what came since the answer to the last request ended belongs to none
        port.write(step.request)
        until = steps[n + 1].time if n + 1 < len(steps) else step.end
        yield Played(step.time, step.request, step.recorded, _listen(port, began + until))


@dataclass(slots=True)
class _Step:
    time: float
    request: bytes = b""
    baud: int | None = None
    recorded: bytes = b""
    end: float = 0.0


def _steps(entries: Iterable[Entry]) -> Iterator[_Step]:
    """Put what came behind each request; what came before the first belongs to none."""
    step: _Step | None = None
    for entry in entries:
        match entry:
            case Chunk(time, Direction.OUT, data):
                if step is not None:
                    yield step
                step = _Step(time, data, end=time + LAST)
            case Chunk(time, _, data) if step is not None:
                step.recorded += data
                step.end = max(step.end, time + LAST)
            case Speed(time, baud):
                if step is not None:
                    yield step
                step = None
                yield _Step(time, baud=baud)
            case TapEnd(time) if step is not None:
                step.end = min(max(time, step.time), step.time + LAST)
    if step is not None:
        yield step


def _wait(port: Transport, moment: float) -> None:
    if (seconds := moment - port.now()) > 0:
        port.sleep(seconds)


def _listen(port: Transport, until: float) -> bytes:
    heard = bytearray(port.read(0))
    while (seconds := until - port.now()) > 0:
        heard += port.read(seconds)
    return bytes(heard)
