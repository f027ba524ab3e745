"""Motions through poses: what makes each spline the one it is, and how limits stretch it."""

import math
import random
from itertools import pairwise
from typing import Any

import pytest

from servobus import BadValue
from servobus.errors import UnknownName
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import Path
from servobus.robots.trajectory.polynomial import derivative, value
from servobus.robots.trajectory.profile import quintic
from servobus.robots.trajectory.spline import Shape, fitted, spline

LIMITS = JointLimits(3.0, 10.0, 100.0)
TIMES = [0.0, 0.5, 0.9, 1.5, 2.0]
POSES = [0.0, 0.5, -0.2, 0.8, 0.3]
EVERY_SHAPE = pytest.mark.parametrize("shape", Shape)


def one(times: list[float], poses: list[float], shape: Shape | str) -> Path:
    return spline(times, {"a": poses}, shape).paths["a"]


def jumps(path: Path, order: int) -> list[float]:
    """Give by how much a derivative jumps at each inner knot."""
    ends = [
        value(derivative(piece, order), after - before)
        for piece, (before, after) in zip(path.pieces, pairwise(path.knots), strict=True)
    ]
    starts = [value(derivative(piece, order), 0.0) for piece in path.pieces]
    return [start - end for end, start in zip(ends, starts[1:], strict=False)]


@EVERY_SHAPE
def test_each_pose_is_passed_at_its_time_and_the_ends_at_rest(shape: Shape) -> None:
    path = one(TIMES, POSES, shape)
    assert [path.at(time).position for time in TIMES] == POSES
    assert path.at(0.0).speed == 0.0
    assert value(derivative(path.pieces[-1]), 0.5) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("shape", "smooth"), [("cubic", 2), ("pchip", 1), ("quintic", 4)])
def test_as_many_derivatives_as_told_are_continuous(shape: str, smooth: int) -> None:
    # With the ends at rest (and, for the quintic, without acceleration), this makes cubic and quintic the only ones.
    path = one(TIMES, POSES, shape)
    for order in range(smooth + 1):
        assert jumps(path, order) == pytest.approx([0.0] * 3, abs=1e-9 * 10**order)
    assert max(map(abs, jumps(path, smooth + 1))) > 1.0


def test_a_quintic_starts_and_ends_without_acceleration() -> None:
    path = one(TIMES, POSES, "quintic")
    assert path.pieces[0][2] == 0.0
    assert value(derivative(path.pieces[-1], 2), 0.5) == pytest.approx(0.0, abs=1e-9)


def test_splines_worked_out_by_hand() -> None:
    assert one([0, 1, 2], [0, 1, 2], "cubic").at(1).speed == pytest.approx(1.5)  # 4 v = 3 (1 + 1)
    assert one([0, 1, 2], [0, 1, 0], "cubic").at(1).speed == pytest.approx(0.0)
    assert one([0, 1, 3], [0, 1, 2], "pchip").at(1).speed == pytest.approx(9 / 13)  # 9 / (5/1 + 4/0.5)
    single, move = one([0.0, 0.8], [0.5, 1.5], "quintic"), quintic(0.5, 1.5, 0.8)
    assert single.pieces[0] == pytest.approx(move.pieces[0])


def test_pchip_never_swings_over_and_stands_between_equal_poses() -> None:
    draw = random.Random(5)
    times = [0.0]
    for _ in range(40):
        times.append(times[-1] + draw.uniform(0.02, 1.0))
    poses = [draw.choice([draw.uniform(-2, 2), 0.5]) for _ in times]
    path = one(times, poses, "pchip")
    for (begin, end), (first, last) in zip(pairwise(times), pairwise(poses), strict=True):
        inside = [path.at(begin + (end - begin) * n / 50).position for n in range(51)]
        moves = [b - a for a, b in pairwise(inside)]
        assert min(first, last) - 1e-12 <= min(inside) <= max(inside) <= max(first, last) + 1e-12
        assert all(move * (last - first) >= -1e-12 for move in moves)
        assert first != last or inside == [first] * 51


def test_the_quintic_has_less_jerk_than_its_neighbours() -> None:
    # Whatever is added between two poses, the integral of jerk² grows.
    def cost(path: Path) -> float:
        total = 0.0
        for piece, (begin, end) in zip(path.pieces, pairwise(path.knots), strict=True):
            jerk = derivative(piece, 3)
            total += sum(value(jerk, (end - begin) * (n + 0.5) / 200) ** 2 * (end - begin) / 200 for n in range(200))
        return total

    best = one(TIMES, POSES, "quintic")
    for index in range(4):
        # rises by 0.01 and falls again within one segment, at rest at its ends
        width = (TIMES[index + 1] - TIMES[index]) / 2
        rise, fall = quintic(0.0, 0.01, width).pieces[0], quintic(0.01, 0.0, width).pieces[0]
        piece = best.pieces[index]
        first = tuple(a + b for a, b in zip(piece, rise, strict=True))
        shifted = tuple(value(derivative(piece, n), width) / math.factorial(n) for n in range(6))
        second = tuple(a + b for a, b in zip(shifted, fall, strict=True))
        knots = sorted({*best.knots, best.knots[index] + width})
        changed = Path(knots, [*best.pieces[:index], first, second, *best.pieces[index + 1 :]], best.goal)
        assert cost(changed) > cost(best)


@EVERY_SHAPE
@pytest.mark.parametrize(
    "limits", [LIMITS, JointLimits(0.5, 10.0), JointLimits(9.0, 1.0), JointLimits(9.0, 99.0, 20.0)]
)
def test_stretched_times_keep_all_limits_and_are_no_longer_than_all_slowed(shape: Shape, limits: JointLimits) -> None:
    poses = {"a": POSES, "b": [0.0, 0.1, 0.1, 0.2, -0.3]}
    both = {"a": limits, "b": LIMITS}
    whole = spline(TIMES, poses, shape).stretched(both)
    result = fitted(TIMES, poses, both, shape)
    assert result.trajectory.demand(both).factor <= 1 + 1e-9
    assert result.trajectory.duration <= whole.duration * (1 + 1e-9)
    assert result.times[-1] == pytest.approx(result.trajectory.duration)
    for index, time in enumerate(result.times[:-1]):
        assert result.trajectory.at(time)["a"].position == POSES[index]
    steps = [after - before for before, after in pairwise(result.times)]
    by_segment = {stretch.segment: stretch.factor for stretch in result.stretches}
    for index, (before, after) in enumerate(pairwise(TIMES)):
        assert steps[index] / (after - before) == pytest.approx(by_segment.get(index, 1.0))
        assert by_segment.get(index, 1.0) >= 1.0


@EVERY_SHAPE
def test_times_that_are_long_enough_are_kept(shape: Shape) -> None:
    result = fitted([0.0, 2.0, 5.0], {"a": [0.0, 1.0, 0.5]}, {"a": LIMITS}, shape)
    assert (result.times, result.stretches, result.most) == ((0.0, 2.0, 5.0), (), None)


def test_a_sudden_segment_is_stretched_and_says_who_asked() -> None:
    times = [0.0, 1.0, 2.0, 3.0, 4.0, 4.1, 5.0, 6.0]
    poses = {"slow": [0.1 * n for n in range(8)], "elbow": [0.0, 0.1, 0.2, 0.3, 0.4, 1.4, 1.5, 1.6]}
    result = fitted(times, poses, {"slow": LIMITS, "elbow": LIMITS}, "pchip")
    assert result.trajectory.duration < 8.0  # slowed as a whole it takes more than half a minute
    assert spline(times, poses, "pchip").stretched({"slow": LIMITS, "elbow": LIMITS}).duration > 30.0
    assert result.times[3] == 3.0
    assert result.most is not None
    assert (result.most.segment, result.most.demand.joint) == (4, "elbow")
    assert str(result.most).startswith("from pose 4 to 5 the motion takes ")
    assert "elbow: " in str(result.most)


def test_a_start_at_speed_is_not_paid_for_by_all_of_a_taught_motion() -> None:
    times = [0.02 * n for n in range(150)]
    poses = {"a": [math.sin(time) for time in times]}
    for shape in Shape:
        whole = spline(times, poses, shape).stretched({"a": LIMITS})
        result = fitted(times, poses, {"a": LIMITS}, shape)
        assert result.trajectory.demand({"a": LIMITS}).factor <= 1 + 1e-9
        assert result.trajectory.duration < 5.0 < 12.0 < whole.duration


@pytest.mark.parametrize(
    ("times", "poses", "shape", "sentence"),
    [
        ([0.0, 1.0], {"a": [0.0, 1.0]}, "linear", "linear' is no shape of a motion: use cubic, pchip, quintic"),
        ([0.0], {"a": [0.0]}, "cubic", "two poses or more"),
        ([0.0, 1.0], {}, "cubic", "two poses or more"),
        ([0.0, 1.0, 1.0], {"a": [0.0] * 3}, "cubic", "pose 2 at 1 s does not come after pose 1 at 1 s: give"),
        ([0.0, math.nan], {"a": [0.0] * 2}, "cubic", "pose 1: nan is no time: give seconds"),
        ([0.0, 1.0], {"elbow": [0.0]}, "cubic", "elbow has 1 positions for 2 times"),
        ([0.0, 1.0], {"elbow": [0.0, "1"]}, "cubic", "elbow: the position of pose 1 '1' is no position: give radians"),
    ],
)
def test_what_makes_no_motion_is_refused(times: Any, poses: Any, shape: str, sentence: str) -> None:
    with pytest.raises(BadValue, match=sentence):
        spline(times, poses, shape)
    with pytest.raises(BadValue, match=sentence):
        fitted(times, poses, dict.fromkeys(poses, LIMITS), shape)


def test_a_joint_without_limits_is_not_fitted() -> None:
    with pytest.raises(UnknownName, match="a has no limits"):
        fitted([0.0, 1.0], {"a": [0.0, 1.0]}, {}, "cubic")


def test_a_motion_starts_at_its_first_pose_and_takes_poses_a_millisecond_apart() -> None:
    assert spline([3.0, 4.0], {"a": [0.0, 1.0]}, "cubic").duration == 1.0
    assert spline([0.001 * n for n in range(50)], {"a": [0.0] * 50}, "quintic").duration == pytest.approx(0.049)
