"""Hiwonder's action group, .d6a: an SQLite file with a table of poses, taken in as the steps of a motion.

    ActionGroup: Index (key), Time (ms of the way to this pose), Servo1, Servo2, ... (positions; ids may be missing)

Positions are counts of a bus servo, 0 .. 1000 over 240°, or widths of pulses in µs of a robot with PWM servos, 500 ..
2500 over 180°. Nothing in the file says which: values above 1000 are no counts, so then the kind must be said.
Source: the action groups of two robots of Hiwonder; 180° for 2000 µs is what Hiwonder tells of its PWM servos, and an
*assumption* for the servo at hand.
"""

import re
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing
from itertools import accumulate
from typing import Any, NamedTuple

from servobus.core.units import deg
from servobus.errors import FormatError
from servobus.robots.file.entries import RobotFile, ServoEntry
from servobus.robots.file.kinds import shown
from servobus.robots.file.writing import Key
from servobus.robots.formats.base import Changes, Given, listed
from servobus.robots.formats.motions import check_angle, joint_of_servo, motion_name, none_known, steps_of
from servobus.robots.formats.servos import angle_row, to_angle

KINDS = ("bus", "pwm")
"""What positions may be: counts of bus servos, or widths of pulses."""
COUNTS = 1000
FAMILY = "lewansoul"
PULSES = 500, 2500
PULSE_MIDDLE, PULSE_STEP = 1500, 180 * deg / 2000
"""µs in the middle of a servo, and rad of one µs."""
HEAD = b"SQLite format 3\0"


class _Group(NamedTuple):
    ids: list[int]
    rows: list[tuple[int, list[int]]]
    """ms of the way, and a position of each id."""


def known(data: bytes) -> bool:
    """Tell whether a file may be an action group: SQLite files all begin so."""
    return data.startswith(HEAD)


def onto(data: bytes, file: RobotFile, given: Given) -> Changes:
    """Take an action group into a robot file, as the steps of a motion whose first pose is at 0 s."""
    group = _read(data, given.source)
    kind = _kind(group, given)
    joints: dict[int, str] = {}
    left = []
    for id in group.ids:
        joint = joint_of_servo(file, id, given, lambda one: kind == "pwm" or one.model.family.name == FAMILY)
        if joint is None:
            left.append(f"Servo{id}")
        elif joint in joints.values():
            raise FormatError(f"{given.source}: two of its servos would be joint {joint}")
        else:
            joints[id] = joint
    if not joints:
        raise none_known(file, given, left)
    poses: list[Mapping[str, float]] = []
    for number, (_, positions) in enumerate(group.rows, 1):
        by_id = dict(zip(group.ids, positions, strict=True))
        where = f"{given.source}: row {number}"
        poses.append(
            {
                joint: check_angle(file, joint, _angle(file, joint, by_id[id], kind, where), where)
                for id, joint in joints.items()
            }
        )
    times = list(accumulate((way / 1000 for way, _ in group.rows[1:]), initial=0.0))
    motion = motion_name(file, given)
    notes = tuple(_notes(file, left, kind))
    # Between its poses such a servo runs straight on; this path goes beyond none of them.
    changes: dict[Key, Any] = {
        ("motion", motion, "path"): "pchip",
        ("motion", motion, "steps"): steps_of(times, poses),
    }
    done = f"motion {motion}: {len(poses)} steps over {times[-1]:g} s of {listed(joints.values())}"
    return Changes(changes, {}, notes, done)


def _notes(file: RobotFile, left: list[str], kind: str) -> Iterator[str]:
    if left:
        yield f"these are no joints of {file.name}, so they were left out: {listed(left)}"
    yield "the time of its first row is left out: playing goes to the first pose by itself, and the motion begins there"
    if kind == "pwm":
        yield "pulses of 500 to 2500 µs were taken as 180° about the middle of each servo: try the motion slowly first"


def _kind(group: _Group, given: Given) -> str:
    said = given.kind
    if said not in (None, *KINDS):
        raise FormatError(f"{given.source}: {shown(said)} is none of the kinds {listed(KINDS)}")
    highest = max(max(positions) for _, positions in group.rows)
    if said is None and highest > COUNTS:
        raise FormatError(
            f"{given.source}: it has positions up to {highest}, and bus servos have counts up to {COUNTS}; say --kind "
            "pwm if they are widths of pulses in µs"
        )
    return said or "bus"


def _angle(file: RobotFile, joint: str, position: int, kind: str, where: str) -> float:
    """Give the angle of a joint for a position of its servo."""
    entry = file.joints[joint]
    servo: ServoEntry = entry.servos[0]
    row, scale = angle_row(servo.model, file.name)
    if kind == "pwm":
        if not PULSES[0] <= position <= PULSES[1]:
            raise FormatError(
                f"{where}: {joint} has a pulse of {position} µs; they are {PULSES[0]} to {PULSES[1]} µs wide"
            )
        middle = to_angle(scale, sum(row.limits) / 2)
        return servo.axis.to_joint(middle + (position - PULSE_MIDDLE) * PULSE_STEP)
    if servo.model.family.name != FAMILY:
        raise FormatError(
            f"{where}: {joint} is a {servo.model.title}, which has other counts than the bus servos of an action group"
        )
    if not 0 <= position <= COUNTS:
        raise FormatError(f"{where}: {joint} is at {position}; the counts of a bus servo are 0 to {COUNTS}")
    return servo.axis.to_joint(to_angle(scale, position))


def _read(data: bytes, source: str) -> _Group:
    """Read the table of an action group. Raises FormatError."""
    try:
        with closing(sqlite3.connect(":memory:")) as database:
            database.deserialize(data)
            cursor = database.execute('SELECT * FROM "ActionGroup" ORDER BY "Index"')
            columns = [column[0] for column in cursor.description]
            found = cursor.fetchall()
    except (sqlite3.Error, OverflowError, UnicodeError) as error:
        raise FormatError(f"{source}: this is no action group, which has a table ActionGroup: {error}") from None
    places = {int(match[1]): at for at, name in enumerate(columns) if (match := re.fullmatch(r"Servo(\d+)", name))}
    if "Time" not in columns or not places:
        raise FormatError(
            f"{source}: an action group has columns Time and Servo1, Servo2, ...; this has {listed(columns)}"
        )
    time = columns.index("Time")
    rows = [
        (
            _whole(row[time], "Time", number, source),
            [_whole(row[at], f"Servo{id}", number, source) for id, at in places.items()],
        )
        for number, row in enumerate(found, 1)
    ]
    if not rows:
        raise FormatError(f"{source}: there is no pose in it")
    for number, (way, _) in enumerate(rows[1:], 2):
        if way <= 0:
            raise FormatError(f"{source}: row {number} has {way} ms for its way; a step needs time")
    return _Group(list(places), rows)


def _whole(value: Any, column: str, number: int, source: str) -> int:
    if not isinstance(value, int):
        raise FormatError(f"{source}: {column} of row {number} is {shown(value)}, which is no whole number")
    return value
