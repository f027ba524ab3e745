"""`play`, `teach` and `teleop` on virtual arms: keys, files, and what is told. Time is virtual, and so are the keys."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from servobus import deg
from servobus.cli.keys import Keys
from servobus.robots.file.reading import read_file
from servobus.robots.motions.motion import motion_of
from servobus.robots.motions.recording import CsvRecorder, Moment, read_recording
from unit.cli.conftest import Run
from unit.cli.test_complete import offered
from unit.robots.test_teleop import FOLLOWER, LEADER

MOTIONS = """
# What it can do.
[motion.nod]
steps = [
  { joints = { base = "0deg", grip = "0deg" }, time = "0s" },
  { joints = { base = "20deg", grip = "20deg" }, time = "0.3s" },
  { joints = { base = "0deg", grip = "0deg" }, time = "0.6s" },
]

[motion.wave]
steps = [
  { joints = { base = "0deg" }, time = "0s" },
  { joints = { base = "10deg" }, time = "0.2s" },
]
"""
Typed = Callable[[Iterator[str]], None]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.toml").write_text(FOLLOWER + MOTIONS)
    Path("leader.toml").write_text(LEADER)
    Path("follower.toml").write_text(FOLLOWER)


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Typed:
    """Be a terminal on which these keys are pressed, one each time somebody asks; "" is none."""

    def sit(keys: Iterator[str]) -> None:
        def enter(self: Keys) -> Keys:
            self.there = True
            return self

        monkeypatch.setattr(Keys, "__enter__", enter)
        monkeypatch.setattr(Keys, "pressed", lambda _self: next(keys, ""))

    return sit


def after(turns: int, *keys: str) -> Iterator[str]:
    yield from [""] * turns
    yield from keys


def test_play_goes_through_the_motion_and_tells_where_it_ended(run: Run) -> None:
    result = run("play", "arm.toml", "wave", "--rate", "50")
    assert result.stdout.startswith("wave played: base ")
    assert "torque switched on: base\n" in result.stderr
    entry = json.loads(run("play", "arm.toml", "wave", "--rate", "50", "--json").stdout)
    assert entry["stopped"] is False
    assert entry["duration"] >= 0.2
    assert entry["positions"] == pytest.approx({"base": 10.0}, abs=1.0)


def test_play_pauses_on_space_and_ends_on_q(run: Run, typed: Typed) -> None:
    typed(after(10, " ", *[""] * 50, "q"))
    result = run("play", "arm.toml", "nod", "--rate", "50", "--record", "run.csv")
    assert result.stdout.startswith("nod ended: base ")
    goals = [moment.goals["base"] for moment in read_recording(Path("run.csv"))]
    assert len(goals) == pytest.approx(62, abs=3)
    assert len(set(goals[-30:])) == 1, "it stood"
    assert 0 < goals[-1] < 20 * deg


@pytest.mark.parametrize("kind", ["csv", "mcap"])
def test_what_was_recorded_is_played_back(run: Run, kind: str) -> None:
    if kind == "mcap":
        pytest.importorskip("mcap")
    run("play", "arm.toml", "nod", "--rate", "50", "--record", f"run.{kind}")
    moments = read_recording(Path(f"run.{kind}"))
    assert moments[0].time == 0.0
    assert max(moment.positions["base"] for moment in moments) == pytest.approx(20 * deg, abs=2 * deg)
    run("teach", "arm.toml", "again", "--from", f"run.{kind}")
    motion = motion_of(read_file("arm.toml"), "again")
    assert max(motion.poses["base"]) == pytest.approx(20 * deg, abs=3 * deg)
    result = run("play", "arm.toml", f"run.{kind}", "--rate", "25")
    assert result.stdout.startswith(f"run.{kind} played: base ")


def test_play_refuses_before_anything_moves(refused: Callable[..., str]) -> None:
    assert "no motion 'wav'; there are nod, wave" in refused("play", "arm.toml", "wav")
    assert "0.0 is no pace" in refused("play", "arm.toml", "nod", "--pace", "0")
    assert "rate" in refused("play", "arm.toml", "nod", "--rate", "0")
    assert "ends in .csv or .mcap" in refused("play", "arm.toml", "nod", "--record", "run.txt")
    assert "none.csv: cannot be read" in refused("play", "arm.toml", "none.csv")
    Path("mine.csv").write_text("mine")
    assert "exists already" in refused("play", "arm.toml", "nod", "--record", "mine.csv")


def test_teach_keeps_samples_beside_the_file_and_comments_in_it(run: Run) -> None:
    result = run("teach", "arm.toml", "swing", "base", "grip", "--seconds", "0.5")
    assert result.stdout.startswith("swing: 2 poses of 27 readings, within 1.0°, 0.5 s; ")
    assert "swing.raw.csv" in result.stderr
    assert len(read_recording(Path("swing.raw.csv"))) == 27
    file = read_file("arm.toml")
    assert "# What it can do." in file.text
    assert file.motions["swing"].file == "swing.csv"
    assert set(motion_of(file, "swing").poses) == {"base", "grip"}
    run("play", "arm.toml", "swing", "--rate", "50")
    # Another of the same name is refused before anything goes limp.
    again = run("teach", "arm.toml", "swing", "base", "--seconds", "0.5", code=1)
    assert "there is a motion 'swing' already" in again.stderr
    forced = run("teach", "arm.toml", "swing", "base", "--seconds", "0.5", "--force", "--json")
    assert json.loads(forced.stdout)["joints"] == ["base"]
    assert read_file("arm.toml").motions["swing"].file == "swing-2.csv"


def test_teach_marks_poses_with_a_key(run: Run, typed: Typed) -> None:
    typed(after(5, " ", "", " ", *[""] * 5, "q"))
    result = run("teach", "arm.toml", "look", "base", "--poses")
    assert result.stdout.startswith("look: 2 poses, 0.5 s; ")
    assert len(read_file("arm.toml").motions["look"].steps) == 2
    assert not list(Path().glob("look*")), "all of it stands in the robot file"


def test_teach_makes_a_motion_of_what_a_crash_left(run: Run, refused: Callable[..., str]) -> None:
    Path("swing.raw.csv").write_text("time,base\n0.00,0.0\n0.02,\n0.04,2.0\n0.06,2.0\n0.08,2.")
    result = run("teach", "arm.toml", "swing", "--from", "swing.raw.csv", "--tolerance", "0.1")
    assert "base: 1 lost readings lie between their neighbours" in result.stderr
    motion = motion_of(read_file("arm.toml"), "swing")
    assert motion.poses["base"] == pytest.approx((0, 2 * deg, 2 * deg))
    Path("look.poses.csv").write_text("time,base\n0.0,0.0\n9.0,45.0\n")
    run("teach", "arm.toml", "look", "--from", "look.poses.csv", "--poses")
    assert [step.time for step in read_file("arm.toml").motions["look"].steps] == [0.0, 1.0]
    Path("other.csv").write_text("time,elbo\n0.0,0.0\n")
    assert "has no joint 'elbo'" in refused("teach", "arm.toml", "new", "--from", "other.csv")


def test_teach_without_a_terminal_needs_an_end(refused: Callable[..., str]) -> None:
    assert "nobody can end it: say --seconds" in refused("teach", "arm.toml", "swing", "base")
    assert "no keys can mark poses" in refused("teach", "arm.toml", "swing", "base", "--poses", "--seconds", "1")
    assert "leave --rate out" in refused("teach", "arm.toml", "swing", "--poses", "--rate", "50", code=2)
    assert "leave joints" in refused("teach", "arm.toml", "swing", "base", "--from", "run.csv", code=2)
    assert "is no name of a motion" in refused("teach", "arm.toml", "my swing", "base", "--seconds", "1")


def lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def test_teleop_follows_while_space_is_held(run: Run, typed: Typed) -> None:
    # Both stand at 0, so there is no way that the follower has to come.
    pressed = [" ", *[""] * 20, *[" ", ""] * 40, *[""] * 40, "q"]
    typed(after(10, *pressed))
    said = lines(run("teleop", "leader.toml", "follower.toml", "--json", "--record", "run.csv").stdout)
    phases = list(dict.fromkeys(entry["phase"] for entry in said))
    assert phases == ["waiting", "following", "holding"]
    assert said[0]["why"] == "the deadman is not held"
    assert said[-1]["why"] == "the deadman is not held"
    moments = read_recording(Path("run.csv"))
    assert abs(moments[-1].positions["base"]) < 2 * deg


def test_teleop_refuses_what_leads_nowhere(run: Run, refused: Callable[..., str]) -> None:
    assert "--no-deadman goes without" in refused("teleop", "leader.toml", "follower.toml")
    for text, why, code in (
        ("base", "is not A=B", 2),
        ("base=base:x", "'x' is no number to scale by", 2),
        ("base=base:1:1m", "OFFSET is an angle", 2),
        ("base=elbow", "no joint 'elbow'", 1),
    ):
        options = ("--no-deadman", "--map", text)
        assert why in refused("teleop", "leader.toml", "follower.toml", *options, code=code)


def test_joints_and_motions_are_offered() -> None:
    assert offered("play", "arm.toml", "") == ["nod", "wave"]
    assert offered("play", "arm.toml", "n") == ["nod"]
    assert offered("teach", "arm.toml", "new", "base", "g") == ["grip"]
    assert offered("teach", "none.toml", "new", "") == []


def test_show_keeps_what_it_shows_until_ctrl_c(
    run: Run, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write, count = CsvRecorder.write, iter(range(100))

    def interrupted(self: CsvRecorder, moment: Moment) -> None:
        write(self, moment)
        if next(count) == 4:
            raise KeyboardInterrupt

    monkeypatch.setattr(CsvRecorder, "write", interrupted)
    run("robot", "show", "arm.toml", "--record", "run.csv")
    moments = read_recording(Path("run.csv"))
    assert [set(moment.positions) for moment in moments] == [{"base", "grip"}] * 5
    assert moments[-1].time == pytest.approx(0.4, abs=0.1)
    assert "leave --once" in refused("robot", "show", "arm.toml", "--once", "--record", "more.csv", code=2)
