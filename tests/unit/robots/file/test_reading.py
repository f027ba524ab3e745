"""A robot file: what it gives, and each kind of mistake with its line, key, value and remedy."""

import math
from pathlib import Path
from typing import Any

import pytest

from servobus import RobotFileError
from servobus.core.units import deg
from servobus.families import registry
from servobus.robots.file.reading import read_file, read_text
from unit.robots.arms import JOINTS, SIX
from unit.robots.file.test_schema import FULL

# What it gives


def test_the_arm() -> None:
    file = read_text(SIX, Path("arm.toml"))
    assert file.robot.name == "six"
    assert file.name == "arm.toml"
    assert tuple(file.joints) == JOINTS
    assert list(file.ports) == ["base", "upper", "hand"]
    assert file.groups["hand"] == ("wrist", "grip")
    assert file.poses["open"] == {"grip": pytest.approx(60 * deg)}
    lift = file.joints["lift"]
    first, second = lift.servos
    assert (first.id, first.port, first.axis.direction) == (2, "base", -1)
    assert (second.id, second.port, second.axis.direction) == (3, "base", 1)
    assert (first.axis.zero, second.axis.zero) == pytest.approx((120 * deg, 170 * deg))
    assert second.model is first.model is registry.model("rx28")
    assert lift.mirror is not None
    assert lift.mirror.disagreement == pytest.approx(4 * deg)


def test_all_keys() -> None:
    file = read_text(FULL)
    hip, knee = file.joints["hip"], file.joints["knee"]
    assert hip.limits == pytest.approx((-0.5, math.pi / 2))
    assert hip.protect is not None
    assert (hip.protect.push, hip.protect.stall, hip.protect.warn) == pytest.approx((0.8, 0.5, 10.0))
    assert hip.load is not None
    assert (hip.load.mass, hip.load.length, hip.load.down) == pytest.approx((0.2, 0.1, -math.pi / 2))
    assert hip.registers == {"punch": 40, "led": True, "return_delay_time": "100us"}
    assert hip.servos[1].baud == 57600
    assert knee.model is registry.model("rx28")
    assert [step.time for step in file.motions["step"].steps] == [0.0, 0.5, 1.0]
    assert file.motions["wave"].file == "wave.csv"
    assert file.ports["main"].bauds == (57600, 1_000_000)


@pytest.mark.parametrize(
    ("joint", "low", "high"),
    [
        # (0° .. 300° of the servo - 150°) * 1, within the limits
        ("base", -120, 120),
        # servo 1: -(0 .. 300 - 120) = -180 .. 120, servo 2: (0 .. 300) - 170 = -170 .. 130, within -60 .. 80
        ("lift", -60, 80),
        # no limits: (-455.0 .. 455.0 of the DRS-0602 - 35) / 1.5; the register holds whole steps of 360° / 12962
        ("turn", (-455 - 35) / 1.5, (455 - 35) / 1.5),
        # -(0 .. 240 - 110) = -130 .. 110, within -70 .. 100
        ("wrist", -70, 100),
        # (0 .. 240 - 60) / 2.5 = -24 .. 72, within 0 .. 70
        ("grip", 0, 70),
    ],
)
def test_the_range_of_a_joint_is_within_limits_and_servo(joint: str, low: float, high: float) -> None:
    assert read_text(SIX).joints[joint].range == pytest.approx((low * deg, high * deg), abs=0.05 * deg)


def test_limits_may_be_all_that_the_servo_can() -> None:
    """The zero and the ends are written in degrees, and none is a whole number of steps or of radians."""
    text = SIX.replace('["-120deg", "120deg"]', '["-150deg", "150deg"]')
    assert read_text(text).joints["base"].range == pytest.approx((-150 * deg, 150 * deg))


# Mistakes

MISTAKES: list[tuple[str, str, str]] = [
    ("[robot]\nformat = 1", "format = 1", 'there is no table "format"'),
    ("format = 1", "format = 2", "[robot.format] 2 is no whole number from 1 to 1"),
    ("format = 1\n", "", "[robot] format is missing: Version"),
    ('rest = "home"', 'rest = "hom"', '[robot.rest] there is no pose "hom"; did you mean home?'),
    ('rest = "home"', 'rset = "home"', '[robot.rset] there is no key "rset" in [robot]; did you mean rest?'),
    ("[port.base]", "[ports.base]", '[ports] there is no table "ports" here; did you mean port?'),
    (
        'path = "virtual:drs0602@1-2?clock=virtual"',
        "path = 3",
        '[port.upper.path] 3 is no text; write one such as "/dev',
    ),
    ('path = "virtual:drs0602@1-2?clock=virtual"', 'path = ""', '[port.upper.path] "" is no text'),
    ('path = "virtual:drs0602@1-2?clock=virtual"', "", "[port.upper] path is missing: Where it is"),
    ("[joint.elbow]", '[joint."the elbow"]', '"the elbow" is no name of a joint: letters, digits'),
    (
        'port = "upper"\nmodel = "drs0602"\nid = 1',
        'port = "uper"\nmodel = "drs0602"\nid = 1',
        '[joint.elbow.port] there is no port "uper"; did you mean upper?',
    ),
    ('model = "drs0602"\nid = 1', 'model = "drs0606"\nid = 1', "[joint.elbow.model] no model 'drs0606'"),
    (
        'model = "drs0602"\nid = 1',
        "model = 602\nid = 1",
        "[joint.elbow.model] 602 is no name of a model; write one such",
    ),
    (
        'model = "drs0602"\nid = 1',
        'model = "drs0602"\nid = 255',
        "[joint.elbow.id] 255 is no whole number from 0 to 253",
    ),
    ('model = "drs0602"\nid = 1', 'model = "drs0602"\nid = true', "[joint.elbow.id] true is no whole number"),
    (
        'model = "drs0602"\nid = 1',
        'model = "drs0602"\nid = 2',
        "[joint.turn.id] id 2 on port upper is that of joint elbow already",
    ),
    (
        'model = "drs0602"\nid = 1',
        'model = "drs0602"\nid = 1\nbaud = 9600',
        "[joint.elbow.baud] 9600 bit/s is no speed of the DRS-0602: it has 57600",
    ),
    ('model = "drs0602"\nid = 1', 'model = "drs0602"\nid = 1\nbaud = "fast"', "[joint.elbow.baud]"),
    ('zero = "-20deg"', "zero = -20", "[joint.elbow.zero] -20 has no unit; write a number and its unit as a text"),
    ('zero = "-20deg"', 'zero = "-20"', '[joint.elbow.zero] "-20" has no unit; write one behind the number'),
    (
        'zero = "-20deg"',
        'zero = "-20 grad"',
        "[joint.elbow.zero] 'grad' is not a unit known here: use °, deg, rad, turn",
    ),
    ('zero = "-20deg"', 'zero = "much"', "[joint.elbow.zero] 'much' is not a number"),
    (
        "direction = -1\nratio = 2.0",
        "direction = 2\nratio = 2.0",
        "[joint.elbow.direction] 2 is no direction: write 1, or",
    ),
    ("ratio = 2.0", "ratio = -2.0", "[joint.elbow.ratio] -2.0 is no number above 0"),
    ("ratio = 2.0", "ratio = nan", "[joint.elbow.ratio] nan is no number above 0"),
    (
        '["-100deg", "100deg"]',
        '["100deg", "-100deg"]',
        '[joint.elbow.limits] ["100deg", "-100deg"]: the lower limit comes',
    ),
    ('["-100deg", "100deg"]', '["100deg"]', '[joint.elbow.limits] ["100deg"] are no limits; write the lower and the'),
    ('["-100deg", "100deg"]', '["-100deg", 100]', "[joint.elbow.limits] 100 has no unit"),
    (
        '["-100deg", "100deg"]',
        '["-300deg", "100deg"]',
        "[joint.elbow.limits] the DRS-0602 cannot be sent there: with this zero, direction and ratio the joint",
    ),
    ('speed = "120deg/s"', 'speed = "0deg/s"', '[joint.base.speed] "0deg/s" is not above 0'),
    ('speed = "120deg/s"', 'speed = "120deg"', "[joint.base.speed] 'deg' is not a unit known here: use"),
    (
        'safe_action = "hold"',
        'safe_action = "halt"',
        '[joint.elbow.safe_action] "halt" is not one of hold, free, brake',
    ),
    ('disagreement = "4deg"', 'disagreement = "0deg"', '[joint.lift.mirror.disagreement] "0deg" is not above 0'),
    (
        "[joint.lift.mirror]\nid = 3",
        "[joint.lift.mirror]\nid = 2",
        "[joint.lift.mirror.id] id 2 on port base is that of joint lift already",
    ),
    ('zero = "170deg"\n', "", "[joint.lift.mirror] zero is missing: Angle of the second servo"),
    (
        "[joint.lift.mirror]",
        "[joint.lift.miror]",
        '[joint.lift.miror] there is no key "miror" in [joint.lift]; did you',
    ),
    (
        'hand = ["wrist", "grip"]',
        'hand = ["wrist", "gripper"]',
        '[group.hand] there is no joint "gripper"; did you mean',
    ),
    (
        'hand = ["wrist", "grip"]',
        'grip = ["wrist", "grip"]',
        "[group.grip] a joint is called grip already; give the group",
    ),
    ('hand = ["wrist", "grip"]', 'hand = "wrist"', '[group.hand] "wrist" is no list of names of joints'),
    ('hand = ["wrist", "grip"]', 'hand = ["wrist", "wrist"]', '[group.hand] "wrist" stands there twice; leave one out'),
    ('grip = "60deg"', 'grip = "71deg"', "[pose.open.grip] 71.0° is outside the limits of the joint, 0.0° .. 70.0°"),
    ('grip = "60deg"', "grip = 60", "[pose.open.grip] 60 has no unit"),
    ('grip = "60deg"', 'girp = "60deg"', '[pose.open.girp] there is no joint "girp"; did you mean grip?'),
    ('grip = "60deg"', "", "[pose.open] a pose has angles of joints, such as"),
    (
        '{ pose = "home", time = "0s" }',
        '{ pose = "hone", time = "0s" }',
        '[motion.wave.steps] there is no pose "hone"; did',
    ),
    ('{ pose = "home", time = "0s" }', '{ time = "0s" }', "[motion.wave.steps] a step has a pose, or joints"),
    ('{ pose = "home", time = "0s" }', '{ pose = "home" }', "[motion.wave.steps] time is missing: Time since"),
    (
        '{ pose = "home", time = "0s" }',
        '{ pose = "home", time = "-1s" }',
        '[motion.wave.steps.time] "-1s" is too little',
    ),
    (
        '{ pose = "home", time = "0s" }',
        '{ pose = "home", time = "2s" }',
        "[motion.wave.steps] each step comes later than",
    ),
    ('joints = { wrist = "20deg" }', 'joints = { wrist = "120deg" }', "120.0° is outside the limits of the joint"),
    ('joints = { wrist = "20deg" }', 'joints = { waist = "20deg" }', 'there is no joint "waist"; did you mean wrist?'),
    ("steps = [", 'file = "a.csv"\nsteps = [', "[motion.wave] write either steps = "),
]
"""What stands in the file, a mistake in its place, and what is told of it."""


@pytest.mark.parametrize(("good", "bad", "told"), MISTAKES, ids=[told[:40] for _, _, told in MISTAKES])
def test_a_mistake_is_told_with_its_line_and_a_remedy(good: str, bad: str, told: str) -> None:
    assert SIX.count(good) == 1, "the mistake is made in one place"
    text = SIX.replace(good, bad)
    with pytest.raises(RobotFileError) as caught:
        read_text(text, Path("arm.toml"))
    message = str(caught.value)
    assert told in message
    where, line, _ = message.split(":", 2)
    assert where == "arm.toml"
    assert 1 <= int(line) <= len(text.splitlines())
    assert len(message) < 400
    assert "\n" not in message


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        ('zero = "-20deg"', "zero = -20"),
        ('disagreement = "4deg"', "disagreement = 4"),
        ('girp = "60deg"', ""),
        ('hand = ["wrist", "grip"]', "hand = 3"),
        ('speed = "120deg/s"', "speed = 120  # fast"),
        ('path = "virtual:lx16a@1-2?clock=virtual"', "path = 7"),
    ],
)
def test_the_line_is_that_of_the_mistake(good: str, bad: str) -> None:
    text = SIX.replace(good, bad) if good in SIX else SIX.replace('grip = "60deg"', good)
    number = 1 + next(n for n, line in enumerate(text.splitlines()) if line == (bad or good))
    with pytest.raises(RobotFileError, match=rf"^arm\.toml:{number}: "):
        read_text(text, Path("arm.toml"))


@pytest.mark.parametrize(
    ("registers", "told"),
    [
        ("punhc = 3", "no register 'punhc'; did you mean punch"),
        ("punch = 5000", "punch"),
        ('led = "maybe"', "neither on nor off"),
        ("present_position = 3", "present_position"),
        ("punch = [3]", "punch"),
    ],
)
def test_settings_are_checked_by_the_model(registers: str, told: str) -> None:
    with pytest.raises(RobotFileError, match=r"arm\.toml:\d+: \[joint\.base\.registers\.") as caught:
        read_text(SIX.replace('speed = "120deg/s"\n', f"[joint.base.registers]\n{registers}\n"), Path("arm.toml"))
    assert told in str(caught.value)


def test_two_servos_without_an_angle_in_common_are_refused() -> None:
    text = SIX.replace('zero = "170deg"', 'zero = "-300deg"').replace('limits = ["-60deg", "80deg"]\n', "")
    with pytest.raises(RobotFileError, match="have no angle in common"):
        read_text(text.replace('lift = "10deg"\n', ""))


@pytest.mark.parametrize(
    ("contents", "told"),
    [
        (b"\xff\xfe", "cannot be read as text"),
        (b"[robot", "this is no TOML"),
        (b"", r"there is no table \[robot\]; write \[robot\] and format = 1"),
        (b"robot = 3", r"\[robot\] 3 is no table; write \[robot\] and its keys below"),
        (b"[robot]\nformat = 1\njoint = 3", 'there is no key "joint"'),
        (b"joint = 3\n[robot]\nformat = 1", r"\[joint\] 3 is no table"),
        (b"joint.elbow = 3\n[robot]\nformat = 1", r"\[joint\.elbow\] 3 is no table"),
    ],
)
def test_what_is_no_robot_file(tmp_path: Path, contents: bytes, told: str) -> None:
    path = tmp_path / "arm.toml"
    path.write_bytes(contents)
    with pytest.raises(RobotFileError, match=told) as caught:
        read_file(path)
    assert str(caught.value).startswith(str(path))


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match=r"no such file; `servobus robot init PORT -o arm\.toml`"):
        read_file(tmp_path / "arm.toml")
    with pytest.raises(RobotFileError, match="cannot be read"):
        read_file(tmp_path)


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_bytes(b"\xef\xbb\xbf" + SIX.replace("\n", "\r\n").encode())
    assert tuple(read_file(path).joints) == JOINTS


def test_an_unnamed_text_is_called_by_what_it_is() -> None:
    with pytest.raises(RobotFileError, match=r"^the robot file:2: "):
        read_text("[robot]\nfrmat = 1")


def _as_any(value: Any) -> Any:
    return value


def test_the_tables_of_a_file_cannot_be_changed() -> None:
    file = read_text(SIX)
    for table in (file.joints, file.poses, file.groups, file.poses["home"]):
        with pytest.raises(TypeError):
            _as_any(table)["new"] = 1
