"""URDF: names, limits and greatest speeds of joints, out and in.

    <joint name="shoulder" type="revolute">
      <parent link="base"/> <child link="shoulder_link"/> <axis xyz="0 0 1"/>
      <limit lower="-1.5708" upper="1.5708" effort="3.7" velocity="2.0944"/>
    </joint>

Angles are in rad, speeds in rad/s, effort in N·m. A joint that mimics another has the limits of that one, times
`multiplier`, plus `offset`. Source: wiki.ros.org/urdf/XML/joint.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from servobus.core.units import show
from servobus.errors import FormatError
from servobus.robots.file.entries import JointEntry, RobotFile
from servobus.robots.file.kinds import shown
from servobus.robots.file.writing import Key, quantity
from servobus.robots.formats.base import Changes, Given, Written, listed, text_of
from servobus.robots.formats.servos import written

TURNS = ("revolute", "continuous")
"""Types of joints that turn about one axis."""
FIXED = ("fixed",)
NARROWER = 1e-6
"""rad from which on limits count as narrower."""


class UrdfJoint(NamedTuple):
    """A joint of a URDF: limits in rad, None where it has none; greatest speed in rad/s, None where it is not said."""

    name: str
    kind: str
    limits: tuple[float, float] | None
    speed: float | None
    mimics: str | None


def known(data: bytes) -> bool:
    """Tell whether a file is a URDF, or the xacro of one."""
    return re.search(rb"<robot[\s>]", data) is not None


# Out


def write(file: RobotFile) -> Written:
    """Make a URDF of the joints of a robot: in joint space, as they stand in the robot file."""
    if not file.joints:
        raise FormatError(f"{file.name}: there is no joint in it, so there is nothing to export")
    root = robot_element(file, {name: (joint, len(joint.servos)) for name, joint in file.joints.items()})
    return Written(xml_text(root), tuple(limit_notes(file, file.joints.values())))


def robot_element(file: RobotFile, joints: Mapping[str, tuple[JointEntry, int]]) -> ET.Element:
    """Make the element <robot>: a link for each joint, all on one base, for a robot file has no shapes.

    `joints` has what each is called, and how many servos drive it.
    """
    root = ET.Element("robot", name=file.robot.name)
    root.append(ET.Comment(" Made by servobus. A robot file has no shapes: put links and origins in their places. "))
    ET.SubElement(root, "link", name="base")
    for name, (joint, servos) in joints.items():
        ET.SubElement(root, "link", name=f"{name}_link")
        element = ET.SubElement(root, "joint", name=name, type="revolute")
        ET.SubElement(element, "parent", link="base")
        ET.SubElement(element, "child", link=f"{name}_link")
        ET.SubElement(element, "axis", xyz="0 0 1")
        low, high = joint.range
        sheet = joint.model.sheet
        effort = (sheet.stall_torque or 0.0) * joint.ratio * servos
        speed = joint.speed or (sheet.speed or 0.0) / joint.ratio
        limit = {"lower": low, "upper": high, "effort": effort, "velocity": speed}
        ET.SubElement(element, "limit", {key: number(value) for key, value in limit.items()})
    return root


def limit_notes(file: RobotFile, joints: Iterable[JointEntry]) -> Iterator[str]:
    """Say where efforts and speeds are from."""
    told = list(joints)
    yield "effort is the stall torque of the data sheet; a simulation may want less"
    if unsaid := [joint.name for joint in told if joint.speed is None]:
        yield f"{file.name} has no greatest speed of these, so velocity is that of the data sheet: {listed(unsaid)}"
    if none := [
        joint.name
        for joint in told
        if not joint.model.sheet.stall_torque or not (joint.speed or joint.model.sheet.speed)
    ]:
        yield f"no data sheet tells torque or speed of these, so 0 stands there: {listed(none)}"
    yield "all joints sit on one base: a robot file has no shapes, so put links and origins in their places"


def number(value: float) -> str:
    """Write a number to six places."""
    return f"{value + 0.0:.6f}".rstrip("0").rstrip(".") if abs(value) >= 5e-7 else "0"


def xml_text(root: ET.Element) -> str:
    """Give the text of a document."""
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'


# In


def onto(data: bytes, file: RobotFile, given: Given) -> Changes:
    """Take limits and greatest speeds of a URDF into a robot file, joint by joint."""
    joints = read(data, given.source)
    changes: dict[Key, Any] = {}
    notes: list[str] = []
    limited, sped, left = [], [], []
    for one in joints.values():
        entry = file.joints.get(given.called(one.name) or one.name)
        if entry is None:
            if one.kind not in FIXED:
                left.append(one.name)
            continue
        if one.kind not in TURNS:
            notes.append(
                f"{one.name} is {one.kind} in the URDF, and a joint here turns about an axis, so it was left out"
            )
            continue
        if one.mimics is not None:
            notes.append(
                f"{one.name} mimics {one.mimics} in the URDF; here it moves by itself, unless it is written as "
                f"[joint.{one.mimics}.mirror]"
            )
        if one.limits is not None:
            can = replace(entry, limits=None).range
            changes[("joint", entry.name, "limits")] = written(*within(entry.name, can, one.limits, notes))
            limited.append(entry.name)
        elif entry.limits is not None:
            notes.append(f"{one.name} has no limits in the URDF; those of {file.name} stay")
        if one.speed is not None:
            changes[("joint", entry.name, "speed")] = quantity(one.speed, "rad/s")
            sped.append(entry.name)
    if not changes:
        raise FormatError(
            f"{given.source}: there is nothing in it about a joint of {file.name}; it has {listed(joints) or 'none'}, "
            f"and {file.name} has {listed(file.joints)}; say which is which, as in --joint THEIRS=OURS"
        )
    if left:
        notes.append(f"these are no joints of {file.name}, so they were left out: {listed(left)}")
    said = [f"limits of {listed(limited)}"] * bool(limited) + [f"speed of {listed(sped)}"] * bool(sped)
    return Changes(changes, {}, tuple(notes), " and ".join(said))


def within(
    joint: str, range_: tuple[float, float], limits: tuple[float, float], notes: list[str]
) -> tuple[float, float]:
    """Give limits as far as the servos of a joint can be sent there. Raises FormatError where they cannot at all."""
    least, most = range_
    low, high = max(limits[0], least), min(limits[1], most)
    told = f"{show(limits[0], 'rad')} .. {show(limits[1], 'rad')}"
    can = f"{show(least, 'rad')} .. {show(most, 'rad')}"
    if not low < high:
        raise FormatError(
            f"{joint}: the URDF allows {told}, and with this zero, direction and ratio the servo can go to {can}; "
            "look at the zero of the joint"
        )
    if low > limits[0] + NARROWER or high < limits[1] - NARROWER:
        notes.append(f"{joint}: the URDF allows {told}, and the servo can go to {can}, so what both allow was taken")
    return low, high


def read(data: bytes, source: str) -> dict[str, UrdfJoint]:
    """Read the joints of a URDF. Raises FormatError for what is none, and for xacro."""
    raw = {str(element.get("name")): element for element in root_of(data, source).findall("joint")}
    return {name: _joint(name, raw, source, ()) for name in raw}


def root_of(data: bytes, source: str) -> ET.Element:
    """Give the element <robot> of a URDF. Raises FormatError for what is none, and for xacro."""
    text = text_of(data, source)
    try:
        root = ET.fromstring(text)  # noqa: S314 - expat bounds what entities may grow to
    except ET.ParseError as error:
        raise FormatError(f"{source}: this is no XML: {error}") from None
    if any("}" in element.tag and "xacro" in element.tag for element in root.iter()):
        raise FormatError(f"{source}: this is xacro, whose macros ROS expands; run `xacro {source} > arm.urdf` first")
    if root.tag != "robot":
        raise FormatError(f"{source}: a URDF begins with <robot>, and this begins with <{root.tag}>")
    return root


def _joint(name: str, raw: Mapping[str, ET.Element], source: str, before: tuple[str, ...]) -> UrdfJoint:
    element = raw[name]
    kind = str(element.get("type"))
    limit, mimic = element.find("limit"), element.find("mimic")
    speed = None if limit is None else _value(limit, "velocity", name, source, None)
    limits = None
    if limit is not None and kind != "continuous" and ("lower" in limit.attrib or "upper" in limit.attrib):
        low, high = (_value(limit, end, name, source, 0.0) or 0.0 for end in ("lower", "upper"))
        if not low < high and kind in TURNS and mimic is None:
            raise FormatError(
                f"{source}: the limits of {name} are {low:g} to {high:g} rad; the lower must be below the upper"
            )
        limits = (low, high) if low < high else None
    if mimic is None:
        return UrdfJoint(name, kind, limits, speed or None, None)
    other = str(mimic.get("joint"))
    if other not in raw or other in before:
        raise FormatError(f"{source}: {name} mimics {shown(other)}, which is no other joint of it")
    led = _joint(other, raw, source, (*before, name))
    times = _value(mimic, "multiplier", name, source, 1.0) or 0.0
    plus = _value(mimic, "offset", name, source, 0.0) or 0.0
    if led.limits is not None and times:
        ends = sorted(times * end + plus for end in led.limits)
        low, high = limits or (-math.inf, math.inf)
        limits = (max(low, ends[0]), min(high, ends[1]))
    return UrdfJoint(name, kind, limits, speed or (abs(times) * led.speed if led.speed else None) or None, other)


def _value(element: ET.Element, key: str, name: str, source: str, default: float | None) -> float | None:
    text = element.get(key)
    if text is None:
        return default
    if "${" in text:
        raise FormatError(f"{source}: this is xacro, whose macros ROS expands; run `xacro {source} > arm.urdf` first")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{source}: {key} of {name} is {shown(text)}, which is no number")
    return value
