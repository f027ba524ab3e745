import json
from collections.abc import Callable
from typing import Any

import pytest

from servobus import RX28, Garbled
from servobus.core.exchange import Pause, Procedure
from servobus.families.base import Family
from servobus.jobs.scan import ScanProblem, ScanResult, _met
from unit.cli.conftest import ALL, LX, RX, Run


@pytest.mark.parametrize("family", ALL)
def test_M3_scan_finds_who_is_there(load: Callable[..., Any], family: str) -> None:
    port, id = ALL[family]
    found = load("scan", port, "--family", family, "--ids", f"{id}-{id + 3}")
    keys = "family model model_number id baud firmware position voltage temperature torque alarms"
    assert all(list(one) == keys.split() for one in found)
    assert found[0]["family"] == family
    assert found[0]["id"] == id


def test_scan_of_a_drawer(load: Callable[..., Any]) -> None:
    found = load("scan", "virtual:rx28@1-3,lx16a@2?clock=virtual", "--ids", "0-4")
    assert [(one["model"], one["id"], one["baud"]) for one in found] == [
        ("rx28", 1, 57600), ("rx28", 2, 57600), ("rx28", 3, 57600), (None, 2, 115200),
    ]  # fmt: skip


def test_scan_for_people(run: Run) -> None:
    lines = run("scan", RX).stdout.splitlines()
    assert [line.partition(":")[0] for line in lines] == [f"RX-28 id {id} at 57600" for id in (1, 2, 3)]
    assert "14.4 V, 25 °C, torque off" in lines[0]


def test_other_speeds_are_found_with_baud(load: Callable[..., Any], run: Run) -> None:
    port = "virtual:rx28@5?clock=virtual&baud=500000"
    options = ("--ids", "5", "--family", "dynamixel")
    assert run("scan", port, *options, "--json").stdout == "[]\n"
    assert "`--baud all` tries every speed" in run("scan", port, *options).stderr
    assert load("scan", port, *options, "--baud", "500000")[0]["baud"] == 500000
    assert load("scan", port, *options, "--baud", "all")[0]["baud"] == 500000


def test_a_speed_that_no_family_has_is_noted_and_tried(run: Run) -> None:
    port = "virtual:rx28@5?clock=virtual&baud=12345"
    result = run("scan", port, "--ids", "5", "--baud", 12345)
    assert (
        result.stderr == "12345 baud is no usual speed of dynamixel, herkulex, lewansoul servos; asking all the same\n"
    )
    assert result.stdout.startswith("RX-28 id 5 at 12345: ")
    # LX-16A have one speed, 115200; RX-28 have 1 Mbps too.
    assert (
        "no usual speed of lewansoul servos"
        in run("scan", LX, "--ids", "1", "--family", "lewansoul", "--baud", 1000000).stderr
    )
    assert "usual" not in run("scan", RX, "--ids", "1", "--baud", 1000000).stderr


def test_a_silent_port(run: Run) -> None:
    result = run("scan", LX, "--ids", "100-103,107")
    assert result.stdout == ""
    assert "no servo answers (asked ids 100-103,107: dynamixel at 57600" in result.stderr


def test_what_answers_without_sense_is_reported(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def garbled(families: list[Family], *rest: object) -> Procedure[ScanResult]:
        yield Pause(0)
        survey = rest[3]
        assert isinstance(survey, ScanResult)
        survey.troubles.append(ScanProblem(families[0], 3, 57600, Garbled("PING id 3: 2 bytes that are no packet")))
        return survey

    monkeypatch.setattr("servobus.cli.scan.scan_procedure", garbled)
    result = run("scan", RX, "--family", "dynamixel", "--json")
    assert result.stdout == "[]\n"
    assert "id 3 at 57600 baud: something answers, but not clearly (PING id 3: 2 bytes" in result.stderr


def test_alarms_are_told(run: Run) -> None:
    result = run("scan", "virtual:rx28@1?clock=virtual&temperature=90", "--ids", "1", "--family", "dynamixel")
    assert "ALARM overheating" in result.stdout


def test_M3_what_was_found_before_ctrl_c_is_told(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    find = _met

    def interrupted(family: Family, id: int, *rest: Any) -> Procedure[Any]:
        if id == 2:
            raise KeyboardInterrupt
        return find(family, id, *rest)

    monkeypatch.setattr("servobus.jobs.scan._met", interrupted)
    result = run("scan", RX, "--family", "dynamixel", "--json", code=130)
    assert [one["id"] for one in json.loads(result.stdout)] == [1]
    assert "stopped; this is what was found so far" in result.stderr


def test_a_model_that_is_not_known_is_listed(
    run: Run, load: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RX28, "number", 29)
    options = ("--family", "dynamixel", "--ids", "1")
    said = "Dynamixel servo, model 28, id 1 at 57600: position 511 (raw), 14.4 V, 25 °C, torque off\n"
    assert run("scan", RX, *options).stdout == said
    (found,) = load("scan", RX, *options)
    assert (found["model"], found["model_number"]) == (None, 28)


def test_what_cannot_be_asked(refused: Callable[..., str]) -> None:
    assert "254 is the broadcast id" in refused("scan", RX, "--ids", "250-254", code=2)
    assert "3-1 runs backwards" in refused("scan", RX, "--ids", "3-1", code=2)
    assert "such as 1-4,7" in refused("scan", RX, "--ids", "1..4", code=2)
    assert "no family 'dynamixl'; did you mean dynamixel?" in refused("scan", RX, "--family", "dynamixl", code=2)
    assert "neither a number of baud nor `all`" in refused("scan", RX, "--baud", "fast", code=2)
    assert "0 is not a speed" in refused("scan", RX, "--baud", "0", code=2)
    assert "no such port" in refused("scan", "/dev/does-not-exist")
    assert "the name of the port is empty" in refused("scan", "")
    assert "no model 'rx99'" in refused("scan", "virtual:rx99@1")


def test_M3_json_says_what_the_line_for_people_says(load: Callable[..., Any]) -> None:
    (one,) = load("scan", "virtual:rx28@1?clock=virtual&temperature=90", "--ids", 1, "--family", "dynamixel")
    assert one["voltage"] == {"value": 14.4, "unit": "V"}
    assert one["temperature"] == {"value": 90.0, "unit": "°C"}
    assert one["position"]["unit"] == "°"
    assert (one["torque"], one["alarms"]) == (False, ["overheating"])
    (lx,) = load("scan", "virtual:lx16a@1?clock=virtual", "--ids", 1, "--family", "lewansoul")
    assert lx["alarms"] is None  # no packet of the protocol tells them


@pytest.mark.parametrize("baud", [115_200, 1_000_000])
def test_N1_a_herkulex_is_found_at_a_given_speed(load: Callable[..., Any], run: Run, baud: int) -> None:
    port = f"virtual:drs0602@219?baud={baud}&clock=virtual"
    (found,) = load("scan", port, "--baud", baud, "--ids", 219)
    assert (found["model"], found["id"], found["baud"]) == ("drs0602", 219, baud)
    assert "DRS-0602 id 219" in run("info", port, 219, "--baud", baud).stdout
    assert "DRS-0602 id 219" in run("doctor", port, "--baud", baud, "--ids", "210-219", "--reads", 10).stdout
