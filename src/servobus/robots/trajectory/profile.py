"""Moves from rest to rest: double S, trapezoid and quintic, and several joints that start and arrive together.

    double S   the quickest move under limits of speed, acceleration and jerk
    trapezoid  the quickest move under limits of speed and acceleration: the speed drawn over time is a trapezoid
    quintic    the move of a given time with the least integral of jerk², a polynomial of the fifth degree

Formulas: L. Biagiotti, C. Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, sections
2.1.7 (quintic), 3.2 (trapezoid) and 3.4 (double S), here for speed 0 at both ends; T. Flash, N. Hogan, The
coordination of arm movements, J. Neuroscience 5 (1985), for the least jerk.
"""

import math
from collections.abc import Mapping

from servobus.core.units import deg, finite, said
from servobus.errors import BadValue
from servobus.robots.trajectory.limits import NEAREST, SHORTEST, JointLimits, limits_of, number_of
from servobus.robots.trajectory.path import Demand, Path, Trajectory, of_durations, same_joints, standing
from servobus.robots.trajectory.polynomial import value

_PEAKS = (15 / 8, 10 / math.sqrt(3), 60.0)
"""Greatest speed, acceleration and jerk of the quintic from 0 to 1 in the time 1."""
_ROUNDING = 1e-9
"""Share by which a limit may seem to be exceeded for rounding alone."""


def quickest(start: float, goal: float, limits: JointLimits) -> Path:
    """Give the quickest move of one joint from rest to rest: double S, or a trapezoid where no jerk is given."""
    return trapezoid(start, goal, limits) if limits.jerk is None else double_s(start, goal, limits)


def trapezoid(start: float, goal: float, limits: JointLimits) -> Path:
    """Give the quickest move under limits of speed V and acceleration A; a limit of jerk is left aside.

    A move over the distance d takes d / V + V / A where it reaches V, which is where d ≥ V² / A, else 2 √(d / A).
    """
    distance, sign = abs(goal - start), math.copysign(1.0, goal - start)
    if distance < NEAREST:
        return standing(goal, 0.0)
    rise = min(limits.speed / limits.acceleration, math.sqrt(distance / limits.acceleration))
    cruise = max(0.0, distance / (rise * limits.acceleration) - rise)
    push = sign * limits.acceleration
    return _phases(start, goal, (rise, 0.0, push), (cruise, 0.0, 0.0), (rise, 0.0, -push))


def double_s(start: float, goal: float, limits: JointLimits) -> Path:
    """Give the quickest move under limits of speed V, acceleration A and jerk J, which is asked for.

    Reaching the speed v takes v / A + A / J where A is reached on the way, which is where v ≥ A² / J, else 2 √(v / J);
    the way until then is v / 2 times that time. The speed reached is V, or the one at which two such ways are the
    whole distance d: then v² / A + v A / J = d, or, without reaching A, J (d / 2J)^(2/3).
    """
    if limits.jerk is None:
        raise BadValue("a double S needs a limit of jerk in rad/s³: give one, or take the trapezoid")
    distance, sign = abs(goal - start), math.copysign(1.0, goal - start)
    if distance < NEAREST:
        return standing(goal, 0.0)
    speed, push, jerk = limits.speed, limits.acceleration, limits.jerk
    ramp = min(push / jerk, math.sqrt(speed / jerk), math.cbrt(distance / (2 * jerk)))
    """How long the jerk lasts."""
    if ramp < push / jerk:
        hold = 0.0
    else:
        by_distance = (math.sqrt(ramp**2 + 4 * distance / push) - ramp) * push / 2
        hold = max(0.0, min(speed, by_distance) / push - ramp)
    reached = jerk * ramp * (ramp + hold)
    cruise = max(0.0, distance / reached - (2 * ramp + hold))
    jerk, push = sign * jerk, sign * jerk * ramp
    rise = (ramp, jerk, 0.0), (hold, 0.0, push), (ramp, -jerk, push)
    fall = (ramp, -jerk, 0.0), (hold, 0.0, -push), (ramp, jerk, -push)
    return _phases(start, goal, *rise, (cruise, 0.0, 0.0), *fall)


def quintic(start: float, goal: float, time: float) -> Path:
    """Give the move with the least jerk in a time T in s: start + d (10 s³ - 15 s⁴ + 6 s⁵) with s = t / T.

    Its greatest speed is 15/8 d/T, its greatest acceleration 10/√3 d/T², its greatest jerk 60 d/T³.
    """
    distance = goal - start
    cubed = distance / time**3
    return Path((0.0, time), ((start, 0.0, 0.0, 10 * cubed, -15 * cubed / time, 6 * cubed / time**2),), goal)


def quintic_time(distance: float, limits: JointLimits) -> float:
    """Give the shortest time in s in which a quintic over a distance keeps the limits."""
    bounds = [limits.speed, limits.acceleration, *([] if limits.jerk is None else [limits.jerk])]
    return max(
        math.pow(peak * abs(distance) / bound, 1 / order)
        for order, (peak, bound) in enumerate(zip(_PEAKS, bounds, strict=False), 1)
    )


def synchronised(
    starts: Mapping[str, float],
    goals: Mapping[str, float],
    limits: Mapping[str, JointLimits],
    time: float | None = None,
) -> Trajectory:
    """Plan a move of several joints from rest to rest that start and arrive together.

    starts, goals  joint -> position in rad; both have the same joints
    limits         joint -> its limits; without a jerk the joint moves in a trapezoid of speed
    time           s; None: as quickly as the slowest joint can, and the others are slowed down to its time

    With a time each joint moves with the least jerk (quintic). Raises BadValue if a limit would be exceeded, with the
    shortest time that keeps all, and for what is no number; UnknownName for joints that lack a goal or limits.
    """
    same_joints(starts, goals, ("start", "goal"))
    checked = limits_of(starts, limits)
    begin = {joint: number_of(joint, "start", start) for joint, start in starts.items()}
    end = {joint: number_of(joint, "goal", goals[joint]) for joint in starts}
    if time is not None:
        _check_time(begin, end, checked, time)
        return Trajectory({joint: quintic(begin[joint], end[joint], time) for joint in begin})
    paths = {joint: quickest(begin[joint], end[joint], checked[joint]) for joint in begin}
    longest = max((path.duration for path in paths.values()), default=0.0)
    return Trajectory({joint: path.lasting(longest) for joint, path in paths.items()})


def _check_time(
    begin: Mapping[str, float], end: Mapping[str, float], limits: Mapping[str, JointLimits], time: float
) -> None:
    seconds = finite(time)
    if seconds is None or not seconds >= SHORTEST:
        raise BadValue(f"{said(time)} is no time for a move: give seconds, {SHORTEST:g} or more")
    needed = {joint: quintic_time(end[joint] - begin[joint], limits[joint]) for joint in begin}
    slowest = max(needed, key=lambda joint: needed[joint])
    if needed[slowest] > seconds * (1 + _ROUNDING):
        (need,) = quintic(begin[slowest], end[slowest], seconds).needs(limits[slowest])
        worst = Demand.of(slowest, 0, need, limits[slowest])
        raise BadValue(
            f"{slowest} cannot move from {begin[slowest] / deg:.1f}° to {end[slowest] / deg:.1f}° in {seconds:g} s"
            f" ({worst}): give time={math.ceil(needed[slowest] * 1000) / 1000:g} or more, or no time"
        )


def _phases(start: float, goal: float, *phases: tuple[float, float, float]) -> Path:
    """Make a path of phases (duration, jerk, acceleration at the beginning), one after another, from rest."""
    position, speed, pieces = start, 0.0, []
    for duration, jerk, acceleration in phases:
        piece = (position, speed, acceleration / 2, jerk / 6)
        pieces.append((duration, piece))
        position, speed = value(piece, duration), speed + (acceleration + jerk * duration / 2) * duration
    return of_durations(pieces, goal)
