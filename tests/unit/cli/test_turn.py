"""`turn` of the models that differ: wheel by speed, several turns, a given current, no endless turn at all."""

from collections.abc import Callable
from typing import Any

import pytest

from unit.cli.conftest import Run

MX = "virtual:mx28@1?clock=virtual"
MX64 = "virtual:mx64@1?clock=virtual"
DX = "virtual:dx117@1?clock=virtual"
AX = "virtual:ax12a@1?clock=virtual"


def test_an_mx_turns_at_a_speed_and_says_how_to_come_back(run: Run) -> None:
    result = run("turn", MX, 1, "--speed", 90)
    assert result.stdout.startswith("MX-28 id 1 turns at 90.0°/s; ")
    assert "it gives up its angle limits, 0.0° to 359.9°, for that; back to angles: " in result.stderr
    assert "--end --limits 0.0 359.9" in result.stderr


def test_goals_of_several_turns(run: Run, load: Callable[..., Any]) -> None:
    assert run("turn", MX, 1, "--multi").stdout == "MX-28 id 1 takes angles of several turns; it is at 180.0°\n"
    told = load("turn", MX, 1, "--multi")
    assert (told["turning"], told["position"]["unit"]) == (False, "°")
    assert told["position"]["value"] == pytest.approx(180, abs=0.1)


def test_a_given_current(run: Run, load: Callable[..., Any]) -> None:
    result = run("turn", MX64, 1, "--current", "0.45A")
    assert result.stdout.startswith("MX-64 id 1 turns at 0.45 A; ")
    assert "gives up" not in result.stderr
    told = load("turn", MX64, 1, "--current", "-0.9")
    assert told["turning"]
    assert told["current"]["value"] == pytest.approx(-0.9)
    assert told["current"]["unit"] == "A"


@pytest.mark.parametrize(
    ("port", "option", "said"),
    [
        (MX, ("--output", 20), "MX-28 id 1 controls the speed at which it turns: give --speed DEG/S"),
        (AX, ("--speed", 20), "AX-12A id 1 cannot control the speed at which it turns: give --output PERCENT"),
        (DX, ("--output", 20), "DX-117 id 1 cannot turn without end: the DX series has no such mode"),
        (DX, ("--multi",), "DX-117 id 1 cannot count its goals over several turns: its limits cannot say so"),
        (MX, ("--current", 1), "MX-28 id 1 cannot turn with a given current: it does not control its current"),
        (MX64, ("--current", 9), "goal_torque"),
    ],
)
def test_what_a_model_cannot_is_refused(
    refused: Callable[..., str], port: str, option: tuple[Any, ...], said: str
) -> None:
    assert said in refused("turn", port, 1, *option)


def test_one_of_these_is_said(refused: Callable[..., str]) -> None:
    assert "say one of" in refused("turn", MX, 1, "--multi", "--end", code=2)
    assert "--limits goes with --end" in refused("turn", MX, 1, "--multi", "--limits", 10, 20, code=2)
