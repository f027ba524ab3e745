"""Moves from rest to rest: known figures, ruckig as a second opinion, and what is refused."""

import math
import random
from typing import Any

import pytest

from servobus import BadValue, deg
from servobus.errors import UnknownName
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import Path
from servobus.robots.trajectory.profile import double_s, quickest, quintic, quintic_time, synchronised, trapezoid
from servobus.robots.trajectory.spline import Shape, fitted

LIMITS = JointLimits(3.0, 10.0, 100.0)
WITHOUT_JERK = JointLimits(3.0, 10.0)


def test_the_known_move_of_1_5_rad() -> None:
    # Durations measured elsewhere: double S (ruckig too) 0.900 s, trapezoid 0.800 s, quintic 0.965 s.
    assert double_s(0.0, 1.5, LIMITS).duration == pytest.approx(0.9, rel=1e-12)
    assert trapezoid(0.0, 1.5, LIMITS).duration == pytest.approx(0.8, rel=1e-12)
    assert quintic_time(1.5, LIMITS) == pytest.approx(0.965, abs=0.0005)
    assert quintic_time(1.5, LIMITS) == pytest.approx((60 * 1.5 / 100) ** (1 / 3), rel=1e-12)


@pytest.mark.parametrize(("plan", "orders"), [(double_s, 3), (trapezoid, 2)])
@pytest.mark.parametrize("goal", [1.5, -1.5, 0.9, 0.1, 1e-3, -1e-9, 40.0])
def test_limits_hold_and_one_of_them_is_used(plan: Any, orders: int, goal: float) -> None:
    path: Path = plan(0.25, 0.25 + goal, LIMITS)
    kept = [
        path.peak(quantity).value / limit
        for quantity, limit in [("speed", 3.0), ("acceleration", 10.0), ("jerk", 100.0)][:orders]
    ]
    assert max(kept) == pytest.approx(1.0, rel=1e-7)
    assert [one.value for one in path.extremes()] == pytest.approx(sorted((0.25, 0.25 + goal)), abs=1e-12)
    assert path.at(path.duration).position == 0.25 + goal
    assert path.at(path.duration / 2).position == pytest.approx(0.25 + goal / 2)


def test_a_double_s_takes_as_long_as_ruckig_says() -> None:
    ruckig = pytest.importorskip("ruckig")
    draw = random.Random(7)
    for _ in range(300):
        limits = JointLimits(*(10 ** draw.uniform(low, low + 3) for low in (-1.5, -1, 0)))
        start, way = draw.uniform(-3, 3), 10 ** draw.uniform(-4, 1.5) * draw.choice((-1, 1))
        given = ruckig.InputParameter(1)
        given.current_position, given.target_position = [start], [start + way]
        given.max_velocity, given.max_acceleration, given.max_jerk = (
            [limits.speed],
            [limits.acceleration],
            [limits.jerk],
        )
        planned = ruckig.Trajectory(1)
        assert ruckig.Ruckig(1).calculate(given, planned) == ruckig.Result.Working
        ours = quickest(start, start + way, limits)
        assert ours.duration == pytest.approx(planned.duration, rel=1e-9)
        for share in (0.1, 0.35, 0.6, 0.95):
            position, speed, acceleration = (row[0] for row in planned.at_time(share * planned.duration))
            state = ours.at(share * planned.duration)
            assert state.position == pytest.approx(position, abs=1e-9 * abs(way) + 1e-12)
            assert state.speed == pytest.approx(speed, abs=1e-8 * limits.speed)
            assert state.acceleration == pytest.approx(acceleration, abs=1e-6 * limits.acceleration)


def test_a_double_s_with_endless_jerk_is_the_trapezoid() -> None:
    for way in (0.1, 0.9, 5.0):
        slow, quick = double_s(0.0, way, JointLimits(3.0, 10.0, 1e9)), trapezoid(0.0, way, LIMITS)
        assert slow.duration == pytest.approx(quick.duration, rel=1e-6)


def test_a_quintic_has_the_peaks_of_the_books() -> None:
    path = quintic(0.0, 2.0, 0.8)  # 15/8 d/T, 10/sqrt(3) d/T^2, 60 d/T^3
    peaks = [path.peak(quantity).value for quantity in ("speed", "acceleration", "jerk")]
    assert peaks == pytest.approx([1.875 * 2 / 0.8, 5.7735027 * 2 / 0.64, 60 * 2 / 0.512], rel=1e-7)
    assert path.at(0.4).position == pytest.approx(1.0)
    assert (path.at(0.8).position, path.at(0.8).speed) == (2.0, 0.0)


def test_the_slowest_joint_rules_and_all_arrive_together() -> None:
    limits = {"shoulder": LIMITS, "elbow": LIMITS, "wrist": WITHOUT_JERK, "jaw": LIMITS}
    starts = {"shoulder": 0.0, "elbow": 1.0, "wrist": -0.5, "jaw": 0.3}
    goals = {"jaw": 0.3, "wrist": 0.5, "elbow": 0.9, "shoulder": 1.5}
    move = synchronised(starts, goals, limits)
    assert move.duration == pytest.approx(0.9)
    assert {path.duration for path in move.paths.values()} == {move.duration}
    assert (move.start, move.goal) == (starts, goals)
    assert {joint: state.position for joint, state in move.at(move.duration).items()} == goals
    assert move.at(0.45)["jaw"].position == 0.3
    assert move.demand(limits).factor == pytest.approx(1.0)
    # Stretched from 4 ms of its own: slower by the factor, speed for speed.
    alone = quickest(1.0, 0.9, LIMITS)
    factor = move.duration / alone.duration
    assert move.paths["elbow"].peak("speed").value == pytest.approx(alone.peak("speed").value / factor)


def test_a_time_is_kept_exactly() -> None:
    move = synchronised({"a": 0.0, "b": 1.0}, {"a": 1.0, "b": 1.0}, {"a": LIMITS, "b": LIMITS}, time=1.2)
    assert move.duration == 1.2
    assert move.at(0.6)["a"].speed == pytest.approx(15 / 8 / 1.2)
    assert move.at(0.6)["b"].position == 1.0


def test_a_time_too_short_is_refused_with_the_one_that_works() -> None:
    limits = {"a": LIMITS, "elbow": LIMITS}
    with pytest.raises(BadValue, match=r"^elbow cannot move from 0\.0° to 85\.9° in 0\.8 s .*give time=0\.966 or more"):
        synchronised({"a": 0.0, "elbow": 0.0}, {"a": 0.1, "elbow": 1.5}, limits, time=0.8)
    with pytest.raises(BadValue, match=r"in 0\.965 s .*give time=0\.966 or more"):
        synchronised({"a": 0.0, "elbow": 0.0}, {"a": 0.1, "elbow": 1.5}, limits, time=0.965)
    assert synchronised({"a": 0.0, "elbow": 0.0}, {"a": 0.1, "elbow": 1.5}, limits, time=0.966).duration == 0.966


def test_the_shortest_time_itself_is_taken() -> None:
    shortest = quintic_time(1.5, LIMITS)
    move = synchronised({"a": 0.0}, {"a": 1.5}, {"a": LIMITS}, time=shortest)
    assert move.demand({"a": LIMITS}).factor == pytest.approx(1.0)


def test_going_nowhere_takes_no_time() -> None:
    move = synchronised({"a": 0.5}, {"a": 0.5}, {"a": LIMITS})
    assert move.duration == 0.0
    assert move.at(0.0)["a"].position == move.at(-1.0)["a"].position == 0.5
    assert move.demand({"a": LIMITS}).factor == 0.0
    assert move.slowed(2.0).duration == 0.0


@pytest.mark.parametrize("way", [1e-13, 1e-12, 1e-9, 1.0, 2e6])
@pytest.mark.parametrize("limit", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("other", [1e-9, 1.0, 1e9])
def test_the_smallest_and_the_largest_numbers_are_planned_with(way: float, limit: float, other: float) -> None:
    limits = {"a": JointLimits(limit, other, limit), "b": JointLimits(1e-9, 1e-9, 1e-9)}
    move = synchronised({"a": -way / 2, "b": -1e6}, {"a": way / 2, "b": 1e6}, limits)
    assert move.at(move.duration)["a"].position == way / 2
    assert 0 <= move.demand(limits).factor <= 1 + 1e-6
    for shape in Shape:
        result = fitted([0.0, 1e-3, 1.0], {"a": [-way / 2, way / 2, 0.0], "b": [-1e6, 1e6, 0.0]}, limits, shape)
        assert result.trajectory.demand(limits).factor <= 1 + 1e-6


@pytest.mark.parametrize("time", [0.0, -1.0, math.nan, math.inf, 1e-9, "1", True])
def test_what_is_no_time_is_refused(time: Any) -> None:
    with pytest.raises(BadValue, match="no time for a move: give seconds"):
        synchronised({"a": 0.0}, {"a": 0.0}, {"a": LIMITS}, time=time)


@pytest.mark.parametrize(
    ("limits", "sentence"),
    [
        (JointLimits(0.0, 1.0), "a: the limit of speed 0.0 is none: give 1e-09 to 1e+09 rad/s"),
        (JointLimits(1.0, math.inf), "a: the limit of acceleration inf is none: give 1e-09 to 1e+09 rad/s²"),
        (JointLimits(1.0, 1.0, -5.0), "a: the limit of jerk -5.0 is none: give 1e-09 to 1e+09 rad/s³"),
    ],
)
def test_what_is_no_limit_is_refused(limits: JointLimits, sentence: str) -> None:
    with pytest.raises(BadValue) as caught:
        synchronised({"a": 0.0}, {"a": 1.0}, {"a": limits})
    assert str(caught.value) == sentence


def test_other_wrong_arguments_are_refused_by_joint() -> None:
    with pytest.raises(UnknownName, match="b has no limits"):
        synchronised({"a": 0.0, "b": 0.0}, {"a": 1.0, "b": 1.0}, {"a": LIMITS})
    with pytest.raises(UnknownName, match="b: there is no goal of that joint"):
        synchronised({"a": 0.0, "b": 0.0}, {"a": 1.0}, {"a": LIMITS, "b": LIMITS})
    with pytest.raises(UnknownName, match="b: there is no start of that joint"):
        synchronised({"a": 0.0}, {"a": 1.0, "b": 0.0}, {"a": LIMITS, "b": LIMITS})
    with pytest.raises(BadValue, match="a: the goal nan is no position: give radians"):
        synchronised({"a": 0.0}, {"a": math.nan}, {"a": LIMITS})
    with pytest.raises(BadValue, match="of no joint"):
        synchronised({}, {}, {})
    with pytest.raises(BadValue, match="needs a limit of jerk"):
        double_s(0.0, 90 * deg, WITHOUT_JERK)
