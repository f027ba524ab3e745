"""A bad adapter: what stands between the receiver at the client's end of the wire and the client.

Bytes keep their order here: what waits makes everything behind it wait. Only a late reply leaves its place; it is
let in where the line has a gap.
"""

import bisect
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from servobus.virtual.wire.uart import EPSILON, ReceivedBytes, Transmission


@dataclass(slots=True)
class Delivery:
    """What is handed over for the bytes of one wave, and when."""

    parts: list[bytes]
    """For each byte of the wave."""
    pauses: dict[int, float] = field(default_factory=dict)
    """Byte -> s for which everything from there on waits."""
    hold: float | None = None
    """s at most for which all of it is held until something else comes."""
    late: float | None = None
    """s by which all of it is late, while others pass."""
    jitter: float = 0.0
    """s on top of the latency."""

    @property
    def data(self) -> bytes:
        return b"".join(self.parts)


def plain(data: bytes) -> Delivery:
    """Give the plan that changes nothing."""
    return Delivery([bytes((byte,)) for byte in data])


class UsbDelay:
    """Takes what arrives and hands it over in its own time.

    `latency` is the time in s after which a piece is handed over, from its first byte on; `wire` holds the waves
    that the client's receiver listens to, in the order of their start.
    """

    def __init__(self, wire: Sequence[Transmission], latency: float, now: float) -> None:
        self.latency = latency
        self._wire = wire
        self._out: deque[tuple[float, bytes]] = deque()
        self._last = now
        """Time at which the last byte of these is handed over."""
        self._blocked_until = now
        self._piece_until = -math.inf
        self._jitter = 0.0
        self._held: list[bytes] = []
        self._holder: Transmission | None = None
        self._held_until = math.inf
        self._late: list[tuple[float, bytes]] = []

    def take(self, run: ReceivedBytes) -> None:
        """Take what the receiver has received."""
        if run.at == 0:
            self._let_in(run.start)
        if self._holder is not None and run.wave is not self._holder:
            self._release(run.wave.end if run.wave else run.end)
        plan = run.wave.note if run.wave is not None and isinstance(run.wave.note, Delivery) else None
        if plan is not None and plan.hold is not None and run.at == 0:
            self._holder, self._held_until = run.wave, run.end + plan.hold
        if plan is None and not self.latency and not self._jitter:
            self._put(run.end, run.data)
            return
        step = (run.end - run.start) / len(run.data)
        for i, byte in enumerate(run.data):
            time = run.start + (i + 1) * step
            if plan is None:
                self._put(self._piece(time), bytes((byte,)))
                continue
            at = run.at + i
            if at in plan.pauses:
                self._blocked_until = max(self._blocked_until, time + plan.pauses[at])
            if plan.parts[at]:
                self._jitter = plan.jitter
                self._put(self._piece(time), plan.parts[at])

    def take_late(self, time: float, data: bytes) -> None:
        """Hand these bytes over at that time, or as soon then as the line has a gap."""
        bisect.insort(self._late, (time, data), key=_time_of)

    def due(self, now: float) -> list[ReceivedBytes]:
        """Give what is handed over by now and was not given yet."""
        self._let_in(now)
        if self._holder is not None and self._held_until <= now:
            self._release(self._held_until)
        runs: list[ReceivedBytes] = []
        while self._out and self._out[0][0] <= now + EPSILON:
            time, data = self._out.popleft()
            runs.append(ReceivedBytes(data, time, time, time, from_servo=True))
        return runs

    def next_event(self) -> float | None:
        """Give the time at which something is handed over next; None if nothing waits, or that time is not known."""
        times = [self._out[0][0]] if self._out else []
        if self._late:
            times.append(self._gap(self._late[0][0]))
        if self._holder is not None and self._held_until < math.inf:
            times.append(self._held_until)
        return min(times, default=None)

    def together(self, run: ReceivedBytes) -> float | None:
        """Give the time up to which these bytes come one behind the other; None if they come as the adapter likes."""
        if self.latency or self._out or self._holder is not None:
            return None
        plan = run.wave.note if run.wave is not None and isinstance(run.wave.note, Delivery) else None
        if run.wave is None or plan is None:
            return run.end
        if plan.jitter:
            return None
        pauses = (run.wave.time(at) for at in plan.pauses if run.at < at < run.at + len(run.data))
        return min(pauses, default=run.end)

    def _piece(self, time: float) -> float:
        """Give the time at which the piece is handed over that a byte received now belongs to."""
        wait = self.latency + self._jitter
        if not wait:
            return time
        if time > self._piece_until:
            self._piece_until = time + wait
        return self._piece_until

    def _put(self, time: float, data: bytes) -> None:
        if self._holder is not None:
            self._held.append(data)
            return
        self._last = max(time, self._blocked_until, self._last)
        self._out.append((self._last, data))

    def _release(self, time: float) -> None:
        """Let go what is held, no earlier than this."""
        self._holder, held, self._held = None, self._held, []
        self._blocked_until = max(self._blocked_until, time)
        for data in held:
            self._put(time, data)

    def _let_in(self, until: float) -> None:
        """Let in the late replies whose gap has come."""
        while self._late and (time := self._gap(self._late[0][0])) <= until + EPSILON:
            if self._holder is not None:
                self._release(time)
            self._put(time, self._late.pop(0)[1])

    def _gap(self, time: float) -> float:
        """Give the first time from then on at which nothing is being received, as far as is known."""
        for wave in self._wire:
            if wave.start + EPSILON < time < wave.end - EPSILON:
                time = wave.end
        return time


def _time_of(item: tuple[float, bytes]) -> float:
    return item[0]
