"""pypot's configuration; figures by hand from pypot/dynamixel/motor.py and conversion.py (5.0.2)."""

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import extent
from servobus import FormatError
from servobus.core.units import deg
from servobus.robots.file.reading import read_text
from servobus.robots.formats import pypot
from servobus.robots.formats.base import Given
from servobus.robots.formats.draft import draft_text
from unit.robots.arms import SIX


def config(**motors: dict[str, Any]) -> dict[str, Any]:
    return {
        "controllers": {"arm": {"port": "auto", "sync_read": False, "attached_motors": list(motors), "protocol": 1}},
        "motorgroups": {},
        "motors": motors,
    }


def motor(**other: Any) -> dict[str, Any]:
    return {"id": 1, "type": "RX-28", "orientation": "direct", "offset": 0.0, "angle_limit": [-90, 90]} | other


def taken(said: dict[str, Any], **ports: str) -> Any:
    return read_text(draft_text(pypot.new(json.dumps(said).encode(), Given("robot.json", ports)), "arm"))


def test_the_offset_counts_after_the_sign_and_limits_before_it() -> None:
    file = taken(config(m1=motor(orientation="indirect", offset=20.0, angle_limit=[-90, 45])))
    joint = file.joints["m1"]
    assert joint.direction == -1
    # 0 = -servo - 20: the servo is at -20°, which is 130° of 0° .. 300°
    assert joint.zero == pytest.approx(130 * deg, abs=1e-6)
    # Counts 205 and 665 (204.6 and 664.95 rounded) are 60.117° and 195.015°: joint = -(servo - 130°)
    assert joint.limits == pytest.approx((-65.0147 * deg, 69.8827 * deg), abs=4e-6)


@pytest.mark.parametrize("orientation", ["direct", "indirect"])
def test_an_angle_is_what_pypot_would_read(orientation: str) -> None:
    """pypot: dxl_to_degree(count) is count * 300 / 1023 - 150; then the sign, then less the offset."""
    joint = taken(config(m1=motor(orientation=orientation, offset=-35.5))).joints["m1"]
    for count in (0, 100, 511, 1023):
        degrees = count * 300 / 1023 - 150
        theirs = (degrees if orientation == "direct" else -degrees) + 35.5
        assert joint.axis.to_joint(count * 300 / 1023 * deg) == pytest.approx(theirs * deg, abs=1e-5)


def test_an_mx_has_4095_parts_of_a_turn_there() -> None:
    joint = taken(config(m1=motor(type="MX-28", offset=-10.0))).joints["m1"]
    # -10° is count (170 / 360) * 4095 = 1933.75, which is 169.9585° of 4096 parts
    assert joint.zero == pytest.approx(1933.75 * 360 / 4096 * deg, abs=1e-6)


def test_ports_groups_and_what_is_left_out() -> None:
    said = config(
        m1=motor(), m2=motor(id=2, broken=True), m3=motor(id=3, wheel_mode=True), m4=motor(id=4, type="XL-320")
    )
    said["motorgroups"] = {"all": ["low", "m3"], "low": ["m1", "m2"]}
    said["controllers"]["arm"]["attached_motors"] = ["all", "m4"]
    said["sensors"] = {"camera": {"type": "OpenCVCamera"}}
    draft = pypot.new(json.dumps(said).encode(), Given("robot.json"))
    file = read_text(draft_text(draft, "arm"))
    assert list(file.joints) == ["m1", "m2", "m3"]
    assert file.groups == {"all": ("m1", "m2", "m3"), "low": ("m1", "m2")}
    assert file.ports["arm"].path == "?"
    assert {joint.baud for joint in file.joints.values()} == {1_000_000}
    assert file.joints["m3"].limits is None
    assert "m4 (XL-320)" in " ".join(draft.notes)
    assert "sensors" in " ".join(draft.notes)
    assert "as broken" in file.text
    assert "wheel_mode" in file.text


def test_a_port_that_was_said_goes_first() -> None:
    said = config(m1=motor())
    said["controllers"]["arm"]["port"] = "/dev/ttyUSB3"
    assert taken(said).ports["arm"].path == "/dev/ttyUSB3"
    assert taken(said, arm="COM4").ports["arm"].path == "COM4"


def test_a_configuration_for_pypot() -> None:
    made = pypot.write(read_text(SIX))
    said = json.loads(made.text)
    assert list(said["motors"]) == ["base", "lift", "lift_mirror"]
    assert said["controllers"]["base"]["attached_motors"] == ["base", "lift", "lift_mirror"]
    assert said["controllers"]["base"]["port"] == "auto"
    assert said["motorgroups"] == {"arm": ["base", "lift", "lift_mirror"]}
    lift, mirror = said["motors"]["lift"], said["motors"]["lift_mirror"]
    # zero 120°, direction -1: the servo is at -30° there, so the offset is 30°; 40° .. 180° are counts 137 .. 613
    assert (lift["orientation"], lift["offset"]) == ("indirect", 30.0)
    assert lift["angle_limit"] == pytest.approx([137 * 300 / 1023 - 150, 613 * 300 / 1023 - 150], abs=1e-4)
    assert (mirror["orientation"], mirror["offset"]) == ("direct", 20.0)
    notes = " ".join(made.notes)
    assert "elbow (DRS-0602)" in notes
    assert "1000000 bit/s" in notes


MOTORS = st.fixed_dictionaries(
    {
        "type": st.sampled_from(sorted(pypot.TYPES)),
        "orientation": st.sampled_from(["direct", "indirect"]),
        "offset": st.integers(-900, 900).map(lambda tenths: tenths / 10),
        "angle_limit": st.tuples(st.integers(-140, -1), st.integers(1, 140)).map(list),
    }
)


@settings(deadline=None, max_examples=200 if extent.everything else 15)
@given(first=MOTORS, second=MOTORS)
def test_there_and_back(first: dict[str, Any], second: dict[str, Any]) -> None:
    said = config(a=motor(**first), b=motor(**second) | {"id": 2})
    back = json.loads(pypot.write(taken(said)).text)
    assert back["controllers"] == said["controllers"]
    for name, one in said["motors"].items():
        other = back["motors"][name]
        assert (other["id"], other["type"], other["orientation"]) == (one["id"], one["type"], one["orientation"])
        assert other["offset"] == pytest.approx(one["offset"], abs=1e-3)
        assert other["angle_limit"] == pytest.approx(one["angle_limit"], abs=0.15)  # half a count
    again = json.loads(pypot.write(taken(back)).text)
    for name in said["motors"]:
        assert again["motors"][name]["angle_limit"] == back["motors"][name]["angle_limit"]


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"controllers": {}, "motors": {}}, "motorgroups"),
        (config(m1=motor(type="XL-320")), "servobus drives none"),
        (config(m1=motor(offset="x")), "offset"),
        (config(m1=motor(angle_limit=[90, -90])), "lower limit first"),
        (config(m1=motor(angle_limit=[200, 300])), "angle_limit of"),
        (config() | {"controllers": {"a": {"port": "auto", "attached_motors": ["m9"]}}}, "m9"),
        (config() | {"controllers": {"a": {"port": "auto"}}}, "attached_motors"),
        (
            config()
            | {"motorgroups": {"a": ["b"], "b": ["a"]}, "controllers": {"c": {"port": "x", "attached_motors": ["a"]}}},
            "in itself",
        ),
    ],
)
def test_a_wrong_one_is_refused(said: dict[str, Any], words: str) -> None:
    with pytest.raises(FormatError, match=words):
        pypot.new(json.dumps(said).encode(), Given("robot.json"))


def test_without_a_dynamixel_there_is_nothing_for_pypot() -> None:
    text = '[robot]\nformat = 1\n[port.p]\npath = "x"\n[joint.a]\nport = "p"\nmodel = "lx16a"\nid = 1\n'
    with pytest.raises(FormatError, match="none of its servos"):
        pypot.write(read_text(text))
