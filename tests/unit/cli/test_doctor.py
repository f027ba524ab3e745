from collections.abc import Callable
from typing import Any

import pytest

from unit.cli.conftest import DRS, RX, Run

LOW = "virtual:rx28@1-2?clock=virtual&voltage=5"


def test_nothing_is_wrong(run: Run) -> None:
    result = run("doctor", RX, "--family", "dynamixel", "--reads", 30)
    lines = result.stdout.splitlines()
    assert "ok       servos: RX-28 ids 1, 2, 3" in lines
    assert any(line.startswith("ok       reads: 30, none lost") for line in lines)
    assert lines[-1] == "nothing is wrong"


def test_cause_first_then_the_command(run: Run) -> None:
    port = "virtual:drs0602@219?clock=virtual&temperature=95"
    lines = run("doctor", port, "--family", "herkulex", "--reads", 500, code=1).stdout.splitlines()
    start = lines.index("FAIL     errors: DRS-0602 id 219: temperature")
    assert lines[start + 1].strip().startswith("it stays until it is cleared")
    assert [line.strip() for line in lines[start + 3 : start + 5]] == [
        f"servobus write '{port}' 219 status_error=0 status_detail=0",
        f"servobus rearm '{port}' 219",
    ]
    assert lines[-1] == "2 wrong"
    # What it says mends it is a command that there is: the heat is still there, so the error comes back.
    written = run("write", port, 219, "status_error=0", "status_detail=0", code=1)
    assert "status_error   temperature -> temperature" in written.stdout
    assert "DRS-0602 id 219 did not take status_error = none: it is temperature" in written.stderr


def test_all_speeds_are_tried_if_nobody_answers(run: Run) -> None:
    port = "virtual:rx28@1?clock=virtual&baud=500000"
    text = run("doctor", port, "--ids", "0-3", "--reads", 10).stdout
    assert "dynamixel at 500000 (from the factory 57600)" in text
    assert "other commands find them with --baud 500000" in text


def test_unless_a_speed_is_named(run: Run) -> None:
    port = "virtual:rx28@1?clock=virtual&baud=1000000"
    text = run("doctor", port, "--ids", "0-3", "--baud", 57600, code=1).stdout
    assert "nobody answers" in text
    assert f"servobus doctor '{port}' --baud all" in text


def test_json(load: Callable[..., Any], run: Run) -> None:
    findings = load("doctor", RX, "--family", "dynamixel", "--reads", 10)
    assert {finding["level"] for finding in findings} == {"ok"}
    assert findings[1] == {
        "level": "ok", "check": "servos", "what": "RX-28 ids 1, 2, 3", "cause": "", "mend": [],
    }  # fmt: skip
    assert '"level": "fail"' in run("doctor", LOW, "--family", "dynamixel", "--reads", 10, "--json", code=1).stdout


@pytest.mark.parametrize("port", [RX, DRS, LOW, "/no/such/port", "virtual:rx28@9?clock=virtual"])
def test_fits_80_columns(run: Run, port: str) -> None:
    code = 0 if port in (RX, DRS) else 1
    for line in run("doctor", port, "--ids", "1-3,219-220", "--reads", 10, code=code).stdout.splitlines():
        assert len(line) <= 80 or line.strip().startswith("servobus "), line


def test_a_port_that_is_not_there(run: Run) -> None:
    lines = run("doctor", "/no/such/port", code=1).stdout.splitlines()
    assert lines[0] == "FAIL     port: /no/such/port is not there"
    assert "servobus ports" in lines[-3]
    assert lines[-1] == "1 wrong"


@pytest.mark.parametrize(
    ("arguments", "why", "code"),
    [
        (("virtual:nope@1",), "nope", 1),
        ((RX, "--reads", "-1"), "--reads -1 is not in 0 .. 1000000", 2),
        ((" ",), "PORT is empty", 2),
    ],
)
def test_what_makes_no_sense(refused: Callable[..., str], arguments: tuple[str, ...], why: str, code: int) -> None:
    assert why in refused("doctor", *arguments, code=code)
