"""A joint: its name, its limits, and the one or two servos behind it."""

from collections.abc import Iterable, Mapping
from typing import Any

from servobus.bus.base import BaseBus
from servobus.bus.servo import Servo
from servobus.core.closed import Closed
from servobus.core.units import deg, show
from servobus.core.values import frozen
from servobus.errors import BadValue, RobotMismatch
from servobus.robots.axis import Axis
from servobus.robots.file.entries import JointEntry
from servobus.robots.file.reading import ROUNDING


@frozen
class Part:
    """One servo of a joint: where it is, and how its angle belongs to that of the joint."""

    servo: Servo
    port: str
    axis: Axis


class Joint(Closed):
    """A joint of a robot. Its angles, speeds and limits are those of the joint, not of its servo; rad, rad/s.

    name    as in the robot file
    entry   what the file says of it
    parts   its servos: one, or two on the same axis
    """

    def __init__(self, entry: JointEntry, parts: tuple[Part, ...]) -> None:
        self.name, self.entry, self.parts = entry.name, entry, parts
        self.limits = entry.range
        """Least and greatest angle, rad."""
        self.mistaken = ""
        """Why the servo that answers is not that of this joint, as a comparison with the file has found; "" if it is.
        Then the joint is neither read nor driven, only stopped and let go."""
        self._close()

    @property
    def servo(self) -> Servo:
        """The first servo, for what only servos have: registers, alarms, backups."""
        return self.parts[0].servo

    @property
    def disagreement(self) -> float:
        """Angle by which two servos on the axis may disagree, rad."""
        return 0.0 if self.entry.mirror is None else self.entry.mirror.disagreement

    def mismatch(self) -> RobotMismatch:
        """Make the error for what cannot be done because another servo answers."""
        return RobotMismatch(f"{self.mistaken}; until then it is neither read nor driven", [])

    def check(self, angle: float) -> float:
        """Give an angle back that the joint may go to. Raises BadValue outside its limits."""
        low, high = self.limits
        if not low - ROUNDING <= angle <= high + ROUNDING:
            hint = ""
            if abs(angle) > high and float(angle).is_integer() and low <= angle * deg <= high:
                hint = f" (angles are in radians: did you mean {angle:g} * deg?)"
            raise BadValue(
                f"{self.name}: {show(angle, 'rad')} is outside its limits, {show(low, 'rad')} .. "
                f"{show(high, 'rad')}{hint}"
            )
        return min(max(angle, low), high)

    def __str__(self) -> str:
        servos = " and ".join(f"{part.servo.target} on {part.port}" for part in self.parts)
        return f"{self.name} ({servos})"

    def __repr__(self) -> str:
        return f"<Joint {self}>"

    def _no_such_attribute(self, name: str) -> str:
        return f'{self.name} has no attribute {name!r}; to read a register: joint.read("{name}"), or joint.servo'


def check_meant(joints: Iterable[Joint]) -> None:
    """Raise RobotMismatch for joints whose servos were found to be others than those of the file."""
    for joint in joints:
        if joint.mistaken:
            raise joint.mismatch()


def parts_of(entry: JointEntry, buses: Mapping[str, BaseBus[Any]]) -> tuple[Part, ...]:
    """Give the servos of a joint, each known on its bus from now on. Asks nothing."""
    return tuple(
        Part(buses[servo.port].attach(servo.model, servo.id, baud=servo.baud), servo.port, servo.axis)
        for servo in entry.servos
    )
