"""Trajectories of any moves, poses and goals: limits hold at every instant, ends are exact, all arrive together."""

from importlib.util import find_spec
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobus.robots.trajectory.follower import BrakingFollower, Follower
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.online import RuckigFollower
from servobus.robots.trajectory.path import State, Trajectory
from servobus.robots.trajectory.playback import Playback
from servobus.robots.trajectory.profile import quickest, synchronised
from servobus.robots.trajectory.spline import Shape, fitted, spline

JOINTS = ("shoulder", "elbow", "wrist")
FOLLOWERS = [BrakingFollower, *([RuckigFollower] if find_spec("ruckig") else [])]
SAMPLES = 50
TICK = 0.01

angles = st.floats(-3.0, 3.0) | st.sampled_from([0.0, 1.0, 1.0 + 1e-12, 1e-310])
speeds, accelerations, jerks = st.floats(0.1, 10.0), st.floats(0.5, 100.0), st.floats(5.0, 2000.0)
limits_with_jerk = st.builds(JointLimits, speeds, accelerations, jerks)
limits = limits_with_jerk | st.builds(JointLimits, speeds, accelerations)
by_joint = st.fixed_dictionaries(dict.fromkeys(JOINTS, angles))
limits_by_joint = st.fixed_dictionaries(dict.fromkeys(JOINTS, limits))
steps = st.lists(st.floats(0.01, 2.0), min_size=1, max_size=5)


@st.composite
def motions(draw: st.DrawFn) -> tuple[list[float], dict[str, list[float]]]:
    """Give times and poses."""
    times = [0.0]
    for step in draw(steps):
        times.append(times[-1] + step)
    return times, {joint: [draw(angles) for _ in times] for joint in JOINTS}


def check_limits(trajectory: Trajectory, bounds: dict[str, JointLimits], slack: float = 1e-6) -> None:
    """Check speed and acceleration as sampled, and from one sample to the next; and all limits by exact extrema."""
    assert trajectory.demand(bounds).factor <= 1 + slack
    width = trajectory.duration / SAMPLES
    sampled = [trajectory.at(width * n) for n in range(SAMPLES + 1)] if width else []
    for joint, bound in bounds.items():
        states = [sample[joint] for sample in sampled]
        rounding = 1e-13 / (width or 1)
        for before, after in pairwise(states):
            assert abs(after.speed) <= bound.speed * (1 + slack)
            assert abs(after.acceleration) <= bound.acceleration * (1 + slack)
            assert abs(after.position - before.position) <= width * bound.speed * (1 + slack) + 1e-13
            assert abs(after.speed - before.speed) <= width * bound.acceleration * (1 + slack) + rounding


@given(by_joint, by_joint, limits_by_joint)
def test_moves_keep_limits_and_arrive_together(
    starts: dict[str, float], goals: dict[str, float], bounds: dict[str, JointLimits]
) -> None:
    move = synchronised(starts, goals, bounds)
    check_limits(move, bounds)
    assert {joint: state.position for joint, state in move.at(move.duration).items()} == goals
    longest = max(quickest(starts[joint], goals[joint], bounds[joint]).duration for joint in JOINTS)
    assert move.duration == longest
    for joint in JOINTS:
        low, high = move.paths[joint].extremes()
        ends = sorted((starts[joint], goals[joint]))
        assert (low.value, high.value) == pytest.approx(ends, abs=1e-9)


@given(motions(), limits_by_joint, st.sampled_from(Shape))
def test_motions_through_poses_keep_limits_between_them_too(
    motion: tuple[list[float], dict[str, list[float]]], bounds: dict[str, JointLimits], shape: Shape
) -> None:
    times, poses = motion
    result = fitted(times, poses, bounds, shape)
    check_limits(result.trajectory, bounds)
    assert result.trajectory.duration <= spline(times, poses, shape).stretched(bounds).duration * (1 + 1e-9)
    for index, time in enumerate(result.times):
        states = result.trajectory.at(time)
        assert all(states[joint].position == pytest.approx(poses[joint][index], abs=1e-9) for joint in JOINTS)
    assert all(
        new >= old * (1 - 1e-9)
        for old, new in zip(
            (b - a for a, b in pairwise(times)), (b - a for a, b in pairwise(result.times)), strict=True
        )
    )


@given(motions())
def test_pchip_stays_between_its_poses(motion: tuple[list[float], dict[str, list[float]]]) -> None:
    times, poses = motion
    ranges = {joint: (min(positions), max(positions)) for joint, positions in poses.items()}
    spline(times, poses, "pchip").check_positions(ranges)


goals_in_flight = st.lists(st.tuples(angles | st.none(), st.integers(1, 60)), min_size=1, max_size=8)


@pytest.mark.parametrize("kind", FOLLOWERS)
@given(goals_in_flight, angles, limits_with_jerk)
def test_followers_keep_limits_whatever_the_goals_and_settle(
    kind: type[Follower], script: list[tuple[float | None, int]], start: float, bound: JointLimits
) -> None:
    """A goal of None is a call of `hold`."""
    follower = kind({"a": State(start)}, {"a": bound}, TICK)
    before, rounding = State(start), 1e-9
    goals = [start, *(goal for goal, _ in script if goal is not None)]
    for goal, ticks in [*script, (script[-1][0], 20_000)]:
        if goal is None:
            follower.hold()
        else:
            follower.aim({"a": goal})
        for _ in range(ticks):
            state = follower.step()["a"]
            speed = (state.position - before.position) / TICK
            assert abs(speed) <= bound.speed + rounding
            assert abs(state.speed) <= bound.speed + rounding
            assert abs(state.speed - before.speed) / TICK <= bound.acceleration * (1 + 1e-6) + rounding
            assert abs(state.acceleration - before.acceleration) / TICK <= (bound.jerk or 0) * 1.001 + 1e-4 or (
                kind is BrakingFollower
            )
            assert min(goals) - 1e-6 <= state.position <= max(goals) + 1e-6
            before = state
            if follower.settled:
                break
    assert follower.settled
    assert before == State(follower.goals["a"])


@given(angles, limits)
def test_a_goal_that_stays_is_never_passed(goal: float, bound: JointLimits) -> None:
    follower = BrakingFollower({"a": State(0.0)}, {"a": bound}, TICK)
    follower.aim({"a": goal})
    positions = [0.0]
    while not follower.settled:
        positions.append(follower.step()["a"].position)
    assert positions == sorted(positions, reverse=goal < 0)
    assert positions[-1] == goal
    # No later than three ticks after the best possible, a trapezoid.
    assert (len(positions) - 1) * TICK <= quickest(0.0, goal, JointLimits(bound.speed, bound.acceleration)).duration + (
        3 * TICK
    )


changes_of_pace = st.lists(st.tuples(st.integers(1, 30), st.floats(0.0, 1.0)), max_size=4)


@given(motions(), limits_by_joint, st.sampled_from(Shape), changes_of_pace)
def test_playback_keeps_limits_and_way_at_any_change_of_pace(
    motion: tuple[list[float], dict[str, list[float]]],
    bounds: dict[str, JointLimits],
    shape: Shape,
    changes: list[tuple[int, float]],
) -> None:
    trajectory = fitted(*motion, bounds, shape).trajectory
    playback = Playback(trajectory, bounds, TICK)
    before = dict(playback.states)
    for ticks, rate in [*changes, (20, 1.0)]:
        playback.set_rate(rate)
        for _ in range(ticks):
            states = playback.step()
            planned = trajectory.at(playback.time)
            for joint, bound in bounds.items():
                assert states[joint].position == pytest.approx(planned[joint].position, abs=1e-9)
                speed = (states[joint].position - before[joint].position) / TICK
                assert abs(speed) <= bound.speed * (1 + 1e-6)
                assert abs(speed - before[joint].speed) / TICK <= bound.acceleration * (1 + 2e-6)
            before = states
