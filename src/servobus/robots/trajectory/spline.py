"""Motions through poses: splines that pass each pose at its time, from rest to rest.

    cubic    speed and acceleration are continuous; swings beyond the poses; the acceleration jumps at both ends
    pchip    speed is continuous, the acceleration jumps at each pose; never swings beyond the poses: each joint turns
             round at poses only, and stands still between two poses that are the same. For taught motions.
    quintic  the motion with the least integral of jerk² through the poses: jerk and all below are continuous; swings
             farthest beyond the poses

Where the acceleration jumps, the jerk has no bound; limits of jerk hold between the jumps. Who needs them everywhere
takes the quintic.

Formulas: C. de Boor, A Practical Guide to Splines, Springer 1978, chapter IV (cubic); F. N. Fritsch, J. Butland, A
method for constructing local monotone piecewise cubic interpolants, SIAM J. Sci. Stat. Comput. 5 (1984) (pchip).
"""

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from itertools import accumulate, pairwise

from servobus.core.units import finite, said
from servobus.core.values import frozen
from servobus.errors import BadValue
from servobus.robots.trajectory.limits import SHORTEST, JointLimits, limits_of, number_of
from servobus.robots.trajectory.path import Demand, Path, Trajectory
from servobus.robots.trajectory.polynomial import Polynomial

_ROUNDS = 10
"""So often segments are stretched and the spline is laid anew, at most; more bring little."""
_SPREADS = (0.6, 0.0)
"""Which part of a stretch, as an exponent, neighbours take over: much for a start that is too sudden for a long motion,
nothing for a single pose that comes too soon. Both are tried."""
_SURPLUS = 1.001
"""Segments are stretched more than they need by this factor: else rounds would come ever closer to the limits."""
_KEPT = 1 + 1e-9
"""What differs by no more than this factor differs by rounding alone."""


class Shape(StrEnum):
    """How a spline passes its poses."""

    CUBIC = "cubic"
    PCHIP = "pchip"
    QUINTIC = "quintic"


@frozen
class Stretch:
    """A segment that lasts longer than it was to, so that limits hold.

    segment  which, counted from 0; between pose `segment` and the one after
    factor   how many times as long it lasts
    demand   what asked for it first: joint, quantity, value, limit
    """

    segment: int
    factor: float
    demand: Demand

    def __str__(self) -> str:
        return (
            f"from pose {self.segment} to {self.segment + 1} the motion takes {self.factor:.2f} times as long"
            f" ({self.demand})"
        )


@frozen
class Fitted:
    """A motion through poses that keeps all limits.

    trajectory  the motion
    times       when it passes each pose, s from the start
    stretches   what was stretched for it, in order of segments; empty where the times given keep all limits
    """

    trajectory: Trajectory
    times: tuple[float, ...]
    stretches: tuple[Stretch, ...]

    @property
    def most(self) -> Stretch | None:
        """The segment stretched by the greatest factor; None where all keep their times."""
        return max(self.stretches, key=lambda one: one.factor, default=None)


def spline(times: Sequence[float], poses: Mapping[str, Sequence[float]], shape: Shape | str) -> Trajectory:
    """Give the motion through poses at their times, whatever limits it exceeds.

    times  s, each after the one before; the motion starts at the first
    poses  joint -> its positions in rad, one for each time
    shape  "cubic", "pchip" or "quintic"

    Raises BadValue for times out of order, fewer than two poses, what is no number, and an unknown shape.
    """
    steps, positions = _check(times, poses)
    return _trajectory(steps, positions, _shape(shape))


def fitted(
    times: Sequence[float],
    poses: Mapping[str, Sequence[float]],
    limits: Mapping[str, JointLimits],
    shape: Shape | str,
) -> Fitted:
    """Give the motion through poses, stretched between those where it would exceed limits, also between the poses.

    Slowing down the whole motion always helps, but one sudden segment would make all of it slow. So segments are
    stretched one by one, each by what it asks for, and the spline is laid anew, as each changes its neighbours, until
    all limits hold. That may need more and more time, or never end; the quickest motion found on the way is given,
    so none is slower than the one that is slowed as a whole. No segment is quicker than its times say.

    Arguments and errors as `spline`; limits is joint -> JointLimits. UnknownName for a joint without.
    """
    kind = _shape(shape)
    given, positions = _check(times, poses)
    checked = limits_of(positions, limits)
    best, asked = list[float](), dict[int, Demand]()
    at_first = _needs(_trajectory(given, positions, kind), checked)
    for spread in _SPREADS:
        steps, asking = given, dict[int, Demand]()
        for _ in range(_ROUNDS):
            if best and sum(steps) >= sum(best):
                break
            needs = at_first if steps is given else _needs(_trajectory(steps, positions, kind), checked)
            worst = max(needs, key=lambda one: one.factor)
            holds = worst.factor <= _KEPT
            slowed = steps if holds else [step * worst.factor for step in steps]
            if not best or sum(slowed) < sum(best):
                best, asked = slowed, asking if holds else dict.fromkeys(range(len(steps)), worst) | asking
            if holds:
                break
            stretches = _spread([(need.factor, need) for need in needs], spread)
            asking = {n: need for n, (factor, need) in enumerate(stretches) if factor > _KEPT} | asking
            steps = [
                step * factor * _SURPLUS if factor > _KEPT else step
                for step, (factor, _) in zip(steps, stretches, strict=True)
            ]
    found = [Stretch(n, best[n] / given[n], need) for n, need in sorted(asked.items())]
    return Fitted(_trajectory(best, positions, kind), (0.0, *accumulate(best)), tuple(found))


def _spread(stretches: list[tuple[float, Demand]], spread: float) -> list[tuple[float, Demand]]:
    """Let neighbours of a segment take over a part of its stretch, their neighbours a part of that, and so on."""
    result = list(stretches)
    for order in (range(1, len(result)), range(len(result) - 2, -1, -1)):
        for segment in order:
            factor, need = result[segment - order.step]
            if factor**spread > result[segment][0]:
                result[segment] = factor**spread, need
    return result


def _needs(trajectory: Trajectory, limits: Mapping[str, JointLimits]) -> list[Demand]:
    """Give for each segment the demand of the joint that asks for most."""
    joints = list(trajectory.paths)
    needs = [path.needs(limits[joint]) for joint, path in trajectory.paths.items()]
    found = list[Demand]()
    for segment, of_joints in enumerate(zip(*needs, strict=True)):
        most = max(range(len(joints)), key=lambda one: of_joints[one][0])
        found.append(Demand.of(joints[most], segment, of_joints[most], limits[joints[most]]))
    return found


def _trajectory(steps: Sequence[float], positions: Mapping[str, list[float]], shape: Shape) -> Trajectory:
    knots = (0.0, *accumulate(steps))
    pieces = _PIECES[shape]
    return Trajectory({joint: Path(knots, pieces(steps, points), points[-1]) for joint, points in positions.items()})


def _cubic(steps: Sequence[float], points: Sequence[float]) -> list[Polynomial]:
    """Lay the cubic spline: its speeds at the poses make the acceleration continuous, and are 0 at both ends.

    At pose i, between the steps l and r and the slopes L and R, v(i-1) / l + 2 v(i) (1/l + 1/r) + v(i+1) / r =
    3 (L / l + R / r). The matrix has three diagonals and is solved by elimination downwards and substitution back.
    """
    slopes = _slopes(steps, points)
    ratios, rests = [0.0], [0.0]  # v(i) = rest(i) - ratio(i) * v(i+1)
    for (left, right), (before, after) in zip(pairwise(steps), pairwise(slopes), strict=True):
        pivot = 2 * (1 / left + 1 / right) - ratios[-1] / left
        rests.append((3 * (before / left + after / right) - rests[-1] / left) / pivot)
        ratios.append(1 / right / pivot)
    speeds = [0.0]
    for ratio, rest in zip(reversed(ratios), reversed(rests), strict=True):
        speeds.append(rest - ratio * speeds[-1])
    return _hermite(steps, points, speeds[::-1])


def _pchip(steps: Sequence[float], points: Sequence[float]) -> list[Polynomial]:
    """Lay the monotone cubic: at a pose where a joint turns round its speed is 0, else a mean of both slopes.

    It is the harmonic mean, weighted by the steps, which never is so large that the spline would swing over.
    """
    slopes, speeds = _slopes(steps, points), [0.0]
    for (left, right), (before, after) in zip(pairwise(steps), pairwise(slopes), strict=True):
        if before > 0 < after or before < 0 > after:
            one, other = 2 * right + left, right + 2 * left
            speeds.append((one + other) / (one / before + other / after))
        else:
            speeds.append(0.0)
    return _hermite(steps, points, [*speeds, 0.0])


def _hermite(steps: Sequence[float], points: Sequence[float], speeds: Sequence[float]) -> list[Polynomial]:
    """Give the cubics with these positions and speeds at their ends."""
    pieces = list[Polynomial]()
    for step, (start, end), (first, last) in zip(steps, pairwise(points), pairwise(speeds), strict=True):
        slope = (end - start) / step
        pieces.append((start, first, (3 * slope - 2 * first - last) / step, (first + last - 2 * slope) / step**2))
    return pieces


def _quintic(steps: Sequence[float], points: Sequence[float]) -> list[Polynomial]:
    """Lay the spline of the fifth degree: jerk and its derivative are continuous, the joint is at rest at both ends.

    A segment of the fifth degree is given by position, speed v and acceleration a at both ends. With l and r the steps
    before and after a pose, and L and R the ways, that the derivative of the jerk and the jerk are continuous is

        168/l³ v(i-1) + 24/l² a(i-1) + (192/l³ + 192/r³) v(i) + (36/r² - 36/l²) a(i) + 168/r³ v(i+1) - 24/r² a(i+1)
            = 360 (L/l⁴ + R/r⁴)
        -24/l² v(i-1) - 3/l a(i-1) + (36/r² - 36/l²) v(i) + (9/l + 9/r) a(i) + 24/r² v(i+1) - 3/r a(i+1)
            = 60 (R/r³ - L/l³)

    These are the derivatives of the integral of jerk² with respect to v(i) and a(i), so the matrix is symmetric and
    positive definite, and elimination by blocks of two rows needs no search for pivots.
    """
    ways = [end - start for start, end in pairwise(points)]
    # (v, a)(i) = rest(i) - ratio(i) · (v, a)(i+1), with ratio a matrix of 2 x 2, row by row
    rows: list[tuple[_Matrix, _Vector]] = [((0.0, 0.0, 0.0, 0.0), (0.0, 0.0))]
    for (left, right), (before, after) in zip(pairwise(steps), pairwise(ways), strict=True):
        below: _Matrix = (168 / left**3, 24 / left**2, -24 / left**2, -3 / left)
        above: _Matrix = (168 / right**3, -24 / right**2, 24 / right**2, -3 / right)
        mixed = 36 / right**2 - 36 / left**2
        middle: _Matrix = (192 / left**3 + 192 / right**3, mixed, mixed, 9 / left + 9 / right)
        wanted = 360 * (before / left**4 + after / right**4), 60 * (after / right**3 - before / left**3)
        ratio, rest = rows[-1]
        inverse = _inverse(_minus(middle, _times(below, ratio)))
        carried = _applied(below, rest)
        rows.append((_times(inverse, above), _applied(inverse, (wanted[0] - carried[0], wanted[1] - carried[1]))))
    states: list[_Vector] = [(0.0, 0.0)]
    for ratio, (speed, acceleration) in reversed(rows):
        carried = _applied(ratio, states[-1])
        states.append((speed - carried[0], acceleration - carried[1]))
    pieces = list[Polynomial]()
    for h, start, way, ((v, a), (w, b)) in zip(steps, points, ways, pairwise(reversed(states)), strict=False):
        # the polynomial of the fifth degree from position, speed and acceleration at both ends
        third = (20 * way - (8 * w + 12 * v) * h - (3 * a - b) * h**2) / (2 * h**3)
        fourth = (-30 * way + (14 * w + 16 * v) * h + (3 * a - 2 * b) * h**2) / (2 * h**4)
        fifth = (12 * way - 6 * (w + v) * h - (a - b) * h**2) / (2 * h**5)
        pieces.append((start, v, a / 2, third, fourth, fifth))
    return pieces


_Matrix = tuple[float, float, float, float]
_Vector = tuple[float, float]


def _times(one: _Matrix, other: _Matrix) -> _Matrix:
    (a, b, c, d), (e, f, g, h) = one, other
    return a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h


def _applied(matrix: _Matrix, vector: _Vector) -> _Vector:
    (a, b, c, d), (x, y) = matrix, vector
    return a * x + b * y, c * x + d * y


def _minus(one: _Matrix, other: _Matrix) -> _Matrix:
    (a, b, c, d), (e, f, g, h) = one, other
    return a - e, b - f, c - g, d - h


def _inverse(matrix: _Matrix) -> _Matrix:
    a, b, c, d = matrix
    determinant = a * d - b * c
    return d / determinant, -b / determinant, -c / determinant, a / determinant


_PIECES: dict[Shape, Callable[[Sequence[float], Sequence[float]], list[Polynomial]]] = {
    Shape.CUBIC: _cubic,
    Shape.PCHIP: _pchip,
    Shape.QUINTIC: _quintic,
}


def _slopes(steps: Sequence[float], points: Sequence[float]) -> list[float]:
    return [(end - start) / step for step, (start, end) in zip(steps, pairwise(points), strict=True)]


def _shape(shape: Shape | str) -> Shape:
    try:
        return Shape(shape)
    except ValueError:
        raise BadValue(f"{said(shape)} is no shape of a motion: use {', '.join(Shape)}") from None


def _check(times: Sequence[float], poses: Mapping[str, Sequence[float]]) -> tuple[list[float], dict[str, list[float]]]:
    """Give the time between poses and the positions of each joint. Raises BadValue."""
    if len(times) < 2 or not poses:
        raise BadValue("a motion passes two poses or more, of one joint or more: give a time and positions for each")
    seconds = list[float]()
    for index, time in enumerate(times):
        number = finite(time)
        if number is None:
            raise BadValue(f"pose {index}: {said(time)} is no time: give seconds")
        if seconds and number - seconds[-1] < SHORTEST / _KEPT:
            raise BadValue(
                f"pose {index} at {number:g} s does not come after pose {index - 1} at {seconds[-1]:g} s: give each"
                f" pose a time {SHORTEST:g} s or more after the one before"
            )
        seconds.append(number)
    positions = {}
    for joint, given in poses.items():
        if len(given) != len(times):
            raise BadValue(f"{joint} has {len(given)} positions for {len(times)} times: give one for each time")
        positions[joint] = [number_of(joint, f"position of pose {index}", one) for index, one in enumerate(given)]
    return [after - before for before, after in pairwise(seconds)], positions
