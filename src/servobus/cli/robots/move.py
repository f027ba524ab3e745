"""`robot move` and `pose`: joints to angles, and poses of a robot file."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import click

from servobus import ServobusError, robot
from servobus.cli import complete
from servobus.cli.app import VerbGroup
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.move import LONGEST, Goal
from servobus.cli.options import as_json, verb
from servobus.cli.output import note, print_json
from servobus.cli.robots.under_way import angles_entry, angles_text
from servobus.cli.values import SECONDS, SPEED, split_assignment
from servobus.core.units import deg, show
from servobus.errors import RobotMismatch, UnknownName, UsageError
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_file
from servobus.robots.file.writing import edited, quantity, save

SLOW = 30 * deg
"""rad/s at which a robot goes to a pose: one can follow it by eye, and stop it."""

file_argument = click.argument("file", type=click.Path())
pose_argument = click.argument("name", shell_complete=complete.poses)
time_option = click.option("--time", type=SECONDS, metavar="S", help="Seconds that the move takes.")


@verb(
    "move",
    "servobus robot move arm.toml elbow=20 grip=5deg",
    "servobus robot move arm.toml elbow+=5 lift-=5 --time 2   # 5° further, 5° back",
)
@file_argument
@click.argument("goals", metavar="JOINT=ANGLE...", nargs=-1, required=True, shell_complete=complete.goals)
@time_option
@click.option("--speed", type=SPEED, metavar="DEG/S", help="Speed of the joint with the longest way; else 90°/s.")
@as_json
def move(file: str, goals: tuple[str, ...], time: float | None, speed: float | None, json: bool) -> None:
    """Move joints of FILE to angles, so that they start and arrive together, over all ports and families.

    Angles are degrees of the joint (20, 20deg) or 0.35rad. From where a joint is, elbow+=5 goes 5° further and elbow-=5
    goes 5° back. Torque that is off is switched on, from where each joint is, and stays on. Nothing moves unless all of
    it can be done. Ctrl-C stops the joints where they are.
    """
    wanted = _goals(goals)
    with robot(read_file(file), incomplete=True) as arm, signals_as_interrupt():
        _check_there(arm, list(wanted))
        here = arm.positions() if any(goal.relative for goal in wanted.values()) else {}
        angles = {name: goal.angle + (here[name] if goal.relative else 0.0) for name, goal in wanted.items()}
        _go(arm, angles, time, speed, json=json)


def _goals(texts: Sequence[str]) -> dict[str, Goal]:
    """Read JOINT=ANGLE..."""
    goals: dict[str, Goal] = {}
    for text in texts:
        word, angle = split_assignment(text, "JOINT=ANGLE, such as elbow=20, or elbow+=5 for 5° further")
        sign = word[-1] if word.endswith(("+", "-")) else ""
        name = word.removesuffix(sign)
        try:
            goal = Goal.parse(sign, angle)
        except ValueError as error:
            raise click.UsageError(f"{name}: {error}") from None
        if name in goals:
            raise click.UsageError(f"{name} is named twice")
        goals[name] = goal
    return goals


def _check_there(arm: Robot, names: Sequence[str]) -> None:
    """Refuse joints whose servos are not there, or are not those of the file. Raises UnknownName, RobotMismatch."""
    joints = [arm[name] for name in names]
    unusable = arm.attendance.unusable(joints)
    if wrong := [text for name, text in unusable.items() if name in names]:
        raise RobotMismatch(f"{'; '.join(wrong)}; nothing was done", arm.attendance.grave)


def _go(arm: Robot, angles: Mapping[str, float], time: float | None, speed: float | None, *, json: bool) -> None:
    """Check everything, then switch the torque on where it is off, then move, and say where all are."""
    if time is not None and speed is not None:
        raise click.UsageError("a move takes either --time or --speed, not both")
    for option, value in (("--time", time), ("--speed", speed)):
        if value is not None and value <= 0:
            raise click.UsageError(f"{option} must be above 0")
    if time is not None and time > LONGEST:
        raise click.UsageError(f"--time {time:g} is more than {LONGEST:g} s")
    _check_there(arm, list(angles))
    arm.plan_move(angles, time=time, speed=speed)
    joints = [arm[name] for name in angles]
    limp = [joint for joint in joints if not joint.look().torque]
    try:
        for joint in limp:
            joint.torque_on()
        under_way = arm.move(angles, time=time, speed=speed)
    except ServobusError:
        for joint in limp:
            joint.torque_off()  # leave them as they were
        raise
    if limp and not json:
        note(f"torque switched on: {', '.join(joint.name for joint in limp)}")
    try:
        under_way.wait()
    except KeyboardInterrupt:
        under_way.cancel()
        note("all joints stopped")
        raise
    seen = {name: angle for name, angle in arm.positions().items() if name in angles}
    if json:
        print_json({"positions": angles_entry(seen), "goals": angles_entry(angles), "unit": "°"})
    else:
        for name, angle in seen.items():
            click.echo(f"{name}  {show(angle, 'rad')}")


class PoseGroup(VerbGroup):
    """The verbs of poses."""

    verbs: ClassVar = {
        "Poses": {
            "save": ("robots.move:pose_save", "Keep where the joints are."),
            "go": ("robots.move:pose_go", "Move slowly to a pose."),
            "list": ("robots.move:pose_list", "List the poses of a robot file."),
        },
    }


@click.group("pose", cls=PoseGroup, subcommand_metavar="COMMAND ...")
def pose() -> None:
    """Poses of a robot: angles of joints under a name, in its robot file."""


@verb("save", "servobus pose save arm.toml home", "servobus pose save arm.toml open grip   # the joint grip alone")
@file_argument
@pose_argument
@click.argument("joints", metavar="[JOINT]...", nargs=-1, shell_complete=complete.joints)
def pose_save(file: str, name: str, joints: tuple[str, ...]) -> None:
    """Keep where the joints of FILE are as the pose NAME, all of them or those that are named. Moves nothing.

    A pose of that name is changed. Comments in FILE stay, and what was there before is kept as a dated copy beside it.
    """
    contents = read_file(file)
    with robot(contents, incomplete=True) as arm:
        wanted = arm.named(*joints)
        _check_there(arm, [joint.name for joint in wanted])
        seen = arm.positions()
        if lost := [joint.name for joint in wanted if joint.name in seen.lost]:
            raise ServobusError(
                f"{', '.join(lost)}: no answer, so nothing was saved; name the joints that are to be kept"
            )
        # Hundredths of a degree: finer than the steps of the servos.
        angles = {joint.name: quantity(round(seen[joint.name] / deg, 2) * deg, "rad") for joint in wanted}
    save(contents, edited(contents, {("pose", name): angles}))
    click.echo(f"{name}: {'  '.join(f'{joint} {angle}' for joint, angle in angles.items())}")


@verb("go", "servobus pose go arm.toml home", "servobus pose go arm.toml home --time 3")
@file_argument
@pose_argument
@time_option
@click.option("--speed", type=SPEED, metavar="DEG/S", help="Speed of the joint with the longest way; else 30°/s.")
@as_json
def pose_go(file: str, name: str, time: float | None, speed: float | None, json: bool) -> None:
    """Move the joints of FILE to the pose NAME, slowly unless --time or --speed say more.

    Joints that the pose does not name stay. Torque that is off is switched on, from where each joint is, and stays on.
    Nothing moves unless all of it can be done. Ctrl-C stops the joints where they are.
    """
    contents = read_file(file)
    if name not in contents.poses:
        raise UnknownName(f"{contents.name}: no pose {name!r}; there are {', '.join(contents.poses) or 'none'}")
    with robot(contents, incomplete=True) as arm, signals_as_interrupt():
        _go(arm, arm.pose(name), time, SLOW if time is None and speed is None else speed, json=json)


@verb("list", "servobus pose list arm.toml", "servobus pose list arm.toml --json")
@file_argument
@as_json
def pose_list(file: str, json: bool) -> None:
    """List the poses of FILE with their angles. Opens no port."""
    contents = read_file(file)
    if json:
        entries: dict[str, Any] = {name: angles_entry(angles) for name, angles in contents.poses.items()}
        print_json(entries)
        return
    if not contents.poses:
        raise UsageError(
            f"{contents.name}: there is no pose; `servobus pose save {file} NAME` keeps where the joints are"
        )
    width = max(map(len, contents.poses))
    for name, angles in contents.poses.items():
        click.echo(f"{name:<{width}}  {angles_text(angles)}")
