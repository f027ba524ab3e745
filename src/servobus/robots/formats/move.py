"""pypot's .move file: samples of a motion, taken in as a motion with a file of samples.

    {"framerate": 50.0, "positions": {"0.02": {"m1": [12.5, 0.0]}}}

The keys are times in s, the values position in degrees and speed in °/s of each motor, in joint space. Speeds are left
out: playing reckons them from the positions. Source: pypot 5.0.2, primitive/move.py.
"""

from itertools import pairwise
from operator import itemgetter
from typing import Any

from servobus.core.units import deg, finite
from servobus.errors import FormatError
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.kinds import shown
from servobus.robots.file.writing import Key
from servobus.robots.formats.base import Changes, Given, json_of, json_or_none, listed
from servobus.robots.formats.motions import check_angle, motion_name, none_known
from servobus.robots.motions.motion import Motion, samples_text


def known(data: bytes) -> bool:
    """Tell whether a file is a .move of pypot."""
    said = json_or_none(data)
    return isinstance(said, dict) and {"framerate", "positions"} <= said.keys()


def onto(data: bytes, file: RobotFile, given: Given) -> Changes:
    """Take a motion into a robot file: its samples go into a file beside it. It begins at 0 s."""
    samples = _read(data, given.source)
    if len(samples) < 2:
        raise FormatError(f"{given.source}: it has one pose, and a motion has at least two")
    first, pose = samples[0]
    names = {name: given.joint(name) for name in pose}
    mine = {name: ours for name, ours in names.items() if ours in file.joints}
    if not mine:
        raise none_known(file, given, list(names))
    left = [name for name in names if name not in mine]
    angles_by_joint: dict[str, list[float]] = {ours: [] for ours in mine.values()}
    for time, angles in samples:
        if angles.keys() != pose.keys():
            raise FormatError(f"{given.source}: at {time:g} s it has other motors than at {first:g} s")
        where = f"{given.source}: at {time:g} s"
        for name, ours in mine.items():
            angles_by_joint[ours].append(check_angle(file, ours, angles[name] * deg, where) * deg)
    motion = motion_name(file, given)
    notes = [f"these are no joints of {file.name}, so they were left out: {listed(left)}"] if left else []
    notes.append("its speeds were left out: playing reckons them from the positions")
    path = f"{motion}.csv"
    times = tuple(time - first for time, _ in samples)
    text = samples_text(Motion(times, {joint: tuple(angles) for joint, angles in angles_by_joint.items()}))
    changes: dict[Key, Any] = {("motion", motion, "path"): "pchip", ("motion", motion, "file"): path}
    done = f"motion {motion}: {len(samples)} samples over {samples[-1][0] - first:g} s of {listed(mine.values())}"
    return Changes(changes, {path: text}, tuple(notes), done)


def _read(data: bytes, source: str) -> list[tuple[float, dict[str, float]]]:
    """Give the samples, the earliest first: time in s, and degrees by motor."""
    said = json_of(data, source)
    positions = said.get("positions") if isinstance(said, dict) else None
    if not isinstance(positions, dict) or not positions:
        raise FormatError(f"{source}: a .move of pypot has positions by time, and this has none")
    samples = sorted((_sample(time, pose, source) for time, pose in positions.items()), key=itemgetter(0))
    late = next((two for (one, _), (two, _) in pairwise(samples) if not one < two), None)
    if late is not None:
        raise FormatError(f"{source}: two of its samples are at {late:g} s")
    return samples


def _sample(time: str, pose: Any, source: str) -> tuple[float, dict[str, float]]:
    try:
        moment = finite(float(time))
    except ValueError:
        moment = None
    if moment is None:
        raise FormatError(f"{source}: {shown(time)} is no time in s")
    if not isinstance(pose, dict) or not pose:
        raise FormatError(f"{source}: at {moment:g} s there are no motors")
    angles: dict[str, float] = {}
    for name, values in pose.items():
        degrees = finite(values[0]) if isinstance(values, list) and values else None
        if degrees is None:
            raise FormatError(
                f"{source}: at {moment:g} s {shown(name)} has {shown(values)}, and not its position in degrees"
            )
        angles[name] = float(degrees)
    return float(moment), angles
