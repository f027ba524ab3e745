"""Motion file of RoboPlus, .mtn: pages of poses, each taken in as the steps of a motion.

    type=motion
    version=1.01
    enable=0 1 1 ...                    26 flags; the place in the row is the id of a servo, from 0 on
    page_begin
    name=Wave
    play_param=0 0 1 1.0 32             next page, exit page, repetitions, rate, inertia
    step=512 512 600 ... 0.2 1.0        a position for each id; the pause after this pose and the way to it, s
    page_end

Positions are counts of an AX-12, 0 .. 1023 over 300°. Both times are divided by the rate of their page. Source: the
motions and the loader of the project bioloidgp, for RoboPlus Motion 1; AX-12A: e-manual, Goal Position.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from servobus.core.units import finite
from servobus.errors import FormatError
from servobus.robots.file.entries import JointEntry, RobotFile
from servobus.robots.file.kinds import shown
from servobus.robots.file.writing import Key
from servobus.robots.formats.base import Changes, Given, listed, plain_name, text_of
from servobus.robots.formats.motions import check_angle, joint_of_servo, none_known, steps_of
from servobus.robots.formats.servos import DYNAMIXEL, angle_row, to_angle

COUNTS = 1023
IDS = 26
"""Places in a row: RoboPlus knows ids up to 25."""
RATE = 3
"""Where the rate of a page stands in its play_param."""


class _Step(NamedTuple):
    positions: Sequence[float]
    pause: float
    way: float


class _Page(NamedTuple):
    name: str
    steps: list[_Step]
    goes_on: bool
    """Whether another page follows it, or it is repeated."""


def known(data: bytes) -> bool:
    """Tell whether a file is a motion file of RoboPlus."""
    return re.match(rb"(\xef\xbb\xbf)?\s*type\s*=\s*motion\b", data) is not None


def onto(data: bytes, file: RobotFile, given: Given) -> Changes:
    """Take the pages of a motion file into a robot file, each as a motion whose first pose is at 0 s.

    Of several pages `--name` takes the one that is called so.
    """
    enabled, pages = _read(text_of(data, given.source), given.source)
    joints: dict[int, str] = {}
    left = []
    for id in enabled:
        joint = joint_of_servo(file, id, given, _fits)
        if joint is None:
            left.append(f"Servo{id}")
        elif joint in joints.values():
            raise FormatError(f"{given.source}: two of its servos would be joint {joint}")
        else:
            joints[id] = joint
    if not joints:
        raise none_known(file, given, left)
    changes: dict[Key, Any] = {}
    done = []
    notes = [f"these are no joints of {file.name}, so they were left out: {listed(left)}"] if left else []
    for page in _wanted(pages, given):
        name = (given.motion if len(pages) == 1 else None) or plain_name(page.name)
        if name in file.motions or ("motion", name, "steps") in changes:
            raise FormatError(f"{file.name} has a motion {name} already; rename the page {shown(page.name)}, or that")
        times, poses = _motion(file, page, joints, given.source)
        changes |= {("motion", name, "path"): "pchip", ("motion", name, "steps"): steps_of(times, poses)}
        done.append(f"motion {name}: {len(poses)} steps over {times[-1]:g} s")
        if page.goes_on:
            notes.append(f"page {shown(page.name)} is repeated, or goes on with another: that was left out")
    notes.append("the time of the first step of a page is left out: playing goes there by itself")
    notes.append("how soft the joints are to be (compliance) was left out")
    return Changes(changes, {}, tuple(notes), f"{'; '.join(done)}; of {listed(joints.values())}")


def _fits(entry: JointEntry) -> bool:
    """Tell whether a joint has a servo with the counts of an AX-12."""
    model = entry.model
    return model.family.name == DYNAMIXEL and not model.generic and angle_row(model, "")[0].limits[1] == COUNTS


def _wanted(pages: Sequence[_Page], given: Given) -> list[_Page]:
    """Give the pages to take: all that have poses, or the one that is named."""
    named = given.motion
    full = [page for page in pages if len(page.steps) > 1 or (len(page.steps) == 1 and page.steps[0].pause > 0)]
    if len(pages) > 1 and named is not None:
        full = [page for page in full if named in (page.name, plain_name(page.name))]
    if not full:
        told = listed(shown(page.name) for page in pages) or "none"
        raise FormatError(f"{given.source}: it has no page with two poses under that name; its pages are {told}")
    return full


def _motion(
    file: RobotFile, page: _Page, joints: Mapping[int, str], source: str
) -> tuple[list[float], list[Mapping[str, float]]]:
    """Give the times of a motion in s, and its poses in degrees."""
    times: list[float] = []
    poses: list[Mapping[str, float]] = []
    now = 0.0
    for number, step in enumerate(page.steps, 1):
        where = f"{source}: page {shown(page.name)}, step {number}"
        if number > 1:
            if step.way <= 0:
                raise FormatError(f"{where} has {step.way:g} s for its way; a step needs time")
            now += step.way
        pose = {joint: _angle(file, joint, step.positions[id], where) for id, joint in joints.items()}
        for moment in (now, now + step.pause) if step.pause > 0 else (now,):
            times.append(moment)
            poses.append(pose)
        now = times[-1]
    return times, poses


def _angle(file: RobotFile, joint: str, position: float, where: str) -> float:
    """Give the angle of a joint, in degrees, for a position of its servo."""
    servo = file.joints[joint].servos[0]
    if not _fits(file.joints[joint]):
        raise FormatError(f"{where}: {joint} is a {servo.model.title}, which has other counts than an AX-12")
    if not 0 <= position <= COUNTS:
        raise FormatError(f"{where}: {joint} is at {position:g}; the counts of an AX-12 are 0 to {COUNTS}")
    _, scale = angle_row(servo.model, file.name)
    return check_angle(file, joint, servo.axis.to_joint(to_angle(scale, position)), where)


def _read(text: str, source: str) -> tuple[list[int], list[_Page]]:
    """Give the ids that are in use, and the pages."""
    enabled: list[int] = []
    pages: list[_Page] = []
    page: dict[str, Any] | None = None
    for number, line in enumerate(text.splitlines(), 1):
        key, _, value = (part.strip() for part in line.partition("="))
        where = f"{source}:{number}"
        if key == "page_begin":
            page = {"name": "", "steps": [], "play": [0.0, 0.0, 1.0, 1.0]}
        elif key == "page_end" and page is not None:
            pages.append(_page(page, f"page{len(pages) + 1}"))
            page = None
        elif key == "enable":
            enabled = [id for id, flag in enumerate(_numbers(value, IDS, where)) if flag]
        elif page is not None and key == "name":
            page["name"] = value
        elif page is not None and key == "play_param":
            page["play"] = _numbers(value, RATE + 1, where)
            if not page["play"][RATE] > 0:
                raise FormatError(f"{where}: the rate of a page is above 0, and this is {page['play'][RATE]:g}")
        elif page is not None and key == "step":
            page["steps"].append(_numbers(value, IDS + 2, where))
    return enabled, pages


def _page(said: Mapping[str, Any], other: str) -> _Page:
    following, _, times, rate = said["play"][: RATE + 1]
    steps = [_Step(row[:IDS], row[IDS] / rate, row[IDS + 1] / rate) for row in said["steps"]]
    return _Page(said["name"] or other, steps, bool(following) or times > 1)


def _numbers(text: str, least: int, where: str) -> list[float]:
    """Read numbers between blanks. Raises FormatError for what is none, and for too few."""
    try:
        numbers = [finite(float(word)) for word in text.split()]
    except ValueError:
        numbers = [None]
    if None in numbers or len(numbers) < least:
        raise FormatError(f"{where}: {shown(text)} is no row of {least} numbers")
    return [float(number) for number in numbers if number is not None]
