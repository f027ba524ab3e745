"""The control laws of Dynamixel protocol 1.0, compliance and PID: plain numbers in, plain numbers out.

    position  units of the register; larger is counter-clockwise
    output    -1 .. 1, the share of the supply voltage at the motor; positive turns counter-clockwise
    limit     0 .. 1, the largest output (Torque Limit)
    error     goal minus position

Compliance: section numbers are those of the RX-28 user's manual. It draws the output over the position and says what
Moving Speed gives, but not how the speed is kept: that part is an assumption.

PID: the ROBOTIS e-manual gives the gains of the MX series and a picture, but not what their unit of output is. That,
`PROPORTIONAL`, is a measurement of Rhoban's BAM (github.com/Rhoban/bam, Apache-2.0) on MX-64 and MX-106.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final

LEVELS: Final = ((5, 4), (11, 8), (23, 16), (47, 32), (95, 64), (191, 128), (254, 254))
"""Compliance Slope: (highest value, what it acts as), as 3-4-2 has it."""
EMANUAL_LEVELS: Final = ((3, 2), (7, 4), (15, 8), (31, 16), (63, 32), (127, 64), (254, 128))
"""The same as the maker's online manual has it (ED-13)."""

SPAN: Final = 32
"""Position units; assumption. Speed control: how far the shaft lags at full output."""
OVERLOAD_TIME: Final = 1.5
"""s; assumption: 3-3 says when a load is too much, and not after how long."""
STANDSTILL: Final = 0.0058
"""rad/s; assumption: the load moves as long as Present Speed would not read 0 (half of 0.111 rpm)."""


def width(slope: int, levels: Sequence[tuple[int, int]] = LEVELS) -> int:
    """Give what a Compliance Slope acts as (3-4-2: seven levels)."""
    for highest, acts_as in levels:
        if slope <= highest:
            return acts_as
    return levels[-1][1]


def compliance(error: float, margin: float, slope: float, punch: float, limit: float) -> float:
    """Give the output for a distance to the goal (3-4-2, the drawing of compliance).

    margin  position units next to the goal without output
    slope   position units next to the margin over which the output falls from full to punch
    punch   the lowest output outside the margin, 0 .. 1

    The limit cuts the curve; it does not scale it (assumption: 3-4-1 calls it a restraint).
    """
    outside = (error if error > 0 else -error) - margin
    if outside <= 0:
        return 0.0
    share = min(punch + (1 - punch) * outside / slope, limit) if outside < slope else limit
    return share if error > 0 else -share


def follow(set_point: float, position: float, goal: float, step: float) -> float:
    """Move the set point of the speed control on by a step, in position units, towards the goal.

    It never leaves the shaft further behind than SPAN, so that a shaft that was held does not hurry afterwards. An
    infinite step is no speed control: then it is at the goal.
    """
    lead = set_point - position
    held = set_point if -SPAN <= lead <= SPAN else position + SPAN if lead > 0 else position - SPAN
    left = goal - held
    return goal if -step <= left <= step else held + step if left > 0 else held - step


def pursue(lead: float, ceiling: float) -> float:
    """Give the output that keeps the shaft behind a moving set point that is `lead` ahead (D-60, assumption).

    3-4-2 has the appropriate torque for the set speed up to the slope, and the curve of compliance there. So the
    output is in proportion to the lead, and never above the curve: a shaft that hangs back gets all there is.
    """
    most, output = ceiling if ceiling > 0 else -ceiling, lead / SPAN
    return output if -most <= output <= most else most if output > 0 else -most


class Approach:
    """The way to the goal, tick by tick: the three above, with what stays the same from tick to tick."""

    __slots__ = ("ccw", "cw", "goal", "limit", "measure", "punch", "set_point", "step")

    def __init__(self, measure: Callable[[float], int]) -> None:
        """Take what measures the shaft: position in rad -> units."""
        self.measure = measure
        self.set_point = 0.0
        self.tune(0, math.inf, (0, 1), (0, 1), 0.0, 0.0)

    def tune(
        self, goal: int, step: float, cw: tuple[int, int], ccw: tuple[int, int], punch: float, limit: float
    ) -> None:
        """Take over what the registers say; cw and ccw are margin and slope on these sides of the goal."""
        self.goal, self.step, self.cw, self.ccw, self.punch, self.limit = goal, step, cw, ccw, punch, limit

    def output(self, position: float) -> float:
        """Give the output for a shaft at a position in rad, and move the set point on."""
        present, goal = self.measure(position), self.goal
        margin, slope = self.cw if goal > present else self.ccw
        ceiling = compliance(goal - present, margin, slope, self.punch, self.limit)
        self.set_point = set_point = follow(self.set_point, present, goal, self.step)
        return ceiling if set_point == goal else pursue(set_point - present, ceiling)

    @property
    def settled(self) -> bool:
        """Whether the output stays if the shaft does."""
        return self.set_point == self.goal


class Steady:
    """An output that stays, wherever the shaft is."""

    __slots__ = ("duty",)

    settled = True

    def __init__(self, duty: float) -> None:
        self.duty = duty

    def output(self, position: float) -> float:  # noqa: ARG002 - it needs none
        return self.duty


PROPORTIONAL: Final = 0.158
"""Output per rad of error and unit of P gain, as BAM measured it with an oscilloscope (bam/dynamixel/actuator.py)."""
LEAD: Final = 1.1
"""Share of full output that the lead of the set point may ask for: more than all, so the output is all there is."""
P_UNIT, I_UNIT, D_UNIT = 1 / 8, 1000 / 2048, 4 / 1000
"""One unit of each gain, in the same measure (e-manual, MX-28, PID Gains): the integral per s, the derivative in s."""


class Pid:
    """The way to the goal, or along with a speed: a set point that moves by a profile, and a PID that follows.

    The profile speeds up by the acceleration, to the speed, and slows down to stop at the goal (e-manual, MX-28, Moving
    Speed and Goal Acceleration); without a speed the set point is at the goal at once. The set point never leads by
    more than gives all the output there is, so that a shaft that was held does not hurry afterwards (assumption).
    """

    __slots__ = (
        "acceleration", "derivative", "goal", "integral", "last", "limit", "measure", "most", "proportional",
        "punch", "rate", "set_point", "step", "sum",
    )  # fmt: skip

    def __init__(self, measure: Callable[[float], int], position: float) -> None:
        """Take what measures the shaft, position in rad -> units, and where the shaft is."""
        self.measure = measure
        self.set_point = float(measure(position))
        self.rate = 0.0
        """Units per tick that the set point moves now."""
        self.sum = 0.0
        self.last = measure(position)

    def tune(self, gains: tuple[float, float, float], unit: float, tick: float, *, punch: float, limit: float) -> None:
        """Take the gains P, I and D as the registers have them, for units of so many rad and ticks of so many s."""
        p, i, d = gains
        scale = PROPORTIONAL * unit
        self.proportional = scale * p
        self.integral = scale * i * I_UNIT / P_UNIT * tick
        self.derivative = scale * d * D_UNIT / P_UNIT / tick
        self.punch, self.limit = punch, limit
        self.most = LEAD / self.proportional if self.proportional else 0.0
        """Units by which the set point leads at most."""

    def aim(self, goal: float, step: float, acceleration: float) -> None:
        """Go to a goal in units, infinite for turning without end, by at most `step` units per tick.

        `acceleration` is in units per tick²; infinite is none to be heeded.
        """
        self.goal, self.step, self.acceleration = goal, step, acceleration

    def output(self, position: float) -> float:
        """Give the output for a shaft at a position in rad, and move the set point on."""
        present = self.measure(position)
        self._move(present)
        error = self.set_point - present
        self.sum += self.integral * error
        self.sum = min(max(self.sum, -self.limit), self.limit)
        share = self.proportional * error + self.sum - self.derivative * (present - self.last - self.rate)
        self.last = present
        if self.punch and error:
            share = max(abs(share), self.punch) * (1 if error > 0 else -1)
        return min(max(share, -self.limit), self.limit)

    def _move(self, present: int) -> None:
        left = self.goal - self.set_point
        if self.step == math.inf:
            self.set_point, self.rate = self.goal, 0.0
            return
        wanted = math.copysign(min(self.step, self._braking(abs(left))), left) if left else 0.0
        self.rate += min(max(wanted - self.rate, -self.acceleration), self.acceleration)
        if abs(left) <= abs(self.rate) and left * self.rate >= 0 and abs(left) <= self.step:
            self.set_point, self.rate = self.goal, 0.0
        else:
            self.set_point += self.rate
        lead = self.set_point - present
        if abs(lead) > self.most > 0:
            self.set_point = present + math.copysign(self.most, lead)

    def _braking(self, left: float) -> float:
        """Give the speed from which the acceleration can still stop within so many units."""
        if math.inf in (self.acceleration, left):
            return math.inf
        return math.sqrt(2 * self.acceleration * left)

    @property
    def settled(self) -> bool:
        """Whether the output stays if the shaft does."""
        return self.set_point == self.goal and (self.integral == 0 or self.last == self.goal)


class CurrentControl:
    """Torque control of the MX-64 and MX-106: the output that brings the current to a goal, by integration."""

    __slots__ = ("current", "duty", "goal", "limit")

    GAIN = 0.05
    """Output per A of error and tick; assumption, so that a step is there within 20 ms."""
    FINE = 1e-4
    """A; less is no error."""

    def __init__(self, current: Callable[[], float], duty: float) -> None:
        """Take what measures the current in A, and the output to begin with."""
        self.current, self.duty = current, duty

    def aim(self, goal: float, limit: float) -> None:
        """Take a current in A as the goal; `limit` bounds the output."""
        self.goal, self.limit = goal, limit

    def output(self, position: float) -> float:  # noqa: ARG002 - the current alone counts
        self.duty = min(max(self.duty + self.GAIN * (self.goal - self.current()), -self.limit), self.limit)
        return self.duty

    @property
    def settled(self) -> bool:
        return abs(self.goal - self.current()) < self.FINE or abs(self.duty) == self.limit


def endless(share: float, limit: float) -> float:
    """Give the output in endless turn (3-4-3): what Moving Speed says, up to the limit."""
    return min(max(share, -limit), limit)


def strained(output: float, limit: float, velocity: float) -> bool:
    """Tell whether a shaft (rad/s) does not yield to all the output there may be (3-3, Overload Error)."""
    most = abs(output)
    return most > 0 and most >= limit and velocity * output <= STANDSTILL * most


def arrived(error: float, margin: float, slope: float, velocity: float, standing: bool) -> bool:
    """Tell whether a shaft (rad/s) has reached its goal (3-4-2 Moving).

    Assumption: it has not while it swings through, and it has where a load keeps it standing within the slope, because
    compliance gets it no nearer.
    """
    distance = abs(error) - margin
    return (distance <= 0 and abs(velocity) <= STANDSTILL) or (standing and distance < slope)
