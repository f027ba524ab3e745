"""A six-joint arm of three families on three ports: read, move, torque, stop, cycles, and what goes wrong."""

import asyncio
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import servobus
from servobus import BadValue, Bus, Disagreement, NoReply, RobotFileError, TorqueOff, UnknownName, UsageError, deg
from servobus.errors import MotionError, MoveTimeout, PortError, RobotMismatch, Stopped
from servobus.families import registry
from servobus.jobs.scan import ScanProgress
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_text
from servobus.robots.joints.attendance import Attendance, ids_to_ask
from servobus.robots.teleop import Teleop
from servobus.virtual.serve.inprocess import VirtualPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url
from unit.robots.arms import JOINTS, goals_in, opened, port_of, servos_of, shaft_angles
from unit.robots.arms import LIVE as SIX

STEP = 0.35 * deg
"""The coarsest step of a servo here, 300° / 1023 and 240° / 1000, and a little of noise."""
HOME: dict[str, float] = {"base": 0, "lift": 10, "elbow": 20, "turn": 0, "wrist": 0, "grip": 5}
OTHER: dict[str, float] = {"base": 40, "lift": -20, "elbow": 60, "turn": -30, "wrist": 45, "grip": 30}
"""Two poses, degrees."""


def rad(degrees: dict[str, float]) -> dict[str, float]:
    return {name: angle * deg for name, angle in degrees.items()}


@pytest.fixture
def arm() -> Iterator[Robot]:
    with opened(SIX) as arm:
        yield arm


@pytest.fixture
def stiff(arm: Robot) -> Robot:
    arm.torque_on()
    return arm


def pass_time(arm: Robot, seconds: float) -> None:
    for bus in arm.buses.values():
        bus.transport.sleep(seconds)


def unplug(arm: Robot, joint: str, n: int = 0) -> None:
    part = arm[joint].parts[n]
    port = port_of(arm, part.port)
    port.rig.unplug([servos_of(arm, joint)[n]], port.now())


def state(arm: Robot) -> dict[str, Any]:
    """Give what could have changed: torque and goals of all servos, and where their shafts are."""
    return {
        f"{joint.name} {n}": (
            servo.memory[servo.model.register("torque_enable")],
            servo.memory[servo.model.register("goal_position")],
            round(servo.shaft.position, 6),
        )
        for joint in arm
        for n, servo in enumerate(servos_of(arm, joint.name))
    }


# Names


def test_joints_have_names(arm: Robot) -> None:
    assert tuple(joint.name for joint in arm) == tuple(arm.joints) == JOINTS
    assert arm.elbow is arm["elbow"]
    assert len(arm) == 6
    assert "elbow" in arm
    assert arm.elbow in arm
    assert [joint.name for joint in arm.hand] == ["wrist", "grip"]
    assert {"elbow", "hand", "move"} <= set(dir(arm))
    assert arm.pose("open") == {"grip": pytest.approx(60 * deg)}


def test_names_that_are_none_are_told(arm: Robot) -> None:
    with pytest.raises(UnknownName, match="no joint 'elbo'; there are base, lift"):
        arm["elbo"]
    with pytest.raises(AttributeError, match="no joint 'elbo'; there are base"):
        arm.elbo  # noqa: B018
    with pytest.raises(UnknownName, match="no pose 'hom'; there are home, open"):
        arm.pose("hom")
    with pytest.raises(UnknownName, match="no joint 'elbo'"):
        arm.move(elbo=3)


def test_nothing_is_kept_that_is_no_attribute(arm: Robot) -> None:
    with pytest.raises(AttributeError, match=r"to move a joint: move\(elbow=20 \* deg\)"):
        arm.elbow = 3  # type: ignore[attr-defined] # that is what is tested
    with pytest.raises(AttributeError, match="goal cannot be set"):
        arm.hand.goal = 3


# Reading


def test_opening_and_reading_change_nothing(arm: Robot) -> None:
    before = state(arm)
    arm.positions()
    arm.look()
    arm.check()
    arm.protect()
    arm.plan_limits()
    arm.elbow.position()
    assert state(arm) == before
    assert all(torque == 0 for torque, _, _ in before.values())


def test_angles_are_those_of_the_joints(arm: Robot) -> None:
    for joint, servos in ((joint, servos_of(arm, joint.name)) for joint in arm):
        for n, servo in enumerate(servos):
            entry = joint.entry.servos[n].axis
            servo.shaft.position = entry.zero + entry.direction * entry.ratio * (10 + n) * deg
    seen = arm.positions()
    assert {name: pytest.approx(10 * deg, abs=STEP) for name in JOINTS if name != "lift"} | {
        "lift": pytest.approx(10.5 * deg, abs=STEP)
    } == dict(seen)
    assert arm.elbow.position() == pytest.approx(10 * deg, abs=STEP)
    assert arm.elbow.look().position == pytest.approx(10 * deg, abs=STEP)
    assert arm.look()["lift"].disagreement == pytest.approx(1 * deg, abs=2 * STEP)
    assert not seen.lost


def test_numpy_arrays_in_and_out(stiff: Robot) -> None:
    goals = np.array([HOME[name] for name in JOINTS]) * deg
    stiff.move(goals, time=2.0).wait()
    assert np.asarray(stiff.positions()) == pytest.approx(goals, abs=1 * deg)
    seen = stiff.cycle().run(np.asarray(stiff.positions()))
    assert np.asarray(seen.positions).shape == (6,)
    with pytest.raises(BadValue, match="3 angles for 6 joints: give one for each of base, lift"):
        stiff.move(np.zeros(3))


# Moving


def test_nothing_moves_without_torque(arm: Robot) -> None:
    before = state(arm)
    with pytest.raises(TorqueOff, match="elbow, grip: torque is off"):
        arm.move(elbow=0.2, grip=0.2)
    assert state(arm) == before


def test_a_move_brings_all_joints_to_their_goals(stiff: Robot) -> None:
    for pose in (HOME, OTHER):
        stiff.move(rad(pose), time=2.0).wait()
        for name, angle in pose.items():
            assert shaft_angles(stiff, name) == pytest.approx([angle * deg] * len(stiff[name].parts), abs=1 * deg)
            assert goals_in(stiff, name) == pytest.approx([angle * deg] * len(stiff[name].parts), abs=STEP)


def test_all_start_and_arrive_together(stiff: Robot) -> None:
    stiff.move(rad(HOME), time=2.0).wait()
    began = {name: shaft_angles(stiff, name)[0] for name in JOINTS}
    move = stiff.move(rad(OTHER), time=2.0)
    assert move.duration == 2.0
    shares = []
    for _ in range(9):
        pass_time(stiff, 0.2)
        shares.append(
            {name: (shaft_angles(stiff, name)[0] - began[name]) / (OTHER[name] * deg - began[name]) for name in JOINTS}
        )
    move.wait()
    for n, at in enumerate(shares, 1):
        # A LewanSoul and a Dynamixel servo keep a speed, a HerkuleX servo has a trapezoid: they part by a tenth.
        assert at == {name: pytest.approx(n / 10, abs=0.13) for name in JOINTS}, n


def test_a_move_without_a_time_keeps_the_speed_of_each_joint(stiff: Robot) -> None:
    stiff.move(rad(HOME), time=2.0).wait()
    # With limits of acceleration and jerk a way d takes d / V + V / A + A / J.
    assert stiff.plan_move(lift=70 * deg).duration == pytest.approx(60 / 90 + 90 / 400 + 400 / 8000, rel=0.05)
    assert stiff.plan_move(base=80 * deg, lift=11 * deg).duration == pytest.approx(80 / 90, rel=0.05)
    assert stiff.plan_move(base=80 * deg, speed=300 * deg).duration == pytest.approx(80 / 120, rel=0.05)
    with pytest.raises(BadValue, match=r"base: .* is faster than its 120\.0°/s; give it 6"):
        stiff.move(base=80 * deg, time=0.3)
    with pytest.raises(BadValue, match="either a time or a speed"):
        stiff.move(base=0, time=1, speed=1)
    with pytest.raises(UsageError, match="a move of no joints"):
        stiff.move()


def test_a_move_has_time_for_the_acceleration_of_each_joint() -> None:
    text = SIX.replace("# acceleration", "acceleration").replace(
        'limits = ["-70deg", "100deg"]', 'limits = ["-70deg", "100deg"]\nacceleration = "100deg/s2"\njerk = "400deg/s3"'
    )
    with servobus.robot(read_text(text)) as arm:
        start = arm.base.position()
        # From rest to rest a way d takes d / V + V / A, and 2 √(d / A) where V is not reached.
        assert arm.plan_move(base=start + 80 * deg).duration == pytest.approx(80 / 120 + 120 / 400, rel=0.02)
        assert arm.plan_move(base=start + 9 * deg, speed=300 * deg).duration == pytest.approx(2 * 0.15, rel=0.05)
        # With jerk, where A is not reached: 4 ∛(d / 2J).
        way = arm.wrist.position() + 4 * deg
        assert arm.plan_move(wrist=way, speed=300 * deg).duration == pytest.approx(4 * (4 / 800) ** (1 / 3), rel=0.05)
        with pytest.raises(BadValue, match=r"base: 80.* in 900 ms is faster than its 400\.0°/s²; give it 967"):
            arm.plan_move(base=start + 80 * deg, time=0.9)
        with pytest.raises(BadValue, match=r"base: 80.* is faster than its 120\.0°/s; give it"):
            arm.plan_move(base=start + 80 * deg, time=0.5)


@pytest.mark.parametrize(
    ("joint", "degrees", "told"),
    [
        ("base", 121, r"base: 121\.0° is outside its limits, -120\.0° \.\. 120\.0°"),
        ("lift", -61, "lift: -61"),
        ("elbow", -66, "elbow: -66"),
        ("wrist", 101, "wrist: 101"),
        ("grip", -1, "grip: -1"),
        ("turn", 81, "turn: 81"),
    ],
)
def test_limits_hold_and_nothing_is_sent(stiff: Robot, joint: str, degrees: float, told: str) -> None:
    before = state(stiff)
    cycle = stiff.cycle()
    for attempt in (
        lambda: stiff.move({joint: degrees * deg, "base": 0.1} if joint != "base" else {joint: degrees * deg}),
        lambda: stiff[joint].move(degrees * deg),
        lambda: cycle.run({joint: degrees * deg}),
    ):
        with pytest.raises(BadValue, match=told):
            attempt()
    assert state(stiff) == before


def test_degrees_for_radians_are_suspected(stiff: Robot) -> None:
    with pytest.raises(BadValue, match=r"did you mean 90 \* deg\?"):
        stiff.move(base=90)


@pytest.mark.parametrize("value", [math.nan, math.inf, "90", None, True])
def test_what_is_no_angle_is_refused(stiff: Robot, value: Any) -> None:
    before = state(stiff)
    with pytest.raises(BadValue, match="base"):
        stiff.move(base=value)
    assert state(stiff) == before


ARMS: list[Robot] = []


@settings(max_examples=20)
@given(st.dictionaries(st.sampled_from(JOINTS), st.floats(-2, 2), min_size=1))
def test_goals_on_the_wire_are_inside_the_limits_of_joint_and_servo(goals: dict[str, float]) -> None:
    """Whatever is asked for: all goals are sent as they are, or none is."""
    if not ARMS:
        ARMS.append(servobus.robot(read_text(SIX)))
        ARMS[0].torque_on()
    arm = ARMS[0]
    before = state(arm)
    inside = all(arm[name].limits[0] - 2e-6 <= angle <= arm[name].limits[1] + 2e-6 for name, angle in goals.items())
    try:
        arm.cycle(time=1.5).run(goals)
    except BadValue:
        assert not inside
        assert {name: goal for name, (_, goal, _) in state(arm).items()} == {
            name: goal for name, (_, goal, _) in before.items()
        }
        return
    assert inside
    pass_time(arm, 2.0)
    for name, angle in goals.items():
        low, high = arm[name].limits
        for servo, got in zip(servos_of(arm, name), shaft_angles(arm, name), strict=True):
            assert got == pytest.approx(angle, abs=1.5 * deg)
            assert low - 0.5 * deg <= got <= high + 0.5 * deg
            row = servo.model.register("goal_position")
            assert row.limits[0] <= servo.memory[row] <= row.limits[1]


# Torque and stop


def test_torque_of_all_and_of_a_group(arm: Robot) -> None:
    arm.hand.torque_on()
    assert {name: state.torque for name, state in arm.look().items()} == {
        name: name in ("wrist", "grip") for name in JOINTS
    }
    with arm.torque():
        assert all(seen.torque for seen in arm.look().values())
    assert {name: state.torque for name, state in arm.look().items()} == {
        name: name in ("wrist", "grip") for name in JOINTS
    }
    arm.torque_off()
    assert not any(seen.torque for seen in arm.look().values())


def test_of_a_pair_both_get_torque_or_none(arm: Robot) -> None:
    arm.lift.position()
    unplug(arm, "lift", 1)
    with pytest.raises(NoReply, match="id 3"):
        arm.lift.torque_on()
    first = servos_of(arm, "lift")[0]
    assert first.memory[first.model.register("torque_enable")] == 0


def test_stop_ends_a_move_of_all(stiff: Robot) -> None:
    stiff.move(rad(HOME), time=2.0).wait()
    stiff.move(rad(OTHER), time=3.0)
    pass_time(stiff, 1.0)
    stiff.stop()
    here = {name: shaft_angles(stiff, name) for name in JOINTS}
    pass_time(stiff, 3.0)
    for name in JOINTS:
        assert shaft_angles(stiff, name) == pytest.approx(here[name], abs=4 * deg), name
        assert abs(here[name][0] - OTHER[name] * deg) > 5 * deg


def test_cancel_ends_a_move(stiff: Robot) -> None:
    move = stiff.move(base=60 * deg, grip=60 * deg, time=3.0)
    pass_time(stiff, 0.5)
    assert not move.done
    move.cancel()
    assert move.done


def test_a_joint_that_is_lost_on_the_way_is_told(stiff: Robot) -> None:
    """The servos run a move by themselves; whether they have arrived is asked when they should have."""
    stiff.move(rad(HOME), time=2.0).wait()
    move = stiff.move(rad(OTHER), time=2.0)
    pass_time(stiff, 0.3)
    unplug(stiff, "elbow")
    with pytest.raises(NoReply, match=r"^elbow: .*id 1"):
        move.wait()


def test_errors_speak_of_joints_and_their_angles(stiff: Robot) -> None:
    """Each port may have a servo with id 1, and its angle is not that of the joint."""
    stiff.move(rad(HOME), time=2.0).wait()
    move = stiff.move(base=60 * deg, time=2.0)
    pass_time(stiff, 0.5)
    stiff.base.stop()
    with pytest.raises(Stopped, match=r"^base is at [0-9.]+° and goes to 60\.\d° no more"):
        move.wait()
    block(stiff, "elbow", 0)
    move = stiff.move(elbow=-20 * deg, time=1.0)
    with pytest.raises(MoveTimeout, match=r"^elbow is at 20\.\d° and did not reach -20\.\d°"):
        move.wait()
    unplug(stiff, "wrist")
    for ask in (stiff.wrist.position, stiff.wrist.look, stiff.torque_off, lambda: stiff.move(wrist=0.1)):
        with pytest.raises(NoReply, match=r"^wrist: .*id 1"):
            ask()
    assert repr(stiff.positions()).endswith("'wrist': lost}")


def test_a_robot_that_was_closed_says_so() -> None:
    with opened(SIX) as arm:
        cycle, play = arm.cycle(), arm.play("wave")
    for ask in (arm.positions, arm.look, arm.check, arm.stop, arm.base.position, cycle.run, play.wait):
        with pytest.raises(PortError, match="this robot is closed; open it anew"):
            ask()


# Two servos on one axis


def test_a_pair_stays_together(stiff: Robot) -> None:
    stiff.move(lift=0, time=2.0).wait()
    for goal in (60 * deg, -50 * deg, 10 * deg):
        move = stiff.lift.move(goal, time=1.5)
        for _ in range(15):
            pass_time(stiff, 0.1)
            one, other = shaft_angles(stiff, "lift")
            assert abs(one - other) < 1.5 * deg
        move.wait()
    cycle = stiff.cycle()
    for n in range(100):
        cycle.run(lift=20 * deg * math.sin(n / 10))
        one, other = shaft_angles(stiff, "lift")
        assert abs(one - other) < 1.5 * deg


def test_a_pair_that_disagrees_is_not_driven(arm: Robot) -> None:
    servos_of(arm, "lift")[1].shaft.position += 5 * deg
    before = {who: (torque, shaft) for who, (torque, _, shaft) in state(arm).items()}
    attempts: list[Callable[[], object]] = [arm.torque_on, arm.positions, arm.lift.torque_on, lambda: arm.move(lift=0)]
    for attempt in attempts:
        with pytest.raises(Disagreement, match=r"lift: RX-28 id 2 at .* and RX-28 id 3 at .* apart, where 4\.0°"):
            attempt()
    assert {who: (torque, shaft) for who, (torque, _, shaft) in state(arm).items()} == before


def block(arm: Robot, joint: str, n: int) -> None:
    """Hold the shaft of a servo as in a vice."""
    shaft = servos_of(arm, joint)[n].shaft
    shaft.load = replace(shaft.load, blocked=1.0)


def test_a_pair_that_comes_to_disagree_is_stopped_by_protect(stiff: Robot) -> None:
    stiff.move(rad(HOME), time=2.0).wait()
    assert all(level == 0 for level in stiff.protect().values())
    block(stiff, "lift", 1)
    stiff.lift.move(60 * deg, time=3.0)
    pass_time(stiff, 0.5)
    with pytest.raises(Disagreement, match="lift"):
        stiff.protect()
    pass_time(stiff, 3.0)
    assert shaft_angles(stiff, "lift")[0] < 40 * deg


def test_a_pair_that_comes_to_disagree_stops_the_move(stiff: Robot) -> None:
    stiff.move(rad(HOME), time=2.0).wait()
    block(stiff, "lift", 1)
    with pytest.raises(Disagreement, match="lift"):
        stiff.move(lift=60 * deg, base=60 * deg, time=3.0).wait()
    pass_time(stiff, 3.0)
    assert shaft_angles(stiff, "lift")[0] < 30 * deg
    assert shaft_angles(stiff, "base")[0] < 30 * deg


# Cycles


def test_a_cycle_sends_and_reads_all(stiff: Robot) -> None:
    stiff.move(rad(HOME), time=2.0).wait()
    cycle = stiff.cycle(["present_position", "present_temperature"])
    for tick in cycle.every(0.02):
        seen = cycle.run(base=10 * deg, grip=20 * deg)
        if tick.time > 1:
            break
    assert seen["base"]["present_position"] == pytest.approx(10 * deg, abs=1 * deg)
    assert seen.positions["grip"] == pytest.approx(20 * deg, abs=1 * deg)
    assert seen["elbow"]["present_temperature"] > 10
    assert set(seen.times) == {"base", "upper", "hand"}
    assert max(seen.times.values()) - min(seen.times.values()) < 0.02
    assert not seen.lost
    assert seen.diagnosis == ""


def test_lost_joints_are_named_and_the_others_go_on(stiff: Robot) -> None:
    unplug(stiff, "wrist")
    unplug(stiff, "lift", 1)
    cycle = stiff.cycle()
    seen = cycle.run(base=5 * deg, lift=0, wrist=0)
    assert set(seen.lost) == {"wrist", "lift"}
    assert list(seen) == ["base", "elbow", "turn", "grip"]
    with pytest.raises(NoReply):
        seen["wrist"]
    read = stiff.positions()
    assert set(read.lost) == {"wrist", "lift"}
    assert np.isnan(np.asarray(read)).sum() == 2
    assert "port hand" in seen.diagnosis


# Who is there

TWO = """\
[robot]
format = 1
[port.main]
path = "virtual:rx28@1,ax12a@2?baud=57600&clock=virtual"
[joint.one]
port = "main"
model = "rx28"
id = 1
[joint.two]
port = "main"
model = "ax12a"
id = 2
baud = 57600
"""


def findings(text: str) -> list[tuple[str, str, str]]:
    with servobus.robot(read_text(text), incomplete=True) as arm:
        return [(one.kind, one.joint, one.port) for one in arm.check().findings]


@pytest.mark.parametrize(
    ("text", "good", "bad", "found"),
    [
        (SIX, "rx28@1-3", "rx28@1-3", []),
        (SIX, "rx28@1-3", "rx28@1-2", [("missing", "lift", "base")]),
        (SIX, "drs0602@1-2", "drs0602@2", [("missing", "elbow", "upper")]),
        (SIX, "rx28@1-3", "rx28@1-3,7", [("stranger", "", "base")]),
        (SIX, "rx28@1-3", "rx28@1-3,200", [("stranger", "", "base")]),
        (SIX, "rx28@1-3", "rx28@1-3,rx28@7,model_number=1060", [("stranger", "", "base")]),
        (SIX, "rx28@1-3", "ax12a@1,rx28@2-3", [("missing", "base", "base")]),
        (TWO, "rx28@1,ax12a@2", "rx28@1,ax12a@2", []),
        (TWO, "rx28@1,ax12a@2", "mx28@1,ax12a@2", [("wrong model", "one", "main")]),
        (TWO, "rx28@1,ax12a@2", "ax12a@1,rx28@2", [("swapped", "one", "main"), ("swapped", "two", "main")]),
    ],
)
def test_who_is_there_is_compared_with_the_file(
    text: str, good: str, bad: str, found: list[tuple[str, str, str]]
) -> None:
    text = text.replace(good, bad)
    assert findings(text) == found
    if any(kind != "stranger" for kind, _, _ in found):
        with pytest.raises(RobotMismatch, match=found[0][1]):
            servobus.robot(read_text(text))
    else:
        servobus.robot(read_text(text)).close()


@pytest.mark.parametrize("bad", ["mx28@1,ax12a@2", "ax12a@1,rx28@2"])
def test_a_joint_that_another_servo_answers_for_is_neither_read_nor_driven(bad: str) -> None:
    """An MX-28 tells 4096 steps a turn, so its angles would be wrong by a factor of three."""
    with servobus.robot(read_text(TWO.replace("rx28@1,ax12a@2", bad)), incomplete=True) as arm:
        port = arm.buses["main"].transport
        assert isinstance(port, VirtualPort)
        shafts = [servo.shaft.position for servo in port.servos]
        assert "one" in arm.positions().lost
        assert "one" in arm.look().lost
        cycle = arm.cycle()
        assert "one" in cycle.run().lost
        attempts: list[Callable[[], object]] = [
            arm.torque_on,
            arm.one.torque_on,
            lambda: arm.torque().__enter__(),
            lambda: arm.move(one=0.1),
            lambda: arm.one.move(0.1),
            lambda: cycle.run(one=0.1),
            lambda: arm.follow("one").wait(),
            lambda: arm.teach().wait(),
            arm.one.position,
        ]
        for attempt in attempts:
            with pytest.raises(RobotMismatch, match=r"one: id 1 on port main is .*; until then it is neither read nor"):
                attempt()
        assert not any(servo.torque for servo in port.servos)
        assert [servo.shaft.position for servo in port.servos] == shafts
        arm.stop()
        arm.torque_off()


def test_who_is_put_right_can_be_used_after_a_new_comparison() -> None:
    with servobus.robot(read_text(TWO.replace("rx28@1,ax12a@2", "ax12a@1,rx28@2")), incomplete=True) as arm:
        assert arm.one.mistaken
        arm.attendance = Attendance("arm", ())
        assert not arm.one.mistaken
        assert not arm.positions().lost


def test_a_pair_of_which_one_servo_is_driven_is_neither_driven_nor_limp(arm: Robot) -> None:
    arm.lift.torque_on()
    assert (arm.lift.look().torque, arm.lift.look().limp) == (True, False)
    arm.lift.parts[1].servo.torque_off()
    state = arm.lift.look()
    assert (state.torque, state.limp, state.half) == (False, False, True)
    assert "torque on of one servo alone" in str(state)
    teach = arm.teach()  # nobody can move it by hand
    next(iter(teach))
    assert arm.lift not in teach.joints
    with pytest.raises(TorqueOff, match="lift: torque is off"):
        arm.move(lift=0.1)
    with pytest.raises(MotionError, match="lift: the torque of the leader is on"):
        Teleop(arm, arm, {"wrist": "lift"}).wait()
    arm.lift.torque_off()
    assert arm.lift.look().limp


@pytest.mark.parametrize(
    ("text", "good", "bad", "told"),
    [
        (SIX, "rx28@1-3", "rx28@1-3,9", "RX-28 id 9 at 57600"),
        (SIX, "lx16a@1-2", "lx16a@1-2,10", "id 10 at 115200"),
        (SIX, "rx28@1-3", "rx28@1-3,200", ""),  # `check` finds it
        # New servos come at 57600 baud (RX-28) and 1 Mbit/s (AX-12A) with id 1, by their manuals.
        (TWO, "rx28@1,ax12a@2?baud=57600", "rx28@1,ax12a@2,ax12a@1?baud=57600", ""),
    ],
)
def test_opening_finds_strangers_where_most_are(text: str, good: str, bad: str, told: str) -> None:
    with servobus.robot(read_text(text.replace(good, bad)), incomplete=True) as arm:
        strangers = [one.text for one in arm.attendance.findings if one.kind == "stranger"]
        assert all(told in one for one in strangers)
        assert len(strangers) == bool(told)
        assert arm.ports.now() < 0.5


def test_a_new_servo_is_found_at_the_speed_that_it_comes_with() -> None:
    rig = build_rig(parse_url("virtual:rx28@2,rx28@1?clock=virtual"))
    text = TWO.replace("id = 1", "id = 2\nbaud = 1000000").partition("[joint.two]")[0]
    port = VirtualPort("main", rig, real=False)
    with Bus(port, echo=False) as bus:
        bus.find(2).change_baud(1_000_000)
        arm = Robot(read_text(text), {"main": bus})
        found = arm.check(strangers="near").findings
    assert [one.text.partition(" is in no joint")[0] for one in found] == [
        "a stranger on port main: RX-28 id 1 at 57600 baud"
    ]


def test_strangers_are_looked_for_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ids_to_ask(["main"], [], "everywhere")
    assert asked == 254 * sum(len(registry.bauds(family)) for family in registry.FAMILIES.values())
    monkeypatch.setattr(registry, "bauds", lambda family: registry.factory_bauds(family)[:1])  # as many as a test needs
    watched: list[ScanProgress] = []
    text = TWO.replace("ax12a@2?", "ax12a@2,drs0602@100?").replace("?baud=57600&", "?").replace("baud = 57600", "")
    with servobus.robot(read_text(text), incomplete=True) as arm:
        assert arm.attendance
        found = arm.check(strangers="everywhere", watch=watched.append)
        assert len(watched) == ids_to_ask(arm.buses, arm, "everywhere") == 254 * 4
    assert [one.text.partition(" is in no joint")[0] for one in found.findings] == [
        "a stranger on port main: DRS-0602 id 100 at 115200 baud"
    ]


def test_an_open_robot_tells_who_went(arm: Robot) -> None:
    unplug(arm, "grip")
    found = arm.check()
    assert [(one.kind, one.joint) for one in found.findings] == [("missing", "grip")]
    assert "grip is missing: LX-16A id 2" in str(found)
    assert arm.attendance is found


def test_a_port_that_is_not_there_is_named() -> None:
    text = SIX.replace("virtual:lx16a@1-2?clock=virtual", "/dev/there-is-none")
    with pytest.raises(PortError, match=r"port hand: .*there-is-none"):
        servobus.robot(read_text(text))


def test_a_robot_that_may_be_incomplete_opens_without_a_port() -> None:
    text = SIX.replace("?clock=virtual", "").replace("virtual:lx16a@1-2", "/dev/there-is-none")
    with servobus.robot(read_text(text), incomplete=True) as arm:
        assert [(finding.kind, finding.port) for finding in arm.attendance.grave] == [("port", "hand")]
        assert set(arm.attendance.unusable(arm)) == {"wrist", "grip"}
        seen = arm.positions()
        assert (list(seen), list(seen.lost)) == ([*JOINTS[:4]], ["wrist", "grip"])
        with pytest.raises(PortError, match=r"^wrist: /dev/there-is-none: no such port"):
            arm.wrist.position()
    for port in ("virtual:rx28@1-3", "virtual:drs0602@1-2"):
        text = text.replace(port, "/dev/nor-is-this")
    with pytest.raises(PortError, match=r"port base: /dev/nor-is-this"):
        servobus.robot(read_text(text), incomplete=True)


def test_a_file_without_joints_is_no_robot() -> None:
    with pytest.raises(RobotFileError, match="there is no joint"):
        servobus.robot(read_text("[robot]\nformat = 1\n"))
    with pytest.raises(RobotFileError, match="there is no joint"):
        servobus.robot_async(read_text("[robot]\nformat = 1\n"))


def test_both_clocks_in_one_robot_are_refused() -> None:
    text = SIX.replace("virtual:lx16a@1-2?clock=virtual", "virtual:lx16a@1-2")
    with pytest.raises(UsageError, match="virtual clock and on the real one"):
        servobus.robot(read_text(text))


def test_a_safe_action_that_a_servo_cannot_do_is_refused() -> None:
    text = SIX.replace('zero = "150deg"\n', 'zero = "150deg"\nsafe_action = "brake"\n')
    with pytest.raises(UsageError, match="base: "):
        servobus.robot(read_text(text))


# Protection

PROTECTED = SIX + '\n[joint.base.protect]\nwarn = "70degC"\nderate = "0degC"\n\n[joint.lift.protect]\nstall = "200ms"\n'


def test_each_joint_has_its_own_thresholds() -> None:
    with opened(PROTECTED) as arm:
        levels = arm.protect()
        assert {name: int(level) for name, level in levels.items()} == {name: int(name == "base") for name in JOINTS}
        unplug(arm, "wrist")
        assert set(arm.protect().lost) == {"wrist"}


def test_thresholds_that_make_no_sense_are_refused() -> None:
    with pytest.raises(RobotFileError, match=r"\[joint\.base\.protect\].*push a share"):
        read_text(SIX + '\n[joint.base.protect]\npush = "150%"\n')


def test_a_pair_is_made_safe_together() -> None:
    """One servo of the pair pushes without moving; the other pushes too little for its own threshold."""
    text = PROTECTED.replace('disagreement = "4deg"', 'disagreement = "40deg"')
    with opened(text) as arm:
        arm.torque_on()
        block(arm, "lift", 0)
        move = arm.lift.move(60 * deg, time=5.0)
        for _ in range(40):
            pass_time(arm, 0.05)
            if (level := arm.protect()["lift"]) == 3:
                break
        assert level == 3
        second = shaft_angles(arm, "lift")[1]
        pass_time(arm, 4.0)
        assert shaft_angles(arm, "lift")[1] == pytest.approx(second, abs=3 * deg)
        assert second < 40 * deg
        with pytest.raises(servobus.Stopped):
            arm.lift.move(0)
        move.cancel()


def test_the_watchdog_guards_every_port(arm: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[float, str | None]] = []
    for bus in arm.buses.values():
        monkeypatch.setattr(type(bus), "watch", lambda _, timeout, action: told.append((timeout, action)))
    arm.watch(0.2, "free")
    assert told == [(0.2, "free")] * 3


def test_made_safe(stiff: Robot) -> None:
    stiff.move(rad(HOME), time=2.0).wait()
    stiff.move(rad(OTHER), time=3.0)
    pass_time(stiff, 0.5)
    stiff.make_safe("free")
    assert not any(seen.torque for seen in stiff.look().values())


# The same for asyncio


def test_the_asynchronous_robot() -> None:
    async def run() -> None:
        async with servobus.robot_async(read_text(SIX)) as arm:
            assert [joint.name for joint in arm.hand] == ["wrist", "grip"]
            with pytest.raises(TorqueOff):
                await arm.move(base=0.1)
            async with arm.torque():
                move = await arm.move(rad(HOME), time=2.0)
                await move.wait()
                seen = await arm.positions()
                assert dict(seen) == {name: pytest.approx(HOME[name] * deg, abs=1 * deg) for name in JOINTS}
                result = await arm.cycle().run(grip=10 * deg)
                assert set(result.times) == {"base", "upper", "hand"}
                assert all(level == 0 for level in (await arm.protect()).values())
                await arm.stop()
            assert not (await arm.grip.look()).torque
            assert await arm.check()
            with pytest.raises(BadValue):
                await arm.grip.move(-1)
            with pytest.raises(UnknownName):
                await arm.move(elbo=1)

    asyncio.run(run())


def test_the_asynchronous_robot_compares_as_it_opens() -> None:
    async def run() -> None:
        async with servobus.robot_async(read_text(SIX.replace("rx28@1-3", "rx28@1-2"))):
            pass

    with pytest.raises(RobotMismatch, match="lift"):
        asyncio.run(run())
