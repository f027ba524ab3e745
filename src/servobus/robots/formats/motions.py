"""Motions of other programs as motions of a robot file: what all of them share."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from servobus.core.units import deg, show
from servobus.errors import FormatError
from servobus.robots.file.entries import JointEntry, RobotFile
from servobus.robots.file.kinds import shown
from servobus.robots.file.reading import ROUNDING
from servobus.robots.formats.base import Given, listed, plain_name

PLACES = 4
"""Places of degrees and of seconds that are written."""
HALF = 0.5 * 10**-PLACES * deg
"""rad by which an angle may be rounded."""


def motion_name(file: RobotFile, given: Given) -> str:
    """Give the name of a motion that comes into a robot file. Raises FormatError if it has one of this name."""
    name = given.motion or plain_name(given.source.rsplit(".", 1)[0])
    if name in file.motions:
        raise FormatError(f"{file.name} has a motion {name} already; give another name, as in --name {name}2")
    return name


def joint_of_servo(file: RobotFile, id: int, given: Given, suits: Callable[[JointEntry], bool]) -> str | None:
    """Find the joint of a servo that a motion calls by its id: by what was said, else the one with this id that suits.

    Raises FormatError if several do.
    """
    name = f"Servo{id}"
    said = given.called(name)
    if said is not None:
        if said not in file.joints:
            raise FormatError(f"{file.name}: there is no joint {shown(said)}; there are {listed(file.joints)}")
        return said
    found = [joint.name for joint in file.joints.values() if joint.id == id and suits(joint)]
    if len(found) > 1:
        raise FormatError(
            f"{given.source}: {listed(found)} all have id {id} in {file.name}; say which is meant, as in "
            f"--joint {name}={found[0]}"
        )
    return found[0] if found else None


def check_angle(file: RobotFile, joint: str, angle: float, where: str) -> float:
    """Give an angle of a joint, rad, in degrees to be written. Raises FormatError outside its limits."""
    low, high = file.joints[joint].range
    if not low - HALF <= angle <= high + HALF:
        raise FormatError(
            f"{where}: {joint} goes to {show(angle, 'rad')}, which is outside its limits in {file.name}, "
            f"{show(low, 'rad')} .. {show(high, 'rad')}; nothing was taken"
        )
    told = round(angle / deg, PLACES)
    if told * deg > high + ROUNDING:
        told = round(told - 2 * HALF / deg, PLACES)
    elif told * deg < low - ROUNDING:
        told = round(told + 2 * HALF / deg, PLACES)
    return told + 0.0


def figure(value: float) -> str:
    """Write a number without needless places."""
    return f"{value:.{PLACES}f}".rstrip("0").rstrip(".")


def steps_of(times: Sequence[float], poses: Sequence[Mapping[str, float]]) -> list[dict[str, Any]]:
    """Give the steps of a motion as a robot file has them; times in s, angles in degrees."""
    return [
        {"joints": {joint: f"{figure(angle)}deg" for joint, angle in pose.items()}, "time": f"{figure(time)}s"}
        for time, pose in zip(times, poses, strict=True)
    ]


def none_known(file: RobotFile, given: Given, names: list[str]) -> FormatError:
    """Make the error for a motion of which no joint is in the robot file."""
    return FormatError(
        f"{given.source}: none of its servos is a joint of {file.name}; it has {listed(names) or 'none'}, and "
        f"{file.name} has {listed(file.joints)}; say which is which, as in --joint THEIRS=OURS"
    )
