from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servobus import Backup
from unit.cli.conftest import ALL, DRS, LX, RX, Run


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Let files that are written land in a folder of the test."""
    monkeypatch.chdir(tmp_path)


def kept(port: str) -> str:
    """Let virtual servos remember from one command to the next."""
    return f"{port}&state=state.json"


def ids(load: Callable[..., Any], port: str, *options: str) -> list[int]:
    return [one["id"] for one in load("scan", port, *options)]


def test_set_id(run: Run, load: Callable[..., Any], refused: Callable[..., str]) -> None:
    port = kept(RX)
    assert run("set-id", port, 1, 7).stdout == "RX-28 id 1 is now id 7\n"
    assert ids(load, port, "--ids", "0-8") == [2, 3, 7]
    assert "id 3 is not free: a servo answers to it" in refused("set-id", port, 7, 3)
    assert "254 is the broadcast id" in refused("set-id", port, 7, 254, code=2)
    assert "no servo answers to id 1" in refused("set-id", port, 1, 5)
    assert ids(load, port, "--ids", "0-8") == [2, 3, 7]


def test_set_baud(run: Run, load: Callable[..., Any], refused: Callable[..., str]) -> None:
    port = kept(RX)
    result = run("set-baud", port, 2, 500000)
    assert result.stdout == "RX-28 id 2 talks at 500000 baud now (before: 57600)\nfind it with --baud 500000\n"
    assert ids(load, port, "--ids", "0-8", "--baud", "500000") == [2]
    assert "123 baud" in refused("set-baud", port, 1, 123)
    assert "fixed at 115200" in refused("set-baud", LX, 1, 9600)
    run("set-baud", port, 2, 57600, "--baud", "all")
    assert ids(load, port, "--ids", "0-8") == [1, 2, 3]


@pytest.mark.parametrize("family", ALL)
def test_backup_and_restore(run: Run, load: Callable[..., Any], family: str) -> None:
    port, id = ALL[family]
    port = kept(port)
    name, value = {
        "dynamixel": ("max_torque", "50"),
        "herkulex": ("dead_zone", "3"),
        "lewansoul": ("max_temperature", "60"),
    }[family]
    said = run("backup", port, id).stdout
    (file,) = Path().glob("*-id*.toml")
    assert said.endswith(f"saved to {file}\n")
    assert Backup.parse(file.read_text()).id == id

    before = load("read", port, id, name)
    run("write", port, id, f"{name}={value}", "--save")
    changed = load("read", port, id, name)
    assert changed != before
    result = run("restore", port, id, file, code=1, input="n\n")
    assert f"  {name}: " in result.stdout
    assert result.stderr == "servobus: nothing was changed\n"
    assert load("read", port, id, name) == changed

    assert run("restore", port, id, file, input="y\n").stdout.endswith(f"restored {name}\n")
    assert load("read", port, id, name) == before
    assert run("restore", port, id, file).stdout.endswith("has these settings already\n")


def test_a_backup_goes_to_a_file_of_ones_choice_or_to_stdout(run: Run, refused: Callable[..., str]) -> None:
    assert "saved to elbow.toml" in run("backup", RX, 2, "elbow.toml").stdout
    assert "elbow.toml exists" in refused("backup", RX, 3, "elbow.toml")
    assert Backup.parse(Path("elbow.toml").read_text()).id == 2
    assert "choose another name, or replace it with --force" in refused("backup", RX, 3, "elbow.toml")
    run("backup", RX, 3, "elbow.toml", "--force")
    assert Backup.parse(Path("elbow.toml").read_text()).id == 3
    assert Backup.parse(run("backup", RX, 1, "-").stdout).id == 1
    assert "no-folder" in refused("backup", RX, 1, "no-folder/elbow.toml")


def test_files_that_are_no_backup(run: Run, refused: Callable[..., str]) -> None:
    Path("notes.toml").write_text("hello")
    Path("noise.toml").write_bytes(b"\xff\xfe\x00")
    assert refused("restore", RX, 1, "missing.toml") == "servobus: missing.toml: No such file or directory\n"
    assert "notes.toml: this is not a backup file" in refused("restore", RX, 1, "notes.toml")
    assert "noise.toml: this is not a backup file" in refused("restore", RX, 1, "noise.toml")
    run("backup", RX, 1, "rx.toml")
    assert "the backup is of a RX-28, LX-16A id 1 is another model" in refused("restore", LX, 1, "rx.toml")


def test_a_backup_of_another_id_leaves_the_id(run: Run, load: Callable[..., Any]) -> None:
    port = kept(RX)
    run("write", port, 1, "max_torque=50", "--save")
    run("backup", port, 1, "one.toml")
    result = run("restore", port, 2, "one.toml", "--yes")
    assert "the backup is of id 1; the id stays 2" in result.stderr
    assert load("read", port, 2, "max_torque")["max_torque"]["value"] == pytest.approx(50, abs=0.1)


def test_reset_can_be_undone(run: Run, load: Callable[..., Any]) -> None:
    port = "virtual:rx28@7?clock=virtual&state=state.json"
    run("write", port, 7, "max_torque=50", "--save")
    result = run("reset", port, 7, input="y\n")
    assert "RX-28 id 7 is reset: id 1 at 57600 baud now" in result.stdout
    assert load("read", port, 1, "max_torque")["max_torque"]["value"] == 100
    for line in [line.split() for line in result.stdout.splitlines() if line.startswith("  servobus")]:
        run(*(word.strip("'") for word in line[1:]), *(["--yes"] if line[1] == "restore" else []))
    assert load("read", port, 7, "max_torque")["max_torque"]["value"] == pytest.approx(50, abs=0.1)


def test_reset_asks_first(run: Run) -> None:
    assert "nothing was changed" in run("reset", RX, 1, code=1, input="n\n").stderr
    assert "nobody is there to confirm" in run("reset", RX, 1, code=1, input="").stderr
    assert list(Path().glob("*.toml")) == []


def test_reset_keeps_what_can_be_kept(run: Run, load: Callable[..., Any], refused: Callable[..., str]) -> None:
    port = kept("virtual:drs0602@5?clock=virtual")
    run("write", port, 5, "dead_zone=3", "--save")
    assert (
        "id 5 is reset: id 5 at 115200"
        in run("reset", port, 5, "--keep", "id,baud", "--yes", "--backup", "b.toml").stdout
    )
    assert load("read", port, 5, "dead_zone")["dead_zone"]["value"] == 0
    assert Backup.parse(Path("b.toml").read_text()).values["dead_zone"] == 3
    assert "only id, baud, calibration" in refused("reset", port, 5, "--keep", "colour", "--yes", code=2)


def test_what_cannot_be_reset_leaves_no_file(refused: Callable[..., str]) -> None:
    assert "cannot be reset" in refused("reset", LX, 1, "--yes")
    assert "cannot keep id" in refused("reset", RX, 2, "--keep", "id", "--yes")
    assert list(Path().glob("*.toml")) == []


def test_a_reset_that_would_make_twins_is_refused(refused: Callable[..., str], load: Callable[..., Any]) -> None:
    port = kept(RX)
    assert "another servo answers to that already" in refused("reset", port, 2, "--yes")
    assert ids(load, port, "--ids", "0-8") == [1, 2, 3]


def test_reboot(run: Run, refused: Callable[..., str]) -> None:
    assert run("reboot", DRS, 219).stdout == "DRS-0602 id 219 restarted; its torque is off\n"
    assert "switch its power off and on" in refused("reboot", RX, 1)
