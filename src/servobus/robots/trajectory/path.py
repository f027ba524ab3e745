"""Paths and trajectories: position, speed and acceleration of joints at any time.

A path is what one joint does, made of polynomials of time one after another; a trajectory is the paths of several
joints, by name, that start and end together. Time is in seconds from the start, positions are in radians in the
joint's own space (zero, direction and gear of servos play no part here). Before the start and after the end a joint
rests.
"""

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import TypeAlias

from servobus.core.units import deg, finite, said
from servobus.core.values import frozen
from servobus.errors import BadValue, UnknownName
from servobus.robots.trajectory.limits import JointLimits, limits_of
from servobus.robots.trajectory.polynomial import Polynomial, at_most, derivative, extrema, largest

QUANTITIES = ("position", "speed", "acceleration", "jerk")
"""What `extremes` is asked for: each is the derivative of the one before."""
Need: TypeAlias = tuple[float, int, float, float]
"""What a polynomial asks of limits, in short: factor, order of the derivative, value, time. See `Demand`."""
SLOWED = (1e-3, 1e20)
"""Factors by which a motion may be slowed; *assumption*: ample, and no number leaves the range of float."""
CLOSE = 1e-9
"""rad; positions that differ by less are the same."""


@frozen
class State:
    """Where a joint is and how it moves at one instant: rad, rad/s, rad/s²."""

    position: float
    speed: float = 0.0
    acceleration: float = 0.0


@frozen
class Extreme:
    """The lowest or highest value of a quantity, and the first time at which the joint has it, in s."""

    value: float
    time: float


@frozen
class Demand:
    """How much of its limits a motion asks for.

    factor    the motion keeps all limits if it lasts this many times as long; at most 1: it keeps them as it is
    joint     the joint that asks for most
    segment   the polynomial in which it does, counted from 0; between poses: the pose before
    quantity  what it asks for: "speed", "acceleration" or "jerk"
    value     how much of it, rad/s, rad/s² or rad/s³
    limit     how much of it the joint may
    time      when, s from the start
    """

    factor: float
    joint: str
    segment: int
    quantity: str
    value: float
    limit: float
    time: float

    @classmethod
    def of(cls, joint: str, segment: int, need: "Need", limits: JointLimits) -> "Demand":
        factor, order, value, time = need
        quantity = QUANTITIES[order]
        return cls(factor, joint, segment, quantity, value, getattr(limits, quantity), time)

    def __str__(self) -> str:
        unit = {"speed": "°/s", "acceleration": "°/s²", "jerk": "°/s³"}[self.quantity]
        than = "more than" if self.factor > 1 else "within"
        return (
            f"{self.joint}: {self.quantity} {self.value / deg:.4g}{unit} at {self.time:.3f} s"
            f" is {than} {self.limit / deg:.4g}{unit}"
        )


class Path:
    """What one joint does from 0 to `duration`.

    knots   times at which one polynomial ends and the next begins, from 0 to the duration
    pieces  the polynomials, each in the time since its own knot
    goal    the position at the end, exactly
    """

    __slots__ = ("duration", "goal", "knots", "pieces", "start")

    def __init__(self, knots: Sequence[float], pieces: Sequence[Polynomial], goal: float) -> None:
        self.knots, self.pieces = tuple(knots), tuple(pieces)
        self.duration = self.knots[-1]
        self.goal = goal
        self.start = self.pieces[0][0] if pieces else goal

    def at(self, time: float) -> State:
        """Give the state of the joint at a time in s, from the right where the acceleration jumps."""
        if time >= self.duration:
            return State(self.goal)
        if not time >= 0:
            return State(self.start)
        index = bisect_right(self.knots, time) - 1
        local = time - self.knots[index]
        position = speed = half = 0.0
        for coefficient in reversed(self.pieces[index]):  # Horner's scheme for a polynomial and its derivatives
            half = half * local + speed
            speed = speed * local + position
            position = position * local + coefficient
        return State(position, speed, 2 * half)

    def extremes(self, quantity: str = "position") -> tuple[Extreme, Extreme]:
        """Give the lowest and the highest value that one of QUANTITIES takes at any instant.

        They are found from the roots of derivatives, not by sampling. Where a quantity jumps, both sides count; the
        jump itself counts for nothing, although a jump of acceleration is a jerk without bound.
        """
        order = _order(quantity)
        found = [Extreme(value, time) for index in range(len(self.pieces)) for value, time in self._turns(index, order)]
        if not found:
            still = Extreme(0.0 if order else self.goal, 0.0)
            return still, still
        return min(found, key=lambda one: one.value), max(found, key=lambda one: one.value)

    def peak(self, quantity: str) -> Extreme:
        """Give the greatest magnitude of one of QUANTITIES, as a positive value, and its time."""
        low, high = self.extremes(quantity)
        return high if high.value >= -low.value else Extreme(-low.value, low.time)

    def slowed(self, factor: float) -> "Path":
        """Give the same path in `factor` times the time: speed / factor, acceleration / factor², jerk / factor³."""
        return self._scaled(factor, self.duration * factor)

    def lasting(self, duration: float) -> "Path":
        """Give the same path in exactly this time, in s. A path that goes nowhere in no time rests that long."""
        if not self.pieces:
            return standing(self.goal, duration)
        return self._scaled(duration / self.duration, duration)

    def then(self, other: "Path") -> "Path":
        """Give this path and another one after it; the other begins where this one ends."""
        knots = [*self.knots, *(self.duration + knot for knot in other.knots[1:])]
        return Path(knots, [*self.pieces, *other.pieces], other.goal)

    def needs(self, limits: JointLimits) -> list["Need"]:
        """Give for each polynomial what it asks of the limits: the quantity that would need the longest time.

        The factors follow from what slowing down does to speed, acceleration and jerk: v / V, √(a / A), ∛(j / J).
        """
        bounds = [limits.speed, limits.acceleration, *([] if limits.jerk is None else [limits.jerk])]
        found = list[Need]()
        for piece, (begin, end) in zip(self.pieces, pairwise(self.knots), strict=True):
            most: Need = 0.0, 1, 0.0, begin
            rate = derivative(piece)
            for order, limit in enumerate(bounds, 1):
                slope = derivative(rate)
                if at_most(rate, end - begin) > limit * most[0] ** order:  # else it asks for less, whatever it is
                    size, time = largest(rate, slope, end - begin)
                    factor = size / limit if order == 1 else (size / limit) ** (1 / order)
                    if factor > most[0]:
                        most = factor, order, size, begin + time
                rate = slope
            found.append(most)
        return found

    def _turns(self, index: int, order: int) -> list[tuple[float, float]]:
        begin, end = self.knots[index], self.knots[index + 1]
        turns = extrema(derivative(self.pieces[index], order), end - begin)
        return [(value, begin + time) for value, time in turns]

    def _scaled(self, factor: float, duration: float) -> "Path":
        pieces = [tuple(number / factor**power for power, number in enumerate(piece)) for piece in self.pieces]
        return Path([*(knot * factor for knot in self.knots[:-1]), duration], pieces, self.goal)


class Trajectory:
    """The paths of several joints, by name, all of the same duration."""

    __slots__ = ("duration", "paths")

    def __init__(self, paths: Mapping[str, Path]) -> None:
        if not paths:
            raise BadValue("a trajectory of no joint: name at least one")
        durations = {path.duration for path in paths.values()}
        if len(durations) > 1:
            raise BadValue(f"the paths last {', '.join(f'{one:g} s' for one in sorted(durations))}: give them one time")
        self.paths: Mapping[str, Path] = MappingProxyType(dict(paths))
        self.duration = durations.pop()

    @property
    def start(self) -> dict[str, float]:
        """Joint -> position at the start, in rad."""
        return {joint: path.start for joint, path in self.paths.items()}

    @property
    def goal(self) -> dict[str, float]:
        """Joint -> position at the end, in rad."""
        return {joint: path.goal for joint, path in self.paths.items()}

    def at(self, time: float) -> dict[str, State]:
        """Give the states of all joints at a time in s from the start."""
        return {joint: path.at(time) for joint, path in self.paths.items()}

    def slowed(self, factor: float) -> "Trajectory":
        """Give the same motion in `factor` times the time: 2 is slow motion at half the speed."""
        times = finite(factor)
        if times is None or not SLOWED[0] <= times <= SLOWED[1]:
            raise BadValue(
                f"{said(factor)} is no factor of time: give {SLOWED[0]:g} to {SLOWED[1]:g}, 2 for half the speed"
            )
        return Trajectory({joint: path.slowed(times) for joint, path in self.paths.items()})

    def then(self, *others: "Trajectory") -> "Trajectory":
        """Give this motion and others after it, each beginning where the one before ends. Raises BadValue."""
        paths = dict(self.paths)
        for other in others:
            if paths.keys() != other.paths.keys():
                odd = ", ".join(sorted(paths.keys() ^ other.paths.keys()))
                raise BadValue(f"two motions in a row have the same joints, and only one of them has {odd}")
            for joint, path in other.paths.items():
                end = paths[joint].goal
                if abs(end - path.start) > CLOSE:
                    raise BadValue(
                        f"{joint}: the next motion begins at {path.start / deg:.3f}°, and the one before ends at"
                        f" {end / deg:.3f}°: put a move between them"
                    )
                paths[joint] = paths[joint].then(path)
        return Trajectory(paths)

    def demand(self, limits: Mapping[str, JointLimits]) -> Demand:
        """Give what the motion asks of the limits most; `slowed(demand.factor)` keeps all limits.

        Raises UnknownName for a joint without limits.
        """
        checked = limits_of(self.paths, limits)
        most: tuple[Need, str, int] = (0.0, 1, 0.0, 0.0), next(iter(self.paths)), 0
        for joint, path in self.paths.items():
            for segment, need in enumerate(path.needs(checked[joint])):
                most = max(most, (need, joint, segment), key=lambda one: one[0][0])
        need, joint, segment = most
        return Demand.of(joint, segment, need, checked[joint])

    def stretched(self, limits: Mapping[str, JointLimits]) -> "Trajectory":
        """Give the same motion, slowed as a whole as far as the limits ask for it, and no quicker than it is."""
        factor = self.demand(limits).factor
        return self.slowed(factor) if factor > 1 else self

    def check_positions(self, bounds: Mapping[str, tuple[float, float]]) -> None:
        """Raise BadValue if a joint leaves its lowest or highest position, in rad, at any instant.

        Splines may swing beyond their poses; the sentence names joint, position and time. Joints without bounds go
        anywhere.
        """
        for joint, path in self.paths.items():
            if joint not in bounds:
                continue
            low, high = bounds[joint]
            lowest, highest = path.extremes()
            for extreme, word, bound, gone in (
                (lowest, "below", low, low - lowest.value),
                (highest, "above", high, highest.value - high),
            ):
                if gone > CLOSE:
                    raise BadValue(
                        f"{joint}: {extreme.value / deg:.2f}° at {extreme.time:.3f} s is {word} the limit"
                        f" {bound / deg:.2f}°: move the poses about that time, or take shape pchip, which does not"
                        " swing beyond poses"
                    )


def standing(position: float, duration: float) -> Path:
    """Give the path of a joint that rests at a position for a time in s."""
    return Path((0.0, duration), ((position,),), position) if duration > 0 else Path((0.0,), (), position)


def resting(positions: Mapping[str, float], duration: float) -> Trajectory:
    """Give the trajectory of joints that rest at their positions for a time in s: a pause between two motions."""
    return Trajectory({joint: standing(position, duration) for joint, position in positions.items()})


def of_durations(pieces: Iterable[tuple[float, Polynomial]], goal: float) -> Path:
    """Make a path of (duration, polynomial) one after another; those too short to be seen are left out."""
    knots, polynomials = [0.0], []
    for duration, polynomial in pieces:
        if knots[-1] + duration > knots[-1]:
            knots.append(knots[-1] + duration)
            polynomials.append(polynomial)
    return Path(knots, polynomials, goal)


def same_joints(first: Mapping[str, float], second: Mapping[str, float], words: tuple[str, str]) -> None:
    """Raise UnknownName unless two mappings have the same joints."""
    for names, others, word in ((first, second, words[1]), (second, first, words[0])):
        missing = [joint for joint in names if joint not in others]
        if missing:
            raise UnknownName(f"{', '.join(missing)}: there is no {word} of that joint; give one")


def _order(quantity: str) -> int:
    if quantity not in QUANTITIES:
        raise UnknownName(f"{quantity!r} is not a quantity of a path: use {', '.join(QUANTITIES)}")
    return QUANTITIES.index(quantity)
