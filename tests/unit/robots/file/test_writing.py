"""Robot files are written with their comments, checked first, in one step, and can be brought back."""

import math
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from servobus import RobotFileError
from servobus.core.units import deg, parse
from servobus.robots.file import writing
from servobus.robots.file.reading import read_file, read_text
from servobus.robots.file.writing import copies, create, edited, quantity, save, undo
from unit.robots.arms import SIX

COMMENTS = re.findall(r"#.*", SIX)


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(SIX)
    return path


def changed(changes: dict[tuple[str, ...], Any], text: str = SIX) -> str:
    return edited(read_text(text), changes)


def names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


# Quantities


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (math.pi / 2, "rad", "90deg"),
        (-0.0, "rad", "0deg"),
        (-1e-9, "rad", "0deg"),
        (-12.3456 * deg, "rad", "-12.3456deg"),
        (2 * math.pi, "rad/s", "360deg/s"),
        (1.5, "s", "1.5s"),
        (0.8, "1", "80%"),
        (10.0, "degC", "10degC"),
        (0.25, "kg", "0.25kg"),
        (1e6 * deg, "rad", "1000000deg"),
    ],
)
def test_a_quantity_is_written_as_the_file_has_it(value: float, unit: str, text: str) -> None:
    assert quantity(value, unit) == text


@pytest.mark.parametrize("unit", ["rad", "rad/s", "rad/s2", "rad/s3", "s", "degC", "1", "kg", "m"])
def test_a_quantity_that_is_written_can_be_read(unit: str) -> None:
    assert parse(quantity(1.2345, unit), unit) == pytest.approx(1.2345, abs=1e-4)


# Changes


def test_a_value_is_replaced_and_its_comment_stays() -> None:
    text = changed({("pose", "home", "grip"): "6deg"})
    assert 'grip = "6deg"  # nearly closed\n' in text
    assert read_text(text).poses["home"]["grip"] == pytest.approx(6 * deg)


def test_the_first_pose_and_the_first_motion_bring_no_empty_heads() -> None:
    text = changed(
        {("pose", "home"): {"base": "1deg"}, ("motion", "wave", "file"): "wave.csv", ("group", "all"): ["base"]},
        "[robot]\nformat = 1\n",
    )
    assert [line for line in text.splitlines() if line.startswith("[")] == [
        "[robot]",
        "[pose.home]",
        "[motion.wave]",
        "[group]",
    ]


def test_all_comments_and_the_order_stay_with_many_changes() -> None:
    text = changed(
        {
            ("joint", "base", "limits"): ["-90deg", "90deg"],
            ("joint", "base", "registers"): {"punch": 40},
            ("joint", "lift", "mirror", "zero"): "171deg",
            ("joint", "turn", "protect"): {"push": "70%"},
            ("port", "spare"): {"path": "/dev/ttyUSB7"},
            ("group", "both"): ["wrist", "grip"],
            ("pose", "up"): {"base": "10deg"},
            ("robot", "rest"): None,
        }
    )
    assert [comment for comment in re.findall(r"#.*", text) if comment in COMMENTS] == COMMENTS
    file = read_text(text)
    assert list(file.joints) == list(read_text(SIX).joints)
    assert file.joints["base"].registers == {"punch": 40}
    assert file.robot.rest is None


def test_a_comment_above_a_table_stays_with_it() -> None:
    text = changed({("joint", "base", "registers"): {"punch": 40}})
    assert "# Two servos lift it, one of them turned round.\n[joint.lift]\n" in text
    assert '# acceleration = "400deg/s2"\n' in text.split("[joint.base.registers]")[0]
    assert "\n\n[joint.base.registers]\npunch = 40\n\n# Two servos" in text


def test_a_comment_above_a_table_goes_with_it() -> None:
    text = changed({("pose", "home"): None, ("robot", "rest"): None, ("motion", "wave"): None})
    assert "# Poses." not in text
    assert '\n\n[pose.open]\ngrip = "60deg"\n' in text


def test_a_table_in_one_line_is_changed_too() -> None:
    text = SIX.replace('[pose.open]\ngrip = "60deg"\n', '[pose]\nopen = { grip = "60deg", wrist = "1deg" }  # wide\n')
    new = changed({("pose", "open", "grip"): "61deg", ("pose", "open", "wrist"): None}, text)
    assert re.search(r'open = \{ *grip = "61deg" *\}  # wide', new)


def test_a_mapping_replaces_the_keys_of_a_table() -> None:
    text = changed({("pose", "home"): {"grip": "9deg", "base": "1deg"}})
    assert tomllib.loads(text)["pose"]["home"] == {"base": "1deg", "grip": "9deg"}
    assert 'grip = "9deg"  # nearly closed' in text


def test_steps_of_a_motion_get_a_line_each() -> None:
    steps = [{"pose": "home", "time": "0s"}, {"joints": {"grip": "5deg"}, "time": "2s"}]
    text = changed({("motion", "new"): {"steps": steps, "loop": True}})
    assert tomllib.loads(text)["motion"]["new"] == {"steps": steps, "loop": True}
    assert len([line for line in text.splitlines() if line.strip().startswith("{")]) == 4


def test_the_day_is_written_where_something_changes() -> None:
    assert changed({("pose", "open", "grip"): "60deg", ("pose", "none"): None}) == SIX
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", read_text(changed({("pose", "open", "grip"): "61deg"})).robot.changed or "")


def test_line_ends_stay() -> None:
    text = changed({("pose", "up"): {"base": "10deg"}}, SIX.replace("\n", "\r\n"))
    assert text.count("\n") == text.count("\r\n") > SIX.count("\n")
    assert read_text(text).poses["up"] == {"base": pytest.approx(10 * deg)}


def test_what_cannot_be_changed_alone_is_refused() -> None:
    with pytest.raises(RobotFileError, match="name is a value"):
        changed({("robot", "name", "first"): "a"})


# Saving


def test_a_file_is_saved_and_brought_back(arm: Path) -> None:
    file = read_file(arm)
    saved = save(file, edited(file, {("robot", "name"): "other"}))
    assert saved.robot.name == read_file(arm).robot.name == "other"
    assert [copy.read_text() for copy in copies(arm)] == [SIX]
    again = save(saved, edited(saved, {("robot", "name"): "third"}))
    assert again.robot.name == "third"
    assert undo(arm).text == saved.text
    assert (arm.parent / "arm.toml.undone").read_text() == again.text
    assert undo(arm).text == SIX
    with pytest.raises(RobotFileError, match="nothing to undo"):
        undo(arm)


def test_a_wrong_text_is_not_saved(arm: Path) -> None:
    file = read_file(arm)
    with pytest.raises(RobotFileError, match=r"arm\.toml:\d+: \[joint\.base\.limits\]"):
        save(file, edited(file, {("joint", "base", "limits"): ["10deg", "-10deg"]}))
    assert arm.read_text() == SIX
    assert names(arm.parent) == ["arm.toml"]


def test_a_file_that_another_program_changed_is_left_as_it_is(arm: Path) -> None:
    file = read_file(arm)
    arm.write_text(SIX + "\n# mine\n")
    with pytest.raises(RobotFileError, match="changed by another program"):
        save(file, edited(file, {("robot", "name"): "other"}))
    assert arm.read_text() == SIX + "\n# mine\n"
    arm.unlink()
    with pytest.raises(RobotFileError, match="is gone"):
        save(file, edited(file, {("robot", "name"): "other"}))
    assert names(arm.parent) == []


def test_the_same_text_leaves_no_copy(arm: Path) -> None:
    file = read_file(arm)
    assert save(file, file.text) is file
    assert not copies(arm)


def test_old_copies_go_and_those_of_the_user_stay(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writing, "KEPT", 3)
    (arm.parent / "arm.toml.mine.bak").write_text("mine")
    file = read_file(arm)
    for number in range(5):
        file = save(file, edited(file, {("robot", "name"): f"n{number}"}))
    assert [read_file(copy).robot.name for copy in copies(arm)] == ["n1", "n2", "n3"]
    assert (arm.parent / "arm.toml.mine.bak").exists()


def test_a_clock_that_was_set_back_does_not_mix_the_copies(arm: Path) -> None:
    late = arm.parent / "arm.toml.2999-01-01_00-00-00-000000.bak"
    late.write_text(SIX)
    file = read_file(arm)
    save(file, edited(file, {("robot", "name"): "other"}))
    assert copies(arm)[0] == late
    assert len(copies(arm)) == 2


def test_a_link_and_the_permissions_stay(arm: Path) -> None:
    link = arm.parent / "link.toml"
    link.symlink_to(arm)
    arm.chmod(0o640)
    file = read_file(link)
    save(file, edited(file, {("robot", "name"): "other"}))
    assert link.is_symlink()
    assert read_file(arm).robot.name == "other"
    assert arm.stat().st_mode & 0o777 == 0o640
    assert undo(link).robot.name == "six"


def test_a_folder_that_cannot_be_written_is_told(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, text: str) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(writing, "replace_text", full)
    file = read_file(arm)
    with pytest.raises(RobotFileError, match="cannot be written: No space left"):
        save(file, edited(file, {("robot", "name"): "other"}))
    assert arm.read_text() == SIX


def test_a_new_file_is_not_written_over_another(tmp_path: Path) -> None:
    made = create(tmp_path / "arm.toml", SIX)
    assert made.robot.name == "six"
    with pytest.raises(RobotFileError, match="there is such a file already"):
        create(tmp_path / "arm.toml", SIX)
    with pytest.raises(RobotFileError, match="no TOML"):
        create(tmp_path / "bad.toml", "=")
    assert names(tmp_path) == ["arm.toml"]


def test_reading_needs_no_library_that_writes() -> None:
    code = "import sys, servobus.robots.opening, servobus.robots.file.writing; sys.exit('tomlkit' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
