"""M2: several ids wherever one is taken. N13: an id that two families share names neither."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servobus import Backup
from unit.cli.conftest import Run

ARM = "virtual:rx28@1-3,drs0602@7,lx16a@10?clock=virtual"
EVERY = [1, 2, 3, 7, 10]
"""The ids on it."""
SHARED = "virtual:rx28@1,2,lx16a@1?clock=virtual"
"""Two families with one id."""

WAYS = pytest.mark.parametrize(
    ("words", "ids"),
    [
        (["1"], [1]),
        (["2-3,7"], [2, 3, 7]),
        (["1,10"], [1, 10]),
        (["3", "1-2"], [3, 1, 2]),
        (["1", "1-2", "2"], [1, 2]),  # each once
        (["all"], EVERY),
    ],
)


def ids_of(entries: Any) -> list[int]:
    return [one["id"] for one in entries]


@WAYS
def test_M2_read(run: Run, load: Callable[..., Any], words: list[str], ids: list[int]) -> None:
    lines = run("read", ARM, *words, "present_temperature", "torque_enable").stdout.splitlines()
    assert len(lines) == 2 * len(ids)
    seen = load("read", ARM, *words, "present_temperature")
    if words == ["1"]:
        assert seen["present_temperature"]["value"] == 25
        return
    assert ids_of(seen) == ids
    assert [f"id {id} " in f"{line} " for id, line in zip(ids, lines[::2], strict=True)]
    assert all(one["registers"]["present_temperature"]["value"] == 25 for one in seen)


@WAYS
def test_M2_info(run: Run, load: Callable[..., Any], words: list[str], ids: list[int]) -> None:
    seen = load("info", ARM, *words)
    assert ids_of([seen] if words == ["1"] else seen) == ids
    assert run("info", ARM, *words).stdout.count("firmware ") >= len(ids)


@WAYS
def test_M2_led_stop_torque_and_write(run: Run, words: list[str], ids: list[int]) -> None:
    assert run("led", ARM, *words, "on").stdout.count(": light on\n") == len(ids)
    assert run("torque", ARM, *words, "on").stdout.count(": torque on\n") == len(ids)
    assert run("stop", ARM, *words).stdout.count(" stopped: ") == len(ids)
    assert run("write", ARM, *words, "max_position=100").stdout.count(" -> ") == len(ids)


def test_M2_write_says_which(run: Run, load: Callable[..., Any]) -> None:
    said = run("write", ARM, "1-3", "led=on", "punch=40").stdout.splitlines()
    assert said[0].split() == ["RX-28", "id", "1", "led", "off", "->", "on"]
    assert len(said) == 6
    changed = load("write", ARM, "1-3", "led=on")
    assert ids_of(changed) == [1, 2, 3]
    assert changed[2]["registers"] == {"led": {"old": False, "new": True, "unit": ""}}


def test_M2_nothing_is_written_unless_all_of_it_can_be(run: Run, refused: Callable[..., str], tmp_path: Path) -> None:
    port = f"{ARM}&state={tmp_path / 'state.json'}"
    assert "no servo answers to id 99" in refused("write", port, "1,99", "max_torque=50")
    assert "DRS-0602 has no register" in refused("write", port, "1,7", "punch=40", "max_torque=50")
    assert run("read", port, 1, "max_torque").stdout == "max_torque  100.0 %\n"


def test_M2_what_answers_is_read_and_what_does_not_is_told(run: Run) -> None:
    result = run("read", ARM, "1,99,3,98", "present_temperature", code=1)
    assert result.stdout.count("25 °C") == 2
    assert result.stderr.count("no servo answers to ids 99, 98 (tried ") == 1
    assert "; are they powered? `--baud all` tries every speed\n" in result.stderr
    shown = run("read", ARM, "1,99,3", "present_temperature", "--json", code=1)
    assert ids_of(json.loads(shown.stdout)) == [1, 3]
    assert run("read", ARM, "1,7", "punch", code=1).stdout == "RX-28 id 1       punch  3.1 %\n"


def test_M2_rearm_and_reboot(run: Run) -> None:
    assert run("rearm", ARM, "1-2,7").stdout.count("torque on, holds") == 3
    said = run("reboot", ARM, "7,1", code=1)
    assert said.stdout == "DRS-0602 id 7 restarted; its torque is off\n"
    assert "RX-28" in said.stderr


def test_M2_move(load: Callable[..., Any], refused: Callable[..., str]) -> None:
    moved = load("move", ARM, "1-2=100", "10=90")
    assert [(one["id"], one["goal"]) for one in moved] == [(1, 100), (2, 100), (10, 90)]
    assert [one["id"] for one in load("move", ARM, "all=30")] == EVERY
    assert "id 2 is named twice" in refused("move", ARM, "1-3=100", "2=90", code=2)
    assert "either ids or `all`" in refused("move", ARM, "all=30", "1=40", code=2)


def test_M2_a_file_for_each_backup(
    run: Run, refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("backup", ARM, "1-2,7").stdout.count(" saved to ") == 3
    assert sorted(path.name for path in Path().iterdir()) == [
        "drs0602-id7.toml",
        "rx28-id1.toml",
        "rx28-id2.toml",
    ]
    run("backup", ARM, "all", "-o", "arm-{id}.toml")
    assert sorted(Backup.parse(path.read_text()).id for path in Path().glob("arm-*.toml")) == EVERY
    run("backup", ARM, 1, "2", "{model}_{id}.toml")
    assert Path("rx28_2.toml").exists()
    assert "write {id} in it" in refused("backup", ARM, "1-2", "-o", "both.toml", code=2)
    assert "write {id} in it" in refused("backup", ARM, "1-2", "-", code=2)
    assert "say one FILE" in refused("backup", ARM, "1", "a.toml", "-o", "b.toml", code=2)


def test_M2_two_servos_never_share_a_backup(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("backup", SHARED, "all", "-o", "{id}.toml", "--force", code=1)
    assert "1.toml is that of another servo by now; write {model} in it too" in result.stderr
    assert Backup.parse(Path("1.toml").read_text()).model.key() == "rx28"
    assert run("backup", SHARED, "all", "-o", "{model}-{id}.toml").stdout.count("saved to") == 3


@pytest.mark.parametrize("verb", ["restore", "turn", "reset", "set-baud", "set-id", "step"])
def test_M2_what_is_for_one_servo_takes_one_id(refused: Callable[..., str], verb: str) -> None:
    assert "1-3" in refused(verb, ARM, "1-3", "x", code=2)


@pytest.mark.parametrize("ids", ["1-", "-", "1..3", "3-1", "1,,2", "one", "254", "0x10", "9999999999", "1;2", "²"])
@pytest.mark.parametrize("verb", ["read", "info", "led", "stop", "backup"])
def test_M2_ids_that_cannot_be(run: Run, verb: str, ids: str) -> None:
    rest = {"read": ["led"], "led": ["on"]}.get(verb, [])
    said = run(verb, ARM, "--", ids, *rest, code=2).stderr
    assert "id" in said
    assert ids.strip("-") in said


def test_M2_what_is_read_of_the_ids_is_named(refused: Callable[..., str]) -> None:
    assert "say REGISTER... after the ids" in refused("read", ARM, "1-3", code=2)
    assert "say REGISTER=VALUE... after the ids" in refused("write", ARM, "all", code=2)


# N13


@pytest.mark.parametrize(
    "command",
    [
        ("read", 1, "present_position"),
        ("info", 1),
        ("write", 1, "led=on"),
        ("led", 1, "on"),
        ("move", "1=100"),
        ("move", "2=100", "1=100"),
        ("turn", 1, "--output", 10),
        ("torque", 1, "on"),
        ("rearm", 1),
        ("reboot", 1),
        ("set-id", 1, 5),
        ("set-baud", 1, 1000000),
        ("backup", 1, "-"),
        ("reset", 1, "--yes"),
        ("step", 1, "--limits", 0, 240),
    ],
)
def test_N13_an_id_of_two_families_names_neither(refused: Callable[..., str], command: tuple[Any, ...]) -> None:
    verb, *rest = command
    said = refused(verb, SHARED, *rest)
    assert "id 1 is not unique here: RX-28 id 1 at 57600 and LX/HTS bus servo, model unknown, id 1 at 115200" in said
    assert "say which with --family dynamixel or --family lewansoul" in said


def test_N13_and_the_family_says_which(load: Callable[..., Any], run: Run) -> None:
    assert load("info", SHARED, 1, "--family", "lewansoul")["model"] is None
    assert load("info", SHARED, 1, "--model", "lx16a")["model"] == "lx16a"
    assert load("info", SHARED, 1, "--model", "rx28")["model"] == "rx28"
    assert "model unknown, id 1" in run("move", SHARED, "1=100", "--family", "lewansoul").stdout


def test_N13_several_go_on_without_it(run: Run) -> None:
    result = run("read", SHARED, "1-2", "present_temperature", code=1)
    assert result.stdout.startswith("RX-28 id 2 ")
    assert "id 1 is not unique here" in result.stderr
    assert run("read", SHARED, "all", "present_temperature").stdout.count("25 °C") == 3


def test_N13_what_makes_safe_takes_both(run: Run) -> None:
    assert run("stop", SHARED, 1).stdout.count(" stopped: ") == 2
    assert run("torque", SHARED, 1, "off").stdout.count(": torque off\n") == 2
