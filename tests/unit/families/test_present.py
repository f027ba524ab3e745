import pytest

from servobus import MODELS
from servobus.families import registry
from servobus.families.base import Model
from servobus.families.present import model_entry, model_lines, servo_entry
from servobus.families.registry import RX28


def test_a_servo() -> None:
    entry = servo_entry(RX28.family, RX28, 7, 57_600, "24")
    assert entry == {
        "family": "dynamixel", "model": "rx28", "model_number": 28, "id": 7, "baud": 57_600, "firmware": "24"
    }  # fmt: skip
    assert servo_entry(RX28.family, None, 7, 57_600, "24")["model"] is None


@pytest.mark.parametrize("model", MODELS.values())
def test_a_model_in_the_units_people_use(model: type[Model]) -> None:
    entry = model_entry(model)
    supply = model.sheet.voltage
    assert entry["voltage"] == (None if supply is None else {"value": list(supply), "unit": "V"})
    assert entry["angle"]["value"] == pytest.approx(model.sheet.angle * 57.29577951, abs=0.001)
    assert len(entry["performance"]) == len(model.sheet.performance)
    assert model.title in model_lines(model)[0]


def test_only_servos_that_cannot_say_their_model_are_said_to_be_remembered() -> None:
    told = {key: model_lines(registry.model(key))[0] for key in ("dynamixel", "herkulex", "lx")}
    assert [key for key, line in told.items() if "`servobus remember`" in line] == ["lx"]
    assert all("--model MODEL" in line for line in told.values())
