"""Goals in flight on a virtual arm: limits on the wire whatever the goals do, and what ends it."""

import asyncio
from itertools import pairwise

import pytest

import servobus
from servobus import TorqueOff, deg
from servobus.errors import BadValue, BusError, UnknownName, UsageError
from servobus.robots.file.reading import read_text
from servobus.robots.motions.motion import limits_of
from unit.robots.arms import LIVE, goals_in, opened, port_of

RATE = 50.0


@pytest.mark.parametrize("jerk", [None, 5000 * deg])
def test_goals_may_jump_and_no_limit_is_exceeded_on_the_wire(jerk: float | None) -> None:
    if jerk is not None:
        pytest.importorskip("ruckig")
    with opened() as arm, arm.torque():
        follow = arm.follow("base", "grip", rate=RATE, jerk=jerk)
        assert set(follow.limits) == {"base", "grip"}
        sent: dict[str, list[float]] = {"base": [], "grip": []}
        for n, _ in enumerate(follow):
            if n % 12 == 0:
                follow.aim(base=(40 if n % 24 else -40) * deg, grip=(10 if n % 24 else 60) * deg)
            if n == 100:
                follow.stop()
            for name, goals in sent.items():
                goals.append(goals_in(arm, name)[0])
        assert len(sent["base"]) < 150, "it came to rest"
        for name, goals in sent.items():
            limits = limits_of(arm[name])
            rounding = 0.3 * deg
            speeds = [(b - a) * RATE for a, b in pairwise(goals)]
            assert 30 * deg < max(map(abs, speeds)) <= limits.speed + rounding * RATE
            wide = [(b - a) * RATE / 5 for a, b in zip(goals, goals[5:], strict=False)]
            changes = [(b - a) * RATE / 5 for a, b in zip(wide, wide[5:], strict=False)]
            assert max(map(abs, changes)) <= limits.acceleration + 2 * rounding * (RATE / 5) ** 2


def test_it_settles_on_the_last_goal_and_joints_that_are_not_named_stand() -> None:
    with opened() as arm, arm.torque():
        before = goals_in(arm, "elbow")
        follow = arm.follow("base", rate=RATE)
        follow.aim(base=10 * deg)
        for tick in follow:
            if tick.settled:
                assert tick.goals == {"base": pytest.approx(10 * deg)}
                break
        assert arm["base"].position() == pytest.approx(10 * deg, abs=1 * deg)
        assert goals_in(arm, "elbow") == before


def test_wrong_goals_change_nothing() -> None:
    with opened() as arm, arm.torque():
        follow = arm.follow("base", rate=RATE)
        with pytest.raises(BadValue, match="base: 130"):
            follow.aim(base=130 * deg)
        with pytest.raises(UnknownName, match="no joint 'grip'; there are base"):
            follow.aim(grip=0.0)
        assert next(iter(follow)).settled
        with pytest.raises(UnknownName, match="no joint 'bas'"):
            arm.follow("bas")
        with pytest.raises(BadValue, match="rate"):
            arm.follow("base", rate=0)


def test_limits_of_jerk_need_ruckig_and_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ruckig", None)
    with opened() as arm, pytest.raises(UsageError, match=r"servobus\[ruckig\]"):
        arm.follow("base", jerk=100.0)


def test_nothing_follows_without_torque_and_a_silent_joint_ends_it() -> None:
    with opened() as arm:
        with pytest.raises(TorqueOff, match="base: torque is off"):
            arm.follow("base", rate=RATE).wait()
        arm.torque_on()
        follow = arm.follow("base", "grip", rate=RATE)
        follow.aim(base=115 * deg, grip=60 * deg)
        port = port_of(arm, "hand")
        with pytest.raises(BusError, match="grip does not answer any more; all joints of the motion were stopped"):
            for n, _ in enumerate(follow):
                if n == 20:
                    port.rig.unplug(port.servos, port.now())
        stood = goals_in(arm, "base")
        port_of(arm, "base").sleep(0.5)
        assert goals_in(arm, "base") == stood
        assert arm["base"].position() < 100 * deg


def test_an_asynchronous_robot_follows_the_same() -> None:
    async def followed() -> float:
        async with servobus.robot_async(read_text(LIVE)) as arm, arm.torque():
            follow = arm.follow("base", rate=RATE)
            follow.aim(base=20 * deg)
            async for tick in follow:
                if tick.settled:
                    break
            return await arm["base"].position()

    assert asyncio.run(followed()) == pytest.approx(20 * deg, abs=1 * deg)
