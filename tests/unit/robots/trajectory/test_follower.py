"""Goals in flight: limits at every tick, rest exactly on the goal, and holding."""

import math
import sys
from typing import Any

import pytest

from servobus import BadValue, UsageError
from servobus.errors import UnknownName
from servobus.robots.trajectory.follower import BrakingFollower, Follower
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.online import RuckigFollower
from servobus.robots.trajectory.path import State

LIMITS = JointLimits(3.0, 10.0, 100.0)
KINDS: list[type[Follower]] = [BrakingFollower, RuckigFollower]
BOTH = pytest.mark.parametrize("kind", KINDS)


@pytest.fixture(autouse=True)
def ruckig_is_there(request: pytest.FixtureRequest) -> None:
    if "kind" in request.fixturenames and request.getfixturevalue("kind") is RuckigFollower:
        pytest.importorskip("ruckig")


def follow(follower: Follower, ticks: int = 10_000) -> list[State]:
    """Step until all rests; give the states of joint a."""
    states = []
    while not follower.settled:
        states.append(follower.step()["a"])
        assert len(states) < ticks
    return states


@pytest.mark.parametrize(("tick", "latest"), [(0.01, 0.65), (0.001, 0.636), (0.02, 0.66)])
def test_the_known_move_of_1_rad_settles_hardly_later_than_it_can(tick: float, latest: float) -> None:
    # The best possible with 3 rad/s and 10 rad/s² is 1/3 + 3/10 = 0.633 s.
    follower = BrakingFollower({"a": State(0.0)}, {"a": LIMITS}, tick)
    follower.aim({"a": 1.0})
    states = follow(follower)
    assert 0.633 <= len(states) * tick <= latest + 1e-9
    assert states[-1] == State(1.0)
    assert max(state.position for state in states) == 1.0


def test_with_jerk_the_move_takes_as_long_as_a_double_s() -> None:
    pytest.importorskip("ruckig")
    follower = RuckigFollower({"a": State(0.0)}, {"a": LIMITS}, 0.01)
    follower.aim({"a": 1.5})
    states = follow(follower)
    assert 0.9 <= len(states) * 0.01 <= 0.911
    assert states[-1] == State(1.5)


@BOTH
def test_speed_and_acceleration_are_those_of_the_positions(kind: type[Follower]) -> None:
    follower = kind({"a": State(0.0)}, {"a": LIMITS}, 0.01)
    follower.aim({"a": 1.0})
    before = follower.states["a"]
    for state in follow(follower):
        speed = (state.position - before.position) / 0.01
        if kind is BrakingFollower:
            assert speed == pytest.approx(state.speed, abs=1e-9)
            assert (state.speed - before.speed) / 0.01 == pytest.approx(state.acceleration, abs=1e-6)
        assert abs(speed) <= 3.0 + 1e-9
        assert abs(state.acceleration) <= 10.0 + 1e-6
        before = state


@BOTH
def test_holding_brakes_at_once_and_stays(kind: type[Follower]) -> None:
    follower = kind({"a": State(0.0), "b": State(1.0)}, {"a": LIMITS, "b": LIMITS}, 0.01)
    follower.aim({"a": 1.0, "b": 0.9})
    for _ in range(20):
        follower.step()
    there = follower.states["a"]
    follower.hold()
    goal = follower.goals["a"]
    assert there.position < goal < 1.0
    states = follow(follower)
    assert states[-1] == State(goal)
    speeds = [state.speed for state in states]
    if kind is BrakingFollower:
        assert speeds == sorted(speeds, reverse=True)
        # 2 rad/s at 10 rad/s² are 20 ticks of 0.1 rad/s: 19 + 18 + ... + 1 ticks of 1 mrad.
        assert goal - there.position == pytest.approx(0.190)
        assert len(states) == pytest.approx(20, abs=2)
    follower.aim({"a": 0.0})
    assert follow(follower)[-1] == State(0.0)


@BOTH
def test_a_goal_behind_is_come_back_to(kind: type[Follower]) -> None:
    follower = kind({"a": State(0.0)}, {"a": LIMITS}, 0.01)
    follower.aim({"a": 1.0})
    for _ in range(20):
        follower.step()
    follower.aim({"a": 0.1})
    states = follow(follower)
    assert max(state.position for state in states) < 1.0
    assert states[-1] == State(0.1)


@BOTH
def test_a_follower_takes_over_a_joint_in_motion(kind: type[Follower]) -> None:
    follower = kind({"a": State(0.0, 2.0)}, {"a": LIMITS}, 0.01)
    assert not follower.settled
    states = follow(follower)
    assert 0.15 < states[-1].position < 0.5  # 2 rad/s at 10 rad/s² take 0.2 rad, with limited jerk more
    assert states[-1].speed == 0.0
    assert max(abs(state.acceleration) for state in states) <= 10.0 + 1e-6


@BOTH
def test_joints_at_rest_stay_where_they_are(kind: type[Follower]) -> None:
    follower = kind({"a": State(0.3), "b": State(-0.7)}, {"a": LIMITS, "b": LIMITS}, 0.01)
    assert follow(follower) == []
    assert follower.step() == {"a": State(0.3), "b": State(-0.7)}
    follower.aim({"b": -0.6})
    while not follower.settled:
        assert follower.step()["a"] == State(0.3)


@BOTH
def test_wrong_goals_change_nothing(kind: type[Follower]) -> None:
    follower = kind({"a": State(0.3)}, {"a": LIMITS}, 0.01)
    with pytest.raises(UnknownName, match="elbow is no joint of this follower: use a"):
        follower.aim({"a": 1.0, "elbow": 1.0})
    with pytest.raises(BadValue, match="a: the goal nan is no position"):
        follower.aim({"a": math.nan})
    assert follower.goals == {"a": 0.3}
    assert follower.settled


@BOTH
@pytest.mark.parametrize("tick", [0.0, -0.01, math.nan, "1"])
def test_what_is_no_tick_is_refused(kind: type[Follower], tick: Any) -> None:
    with pytest.raises(BadValue, match="is not a number above 0"):
        kind({"a": State(0.3)}, {"a": LIMITS}, tick)


@BOTH
def test_a_joint_without_limits_is_refused(kind: type[Follower]) -> None:
    with pytest.raises(UnknownName, match="a has no limits"):
        kind({"a": State(0.3)}, {}, 0.01)


def test_ruckig_needs_a_jerk() -> None:
    with pytest.raises(BadValue, match="a has no limit of jerk: give one in rad/s³, or take the BrakingFollower"):
        RuckigFollower({"a": State(0.0)}, {"a": JointLimits(3.0, 10.0)}, 0.01)


def test_without_ruckig_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ruckig", None)
    with pytest.raises(UsageError, match=r'pip install "servobus\[ruckig\]"'):
        RuckigFollower({"a": State(0.0)}, {"a": LIMITS}, 0.01)


def test_ruckig_is_told_no_waypoints() -> None:
    # It would send the whole motion to a server.
    pytest.importorskip("ruckig")
    follower = RuckigFollower({"a": State(0.0)}, {"a": LIMITS}, 0.01)
    follower.aim({"a": 1.0})
    follower.step()
    follower.hold()
    follower.step()
    assert list(follower._input.intermediate_positions) == []
