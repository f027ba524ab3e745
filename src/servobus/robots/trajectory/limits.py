"""What a joint may do: its greatest speed, acceleration and jerk."""

from collections.abc import Iterable, Mapping

from servobus.core.units import finite, said
from servobus.core.values import frozen
from servobus.errors import BadValue, UnknownName

RANGE = (1e-9, 1e9)
"""rad/s, rad/s², rad/s³; *assumption*: no joint is so slow or so quick, and no number leaves the range of float."""
FARTHEST = 1e6
"""rad; *assumption*: no joint turns farther, and floats tell positions apart to 1e-10 rad up to there."""
NEAREST = 1e-12
"""rad; a shorter way is none: no encoder sees one, and its profile would be made of numbers without digits."""
SHORTEST = 1e-3
"""s; *assumption*: no goal is sent more often, so no move and no segment of a motion is shorter."""


@frozen
class JointLimits:
    """The greatest speed, acceleration and jerk of a joint, in either direction.

    speed         rad/s
    acceleration  rad/s²
    jerk          rad/s³; None: acceleration may change at once, as in a trapezoid of speed
    """

    speed: float
    acceleration: float
    jerk: float | None = None

    def check(self, joint: str) -> None:
        """Raise BadValue, with the name of the joint, unless all limits are numbers within RANGE."""
        for name, unit, value in (
            ("speed", "rad/s", self.speed),
            ("acceleration", "rad/s²", self.acceleration),
            ("jerk", "rad/s³", self.jerk),
        ):
            if name == "jerk" and value is None:
                continue
            number = finite(value)
            if number is None or not RANGE[0] <= number <= RANGE[1]:
                low, high = (f"{bound:g}" for bound in RANGE)
                raise BadValue(f"{joint}: the limit of {name} {said(value)} is none: give {low} to {high} {unit}")


def limits_of(joints: Iterable[str], limits: Mapping[str, JointLimits]) -> dict[str, JointLimits]:
    """Give the checked limits of these joints. Raises UnknownName for a joint without, BadValue for bad ones."""
    found = {}
    for joint in joints:
        if joint not in limits:
            raise UnknownName(f"{joint} has no limits of speed and acceleration: give JointLimits for {joint}")
        limits[joint].check(joint)
        found[joint] = limits[joint]
    return found


def number_of(joint: str, what: str, value: object) -> float:
    """Give a position in rad back. Raises BadValue that names the joint."""
    number = finite(value)
    if number is None or abs(number) > FARTHEST:
        raise BadValue(f"{joint}: the {what} {said(value)} is no position: give radians, at most {FARTHEST:g}")
    return number
