"""`play`: a motion of a robot file."""

from contextlib import ExitStack, closing
from typing import TYPE_CHECKING

import click

from servobus import robot
from servobus.cli import complete
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.keys import SPACE, Keys
from servobus.cli.options import as_json, verb
from servobus.cli.output import note, print_json
from servobus.cli.robots.under_way import (
    Write,
    angles_entry,
    angles_text,
    drawn,
    joint_table,
    motion_named,
    recording,
    switch_on,
)
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_file
from servobus.robots.motions.play import RATE, BlockingPlay, PlayTick

if TYPE_CHECKING:
    from rich.console import RenderableType


@verb(
    "play",
    "servobus play arm.toml wave",
    "servobus play arm.toml wave --pace 0.5 --loop",
    "servobus play arm.toml wave --record run.csv",
    "servobus play arm.toml run.csv            # what was recorded",
)
@click.argument("file", type=click.Path())
@click.argument("motion", shell_complete=complete.motions)
@click.option("--pace", type=float, default=1.0, metavar="P", help="Slow motion: 0.5 takes twice as long.")
@click.option("--loop/--once", default=None, help="Begin again where it ends, or not; else as FILE says.")
@click.option("--rate", type=float, default=RATE, metavar="HZ", help=f"Goals a second; {RATE:g} without it.")
@click.option("--record", metavar="OUT", help="Keep goals and positions in a file: OUT.csv or OUT.mcap.")
@as_json
def play(file: str, motion: str, pace: float, loop: bool | None, rate: float, record: str | None, json: bool) -> None:
    """Play a motion of FILE: MOTION is its name, or the path of a recording (.csv, .mcap).

    The joints go slowly to where it begins. Torque that is off is switched on, where each joint stands, and stays on.
    Limits of speed and acceleration slow the motion down where it is too quick. SPACE pauses and goes on, q comes to
    rest and ends, Ctrl-C stops all joints at once. A joint that is silent, without torque or held up stops all.
    """
    with ExitStack() as stack:
        arm = stack.enter_context(robot(read_file(file)))
        stack.enter_context(signals_as_interrupt())
        played = arm.play(motion_named(arm, motion), rate=rate, loop=loop)
        played.set_pace(pace)
        joints = [arm[joint.name] for joint in played.joints]
        with recording(record, arm, joints, joints) as write:
            if played.stretches and not json:
                worst = max(played.stretches, key=lambda one: one.factor)
                note(f"slower than it was made, within the limits of the joints: {worst}")
            switch_on(joints, quiet=json)
            try:
                last = _run(arm, played, motion, write, live=not json)
            except KeyboardInterrupt:
                if not json:
                    note("all joints stopped")
                raise
        _tell(played, motion, last, json=json)


def _run(arm: Robot, played: BlockingPlay, name: str, write: Write, *, live: bool) -> PlayTick | None:
    """Play it to its end; give the last turn."""
    last: PlayTick | None = None
    paused = False
    joints = [arm[joint.name] for joint in played.joints]

    def table() -> "RenderableType":
        if last is None:
            return ""
        state = "on the way to the first pose" if last.time < 0 else f"{last.time:.1f} of {played.duration:.1f} s"
        foot = f"SPACE {'goes on' if paused else 'pauses'}, q ends"
        head = f"{name}: {state}{', paused' if paused else ''}"
        return joint_table(head, joints, last.positions, last.goals, foot)

    with Keys() as keys, drawn(table, wanted=live), closing(iter(played)) as ticks:
        for tick in ticks:
            last = tick
            write(tick.positions, tick.goals)
            for key in keys.pressed():
                if key == SPACE:
                    paused = not paused
                    (played.pause if paused else played.resume)()
                elif key == "q":
                    played.stop()
    return last


def _tell(played: BlockingPlay, name: str, last: PlayTick | None, *, json: bool) -> None:
    positions = {} if last is None else dict(last.positions)
    missed = 0 if played.schedule is None else played.schedule.missed
    if json:
        entry = {"motion": name, "duration": round(played.duration, 3), "stopped": played.stopped, "missed": missed}
        print_json({**entry, "positions": angles_entry(positions)})
        return
    if missed:
        note(
            f"{missed} turns were left out, so it took longer: the lines or this computer are too slow for "
            f"{1 / played.period:g} goals a second; --rate says how many"
        )
    click.echo(f"{name} {'ended' if played.stopped else 'played'}: {angles_text(positions)}")
