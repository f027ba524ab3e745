"""Recordings: what is written is read again, also after a crash, and becomes a motion without anything invented."""

import json
import math
from pathlib import Path

import pytest

from servobus import UsageError, deg
from servobus.robots.motions.motion import Motion
from servobus.robots.motions.recording import Moment, read_recording, recorder
from servobus.robots.motions.thinning import GAP, kept, thinned
from servobus.robots.trajectory.spline import spline
from unit.robots.arms import opened

MOMENTS = [
    Moment(0.0, {"base": 1 * deg, "grip": -2 * deg}, {"base": 1.5 * deg}),
    Moment(0.02, {"grip": -2.5 * deg}, {"base": 1.6 * deg}),
    Moment(0.04, {"base": 2 * deg, "grip": -3 * deg}, {"base": 1.7 * deg}),
]
TEXT = """\
time,base,grip,goal.base
0.0000,1.000,-2.000,1.500
0.0200,,-2.500,1.600
0.0400,2.000,-3.000,1.700
"""


def same(read: list[Moment], written: list[Moment]) -> None:
    assert [one.time for one in read] == pytest.approx([one.time for one in written])
    for one, other in zip(read, written, strict=True):
        assert one.positions == pytest.approx(other.positions)
        assert one.goals == pytest.approx(other.goals)


def test_csv_is_text_that_people_read_and_each_line_is_there_at_once(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    with recorder(path, ["base", "grip"], ["base"]) as out:
        for n, moment in enumerate(MOMENTS):
            out.write(moment)
            assert path.read_text() == "".join(TEXT.splitlines(keepends=True)[: n + 2])
    same(read_recording(path), MOMENTS)


def test_a_last_line_that_was_broken_off_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(TEXT[:-4])
    same(read_recording(path), MOMENTS[:2])


def test_mcap_both_ways_also_without_its_end(tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    path = tmp_path / "run.mcap"
    with recorder(path, ["base", "grip"], ["base"]) as out:
        for moment in MOMENTS:
            out.write(moment)
        crashed = path.read_bytes()
    same(read_recording(path), MOMENTS)
    # The library's own reader finds it by the index at the end.
    with path.open("rb") as file:
        found = list(reader.make_reader(file).iter_messages(topics=["/joints"]))
    schema, channel, message = found[0]
    assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
    assert set(json.loads(schema.data)["properties"]) == set(json.loads(message.data))
    assert [round((one[2].log_time - message.log_time) / 1e6) for one in found] == [0, 20, 40]
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(crashed)
    same(read_recording(broken), MOMENTS)
    broken.write_bytes(crashed[:-7])
    same(read_recording(broken), MOMENTS[:2])


def test_mcap_without_its_library_says_which_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mcap.writer", None)
    with pytest.raises(UsageError, match=r'pip install "servobus\[mcap\]"'):
        recorder(tmp_path / "run.mcap", ["base"])
    assert not list(tmp_path.iterdir())


def test_no_file_is_replaced_and_other_names_are_refused(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("mine")
    with pytest.raises(UsageError, match="exists already and is not replaced"):
        recorder(tmp_path / "run.csv", ["base"])
    assert (tmp_path / "run.csv").read_text() == "mine"
    with pytest.raises(UsageError, match=r"ends in \.csv or \.mcap"):
        recorder(tmp_path / "run.txt", ["base"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", ":1: the first line names the columns"),
        ("time,a,a\n", ":1: the first line names the columns, each once"),
        ("time,a\n0,x\n", ":2: could not convert string to float: 'x'"),
        ("time,a\n,1\n", ":2: write the time and 1 angles"),
        ("time,a\n0,1,2\n", ":2: write the time and 1 angles"),
        ("time,a\n0,nan\n", ":2: write the time and 1 angles"),
        ("time,a\n0,1\n0,2\n", "the time 0 s comes after 0 s"),
        ("time,a\n", "nothing was recorded"),
    ],
)
def test_wrong_recordings_are_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text)
    with pytest.raises(UsageError) as refused:
        read_recording(path)
    assert said in str(refused.value)


def noisy(count: int) -> Motion:
    """Two joints that swing, read with an encoder of 0.3° that is off by one at times."""
    times = tuple(n * 0.02 for n in range(count))

    def read(n: int, angle: float) -> float:
        return round((angle + (-0.3, 0.0, 0.3)[n * n % 3]) / 0.3) * 0.3 * deg

    poses = {
        "base": tuple(read(n, 60 * math.sin(2 * time)) for n, time in enumerate(times)),
        "grip": tuple(read(n, 30 * math.cos(time)) for n, time in enumerate(times)),
    }
    return Motion(times, poses)


@pytest.mark.parametrize("tolerance", [0.7 * deg, 2 * deg])
def test_what_is_left_out_lies_on_the_curve_within_the_tolerance(tolerance: float) -> None:
    motion = noisy(500)
    thin = thinned(motion, tolerance)
    assert len(thin.times) < 100
    assert (thin.times[0], thin.times[-1]) == (motion.times[0], motion.times[-1])
    played = spline(thin.times, thin.poses, thin.shape)
    for name, angles in motion.poses.items():
        missed = [
            abs(played.paths[name].at(time).position - angle) for time, angle in zip(motion.times, angles, strict=True)
        ]
        assert max(missed) <= tolerance


def moments(angles: list[float | None], period: float = 0.05) -> list[Moment]:
    return [
        Moment(n * period, {"grip": 0.0} | ({} if angle is None else {"base": angle * deg}), {})
        for n, angle in enumerate(angles)
    ]


def test_short_gaps_lie_between_their_neighbours_and_longer_ones_are_left_out() -> None:
    with opened() as arm:
        joints = arm.named("base", "grip")
        short = kept(moments([0, 10, None, None, 40, 50]), joints, 0.01 * deg)
        assert short.interpolated == {"base": 2}
        assert short.left_out == 0
        assert short.notes == ["base: 2 lost readings lie between their neighbours"]
        at = spline(short.motion.times, short.motion.poses, "pchip").paths["base"].at
        assert at(0.15).position == pytest.approx(30 * deg, abs=0.01 * deg)
        count = round(GAP / 0.05)
        long = kept(moments([0, 10, *[None] * count, 40, 50]), joints, 0.01 * deg)
        assert (dict(long.interpolated), long.left_out) == ({}, count)
        assert long.notes == [f"{count} of {count + 4} moments are left out, because a joint did not answer"]
        assert [time for time in long.motion.times if 0.05 < time < 0.05 * (count + 2)] == []
        # What was lost at the beginning and at the end is not there at all.
        ends = kept(moments([None, 10, 20, None]), joints)
        assert ends.motion.times == pytest.approx((0.0, 0.05))
        assert ends.motion.poses["base"] == pytest.approx((10 * deg, 20 * deg))


def test_angles_outside_the_limits_stay_at_the_limit_and_are_told() -> None:
    with opened() as arm:
        found = kept(moments([100, 125, 100]), arm.named("base"))
        assert max(found.motion.poses["base"]) == pytest.approx(120 * deg)
        assert found.notes == ["base was up to 5.0° outside its limits, and is kept within them"]


def test_a_recording_that_makes_no_motion_says_why() -> None:
    with opened() as arm:
        with pytest.raises(UsageError, match="elbow: there is no reading of it"):
            kept(moments([0, 1]), arm.named("base", "elbow"))
        with pytest.raises(UsageError, match="at least two moments"):
            kept(moments([None, 1]), arm.named("base"))
