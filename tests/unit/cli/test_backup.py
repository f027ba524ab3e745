import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servobus import MODELS, Backup
from unit.cli.conftest import ALL, DRS, LX, RX, Run
from unit.served import Arm


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
    folder = f"there is no folder {Path('no-folder').absolute()}; make it first, or name another file"
    assert refused("backup", RX, 1, "no-folder/elbow.toml") == f"servobus: no-folder/elbow.toml: {folder}\n"


def test_a_name_with_something_else_in_braces_is_refused(run: Run) -> None:
    result = run("backup", RX, "1", "-o", "arm-{foo}-{id}.toml", code=2)
    assert "nothing stands for {foo}; {id} and {model} stand for those of the servo" in " ".join(result.stderr.split())
    assert list(Path().glob("arm*")) == []


def test_files_that_are_no_backup(run: Run, refused: Callable[..., str]) -> None:
    Path("notes.toml").write_text("hello")
    Path("noise.toml").write_bytes(b"\xff\xfe\x00")
    said = "there is no such file; did you mean notes.toml?"
    assert refused("restore", RX, 1, "note.toml") == f"servobus: note.toml: {said}\n"
    said = f"there is no such file; look for it in {Path.cwd()}"
    assert refused("restore", RX, 1, "missing.x") == f"servobus: missing.x: {said}\n"
    assert "notes.toml: this is not a backup file" in refused("restore", RX, 1, "notes.toml")
    assert "noise.toml: this is not a backup file" in refused("restore", RX, 1, "noise.toml")
    run("backup", RX, 1, "rx.toml")
    assert "the backup belongs to model RX-28, LX-16A id 1 is another model" in refused("restore", LX, 1, "rx.toml")


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


@pytest.mark.parametrize("family", ALL)
def test_N4_restore_with_the_torque_on_is_refused_or_lets_go_first(run: Run, family: str) -> None:
    port, id = ALL[family]
    key = port.removeprefix("virtual:").partition("@")[0]
    limits = {"rx28": ("0", "0"), "drs0602": ("12000", "12001"), "lx16a": ("100", "101")}[key]  # one of them turns
    low, high = (MODELS[key].register(name).name for name in ("min_position", "max_position"))
    with Arm(f"{key}@{id}") as arm:
        run("backup", arm.name, id, "as-it-was.toml")
        text = Path("as-it-was.toml").read_text()
        for name, raw in zip((low, high), limits, strict=True):
            text = re.sub(rf"^{name} = \d+", f"{name} = {raw}", text, flags=re.MULTILINE)
        Path("wheel.toml").write_text(text)
        run("torque", arm.name, id, "on")
        shaft = arm.servos[0].position
        result = run("restore", arm.name, id, "wheel.toml", "--yes", code=1)
        assert f"its torque is on, and settings can move it: switch it off first (`servobus torque {arm.name} {id}" in (
            result.stderr
        )
        assert "or say --torque-off; nothing was changed" in result.stderr
        result = run("restore", arm.name, id, "wheel.toml", "--yes", "--torque-off")
        assert f"torque switched off: id {id}" in result.stderr
        assert f"restored {low}" in result.stdout or f"restored {high}" in result.stdout
        time.sleep(0.1)
        assert arm.servos[0].position == pytest.approx(shaft, abs=1e-9)
        assert not arm.servos[0].torque


@pytest.mark.parametrize(("key", "name"), [("lx16a", "angle_offset"), ("drs0602", "calibration_difference")])
def test_N4_a_shift_of_the_zero_is_told(run: Run, key: str, name: str) -> None:
    port = kept(f"virtual:{key}@1?clock=virtual")
    run("write", port, 1, f"{name}={'10' if key == 'lx16a' else '50'}", "--save")
    run("backup", port, 1, "shifted.toml")
    run("write", port, 1, f"{name}=0", "--save")
    said = run("restore", port, 1, "shifted.toml", "--yes").stderr
    assert f"{name}: the angles that are read change with it, the shaft stays where it is" in said


def test_T4_what_cannot_be_written_is_named_and_the_exit_code_tells(run: Run, load: Callable[..., Any]) -> None:
    port = kept(RX)
    run("backup", port, 1, "rx.toml")
    text = Path("rx.toml").read_text()
    text = text.replace("ccw_angle_limit = 1023", "ccw_angle_limit = 65535").replace("alarm_led = 36", "alarm_led = 4")
    Path("rx.toml").write_text(text)
    result = run("restore", port, 1, "rx.toml", "--yes", code=1)
    assert "  alarm_led: overheating+overload -> overheating\n" in result.stdout
    assert "restored alarm_led; not restored: ccw_angle_limit = " in result.stderr
    assert "is not in 0.0° (raw 0) .. 300.0° (raw 1023)" in result.stderr
    assert load("read", port, 1, "alarm_led")["alarm_led"]["raw"] == 4


def test_T4_a_damaged_file_is_named_by_line_and_key(run: Run, refused: Callable[..., str]) -> None:
    run("backup", RX, 1, "rx.toml")
    text = Path("rx.toml").read_text()
    Path("bad.toml").write_text(text.replace("max_torque = 1023", "max_torque = 10x3"))
    assert "bad.toml: this is not a backup file, or it is damaged: line 18 (max_torque = 10x3" in refused(
        "restore", RX, 1, "bad.toml"
    )
    Path("bad.toml").write_text(text.replace("max_torque = 1023", "max_torque = 102.3"))
    assert "max_torque in line 18 is 102.3" in refused("restore", RX, 1, "bad.toml")
    Path("bad.toml").write_text("")
    assert refused("restore", RX, 1, "bad.toml") == "servobus: bad.toml: the file is empty: it holds no backup\n"
    Path("bad.toml").write_bytes(text.encode().replace(b"alarm_led = 36", b"alarm_led = \xff"))
    assert "line 20 is no text" in refused("restore", RX, 1, "bad.toml")


def test_T4_a_backup_of_another_id_is_asked_about(run: Run) -> None:
    port = kept(RX)
    run("write", port, 1, "max_torque=50", "--save")
    run("backup", port, 1, "one.toml")
    result = run("restore", port, 2, "one.toml", code=1, input="n\n")
    assert "write it to RX-28 id 2; the backup is of id 1, this is id 2?" in result.stdout
    assert "the id stays 2" in result.stderr


def test_T4_what_a_shorter_backup_lacks_is_told(run: Run, refused: Callable[..., str]) -> None:
    run("backup", RX, 1, "rx.toml")
    text = Path("rx.toml").read_text()
    short = "".join(line for line in text.splitlines(True) if "alarm_led" not in line)
    Path("short.toml").write_text(short)
    assert "short.toml: the backup is damaged: count in line 6 says 13 settings, and 12 are here" in refused(
        "restore", RX, 1, "short.toml", "--yes"
    )
    Path("short.toml").write_text(short.replace("count = 13", "count = 12"))
    assert "the backup lacks alarm_led: what the servo has there stays" in run("restore", RX, 1, "short.toml").stderr


def test_reset_of_what_cannot_is_refused_before_it_asks(run: Run) -> None:
    result = run("reset", LX, 1, code=1, input="y\n")
    assert "cannot be reset" in result.stderr
    assert result.stdout == ""
    assert list(Path().glob("*.toml")) == []


@pytest.mark.parametrize("asked", [57_142, 57_600, 57_000])
def test_T7_one_code_is_one_speed(run: Run, asked: int) -> None:
    """2 000 000 / 35 = 57143 baud: code 34, the speed from the factory (manual 3-4-1)."""
    said = run("set-baud", RX, 1, asked).stdout
    other = "" if asked == 57_600 else f"; {asked} is the same to it"
    assert said == f"RX-28 id 1 talks at 57600 baud already{other}\n"


@pytest.mark.parametrize("asked", [123_456, 222_222, 2_000_000, 34_482, 1_100_000, 7_843, 1])
def test_N16_a_speed_at_which_no_scan_looks_is_refused(refused: Callable[..., str], asked: int) -> None:
    said = refused("set-baud", RX, 1, asked)
    assert f"is not set to {asked} baud: no scan would find it there" in said
    assert "the nearest is " in said


@pytest.mark.parametrize("key", ["rx28", "drs0602"])
def test_N16_every_speed_of_set_baud_is_found_by_a_wide_scan(run: Run, load: Callable[..., Any], key: str) -> None:
    port = kept(f"virtual:{key}@1?clock=virtual")
    family = MODELS[key].family.name
    for baud in MODELS[key].bauds[1:]:
        run("set-baud", port, 1, baud, "--baud", "all", "--family", family)
        found = load("scan", port, "--ids", "1", "--baud", "all", "--family", family)
        assert [one["baud"] for one in found] == [baud]


def test_T7_the_lx16a_has_its_speed_already(run: Run) -> None:
    assert run("set-baud", LX, 1, 115_200).stdout == "LX-16A id 1 talks at 115200 baud already\n"


def test_T4_a_backup_that_an_editor_saved_with_a_byte_order_mark_is_read(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "elbow.toml"
    run("backup", RX, 1, path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert "has these settings already" in run("restore", RX, 1, path, "--yes").stdout
