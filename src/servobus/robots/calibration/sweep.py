"""What a hand does to a limp servo, told from its readings: how it turns through a seam, which ends it touches."""

import math

from servobus.core.units import deg, show
from servobus.families.base import Model

TURN = 2 * math.pi
REVERSED = 3 * deg
"""rad by which a shaft turns back before its farthest angle counts as the end of a motion. Assumption: more than a hand
trembles, less than one lets go of an end."""


def goal_range(model: type[Model]) -> tuple[float, float]:
    """Give the lowest and the highest angle, rad, that a servo can be sent to within one turn of its counter."""
    low, high = model.register("min_position"), model.register("max_position")
    return low.decode(low.limits[0]), high.decode(high.limits[1])


def dead_zone(model: type[Model]) -> float:
    """Give the part of a turn, rad, in which a servo can be sent nowhere; 0 if it covers a whole turn or more."""
    low, high = goal_range(model)
    gap = TURN - (high - low)
    return gap if gap > 2 * step_of(model) else 0.0


def step_of(model: type[Model]) -> float:
    """Give the step in which a servo tells its angle, rad."""
    row = model.register("present_position")
    step: float = row.scale.decode(1) - row.scale.decode(0)
    return step


class Track:
    """The angle of one servo, followed by differences: a jump of more than half a turn is the seam of its sensor.

    angle   rad, continued beyond the seam; None before the first reading
    seam    what was read before and after the first jump, rad; None without one
    """

    def __init__(self, model: type[Model]) -> None:
        self.model = model
        self.angle: float | None = None
        self.seam: tuple[float, float] | None = None
        self._reading = 0.0

    def add(self, reading: float) -> float:
        """Take a reading, rad; give the angle."""
        if self.angle is None:
            self.angle = reading
        else:
            step = reading - self._reading
            if abs(step) > TURN / 2:
                self.seam = self.seam or (self._reading, reading)
            self.angle += math.remainder(step, TURN)
        self._reading = reading
        return self.angle

    def begin(self) -> None:
        """Begin anew at the last reading: what was before is forgotten, a seam included."""
        self.seam = None
        if self.angle is not None:
            self.angle = self._reading


class Ends:
    """The ends of a sweep: the lowest and the highest angle so far, and how often each was touched.

    An end is touched where the motion turns back within `near` of the farthest angle. All angles in rad.
    """

    def __init__(self, near: float) -> None:
        self.near = near
        self.low, self.high = math.inf, -math.inf
        self._turned: dict[int, list[float]] = {1: [], -1: []}
        """Direction, up or down -> angles at which a motion in it ended."""
        self._direction = 0
        self._farthest = math.nan

    def add(self, angle: float) -> None:
        """Take an angle."""
        self.low, self.high = min(self.low, angle), max(self.high, angle)
        if self._direction == 0:
            if self.high - self.low >= REVERSED:
                self._direction = 1 if angle == self.high else -1
                self._farthest = angle
            return
        if self._direction * (angle - self._farthest) > 0:
            self._farthest = angle
        elif self._direction * (self._farthest - angle) >= REVERSED:
            self._turned[self._direction].append(self._farthest)
            self._direction, self._farthest = -self._direction, angle

    @property
    def touched(self) -> tuple[int, int]:
        """How often the lower and the upper end were touched."""
        return (
            sum(angle - self.low <= self.near for angle in self._turned[-1]),
            sum(self.high - angle <= self.near for angle in self._turned[1]),
        )

    @property
    def complete(self) -> bool:
        """Whether both ends were touched twice."""
        return min(self.touched) >= 2


def why_unusable(track: Track, ends: Ends) -> str | None:
    """Say why a servo cannot serve a joint with this travel, and what to do; None if it can."""
    model, (low, high) = track.model, goal_range(track.model)
    middle = (low + high) / 2
    remedy = (
        f"take the horn off and put it on again so that the middle of the travel lies near {show(middle, 'rad')} of "
        f"the servo (it is near {show(_within((ends.low + ends.high) / 2, middle), 'rad')})"
    )
    gap = dead_zone(model)
    if track.seam is not None:
        before, after = track.seam
        jump = f"what it reads jumps from {show(before, 'rad')} to {show(after, 'rad')}"
        if gap:
            return (
                f"the travel crosses the dead zone of the {model.title}, {show(gap, 'rad')} beyond "
                f"{show(low, 'rad')} .. {show(high, 'rad')} where it can be sent nowhere ({jump}); {remedy}"
            )
        return f"the travel crosses the seam of the {model.title} ({jump}), and no goal leads across; {remedy}"
    beyond = model.register("present_position").layout.range[0] < 0  # it tells angles that it cannot be sent to
    edge = step_of(model) / 2
    if gap and not beyond and (ends.low <= low + edge or ends.high >= high - edge):
        return (
            f"the travel reaches into the dead zone of the {model.title}, beyond {show(low, 'rad')} .. "
            f"{show(high, 'rad')}, where it is blind; {remedy}"
        )
    return None


def _within(angle: float, middle: float) -> float:
    """Give the same direction within half a turn of the middle."""
    return math.remainder(angle - middle, TURN) + middle
