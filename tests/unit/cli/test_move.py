import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest

from servobus import RX28
from servobus.families import registry
from unit.cli.conftest import ALL, DRS, LX, RX, Run

posix = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")


@pytest.mark.parametrize("family", ALL)
def test_move_arrives(load: Callable[..., Any], family: str) -> None:
    port, id = ALL[family]
    goals = {"dynamixel": (90.0, 200.0), "herkulex": (-45.0, 60.0), "lewansoul": (30.0, 170.0)}[family]
    moved = load("move", port, f"{id}={goals[0]}", f"{id + 1}={goals[1]}deg", "--time", "1.5")
    assert [(one["id"], one["goal"], one["unit"]) for one in moved] == [(id, goals[0], "°"), (id + 1, goals[1], "°")]
    for one, goal in zip(moved, goals, strict=True):
        assert one["position"] == pytest.approx(goal, abs=3)


def test_torque_is_switched_on_and_said(run: Run) -> None:
    result = run("move", RX, "1=150", "3=1.6rad", "--speed", "200")
    assert "torque switched on: id 1, id 3\n" in result.stderr
    lines = result.stdout.splitlines()
    assert lines[0].startswith("RX-28 id 1  1")
    assert lines[1].startswith("RX-28 id 3  9")


def test_no_wait_comes_back_at_once(run: Run) -> None:
    assert run("move", RX, "1=90", "--time", "3", "--no-wait").stdout == "moving for 3.00 s\n"


@pytest.mark.parametrize(
    ("args", "why"),
    [
        (("1=1e400",), "inf is not a number"),
        (("1=310",), "RX-28 id 1: 310.0° is outside 0.0° .. 300.0°"),
        (("1=90", "2=-5"), "RX-28 id 2: -5.0° is outside"),
        (("9=90",), "no servo answers to id 9"),
    ],
)
def test_what_cannot_be_is_refused_before_any_torque(
    refused: Callable[..., str], args: tuple[str, ...], why: str
) -> None:
    assert why in refused("move", RX, *args)


@pytest.mark.parametrize(
    ("args", "why"),
    [
        (("1=nan",), "'nan' is not a number"),
        (("1=inf",), "'inf' is not a number"),
        (("1=90rad",), "90rad are 5156.6°; did you mean 90, in degrees?"),
        (("1=1e308rad",), "did you mean 1e308, in degrees?"),
        (("1=90", "--time", "1e300"), "is more than 3600 s"),
        (("1=90", "1=91"), "id 1 is named twice"),
        (("254=90",), "254 is the broadcast id"),
        (("1=90m",), "'m' is not a unit known here"),
        (("1=90", "--time", "0"), "--time must be above 0"),
        (("1=90", "--speed", "-3"), "--speed must be above 0"),
    ],
)
def test_a_command_line_that_is_wrong_by_itself(refused: Callable[..., str], args: tuple[str, ...], why: str) -> None:
    assert why in refused("move", "/no/such/port", *args, code=2)


@pytest.mark.parametrize("goal", ["500", "400deg", "6.5rad"])
def test_degrees_are_not_asked_for_where_they_were_given(refused: Callable[..., str], goal: str) -> None:
    assert refused("move", RX, f"1={goal}").endswith("is outside 0.0° .. 300.0°\n")


def test_a_move_that_only_goes_on_while_it_is_waited_for_is_waited_for(refused: Callable[..., str]) -> None:
    """Longer than the 2.8448 s that a HerkuleX can be told (6-5)."""
    said = refused("move", DRS, "219=10", "--time", "5.6", "--no-wait")
    assert "goes to the servo in parts of 2.8 s, so the command must wait for it" in said


@pytest.mark.parametrize(
    ("goal", "way"),
    [("1+=5", 5), ("1=+5", 5), ("1-=5", -5), ("1+=-5", -5), ("1-4-=0.1rad", -5.73), ("all-=5deg", -5)],
)
@pytest.mark.parametrize(("model", "start"), [("rx28", 149.9), ("drs0602", 0), ("lx16a", 120)])
def test_M11_a_relative_move(load: Callable[..., Any], model: str, start: float, goal: str, way: float) -> None:
    (one, *_) = load("move", f"virtual:{model}@1-4?clock=virtual", goal, "--time", "0.5")
    assert one["goal"] == pytest.approx(start + way, abs=0.5)
    assert one["position"] == pytest.approx(start + way, abs=2)


def test_M11_minus_is_no_way_back_but_an_angle(load: Callable[..., Any], refused: Callable[..., str]) -> None:
    assert load("move", DRS, "219=-5")[0]["goal"] == -5
    assert "-5.0° is outside" in refused("move", RX, "1=-5")
    assert "is outside" in refused("move", RX, "1+=200")
    for wrong in ("1=+-5", "1=--5", "1+=", "+=5", "1++=5", "1=5+"):
        refused("move", RX, wrong, code=2)


def test_usage(refused: Callable[..., str]) -> None:
    assert "not both" in refused("move", RX, "1=90", "--time", "1", "--speed", "60", code=2)
    assert "--speed: 'nan' is not a number" in refused("move", RX, "1=90", "--speed", "nan", code=2)
    assert "is not ID=ANGLE" in refused("move", RX, "90", code=2)
    assert "'a' is no id" in refused("move", RX, "a=90", code=2)


def test_limits_in_the_servo_are_kept(run: Run, refused: Callable[..., str], tmp_path: Any) -> None:
    port = f"{RX}&state={tmp_path / 'state.json'}"
    run("write", port, 1, "max_position=100", "--save")
    assert "outside the limits set in it, 0.0° .. 100.0°" in refused("move", port, "1=120")


def test_a_wheel_takes_no_angles(run: Run, refused: Callable[..., str], tmp_path: Any) -> None:
    port = f"{RX}&state={tmp_path / 'state.json'}"
    run("turn", port, 1, "--output", "10")
    assert "`servobus turn PORT 1 --end` ends that" in refused("move", port, "1=120")
    assert "takes angles again" in run("turn", port, 1, "--end", "--limits", "10", "200").stdout
    assert json.loads(run("read", port, 1, "max_position", "--json").stdout)["max_position"]["value"] == pytest.approx(
        200, abs=0.2
    )


def test_turn(run: Run, refused: Callable[..., str]) -> None:
    result = run("turn", LX, 1, "--output", "-30%")
    assert "LX-16A id 1 turns at -30.0 % of full output; `servobus stop" in result.stdout
    assert "torque switched on" in result.stderr
    assert "DRS-0602 id 219 turns at -90.0°/s" in run("turn", DRS, 219, "--speed", "-90").stdout
    assert "RX-28 id 1 cannot control the speed at which it turns: give --output PERCENT" in refused(
        "turn", RX, 1, "--speed", "90"
    )
    assert "DRS-0602 id 219 controls the speed at which it turns: give --speed DEG/S" in refused(
        "turn", DRS, 219, "--output", "9"
    )
    assert "--output: 300 % is not in -100 .. 100" in refused("turn", RX, 1, "--output", "300", code=2)
    assert "say one of" in refused("turn", RX, 1, code=2)
    assert "goes with --end" in refused("turn", RX, 1, "--output", "9", "--limits", "1", "2", code=2)


def test_limits_that_cannot_be(refused: Callable[..., str]) -> None:
    for limits, why in (
        ((400, 20), "400.0°"),
        ((-3, 20), "-2.9°"),
        ((30, 20), "30.0° is not below 20.0°"),
    ):
        assert why in refused("turn", RX, 1, "--end", "--limits", *limits)
    assert "nan" in refused("turn", RX, 1, "--end", "--limits", "nan", 20, code=2)


def test_the_ways_back_can_be_typed(run: Run) -> None:
    result = run("turn", RX, 1, "--output", "10")
    assert f"servobus turn '{RX}' 1 --end --limits 0.0 300.0" in result.stderr


@pytest.mark.parametrize("family", ALL)
def test_torque_and_stop(run: Run, family: str) -> None:
    port, id = ALL[family]
    assert run("torque", port, id, id + 1, "on").stdout.count(": torque on\n") == 2
    assert run("torque", port, id, "off").stdout.endswith("torque off\n")
    assert run("stop", port, id).stdout.endswith(f"id {id} stopped: it drives nothing: its torque was off\n")


def test_all(run: Run, refused: Callable[..., str]) -> None:
    assert run("stop", RX, "all", "--family", "dynamixel").stdout.count(" stopped: ") == 3
    assert run("torque", RX, "all", "on", "--family", "dynamixel").stdout.count("torque on\n") == 3
    result = run("torque", RX, "all", "off")
    speeds = ", ".join(map(str, registry.bauds(RX28.family)))
    assert " ".join(result.stdout.split()).startswith(f"torque off: told all ids dynamixel at {speeds} herkulex at ")
    assert max(map(len, result.output.splitlines())) <= 80
    assert "either ids or `all`" in refused("stop", RX, "1", "all", code=2)
    assert "no servo answers (lewansoul at 115200)" in refused("stop", RX, "all", "--family", "lewansoul")
    assert run("torque", RX, 1, 1, "on").stdout == "RX-28 id 1: torque on\n"
    assert "broadcast" in refused("torque", RX, 254, "on", code=2)
    refused("torque", RX, 1, "maybe", code=2)


def test_led(run: Run, refused: Callable[..., str]) -> None:
    assert run("led", RX, 1, "on").stdout == "RX-28 id 1: light on\n"
    assert run("led", DRS, 219, "Magenta").stdout == "DRS-0602 id 219: light magenta\n"
    assert "not 'green'" in refused("led", LX, 1, "green")


@posix
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_stops_the_servos(end: signal.Signals) -> None:
    command = [sys.executable, "-u", "-m", "servobus", "move", "virtual:rx28@1,2", "1=10", "2=290", "--time", "20"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "torque switched on: id 1, id 2\n"
        time.sleep(0.1)
        process.send_signal(end)
        stdout, stderr = process.communicate(timeout=10)
    assert (process.returncode, stdout) == (130, "")
    assert re.fullmatch(r"\n(RX-28 id [12] stopped: held at \d+\.\d°\n){2}", stderr)
