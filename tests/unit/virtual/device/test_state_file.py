import json
import os
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest

from servobus.errors import UsageError
from servobus.families.registry import LX16A, RX28
from servobus.virtual.device.servo import VirtualServo, virtual_servo
from servobus.virtual.device.state_file import StateFile
from servobus.virtual.serve.inprocess import connect
from servobus.virtual.serve.ports import TcpPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "servos.json"


def rig() -> list[VirtualServo]:
    return [virtual_servo(RX28, 1), virtual_servo(RX28, 1), virtual_servo(LX16A, 2)]


def test_what_is_stored_is_found_again(path: Path) -> None:
    first = rig()
    state = StateFile(path, first)
    first[1].memory.store(RX28.id, 9)
    first[2].memory.store(LX16A.max_temperature, 70)
    state.close()
    second = rig()
    StateFile(path, second)
    assert [servo.id for servo in second] == [1, 9, 2]
    assert second[2].get("max_temperature") == 70


def test_the_file_is_readable(path: Path) -> None:
    StateFile(path, rig())
    content = json.loads(path.read_text())
    assert list(content["servos"]) == ["1: rx28@1", "2: rx28@1", "3: lx16a@2"]
    assert content["servos"]["1: rx28@1"]["return_delay_time"] == 250


def test_it_is_written_only_when_eeprom_changes(path: Path) -> None:
    servos = rig()
    StateFile(path, servos)
    path.unlink()
    servos[0].memory[RX28.led] = 1
    assert not path.exists()
    servos[0].memory[RX28.alarm_led] = 1
    assert path.exists()
    assert [other.name for other in path.parent.iterdir()] == [path.name]


def test_a_crash_while_writing_leaves_the_old_file(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    servos = rig()
    StateFile(path, servos)
    before = path.read_text()

    def crash(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", crash)
    with pytest.raises(UsageError, match="No space left"):
        servos[0].memory.store(RX28.id, 5)
    assert path.read_text() == before
    assert [other.name for other in path.parent.iterdir()] == [path.name]


def test_a_link_stays_a_link(path: Path, tmp_path: Path) -> None:
    target = tmp_path / "elsewhere.json"
    path.symlink_to(target)
    StateFile(path, rig())
    assert path.is_symlink()
    assert target.is_file()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("}", ""),
        ('"version": 1', '"version": 2'),
        ('"kind"', '"kin"'),
        ('"alarm_led": 36', '"alarm_led": 999'),
        ('"alarm_led": 36', '"alarm_led": "36"'),
        ('"alarm_led"', '"alarm_lead"'),
        ('"alarm_led": 36,', ""),
        ('"servos"', '"servants"'),
    ],
)
def test_damaged_files_are_refused_and_left_alone(path: Path, old: str, new: str) -> None:
    StateFile(path, rig()).close()
    text = path.read_text(encoding="utf-8").replace(old, new)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match="json"):
        StateFile(path, rig())
    assert path.read_text(encoding="utf-8") == text


@pytest.mark.parametrize("text", ["[]", "{", "\N{EURO SIGN}", "null", '{"servos": {}}'])
def test_other_files_are_refused(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match="json"):
        StateFile(path, rig())


def test_other_servos_are_refused(path: Path) -> None:
    StateFile(path, rig()).close()
    with pytest.raises(UsageError, match="rx28@1,rx28@1,lx16a@2, not rx28@5"):
        StateFile(path, [virtual_servo(RX28, 5)])


def test_a_directory_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be written"):
        StateFile(tmp_path / "nowhere" / "a.json", rig())
    with pytest.raises(UsageError, match="cannot be read"):
        StateFile(tmp_path, rig())


needs_locks = pytest.mark.skipif(sys.platform == "win32", reason="no such locks on Windows")


def start(path: Path) -> "subprocess.Popen[str]":
    """Start a server that keeps its servos in a file, and wait until it is ready, or has ended."""
    command = [sys.executable, "-m", "servobus", "virtual", "rx28@1,2", "--tcp", "0", "--state", str(path)]
    server = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert server.stdout is not None
    server.first_line = server.stdout.readline()  # type: ignore[attr-defined]
    return server


@needs_locks
def test_M10_a_second_server_is_refused_and_told_who_has_the_file(path: Path) -> None:
    with start(path) as first:
        try:
            assert first.first_line.startswith("ready ")  # type: ignore[attr-defined]
            before = path.read_text()
            with start(path) as second:
                said = second.communicate(timeout=30)[1]
            assert second.returncode == 1
            assert f"servobus: state file {path} is kept by " in said
            assert "virtual rx28@1,2" in said
            assert f"(pid {first.pid})" in said
            assert path.read_text() == before
            with pytest.raises(UsageError, match=rf"pid {first.pid}\)"):
                connect(f"virtual:rx28@1,2?state={path}")
        finally:
            first.kill()
    assert [one.name for one in path.parent.iterdir()] == [path.name]
    connect(f"virtual:rx28@1,2?state={path}").close()


@needs_locks
def test_M10_the_lock_is_on_each_new_file_too(path: Path) -> None:
    servos = rig()
    first = StateFile(path, servos)
    for id in range(10, 20):
        servos[0].memory.store(RX28.id, id)
        with pytest.raises(UsageError, match="this process"):
            StateFile(path, rig())
        (there,) = (json.loads(path.read_text())["servos"]["1: rx28@1"]["id"],)
        assert there == id
    first.close()
    again = rig()
    StateFile(path, again).close()
    assert again[0].id == 19
    assert [one.name for one in path.parent.iterdir()] == [path.name]


@needs_locks
def test_M10_through_a_link_it_is_the_same_file(path: Path) -> None:
    kept = StateFile(path, rig())
    link = path.with_name("link.json")
    link.symlink_to(path)
    with pytest.raises(UsageError, match="kept by"):
        StateFile(link, rig())
    kept.close()


@needs_locks
def test_M10_a_file_that_was_put_in_its_place_is_taken_only_if_it_is_free(path: Path) -> None:
    first, second = rig(), rig()
    mine = StateFile(path, first)
    path.unlink()
    other = StateFile(path, second)
    with pytest.raises(UsageError, match="kept by"):
        first[0].memory.store(RX28.id, 7)
    other.close()
    first[0].memory.store(RX28.id, 8)
    assert json.loads(path.read_text())["servos"]["1: rx28@1"]["id"] == 8
    mine.close()


@needs_locks
def test_M10_many_writes_and_many_who_try(path: Path) -> None:
    """There is no moment between two files at which another gets in."""
    servos = rig()
    kept = StateFile(path, servos)
    got_in: list[StateFile] = []
    done = threading.Event()

    def attempt() -> None:
        while not done.is_set():
            with suppress(UsageError):
                got_in.append(StateFile(path, rig()))

    thread = threading.Thread(target=attempt)
    thread.start()
    for n in range(60):
        servos[0].memory.store(RX28.id, n)
    done.set()
    thread.join()
    kept.close()
    assert not got_in


@needs_locks
def test_M10_a_killed_server_leaves_nothing_that_blocks_and_no_litter(path: Path) -> None:
    """Killed amid its writes, at whatever moment."""
    code = (
        "import sys, itertools; from pathlib import Path; from servobus import RX28\n"
        "from servobus.virtual.device.servo import virtual_servo\n"
        "from servobus.virtual.device.state_file import StateFile\n"
        "servo = virtual_servo(RX28, 1); kept = StateFile(Path(sys.argv[1]), [servo]); print('ready', flush=True)\n"
        "for n in itertools.count(): servo.memory.store(RX28.id, n % 200)\n"
    )
    for n in range(3):
        with subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline() == "ready\n"
            time.sleep(0.02 + 0.007 * n)
            writer.kill()
        StateFile(path, [virtual_servo(RX28, 1)]).close()
        assert [one.name for one in path.parent.iterdir()] == [path.name]


@needs_locks
def test_M10_what_a_killed_writer_left_goes_with_the_next_start(path: Path) -> None:
    StateFile(path, rig()).close()
    path.with_name(".servos.json.new").write_text("half")
    StateFile(path, rig()).close()
    assert [one.name for one in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("text", ["", "\n", "  \n\n"])
def test_M10_an_empty_file_is_a_fresh_one(path: Path, text: str) -> None:
    path.write_text(text)
    servos = rig()
    state = StateFile(path, servos)
    assert list(json.loads(path.read_text())["servos"]) == ["1: rx28@1", "2: rx28@1", "3: lx16a@2"]
    servos[1].memory.store(RX28.id, 9)
    state.close()
    again = rig()
    StateFile(path, again).close()
    assert again[1].id == 9


def test_M10_what_is_no_file_is_left_alone(tmp_path: Path) -> None:
    if os.name == "posix":
        os.mkfifo(tmp_path / "pipe")
        for what in (tmp_path / "pipe", Path(os.devnull)):
            with pytest.raises(UsageError, match="no regular file"):
                StateFile(what, rig())
            assert not what.is_file()


@needs_locks
def test_M10_a_closed_port_lets_go_and_takes_the_file_again(path: Path) -> None:
    spec = f"virtual:rx28@1?clock=virtual&state={path}"
    first = connect(spec)
    with pytest.raises(UsageError, match="this process"):
        connect(spec)
    first.close()
    second = connect(spec)
    second.servos[0].memory.store(RX28.alarm_led, 1)
    with pytest.raises(UsageError, match="this process"):
        first.reopen()
    second.close()
    first.reopen()
    assert first.servos[0].memory.eeprom[RX28.alarm_led] == 1
    first.close()
    first.servos[0].memory.store(RX28.alarm_led, 2)
    assert json.loads(path.read_text())["servos"]["1: rx28@1"]["alarm_led"] == 1
    first.reopen()
    assert json.loads(path.read_text())["servos"]["1: rx28@1"]["alarm_led"] == 2
    first.close()


@needs_locks
def test_M10_a_served_port_lets_go_when_it_is_closed(path: Path) -> None:
    spec = f"virtual:rx28@1?state={path}"
    with TcpPort(build_rig(parse_url(spec))), pytest.raises(UsageError, match="this process"):
        connect(spec)
    connect(spec).close()


@needs_locks
def test_M10_who_cannot_start_keeps_nothing(path: Path) -> None:
    with pytest.raises(UsageError, match="baud"):
        build_rig(parse_url(f"virtual:rx28@1?baud=123&state={path}"))
    connect(f"virtual:rx28@1?state={path}").close()
