"""`robot export` and `robot import`: files are made, none is replaced unasked, notes go to standard error."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from servobus.robots.file.reading import read_file
from servobus.robots.formats.table import FORMATS
from unit.cli.conftest import Run
from unit.robots.arms import SIX

LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="2"/>'
URDF = f'<robot name="r"><joint name="j1" type="revolute">{LIMIT}</joint></robot>'
MOVE = json.dumps({"framerate": 50.0, "positions": {"0.0": {"wrist": [1.5, 0.0]}, "1.0": {"wrist": [2.5, 0.0]}}})


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "arm.toml"
    path.write_text(SIX)
    return path


@pytest.mark.parametrize("name", [name for name, one in FORMATS.items() if one.write])
def test_export_prints_and_tells_what_is_lost(arm: Path, run: Run, name: str) -> None:
    printed = run("robot", "export", arm.name, name)
    assert FORMATS[name].lacks in printed.stderr
    run("robot", "export", arm.name, name, "-o", "out")
    assert Path("out").read_text() == printed.stdout


def test_export_replaces_nothing_unasked(arm: Path, run: Run, refused: Callable[..., str]) -> None:
    Path("out").write_text("mine")
    assert "--force" in refused("robot", "export", arm.name, "urdf", "-o", "out")
    assert Path("out").read_text() == "mine"
    run("robot", "export", arm.name, "urdf", "-o", "out", "--force")
    assert Path("out").read_text() != "mine"


def test_a_format_that_only_comes_in(arm: Path, refused: Callable[..., str]) -> None:
    assert "goes the other way only" in refused("robot", "export", arm.name, "d6a", code=2)


def test_import_makes_a_robot_file(arm: Path, run: Run) -> None:
    run("robot", "export", arm.name, "pypot", "-o", "robot.json")
    done = run("robot", "import", "robot.json", "-o", "new.toml", "--port", "base=/dev/ttyUSB0")
    assert done.stdout == "3 joints on 1 ports written to new.toml\n"
    assert "no gear" in done.stderr
    made = read_file("new.toml")
    assert made.ports["base"].path == "/dev/ttyUSB0"
    assert made.robot.name == "new"
    assert list(made.joints) == ["base", "lift", "lift_mirror"]
    printed = run("robot", "import", "robot.json", "--port", "/dev/tty=USB0")
    assert 'path = "/dev/tty=USB0"' in printed.stdout


def test_import_replaces_no_robot_file(arm: Path, run: Run, refused: Callable[..., str]) -> None:
    run("robot", "export", arm.name, "robotis", "-o", "a.robot")
    assert "already" in refused("robot", "import", "a.robot", "-o", arm.name)
    assert arm.read_text() == SIX


def test_limits_come_into_a_robot_file(arm: Path, run: Run) -> None:
    Path("arm.urdf").write_text(URDF)
    done = run("robot", "import", "arm.urdf", "--onto", arm.name, "--joint", "j1=wrist")
    assert done.stdout == "arm.toml: limits of wrist and speed of wrist\n"
    assert read_file(arm).joints["wrist"].limits == pytest.approx((-1, 1), abs=2e-6)
    assert "# The base turns the whole arm." in arm.read_text()
    assert list(arm.parent.glob("arm.toml.*.bak"))


def test_a_motion_comes_with_a_file_of_samples(arm: Path, run: Run, refused: Callable[..., str]) -> None:
    Path("nod.move").write_text(MOVE)
    done = run("robot", "import", "nod.move", "--onto", arm.name)
    assert "samples in nod.csv" in done.stdout
    assert Path("nod.csv").read_text() == "time,wrist\n0.0000,1.500\n1.0000,2.500\n"
    assert read_file(arm).motions["nod"].file == "nod.csv"
    text = arm.read_text()
    Path("other.csv").write_text("mine")
    assert "other.csv exists already" in refused("robot", "import", "nod.move", "--onto", arm.name, "--name", "other")
    assert Path("other.csv").read_text() == "mine"
    assert arm.read_text() == text


def test_what_cannot_be_is_refused_and_changes_nothing(arm: Path, refused: Callable[..., str]) -> None:
    Path("arm.urdf").write_text(URDF)
    assert "robot init" in refused("robot", "import", "arm.urdf", "-o", "new.toml")
    assert "--format" in refused("robot", "import", arm.name, "-o", "new.toml")
    assert "cannot be read" in refused("robot", "import", "nothing.json", "-o", "new.toml")
    assert "say -o" in refused("robot", "import", "arm.urdf", "-o", "a", "--onto", arm.name, code=2)
    assert "THEIRS=OURS" in refused("robot", "import", "arm.urdf", "--onto", arm.name, "--joint", "j1", code=2)
    onto = ("robot", "import", "arm.urdf", "--onto", arm.name, "--joint", "j1=wrist")
    assert "--model rx28, --joint j2=grip: nothing in this URDF" in refused(
        *onto, "--joint", "j2=grip", "--model", "rx28", code=2
    )
    assert "--name wave" in refused(*onto, "--name", "wave", code=2)
    assert arm.read_text() == SIX
    assert not Path("new.toml").exists()
