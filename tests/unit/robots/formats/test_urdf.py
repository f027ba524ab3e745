"""URDF and ros2_control: limits in and out, and the parameters that make dynamixel_hardware turn joints as we do."""

import xml.etree.ElementTree as ET

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import extent
from servobus import FormatError
from servobus.core.units import deg, parse
from servobus.robots.file.reading import read_text
from servobus.robots.file.writing import edited
from servobus.robots.formats import ros2_control, urdf
from servobus.robots.formats.base import ALL, Given
from servobus.robots.formats.draft import draft_text
from unit.robots.arms import JOINTS, SIX

LIMIT = '<limit lower="-1.0" upper="0.5" effort="3" velocity="2.0"/>'


def joint(name: str, inside: str = LIMIT, kind: str = "revolute") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="a"/><child link="b"/>{inside}</joint>'


def robot(*joints: str) -> bytes:
    return f'<?xml version="1.0"?><robot name="r">{"".join(joints)}</robot>'.encode()


def onto(data: bytes, **names: str) -> tuple[str, str]:
    """Give the text of the robot file after it, and the notes."""
    file = read_text(SIX)
    changes = urdf.onto(data, file, Given("arm.urdf", joints=names))
    return edited(file, changes.changes), " ".join(changes.notes)


def test_limits_and_speeds_come_in() -> None:
    text, notes = onto(robot(joint("base"), joint("camera"), joint("plate", "", "fixed")))
    file = read_text(text)
    assert file.joints["base"].limits == pytest.approx((-1.0, 0.5), abs=2e-6)
    assert file.joints["base"].speed == pytest.approx(2.0, abs=2e-6)
    assert file.joints["wrist"] == read_text(SIX).joints["wrist"]
    assert "camera" in notes
    assert "plate" not in notes


def test_limits_beyond_the_servo_are_cut_and_told() -> None:
    wide = '<limit lower="-3" upper="3" effort="1" velocity="0"/>'
    text, notes = onto(robot(joint("base", wide)))
    # zero 150° of 0 .. 300°
    assert read_text(text).joints["base"].limits == pytest.approx((-150 * deg, 150 * deg), abs=2e-6)
    assert read_text(text).joints["base"].speed == pytest.approx(120 * deg)  # velocity 0 says nothing
    assert "-171.9°" in notes


def test_names_can_be_matched() -> None:
    text, _ = onto(robot(joint("joint 1")), **{"joint 1": "wrist"})
    assert read_text(text).joints["wrist"].limits == pytest.approx((-1.0, 0.5), abs=2e-6)


def test_a_mimic_joint_has_the_limits_of_the_other() -> None:
    mimic = '<mimic joint="base" multiplier="-2" offset="0.1"/>'
    read = urdf.read(robot(joint("base"), joint("turn", mimic)), "arm.urdf")
    assert read["turn"].limits == pytest.approx((-0.9, 2.1))  # -2 * 0.5 + 0.1, -2 * -1 + 0.1
    assert read["turn"].speed == pytest.approx(4.0)
    _, notes = onto(robot(joint("base"), joint("turn", mimic)))
    assert "turn mimics base" in notes


def test_joints_without_limits_and_of_other_kinds() -> None:
    text, notes = onto(robot(joint("base"), joint("wrist", "", "continuous"), joint("grip", LIMIT, "prismatic")))
    file = read_text(text)
    assert file.joints["wrist"].limits == read_text(SIX).joints["wrist"].limits
    assert file.joints["grip"] == read_text(SIX).joints["grip"]
    assert "wrist has no limits" in notes
    assert "grip is prismatic" in notes


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"<robot", "no XML"),
        (b"<sdf></sdf>", "begins with <robot>"),
        (b'<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="a"/></robot>', "xacro arm.urdf >"),
        (robot(joint("base", '<limit lower="${-pi}" upper="1" effort="1" velocity="1"/>')), "xacro arm.urdf >"),
        (robot(joint("base", '<limit lower="1" upper="-1" effort="1" velocity="1"/>')), "lower must be below"),
        (robot(joint("base", '<limit lower="x" upper="1" effort="1" velocity="1"/>')), "no number"),
        (robot(joint("base", '<limit lower="nan" upper="1" effort="1" velocity="1"/>')), "no number"),
        (robot(joint("j1")), "--joint"),
        (robot(joint("base", '<limit lower="2.7" upper="3" effort="1" velocity="1"/>')), "look at the zero"),
        (robot(joint("base", '<mimic joint="base"/>')), "no other joint"),
    ],
)
def test_a_wrong_one_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(FormatError, match=words):
        onto(data)


def test_joints_go_out_in_joint_space() -> None:
    file = read_text(SIX)
    made = urdf.write(file)
    joints = {one.get("name"): one for one in ET.fromstring(made.text).findall("joint")}
    assert tuple(joints) == JOINTS
    limit = joints["lift"].find("limit")
    assert limit is not None
    assert float(limit.attrib["lower"]) == pytest.approx(-60 * deg, abs=1e-6)
    assert float(limit.attrib["upper"]) == pytest.approx(80 * deg, abs=1e-6)
    assert float(limit.attrib["velocity"]) == pytest.approx(90 * deg, abs=1e-6)
    links = {one.get("name") for one in ET.fromstring(made.text).findall("link")}
    assert {f"{name}_link" for name in JOINTS} < links


@settings(deadline=None, max_examples=200 if extent.everything else 15)
@given(low=st.integers(-1200, -1), high=st.integers(1, 1200))
def test_limits_there_and_back(low: int, high: int) -> None:
    text = SIX.replace('["-120deg", "120deg"]', f'["{low / 10}deg", "{high / 10}deg"]')
    file = read_text(text)
    changes = urdf.onto(urdf.write(file).text.encode(), file, Given("arm.urdf"))
    limits = [parse(end, "rad") for end in changes.changes["joint", "base", "limits"]]
    assert limits == pytest.approx([low / 10 * deg, high / 10 * deg], abs=3e-6)


def test_dynamixel_hardware_turns_joints_as_the_robot_file_says() -> None:
    """Its rule: joint = (servo - middle) / gear_ratio - offset, the middle of an RX-28 at count 512."""
    geared = SIX.replace('zero = "120deg"', 'zero = "120deg"\nratio = 2.0')
    file = read_text(geared.replace('["-60deg", "80deg"]', '["-60deg", "60deg"]'))
    root = ET.fromstring(ros2_control.write(file).text)
    system = root.find("ros2_control")
    assert system is not None
    hardware = {one.get("name"): one.text for one in system.iterfind("hardware/param")}
    assert hardware["baud_rate"] == "57600"
    said = {
        str(one.get("name")): {str(parameter.get("name")): str(parameter.text) for parameter in one.iterfind("param")}
        for one in system.iterfind("joint")
    }
    assert list(said) == ["base", "lift", "lift_mirror"]
    assert [one["id"] for one in said.values()] == ["1", "2", "3"]
    middle = 512 * 300 / 1023
    for name, zero, turns in (("base", 150, 1.0), ("lift", 120, -2.0), ("lift_mirror", 170, 2.0)):
        ratio, offset = float(said[name]["gear_ratio"]), float(said[name]["offset"])
        assert ratio == turns
        for servo in (10.0, 150.0, 290.0):
            assert (servo - middle) * deg / ratio - offset == pytest.approx((servo - zero) * deg / turns, abs=1e-5)


def test_a_robot_without_a_dynamixel_is_refused() -> None:
    text = '[robot]\nformat = 1\n[port.p]\npath = "x"\n[joint.a]\nport = "p"\nmodel = "lx16a"\nid = 1\n'
    with pytest.raises(FormatError, match="Dynamixel servos alone"):
        ros2_control.write(read_text(text))


# Coming in

CONTROL = """\
<ros2_control name="arm" type="system">
  <hardware>
    <plugin>dynamixel_hardware/DynamixelHardware</plugin>
    <param name="port_name">/dev/ttyUSB0</param>
    <param name="baud_rate">1000000</param>
  </hardware>
  <joint name="base">
    <param name="id">3</param>
    <param name="gear_ratio">-2.0</param>
    <param name="offset">0.25</param>
    <param name="Profile_Velocity">100</param>
    <command_interface name="position"/>
  </joint>
  <joint name="tip"><param name="id">4</param></joint>
</ros2_control>
"""


def taken(data: bytes, **models: str) -> tuple[str, str]:
    draft = ros2_control.new(data, Given("arm.urdf", models=models or {ALL: "mx28"}))
    return draft_text(draft, "arm"), " ".join(draft.notes)


def test_servos_of_dynamixel_hardware_come_in() -> None:
    text, notes = taken(robot(joint("base"), CONTROL))
    file = read_text(text)
    base, tip = file.joints.values()
    assert file.ports["ttyUSB0"].path == "/dev/ttyUSB0"
    assert (base.name, base.id, base.baud, base.model.key(), base.direction, base.ratio) == (
        "base", 3, 1_000_000, "mx28", -1, 2.0,
    )  # fmt: skip
    # joint = (servo - middle) / gear_ratio - offset; an MX-28 has 4096 counts a turn (e-manual)
    middle = 180 * deg
    for servo in (1.0, 3.0, 5.0):
        assert base.servos[0].axis.to_joint(servo) == pytest.approx((servo - middle) / -2 - 0.25, abs=2e-6)
        assert tip.servos[0].axis.to_joint(servo) == pytest.approx(servo - middle, abs=2e-6)
    assert base.limits == pytest.approx((-1.0, 0.5), abs=2e-6)
    assert base.speed == pytest.approx(2.0, abs=2e-6)
    assert tip.limits is None
    assert "base has parameters that were left out, for they are raw values of registers: Profile_Velocity" in notes


def test_a_robot_goes_to_ros2_control_and_comes_back() -> None:
    file = read_text(SIX)
    back = read_text(taken(ros2_control.write(file).text.encode(), **{ALL: "rx28"})[0])
    for name, one in (("base", "base"), ("lift", "lift"), ("lift_mirror", "lift")):
        servo = file.joints[one].servos[name != one]
        mine = back.joints[name]
        assert (mine.id, mine.servos[0].baud) == (servo.id, servo.model.factory_baud)
        assert mine.servos[0].axis.zero == pytest.approx(servo.axis.zero, abs=2e-5)
        assert (mine.direction, mine.ratio) == (servo.axis.direction, servo.axis.ratio)
        if name == one:
            assert mine.limits == pytest.approx(file.joints[one].range, abs=2e-5)


@pytest.mark.parametrize(
    ("old", "new", "models", "words"),
    [
        ("", "", {"tip": "mx28"}, "--model base=mx28"),
        ("", "", {ALL: "lx16a"}, "drives Dynamixel servos alone"),
        (">3<", ">x<", {ALL: "mx28"}, 'the id of base is "x"'),
        (">3<", ">254<", {ALL: "mx28"}, "ids are 0 to 253"),
        (">-2.0<", ">0<", {ALL: "mx28"}, "gear_ratio of base is 0"),
        (">-2.0<", ">two<", {ALL: "mx28"}, 'gear_ratio of base is "two", which is no number'),
        ("dynamixel_hardware/", "other/", {ALL: "mx28"}, "no joint of dynamixel_hardware"),
        ('"tip"', '"base"', {ALL: "mx28"}, "two of its entries would be called base"),
    ],
)
def test_tags_that_make_no_robot_are_refused(old: str, new: str, models: dict[str, str], words: str) -> None:
    with pytest.raises(FormatError, match=words):
        taken(robot(joint("base"), CONTROL.replace(old, new)), **models)


def test_the_port_may_be_open_or_said() -> None:
    bare = robot(CONTROL.replace('<param name="port_name">/dev/ttyUSB0</param>', ""))
    assert read_text(taken(bare)[0]).ports["bus"].path == "?"
    draft = ros2_control.new(bare, Given("arm.urdf", {ALL: "/dev/ttyUSB7"}, {ALL: "mx28"}))
    assert read_text(draft_text(draft, "arm")).ports["bus"].path == "/dev/ttyUSB7"
