"""What an LX-16A makes of a move: a set point of uniform speed, and the output that keeps the shaft at it.

    positions rad, speeds rad/s, times s; the output is -1 .. 1 of the supply, positive towards larger positions

    set point   goes straight to the goal at the speed of the move, and stays there
    output      P * error + total + D * (speed of the set point - measured speed) + F * speed of the set point
    error       from the shaft to the set point, less a dead zone in which the sensor would tell the goal
    total       grows by I * error, unless that drives the output further beyond what there is
    motor mode  the output is what the host says, whatever becomes of the speed

The maker tells nothing of this but the uniform speed, and users have measured no more than that motor mode is an
output without a loop. So every number below is an assumption. They are chosen for the motor of
`servobus.families.lewansoul.motors` at 7.4 V: without load the loop is damped well, with seven times its inertia
still stable. The dead zone is what lets the shaft come to rest: with friction, a total that went on would hunt for
ever.
"""

import math
from dataclasses import dataclass

UNIT = math.radians(0.24)
"""rad; one unit of position."""


@dataclass(frozen=True, slots=True)
class Gains:
    """The numbers of the position loop."""

    proportional: float  # 1/rad
    integral: float  # 1/(rad s)
    derivative: float  # s/rad
    feed_forward: float  # s/rad
    dead: float  # rad, to either side


GAINS = Gains(
    proportional=0.20 / UNIT,  # full output at 5 units, 1.2 degrees
    integral=3.0 / UNIT,
    derivative=1.0,
    feed_forward=0.16 / math.radians(60),  # the product pages: full output is 60 degrees in 0.16 s
    dead=0.4 * UNIT,
)
STEPS = 1000
"""Steps of the output from 0 to full; assumption: as many as motor mode has."""
NEARLY_FULL = 0.9
"""Output from which a rotor that stands counts as locked; assumption."""
LOCKED_TIME = 1.0
"""s that it has to stand until it does; assumption."""


def set_point(point: float, goal: float, speed: float, dt: float) -> float:
    """Give where the set point is after dt, on its way to the goal."""
    way = goal - point
    step = speed * dt
    return goal if -step <= way <= step else point + step if way > 0 else point - step


def hold(gains: Gains, error: float, wanted: float, measured: float, total: float, dt: float) -> tuple[float, float]:
    """Give the output and the new total, for an error of position and the wanted and measured speed."""
    rest = gains.proportional * error + gains.derivative * (wanted - measured) + gains.feed_forward * wanted
    if gains.dead < (error if error > 0 else -error) < 1 / gains.proportional:
        total += gains.integral * error * dt
        total = 1.0 if total > 1 else -1.0 if total < -1 else total
    output = rest + total
    return (1.0 if output >= 1 else -1.0 if output <= -1 else round(output * STEPS) / STEPS), total


def stands(output: float, moved: float) -> bool:
    """Tell whether a motor with this output, that has moved this far since it last moved, is held by something."""
    return not -NEARLY_FULL < output < NEARLY_FULL and -UNIT < moved < UNIT


class Follower:
    """The loop of one servo, tick by tick: the three above, with what stays from one tick to the next."""

    __slots__ = (
        "_dt", "_gains", "_last", "_output", "_stuck_at", "_unwatched", "fixed", "point", "speed", "stuck", "target",
        "total",
    )  # fmt: skip

    def __init__(self, gains: Gains, dt: float, position: float) -> None:
        self._gains, self._dt = gains, dt
        self.target: float | None = None
        """Where on the shaft the goal is, rad; None while nothing holds the shaft there."""
        self.point = 0.0
        """The set point, on its way there, rad."""
        self.speed = 0.0
        """Of the set point on its way, rad/s."""
        self.total = 0.0
        self.fixed = 0.0
        """The output without a goal."""
        self.stuck = 0
        """Ticks for which something has held the rotor by now."""
        self._last = self._stuck_at = position
        self._output = 0.0
        self._unwatched = False
        """Whether it has not been seen yet what became of the last output."""

    def take_hold(self, position: float) -> None:
        """Keep the shaft where it is."""
        self.target = self.point = self._last = position
        self.total = 0.0

    def release(self) -> None:
        """Take note that the motor has no output."""
        self._output = 0.0

    def output(self, position: float) -> float:
        """Give the output for the next tick, and move the set point on."""
        if self._unwatched:
            self.watch(position)
        self._unwatched = True
        target = self.target
        if target is None:
            self._output = self.fixed
            return self.fixed
        dt, now = self._dt, self.point
        # At its goal the set point stands.
        self.point = point = now if now == target else set_point(now, target, self.speed, dt)
        wanted, measured = (point - now) / dt, (position - self._last) / dt
        self._last = position
        self._output, self.total = result = hold(self._gains, now - position, wanted, measured, self.total, dt)
        return result[0]

    def watch(self, position: float) -> None:
        """See whether something holds the rotor, once after every tick."""
        self._unwatched = False
        if stands(self._output, position - self._stuck_at):
            self.stuck += 1
        else:
            self.stuck, self._stuck_at = 0, position
