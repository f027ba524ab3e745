"""Teaching on virtual arms, whose shafts a hand turns between two readings."""

import asyncio
import math
from collections.abc import Iterator
from pathlib import Path

import pytest

import servobus
from servobus import UsageError, deg
from servobus.errors import BadValue, BusError, MotionError, UnknownName
from servobus.robots.blocking import Robot
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.reading import read_file, read_text
from servobus.robots.motions.keeping import check_free, free_path, keep_samples, keep_steps
from servobus.robots.motions.motion import Motion, motion_of
from servobus.robots.motions.recording import read_recording
from servobus.robots.motions.teach import BlockingTeach, TeachTick
from servobus.robots.trajectory.spline import spline
from unit.robots.arms import LIVE, opened, port_of, servos_of

SWING = 40 * deg


def turn(arm: Robot, joint: str, angle: float) -> None:
    """Turn a joint by hand."""
    for part, servo in zip(arm[joint].parts, servos_of(arm, joint), strict=True):
        servo.turn_shaft(part.axis.to_servo(angle))


def taught(arm: Robot, teach: BlockingTeach, seconds: float = 2.0) -> Iterator[TeachTick]:
    """Swing base and grip by hand while it is recorded."""
    for tick in teach:
        turn(arm, "base", SWING * math.sin(3 * tick.time))
        turn(arm, "grip", SWING / 2 * math.sin(2 * tick.time))
        yield tick
        if tick.time >= seconds:
            teach.stop()


def torque(arm: Robot) -> dict[str, bool]:
    return {name: state.torque for name, state in arm.look().items()}


def test_only_the_named_joints_go_limp_and_what_the_hand_did_is_a_motion(tmp_path: Path) -> None:
    with opened() as arm:
        arm.torque_on()
        raw = tmp_path / "swing.raw.csv"
        teach = arm.teach("base", "grip", keep=raw)
        assert all(torque(arm).values()), "nothing happens before it begins"
        times = [tick.time for tick in taught(arm, teach, 1.0)]
        assert torque(arm) == {name: name not in ("base", "grip") for name in arm.joints}
        assert len(times) == pytest.approx(50, abs=2)
        found = teach.kept()
        assert found.notes == []
        assert len(found.motion.times) < 30
        # The hand turned it after each reading: what is recorded is one period late.
        path = spline(found.motion.times, found.motion.poses, found.motion.shape).paths["base"]
        for time in (0.3, 0.6, 0.9):
            assert path.at(time).position == pytest.approx(SWING * math.sin(3 * (time - 0.02)), abs=1.5 * deg)
        # All of it is in the file.
        assert [one.time for one in read_recording(raw)] == pytest.approx(times, abs=1e-4)
        arm.torque_on()
        arm.play(found.motion, rate=20).wait()
        assert arm["base"].position() == pytest.approx(found.motion.poses["base"][-1], abs=1 * deg)


def test_without_names_those_are_recorded_that_are_limp() -> None:
    with opened() as arm:
        arm.torque_on()
        with pytest.raises(MotionError, match="all joints have torque"):
            arm.teach().wait()
        arm["wrist"].torque_off()
        teach = arm.teach()
        next(iter(teach))
        assert [joint.name for joint in teach.joints] == ["wrist"]
        with pytest.raises(UnknownName, match="no joint 'wirst'"):
            arm.teach("wirst")


def test_marked_poses_become_steps() -> None:
    with opened() as arm:
        teach = arm.teach("base", "grip")
        for n, tick in enumerate(teach):
            turn(arm, "base", (n if n <= 90 else 130) * deg)
            if n in (0, 30, 90):
                assert teach.mark()["base"] == pytest.approx(tick.positions["base"])
            if n == 92:
                with pytest.raises(BadValue, match="base: 130"):
                    teach.mark()
                teach.stop()
        steps = teach.steps()
        assert steps.poses["base"] == pytest.approx((0, 29 * deg, 89 * deg), abs=0.5 * deg)
        # 45°/s at most: 29° take 0.65 s, the 60° after them 1.33 s.
        assert steps.times == pytest.approx((0.0, 0.65, 0.65 + 1.33), abs=0.03)


def test_poses_need_readings_and_two_of_them() -> None:
    with opened() as arm:
        teach = arm.teach("base", "grip")
        with pytest.raises(UsageError, match="nothing has been read yet"):
            teach.mark()
        ticks = iter(teach)
        next(ticks)
        teach.mark()
        with pytest.raises(UsageError, match="at least two poses, and 1 was marked"):
            teach.steps()
        port = port_of(arm, "hand")
        port.rig.unplug(port.servos, port.now())
        next(ticks)
        with pytest.raises(UsageError, match="grip did not answer just now, so this pose was not kept"):
            teach.mark()
        assert len(teach.poses) == 1


def test_a_joint_that_is_silent_for_long_ends_it_and_nothing_is_lost(tmp_path: Path) -> None:
    with opened() as arm:
        raw = tmp_path / "swing.raw.csv"
        teach = arm.teach("base", "grip", keep=raw)
        port = port_of(arm, "hand")
        with pytest.raises(BusError, match="grip does not answer any more, so the recording has ended") as ended:
            for tick in taught(arm, teach, 60.0):
                if 1.0 <= tick.time < 1.02:
                    port.rig.unplug(port.servos, port.now())
        assert str(raw) in str(ended.value)
        assert len(read_recording(raw)) == len(teach.moments)
        found = teach.kept()
        assert found.motion.times[-1] == pytest.approx(1.0, abs=0.05)
        assert found.left_out > 10


def test_a_servo_that_restarts_leaves_a_gap_that_is_told() -> None:
    with opened() as arm:
        teach = arm.teach("base", "elbow")
        port = port_of(arm, "upper")
        gone = servos_of(arm, "elbow")
        for tick in taught(arm, teach):
            if 1.0 <= tick.time < 1.02:
                port.rig.unplug(gone, port.now())
                port.rig.plug(gone, port.now())
        found = teach.kept()
        assert found.left_out or found.interpolated
        assert len(found.notes) == 1


def test_a_port_that_is_gone_ends_it_with_all_that_was_recorded(tmp_path: Path) -> None:
    with opened() as arm:
        raw = tmp_path / "swing.raw.csv"
        teach = arm.teach("base", "grip", keep=raw)
        with pytest.raises(servobus.ServobusError):
            for tick in taught(arm, teach):
                if tick.time >= 1.0:
                    arm.buses["hand"].close()
        assert len(read_recording(raw)) == pytest.approx(51, abs=2)


def test_an_asynchronous_robot_teaches_the_same() -> None:
    async def recorded() -> int:
        async with servobus.robot_async(read_text(LIVE)) as arm:
            teach = arm.teach("base")
            async for tick in teach:
                if tick.time >= 0.5:
                    teach.stop()
            return len(teach.moments)

    assert asyncio.run(recorded()) == pytest.approx(26, abs=1)


# What is kept in the robot file


@pytest.fixture
def file(tmp_path: Path) -> RobotFile:
    path = tmp_path / "arm.toml"
    path.write_text(LIVE.replace("[group]", "# Who belongs together.\n[group]"))
    return read_file(path)


MOTION = Motion((0.0, 0.5, 1.25), {"base": (0.0, 20 * deg, 0.0), "grip": (0.0, 10 * deg, 5 * deg)})


@pytest.mark.parametrize("keep", [keep_steps, keep_samples])
def test_a_motion_that_is_kept_is_read_again_and_comments_stay(file: RobotFile, keep: type, tmp_path: Path) -> None:
    keep(file, "swing", MOTION)
    again = read_file(tmp_path / "arm.toml")
    assert "# Who belongs together." in again.text
    motion = motion_of(again, "swing")
    assert motion.times == pytest.approx(MOTION.times)
    assert motion.shape == "pchip"
    for name, angles in MOTION.poses.items():
        assert motion.poses[name] == pytest.approx(angles, abs=1e-5)
    assert set(again.motions) == {"wave", "bow", "nod", "swing"}


def test_no_motion_is_replaced_unless_told_and_its_samples_stay(file: RobotFile, tmp_path: Path) -> None:
    file = keep_samples(file, "swing", MOTION)
    first = (tmp_path / "swing.csv").read_text()
    with pytest.raises(UsageError, match="there is a motion 'swing' already; give another name, or say --force"):
        keep_samples(file, "swing", MOTION)
    with pytest.raises(UsageError, match="is no name of a motion"):
        check_free(file, "my swing", replace=False)
    other = Motion((0.0, 1.0), {"base": (0.0, 5 * deg)})
    file = keep_samples(file, "swing", other, replace=True)
    assert motion_of(file, "swing").poses.keys() == {"base"}
    assert (tmp_path / "swing.csv").read_text() == first
    assert free_path(file, "swing", ".csv").name == "swing-3.csv"
