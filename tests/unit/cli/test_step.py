"""`step`: figures and a picture, virtual and on a port."""

import importlib.util
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servobus import RX28
from unit.cli.conftest import Run
from unit.served import PATIENCE, Arm, stops, wait_for

Refused = Callable[..., str]
has_matplotlib = pytest.mark.skipif(importlib.util.find_spec("matplotlib") is None, reason="matplotlib is an extra")
posix = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")


@pytest.mark.parametrize(("model", "start"), [("rx28", 149.9), ("drs0602", 0.0), ("lx16a", 120.0)])
def test_figures_of_a_virtual_servo(load: Callable[..., Any], model: str, start: float) -> None:
    said = load("step", model)
    assert said["start"]["value"] == pytest.approx(start, abs=0.1)
    assert said["goal"]["value"] == pytest.approx(start + 45, abs=0.1)
    # 36° at 360 to 480°/s without load, and some time to get there.
    assert 0.07 < said["rise_time"]["value"] < 0.2
    assert said["overshoot"]["value"] < 10
    assert said["settling_time"]["value"] < 0.5
    assert abs(said["steady_error"]["value"]) < 0.6
    assert said["peak_current"]["value"] > 0.3


def test_the_same_for_people(run: Run) -> None:
    lines = run("step", "rx28", "--to", "90deg").stdout.splitlines()
    assert lines[0] == "RX-28, virtual: 149.9° to 90.0°"
    assert [line.split("  ")[1] for line in lines[1:]] == [
        "rise time", "overshoot", "settling time", "steady error", "peak current",
    ]  # fmt: skip


def test_a_register_makes_a_difference(load: Callable[..., Any]) -> None:
    # A quarter of the torque limit: a quarter of the torque and, for a motor, of the speed.
    stiff, soft = load("step", "rx28"), load("step", "rx28", "--set", "torque_limit=25")
    assert soft["rise_time"]["value"] > 2 * stiff["rise_time"]["value"]


def test_one_that_does_not_arrive(run: Run, load: Callable[..., Any]) -> None:
    lines = run("step", "rx28", "--to", "90", "--load", "blocked").stdout.splitlines()
    assert lines[3].split()[:3] == ["settling", "time", "-"]
    assert lines[-1] == "  it did not arrive: it ends up at 150.0°"
    said = load("step", "rx28", "--to", "90", "--load", "blocked")
    assert (said["arrived"], said["settling_time"]["value"]) == (False, None)
    assert load("step", "rx28", "--to", "90")["arrived"]


def test_voltage_and_load_make_a_difference(load: Callable[..., Any]) -> None:
    strong, weak = load("step", "lx16a", "--voltage", "8.4"), load("step", "lx16a", "--voltage", "6.6")
    assert weak["rise_time"]["value"] > 1.1 * strong["rise_time"]["value"]
    heavy = load("step", "lx16a", "--voltage", "8.4", "--load", "inertia=0.05")
    assert heavy["rise_time"]["value"] > 1.2 * strong["rise_time"]["value"]


def test_where_it_starts_and_how_long_it_takes(load: Callable[..., Any]) -> None:
    said = load("step", "rx28", "--start", "60", "--to", "120", "--time", "1")
    assert said["start"]["value"] == pytest.approx(60, abs=0.3)
    assert said["rise_time"]["value"] == pytest.approx(0.8, abs=0.1)


@has_matplotlib
@pytest.mark.parametrize(("name", "magic"), [("a.png", b"\x89PNG"), ("b.svg", b"<?xml")])
def test_a_picture(run: Run, tmp_path: Path, name: str, magic: bytes) -> None:
    file = tmp_path / name
    assert f"drawn: {file}" in run("step", "drs0602", "--time", "0.5", "--plot", str(file)).stderr
    assert file.read_bytes().startswith(magic)


def test_on_a_port_within_limits(load: Callable[..., Any]) -> None:
    port = "virtual:rx28@1?clock=real"
    said = load("step", port, "1", "--to", "170", "--limits", "100", "200", "--seconds", "0.6")
    assert said["goal"]["value"] == pytest.approx(170, abs=0.1)
    assert abs(said["steady_error"]["value"]) < 1
    assert said["peak_current"]["value"] is None


@posix
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("torque", [0, 1])
def test_ctrl_c_stops_it_and_leaves_it_as_it_was(end: signal.Signals, torque: int) -> None:
    with Arm("rx28@1") as arm:
        with arm.open() as bus:
            servo = bus.find(1)
            servo.write_raw({RX28.moving_speed: 100, RX28.torque_enable: torque})
        command = [sys.executable, "-m", "servobus", "step", arm.name, "1", "--to", "290", "--time", "10"]
        with subprocess.Popen(
            [*command, "--limits", "0", "300", "--seconds", "60"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            # WRITE_DATA to Goal Position and Moving Speed: address 30, four bytes (3-4)
            wait_for(lambda: any(one.code == 3 and one.data[0] == 30 and len(one.data) == 5 for one in arm.heard))
            process.send_signal(end)
            stdout, stderr = process.communicate(timeout=PATIENCE)
        assert (process.returncode, stdout) == (130, "")
        assert re.fullmatch(r"\nRX-28 id 1 stopped: held at \d+\.\d°\n", stderr)
        assert stops(arm.settled(), "rx28", 1) >= 1
        (real,) = arm.servos
        assert (real.get("moving_speed"), real.get("torque_enable")) == (100, torque)


def test_N19_what_answers_in_place_of_a_person_is_named(run: Run) -> None:
    result = run("step", "virtual:rx28@1?clock=real", "1", code=1, input="")
    assert "RX-28 id 1 is at 149.9° and will jump to 194.9° as fast as it can." in result.stderr
    assert "nobody is there to answer, and nothing was changed: say --limits LOW HIGH" in result.stderr
    assert "--yes" not in result.stderr


@pytest.mark.parametrize(("verb", "rest"), [("reset", []), ("restore", ["a.toml"])])
def test_N19_every_option_that_a_message_names_is_there(
    run: Run, verb: str, rest: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run("backup", "virtual:rx28@1?clock=virtual", 1, "a.toml")
    Path("a.toml").write_text(Path("a.toml").read_text().replace("max_torque = 1023", "max_torque = 512"))
    said = run(verb, "virtual:rx28@1?clock=virtual", 1, *rest, code=1, input="").stderr
    assert "--yes goes ahead" in said
    run(verb, "virtual:rx28@1?clock=virtual", 1, *rest, "--yes")


@pytest.mark.parametrize(
    ("model", "start", "range_"),
    [
        ("rx28", "500", "0.0° .. 300.0°"),
        ("rx28", "-5", "0.0° .. 300.0°"),
        ("lx16a", "300", "0.0° .. 240.0°"),
        ("drs0602", "3.5rad", "-159.9° .. 159.6°"),
    ],
)
def test_N20_a_start_is_checked(refused: Callable[..., str], model: str, start: str, range_: str) -> None:
    said = refused("step", model, "--start", start, code=2)
    assert "--start" in said
    assert f"is not in {range_}" in said


@pytest.mark.parametrize(("model", "start"), [("rx28", 300), ("rx28", 280), ("lx16a", 240), ("drs0602", 159)])
def test_N20_a_step_from_the_end_of_the_range_goes_back(load: Callable[..., Any], model: str, start: float) -> None:
    said = load("step", model, "--start", start)
    assert said["arrived"]
    assert said["goal"]["value"] == pytest.approx(start - 45, abs=2)


def test_numbers_that_are_none(refused: Callable[..., str]) -> None:
    assert "not a number" in refused("step", "rx28", "--to", "nan", code=2)
    for seconds in ("0", "61"):
        assert "is not above 0 and up to 60" in refused("step", "rx28", "--seconds", seconds, code=2)


def test_N20_a_time_of_0_is_none(refused: Callable[..., str]) -> None:
    for time in ("0", "-1"):
        assert "is not above 0" in refused("step", "rx28", "--time", time, code=2)


def test_limits_are_asked_for(run: Run) -> None:
    port = "virtual:rx28@1?clock=real"
    result = run("step", port, "1", "--to", "170", code=1, input="100\n160\n")
    assert "leaves 100.0° .. 160.0°" in result.stderr


@pytest.mark.parametrize(
    ("args", "why"),
    [
        (("rx29",), "no model 'rx29'; did you mean rx28?"),
        (("rx28", "--to", "400"), "outside"),
        (("rx28", "--set", "punsh=1"), "did you mean punch"),
        (("rx28", "--set", "punch=200"), "punch"),
        (("rx28", "--set", "led=1", "--set", "led=0"), "set twice"),
        (("rx28", "--motor", "huge"), "no motor data 'huge'"),
        (("rx28", "--plot", "step.doc"), "a picture is one of png, svg, pdf"),
        (("rx28", "--plot", "no/such/folder/step.png"), "there is no folder"),
        (("virtual:rx28@1", "254"), "broadcast"),
    ],
)
def test_what_cannot_be_is_refused(refused: Refused, args: tuple[str, ...], why: str) -> None:
    assert why in refused("step", *args)


def test_a_port_needs_an_id(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm").touch()  # as the link of `servobus virtual --pty arm`
    for port in ("/dev/ttyUSB0", "COM4", "arm"):
        assert f"{port} is a port: name the ID of a servo on it too" in run("step", port, code=2).stderr
    assert "no model 'leg'" in run("step", "leg", code=1).stderr
