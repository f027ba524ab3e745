"""Servos of a model that nobody here knows, on the command line: what their protocol gives works (T1, T2)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from unit.cli.conftest import Run

UNKNOWN = {
    # An XL430-W250 has the number 1060: ROBOTIS e-manual. A DRS-0102 reports 01 02.
    "dynamixel": ("virtual:rx28@1,model_number=1060?clock=virtual", "Dynamixel servo, model 1060, id 1"),
    "herkulex": ("virtual:drs0602@1,model_no1=1,model_no2=2?clock=virtual", "HerkuleX servo, model 0102, id 1"),
}
MUTE = "virtual:rx28@1,model_number=1060,status_return_level=0?clock=virtual"
ONE = pytest.mark.parametrize(("port", "name"), UNKNOWN.values(), ids=UNKNOWN)


@ONE
def test_T2_verbs_without_units_work(run: Run, port: str, name: str) -> None:
    assert name in run("scan", port, "--ids", "0-3").stdout
    assert name in run("info", port, 1).stdout
    assert "(raw)" in run("read", port, 1, "present_position").stdout
    for verb, said in {
        ("torque", port, 1, "on"): "torque on",
        ("torque", port, 1, "off"): "torque off",
        ("stop", port, 1): "stopped",
        ("led", port, 1, "on"): "light on",
        ("set-id", port, 1, 7): "is now id 7",
        ("set-baud", port, 1, 500_000): "talks at 500000 baud now",
    }.items():
        out = run(*verb).stdout
        assert name in out
        assert said in out
    (line,) = run("rearm", port, 1).stdout.splitlines()
    assert line.startswith(f"{name}: torque on, holds ")
    assert line.endswith(" (raw)")
    assert "nothing is wrong" in run("doctor", port, "--ids", "0-3", "--reads", 10).stdout


def test_T2_a_herkulex_is_rebooted(run: Run, refused: Callable[..., str]) -> None:
    port, name = UNKNOWN["herkulex"]
    assert run("reboot", port, 1).stdout.startswith(f"{name} restarted")
    assert "protocol 1.0 has no such instruction" in refused("reboot", UNKNOWN["dynamixel"][0], 1)


@pytest.mark.parametrize("port", [*(port for port, _ in UNKNOWN.values()), MUTE])
def test_T1_verbs_with_units_are_refused(refused: Callable[..., str], port: str) -> None:
    for verb in (
        ("move", port, "1=10"),
        ("turn", port, 1, "--speed", 10),
        ("turn", port, 1, "--output", "10%"),
        ("turn", port, 1, "--end", "--limits", 20, 280),
        ("write", port, 1, "goal_position=100"),
        ("step", port, 1, "--limits", 20, 280),
    ):
        assert "--model" in refused(*verb)


@ONE
def test_T1_a_backup_is_not_restored(
    run: Run, refused: Callable[..., str], tmp_path: Path, port: str, name: str
) -> None:
    file = tmp_path / "settings.toml"
    assert name in run("backup", port, 1, file).output
    assert "--model" in refused("restore", port, 1, file)


@ONE
def test_T2_alarms_are_shown(run: Run, load: Callable[..., Any], port: str, name: str) -> None:
    low = f"{port}&voltage=4"
    out = run("scan", low).stdout  # of all ids: a HerkuleX tells of it after a while
    assert name in out
    assert "ALARM input_voltage" in out
    (found,) = load("scan", low)
    assert found["alarms"] == ["input_voltage"]
    assert "input_voltage" in run("doctor", low, "--ids", "0-3", "--reads", 10, code=1).stdout


def test_T1_a_servo_that_answers_no_reads_is_of_no_known_model(run: Run, refused: Callable[..., str]) -> None:
    """Status Return Level 0 (RX-28 manual 3-4-1): PING alone is answered, and says no model number."""
    name = "Dynamixel servo, model unknown, id 1"
    assert run("scan", MUTE, "--ids", "0-3").stdout.startswith(f"{name} at 57600")
    for verb in (("info", MUTE, 1), ("read", MUTE, 1, "present_position"), ("torque", MUTE, 1, "on")):
        assert "`servobus write PORT 1 status_return_level=1` lets it answer" in refused(*verb)
    assert f"{name}: torque off" in run("torque", MUTE, 1, "off").stdout
    assert f"{name} stopped: let go" in run("stop", MUTE, 1).stdout
    assert f"{name} is now id 7" in run("set-id", MUTE, 1, 7).stdout
    assert "answers no reads" in run("doctor", MUTE, "--ids", "0-3", "--reads", 10).stdout
