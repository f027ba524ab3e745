"""LeRobot's calibration file: one entry per motor, in counts of the servo.

    {"shoulder": {"id": 2, "drive_mode": 0, "homing_offset": 0, "range_min": 205, "range_max": 819}}

These five keys and no others, whole numbers all of them, indented by 4, without a line end at the end: as LeRobot 0.6
reads and writes them. There an angle of 0 is the middle of the range, and drive_mode 1 turns percent round but never
degrees. Source: lerobot 0.6.1, `MotorCalibration` and the buses in lerobot/motors.
"""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

from servobus.core.ids import LAST_ID
from servobus.core.units import deg
from servobus.errors import FormatError
from servobus.families.model import Model
from servobus.robots.axis import Axis
from servobus.robots.file.entries import OPEN_PORT, RobotFile
from servobus.robots.file.kinds import shown
from servobus.robots.file.writing import Key, quantity
from servobus.robots.formats.base import Changes, Draft, Given, Noted, Written, added, json_of, json_or_none, listed
from servobus.robots.formats.servos import (
    angle_row,
    limit_counts,
    named_servos,
    narrowed,
    rounded,
    to_angle,
    written,
)

KEYS = ("id", "drive_mode", "homing_offset", "range_min", "range_max")
LACKS = (
    "A calibration of LeRobot does not say which model a servo is, nor its port, its speed and the gear behind it.",
    "Its 0° is the middle of the range: `servobus robot calibrate` sets a zero that means something.",
)
PORT = "bus"
"""What the one port is called in a new robot file."""


class Calibration(NamedTuple):
    """What LeRobot knows of one motor."""

    id: int
    drive_mode: int
    homing_offset: int
    range_min: int
    range_max: int


def known(data: bytes) -> bool:
    """Tell whether a file is a calibration of LeRobot."""
    said = json_or_none(data)
    return isinstance(said, dict) and any(isinstance(one, dict) and "homing_offset" in one for one in said.values())


def write(file: RobotFile) -> Written:
    """Make a calibration file for LeRobot."""
    servos = named_servos(file)
    made: dict[str, Mapping[str, int]] = {}
    shifted = []
    for one in servos:
        low, high = limit_counts(one, file.name)
        made[one.name] = Calibration(one.servo.id, int(one.servo.axis.direction < 0), 0, low, high)._asdict()
        _, scale = angle_row(one.servo.model, file.name)
        zero = one.servo.axis.to_joint(to_angle(scale, (low + high) / 2))
        if abs(zero) > scale.step:
            shifted.append(f"{one.name} {zero / deg:.1f}°")
    notes = []
    if shifted:
        notes.append(f"LeRobot's 0° is the middle of the range, which is here: {listed(shifted)}")
    if turned := [name for name, values in made.items() if values["drive_mode"]]:
        notes.append(
            f"direction -1 is drive_mode 1, which turns LeRobot's percent but not its degrees: {listed(turned)}"
        )
    if geared := [one.name for one in servos if one.servo.axis.ratio != 1]:
        notes.append(f"LeRobot knows no gear, so its degrees are those of the servo: {listed(geared)}")
    if pairs := [one.name for one in servos if one.name != one.joint.name]:
        notes.append(f"LeRobot has a motor of its own for the second servo of a joint: {listed(pairs)}")
    if wide := list(narrowed(servos, file.name)):
        notes.append(f"limits of more than a turn were cut to one turn: {listed(wide)}")
    return Written(json.dumps(made, indent=4), tuple(notes))


def new(data: bytes, given: Given) -> Draft:
    """Make a robot file out of a calibration; the models of the servos must be said."""
    joints: dict[str, dict[str, Any]] = {}
    for name, one in _read(data, given.source).items():
        joint = given.joint(name)
        model = given.model(joint)
        if model is None:
            raise FormatError(
                f"{given.source}: a calibration of LeRobot does not say what the servo of {joint} is; say it, as in "
                f"--model {joint}=mx28, or --model mx28 for all"
            )
        values = {"port": PORT, "model": model.key(), "id": one.id}
        added(joints, joint, values | _values(given.source, joint, one, model, 1.0), given.source)
    port = given.port(PORT)
    path = port if port is not None else Noted(OPEN_PORT, "not in a calibration: write the path of the port")
    return Draft("a calibration file of LeRobot", {PORT: {"path": path}}, joints, {}, LACKS, ())


def onto(data: bytes, file: RobotFile, given: Given) -> Changes:
    """Take zero, direction and limits of a calibration into a robot file, joint by joint."""
    changes: dict[Key, Any] = {}
    notes, taken = [], []
    for name, one in _read(data, given.source).items():
        joint = file.joints.get(given.joint(name))
        if joint is None:
            notes.append(f"{name} is no joint of {file.name}, so it was left out")
            continue
        if joint.id != one.id:
            raise FormatError(
                f"{given.source}: {name} has id {one.id}, but joint {joint.name} has id {joint.id} in {file.name}; say "
                "which joint it is, as in --joint THEIRS=OURS, or mend the id"
            )
        if joint.mirror is not None:
            notes.append(f"{joint.name} has two servos, whose zeros belong together, so it was left out")
            continue
        values = _values(given.source, joint.name, one, joint.model, joint.ratio)
        changes |= {("joint", joint.name, key): value.value for key, value in values.items()}
        if file.poses or file.motions:
            was, now = quantity(joint.zero, "rad"), values["zero"].value
            if (was, joint.direction) != (now, values["direction"].value):
                notes.append(
                    f"{joint.name} had its zero at {was} of the servo and has it at {now}: poses that name it move"
                )
        taken.append(joint.name)
    if not taken:
        raise FormatError(
            f"{given.source}: none of its motors is a joint of {file.name}, which has {listed(file.joints)}; say which "
            "is which, as in --joint THEIRS=OURS"
        )
    return Changes(changes, {}, tuple(notes), f"zero, direction and limits of {listed(taken)}")


def _values(source: str, joint: str, one: Calibration, model: type[Model], ratio: float) -> dict[str, Noted]:
    """Give zero, direction and limits of a joint, for a servo of this model behind this gear."""
    row, scale = angle_row(model, source)
    least, most = row.limits
    for key, count in (("range_min", one.range_min), ("range_max", one.range_max)):
        if not least <= count <= most:
            raise FormatError(
                f"{source}: {key} of {joint} is {count}, and a {model.title} has counts from {least} to {most}; say "
                f"the model that it is, as in --model {joint}=NAME"
            )
    zero = rounded(to_angle(scale, (one.range_min + one.range_max) / 2))
    direction = -1 if one.drive_mode else 1
    axis = Axis(zero, direction, ratio)
    limits = axis.range_to_joint(to_angle(scale, one.range_min), to_angle(scale, one.range_max))
    values = {
        "zero": Noted(quantity(zero, "rad"), "the middle of the range, as LeRobot counts degrees"),
        "direction": Noted(direction, f"drive_mode {one.drive_mode}"),
        "limits": Noted(written(*limits), f"counts {one.range_min} to {one.range_max}"),
    }
    if one.homing_offset:
        remark = f"homing_offset {one.homing_offset} is in the servo already: its counts have it in them"
        values["limits"] = Noted(values["limits"].value, f"{values['limits'].remark}; {remark}")
    return values


def _read(data: bytes, source: str) -> dict[str, Calibration]:
    """Read a calibration as LeRobot does: these keys, no others, whole numbers. Raises FormatError."""
    said = json_of(data, source)
    if not isinstance(said, dict) or not said:
        raise FormatError(f"{source}: a calibration of LeRobot is a JSON object with an entry per motor")
    read: dict[str, Calibration] = {}
    for name, entry in said.items():
        if not isinstance(entry, dict) or set(entry) != set(KEYS):
            raise FormatError(f"{source}: {shown(name)} must have the keys {listed(KEYS)}, and no others")
        for key, value in entry.items():
            if isinstance(value, bool) or not isinstance(value, int):
                raise FormatError(f"{source}: {key} of {shown(name)} is {shown(value)}, which is no whole number")
        one = Calibration(**entry)
        if not 0 <= one.id <= LAST_ID:
            raise FormatError(f"{source}: the id of {shown(name)} is {one.id}; ids are 0 to {LAST_ID}")
        if one.drive_mode not in (0, 1):
            raise FormatError(f"{source}: drive_mode of {shown(name)} is {one.drive_mode}; LeRobot writes 0 or 1")
        if not one.range_min < one.range_max:
            raise FormatError(
                f"{source}: range_min {one.range_min} of {shown(name)} is not below its range_max {one.range_max}; "
                "calibrate it anew, away from the ends of its counts"
            )
        read[name] = one
    return read
