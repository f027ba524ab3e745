"""The .robot file of the ROBOTIS framework, and what of it a robot file has."""

import pytest

from servobus import FormatError
from servobus.core.units import deg
from servobus.robots.file.reading import read_text
from servobus.robots.formats import robotis
from servobus.robots.formats.base import Given
from servobus.robots.formats.draft import draft_text
from unit.robots.arms import SIX

HEAD = """\
# A neck.
[ control info ]
control_cycle = 8
[ port info ]
# PORT NAME  | BAUDRATE | DEFAULT JOINT
/dev/ttyUSB0 | 57600    | pan    # at the back
/dev/ttyUSB1 | 1000000  | arm
[ device info ]
"""
PAN = "dynamixel | /dev/ttyUSB0 | 1 | MX-28 | 1.0 | pan | present_position\n"
TILT = "dynamixel | /dev/ttyUSB0 | 2 | RX-28 | 1.0 | tilt | present_position\n"


def taken(text: str, given: Given | None = None) -> tuple[str, tuple[str, ...]]:
    draft = robotis.new(text.encode(), given or Given("neck.robot"))
    return draft_text(draft, "neck"), draft.notes


def test_ports_names_models_and_ids() -> None:
    text, notes = taken(HEAD + PAN + TILT)
    file = read_text(text)
    assert not notes
    assert file.ports["ttyUSB0"].path == "/dev/ttyUSB0"
    pan, tilt = file.joints["pan"], file.joints["tilt"]
    assert (pan.model.key(), pan.id, pan.baud, pan.port) == ("mx28", 1, 57600, "ttyUSB0")
    assert (tilt.model.key(), tilt.id, tilt.direction, tilt.limits) == ("rx28", 2, 1, None)
    assert pan.zero == pytest.approx(180 * deg)  # value_of_0_radian_position = 2048 of 4096
    assert tilt.zero == pytest.approx(512 * 300 / 1023 * deg, abs=1e-6)
    assert "has no zero, direction, limits" in text


def test_what_cannot_be_driven_is_left_out_and_told() -> None:
    more = "sensor | /dev/ttyUSB1 | 200 | OPEN-CR | 2.0 | open-cr | button\n"
    more += "dynamixel | /dev/ttyUSB1 | 3 | XM430-W350 | 2.0 | roll | present_position\n"
    more += "dynamixel | /dev/ttyUSB1 | 4 | MX-28\n"
    text, notes = taken(HEAD + PAN + more)
    assert list(read_text(text).joints) == ["pan"]
    assert "open-cr (OPEN-CR, protocol 2.0), roll (XM430-W350, protocol 2.0)" in " ".join(notes)
    assert "Line 12 has 4 columns" in " ".join(notes)


def test_a_port_and_a_name_can_be_said() -> None:
    text, _ = taken(HEAD + PAN, Given("neck.robot", {"ttyUSB0": "usb:A1"}, joints={"pan": "neck"}))
    file = read_text(text)
    assert file.ports["ttyUSB0"].path == "usb:A1"
    assert list(file.joints) == ["neck"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[ port info ]\n", "device info"),
        (HEAD + PAN.replace("MX-28", "XM430"), "no Dynamixel servo"),
        (HEAD + PAN.replace("| 1 |", "| 300 |"), "ids are 0 to"),
        (HEAD.replace("57600", "fast") + PAN, "neck.robot:6"),
        (HEAD + PAN + PAN, "two of its entries"),
    ],
)
def test_a_wrong_one_is_refused(text: str, words: str) -> None:
    with pytest.raises(FormatError, match=words):
        taken(text)


def test_there_and_back() -> None:
    file = read_text(SIX)
    made = robotis.write(file)
    text, _ = taken(made.text)
    back = read_text(text)
    for name in ("base", "lift"):
        ours, theirs = file.joints[name], back.joints[name]
        assert (theirs.model, theirs.id, theirs.baud) == (ours.model, ours.id, ours.model.factory_baud)
    assert back.joints["lift_mirror"].id == 3
    notes = " ".join(made.notes)
    assert "elbow (DRS-0602)" in notes
    assert "turn the other way there: lift" in notes
    # base 150°, less the middle at 150.1466°: -0.0026 rad; lift 120°: -0.5262 rad
    assert "base -0.0026" in notes
    assert "lift -0.5262" in notes


def test_a_port_has_one_speed() -> None:
    text = SIX.replace("id = 1\n", "id = 1\nbaud = 1000000\n", 1)
    with pytest.raises(FormatError, match="port base would need one speed, but base has 1000000"):
        robotis.write(read_text(text))
