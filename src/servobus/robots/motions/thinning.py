"""From a recording to a motion: what was lost is told, what is needless is left out.

A recording has a reading every few milliseconds, with the noise of the encoder in each; a motion through all of them
would tremble, and takes long to plan. `thinned` keeps the fewest poses it finds such that the curve through them passes
each reading within a tolerance; noise that is smaller than it goes with the others.
"""

from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

from servobus.core.arguments import check_above_0
from servobus.core.units import deg, show
from servobus.core.values import frozen
from servobus.errors import UsageError
from servobus.robots.joints.joint import Joint
from servobus.robots.motions.motion import Motion
from servobus.robots.motions.recording import Moment
from servobus.robots.motions.supervision import jumped
from servobus.robots.trajectory.spline import spline

TOLERANCE = 1 * deg
"""rad; *assumption*: three units of the coarsest encoders here, and less than the play of their gears."""
GAP = 0.25
"""s between two readings up to which those between them that were lost are interpolated; *assumption*: a hand does not
turn round within it."""
MANY = 3
"""Times that are told one by one."""
_SHAPE = "pchip"
"""It never swings beyond what was taught."""


@frozen
class Kept:
    """A motion of a recording, and what was done to get it.

    motion        the motion
    readings      moments of the recording
    interpolated  joint -> readings that were lost for so short that they lie between their neighbours
    left_out      moments left out, because a joint was lost for longer
    clamped       joint -> rad by which it was outside its limits at most: it stays at the limit there
    jumps         joint -> when it was seen somewhere else than a hand could have turned it, s
    """

    motion: Motion
    readings: int
    interpolated: Mapping[str, int]
    left_out: int
    clamped: Mapping[str, float]
    jumps: Mapping[str, tuple[float, ...]]

    @property
    def notes(self) -> list[str]:
        """What a person should know, a sentence each."""
        said = [
            f"{joint}: {count} lost readings lie between their neighbours" for joint, count in self.interpolated.items()
        ]
        if self.left_out:
            said.append(f"{self.left_out} of {self.readings} moments are left out, because a joint did not answer")
        said += [
            f"{joint} was up to {show(angle, 'rad')} outside its limits, and is kept within them"
            for joint, angle in self.clamped.items()
        ]
        said += [
            f"{joint} jumped at {', '.join(f'{time:.2f} s' for time in times[:MANY])}"
            f"{', and so on' if len(times) > MANY else ''}: look at its cable and its servo, and at the motion before "
            "you play it"
            for joint, times in self.jumps.items()
        ]
        return said


def kept(moments: Sequence[Moment], joints: Iterable[Joint], tolerance: float = TOLERANCE) -> Kept:
    """Make a motion of a recording of these joints.

    Raises UsageError where a joint was not recorded, or where fewer than two moments are whole.
    """
    wanted = {joint.name: joint for joint in joints}
    for name in wanted:
        if not any(name in moment.positions for moment in moments):
            raise UsageError(f"{name}: there is no reading of it in the recording")
    columns: dict[str, list[float | None]] = {}
    interpolated: dict[str, int] = {}
    for name in wanted:
        columns[name] = _filled([(moment.time, moment.positions.get(name)) for moment in moments])
        count = sum(
            angle is not None and name not in moment.positions
            for angle, moment in zip(columns[name], moments, strict=True)
        )
        interpolated |= {name: count} if count else {}
    whole = [n for n in range(len(moments)) if all(column[n] is not None for column in columns.values())]
    if len(whole) < 2:
        raise UsageError("a motion has at least two moments at which all its joints answered")
    clamped: dict[str, float] = {}
    poses: dict[str, tuple[float, ...]] = {}
    for name, joint in wanted.items():
        low, high = joint.limits
        angles = [angle for n in whole if (angle := columns[name][n]) is not None]
        outside = max(low - min(angles), max(angles) - high)
        clamped |= {name: outside} if outside > 0 else {}
        poses[name] = tuple(min(max(angle, low), high) for angle in angles)
    motion = Motion(tuple(moments[n].time - moments[whole[0]].time for n in whole), poses, _SHAPE)
    jumps = {name: times for name in wanted if (times := _jumps(name, moments))}
    return Kept(thinned(motion, tolerance), len(moments), interpolated, len(moments) - len(whole), clamped, jumps)


def _jumps(name: str, moments: Sequence[Moment]) -> tuple[float, ...]:
    readings = [(moment.time, moment.positions[name]) for moment in moments if name in moment.positions]
    return tuple(time for (begun, before), (time, after) in pairwise(readings) if jumped(before, after, time - begun))


def _filled(readings: Sequence[tuple[float, float | None]]) -> list[float | None]:
    """Put what lies between two readings in place of those that were lost, where they are no farther apart than GAP."""
    filled = [angle for _, angle in readings]
    there = [n for n, angle in enumerate(filled) if angle is not None]
    for first, last in pairwise(there):
        (begin, before), (end, after) = readings[first], readings[last]
        if last - first > 1 and end - begin <= GAP and before is not None and after is not None:
            for n in range(first + 1, last):
                filled[n] = before + (after - before) * (readings[n][0] - begin) / (end - begin)
    return filled


def thinned(motion: Motion, tolerance: float = TOLERANCE) -> Motion:
    """Leave out poses that the curve through the others passes within the tolerance, rad.

    First as Ramer, Douglas and Peucker do with straight lines, over all joints at once; then the pose that the curve
    itself misses most is put back in each segment, until it misses none by more. First and last pose stay.
    """
    bound = check_above_0("tolerance", tolerance)
    keep = _by_lines(motion, bound)
    while True:
        chosen = sorted(keep)
        curve = spline(
            [motion.times[n] for n in chosen],
            {name: [angles[n] for n in chosen] for name, angles in motion.poses.items()},
            motion.shape,
        )
        missed: dict[int, tuple[float, int]] = {}
        for name, path in curve.paths.items():
            angles = motion.poses[name]
            for n, moment in enumerate(motion.times):
                if n not in keep and (by := abs(path.at(moment - motion.times[0]).position - angles[n])) > bound:
                    segment = bisect_left(chosen, n)
                    missed[segment] = max(missed.get(segment, (0.0, 0)), (by, n))
        if not missed:
            break
        keep |= {n for _, n in missed.values()}
    return Motion(
        tuple(motion.times[n] for n in chosen),
        {name: tuple(angles[n] for n in chosen) for name, angles in motion.poses.items()},
        motion.shape,
        motion.loop,
    )


def _by_lines(motion: Motion, bound: float) -> set[int]:
    """Give the poses to keep such that straight lines between them pass all others within the bound."""
    times, last = motion.times, len(motion.times) - 1
    keep, open_ = {0, last}, [(0, last)]
    while open_:
        first, end = open_.pop()
        worst, at = bound, 0
        span = times[end] - times[first]
        for angles in motion.poses.values():
            start, slope = angles[first], (angles[end] - angles[first]) / span
            for n in range(first + 1, end):
                by = abs(start + slope * (times[n] - times[first]) - angles[n])
                if by > worst:
                    worst, at = by, n
        if at:
            keep.add(at)
            open_ += [(first, at), (at, end)]
    return keep
