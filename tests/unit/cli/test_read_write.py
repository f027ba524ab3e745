from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servobus import MODELS
from unit.cli.conftest import ALL, DRS, LX, RX, Run


@pytest.mark.parametrize("family", ALL)
def test_info_as_json(load: Callable[..., Any], family: str) -> None:
    data = load("info", *ALL[family])
    model = MODELS[data["model"]]
    assert data["family"] == family
    assert data["alarms"] == []
    assert list(data["registers"]) == [row.name for row in model.registers.values() if row.readable]
    assert data["sheet"]["maker"] == model.sheet.maker
    voltage = data["registers"][model.register("present_voltage").name]
    assert voltage["unit"] == "V"
    assert voltage["value"] == pytest.approx(model.sheet.nominal_voltage, abs=0.1)


@pytest.mark.parametrize("family", ALL)
def test_info_for_people(run: Run, family: str) -> None:
    text = run("info", *ALL[family]).stdout
    assert text.startswith({"dynamixel": "RX-28", "herkulex": "DRS-0602", "lewansoul": "LX-16A"}[family])
    assert "supply voltage" in text
    assert "firmware" in text


@pytest.mark.parametrize("family", ALL)
def test_read_by_the_shared_names(load: Callable[..., Any], run: Run, family: str) -> None:
    data = load("read", *ALL[family], "present_position", "present_temperature", "torque_enable")
    assert list(data) == ["present_position", "present_temperature", "torque_enable"]
    assert data["present_position"]["unit"] == "°"
    assert data["present_temperature"] == {"value": 25.0, "unit": "°C", "raw": 25}
    assert data["torque_enable"]["unit"] == ""
    assert run("read", *ALL[family], "present_temperature").stdout == "present_temperature  25 °C\n"


def test_write_shows_old_and_new(run: Run, load: Callable[..., Any]) -> None:
    assert run("write", RX, 1, "led=on").stdout == "led  off -> on\n"
    assert (
        run("write", RX, 1, "max_torque=50%", "led=1").stdout
        == "max_torque  100.0 % -> 50.0 %\nled         off -> on\n"
    )
    assert load("write", RX, 1, "moving_speed=60deg/s") == {"moving_speed": {"old": 0.0, "new": 59.94, "unit": "°/s"}}


@pytest.mark.parametrize(
    ("setting", "shown"),
    [
        ("max_position=90", "-> 90.0°"),
        ("max_position=90deg", "-> 90.0°"),
        ("max_position=1.5708rad", "-> 90.0°"),
        ("cw_compliance_slope=0x20", "32 -> 32"),
        ("alarm_led=overload+overheating", "-> overheating+overload"),
        ("alarm_led=none", "-> none"),
    ],
)
def test_ways_of_writing_values(run: Run, setting: str, shown: str) -> None:
    assert shown in run("write", RX, 1, setting).stdout


def test_a_herkulex_remembers_only_what_is_saved(run: Run, load: Callable[..., Any], tmp_path: Path) -> None:
    port = f"{DRS}&state={tmp_path / 'state.json'}"
    run("write", port, 219, "dead_zone=3")
    assert load("read", port, 219, "dead_zone")["dead_zone"]["value"] == 0
    assert run("write", port, 219, "dead_zone=3", "--save").stdout == "dead_zone  0 -> 3\n"
    assert load("read", port, 219, "dead_zone")["dead_zone"]["value"] == 3


def test_what_cannot_be_saved(refused: Callable[..., str]) -> None:
    for port, id, setting in ((RX, 1, "led=on"), (DRS, 219, "led_control=red"), (LX, 1, "torque_enable=on")):
        refused("write", port, id, setting, "--save")


def test_a_servo_that_answers_nothing_is_written_all_the_same(run: Run) -> None:
    result = run("write", RX, 1, "status_return_level=0")
    assert result.stdout == "status_return_level  2 -> 0\n"
    assert "was not read back" in result.stderr


@pytest.fixture
def starved(run: Run, tmp_path: Path) -> str:
    """Give a HerkuleX whose supply is so low that it has an error, which keeps the torque off."""
    port = f"{DRS}&state={tmp_path / 'state.json'}"
    run("write", port, 219, "adc_fault_check_period=0", "--save")
    return f"{port}&voltage=7"


def test_what_does_not_take_is_an_error(run: Run, starved: str) -> None:
    result = run("write", starved, 219, "torque_control=on", code=1)
    assert result.stdout == ""
    assert "servobus: DRS-0602 id 219 has shut down (input_voltage), so nothing would move; rearm()" in result.stderr


def test_alarms_are_told_beside_the_value(run: Run, load: Callable[..., Any], starved: str) -> None:
    result = run("read", starved, 219, "voltage")
    assert result.stdout == "voltage  7.0 V\n"
    assert result.stderr == "DRS-0602 id 219: ALARM input_voltage\n"
    assert load("info", starved, 219)["alarms"] == ["input_voltage"]


@pytest.mark.parametrize(
    ("setting", "why"),
    [
        ("max_position=400", "is not in 0.0° (raw 0) .. 300.0° (raw 1023)"),
        ("max_position=nan", "'nan' is not a number"),
        ("max_position=90V", "'V' is not a unit known here"),
        ("present_position=10", "can only be read"),
        ("led=maybe", "neither on nor off"),
        ("alarm_led=smoke", "'smoke' is not one of"),
        ("reserved_10=1", "is reserved"),
        ("goal_positon=10", "did you mean goal_position"),
        ("id=3", "set-id"),
        ("baud=9600", "set-baud"),
    ],
)
def test_a_wrong_setting_is_refused_and_nothing_is_written(refused: Callable[..., str], setting: str, why: str) -> None:
    assert why in refused("write", RX, 1, "punch=5", setting)


def test_settings_named_twice(refused: Callable[..., str]) -> None:
    assert "named twice" in refused("write", RX, 1, "led=on", "led=off", code=2)
    assert "named twice" in refused("write", RX, 1, "cw_angle_limit=0", "min_position=1")


def test_ids_that_cannot_be(refused: Callable[..., str]) -> None:
    assert "254 is the broadcast id: every servo would obey" in refused("write", RX, 254, "led=on", code=2)
    assert "'one' is no id" in refused("read", RX, "one", "led", code=2)
    message = refused("read", RX, 9, "led")
    assert "no servo answers to id 9 (tried dynamixel at 57600" in message
    assert "`--baud all` tries every speed" in message
    assert "is not REGISTER=VALUE" in refused("write", RX, 1, "led", code=2)
    assert "REGISTER" in refused("read", RX, 1, code=2)


def test_where_to_look(load: Callable[..., Any], refused: Callable[..., str]) -> None:
    port = "virtual:rx28@5?clock=virtual&baud=1000000"
    for options in (("--baud", "1000000"), ("--baud", "all"), ("--family", "dynamixel", "--baud", "all")):
        assert load("read", port, 5, "id", *options)["id"]["value"] == 5
    assert "tried lewansoul at 115200" in refused("read", port, 5, "id", "--family", "lewansoul")
    assert load("read", "virtual:rx28@1,lx16a@1?clock=virtual", 1, "present_position", "--family", "lewansoul")
