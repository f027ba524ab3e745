"""Options of virtual servos on the command line: `virtual`, its console, `info`, `models` and `registers`."""

import os
import re
from collections.abc import Callable
from typing import Any

import pytest
from click.testing import CliRunner

from samples import sample_models
from servobus import MODELS
from servobus.cli.app import app
from servobus.virtual.device.options import defaults, options_of
from servobus.virtual.device.servo import firmware
from unit.cli.conftest import Run
from unit.cli.test_virtual import served
from unit.cli.test_virtual_console import Desk

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo terminals and signals as on POSIX")


@posix
def test_the_server_says_what_is_not_as_usual(load: Callable[..., Any]) -> None:
    notes = (
        "RX-28 id 1, 2: goal_torque=off\n"
        "LX-16A id 7: surplus=ignored, wait_read=silent\n"
    )  # fmt: skip
    words = "rx28@1-2,goal_torque=off,3", "drs0602@4,lx16a@7", "surplus=ignored,wait_read=silent"
    with served(*words, notes=notes.replace("1, 2:", "1, 2, 3:")) as port:
        assert load("read", port, "7", "torque_enable")


@posix
def test_a_reading_for_all(load: Callable[..., Any]) -> None:
    notes = "RX-28 id 1: answer_time=off, goal_torque=off\n"
    with served("rx28@1", "--as", "manual", notes=notes) as port:
        assert load("read", port, "1", "return_delay_time")


def test_what_makes_no_sense(refused: Callable[..., str]) -> None:
    assert "did you mean goal_torque" in refused("virtual", "rx28@1,gaol_torque=off")
    assert "on, off" in refused("virtual", "rx28@1,goal_torque=perhaps")
    assert "practice" in refused("virtual", "rx28@1", "--as", "hearsay", code=2)


@sample_models
def test_help_lists_every_option_of_every_model(key: str) -> None:
    named = re.escape(MODELS[key].title)
    text = CliRunner().invoke(app, ["virtual", "--help"], terminal_width=80).output
    sections = [" ".join(part.split()) for part in re.split(r"^Options of ", text, flags=re.MULTILINE)[1:]]
    (about,) = [part for part in sections if re.match(rf"{named}[, ]|.*?The same for ([^.]+, )?{named}[,.]", part)]
    for name, option in options_of(firmware(MODELS[key])).items():
        value = option.kind.show(defaults(firmware(MODELS[key]), MODELS[key])[name])
        assert f" {name}={value} " in about
        assert option.decision in about


def test_the_console_shows_and_sets_them() -> None:
    desk = Desk("rx28@1-2,lx16a@1")
    first, second, small = desk.rig.servos
    said = desk.type("options rx28@1-2")
    assert said.splitlines()[0].startswith("RX-28 id 1: answer_time=20µs-200µs, bad_checksum=answered, boot_time=off")
    assert "goal_torque=on" in said
    assert "goal_torque=off, " in desk.type("options 1 goal_torque=off")
    assert [servo.options["goal_torque"] for servo in (first, second, small)] == [False, True, False]
    assert "eeprom_pause=6ms" in desk.type("options 2 eeprom_pause=6ms goal_torque=off")
    assert (second.options["eeprom_pause"], second.options["goal_torque"]) == ((0.006, 0.006), False)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("options 1 surplus=obeyed", "RX-28 has no option 'surplus'"),
        ("options all goal_torque=perhaps", "on, off"),
        ("options all goal_torque", "NAME=VALUE"),
        ("options 9", "there is no servo 9"),
    ],
)
def test_the_console_sets_all_or_none(line: str, why: str) -> None:
    desk = Desk("lx16a@1,rx28@1-2")
    before = [dict(servo.options) for servo in desk.rig.servos]
    assert why in desk.type(line)
    assert [servo.options for servo in desk.rig.servos] == before


@sample_models
def test_info_shows_those_of_a_virtual_servo(key: str, load: Callable[..., Any], run: Run) -> None:
    port = f"virtual:{key}@1,answer_time=off?clock=virtual"
    shown = load("info", port, "1", "--model", key)["options"]
    assert shown["answer_time"] == "off"
    assert set(shown) == set(options_of(firmware(MODELS[key])))
    text = run("info", port, "1", "--model", key).stdout
    assert "options of this virtual servo" in text
    assert re.search(r"^answer_time +off$", text, re.MULTILINE)


@sample_models
def test_registers_and_models_list_them(key: str, load: Callable[..., Any], run: Run) -> None:
    names = list(options_of(firmware(MODELS[key])))
    entry = next(one for one in load("models") if one["name"] == key)
    assert [option["name"] for option in entry["options"]] == names
    text = run("registers", key).stdout
    assert all(f"\n{name}=" in text for name in names)
    assert f"\n{names[0]}=" not in run("registers", key, "id").stdout
