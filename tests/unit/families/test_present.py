import pytest

from servobus import MODELS
from servobus.families.base import Model
from servobus.families.present import model_entry, model_lines, packet_entries, servo_entry
from servobus.families.registry import RX28

READ = bytes.fromhex("FF FF 01 04 02 2B 01 CC")
"""READ_DATA of present_temperature, and its answer 32 °C: RX-28 manual 3-5-2."""
STATUS = bytes.fromhex("FF FF 01 03 00 20 DB")


def test_a_servo() -> None:
    entry = servo_entry(RX28.family, RX28, 7, 57_600, "24")
    assert entry == {
        "family": "dynamixel", "model": "rx28", "model_number": 28, "id": 7, "baud": 57_600, "firmware": "24"
    }  # fmt: skip
    assert servo_entry(RX28.family, None, 7, 57_600, "24")["model"] is None


@pytest.mark.parametrize("model", MODELS.values())
def test_a_model_in_the_units_people_use(model: type[Model]) -> None:
    entry = model_entry(model)
    assert entry["voltage"] == {"value": list(model.sheet.voltage), "unit": "V"}
    assert entry["angle"]["value"] == pytest.approx(model.sheet.angle * 57.29577951, abs=0.001)
    assert len(entry["performance"]) == len(model.sheet.performance)
    assert model.title in model_lines(model)[0]


def test_packets_and_what_is_between_them() -> None:
    data = READ + STATUS + b"\x00" + STATUS[:-1] + b"\x00"
    entries = packet_entries(RX28, data)
    assert [(one["offset"], one["kind"], one["id"]) for one in entries] == [
        (0, "packet", 1), (8, "packet", 1), (15, "noise", None), (16, "corrupt", 1),
    ]  # fmt: skip
    assert bytes.fromhex("".join(one["hex"] for one in entries)) == data
    texts = [one["text"] for one in entries]
    assert texts[1] == "status of id 1: ok, present_temperature 32 °C"
    assert texts[2] == "JUNK: a byte that is no packet"
    assert texts[3].startswith("CHECKSUM WRONG: would be status of id 1")
