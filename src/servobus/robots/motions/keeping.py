"""Motions kept in a robot file: as steps that stand in it, or as a table of samples beside it.

Nothing is lost: a motion that is replaced stays in the dated copy of the robot file, and its table of samples where it
is, since each table gets a name of its own.
"""

import re
from pathlib import Path
from typing import Any

from servobus.errors import UsageError
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.kinds import NAME
from servobus.robots.file.writing import edited, quantity, save
from servobus.robots.motions.motion import Motion, samples_text
from servobus.transports.file_lock import replace_text


def check_free(file: RobotFile, name: str, *, replace: bool) -> None:
    """Raise UsageError if a motion cannot have this name, or if there is one that is not to be replaced."""
    if not re.fullmatch(NAME, name):
        raise UsageError(f"{name!r} is no name of a motion: use letters, digits, - and _, and a letter first")
    if name in file.motions and not replace:
        raise UsageError(f"{file.name}: there is a motion {name!r} already; give another name, or say --force")
    if file.path is None:
        raise UsageError("this robot was not read from a file, so there is none to keep a motion in")


def free_path(file: RobotFile, name: str, suffix: str) -> Path:
    """Give a path beside the robot file that no file has: NAME.csv, else NAME-2.csv, and so on."""
    assert file.path is not None
    folder = file.path.resolve().parent
    number = 1
    while (path := folder / f"{name}{'' if number == 1 else f'-{number}'}{suffix}").exists():
        number += 1
    return path


def keep_steps(file: RobotFile, name: str, motion: Motion, *, replace: bool = False) -> RobotFile:
    """Keep a motion as steps in its robot file. Raises UsageError or RobotFileError; then nothing has changed."""
    check_free(file, name, replace=replace)
    steps = [
        {
            "joints": {joint: quantity(angles[n], "rad") for joint, angles in motion.poses.items()},
            "time": quantity(moment, "s"),
        }
        for n, moment in enumerate(motion.times)
    ]
    return _keep(file, name, motion, {"steps": steps})


def keep_samples(file: RobotFile, name: str, motion: Motion, *, replace: bool = False) -> RobotFile:
    """Keep a motion as a table of samples beside its robot file. Raises UsageError, RobotFileError or OSError."""
    check_free(file, name, replace=replace)
    path = free_path(file, name, ".csv")
    replace_text(path, samples_text(motion))
    return _keep(file, name, motion, {"file": path.name})


def _keep(file: RobotFile, name: str, motion: Motion, contents: dict[str, Any]) -> RobotFile:
    table = {"path": motion.shape, **({"loop": True} if motion.loop else {}), **contents}
    return save(file, edited(file, {("motion", name): table}))
