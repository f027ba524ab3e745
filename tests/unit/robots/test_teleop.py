"""Teleoperation of a virtual arm by another of other families, on the virtual clock."""

import asyncio
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

import servobus
from servobus import MotionError, Stopped, UsageError, deg
from servobus.errors import UnknownName
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_text
from servobus.robots.motions.leading import Lead, Phase
from servobus.robots.teleop import AsyncTeleop, Teleop, TeleopTick
from servobus.virtual.physics.motor import Load
from unit.robots.arms import port_of, servos_of

LEADER = """
[robot]
format = 1
[port.hand]
path = "virtual:lx16a@1-2?clock=virtual"
[joint.base]
port = "hand"
model = "lx16a"
id = 1
zero = "120deg"
[joint.grip]
port = "hand"
model = "lx16a"
id = 2
zero = "120deg"
direction = -1
"""
FOLLOWER = """
[robot]
format = 1
[port.left]
path = "virtual:rx28@1?clock=virtual"
[port.right]
path = "virtual:drs0602@1?clock=virtual"
[joint.base]
port = "left"
model = "rx28"
id = 1
zero = "150deg"
direction = -1
limits = ["-60deg", "60deg"]
speed = "120deg/s"
acceleration = "600deg/s2"
[joint.grip]
port = "right"
model = "drs0602"
id = 1
limits = ["-40deg", "40deg"]
"""


@pytest.fixture
def arms() -> Iterator[tuple[Robot, Robot]]:
    with ExitStack() as stack:
        leader = stack.enter_context(servobus.robot(read_text(LEADER)))
        follower = stack.enter_context(servobus.robot(read_text(FOLLOWER)))
        follower.torque_on()
        yield leader, follower


def turn(leader: Robot, joint: str, angle: float) -> None:
    """Turn a joint of the limp leader by hand."""
    (part,) = leader[joint].parts
    (servo,) = servos_of(leader, joint)
    servo.shaft.position = part.axis.to_servo(angle)


def ticks(teleop: Teleop, count: int) -> Iterator[tuple[int, TeleopTick]]:
    for n, tick in enumerate(teleop):
        yield n, tick
        if n + 1 >= count:
            teleop.stop()


def test_the_follower_comes_slowly_and_then_follows(arms: tuple[Robot, Robot]) -> None:
    leader, follower = arms
    turn(leader, "base", 30 * deg)
    phases = []
    last = 0.0
    for n, tick in ticks(Teleop(leader, follower), 160):
        phases.append(tick.phase)
        here = tick.result.positions["base"]
        if tick.phase is Phase.STARTING:
            assert here - last < (30 * deg) / 50 + 0.6 * deg
        last = here
        if n > 100:
            turn(leader, "base", 30 * deg - (n - 100) * 0.5 * deg)
    assert list(dict.fromkeys(phases)) == [Phase.STARTING, Phase.FOLLOWING]
    assert follower.positions()["base"] == pytest.approx(30 * deg - 59 * 0.5 * deg, abs=4 * deg)


def test_beyond_the_gate_nothing_moves_and_the_joint_is_named(arms: tuple[Robot, Robot]) -> None:
    leader, follower = arms
    turn(leader, "base", 55 * deg)
    for _, tick in ticks(Teleop(leader, follower), 30):
        assert tick.phase is Phase.WAITING
        assert tick.why.startswith("too far apart to start: base by 5")
    assert follower.positions()["base"] == pytest.approx(0, abs=0.5 * deg)


def test_what_lies_beyond_a_limit_is_clamped_and_told(arms: tuple[Robot, Robot]) -> None:
    leader, follower = arms
    clamped: tuple[str, ...] = ()
    for n, tick in ticks(Teleop(leader, follower), 200):
        turn(leader, "grip", min(n * 0.6, 80) * deg)
        clamped = tick.clamped
    assert clamped == ("grip",)
    assert follower.positions()["grip"] == pytest.approx(40 * deg, abs=1 * deg)


def test_a_leader_that_falls_silent_makes_the_follower_hold(arms: tuple[Robot, Robot]) -> None:
    leader, follower = arms
    port = port_of(leader, "hand")
    phases: list[Phase] = []
    turn(leader, "base", 12 * deg)
    for n, tick in ticks(Teleop(leader, follower), 200):
        phases.append(tick.phase)
        turn(leader, "base", min(12 + n * 0.4, 30) * deg)
        if n == 60:
            port.inject("mute=1")
        if n == 64:
            assert tick.why == "the leader does not answer: base, grip"
        if n == 120:
            port.inject(None)
    assert list(dict.fromkeys(phases)) == [Phase.STARTING, Phase.FOLLOWING, Phase.HOLDING]
    assert phases[63] is Phase.HOLDING
    assert phases[-1] is Phase.FOLLOWING


def test_a_deadman_that_is_let_go_makes_the_follower_hold(arms: tuple[Robot, Robot]) -> None:
    leader, follower = arms
    held = [True]
    stood = []
    for n, tick in ticks(Teleop(leader, follower, deadman=lambda: held[0]), 120):
        turn(leader, "base", min(n * 0.4, 30) * deg)
        if n == 50:
            held[0] = False
        if n > 80:
            stood.append(tick.result.positions["base"])
            assert tick.why == "the deadman is not held"
    assert max(stood) - min(stood) < 0.6 * deg


def test_a_follower_that_is_held_ends_it_and_stops(arms: tuple[Robot, Robot]) -> None:
    leader, follower = arms
    teleop = Teleop(leader, follower)
    with pytest.raises(Stopped, match="base stays"):
        for n, _ in ticks(teleop, 300):
            turn(leader, "base", min(n * 0.6, 40) * deg)
            if n == 20:
                for servo in servos_of(follower, "base"):
                    servo.shaft.load = Load(blocked=True)


def test_scale_offset_and_other_names(arms: tuple[Robot, Robot]) -> None:
    leader, follower = arms
    teleop = Teleop(leader, follower, {"base": Lead("grip", scale=-0.5, offset=10 * deg)})
    for _ in ticks(teleop, 150):
        turn(leader, "grip", 20 * deg)
    assert follower.positions()["base"] == pytest.approx(0 * deg, abs=1 * deg)
    assert follower.positions()["grip"] == pytest.approx(0, abs=0.5 * deg)


def test_a_leader_with_torque_is_refused(arms: tuple[Robot, Robot]) -> None:
    leader, follower = arms
    leader["base"].torque_on()
    with pytest.raises(MotionError, match="base: the torque of the leader is on"):
        Teleop(leader, follower).wait()
    leader["base"].torque_off()


def test_wrong_joints_are_refused(arms: tuple[Robot, Robot]) -> None:
    leader, follower = arms
    with pytest.raises(UnknownName, match="no joint 'wrist'; there are base, grip"):
        Teleop(leader, follower, {"base": "wrist"})
    with pytest.raises(UsageError, match="scale 0"):
        Teleop(leader, follower, {"base": Lead("base", scale=0)})


def test_asynchronous_robots_do_the_same() -> None:
    async def led() -> tuple[Phase, float]:
        async with (
            servobus.robot_async(read_text(LEADER)) as leader,
            servobus.robot_async(read_text(FOLLOWER)) as follower,
        ):
            await follower.torque_on()
            teleop = AsyncTeleop(leader, follower, {"base": Lead("base", offset=10 * deg)})
            phase = Phase.WAITING
            async for tick in teleop:
                phase = tick.phase
                if follower.ports.now() > 1.5:
                    teleop.stop()
            return phase, await follower["base"].position()

    phase, angle = asyncio.run(led())
    assert phase is Phase.FOLLOWING
    assert angle == pytest.approx(10 * deg, abs=1 * deg)
