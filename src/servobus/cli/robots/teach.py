"""`teach`: a motion is made by moving limp joints by hand."""

from collections.abc import Sequence
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from servobus import robot
from servobus.cli import complete
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.keys import SPACE, Keys
from servobus.cli.options import as_json, verb
from servobus.cli.output import note, print_json
from servobus.cli.robots.under_way import angles_text, drawn, joint_table
from servobus.cli.values import ANGLE, SECONDS, check_above_0
from servobus.core.units import show
from servobus.errors import ServobusError, UsageError
from servobus.robots.blocking import Robot
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.reading import read_file
from servobus.robots.joints.joint import Joint
from servobus.robots.motions.keeping import check_free, free_path, keep_samples, keep_steps
from servobus.robots.motions.recording import Moment, read_recording, recorder
from servobus.robots.motions.teach import RATE, BlockingTeach, TeachTick, motion_of_poses
from servobus.robots.motions.thinning import TOLERANCE, kept

if TYPE_CHECKING:
    from rich.console import RenderableType

RAW, MARKED = ".raw.csv", ".poses.csv"
"""Ends of the names of the files that readings, and marked poses, are written to as they come."""


@verb(
    "teach",
    "servobus teach arm.toml wave shoulder elbow",
    "servobus teach arm.toml wave shoulder elbow --poses",
    "servobus teach arm.toml wave grip --seconds 10 --rate 100",
    "servobus teach arm.toml wave --from wave.raw.csv --tolerance 2",
)
@click.argument("file", type=click.Path())
@click.argument("name")
@click.argument("joints", metavar="[JOINT]...", nargs=-1, shell_complete=complete.joints)
@click.option("--poses", is_flag=True, help="Keep poses, one each time SPACE is pressed, and no readings between.")
@click.option("--rate", type=float, metavar="HZ", help=f"Readings a second; {RATE:g} without it.")
@click.option("--seconds", type=SECONDS, metavar="S", help="End after this time; else q or Ctrl-C ends it.")
@click.option("--tolerance", type=ANGLE, metavar="DEG", help=f"What thinning may miss; {show(TOLERANCE, 'rad')} else.")
@click.option("--from", "source", metavar="RECORDING", help="Take what stands in a recording (.csv, .mcap).")
@click.option("--force", is_flag=True, help="Replace the motion if there is one of this name.")
@as_json
def teach(
    file: str,
    name: str,
    joints: tuple[str, ...],
    poses: bool,
    rate: float | None,
    seconds: float | None,
    tolerance: float | None,
    source: str | None,
    force: bool,
    json: bool,
) -> None:
    """Record a motion by hand and keep it in FILE as [motion.NAME].

    The JOINTs that are named go limp: hold them. If none is named, those are recorded that are limp already. All others
    stay as they are. q or Ctrl-C ends the recording; the joints stay limp. Readings become a table NAME.csv beside
    FILE, thinned so that no reading is missed by more than the tolerance; with --poses they become steps in FILE.

    Each reading is in NAME.raw.csv as soon as it comes (each pose in NAME.poses.csv), so nothing is lost whatever
    happens: `--from` makes a motion of such a file, or of what `play --record` kept.
    """
    check_above_0("--seconds", seconds)
    check_above_0("--tolerance", tolerance)
    if poses and rate is not None:
        raise click.UsageError("--poses keeps poses and no readings between them: leave --rate out")
    if source is not None and (joints or rate is not None or seconds is not None):
        raise click.UsageError("--from takes what is recorded already: leave joints, --rate and --seconds out")
    contents = read_file(file)
    check_free(contents, name, replace=force)
    bound = TOLERANCE if tolerance is None else tolerance
    if source is not None:
        found = read_recording(Path(source))
        entries = _recorded(contents, found)
        _keep(file, name, found, entries, poses=poses, bound=bound, force=force, json=json)
        return
    with ExitStack() as stack:
        arm = stack.enter_context(robot(contents))
        stack.enter_context(signals_as_interrupt())
        keys = stack.enter_context(Keys())
        if not keys.there and (poses or seconds is None):
            missing = "no keys can mark poses" if poses else "nobody can end it: say --seconds"
            raise UsageError(f"there is no terminal, so {missing}")
        _wait_for_hands(arm, joints, keys)
        raw = free_path(contents, name, MARKED if poses else RAW)
        recording = arm.teach(*joints, rate=rate or RATE, keep=None if poses else raw)
        try:
            with suppress(KeyboardInterrupt):  # that is how it ends, too
                _record(arm, recording, name, keys, marked=raw if poses else None, seconds=seconds, live=not json)
        except ServobusError:
            if recording.moments:
                note(_rescue(file, name, raw, poses=poses))
            raise
        taught = [Moment(float(n), pose, {}) for n, pose in enumerate(recording.poses)] if poses else recording.moments
        try:
            _keep(file, name, taught, recording.joints, poses=poses, bound=bound, force=force, json=json)
        except (ServobusError, OSError):
            if taught:
                note(_rescue(file, name, raw, poses=poses))
            raise
        if poses:
            raw.unlink(missing_ok=True)  # all of it stands in the robot file
        elif not json:
            note(f"all readings are in {raw.name}")


def _rescue(file: str, name: str, raw: Path, *, poses: bool) -> str:
    return (
        f"what was recorded is in {raw}; `servobus teach {file} {name} --from {raw}{' --poses' if poses else ''}` "
        "makes a motion of it"
    )


def _wait_for_hands(arm: Robot, joints: Sequence[str], keys: Keys) -> None:
    """Let a person hold what goes limp, where one is there."""
    falling = [joint.name for joint in arm.named(*joints) if not joint.look().limp] if joints else []
    if not falling or not keys.there:
        return
    goes = "it goes" if len(falling) == 1 else "they go"
    note(f"hold {', '.join(falling)}, and press SPACE: then {goes} limp; q ends")
    while not (pressed := set(keys.pressed())) & {SPACE, "\n", "\r"}:
        if "q" in pressed:
            raise UsageError("ended before anything went limp, and nothing was recorded")
        next(iter(arm.buses.values())).transport.sleep(0.02)
        if not keys.there:
            raise UsageError("the terminal is gone; nothing went limp")


def _record(
    arm: Robot,
    recording: BlockingTeach,
    name: str,
    keys: Keys,
    *,
    marked: Path | None,
    seconds: float | None,
    live: bool,
) -> None:
    """Record until a key, or the time, ends it."""
    last: TeachTick | None = None
    said = ""

    def table() -> "RenderableType":
        if last is None:
            return ""
        lost = sum(len(moment.positions) < len(recording.joints) for moment in recording.moments)
        head = f"{name}: {last.time:.1f} s" + (f", {len(recording.poses)} poses" if marked is not None else "")
        foot = "SPACE keeps a pose, q ends" if marked is not None else "q ends"
        foot += f"; {lost} turns with a lost reading" if lost else ""
        return joint_table(head, [arm[joint.name] for joint in recording.joints], last.positions, {}, f"{foot} {said}")

    with ExitStack() as stack:
        ticks = stack.enter_context(closing(iter(recording)))
        stack.enter_context(drawn(table, wanted=live))
        out = None
        for tick in ticks:
            last = tick
            if marked is not None and out is None:
                out = stack.enter_context(recorder(marked, [joint.name for joint in recording.joints]))
            for key in keys.pressed():
                if key == "q":
                    recording.stop()
                elif key in (SPACE, "\n") and out is not None:
                    try:
                        pose = recording.mark()
                    except ServobusError as error:
                        said = str(error)
                        note(said)
                        continue
                    out.write(Moment(tick.time, pose, {}))
                    said = angles_text(pose)
            if seconds is not None and tick.time >= seconds:
                recording.stop()


def _recorded(file: RobotFile, moments: Sequence[Moment]) -> list[Joint]:
    """Give the joints of the robot file that stand in a recording. Raises UsageError for one that it lacks."""
    names = {name for moment in moments for name in moment.positions}
    if unknown := sorted(names - set(file.joints)):
        raise UsageError(f"{file.name} has no joint {unknown[0]!r}; there are {', '.join(file.joints)}")
    return [Joint(entry, ()) for name, entry in file.joints.items() if name in names]


def _keep(
    file: str,
    name: str,
    moments: Sequence[Moment],
    joints: Sequence[Joint],
    *,
    poses: bool,
    bound: float,
    force: bool,
    json: bool,
) -> None:
    """Make a motion of what was recorded, keep it in the robot file as that is now, and tell."""
    notes: list[str] = []
    if poses:
        motion = motion_of_poses([moment.positions for moment in moments], joints)
        keep_steps(read_file(file), name, motion, replace=force)
    else:
        found = kept(moments, joints, bound)
        motion, notes = found.motion, found.notes
        keep_samples(read_file(file), name, motion, replace=force)
    if json:
        entry = {"motion": name, "joints": list(motion.poses), "duration": round(motion.times[-1], 3)}
        print_json({**entry, "readings": len(moments), "poses": len(motion.times), "notes": notes})
        return
    for text in notes:
        note(text)
    of = "" if poses else f" of {len(moments)} readings, within {show(bound, 'rad')}"
    click.echo(
        f"{name}: {len(motion.times)} poses{of}, {motion.times[-1]:.1f} s; `servobus play {file} {name}` plays it"
    )
