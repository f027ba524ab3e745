"""URDF with the <ros2_control> tags of the hardware interface dynamixel_hardware: its joints and their servos.

    joint = (servo - middle) / gear_ratio - offset

gear_ratio is negative where the joint turns against its servo, offset is in rad of the joint. The middle is count 512
of 1024, and 2048 of 4096. Source: dynamixel_hardware of 2026, its tests of gear_ratio and offset, and its guide of
migration; earlier ones know neither parameter. Its successor dynamixel_hardware_interface speaks protocol 2.0 alone.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence

from servobus.robots.file.entries import RobotFile
from servobus.robots.formats.base import Written, listed
from servobus.robots.formats.servos import NamedServo, dynamixels, middle, one_speed, port_notes
from servobus.robots.formats.urdf import limit_notes, number, robot_element, xml_text

PLUGIN = "dynamixel_hardware/DynamixelHardware"


def write(file: RobotFile) -> Written:
    """Make a URDF with a <ros2_control> tag for each port, of the Dynamixel servos of a robot."""
    mine, left = dynamixels(file, "dynamixel_hardware")
    root = robot_element(file, {one.name: (one.joint, 1) for one in mine})
    for port in dict.fromkeys(one.servo.port for one in mine):
        _system(root, file, port, [one for one in mine if one.servo.port == port])
    return Written(xml_text(root), (*left, *_notes(file, mine)))


def _system(root: ET.Element, file: RobotFile, port: str, there: Sequence[NamedServo]) -> None:
    system = ET.SubElement(root, "ros2_control", name=f"{file.robot.name}_{port}", type="system")
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
