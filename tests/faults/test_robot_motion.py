"""What goes wrong under a robot in motion, by what it is doing: nothing moves afterwards, and the joint is named.

What must happen stands as a table in docs/motion.md. Time is virtual.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import pairwise
from typing import Any

import pytest

import servobus
from servobus import BadValue, ServobusError, Stopped, TorqueOff, deg
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_text
from servobus.robots.motions.leading import Phase
from servobus.robots.motions.motion import Motion
from servobus.robots.teleop import Teleop
from servobus.virtual.physics.motor import Load
from unit.robots.arms import goals_in, port_of, servos_of, shaft_angles

ROBOT = """
[robot]
format = 1
[port.left]
path = "virtual:rx28@1-2?clock=virtual"
[port.right]
path = "virtual:drs0602@1?clock=virtual"
[joint.base]
port = "left"
model = "rx28"
id = 1
zero = "150deg"
limits = ["-100deg", "100deg"]
[joint.lift]
port = "left"
model = "rx28"
id = 2
zero = "150deg"
limits = ["-100deg", "100deg"]
[joint.grip]
port = "right"
model = "drs0602"
id = 1
[motion.swing]
steps = [
  { joints = { base = "0deg", lift = "0deg", grip = "0deg" }, time = "0s" },
  { joints = { base = "60deg", lift = "-60deg", grip = "40deg" }, time = "3s" },
]
"""
AT = 45
"""Turn in which it happens."""

Fault = Callable[[Robot], None]


def cable(robot: Robot) -> None:
    """The cable of a servo comes off."""
    port = port_of(robot, "right")
    port.rig.unplug(port.servos, port.now())


def port(robot: Robot) -> None:
    """The adapter is pulled out."""
    port_of(robot, "right").inject("gone#1")


def restart(robot: Robot) -> None:
    """A servo loses its supply for a moment."""
    there = port_of(robot, "right")
    there.rig.unplug(there.servos, there.now())
    there.rig.plug(there.servos, there.now())


def swap(robot: Robot) -> None:
    """Somebody exchanges two servos, or their ids."""
    there = port_of(robot, "left")
    one, other = there.servos
    there.rig.unplug([one, other], there.now())
    row = one.model.register("id")
    one.memory.store(row, 2)
    other.memory.store(row, 1)
    there.rig.plug([one, other], there.now())


def stall(robot: Robot) -> None:
    """Something holds a joint."""
    for servo in servos_of(robot, "lift"):
        servo.shaft.load = Load(blocked=True)


FAULTS = [cable, port, restart, swap, stall]


def named(fault: Any) -> str:
    return str(fault.__name__)


@pytest.fixture
def arm() -> Iterator[Robot]:
    with servobus.robot(read_text(ROBOT)) as arm:
        arm.torque_on()
        yield arm


def stands(robot: Robot) -> None:
    """Make sure that nothing moves any more, and that no goal lies elsewhere than where the joints are."""
    for joint in robot:
        for servo in servos_of(robot, joint.name):
            servo.shaft.load = Load()  # what held a joint lets go of it
    robot.ports.align(robot.ports.now() + 0.5)
    before = [shaft_angles(robot, joint.name) for joint in robot]
    robot.ports.align(robot.ports.now() + 1.0)
    for joint, angles in zip(robot, before, strict=True):
        assert shaft_angles(robot, joint.name) == pytest.approx(angles, abs=0.5 * deg)


SAID = {
    "cable": "grip does not answer any more; all joints of the motion were stopped",
    "port": "gone",
    "restart": "grip (does not answer any more|has no torque any more)",
    "swap": "(base|lift) was seen at .* and at once at",
    "stall": "lift stays .* behind its goal",
}


@pytest.mark.parametrize("fault", FAULTS, ids=named)
def test_play(arm: Robot, fault: Fault) -> None:
    with pytest.raises(ServobusError, match=SAID[fault.__name__]):
        for n, _ in enumerate(arm.play("swing", rate=25)):
            if n == AT:
                fault(arm)
            assert n < AT + 60
    assert abs(goals_in(arm, "base")[0]) < 59 * deg, "it did not go on"
    stands(arm)


@pytest.mark.parametrize("fault", FAULTS, ids=named)
def test_follow(arm: Robot, fault: Fault) -> None:
    follow = arm.follow(rate=25)
    follow.aim(base=100 * deg, lift=-100 * deg, grip=100 * deg)
    with pytest.raises(ServobusError, match=SAID[fault.__name__]):
        for n, _ in enumerate(follow):
            if n == 10:
                fault(arm)
            assert n < AT + 60
    stands(arm)


@pytest.fixture
def leader() -> Iterator[Robot]:
    with servobus.robot(read_text(ROBOT)) as leader:
        yield leader


def lead(leader: Robot, turn: int) -> None:
    """Move the leader by hand."""
    for joint, direction in (("base", 1), ("lift", -1), ("grip", 1)):
        (part,), (servo,) = leader[joint].parts, servos_of(leader, joint)
        if not servo.shaft.load.blocked:
            servo.turn_shaft(part.axis.to_servo(direction * min(turn, 40) * deg))


@pytest.mark.parametrize("fault", FAULTS, ids=named)
def test_teleop_of_a_follower(arm: Robot, leader: Robot, fault: Fault) -> None:
    with pytest.raises(ServobusError, match=SAID[fault.__name__]):
        for n, _ in enumerate(Teleop(leader, arm, rate=25)):
            lead(leader, n)
            if n == (10 if fault is stall else AT):
                fault(arm)
            assert n < AT + 60
    stands(arm)


HOLDS = {
    "cable": (Phase.HOLDING, "the leader does not answer: grip"),
    "port": (Phase.HOLDING, "the leader does not answer: grip"),
    "restart": (Phase.FOLLOWING, ""),
    "swap": (Phase.HOLDING, "too far apart to start: base by 8"),
    "stall": (Phase.FOLLOWING, ""),
}


@pytest.mark.parametrize("fault", FAULTS, ids=named)
def test_teleop_by_a_leader(arm: Robot, leader: Robot, fault: Fault) -> None:
    fastest, before = 0.0, 0.0
    teleop = Teleop(leader, arm, rate=25)
    for n, tick in enumerate(teleop):
        lead(leader, n) if n <= 45 else None
        if n == 46:
            fault(leader)
        if n > 46:
            here = tick.result.positions["base"]
            fastest = max(fastest, abs(here - before) * 25)
        before = tick.result.positions["base"]
        if n == 90:
            assert (tick.phase, tick.why[: len(HOLDS[fault.__name__][1])]) == HOLDS[fault.__name__]
            teleop.stop()
    assert fastest < 60 * deg
    assert arm["base"].position() == pytest.approx(40 * deg, abs=4 * deg)
    stands(arm)


@pytest.mark.parametrize("fault", FAULTS, ids=named)
def test_teach(leader: Robot, fault: Fault) -> None:
    teach = leader.teach(rate=25)
    with ExitStack() as stack:
        if fault in (cable, port):
            said = "grip does not answer any more, so the recording has ended" if fault is cable else "gone"
            stack.enter_context(pytest.raises(ServobusError, match=said))
        for n, _ in enumerate(teach):
            lead(leader, n)
            if n == AT:
                fault(leader)
            if n == AT + 10 and fault not in (cable, port):
                teach.stop()
    found = teach.kept()
    assert found.motion.times[-1] >= (AT - 1) / 25
    told = " ".join(found.notes)
    assert {"restart": "did not answer", "swap": "jumped at", "cable": "left out"}.get(fault.__name__, "") in told
    stands(leader)


def pull(robot: Robot, joint: str) -> None:
    """Let the supply of a joint's servos fail for a moment, so short that nobody hears them miss a reply."""
    for part, servo in zip(robot[joint].parts, servos_of(robot, joint), strict=True):
        there = port_of(robot, part.port)
        there.rig.unplug([servo], there.now())
        there.rig.plug([servo], there.now())


def test_a_joint_that_was_silent_catches_up_no_faster_than_its_limit(arm: Robot) -> None:
    play = arm.play("swing", rate=25)
    goals = []
    for n, _ in enumerate(play):
        if n == AT:
            port_of(arm, "right").inject("mute")
        if n == AT + 2:
            port_of(arm, "right").inject(None)
        goals.append(goals_in(arm, "grip")[0])
    steps = [abs(after - before) for before, after in pairwise(goals)]
    step = 0.163 * deg  # a unit of position of a DRS-0602, by its manual
    assert max(steps) <= play.limits["grip"].speed * play.period + step
    assert min(steps[AT : AT + 3]) == 0, "it was sent nothing while it was silent"
    assert goals[-1] == pytest.approx(40 * deg, abs=step)


def test_a_joint_that_is_held_shortly_before_the_end_is_told(arm: Robot) -> None:
    quick = Motion((0.0, 1.0), {"lift": (0.0, 60 * deg)})
    with pytest.raises(Stopped, match=r"lift stays .* behind its goal"):
        for tick in arm.play(quick, rate=25):
            if 0.6 < tick.time < 0.65:
                stall(arm)
    stands(arm)


@pytest.mark.parametrize("joint", ["base", "grip"])
def test_a_servo_that_restarts_between_two_turns_that_are_far_apart_is_given_no_goal(arm: Robot, joint: str) -> None:
    with pytest.raises(TorqueOff, match=f"{joint} has no torque any more"):
        for n, _ in enumerate(arm.play("swing", rate=2)):
            if n == 6:
                pull(arm, joint)
    assert not any(servo.torque for servo in servos_of(arm, joint))
    stands(arm)


def test_a_program_that_slept_between_two_turns_looks_before_it_sends(arm: Robot) -> None:
    with pytest.raises(TorqueOff, match="base has no torque any more"):
        for n, _ in enumerate(arm.play("swing", rate=25)):
            if n == AT:
                pull(arm, "base")
                servos_of(arm, "base")[0].turn_shaft(servos_of(arm, "base")[0].shaft.position - 10 * deg)
                arm.ports.align(arm.ports.now() + 1.0)
    assert not servos_of(arm, "base")[0].torque
    stands(arm)


def test_a_joint_far_outside_its_limits_is_not_brought_inside_by_a_jump(arm: Robot) -> None:
    arm["base"].torque_off()
    servos_of(arm, "base")[0].turn_shaft((150 + 120) * deg)
    arm["base"].torque_on()
    with pytest.raises(BadValue, match=r"base stands at 120\.\d°, outside its limits, .*: move it inside first"):
        arm.play("swing", rate=25).wait()
    stands(arm)
    arm.move(base=90 * deg, speed=60 * deg).wait()
    arm.play("swing", rate=25).wait()
