import json
from pathlib import Path

import pytest

from servobus.errors import UsageError
from servobus.families.registry import LX16A, RX28
from servobus.virtual.device.servo import VirtualServo, virtual_servo
from servobus.virtual.device.state_file import StateFile


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "servos.json"


def rig() -> list[VirtualServo]:
    return [virtual_servo(RX28, 1), virtual_servo(RX28, 1), virtual_servo(LX16A, 2)]


def test_what_is_stored_is_found_again(path: Path) -> None:
    first = rig()
    StateFile(path, first)
    first[1].memory.store(RX28.id, 9)
    first[2].memory.store(LX16A.max_temperature, 70)
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
    StateFile(path, rig())
    text = path.read_text(encoding="utf-8").replace(old, new)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match="json"):
        StateFile(path, rig())
    assert path.read_text(encoding="utf-8") == text


@pytest.mark.parametrize("text", ["", "[]", "{", "\N{EURO SIGN}", "null", '{"servos": {}}'])
def test_other_files_are_refused(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match="json"):
        StateFile(path, rig())


def test_other_servos_are_refused(path: Path) -> None:
    StateFile(path, rig())
    with pytest.raises(UsageError, match="rx28@1,rx28@1,lx16a@2, not rx28@5"):
        StateFile(path, [virtual_servo(RX28, 5)])


def test_a_directory_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be written"):
        StateFile(tmp_path / "nowhere" / "a.json", rig())
    with pytest.raises(UsageError, match="cannot be read"):
        StateFile(tmp_path, rig())
