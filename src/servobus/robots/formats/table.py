"""All formats of other programs, in one table: the command line, the pages and the messages read it."""

from collections.abc import Iterable

from servobus.errors import FormatError, UnknownName
from servobus.robots.formats import d6a, lerobot, move, mtn, pypot, robotis, ros2_control, urdf
from servobus.robots.formats.base import Format, listed

FORMATS = {
    one.name: one
    for one in (
        Format(
            "lerobot",
            "calibration file of LeRobot",
            (".json",),
            "ids, directions and limits; coming in also zero: the middle of the range",
            "ports, models, speeds, zero, gears, groups, poses and motions",
            lerobot.known,
            write=lerobot.write,
            new=lerobot.new,
            onto=lerobot.onto,
        ),
        Format(
            "pypot",
            "robot configuration of pypot",
            (".json",),
            "ports, groups, models, ids, zero, directions and limits",
            "speeds, gears, poses, motions, and servos other than Dynamixel",
            pypot.known,
            write=pypot.write,
            new=pypot.new,
        ),
        Format(
            "robotis",
            ".robot file of the ROBOTIS framework",
            (".robot",),
            "ports and their speeds, names, models and ids",
            "zero, directions, limits, gears, groups, poses, motions, and servos other than Dynamixel",
            robotis.known,
            write=robotis.write,
            new=robotis.new,
        ),
        Format(
            "ros2_control",
            "URDF with the <ros2_control> tags of dynamixel_hardware",
            (".urdf",),
            "joints as in a URDF; ports and their speeds, ids, zero, directions and gears",
            "models, groups, poses, motions, and servos other than Dynamixel",
            ros2_control.known,
            write=ros2_control.write,
            new=ros2_control.new,
            onto=urdf.onto,
        ),
        Format(
            "urdf",
            "URDF",
            (".urdf", ".xml"),
            "names, limits and greatest speeds of joints",
            "ports, servos, zero, directions, gears, groups, poses and motions",
            urdf.known,
            write=urdf.write,
            onto=urdf.onto,
        ),
        Format(
            "d6a",
            "action group of Hiwonder",
            (".d6a",),
            "poses and their times, as the steps of a motion",
            "names, models, zero and directions: they are those of the robot file",
            d6a.known,
            onto=d6a.onto,
        ),
        Format(
            "mtn",
            "motion file of RoboPlus",
            (".mtn",),
            "poses, pauses and their times of each page, as the steps of a motion",
            "names, models, zero and directions: they are those of the robot file",
            mtn.known,
            onto=mtn.onto,
        ),
        Format(
            "move",
            ".move of pypot",
            (".move",),
            "positions and their times, as a file of samples and its motion",
            "all but names and angles of joints",
            move.known,
            onto=move.onto,
        ),
    )
}
"""Name -> format."""


def by_name(name: str, among: Iterable[str] = FORMATS) -> Format:
    """Find a format, among those of these names. Raises UnknownName."""
    names = list(among)
    if name not in names:
        other = f"{FORMATS[name].a_title} goes the other way only" if name in FORMATS else f"no format {name!r}"
        raise UnknownName(f"{other}; there are {listed(names)}")
    return FORMATS[name]


def recognised(data: bytes, source: str) -> Format:
    """Find the format of a file by what is in it. Raises FormatError."""
    for one in FORMATS.values():
        if one.known(data):
            return one
    told = listed(f"{one.name} ({one.title})" for one in FORMATS.values() if one.new or one.onto)
    raise FormatError(f"{source}: this is a file of none of the formats known here; say one with --format: {told}")
