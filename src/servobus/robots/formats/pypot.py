"""pypot's robot configuration: controllers, groups and motors, in degrees.

    {"controllers": {"arm": {"port": "auto", "sync_read": false, "attached_motors": ["base"], "protocol": 1}},
     "motorgroups": {"base": ["m1"]},
     "motors": {"m1": {"id": 1, "type": "RX-28", "orientation": "direct", "offset": 0.0, "angle_limit": [-90, 90]}}}

The servo is at 0° in the middle of its counts. The offset is an angle of the joint, after the sign; the limits are
angles of the servo, before the sign:

    joint = servo - offset        "orientation": "direct"
    joint = -servo - offset       any other orientation

Source: pypot 5.0.2, robot/config.py, dynamixel/motor.py and dynamixel/conversion.py.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from servobus.core.ids import LAST_ID
from servobus.core.units import finite
from servobus.errors import FormatError
from servobus.families import registry
from servobus.families.model import Model
from servobus.robots.axis import Axis
from servobus.robots.file.entries import OPEN_PORT, RobotFile
from servobus.robots.file.kinds import shown
from servobus.robots.file.writing import quantity
from servobus.robots.formats.base import (
    Draft,
    Given,
    Noted,
    Written,
    added,
    json_of,
    json_or_none,
    listed,
    plain_name,
)
from servobus.robots.formats.servos import (
    NamedServo,
    angle_row,
    device,
    limit_counts,
    named_servos,
    rounded,
    to_angle,
    to_count,
    written,
)

TYPES = {
    "AX-12": "ax12a",
    "AX-18": "ax18a",
    "RX-24": "rx24f",
    "RX-28": "rx28",
    "RX-64": "rx64",
    "MX-12": "mx12w",
    "MX-28": "mx28",
    "MX-64": "mx64",
    "MX-106": "mx106",
}
"""What pypot calls a model -> what it is called here; it knows no others that are here."""
BAUD = 1_000_000
"""bit/s at which pypot speaks, whatever the servos are set to."""
TURN, REST = ("MX", 360.0), 300.0
"""Degrees that all counts of a servo are to pypot, of those whose type begins so, and of the others."""
PLACES = 4
MOST = 1e5
"""Degrees beyond which a number is no angle any more."""
LACKS = (
    "A configuration of pypot has no speed of the bus: pypot speaks at 1 Mbit/s.",
    "It has no greatest speed of a joint, no gear, no poses and no motions.",
)


def known(data: bytes) -> bool:
    """Tell whether a file is a configuration of pypot."""
    said = json_or_none(data)
    return isinstance(said, dict) and {"controllers", "motors"} <= said.keys()


def write(file: RobotFile) -> Written:
    """Make a configuration for pypot, of the Dynamixel servos that it knows."""
    types = {key: kind for kind, key in TYPES.items()}
    servos = named_servos(file)
    mine = [one for one in servos if one.servo.model.key() in types]
    if not mine:
        raise FormatError(f"{file.name}: pypot drives none of its servos; it knows {listed(TYPES)}")
    config = {
        "controllers": {
            port: {
                "port": device(file.ports[port].path) or "auto",
                "sync_read": False,
                "attached_motors": [one.name for one in mine if one.servo.port == port],
                "protocol": 1,
            }
            for port in dict.fromkeys(one.servo.port for one in mine)
        },
        "motorgroups": dict(_groups(file, mine)),
        "motors": {one.name: _motor(file, one, types[one.servo.model.key()]) for one in mine},
    }
    return Written(json.dumps(config, indent=4) + "\n", tuple(_notes(servos, mine)))


def _motor(file: RobotFile, one: NamedServo, kind: str) -> dict[str, Any]:
    row, scale = angle_row(one.servo.model, file.name)
    axis = one.servo.axis
    zero = _degrees(to_count(scale, axis.zero), kind, row.limits[1])
    return {
        "id": one.servo.id,
        "type": kind,
        "orientation": "direct" if axis.direction > 0 else "indirect",
        "offset": round(axis.direction * zero, PLACES) + 0.0,
        "angle_limit": [
            round(_degrees(count, kind, row.limits[1]), PLACES) + 0.0 for count in limit_counts(one, file.name)
        ],
    }


def _groups(file: RobotFile, mine: Sequence[NamedServo]) -> Iterator[tuple[str, list[str]]]:
    for group, joints in file.groups.items():
        motors = [one.name for one in mine if one.joint.name in joints]
        if motors:
            yield group, motors


def _notes(servos: Sequence[NamedServo], mine: Sequence[NamedServo]) -> Iterator[str]:
    if others := [f"{one.name} ({one.servo.model.title})" for one in servos if one not in mine]:
        yield f"pypot knows nothing of these servos, so they are left out: {listed(others)}"
    if slow := [f"{one.name} ({one.baud} bit/s)" for one in mine if one.baud != BAUD]:
        yield f"pypot speaks at {BAUD} bit/s: set the speed of {listed(slow)} with `servobus set-baud` first"
    if geared := [one.name for one in mine if one.servo.axis.ratio != 1]:
        yield f"pypot knows no gear, so its angles are those of the servo: {listed(geared)}"
    if pairs := [one.name for one in mine if one.name != one.joint.name]:
        yield f"pypot moves the second servo of a joint by itself, so send both the same goals: {listed(pairs)}"
    yield "pypot writes angle_limit and a return delay of 0 into the servos when it loads this"


def new(data: bytes, given: Given) -> Draft:
    """Make a robot file out of a configuration of pypot."""
    said = json_of(data, given.source)
    for table in ("controllers", "motorgroups", "motors"):
        if not isinstance(said, dict) or not isinstance(said.get(table), dict):
            raise FormatError(f"{given.source}: a configuration of pypot has a table {table}, and this has none")
    source, motors, groups = given.source, said["motors"], said["motorgroups"]
    ports: dict[str, dict[str, Any]] = {}
    joints: dict[str, dict[str, Any]] = {}
    notes = []
    for controller, values in said["controllers"].items():
        names = [
            name for attached in _names(values, "attached_motors", source) for name in _flat(groups, attached, source)
        ]
        foreign = isinstance(values, dict) and values.get("protocol", 1) != 1
        mine = {name: _entry(motors, name, source) for name in names}
        strangers = [name for name, entry in mine.items() if foreign or _model(entry) is None]
        if strangers:
            kinds = (f"{name} ({_entry(motors, name, source).get('type')})" for name in strangers)
            notes.append(f"servobus does not drive these servos, so they are left out: {listed(kinds)}.")
        port = plain_name(controller)
        taken = {given.joint(name): entry for name, entry in mine.items() if name not in strangers}
        if taken:
            added(ports, port, {"path": _path(given, port, values.get("port"))}, source)
        for joint, entry in taken.items():
            model = _model(entry)
            assert model is not None  # those without were left out
            made = {"port": port, "model": model.key(), **_joint(source, joint, entry, model)}
            added(joints, joint, made, source)
    if not joints:
        raise FormatError(
            f"{source}: servobus drives none of its servos; it knows {listed(TYPES)} of those that pypot does"
        )
    if "sensors" in said:
        notes.append("Its sensors are left out: a robot file has joints alone.")
    left = (
        (plain_name(group), tuple(dict.fromkeys(given.joint(name) for name in _flat(groups, group, source))))
        for group in groups
    )
    members = {group: tuple(name for name in names if name in joints) for group, names in left if group not in joints}
    return Draft(
        "a configuration of pypot",
        ports,
        joints,
        {group: names for group, names in members.items() if names},
        LACKS,
        tuple(notes),
    )


def _joint(source: str, name: str, entry: Mapping[str, Any], model: type[Model]) -> dict[str, Any]:
    row, scale = angle_row(model, source)
    kind, most = str(entry["type"]), row.limits[1]
    direction = 1 if entry.get("orientation") == "direct" else -1
    offset = _number(entry, "offset", name, source)
    zero = rounded(to_angle(scale, _count(direction * offset, kind, most)))
    id = entry.get("id")
    if isinstance(id, bool) or not isinstance(id, int) or not 0 <= id <= LAST_ID:
        raise FormatError(f"{source}: the id of {shown(name)} is {shown(id)}; ids are 0 to {LAST_ID}")
    values: dict[str, Any] = {
        "id": id,
        "baud": BAUD,
        "zero": Noted(quantity(zero, "rad"), f"offset {offset:g}°, after the sign"),
        "direction": Noted(direction, f"orientation {shown(entry.get('orientation'))}"),
    }
    if entry.get("wheel_mode"):
        values["limits"] = Noted(None, "wheel_mode, which a joint has not: this servo turns without end in pypot")
    else:
        low, high = _limits(entry, name, source)
        counts = [min(max(round(_count(end, kind, most)), row.limits[0]), most) for end in (low, high)]
        if not counts[0] < counts[1]:
            raise FormatError(
                f"{source}: angle_limit of {shown(name)} is {low:g}° to {high:g}°, and a {model.title} has "
                f"{_degrees(row.limits[0], kind, most):g}° to {_degrees(most, kind, most):g}°"
            )
        ends = Axis(zero, direction).range_to_joint(*(to_angle(scale, count) for count in counts))
        values["limits"] = Noted(written(*ends), f"angle_limit {low:g}° to {high:g}°, of the servo")
    if entry.get("broken"):
        values["id"] = Noted(id, "pypot has it as broken")
    return values


def _path(given: Given, port: str, said: Any) -> Any:
    path = given.port(port)
    if path is not None:
        return path
    if isinstance(said, str) and said and said != "auto":
        return said
    return Noted(OPEN_PORT, f"{shown(said)} in pypot: write the path of the port")


def _model(entry: Mapping[str, Any]) -> type[Model] | None:
    """Find the model of a motor; None if it is none that is driven here."""
    key = TYPES.get(str(entry.get("type")))
    return None if key is None else registry.model(key)


def _entry(motors: Mapping[str, Any], name: str, source: str) -> Mapping[str, Any]:
    entry = motors.get(name)
    if not isinstance(entry, dict):
        raise FormatError(
            f"{source}: {shown(name)} is attached to a controller, but is no motor; there are {listed(motors)}"
        )
    return entry


def _flat(groups: Mapping[str, Any], name: str, source: str, inside: tuple[str, ...] = ()) -> list[str]:
    """Give the motors of a group, or the motor of this name: groups stand in groups."""
    if name in inside:
        raise FormatError(f"{source}: the group {shown(name)} is in itself")
    if name not in groups:
        return [name]
    names = _names(groups, name, source)
    return list(chain.from_iterable(_flat(groups, one, source, (*inside, name)) for one in names))


def _names(table: Any, key: str, source: str) -> list[str]:
    names = table.get(key) if isinstance(table, dict) else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise FormatError(f"{source}: {shown(key)} must be a list of names, and is {shown(names)}")
    return names


def _number(entry: Mapping[str, Any], key: str, name: str, source: str) -> float:
    number = finite(entry.get(key))
    if number is None or abs(number) > MOST:
        raise FormatError(f"{source}: {key} of {shown(name)} is {shown(entry.get(key))}, which is no number of degrees")
    return float(number)


def _limits(entry: Mapping[str, Any], name: str, source: str) -> tuple[float, float]:
    ends = entry.get("angle_limit")
    numbers = [finite(end) for end in ends] if isinstance(ends, list) else []
    if len(numbers) != 2 or numbers[0] is None or numbers[1] is None or not -MOST < numbers[0] < numbers[1] < MOST:
        raise FormatError(
            f"{source}: angle_limit of {shown(name)} is {shown(ends)}; it has the lower limit first, then the upper, "
            "in degrees of the servo"
        )
    return float(numbers[0]), float(numbers[1])


def _span(kind: str) -> float:
    return TURN[1] if kind.startswith(TURN[0]) else REST


def _degrees(count: float, kind: str, most: int) -> float:
    """Turn counts of a servo into pypot's degrees of the servo."""
    return count * _span(kind) / most - _span(kind) / 2


def _count(degrees: float, kind: str, most: int) -> float:
    """Turn pypot's degrees of a servo into its counts, not rounded."""
    return (degrees + _span(kind) / 2) * most / _span(kind)
