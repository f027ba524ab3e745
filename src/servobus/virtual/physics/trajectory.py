r"""Motion in plain numbers: speed profiles, stop detection, and a position that is counted in steps.

A profile tells where a motion of given duration is at any time, and how fast, in any unit:

    speed        ____________            trapezoid: 0 < ramp < duration / 2
               /:            :\           triangle:  ramp = duration / 2
             /  :            :  \        rectangle: ramp = 0
           /____:____________:____\
           ramp                 ramp     duration

A profile may begin with a speed; it then speeds up or slows down from there, and still ends in time.
"""

from dataclasses import dataclass

EPSILON = 1e-9
"""s; a time that should be the end of a profile can be a rounding error short of it."""


@dataclass(frozen=True, slots=True)
class Profile:
    """A motion from `start`, at `velocity`, to rest at `goal`.

    ramp  time spent speeding up, and as much slowing down: at most half the duration
    """

    start: float
    goal: float
    duration: float = 0.0
    ramp: float = 0.0
    velocity: float = 0.0

    @property
    def cruise(self) -> float:
        """Speed between the ramps: the one with which the area under the profile is the distance."""
        return (self.goal - self.start - self.velocity * self.ramp / 2) / (self.duration - self.ramp)

    def over(self, time: float) -> bool:
        return time >= self.duration - EPSILON

    def position(self, time: float) -> float:
        if self.over(time):
            return self.goal
        if time < self.ramp:
            gain = (self.cruise - self.velocity) / self.ramp
            return self.start + self.velocity * time + gain * time**2 / 2
        left = self.duration - time
        if left < self.ramp:
            return self.goal - self.cruise * left**2 / (2 * self.ramp)
        return self.goal - self.cruise * (left - self.ramp / 2)

    def speed(self, time: float) -> float:
        if self.over(time):
            return 0.0
        if time < self.ramp:
            return self.velocity + (self.cruise - self.velocity) * time / self.ramp
        left = self.duration - time
        return self.cruise * left / self.ramp if left < self.ramp else self.cruise

    def moving(self, time: float) -> bool:
        """Tell whether it is on its way; a motion to where it is already is none."""
        return not self.over(time) and (self.start != self.goal or self.velocity != 0)


@dataclass(frozen=True, slots=True)
class Ramp:
    """A change of speed that takes a given time, for turning without a goal: a profile with no position."""

    before: float = 0.0
    after: float = 0.0
    duration: float = 0.0

    def over(self, time: float) -> bool:
        return time >= self.duration - EPSILON

    def speed(self, time: float) -> float:
        if self.over(time):
            return self.after
        return self.before + (self.after - self.before) * time / self.duration

    def moving(self, time: float) -> bool:
        return self.speed(time) != 0


class GoalTrajectory:
    """A profile under way, counted in control loops."""

    def __init__(self, tick: float, plan: Profile | Ramp) -> None:
        self.tick = tick
        self.begin(plan)

    def begin(self, plan: Profile | Ramp) -> None:
        self.plan, self._loops = plan, 0

    def step(self) -> None:
        self._loops += 1

    @property
    def time(self) -> float:
        """Time since the beginning, s."""
        return self._loops * self.tick

    @property
    def over(self) -> bool:
        return self.plan.over(self.time)

    @property
    def position(self) -> float | None:
        """Where the profile is; None if it has no position."""
        return self.plan.position(self.time) if isinstance(self.plan, Profile) else None

    @property
    def speed(self) -> float:
        return self.plan.speed(self.time)

    @property
    def moving(self) -> bool:
        return self.plan.moving(self.time)


class StopDetection:
    """Tells motion from standing: what changes by less than a threshold for longer than a while has stopped."""

    def __init__(self, position: float) -> None:
        self.moving = False
        self.threshold, self.loops = 0.0, 0
        """Smallest change that is motion, and the control loops without it that are still no stop."""
        self._stood_at, self._stood_for = position, 0

    def start(self) -> None:
        """Count as moving from now on."""
        self.moving, self._stood_for = True, 0

    def step(self, position: float, *, planned: bool) -> None:
        """Look at the position once more; `planned` motion counts even if too slow to be seen."""
        if planned or abs(position - self._stood_at) >= self.threshold:
            self._stood_at = position
            self.start()
        elif self.moving:
            self._stood_for += 1
            self.moving = self._stood_for <= self.loops
            if not self.moving:
                self._stood_at = position


class StepCounter:
    """What a servo calls the positions of its shaft: steps from 0 to `size` - 1, from which it starts anew.

    What it calls where it is can be changed, so that steps = angle / step + zero + shift.
    """

    def __init__(self, step: float, zero: int, size: int) -> None:
        self.step, self.zero, self.size = step, zero, size
        """rad in a step; the step at 0 rad; how many steps there are"""
        self._shift = 0.0

    def place(self, angle: float, steps: float) -> None:
        """Call this angle by that number."""
        self._shift += steps - self._steps(angle)

    def wrap(self, angle: float) -> None:
        """Forget the turns, so that all positions from 0 to the last lie around this angle."""
        # Half a step below 0 is still 0, not the other end.
        self.place(angle, (self._steps(angle) + 0.5) % self.size - 0.5)

    def read(self, angle: float) -> int:
        """Give the number of the nearest step."""
        return round(self._steps(angle)) % self.size

    def angle(self, steps: float) -> float:
        return (steps - self.zero - self._shift) * self.step

    def _steps(self, angle: float) -> float:
        return angle / self.step + self.zero + self._shift


def ramp_time(duration: float, share: float, longest: float) -> float:
    """Give the time spent speeding up: a share of the motion, but no longer than the longest."""
    return min(duration * share, longest)
