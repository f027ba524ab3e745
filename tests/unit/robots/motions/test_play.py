"""Motions played on a virtual arm of three families: limits at every tick, and all that can go wrong under way."""

import asyncio
from itertools import pairwise
from pathlib import Path

import pytest

import servobus
from servobus import BusError, Stopped, TorqueOff, deg
from servobus.errors import BadValue, PortLost, UnknownName
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_text
from servobus.robots.motions.motion import Motion, limits_of, read_samples, samples_of, samples_text
from servobus.robots.motions.play import BlockingPlay, PlayTick
from servobus.robots.steps import RobotJob
from servobus.virtual.physics.motor import Load
from unit.robots.arms import LIVE, goals_in, opened, port_of, servos_of, shaft_angles

STEP = {"rx28": 0.3 * deg, "drs0602": 0.163 * deg, "lx16a": 0.24 * deg}
"""What one unit of position is, as the manuals say: it is what rounding may add to a goal."""


def unit(arm: Robot, joint: str) -> float:
    entry = arm[joint].entry
    return STEP[entry.model.key()] / entry.ratio


@pytest.mark.parametrize("shape", ["cubic", "quintic", "pchip"])
def test_no_goal_on_the_wire_leaves_a_limit_of_speed_or_acceleration(shape: str) -> None:
    text = LIVE.replace("[motion.bow]", f'[motion.bow]\npath = "{shape}"')
    with opened(text) as arm, arm.torque():
        play = arm.play("bow", rate=50)
        sent: dict[str, list[float]] = {joint.name: [] for joint in play.joints}
        for _ in play:
            for name, goals in sent.items():
                goals.append(goals_in(arm, name)[0])
        for name, goals in sent.items():
            limits, rounding = limits_of(arm[name]), unit(arm, name)
            low, high = arm[name].limits
            assert low - rounding <= min(goals)
            assert max(goals) <= high + rounding
            speeds = [(b - a) / play.period for a, b in pairwise(goals)]
            assert max(map(abs, speeds)) <= limits.speed + rounding / play.period
            # Rounding moves a goal by half a unit; over 5 ticks that is little, and a jump would stand out.
            wide = [(b - a) / (5 * play.period) for a, b in zip(goals, goals[5:], strict=False)]
            changes = [(b - a) / (5 * play.period) for a, b in zip(wide, wide[5:], strict=False)]
            assert max(map(abs, changes)) <= limits.acceleration + 2 * rounding / (5 * play.period) ** 2


def test_the_arm_comes_where_the_motion_ends_and_both_servos_of_a_joint_together() -> None:
    with opened() as arm, arm.torque():
        apart = 0.0
        for _ in arm.play("bow", rate=50):
            one, other = shaft_angles(arm, "lift")
            apart = max(apart, abs(one - other))
        assert apart < 1 * deg
        for name, angle in arm.pose("home").items():
            assert arm[name].position() == pytest.approx(angle, abs=1 * deg)


def test_the_way_to_the_first_pose_is_slow() -> None:
    with opened() as arm, arm.torque():
        arm.move(base=45 * deg, time=1.0).wait()
        speeds = []
        last = goals_in(arm, "base")[0]
        for tick in arm.play("nod", rate=50):
            goal = goals_in(arm, "base")[0]
            if tick.time >= 0:
                break
            speeds.append(abs(goal - last) / 0.02)
            last = goal
        assert len(speeds) > 50
        assert sum(speeds) / len(speeds) < 45 * deg


def test_a_motion_that_is_too_quick_is_stretched_and_says_by_whom() -> None:
    quick = Motion((0.0, 0.1), {"base": (0.0, 90 * deg)}, "quintic")
    with opened() as arm:
        play = arm.play(quick)
        # Quintic from rest to rest: v = 15/8 d/T and a = 10/√3 d/T², so T = max(1.41, 1.02) s.
        assert play.duration == pytest.approx(1.875 * 90 / 120, rel=0.01)
        assert "base" in str(play.stretches[0])


def test_pause_resume_and_stop() -> None:
    with opened() as arm, arm.torque():
        play = arm.play("nod", rate=50)
        stood: list[float] = []
        for n, tick in enumerate(play):
            if n == 20:
                play.pause()
            if 50 < n <= 60:
                stood.append(tick.time)
            if n == 60:
                play.resume()
            if n == 75:
                play.stop()
        assert len(set(stood)) == 1
        assert play.stopped
        assert play.over
        here = arm.positions()
        port_of(arm, "base").sleep(0.5)
        assert arm.positions()["base"] == pytest.approx(here["base"], abs=0.6 * deg)


def test_slow_motion_takes_longer_and_a_loop_begins_again() -> None:
    with opened() as arm, arm.torque():
        play = arm.play("nod", rate=50)
        play.set_pace(0.5)
        began = arm.ports.now()
        play.wait()
        assert arm.ports.now() - began > 1.9 * play.duration
        looped = arm.play("nod", loop=True, rate=50)
        starts = 0
        last: PlayTick | None = None
        for tick in looped:
            if last is not None and tick.time < last.time:
                starts += 1
            last = tick
            if starts == 2:
                looped.stop()
        assert starts == 2


def test_nothing_is_played_without_torque_and_the_limp_joints_are_named() -> None:
    with opened() as arm:
        arm["base"].torque_on()
        with pytest.raises(TorqueOff, match="lift, elbow, turn, wrist, grip: torque is off"):
            arm.play("bow", rate=50).wait()


def test_a_motion_outside_the_limits_is_refused_before_anything_moves() -> None:
    with opened() as arm:
        with pytest.raises(BadValue, match=r"base: 130\.0° at 1 s is outside its limits, -120\.0° \.\. 120\.0°"):
            arm.play(Motion((0.0, 1.0), {"base": (0.0, 130 * deg)}))
        # A cubic swings beyond its poses.
        swing = Motion((0.0, 0.5, 1.0, 1.5), {"grip": (0.0, 69.5 * deg, 69.5 * deg, 0.0)}, "cubic")
        with pytest.raises(BadValue, match="grip"):
            arm.play(swing)
        with pytest.raises(UnknownName, match="no motion 'wav'; there are wave"):
            arm.play("wav")


def standing(arm: Robot) -> None:
    """Make sure that no joint moves any more."""
    port_of(arm, "base").sleep(0.5)
    arm.ports.align(arm.ports.now())
    before = {joint.name: shaft_angles(arm, joint.name) for joint in arm}
    arm.ports.align(arm.ports.now() + 1.0)
    for joint in arm:
        assert shaft_angles(arm, joint.name) == pytest.approx(before[joint.name], abs=0.5 * deg)


def broken_at(play: BlockingPlay, turn: int, what: object) -> None:
    """Let something happen in the middle of a motion."""
    assert callable(what)
    for n, _ in enumerate(play):
        if n == turn:
            what()


def test_a_cable_that_comes_off_stops_all_joints() -> None:
    with opened() as arm:
        arm.torque_on()
        gone = servos_of(arm, "elbow")

        def pull() -> None:
            port_of(arm, "upper").rig.unplug(gone, port_of(arm, "upper").now())

        play = arm.play("bow", rate=50)
        with pytest.raises(BusError, match="elbow does not answer any more; all joints of the motion were stopped"):
            broken_at(play, 20, pull)
        standing(arm)


def test_a_servo_that_restarts_stops_all_joints_and_is_told() -> None:
    with opened() as arm, arm.torque():
        port = port_of(arm, "upper")
        again = servos_of(arm, "elbow")

        def restart() -> None:
            port.rig.unplug(again, port.now())
            port.rig.plug(again, port.now())

        # It hears nothing while it boots, so the silence may be noticed before the torque that is gone.
        with pytest.raises(
            (TorqueOff, BusError), match=r"elbow (has no torque any more: it restarted|does not answer)"
        ):
            broken_at(arm.play("bow", rate=50), 20, restart)
        standing(arm)


def test_a_joint_that_is_held_stops_all_joints() -> None:
    with opened() as arm, arm.torque():

        def hold() -> None:
            for servo in servos_of(arm, "grip"):
                servo.shaft.load = Load(blocked=True)

        with pytest.raises(Stopped, match=r"grip stays .* behind its goal"):
            broken_at(arm.play("bow", rate=50), 20, hold)
        standing(arm)


def test_a_port_that_goes_away_stops_the_joints_of_the_others() -> None:
    with opened() as arm:
        arm.torque_on()
        with pytest.raises(PortLost):
            broken_at(arm.play("bow", rate=50), 20, lambda: port_of(arm, "hand").inject("gone#1"))
        standing(arm)


def test_the_goal_speed_of_a_move_before_does_not_slow_the_motion_and_comes_back() -> None:
    with opened() as arm, arm.torque():
        servo = arm["base"].servo
        servo.write("goal_speed", 10 * deg)
        held = servos_of(arm, "base")[0]
        row = held.model.register("goal_speed")
        raw = held.memory[row]
        behind = max(abs(tick.goals["base"] - tick.positions["base"]) for tick in arm.play("bow", rate=50))
        assert behind < 8 * deg
        assert servos_of(arm, "base")[0].memory[row] == raw


def test_an_asynchronous_robot_plays_the_same() -> None:
    async def played() -> float:
        async with servobus.robot_async(read_text(LIVE)) as arm, arm.torque():
            await arm.play("nod", rate=50).wait()
            return await arm["base"].position()

    assert asyncio.run(played()) == pytest.approx(0.0, abs=1 * deg)


SAMPLES = "time,base,grip\n0.0000,0.000,10.000\n0.5000,20.000,5.500\n1.0000,0.000,10.000\n"


def test_samples_are_text_both_ways() -> None:
    motion = samples_of(SAMPLES, "wave.csv")
    assert motion.times == (0.0, 0.5, 1.0)
    assert motion.poses["grip"] == pytest.approx((10 * deg, 5.5 * deg, 10 * deg))
    assert samples_text(motion) == SAMPLES


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "wave.csv:1: the first line names the columns"),
        ("base,time\n", "wave.csv:1: the first line names the columns"),
        ("time,a,a\n0,1,1\n1,1,1\n", "wave.csv:1: a stands there twice"),
        ("time,a\n0,x\n", "wave.csv:2: could not convert string to float: 'x'"),
        ("time,a\n0,1\n0,2\n", "wave.csv:3: the time 0 s is not later"),
        ("time,a\n0,1,2\n", "wave.csv:2: write the time and 1 angles"),
        ("time,a\n0,nan\n", "wave.csv:2: write the time and 1 angles"),
        ("time,a\n0,1\n", "wave.csv: a motion has at least two moments"),
    ],
)
def test_wrong_samples_are_refused_with_their_line(text: str, said: str) -> None:
    with pytest.raises(servobus.UsageError) as refused:
        samples_of(text, "wave.csv")
    assert said in str(refused.value)


def test_a_motion_of_samples_stands_beside_the_robot_file(tmp_path: Path) -> None:
    folder = tmp_path
    (folder / "wave.csv").write_text(SAMPLES)
    (folder / "arm.toml").write_text(LIVE + '\n[motion.recorded]\nfile = "wave.csv"\npath = "pchip"\n')
    with servobus.robot(folder / "arm.toml") as arm:
        assert arm.play("recorded").duration == pytest.approx(1.0)
    with pytest.raises(servobus.UsageError, match=r"no\.csv: cannot be read"):
        read_samples(folder / "no.csv")


def test_speeds_come_back_although_the_beginning_fails_on_another_port() -> None:
    with opened() as arm:
        arm.torque_on()
        arm["base"].servo.write("goal_speed", 10 * deg)
        held = servos_of(arm, "base")[0]
        row = held.model.register("goal_speed")
        raw = held.memory[row]
        play = arm.play("nod", rate=50)
        turn = iter(play)
        next(turn)
        assert held.memory[row] == 0
        turn.close()
        assert held.memory[row] == raw
        again = arm.play("nod", rate=50)

        def gone() -> RobotJob[None]:
            yield from ()
            raise PortLost("gone")

        again._supervision.begin = gone  # type: ignore[method-assign] # the last that is done before the first goal
        with pytest.raises(PortLost):
            again.wait()
        assert servos_of(arm, "base")[0].memory[row] == raw
