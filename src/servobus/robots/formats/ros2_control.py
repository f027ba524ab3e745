"""URDF with the <ros2_control> tags of the hardware interface dynamixel_hardware: joints and servos, both ways.

    joint = (servo - middle) / gear_ratio - offset

gear_ratio is negative where the joint turns against its servo, offset is in rad of the joint. The middle is count 512
of 1024, and 2048 of 4096. Source: dynamixel_hardware of 2026, its tests of gear_ratio and offset, and its guide of
migration; earlier ones know neither parameter. Its successor dynamixel_hardware_interface speaks protocol 2.0 alone.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from typing import Any

from servobus.core.ids import LAST_ID
from servobus.core.units import finite
from servobus.errors import FormatError
from servobus.families.model import Model
from servobus.robots.axis import Axis
from servobus.robots.file.entries import OPEN_PORT, RobotFile
from servobus.robots.file.kinds import shown
from servobus.robots.file.writing import quantity
from servobus.robots.formats.base import Draft, Given, Noted, Written, added, listed, plain_name
from servobus.robots.formats.servos import (
    DYNAMIXEL,
    NamedServo,
    dynamixels,
    middle,
    one_speed,
    port_notes,
    rounded,
    written,
)
from servobus.robots.formats.urdf import (
    UrdfJoint,
    limit_notes,
    number,
    read,
    robot_element,
    root_of,
    within,
    xml_text,
)

PLUGIN = "dynamixel_hardware/DynamixelHardware"
TAG = "ros2_control"
PORTS = ("port_name", "usb_port")
"""Parameters that name the port: of 2026, and before."""
TAKEN = ("id", "gear_ratio", "offset")
"""Parameters of a joint that a robot file says too."""
LACKS = ("Such a URDF does not say the models of servos.", "It has no groups, no poses and no motions.")


def known(data: bytes) -> bool:
    """Tell whether a file is a URDF with tags of dynamixel_hardware."""
    return b"<ros2_control" in data and PLUGIN.encode() in data


# Out


def write(file: RobotFile) -> Written:
    """Make a URDF with a <ros2_control> tag for each port, of the Dynamixel servos of a robot."""
    mine, left = dynamixels(file, "dynamixel_hardware")
    root = robot_element(file, {one.name: (one.joint, 1) for one in mine})
    for port in dict.fromkeys(one.servo.port for one in mine):
        _system(root, file, port, [one for one in mine if one.servo.port == port])
    return Written(xml_text(root), (*left, *_notes(file, mine)))


def _system(root: ET.Element, file: RobotFile, port: str, there: Sequence[NamedServo]) -> None:
    system = ET.SubElement(root, TAG, name=f"{file.robot.name}_{port}", type="system")
    hardware = ET.SubElement(system, "hardware")
    ET.SubElement(hardware, "plugin").text = PLUGIN
    _parameter(hardware, "port_name", file.ports[port].path)
    _parameter(hardware, "baud_rate", str(one_speed(file, port, there)))
    for one in there:
        axis = one.servo.axis
        joint = ET.SubElement(system, "joint", name=one.name)
        _parameter(joint, "id", str(one.servo.id))
        _parameter(joint, "gear_ratio", number(axis.direction * axis.ratio))
        _parameter(joint, "offset", number(-axis.to_joint(middle(one.servo.model, file.name))))
        ET.SubElement(joint, "command_interface", name="position")
        for state in ("position", "velocity", "effort"):
            ET.SubElement(joint, "state_interface", name=state)


def _parameter(parent: ET.Element, name: str, value: str) -> None:
    ET.SubElement(parent, "param", name=name).text = value


def _notes(file: RobotFile, mine: Sequence[NamedServo]) -> Iterator[str]:
    if pairs := [f"{one.joint.name} and {one.name}" for one in mine if one.name != one.joint.name]:
        yield f"nothing there keeps the two servos of a joint together, so send both the same goals: {listed(pairs)}"
    if any(one.servo.axis.direction < 0 or one.servo.axis.ratio != 1 for one in mine):
        yield "gear_ratio and offset need dynamixel_hardware of 2026; earlier ones ignore both, and joints turn wrong"
    yield from limit_notes(file, {one.joint.name: one.joint for one in mine}.values())
    yield from port_notes(file, (one.servo.port for one in mine))


# In


def new(data: bytes, given: Given) -> Draft:
    """Make a robot file of the servos of dynamixel_hardware, with the limits and speeds of the joints of the URDF."""
    source = given.source
    root, joints_there = root_of(data, source), read(data, source)
    ports: dict[str, dict[str, Any]] = {}
    joints: dict[str, dict[str, Any]] = {}
    notes: list[str] = []
    for system in root.findall(TAG):
        plugin = (system.findtext("hardware/plugin") or "").strip()
        if plugin != PLUGIN:
            notes.append(f"The tag {shown(system.get('name'))} is of {shown(plugin)}, so it was left out.")
            continue
        said = _parameters(system.find("hardware"))
        path = next((said[key] for key in PORTS if key in said), None)
        port = _port(path, given, ports)
        baud = int(said["baud_rate"]) if said.get("baud_rate", "").isdecimal() else None
        for element in system.findall("joint"):
            name = given.joint(str(element.get("name")))
            values = {"port": port, "baud": baud or Noted(None, "the URDF has no baud_rate, so its speed is open")}
            there = joints_there.get(str(element.get("name")))
            added(joints, name, values | _joint(name, _parameters(element), there, given, notes), source)
    if not joints:
        raise FormatError(f"{source}: there is no joint of {PLUGIN} in it")
    return Draft("a URDF with the tags of dynamixel_hardware", ports, joints, {}, LACKS, tuple(notes))


def _parameters(element: ET.Element | None) -> dict[str, str]:
    if element is None:
        return {}
    return {str(one.get("name")): (one.text or "").strip() for one in element.findall("param")}


def _port(path: str | None, given: Given, ports: dict[str, dict[str, Any]]) -> str:
    """Give the name of a port in the robot file, and enter it there."""
    name = "bus" if path is None else plain_name(path)
    said = given.port(name) or path
    entry = {"path": Noted(OPEN_PORT, "not in the URDF: write the path of the port") if said is None else said}
    if name in ports and ports[name]["path"] != said:
        raise FormatError(
            f"{given.source}: two of its ports would be called {name} in a robot file; rename one of them"
        )
    ports[name] = entry
    return name


def _joint(name: str, said: dict[str, str], there: UrdfJoint | None, given: Given, notes: list[str]) -> dict[str, Any]:
    """Give the keys of a joint but for its port and speed."""
    source = given.source
    model = _model(name, given)
    if not said.get("id", "").isdecimal() or int(said["id"]) > LAST_ID:
        raise FormatError(f"{source}: the id of {name} is {shown(said.get('id'))}; ids are 0 to {LAST_ID}")
    turns, offset = _number(name, said, "gear_ratio", 1.0, source), _number(name, said, "offset", 0.0, source)
    if turns == 0:
        raise FormatError(f"{source}: the gear_ratio of {name} is 0, and so nothing would turn")
    zero = rounded(middle(model, source) + turns * offset)
    axis = Axis(zero, 1 if turns > 0 else -1, abs(turns))
    values: dict[str, Any] = {
        "model": model.key(),
        "id": int(said["id"]),
        "zero": Noted(quantity(zero, "rad"), f"offset {offset:g} rad, from the middle of the servo"),
        "direction": Noted(axis.direction, f"gear_ratio {turns:g}"),
    }
    if axis.ratio != 1:
        values["ratio"] = axis.ratio
    if there is not None and there.limits is not None:
        row = model.register("goal_position")
        low, high = (float(row.decode(raw)) for raw in row.limits)
        values["limits"] = written(*within(name, axis.range_to_joint(low, high), there.limits, notes))
    if there is not None and there.speed is not None:
        values["speed"] = quantity(there.speed, "rad/s")
    if left := [key for key in said if key not in TAKEN]:
        notes.append(f"{name} has parameters that were left out, for they are raw values of registers: {listed(left)}.")
    return values


def _model(name: str, given: Given) -> type[Model]:
    model = given.model(name)
    if model is None:
        raise FormatError(
            f"{given.source}: a URDF does not say what the servo of {name} is; say it, as in --model {name}=mx28, or "
            "--model mx28 for all"
        )
    if model.family.name != DYNAMIXEL:
        raise FormatError(
            f"{given.source}: dynamixel_hardware drives Dynamixel servos alone; {name} is said to be a {model.title}"
        )
    return model


def _number(name: str, said: dict[str, str], key: str, default: float, source: str) -> float:
    try:
        value = finite(float(said.get(key, default)))
    except ValueError:
        value = math.nan
    if value is None or math.isnan(value):
        raise FormatError(f"{source}: {key} of {name} is {shown(said[key])}, which is no number")
    return value
