"""robot init, check, show, move, schema; pose save, go, list: what they do, and that only two of them move anything."""

import json
import tomllib
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import pytest
from click.testing import CliRunner
from rich.console import Console

import servobus
from servobus.cli.app import app
from servobus.cli.robots.show import _entry, _table
from servobus.core.units import deg
from servobus.families import registry
from servobus.robots.file.reading import read_file, read_text
from unit.cli.conftest import Run
from unit.cli.test_complete import offered
from unit.robots.arms import JOINTS, LIVE

PORTS = "virtual:rx28@1-2?clock=virtual", "virtual:drs0602@219?clock=virtual"


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(LIVE)
    return path


# init


def test_init_takes_defaults(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "new.toml"
    done = run("robot", "init", *PORTS, "-o", path, "--yes")
    assert done.stdout == f"{path}: 3 joints: joint1, joint2, joint3\n"
    file = read_file(path)
    joints = file.joints.values()
    assert [(joint.port, joint.id) for joint in joints] == [("port1", 1), ("port1", 2), ("port2", 219)]
    assert [joint.zero / deg for joint in joints] == pytest.approx([150, 150, 0])
    assert "# limits = " in file.text
    run("robot", "check", path, "--quick")


def test_init_asks_for_names_until_they_can_be_used(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "new.toml"
    done = run("robot", "init", *PORTS, "-o", path, "--as-found", input="hip\nhip\n2nd\nknee\n\n")
    assert list(read_file(path).joints) == ["hip", "knee", "joint1"]
    assert "there is a joint hip already" in done.stderr
    assert "RX-28 id 1 on virtual:rx28@1-2" in done.stderr
    assert read_file(path).joints["hip"].zero / deg == pytest.approx(149.85, abs=0.3)


def test_init_asks_for_models_that_servos_cannot_say(run: Run, tmp_path: Path) -> None:
    port, path = "virtual:lx16a@11-12,rx28@1,model_number=1060?clock=virtual", tmp_path / "new.toml"
    done = run("robot", "init", port, "-o", path, "--yes")
    assert [(joint.id, joint.model.key()) for joint in read_file(path).joints.values()] == [
        (11, "lx16a"),
        (12, "lx16a"),
    ]
    assert "model unknown, id 12: it cannot say its model, and is taken for lx16a" in done.stderr
    assert "id 1 is left out: it is of model 1060, which is not known here" in done.stderr
    path.unlink()
    done = run("robot", "init", port, "-o", path, "--as-found", input="lx16b\nlx15d\nhip\nnone\n")
    (hip,) = read_file(path).joints.values()
    assert (hip.name, hip.id, hip.model.key()) == ("hip", 11, "lx15d")
    assert hip.zero / deg == pytest.approx(120, abs=0.5)  # an LX-16A stands at 500 of 1000 steps, over 240°
    assert "'lx16b' is no model of this family: lx16a, lx15d" in done.stderr


def test_init_writes_over_nothing(refused: Callable[..., str], arm: Path) -> None:
    assert "there is such a file already" in refused("robot", "init", PORTS[0], "-o", arm, "--yes")
    assert arm.read_text() == LIVE
    new = arm.parent / "new.toml"
    nobody = CliRunner().invoke(app, ["robot", "init", PORTS[0], "-o", str(new)], input="")
    assert nobody.exit_code == 1
    assert "--yes takes joint1" in nobody.stderr
    assert "named twice" in refused("robot", "init", PORTS[0], PORTS[0], "-o", new, "--yes")
    assert "no servo was found" in refused("robot", "init", PORTS[0], "-o", new, "--yes", "--family", "herkulex")
    assert not new.exists()


# Looking


def test_check_tells_what_is_missing(run: Run, arm: Path) -> None:
    assert run("robot", "check", arm, "--quick").stdout == "arm.toml: all servos are there\n"
    arm.write_text(LIVE.replace("rx28@1-3", "rx28@1-2"))
    found = json.loads(run("robot", "check", arm, "--json", "--quick", code=1).stdout)
    assert [(one["kind"], one["joint"]) for one in found] == [("missing", "lift")]


def test_check_looks_for_strangers_of_all_families(run: Run, arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "bauds", lambda family: registry.factory_bauds(family)[:1])  # as many as a test needs
    port = "virtual:rx28@1,lx16a@99?clock=virtual"
    arm.write_text(
        f'[robot]\nformat = 1\n[port.main]\npath = "{port}"\n[joint.one]\nport = "main"\nmodel = "rx28"\nid = 2\n'
    )
    assert "id 99" not in run("robot", "check", arm, "--quick", code=1).stdout
    missing, first, second = run("robot", "check", arm, code=1).stdout.splitlines()
    assert missing.startswith("arm.toml: one is missing: RX-28 id 2")
    assert first.startswith("arm.toml: a stranger on port main: RX-28 id 1 at 57600 baud")
    assert second.startswith("arm.toml: a stranger on port main: LX/HTS bus servo, model unknown id 99 at 115200 baud")


def test_show_has_a_line_for_each_joint(run: Run, arm: Path) -> None:
    lines = run("robot", "show", arm).stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["joint", *JOINTS]
    assert "off" in lines[1]
    arm.write_text(LIVE.replace("rx28@1-3", "rx28@1-2"))
    assert "no answer" in run("robot", "show", arm, "--once").stdout


def test_show_for_programs(run: Run, arm: Path) -> None:
    entries = json.loads(run("robot", "show", arm, "--json").stdout)
    assert [entry["joint"] for entry in entries] == list(JOINTS)
    assert entries[1]["position"] == {"value": pytest.approx(-20, abs=0.3), "unit": "°"}
    assert entries[1]["limits"][0] == {"value": pytest.approx(-60), "unit": "°"}
    assert entries[1]["torque"] is False
    assert entries[0]["disagreement"] is None
    assert entries[0]["goal"] is None  # limp: it goes nowhere


def test_show_has_goals_of_driven_joints() -> None:
    with servobus.robot(read_text(LIVE)) as arm:
        arm.base.torque_on()
        arm.base.move(30 * deg, time=20)
        seen, goals = arm.look(), arm.read("goal_position")
        entries = {joint.name: _entry(joint, seen, goals) for joint in arm}
        assert entries["base"]["goal"] == {"value": pytest.approx(30, abs=0.3), "unit": "°"}
        assert entries["lift"]["goal"] is None
        out = Console(width=100, file=StringIO(), force_terminal=False)
        out.print(_table(arm, seen, goals))
    assert isinstance(out.file, StringIO)
    lines = out.file.getvalue().splitlines()
    assert lines[1].split()[2] in ("29.9°", "30.1°")  # steps of 0.29°
    assert lines[2].split()[2].startswith("─")


# Moving


def test_move_switches_torque_on_and_says_so(run: Run, arm: Path) -> None:
    done = run("robot", "move", arm, "base=20", "grip+=5", "--time", 1)
    assert done.stderr == "torque switched on: base, grip\n"
    base, grip = done.stdout.splitlines()
    assert base.startswith("base  ")
    assert abs(float(base.split()[1].rstrip("°")) - 20) < 0.6
    assert abs(float(grip.split()[1].rstrip("°")) - 29) < 0.6


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["base=200"], 1, "base: 200.0° is outside its limits"),
        (["base=20", "elbo=3"], 1, "no joint 'elbo'"),
        (["base=20grad"], 2, "an angle is 90, 90deg"),
        (["base=20", "base=30"], 2, "base is named twice"),
        (["base"], 2, "is not JOINT=ANGLE"),
        (["base=20", "--time", "1", "--speed", "3"], 2, "either --time or --speed"),
        (["base=100", "--time", "0.1"], 1, "faster than its 120.0°/s"),
    ],
)
def test_a_move_that_cannot_be_done_moves_nothing(
    refused: Callable[..., str], arm: Path, words: list[str], code: int, told: str
) -> None:
    said = refused("robot", "move", arm, *words, code=code)
    assert told in said
    assert "torque switched on" not in said


def test_what_is_missing_is_not_moved_and_the_others_can_be(run: Run, refused: Callable[..., str], arm: Path) -> None:
    arm.write_text(LIVE.replace("rx28@1-3", "rx28@1-2"))
    for words in (
        ("robot", "move", arm, "base=5", "lift=0"),
        ("robot", "move", arm, "lift+=5"),
        ("pose", "go", arm, "home"),
    ):
        said = refused(*words)
        assert "lift is missing: RX-28 id 3" in said
        assert "nothing was done" in said
    assert run("robot", "move", arm, "base=5").stderr == "torque switched on: base\n"


# Poses


def test_torque_of_joints_on_and_off(run: Run, refused: Callable[..., str], arm: Path) -> None:
    assert run("robot", "torque", arm, "on", "grip", "base").stdout == "torque on: base, grip\n"
    assert run("robot", "torque", arm, "off").stdout == f"torque off: {', '.join(JOINTS)}\n"
    said = json.loads(run("robot", "torque", arm, "on", "base", "--json").stdout)
    assert said == {"torque": True, "joints": ["base"]}
    arm.write_text(LIVE.replace("drs0602@1-2", "drs0602@2"))
    assert "elbow is missing" in refused("robot", "torque", arm, "on")
    assert refused("robot", "torque", arm, "off").startswith("servobus: elbow: ")


def test_joints_are_stopped(run: Run, arm: Path) -> None:
    limp = "it drives nothing: its torque was off"
    assert run("robot", "stop", arm).stdout == "".join(f"{name}: {limp}\n" for name in JOINTS)
    assert json.loads(run("robot", "stop", arm, "grip", "--json").stdout) == {"grip": {"held": False, "done": limp}}


def test_a_pose_is_saved_with_all_comments(run: Run, arm: Path) -> None:
    run("pose", "save", arm, "here")
    text = arm.read_text()
    assert [line for line in LIVE.splitlines() if "#" in line] == [line for line in text.splitlines() if "#" in line]
    pose = read_file(arm).poses["here"]
    assert set(pose) == set(JOINTS)
    assert pose["lift"] / deg == pytest.approx(-20, abs=0.3)
    run("pose", "save", arm, "here", "grip", "base")
    assert list(read_file(arm).poses["here"]) == ["base", "grip"]
    assert len(list(arm.parent.glob("arm.toml.*.bak"))) == 2


def test_a_pose_of_lost_joints_is_not_saved(refused: Callable[..., str], arm: Path) -> None:
    text = LIVE.replace("rx28@1-3", "rx28@1-2")
    arm.write_text(text)
    assert "lift is missing: RX-28 id 3" in refused("pose", "save", arm, "here")
    assert arm.read_text() == text


def test_to_a_pose_it_goes_slowly(run: Run, refused: Callable[..., str], arm: Path) -> None:
    done = run("pose", "go", arm, "home", "--json")
    seen = json.loads(done.stdout)
    assert seen["goals"] == {"base": 0, "lift": 10, "elbow": 20, "turn": 0, "wrist": 0, "grip": 5}
    assert seen["positions"] == {name: pytest.approx(angle, abs=1) for name, angle in seen["goals"].items()}
    assert "no pose 'hom'; there are home, open" in refused("pose", "go", arm, "hom")


def test_poses_are_listed(run: Run, refused: Callable[..., str], arm: Path) -> None:
    assert run("pose", "list", arm).stdout.splitlines()[1] == "open  grip 60.0°"
    assert json.loads(run("pose", "list", arm, "--json").stdout)["open"] == {"grip": 60.0}
    empty = arm.parent / "empty.toml"
    empty.write_text("[robot]\nformat = 1\n")
    assert "there is no pose" in refused("pose", "list", empty)


def test_a_pose_is_undone(run: Run, refused: Callable[..., str], arm: Path) -> None:
    run("pose", "save", arm, "home", "grip")
    run("pose", "save", arm, "here", "grip")
    changed = arm.read_text()
    done = run("robot", "undo", arm).stdout.splitlines()
    assert "-[pose.here]" in done
    assert done[-1] == f"{arm}: brought back; its joints are {', '.join(JOINTS)}"
    assert "here" not in read_file(arm).poses
    assert arm.with_name("arm.toml.undone").read_text() == changed
    assert '+grip = "5deg"  # nearly closed' in run("robot", "undo", arm).stdout.splitlines()
    assert arm.read_text() == LIVE
    assert "there is nothing to undo" in refused("robot", "undo", arm)


# What the Tab key offers


def test_joints_and_poses_are_offered(arm: Path) -> None:
    assert offered("robot", "move", str(arm), "e") == ["elbow="]
    assert offered("pose", "go", str(arm), "") == ["home", "open", "up"]
    assert offered("pose", "save", str(arm), "new", "gr") == ["grip"]
    assert offered("pose", "") == ["save", "go", "list"]


def test_a_schema_is_printed(run: Run) -> None:
    assert json.loads(run("robot", "schema").stdout)["required"] == ["robot"]
    assert tomllib.loads(LIVE)["robot"]["format"] == 1
