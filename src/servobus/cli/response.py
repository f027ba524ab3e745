"""A step response: what a servo does when it is told to be somewhere else, in samples and in figures."""

import math

from servobus.core.values import frozen


@frozen
class Sample:
    """One moment of a step response. What cannot be known of a servo is nan."""

    time: float
    """s since the goal was given"""
    position: float
    """rad"""
    trajectory: float = math.nan
    """Where the servo's own profile wants it to be, rad."""
    speed: float = math.nan
    """rad/s"""
    duty: float = math.nan
    """Share of full output, -1 .. 1."""
    current: float = math.nan
    """A"""
    voltage: float = math.nan
    """V"""
    temperature: float = math.nan
    """degC, of the case"""


@frozen
class Figures:
    """What one says of a step response. nan where it did not get that far, or cannot be known.

    arrived       whether it ends up within a tenth of the way of its goal
    rise_time     s from 10 % to 90 % of the way
    overshoot     share of the way that it went too far
    settling_time s until it stays within the band around where it ends up; nan if it never left its start
    steady_error  rad: where it ends up, less the goal
    peak_current  A
    """

    arrived: bool
    rise_time: float
    overshoot: float
    settling_time: float
    steady_error: float
    peak_current: float


BAND = 0.02
"""Share of the way that counts as settled: the usual 2 %."""
NEAR = 0.1
"""Share of the way that may be left for it to have arrived: rise times end there too."""


@frozen
class Response:
    """The samples of a step from `start` to `goal` (rad), in the order of time."""

    start: float
    goal: float
    samples: tuple[Sample, ...]
    resolution: float = 0.0
    """Smallest difference that the sensor tells, rad: nothing finer counts as unsettled."""

    def figures(self) -> Figures:
        """Work the figures out. Raises ValueError without samples."""
        if not self.samples:
            raise ValueError("a step response without samples has no figures")
        way = self.goal - self.start
        end = self._end()
        ten, ninety = self._reached(0.1 * way), self._reached(0.9 * way)
        band = max(BAND * abs(way), 1.5 * self.resolution)
        moved = abs(way) <= band or any(abs(sample.position - self.start) > band for sample in self.samples)
        farthest = max((sample.position - self.goal) * math.copysign(1, way) for sample in self.samples)
        currents = [abs(sample.current) for sample in self.samples if not math.isnan(sample.current)]
        return Figures(
            arrived=abs(end - self.goal) <= max(NEAR * abs(way), 1.5 * self.resolution),
            rise_time=ninety - ten,
            overshoot=max(0.0, farthest - self.resolution / 2) / abs(way) if way else 0.0,
            settling_time=self._settled(end, band) if moved else math.nan,
            steady_error=end - self.goal,
            peak_current=max(currents, default=math.nan),
        )

    def _end(self) -> float:
        """Where it ends up: the mean of the last tenth of the samples."""
        last = self.samples[-max(1, len(self.samples) // 10) :]
        return math.fsum(sample.position for sample in last) / len(last)

    def _reached(self, distance: float) -> float:
        """Time at which it was first this far on its way, between samples by a straight line."""
        sense = math.copysign(1, distance)
        before: Sample | None = None
        for sample in self.samples:
            done = (sample.position - self.start - distance) * sense
            if done >= 0:
                if before is None or sample.position == before.position:
                    return sample.time
                missing = (self.start + distance - before.position) / (sample.position - before.position)
                return before.time + missing * (sample.time - before.time)
            before = sample
        return math.nan

    def _settled(self, end: float, band: float) -> float:
        """Time from which on it stays within the band."""
        settled = math.nan
        for sample in reversed(self.samples):
            if abs(sample.position - end) > band:
                break
            settled = sample.time
        return settled
