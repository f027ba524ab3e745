"""Servos of a robot file as other programs have them: one by one, each with a name, in counts of its registers."""

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from servobus.core.registers import Register
from servobus.core.units import Quantity, deg
from servobus.errors import FormatError
from servobus.families.model import Model
from servobus.robots.file.entries import OPEN_PORT, JointEntry, RobotFile, ServoEntry

DYNAMIXEL = "dynamixel"
"""The family that programs of ROBOTIS drive."""
NEAR = 0.02
"""Share of a count by which a limit may be missed: a robot file has angles to a ten-thousandth of a degree."""
PLACES = 1e4
"""Parts of a degree to which angles of a robot file are written."""
FINE = 5e-4
"""Share of such a part that is rounding of floats: less than what a robot file may miss a limit by."""


class NamedServo(NamedTuple):
    """A servo of a joint under a name of its own: that of the joint, or for the second one NAME_mirror."""

    name: str
    joint: JointEntry
    servo: ServoEntry

    @property
    def baud(self) -> int:
        """Speed of the servo, bit/s."""
        return self.servo.baud or self.servo.model.factory_baud


def named_servos(file: RobotFile) -> list[NamedServo]:
    """Give all servos of a robot. Raises FormatError where there are none, or two would have one name."""
    found: dict[str, NamedServo] = {}
    for joint in file.joints.values():
        for servo, name in zip(joint.servos, (joint.name, f"{joint.name}_mirror"), strict=False):
            if name in found or (name != joint.name and name in file.joints):
                raise FormatError(f"{file.name}: the second servo of {joint.name} would be called as joint {name} is")
            found[name] = NamedServo(name, joint, servo)
    if not found:
        raise FormatError(f"{file.name}: there is no joint in it, so there is nothing to export")
    return list(found.values())


def angle_row(model: type[Model], source: str) -> tuple[Register[float], Quantity]:
    """Give the register that holds the lower limit of a servo, and its scale: what counts of angles are to it.

    Raises FormatError for a model that is not known.
    """
    row = model.register("min_position")
    if not isinstance(row.scale, Quantity):
        raise FormatError(f"{source}: a {model.title} has counts of which no angle is known; say the model that it is")
    return row, row.scale


def to_count(scale: Quantity, angle: float) -> float:
    """Turn an angle of a servo, rad, into its counts, not rounded."""
    return angle / scale.step + scale.zero


def to_angle(scale: Quantity, count: float) -> float:
    """Turn counts of a servo, whole or not, into its angle, rad."""
    return (count - scale.zero) * scale.step


def limit_counts(one: NamedServo, source: str) -> tuple[int, int]:
    """Give the limits of a joint as its servo's registers can hold them: counts, the lower first, rounded inwards."""
    row, scale = angle_row(one.servo.model, source)
    low, high = (to_count(scale, end) for end in one.servo.axis.range_to_servo(*one.joint.range))
    least, most = row.limits
    lowest, highest = max(math.ceil(low - NEAR), least), min(math.floor(high + NEAR), most)
    if not lowest < highest:
        raise FormatError(f"{source}: the limits of {one.name} are nearer to each other than two counts of its servo")
    return lowest, highest


def narrowed(servos: Iterable[NamedServo], source: str) -> Iterator[str]:
    """Name the servos whose limits are wider than their registers can hold: those that turn more than once."""
    for one in servos:
        row, scale = angle_row(one.servo.model, source)
        ends = [to_count(scale, end) for end in one.servo.axis.range_to_servo(*one.joint.range)]
        least, most = row.limits
        if one.joint.limits is not None and not (least - 1 < ends[0] and ends[1] < most + 1):
            yield one.name


def middle(model: type[Model], source: str) -> float:
    """Give the angle in the middle of a servo as programs of ROBOTIS count it: count 512 of 1024, 2048 of 4096."""
    row, scale = angle_row(model, source)
    return to_angle(scale, (row.limits[1] + 1) // 2)


def rounded(angle: float) -> float:
    """Round an angle, rad, to what a robot file writes."""
    return round(angle / deg * PLACES) / PLACES * deg


def written(low: float, high: float) -> list[str]:
    """Write limits, rad, as a robot file has them: rounded inwards, so that they stay within what the servo can."""
    ends = math.ceil(low / deg * PLACES - FINE) / PLACES, math.floor(high / deg * PLACES + FINE) / PLACES
    return [f"{end + 0.0:.4f}".rstrip("0").rstrip(".") + "deg" for end in ends]


def dynamixels(file: RobotFile, program: str) -> tuple[list[NamedServo], list[str]]:
    """Give the Dynamixel servos of a robot, and a note on the others if there are any: `program` drives no others.

    Raises FormatError where there is none.
    """
    servos = named_servos(file)
    mine = [one for one in servos if one.servo.model.family.name == DYNAMIXEL]
    if not mine:
        raise FormatError(f"{file.name}: {program} drives Dynamixel servos alone, and there is none in it")
    others = ", ".join(f"{one.name} ({one.servo.model.title})" for one in servos if one not in mine)
    return mine, [f"{program} drives Dynamixel servos alone, so these are left out: {others}"] * bool(others)


def one_speed(file: RobotFile, port: str, there: Iterable[NamedServo]) -> int:
    """Give the speed of all servos on a port. Raises FormatError if they differ, for programs that have one a port."""
    speeds = {one.baud: one.name for one in there}
    if len(speeds) > 1:
        told = " and ".join(f"{name} has {baud} bit/s" for baud, name in speeds.items())
        raise FormatError(
            f"{file.name}: port {port} would need one speed, but {told}; give them one with `servobus set-baud`, "
            "and write it into the file"
        )
    return next(iter(speeds))


def device(path: str) -> str | None:
    """Give the path of a port if other programs can open it; None for what is known here alone, such as usb:SERIAL."""
    return None if path == OPEN_PORT or ":" in path else path


def port_notes(file: RobotFile, ports: Iterable[str]) -> Iterator[str]:
    """Say which ports other programs cannot open as they stand in the robot file."""
    for port in dict.fromkeys(ports):
        path = file.ports[port].path
        if device(path) is None:
            yield f"port {port} is {path!r} here; write the path of its device where the file has it"
