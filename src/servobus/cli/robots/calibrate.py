"""`robot calibrate`: zero, direction and limits of joints, found by moving them by hand."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from servobus import ServobusError, robot
from servobus.cli.held_key import HeldKey
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.keys import SPACE
from servobus.cli.options import verb
from servobus.cli.output import note
from servobus.cli.robots.person import ENTER, AtTerminal, Person, Script, angle_text
from servobus.cli.robots.settings import file_argument
from servobus.cli.robots.undo import bring_back
from servobus.cli.values import ANGLE, split_assignment
from servobus.core.exchange import Procedure, SetBaud
from servobus.core.registers import Register
from servobus.core.units import deg, parse, show
from servobus.errors import RobotFileError, RobotMismatch
from servobus.robots.blocking import Robot, RobotJoint
from servobus.robots.calibration.flow import Calibration
from servobus.robots.calibration.joint import MARGIN, Key, Step, key_of
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.reading import read_file, read_text
from servobus.robots.file.writing import edited, save
from servobus.robots.joints import jobs
from servobus.robots.joints.joint import Part
from servobus.robots.settings.applying import on
from servobus.robots.values import check_joint

if TYPE_CHECKING:
    from rich.console import RenderableType

PERIOD = 0.04
"""s between two readings."""
SILENT = 3.0
"""s for which a joint that is dealt with may not answer."""
TEST, TEST_SPEED = 10 * deg, 5 * deg
"""How far a test move goes, and how fast: slow enough that whoever lets the key go stops it within some degrees."""
AHEAD = 1 * deg
"""How far the goal of a test move is ahead of where the joint should be: so far it goes if the program is killed."""


@verb(
    "calibrate",
    "servobus robot calibrate arm.toml",
    "servobus robot calibrate arm.toml elbow --zero elbow=90 --dry-run",
    "servobus robot calibrate arm.toml --undo",
)
@file_argument
@click.argument("joints", metavar="[JOINT]...", nargs=-1)
@click.option("--zero", "zeros", multiple=True, metavar="JOINT=ANGLE", help="Angle of the known pose; 0 without it.")
@click.option("--margin", type=ANGLE, default=None, metavar="ANGLE", help="Of the limits to the ends; 2° by default.")
@click.option("--dry-run", is_flag=True, help="Show what would be written, and write nothing.")
@click.option("--yes", is_flag=True, help="Write without a question.")
@click.option("--no-test", is_flag=True, help="Leave out the test moves at the end.")
@click.option("--undo", is_flag=True, help="Bring back what stood in FILE before the last change.")
@click.option("--script", type=click.Path(path_type=Path), metavar="SCRIPT", help="Let a script move virtual servos.")
def calibrate(
    file: str,
    joints: tuple[str, ...],
    zeros: tuple[str, ...],
    margin: float | None,
    dry_run: bool,
    yes: bool,
    no_test: bool,
    undo: bool,
    script: Path | None,
) -> None:
    """Find zero, direction and limits of JOINTs by moving them by hand, and write them to FILE; of all without JOINT.

    The joints go limp. For each: move it, so that its servo is known; push it to where its angle shall grow; move it to
    both ends twice; bring it to a known pose or a mark. Then what changes in FILE is shown and written, comments stay,
    and a copy is kept. At the end each joint makes a small move as long as SPACE is held. Keys: ENTER goes on, y and n
    answer, r begins the joint anew, a takes another angle for the known pose, Ctrl-C ends it all.
    """
    if undo:
        bring_back(file)
        return
    contents = read_file(file)
    for name in joints:
        check_joint(name, contents.joints)
    names = list(dict.fromkeys(joints)) or list(contents.joints)
    poses = _zeros(zeros, names)
    room = MARGIN if margin is None else margin
    if not room >= 0:
        raise click.BadParameter(f"{show(room, 'rad')} is below 0", param_hint="--margin")
    with robot(contents, incomplete=True) as arm, signals_as_interrupt():
        _check_there(arm, names)
        person: Person = Script(arm, script) if script is not None else AtTerminal(arm)
        flow = Calibration(contents, names, poses, room)
        try:
            offsets = _offsets(arm, names)
            _go_limp(arm, names, person)
            _run(arm, flow, person)
        except (KeyboardInterrupt, ServobusError):
            note(f"{file} is as it was, and the servos hold what they held; the joints may be limp")
            raise
        changes = flow.changes() | _offsets_kept(flow, offsets)
        written = _write(contents, flow, changes, person, dry_run=dry_run, yes=yes)
        if written is not None and not no_test:
            moved = Robot(written, arm.buses)
            for result in flow.results():
                _test(moved[result.joint], moved, person)
    if flow.failures:
        said = "; ".join(f"{name}: {why}" for name, why in flow.failures.items())
        raise ServobusError(f"not calibrated: {said}")


def _zeros(words: Sequence[str], names: Sequence[str]) -> dict[str, float]:
    poses = {}
    for word in words:
        name, angle = split_assignment(word, "JOINT=ANGLE, such as elbow=90")
        check_joint(name, names)
        try:
            poses[name] = parse(angle, "rad")
        except ValueError as error:
            raise click.BadParameter(f"{word}: {error}", param_hint="--zero") from None
    return poses


def _check_there(arm: Robot, names: Sequence[str]) -> None:
    """Raise RobotMismatch where a servo that is to be calibrated is not the one of the file."""
    why = {name: text for name, text in arm.attendance.unusable(arm).items() if name in names}
    if why:
        raise RobotMismatch(f"{arm.file.name}: {'; '.join(why.values())}", arm.attendance.grave)


def _go_limp(arm: Robot, names: Sequence[str], person: Person) -> None:
    """Switch the torque of these joints off, after the person has the arm in hand."""
    driven = [name for name in names if any(arm.do(on(part.port, _torque(part))) for part in arm[name].parts)]
    if not driven:
        return
    if not person.yes(f"hold the arm: {', '.join(driven)} {'goes' if len(driven) == 1 else 'go'} limp. Go on?"):
        raise ServobusError("nothing was changed")
    arm.do(jobs.torque_off([arm[name] for name in driven]))


def _torque(part: Part) -> Procedure[bool]:
    yield SetBaud(part.servo.baud)
    return (yield from part.servo.family.read_torque(part.servo.target)).on


# The flow


def _run(arm: Robot, flow: Calibration, person: Person) -> None:
    """Go through the flow with a person until nothing is left to do."""
    everyone = [joint for joint in arm if joint.name not in arm.attendance.unusable(arm)]
    while not flow.over:
        with person.attentive():
            typed = _until_asked(arm, everyone, flow, person)
        joint = flow.current
        if flow.asks:
            flow.answer(person.yes(flow.prompt))
        elif typed and joint is not None:
            joint.zero_at = person.angle(f"at which angle, in degrees, is {joint.name} known?")
    for name, why in flow.failures.items():
        note(f"{name}: {why}")


def _until_asked(arm: Robot, everyone: Sequence[RobotJoint], flow: Calibration, person: Person) -> bool:
    """Read and show what is to be done, until there is a question; tell whether an angle is to be typed."""
    heard = arm.ports.now()
    while (joint := flow.current) is not None and not flow.asks:
        mine = [one for one in everyone if any(_key(part) in joint.tracks for part in one.parts)]
        seen, lost = arm.do(jobs.servo_angles(everyone if joint.step is Step.FIND else mine))
        now = arm.ports.now()
        flow.take(now, {_key(part): angle for part, angle in seen.items()})
        silent = [error for part, error in lost.items() if _key(part) in joint.tracks]
        heard = heard if silent else now
        if now - heard > SILENT:
            raise silent[0]
        person.show(f"{flow.message}. {flow.prompt}" if flow.message else flow.prompt, partial(_table, flow))
        pressed = person.key(PERIOD)
        if pressed == ENTER:
            flow.confirm()
        elif pressed == "r":
            flow.redo()
        elif pressed == "a" and joint.step is Step.ZERO:
            return True
    return False


def _key(part: Part) -> Key:
    return part.port, part.servo.id, part.servo.baud


def _table(flow: Calibration) -> "RenderableType":
    """Draw all joints: how far each is, and the angles of its servo."""
    from rich.console import Group  # noqa: PLC0415 - rich is slow to import and not always wanted
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold", pad_edge=False)
    for header in ("joint", "step"):
        table.add_column(header)
    for header in ("servo at", "lowest", "highest", "touched"):
        table.add_column(header, justify="right")
    for joint in flow.joints.values():
        ends, angle = joint.ends, joint.angle
        low, high = ends.touched
        style = "bold cyan" if joint is flow.current else "red" if joint.step is Step.FAILED else ""
        table.add_row(
            joint.name,
            joint.step.value,
            angle_text(math.nan if angle is None else angle),
            angle_text(ends.low),
            angle_text(ends.high),
            f"{low}, {high}",
            style=style,
        )
    keys = "r: this joint anew   a: another angle for the pose   Ctrl-C: end, write nothing"
    return Group(table, Text(flow.message, style="dim"), Text(flow.prompt, style="bold"), Text(keys, style="dim"))


# The file


def _offsets(arm: Robot, names: Sequence[str]) -> dict[Key, tuple[str, int]]:
    """Read the offsets that servos have of their own: servo -> name of the register and raw value. None is changed."""
    found = {}
    for part in (part for name in names for part in arm[name].parts):
        row = part.servo.model.optional("calibration")
        if row is not None:
            found[_key(part)] = row.name, arm.do(on(part.port, _raw(part, row)))
    return found


def _raw(part: Part, row: Register[Any]) -> Procedure[int]:
    yield SetBaud(part.servo.baud)
    (raw,) = yield from part.servo.family.read(part.servo.target, [row])
    return raw


def _offsets_kept(flow: Calibration, offsets: Mapping[Key, tuple[str, int]]) -> dict[tuple[str, ...], Any]:
    """Give what the file is to say of offsets: the zeros were found with them, and a new servo must get them.

    Two servos on one axis have one table of registers, in which their offsets have no place.
    """
    kept: dict[tuple[str, ...], Any] = {}
    for result in flow.results():
        name, raw = offsets.get(key_of(result.servos[0]), ("", 0))
        said = name in flow.file.joints[result.joint].registers
        if len(result.servos) == 1 and (raw or said):
            kept["joint", result.joint, "registers", name] = raw
    return kept


def _write(
    file: RobotFile,
    flow: Calibration,
    changes: Mapping[tuple[str, ...], Any],
    person: Person,
    *,
    dry_run: bool,
    yes: bool,
) -> RobotFile | None:
    """Show what changes in the file and write it; None where nothing is written."""
    if not changes:
        note(f"{file.path}: nothing to write")
        return None
    for result in flow.results():
        travel = " .. ".join(show(angle, "rad") for angle in result.travel)
        click.echo(f"{result.joint}: goes from {travel}, limits {' .. '.join(show(a, 'rad') for a in result.limits)}")
        for remark in result.notes:
            note(f"{result.joint}: {remark}")
    _show_changes(file, changes)
    try:
        text = edited(file, changes)
        read_text(text, file.path)
    except RobotFileError as error:
        raise RobotFileError(
            f"{error}; nothing was written: mend that in the file first, or write what is shown above by hand"
        ) from None
    if dry_run:
        note(f"{file.path} is as it was: --dry-run writes nothing")
        return None
    if not yes and not person.yes(f"write this to {file.path}?"):
        raise ServobusError("nothing was written")
    made = save(file, text)
    assert file.path is not None
    _read_back(read_file(file.path), made, [result.joint for result in flow.results()])
    click.echo(f"{file.path}: written; `servobus robot calibrate {file.path} --undo` brings back what was there before")
    kept = [result.joint for result in flow.results() if made.joints[result.joint].limits_in_servo]
    if kept:
        click.echo(f"the limits of {', '.join(kept)} belong in the servos too: `servobus robot plan {file.path}`")
    return made


def _show_changes(file: RobotFile, changes: Mapping[tuple[str, ...], Any]) -> None:
    import tomllib  # noqa: PLC0415 - only who writes files needs it

    tables = tomllib.loads(file.text)
    for path, new in changes.items():
        old: Any = tables
        for key in path:
            old = old.get(key) if isinstance(old, dict) else None
        if old != new:
            click.echo(f"  [{'.'.join(path[:-1])}] {path[-1]}: {_said(old)} -> {_said(new)}")


def _said(value: Any) -> str:
    if value is None:
        return "not said"
    return " .. ".join(map(str, value)) if isinstance(value, list) else str(value)


def _read_back(there: RobotFile, made: RobotFile, names: Sequence[str]) -> None:
    """Raise RobotFileError if the file does not say what was written."""
    for name in names:
        if there.joints[name] != made.joints[name]:
            raise RobotFileError(f"{there.name}: [joint.{name}] does not read as it was written; look at the file")


# The test move


def _test(joint: RobotJoint, arm: Robot, person: Person) -> None:
    """Let a joint move to and fro as long as a key is held. Its torque is off before and afterwards."""
    if not person.yes(
        f"test {joint.name}: hold the arm, for it is limp again at the end. Its torque comes on, and it moves while "
        "SPACE is held. Test it?"
    ):
        return
    joint.torque_on()
    try:
        with person.attentive():
            _move_while_held(joint, arm, person)
    finally:
        try:
            joint.stop()
        finally:
            joint.torque_off()
        note(f"{joint.name} is limp again")


def _move_while_held(joint: RobotJoint, arm: Robot, person: Person) -> None:
    """Move towards positive angles while SPACE is held, the next time towards negative ones; another key ends it."""
    direction, held = 1, HeldKey()
    while True:
        there = "greater" if direction > 0 else "smaller"
        person.show(f"{joint.name.upper()}: hold SPACE, it moves to {there} angles; ENTER ends")
        pressed = person.key(PERIOD)
        if pressed not in ("", SPACE):
            return
        if pressed != SPACE:
            continue
        held.pressed(arm.ports.now())
        here = joint.position()
        goal = min(max(here + direction * TEST, joint.limits[0]), joint.limits[1])
        if abs(goal - here) < deg:
            direction = -direction
            continue
        _creep(joint, here, goal, held, arm, person)
        note(f"{joint.name}: {show(here, 'rad')} to {show(joint.position(), 'rad')}")
        direction, held = -direction, HeldKey()


def _creep(joint: RobotJoint, here: float, goal: float, held: HeldKey, arm: Robot, person: Person) -> None:
    """Move to a goal while the key is held, with commands that lead no farther than AHEAD: a killed program's are over.

    The joint stops where the key is let go.
    """
    way, began = goal - here, arm.ports.now()
    try:
        while held.held(arm.ports.now()):
            gone = TEST_SPEED * (arm.ports.now() - began)
            share = min(1.0, (gone + AHEAD) / abs(way))
            move = joint.move(here + share * way, speed=TEST_SPEED)
            if person.key(PERIOD) == SPACE:
                held.pressed(arm.ports.now())
            if share == 1.0 and move.done:
                return
    finally:
        joint.stop()
