"""Motions: poses of joints and the times at which they are reached, from a robot file or from a table of samples.

A table of samples is text that people read and programs write, CSV with one line for each moment:

    time,shoulder,elbow
    0.00,0.0,-45.0
    0.02,0.3,-44.6

Times are in s, each later than the one before, angles in degrees of the joint.
"""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from servobus.core.units import deg, show
from servobus.core.values import frozen
from servobus.errors import BadValue, UsageError
from servobus.robots.file.entries import MotionEntry, RobotFile
from servobus.robots.file.kinds import Measured
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.spline import Fitted, fitted

if TYPE_CHECKING:
    from servobus.robots.joints.joint import Joint

SPEED, ACCELERATION = 180 * deg, 720 * deg
"""rad/s and rad/s² of a joint of which the file says nothing; *assumption*: brisk, and within what small arms bear."""
TIME = "time"
"""Heading of the first column of a table of samples."""
_ANGLE = Measured("rad", "90deg")
_HALF = 0.0005 * deg + 1e-9
"""rad by which an angle in a table of samples may be rounded: it has thousandths of a degree."""


@frozen
class Motion:
    """A motion of joints through poses.

    times   s, each later than the one before
    poses   joint -> its angle at each of these times, rad
    shape   curve through the poses: "cubic", "quintic" or "pchip"; see servobus.robots.trajectory.spline
    loop    whether it begins again where it ends
    """

    times: tuple[float, ...]
    poses: Mapping[str, tuple[float, ...]]
    shape: str = "pchip"
    loop: bool = False

    @property
    def start(self) -> dict[str, float]:
        """The first pose: joint -> angle, rad."""
        return {joint: angles[0] for joint, angles in self.poses.items()}

    def fitted(self, joints: Sequence["Joint"]) -> Fitted:
        """Plan the motion, slower where it would exceed limits of speed, acceleration or jerk, also between the poses.

        Raises BadValue where a joint would leave its limits, between the poses too.
        """
        by_name = {joint.name: joint for joint in joints}
        plan = fitted(self.times, self.poses, {name: limits_of(by_name[name]) for name in self.poses}, self.shape)
        plan.trajectory.check_positions({name: by_name[name].limits for name in self.poses})
        return plan


def limits_of(joint: "Joint") -> JointLimits:
    """Give the greatest speed, acceleration and jerk of a joint: those of the file, else the defaults here."""
    entry = joint.entry
    return JointLimits(entry.speed or SPEED, entry.acceleration or ACCELERATION, entry.jerk)


def motion_of(file: RobotFile, name: str) -> Motion:
    """Give a motion of a robot file. Raises UnknownName through the file, UsageError for a wrong table of samples."""
    entry = file.motions[name]
    if entry.file is None:
        return _of_steps(file, entry)
    beside = Path() if file.path is None else file.path.parent
    motion = read_samples(beside / entry.file)
    unknown = [joint for joint in motion.poses if joint not in file.joints]
    if unknown:
        raise UsageError(f"{entry.file}: {file.name} has no joint {unknown[0]!r}; there are {', '.join(file.joints)}")
    poses = {
        joint: tuple(_rounded_back(angle, *file.joints[joint].range) for angle in angles)
        for joint, angles in motion.poses.items()
    }
    return Motion(motion.times, poses, entry.path, entry.loop)


def _rounded_back(angle: float, low: float, high: float) -> float:
    """Give the limit for an angle that misses it by no more than a table of samples rounds."""
    if low - _HALF <= angle < low:
        return low
    return high if high < angle <= high + _HALF else angle


def _of_steps(file: RobotFile, entry: MotionEntry) -> Motion:
    """Make a motion of steps; a joint that a step does not name stays where the step before had it."""
    poses: list[dict[str, float]] = []
    for step in entry.steps:
        named = dict(file.poses[step.pose]) if step.pose is not None else {}
        named |= {joint: _ANGLE.read(angle) for joint, angle in step.joints.items()}
        poses.append({**(poses[-1] if poses else {}), **named})
    names = list(poses[-1])
    if late := next((name for name in names if name not in poses[0]), None):
        raise UsageError(f"{file.name}: [motion.{entry.name}] {late} has no angle in the first step; give it one there")
    times = tuple(step.time for step in entry.steps)
    return Motion(times, {name: tuple(pose[name] for pose in poses) for name in names}, entry.path, entry.loop)


def read_samples(path: Path) -> Motion:
    """Read a table of samples. Raises UsageError with file, line and remedy."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror or error}") from None
    return samples_of(text, str(path))


def samples_of(text: str, name: str) -> Motion:
    """Read the text of a table of samples; see the head of this module."""
    rows = list(csv.reader(io.StringIO(text)))
    if not rows or [cell.strip() for cell in rows[0][:1]] != [TIME] or len(rows[0]) < 2:
        raise UsageError(f"{name}:1: the first line names the columns, such as {TIME},shoulder,elbow")
    joints = [cell.strip() for cell in rows[0][1:]]
    if twice := next((joint for joint in joints if joints.count(joint) > 1), None):
        raise UsageError(f"{name}:1: {twice} stands there twice; leave one out")
    times: list[float] = []
    angles: list[list[float]] = []
    for line, row in enumerate(rows[1:], 2):
        if not row:
            continue
        try:
            moment, *degrees = (float(cell) for cell in row)
        except ValueError as error:
            raise UsageError(f"{name}:{line}: {error}; write the time in s, then angles in degrees") from None
        if len(degrees) != len(joints) or not all(map(math.isfinite, [moment, *degrees])):
            raise UsageError(
                f"{name}:{line}: write the time and {len(joints)} angles, one for each of {', '.join(joints)}"
            )
        if times and not moment > times[-1]:
            raise UsageError(f"{name}:{line}: the time {moment:g} s is not later than the one before it")
        times.append(moment)
        angles.append([angle * deg for angle in degrees])
    if len(times) < 2:
        raise UsageError(f"{name}: a motion has at least two moments")
    return Motion(tuple(times), {joint: tuple(row[n] for row in angles) for n, joint in enumerate(joints)})


def samples_text(motion: Motion) -> str:
    """Write a motion as a table of samples."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([TIME, *motion.poses])
    for n, moment in enumerate(motion.times):
        writer.writerow([f"{moment:.4f}", *(f"{angles[n] / deg:.3f}" for angles in motion.poses.values())])
    return out.getvalue()


def check_known(motion: Motion, joints: Sequence["Joint"]) -> None:
    """Raise BadValue for an angle outside the limits of a joint, UsageError for a joint that is not there."""
    by_name = {joint.name: joint for joint in joints}
    for name, angles in motion.poses.items():
        if name not in by_name:
            raise UsageError(f"no joint {name!r}; there are {', '.join(by_name)}")
        low, high = by_name[name].limits
        for moment, angle in zip(motion.times, angles, strict=True):
            if not low - 1e-9 <= angle <= high + 1e-9:
                raise BadValue(
                    f"{name}: {show(angle, 'rad')} at {show(moment, 's')} is outside its limits, {show(low, 'rad')} .. "
                    f"{show(high, 'rad')}"
                )
