"""LeRobot's calibration. What LeRobot itself writes stands here as it came out of lerobot 0.6.1, draccus 0.11.6."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import extent
from servobus import FormatError
from servobus.core.units import deg, parse
from servobus.families import registry
from servobus.families.model import Model
from servobus.robots.file.reading import read_text
from servobus.robots.file.writing import edited
from servobus.robots.formats import lerobot
from servobus.robots.formats.base import ALL, Given
from servobus.robots.formats.draft import draft_text
from unit.robots.arms import SIX

ARM = """\
[robot]
format = 1
name = "arm"
[port.bus]
path = "/dev/ttyUSB0"
[joint.shoulder]
port = "bus"
model = "rx28"
id = 1
zero = "150deg"
direction = -1
limits = ["-90deg", "90deg"]
[joint.grip]
port = "bus"
model = "lx16a"
id = 2
zero = "60deg"
ratio = 2.0
limits = ["0deg", "60deg"]
"""
# 60°..240° of 300° on 1023 counts: 204.6 and 818.4, rounded inwards; 60°..180° of 240° on 1000 counts.
THEIRS = (
    '{\n    "shoulder": {\n        "id": 1,\n        "drive_mode": 1,\n        "homing_offset": 0,\n        '
    '"range_min": 205,\n        "range_max": 818\n    },\n    "grip": {\n        "id": 2,\n        "drive_mode": 0,\n'
    '        "homing_offset": 0,\n        "range_min": 250,\n        "range_max": 750\n    }\n}'
)
"""What LeRobot writes of these two motors, to the byte."""


def said(**motors: dict[str, int]) -> bytes:
    return json.dumps(motors).encode()


def motor(id: int = 1, drive_mode: int = 0, homing_offset: int = 0, low: int = 100, high: int = 900) -> dict[str, int]:
    return {
        "id": id,
        "drive_mode": drive_mode,
        "homing_offset": homing_offset,
        "range_min": low,
        "range_max": high,
    }


def test_a_calibration_is_what_lerobot_writes() -> None:
    made = lerobot.write(read_text(ARM))
    assert made.text == THEIRS
    # The middle of 250 .. 750 is count 500, 120° of the servo: (120 - 60) / 2 = 30° of the joint.
    assert any("grip 30.0°" in note for note in made.notes)
    assert any("drive_mode 1" in note and "shoulder" in note for note in made.notes)
    assert any("gear" in note and "grip" in note for note in made.notes)


def test_the_second_servo_of_a_joint_is_a_motor_of_its_own() -> None:
    made = json.loads(lerobot.write(read_text(SIX)).text)
    # zero 120°, direction -1, -60° .. 80°: 40° .. 180° of the servo, counts 136.4 and 613.8; the other one 110° .. 250°
    assert (made["lift"]["range_min"], made["lift"]["range_max"], made["lift"]["drive_mode"]) == (137, 613, 1)
    assert (made["lift_mirror"]["range_min"], made["lift_mirror"]["range_max"]) == (376, 852)
    assert made["lift_mirror"]["drive_mode"] == 0


def test_limits_of_several_turns_are_cut_and_told() -> None:
    text = ARM.replace("rx28", "mx28").replace('limits = ["-90deg", "90deg"]', 'limits = ["-720deg", "90deg"]')
    made = lerobot.write(read_text(text))
    # direction -1: 60° .. 870° of the servo, of which its register holds 60° .. 359.9°: 682.67 .. 4095
    assert json.loads(made.text)["shoulder"]["range_min"] == 683
    assert json.loads(made.text)["shoulder"]["range_max"] == 4095
    assert any("more than a turn" in note and "shoulder" in note for note in made.notes)


def test_a_new_robot_file() -> None:
    calibration = said(lift=motor(2, 1, -310, 205, 819), grip=motor(3, low=0, high=1000))
    draft = lerobot.new(calibration, Given("f.json", {ALL: "/dev/ttyUSB1"}, {ALL: "rx28", "grip": "lx16a"}))
    file = read_text(draft_text(draft, "arm"))
    lift, grip = file.joints["lift"], file.joints["grip"]
    assert (lift.model.key(), lift.id, lift.direction) == ("rx28", 2, -1)
    # middle of 205 and 819 is 512 counts of 300°/1023
    assert lift.zero == pytest.approx(512 * 300 / 1023 * deg, abs=1e-6)
    assert lift.limits == pytest.approx((-307 * 300 / 1023 * deg, 307 * 300 / 1023 * deg), abs=4e-6)
    assert grip.zero == pytest.approx(120 * deg)
    assert file.ports["bus"].path == "/dev/ttyUSB1"
    assert "homing_offset -310" in file.text


def test_without_a_port_the_path_stays_open() -> None:
    draft = lerobot.new(said(a=motor()), Given("f.json", models={ALL: "rx28"}))
    file = read_text(draft_text(draft, "arm"))
    assert file.ports["bus"].path == "?"


def test_onto_a_robot_file() -> None:
    file = read_text(ARM)
    changes = lerobot.onto(said(shoulder=motor(1, 0, 0, 256, 768), other=motor(9)), file, Given("f.json"))
    made = read_text(edited(file, changes.changes))
    shoulder = made.joints["shoulder"]
    assert shoulder.direction == 1
    assert shoulder.zero == pytest.approx(512 * 300 / 1023 * deg, abs=1e-6)
    assert made.joints["grip"] == file.joints["grip"]
    assert "other is no joint" in " ".join(changes.notes)


def test_the_gear_of_the_robot_file_counts() -> None:
    file = read_text(ARM)
    changes = lerobot.onto(said(grip=motor(2, 0, 0, 250, 750)), file, Given("f.json"))
    assert changes.changes[("joint", "grip", "zero")] == "120deg"
    assert changes.changes[("joint", "grip", "limits")] == ["-30deg", "30deg"]  # 60° of the servo, behind 2:1


def test_a_pair_is_left_alone() -> None:
    with pytest.raises(FormatError, match="none of its motors"):
        lerobot.onto(said(lift=motor(2)), read_text(SIX), Given("f.json"))
    changes = lerobot.onto(said(lift=motor(2), base=motor(1)), read_text(SIX), Given("f.json"))
    assert not any("lift" in path for path in changes.changes)
    assert any("two servos" in note for note in changes.notes)
    assert any("base" in note and "poses" in note for note in changes.notes)


@settings(deadline=None, max_examples=200 if extent.everything else 15)
@given(
    model=st.sampled_from([one for one in registry.MODELS.entries.values() if not one.generic]),
    ends=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    mode=st.integers(0, 1),
)
def test_there_and_back(model: type[Model], ends: tuple[float, float], mode: int) -> None:
    low, high = model.register("min_position").limits
    one, other = sorted(round(low + end * (high - low)) for end in ends)
    if one == other:
        return
    calibration = {"joint": motor(3, mode, 0, one, other)}
    draft = lerobot.new(json.dumps(calibration).encode(), Given("f.json", models={ALL: model.key()}))
    assert json.loads(lerobot.write(read_text(draft_text(draft, "arm"))).text) == calibration


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"[1]", "object with an entry per motor"),
        (b"{", "no JSON"),
        (b"\xff\xfe", "no text"),
        (said(a={"id": 1}), "must have the keys"),
        (said(a=motor() | {"speed": 1}), "and no others"),
        (json.dumps({"a": motor() | {"range_min": 1.5}}).encode(), "1.5, which is no whole number"),
        (json.dumps({"a": motor() | {"id": True}}).encode(), "no whole number"),
        (said(a=motor(low=900, high=100)), "not below its range_max"),
        (said(a=motor(high=3120)), "a RX-28 has counts from 0 to 1023"),
        (said(a=motor(drive_mode=4)), "drive_mode"),
        (said(**{"left arm": motor()}), "--joint"),
    ],
)
def test_what_lerobot_would_not_write_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(FormatError, match=words):
        lerobot.new(data, Given("f.json", models={ALL: "rx28"}))


def test_the_model_must_be_said() -> None:
    with pytest.raises(FormatError, match="--model a=mx28"):
        lerobot.new(said(a=motor()), Given("f.json"))


def test_another_id_is_refused() -> None:
    with pytest.raises(FormatError, match="id 7"):
        lerobot.onto(said(shoulder=motor(7)), read_text(ARM), Given("f.json"))


def test_quantities_can_be_read_back() -> None:
    draft = lerobot.new(said(a=motor(low=1, high=2)), Given("f.json", models={ALL: "rx28"}))
    zero = draft.joints["a"]["zero"].value
    assert parse(zero, "rad") == pytest.approx(1.5 * 300 / 1023 * deg, abs=1e-6)
