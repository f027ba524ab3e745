"""What an LX-16A makes of a move: a set point of uniform speed, and the output that keeps the shaft at it.

    positions rad, speeds rad/s, times s; the output is -1 .. 1 of the supply, positive towards larger positions

    set point   goes straight to the goal at the speed of the move, and stays there
    output      P * error + total + D * (speed of the set point - measured speed) + F * speed of the set point
    error       from the shaft to the set point, less a dead zone in which the sensor would tell the goal
    total       grows by I * error, unless that drives the output further beyond what there is
    motor mode  the output is what the host says, whatever becomes of the speed

The maker tells nothing of this but the uniform speed, and users have measured no more than that motor mode is an
output without a loop. So every number below is an assumption. They are chosen for the motor of
`servobus.virtual.motors` at 7.4 V: without load the loop is damped well, with seven times its inertia still stable.
The dead zone is what lets the shaft come to rest: with friction, a total that went on would hunt for ever.
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
    return goal if abs(way) <= speed * dt else point + math.copysign(speed * dt, way)


def hold(gains: Gains, error: float, wanted: float, measured: float, total: float, dt: float) -> tuple[float, float]:
    """Give the output and the new total, for an error of position and the wanted and measured speed."""
    rest = gains.proportional * error + gains.derivative * (wanted - measured) + gains.feed_forward * wanted
    if gains.dead < abs(error) < 1 / gains.proportional:
        total = max(-1.0, min(total + gains.integral * error * dt, 1.0))
    return round(max(-1.0, min(rest + total, 1.0)) * STEPS) / STEPS, total


def stands(output: float, moved: float) -> bool:
    """Tell whether a motor with this output, that has moved this far since it last moved, is held by something."""
    return abs(output) >= NEARLY_FULL and abs(moved) < UNIT
