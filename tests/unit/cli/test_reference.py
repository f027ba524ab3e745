import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from servobus import MODELS
from servobus.families.dynamixel.places import Address
from unit.cli.conftest import Run


def test_models_are_listed(run: Run) -> None:
    lines = run("models").stdout.splitlines()
    named = [line.split()[0] for line in lines[1:]]
    assert sorted(named) == sorted(MODELS)
    kinds = [(MODELS[name].family.name, MODELS[name].series) for name in named]
    assert len([kind for kind, _ in itertools.groupby(kinds)]) == len(set(kinds))  # each series stands together


def test_models_as_json(load: Callable[..., Any]) -> None:
    models = {one["name"]: one for one in load("models")}
    assert {key: one["family"] for key, one in models.items()} == {
        key: model.family.name for key, model in MODELS.items()
    }
    rx, drs, lx = (models[key] for key in ("rx28", "drs0602", "lx16a"))
    assert [one["family"] for one in (rx, drs, lx)] == ["dynamixel", "herkulex", "lewansoul"]
    assert rx["angle"] == {"value": 300.0, "unit": "°"}
    assert drs["performance"] == [
        {
            "voltage": {"value": 14.8, "unit": "V"},
            "stall_torque": {"value": 7.6, "unit": "N·m"},
            "speed": {"value": 365.8537, "unit": "°/s"},
            "stall_current": None,
        }
    ]
    assert lx["number"] is None


@pytest.mark.parametrize("model", MODELS)
def test_registers_as_json(load: Callable[..., Any], model: str) -> None:
    rows = load("registers", model)
    assert [row["name"] for row in rows] == list(MODELS[model].registers)
    wanted = {
        "name",
        "aliases",
        "size",
        "access",
        "limits",
        "default",
        "unit",
        "meaning",
        "note",
        "area",
        "allowed",
        "raw",
    }
    for row in rows:
        assert set(row) - {"address", "command"} == wanted
        assert ("address" in row) != ("command" in row)


def test_where_registers_live(load: Callable[..., Any]) -> None:
    (goal,) = load("registers", "rx28", "goal_position")
    assert MODELS["rx28"].register("goal_position").place == Address(30)
    assert goal["address"] == 30
    assert (goal["limits"], goal["unit"], goal["access"], goal["raw"]["limits"]) == ([0.0, 300.0], "°", "rw", [0, 1023])
    (id, torque) = load("registers", "drs0602", "id", "torque_control")
    assert (id["address"], torque["address"]) == ({"eep": 6, "ram": 0}, {"ram": 52})
    (speed,) = load("registers", "lx16a", "motor_speed")
    assert speed["command"] == {"write": 29, "read": 30, "byte": 2}


def test_registers_are_found_by_alias(load: Callable[..., Any]) -> None:
    (row,) = load("registers", "drs0602", "torque_enable")
    assert (row["name"], row["aliases"]) == ("torque_control", ["torque_enable"])
    assert row["allowed"] == ["free", "brake", "on"]


def test_registers_for_people(run: Run) -> None:
    text = run("registers", "RX-28").stdout
    assert "goal_position" in text
    assert "RAM 30, 2 bytes, read, write" in text
    assert "    0.0° .. 300.0°" in text
    assert max(map(len, text.splitlines())) <= 80


def test_flags_and_choices_are_listed_as_they_are_typed(run: Run) -> None:
    assert (
        "any of over_temperature, over_voltage, locked_rotor, joined by +"
        in run("registers", "lx16a", "led_error").stdout
    )
    assert "nothing, reads, everything; factory setting reads" in run("registers", "drs0602", "ack_policy").stdout


def test_notes_are_shown_for_named_registers(run: Run) -> None:
    assert "ED-16" in run("registers", "rx28", "registered_instruction").stdout
    assert "ED-16" not in run("registers", "rx28").stdout


def test_unknown_names(refused: Callable[..., str]) -> None:
    assert "no model 'rx29'; did you mean rx28?" in refused("registers", "rx29")
    assert "did you mean goal_position" in refused("registers", "rx28", "goal_positon")


@pytest.fixture
def _nothing_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


@pytest.mark.usefixtures("_nothing_remembered")
def test_ports(run: Run, load: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    fakes = [ListPortInfo(f"/dev/ttyUSB{number}", skip_link_detection=True) for number in (1, 0)]
    fakes[1].description = "USB2Dynamixel"
    monkeypatch.setattr(list_ports, "comports", lambda: fakes)
    assert run("ports").stdout == "/dev/ttyUSB0  USB2Dynamixel\n/dev/ttyUSB1\n"
    assert load("ports")[0] == {
        "port": "/dev/ttyUSB0",
        "description": "USB2Dynamixel",
        "hardware": "",
        "remembered": {},
        "listed": True,
    }


@pytest.mark.usefixtures("_nothing_remembered")
def test_no_ports(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(list_ports, "comports", list)
    result = run("ports")
    assert result.stdout == ""
    assert "no serial port is plugged in" in result.stderr


def test_what_is_known_of_one_model_and_how_sure_that_is(run: Run) -> None:
    text = run("models", "RX-28").stdout
    assert text.startswith("ROBOTIS RX-28")
    assert "confidence high" in text


def test_a_model_that_is_not_known_changes_nothing(run: Run) -> None:
    assert "did you mean rx28?" in run("models", "rx2", code=1).stderr


def test_the_difference_between_two_tables(run: Run, load: Callable[..., Any]) -> None:
    rows = load("registers", "rx28", "goal_position", "--diff", "lx16a")
    assert {row["register"] for row in rows} == {"goal_position"}
    (place,) = (row for row in rows if row["what"] == "where")
    assert place["rx28"] == "RAM 30, 2 bytes, read, write"
    assert "no difference" in run("registers", "rx28", "--diff", "rx28").stdout


@pytest.mark.parametrize("key", [key for key, model in MODELS.items() if model.firmware])
def test_a_model_says_what_the_motor_of_its_virtual_servo_stands_on(
    run: Run, load: Callable[..., Any], key: str
) -> None:
    text = run("models", key).stdout
    (entry,) = load("models", key)
    sets = entry["motor"]["sets"]
    assert sets[0]["name"] == "manual"
    for number in sets[0]["parameters"].values():
        assert number["source"] + (f" from {number['sibling']}: " if number["sibling"] else ": ") in text
        assert f" ({number['text']})" in text
    for other in sets[1:]:
        assert f"motor={other['name']}: {other['text']}" in text
    for missed in entry["motor"]["not_met"]:
        assert f"not met: {missed}" in text


def test_figures_that_contradict_each_other_are_told(run: Run) -> None:
    """LX-16A: 17 kgf·cm at 6 V does not go with 19.5 at 7.4 V. RX-28: 3.7 N·m at 18.5 V is that of 16 V in print."""
    assert (
        "not met: stall torque 1.67 N·m at 6 V, which contradicts the others; the motor has"
        in run("models", "lx16a").stdout
    )
    assert "not met: stall torque 3.7 N·m at 18.5 V (ROBOTIS e-manual)" in run("models", "rx28").stdout
