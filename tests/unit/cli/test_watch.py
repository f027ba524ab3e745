"""M1: live values and curves of real servos, in the terminal and in a file."""

import csv
import json
import math
import os
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servobus import MODELS
from servobus.cli.canvas import MARKS, Curve, Panel, draw
from servobus.families import registry
from unit.cli.conftest import Run
from unit.served import Arm

ARM = "virtual:rx28@1-2,lx16a@7?clock=virtual"
posix = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")


def rows(file: Path) -> list[dict[str, str]]:
    with file.open(encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


def test_M1_values_line_by_line_where_there_is_no_terminal(run: Run) -> None:
    said = run("read", ARM, "1,7", "present_position", "present_temperature", "--watch", "--seconds", 0.5).stdout
    assert said.splitlines() == [
        f"    0.{n}0 s  {who}  present_position {angle}  present_temperature 25 °C"
        for n in (0, 2, 4)
        for who, angle in (("RX-28 id 1", "149.9°"), ("LX/HTS bus servo, model unknown, id 7", "120.0°"))
    ]


def test_M1_what_makes_no_sense_is_asked_for_once_more(run: Run) -> None:
    port = "virtual:rx28@1-2?clock=virtual&faults=seed=1,drop@3=0.1"
    said = run("read", port, "1,2", "present_temperature", "--watch", "--interval", 0.1, "--seconds", 3).stdout
    assert said.count("25 °C") >= 60
    assert "no answer" not in said


def test_M1_an_object_a_line(run: Run) -> None:
    said = run("read", ARM, "1,7", "present_temperature", "--watch", "--interval", 0.25, "--seconds", 0.3, "--json")
    assert [json.loads(line) for line in said.stdout.splitlines()] == [
        {"time": time, "family": family, "model": model, "id": id,
         "registers": {"present_temperature": {"value": 25.0, "unit": "°C"}}}
        for time in (0, 0.25)
        for family, model, id in (("dynamixel", "rx28", 1), ("lewansoul", None, 7))
    ]  # fmt: skip


def test_M1_values_are_kept(run: Run, refused: Callable[..., str], tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    command = ("read", ARM, "all", "present_voltage", "torque_enable", "--watch", "--interval", 0.1, "--csv", file)
    run(*command, "--seconds", 0.95)
    kept = rows(file)
    assert len(kept) == 10 * 3 * 2
    assert kept[0] == {
        "time": "0.000000", "model": "rx28", "id": "1", "register": "present_voltage", "value": "14.4", "unit": "V",
    }  # fmt: skip
    assert [row["value"] for row in kept if row["register"] == "torque_enable"] == ["False"] * 30
    assert [float(row["time"]) for row in kept[::6]] == pytest.approx([n / 10 for n in range(10)])
    assert "exists already and is not replaced" in refused(*command, "--seconds", 1)


def test_M1_a_lost_servo_is_shown_and_comes_back(run: Run, tmp_path: Path) -> None:
    port = "virtual:rx28@1-2?clock=virtual&faults=unplug@2%231s-2s"
    file = tmp_path / "a.csv"
    lines = run(
        "read", port, "1,2", "present_temperature", "--watch", "--seconds", 4, "--csv", file
    ).stdout.splitlines()
    second = [line for line in lines if "id 2" in line]
    told = ["no answer" in line for line in second]
    assert told[0] is told[-1] is False
    assert any(told)
    assert all("25 °C" in line for line in lines if "id 1" in line)
    assert [row["value"] for row in rows(file) if row["id"] == "2"] == ["" if lost else "25.0" for lost in told]


def test_M1_who_is_not_there_at_the_start_is_told(run: Run, refused: Callable[..., str]) -> None:
    result = run("read", ARM, "1,99", "present_temperature", "--watch", "--seconds", 0.1, code=1)
    assert "id 1" in result.stdout
    assert "no servo answers to id 99" in result.stderr
    assert "no servo answers to id 99" in refused("read", ARM, "99", "present_temperature", "--watch", "--seconds", 1)


@pytest.mark.parametrize("key", ["rx28", "drs0602", "lx16a"])
def test_M1_who_is_not_there_at_the_start_joins_in(run: Run, tmp_path: Path, key: str) -> None:
    port = f"virtual:rx28@1,{key}@2?clock=virtual&faults=unplug@2:2s"
    file = tmp_path / "a.csv"
    command = (port, "1,2", "present_temperature", "--seconds", 8, "--csv", file)
    title = registry.GENERIC["lewansoul"].named("id 2") if key == "lx16a" else f"{MODELS[key].title} id 2"
    result = run("read", *command, "--watch")
    assert "no servo answers to id 2" in result.stderr
    assert f"{title}: answers now" in result.stderr
    kept = rows(file)
    assert [row["value"] for row in kept if row["id"] == "1"][:1] == ["25.0"]
    joined = [float(row["time"]) for row in kept if row["id"] == "2" and row["value"]]
    assert 0.5 < joined[0] < 6.0
    file.unlink()
    assert f"x {title}" in run("plot", *command).stdout


@pytest.mark.parametrize("verb", [("read", "--watch"), ("plot",)])
def test_M1_who_never_answers_is_told_at_the_end(run: Run, verb: tuple[str, ...]) -> None:
    result = run(verb[0], ARM, "1,98,99", "present_temperature", "--seconds", 2.5, *verb[1:], code=1)
    assert "id 98, 99 has never answered" in result.stderr


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--interval", 1], "--interval goes with --watch"),
        (["--seconds", 1], "--seconds goes with --watch"),
        (["--csv", "a.csv"], "--csv goes with --watch"),
        (["--watch", "--interval", 0], "0 is not above 0"),
        (["--watch", "--seconds", -1], "-1 is not above 0"),
        (["--watch", "--interval", "nan"], "not a number"),
    ],
)
def test_M1_options_that_make_no_sense(refused: Callable[..., str], options: list[Any], why: str) -> None:
    assert why in refused("read", ARM, 1, "led", *options, code=2)


def test_M1_a_register_that_one_of_them_lacks(refused: Callable[..., str]) -> None:
    assert "LX/HTS bus servo, model unknown has no register 'punch'" in refused("read", ARM, "all", "punch", "--watch")


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("verb", [("read", "--watch"), ("plot",)])
def test_M1_ctrl_c_ends_it_well(number: signal.Signals, verb: tuple[str, ...], tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    with Arm("rx28@1") as arm:
        command = [sys.executable, "-m", "servobus", verb[0], arm.name, "1", "present_position", *verb[1:]]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        with subprocess.Popen([*command, "--csv", file], text=True, **pipes) as process:  # type: ignore[call-overload]
            while not (file.exists() and file.read_text().count("\n") > 3):
                assert process.poll() is None, process.stderr.read()
            process.send_signal(number)
            out, err = process.communicate(timeout=20)
    assert process.returncode == 0
    assert "Traceback" not in err
    assert "id 1" in out
    assert file.read_text().endswith("\n")


# plot


def test_M1_curves_are_printed_where_there_is_no_terminal(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    result = run("plot", ARM, "1,7", "present_position", "--rate", 50, "--seconds", 2, "--csv", file)
    lines = result.stdout.rstrip("\n").split("\n")
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith("   149.9 ° ")
    assert "*" * 69 in lines[0]
    assert any(line.startswith("   120.0 ° ") and "x" * 69 in line for line in lines)
    assert lines[-2].split("  ") == [
        "",
        "",
        "",
        "",
        "",
        " * RX-28 id 1",
        " x LX/HTS bus servo, model unknown, id 7",
        " ",
    ]
    assert lines[-1].split() == ["0.0", "s", "2.0", "s"]
    assert len(rows(file)) == 2 * 101


def test_M1_registers_of_one_unit_share_a_picture(run: Run) -> None:
    said = run("plot", ARM, 1, "present_position", "present_temperature", "torque_enable", "--seconds", 1).stdout
    for edge in (" 150.4 °", " 149.4 °", " 25.5 °C", " 24.5 °C", " 0.5 ", " -0.5 "):
        assert edge in said
    assert "* RX-28 id 1 present_position" in said


def test_M1_only_the_last_seconds_are_shown(run: Run) -> None:
    last = run("plot", ARM, 1, "present_position", "--seconds", 5, "--span", 2).stdout.rstrip("\n").split("\n")[-1]
    assert last.split() == ["3.0", "s", "5.0", "s"]


@pytest.mark.parametrize(
    "options", [["--rate", 0], ["--rate", "nan"], ["--rate", 1e9], ["--span", 0], ["--seconds", 0]]
)
def test_M1_plots_that_make_no_sense(refused: Callable[..., str], options: list[Any]) -> None:
    assert "above 0" in refused("plot", ARM, 1, "led", *options, code=2)


def ramp(*values: float) -> Curve:
    return Curve("a", deque((float(time), value) for time, value in enumerate(values)))


@pytest.mark.parametrize("colour", [False, True])
def test_M1_a_picture_has_its_size_whatever_is_drawn(colour: bool) -> None:
    for curves in ([ramp(0, 5, 2)], [ramp(1, 1), ramp(3, math.nan, 1e6)], [ramp()], [ramp(math.nan)], [ramp(2)] * 12):
        picture = draw([Panel("°", curves)] * 2, (0.0, 2.0), 80, 24, colour=colour).plain.split("\n")
        assert all(len(line) <= 80 for line in picture)
        assert len(picture) <= 24


def test_M1_a_line_joins_the_points_and_a_gap_does_not() -> None:
    joined = draw([Panel("", [ramp(0, 10)])], (0.0, 1.0), 31, 14, colour=False).plain.split("\n")
    assert [line.strip()[-2:].count(MARKS[0]) > 0 for line in joined[1:10]] == [True] * 9
    parted = draw([Panel("", [ramp(0, math.nan, 10)])], (0.0, 2.0), 31, 14, colour=False).plain
    assert parted.partition("a")[0].count(MARKS[0]) == 3  # two points, and the legend


def test_M1_braille_dots_are_where_the_standard_puts_them() -> None:
    """U+2800 and: left column 1, 2, 4, 40; right column 8, 10, 20, 80, from the top (Unicode, Braille Patterns)."""
    picture = draw([Panel("", [ramp(1, 1, 0)])], (0.0, 2.0), 21, 6, colour=True).plain.split("\n")
    assert picture[0][11] == chr(0x2800 + 0x01 + 0x08)
