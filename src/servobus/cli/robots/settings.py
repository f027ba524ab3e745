"""`robot plan` and `robot apply`: the settings of the servos as the robot file says."""

import click

from servobus import ServobusError, robot
from servobus.cli.interrupts import signals_as_interrupt, unless_nobody_answers
from servobus.cli.options import verb
from servobus.cli.output import note, print_json
from servobus.errors import BusError, NotRestored, PortError
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_file
from servobus.robots.settings.backups import Backups
from servobus.robots.settings.planning import Plan

file_argument = click.argument("file", type=click.Path())
torque_off_option = click.option("--torque-off", is_flag=True, help="Switch the torque off first, where it is on.")


@verb("plan", "servobus robot plan arm.toml", "servobus robot plan arm.toml --json")
@file_argument
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def plan(file: str, as_json: bool) -> None:
    """Compare the settings that the servos hold with FILE, and show what `robot apply` would write.

    FILE says them in [joint.NAME.registers]; with limits_in_servo = true the limits of the joint are kept in its servos
    too. Nothing is written. The exit code is 1 where a servo cannot be compared, or cannot have what FILE asks for.
    """
    with robot(read_file(file), incomplete=True) as opened:
        found = opened.plan_settings()
        if as_json:
            print_json(found.entry())
        else:
            click.echo(str(found))
        _note_broken_off(opened, file)
    if found.problems:
        raise click.exceptions.Exit(1)


@verb(
    "apply",
    "servobus robot apply arm.toml",
    "servobus robot apply arm.toml --yes --torque-off",
    "servobus robot apply arm.toml --undo",
)
@file_argument
@click.option("--yes", is_flag=True, help="Do not ask.")
@torque_off_option
@click.option("--offsets", is_flag=True, help="Write the servos' own offsets too, where FILE names them.")
@click.option("--undo", is_flag=True, help="Bring back what the servos held before the last apply.")
def apply(file: str, yes: bool, torque_off: bool, offsets: bool, undo: bool) -> None:
    """Write the settings in FILE to the servos that have others, after showing them, and read them back.

    Nothing moves: a servo with its torque on is refused, or goes limp first with --torque-off. What was there before is
    kept in a folder beside FILE. Broken off, whatever the reason, the same command does the rest, and --undo brings
    back what was there before.
    """
    if undo and offsets:
        raise click.UsageError("--undo brings back what was written, offsets or not: leave --offsets out")
    with robot(read_file(file), incomplete=True) as opened, signals_as_interrupt():
        if undo:
            _undo(opened, file, torque_off=torque_off, yes=yes)
            return
        found = opened.plan_settings()
        click.echo(found.text(offsets=offsets))
        _note_broken_off(opened, file)
        if found.changes(offsets=offsets):
            _check_torque(found, torque_off=torque_off, offsets=offsets)
            with unless_nobody_answers("--yes writes it without a question"):
                if not yes and not click.confirm(_question(found, offsets=offsets)):
                    raise ServobusError("nothing was written")
        try:
            done = opened.apply_settings(found, torque_off=torque_off, offsets=offsets)
        except (BusError, PortError, NotRestored, KeyboardInterrupt):
            if not found.changes(offsets=offsets):
                raise  # there was nothing to write
            note(f"what is not written yet is written when this command is given again; {_undo_hint(file)}")
            raise
        for who, names in done.written.items():
            click.echo(f"{who}: written {', '.join(names)}")
        if done.written:
            click.echo(f"what was there before is in {done.run.folder}; {_undo_hint(file)}")


@verb(
    "sync-limits",
    "servobus robot sync-limits arm.toml",
    "servobus robot sync-limits arm.toml --yes --torque-off",
)
@file_argument
@click.option("--yes", is_flag=True, help="Do not ask.")
@torque_off_option
def sync_limits(file: str, yes: bool, torque_off: bool) -> None:
    """Keep the limits of the joints in the servos too, so that they hold whoever commands them.

    Shows what it would write, asks, writes, and reads back. The limits of a servo lie inside those of its joint, the
    lower one first whatever the direction. Nothing moves: a servo that stands outside is refused. What was there before
    is kept in a folder beside FILE; `robot apply --undo` brings it back.
    """
    with robot(read_file(file), incomplete=True) as opened, signals_as_interrupt():
        found = opened.plan_limits()
        click.echo(str(found))
        if not found.changes():
            if found.problems:
                raise click.exceptions.Exit(1)
            return
        _check_torque(found, torque_off=torque_off, offsets=False)
        with unless_nobody_answers("--yes writes it without a question"):
            if not yes and not click.confirm(_question(found, offsets=False)):
                raise ServobusError("nothing was written")
        done = opened.sync_limits(found, torque_off=torque_off)
        for who, names in done.written.items():
            click.echo(f"{who}: written {', '.join(names)}")
        click.echo(f"what was there before is in {done.run.folder}; {_undo_hint(file)}")


def _question(found: Plan, *, offsets: bool) -> str:
    count, kept = found.changes(offsets=offsets), found.eeprom_writes(offsets=offsets)
    return f"write {'this value' if count == 1 else f'these {count} values'}, {kept} of them to the EEPROM?"


def _check_torque(found: Plan, *, torque_off: bool, offsets: bool) -> None:
    driven = [one for one in found.servos if one.driven and one.to_write(offsets=offsets)]
    for one in driven if torque_off else ():
        note(f"{one.who} goes limp: hold what hangs on it")
    if driven and not torque_off:
        who = ", ".join(one.who for one in driven)
        raise ServobusError(
            f"the torque of {who} is on, and settings can move a servo: switch it off first, or say --torque-off; "
            "nothing was written"
        )


def _undo(opened: Robot, file: str, *, torque_off: bool, yes: bool) -> None:
    run = Backups(opened.file).latest()
    if run is not None:
        servos = ", ".join(sorted({one.joint for one in run.servos()}))
        with unless_nobody_answers("--yes brings it back without a question"):
            if not yes and not click.confirm(f"bring back what {servos} held before the run in {run.folder}?"):
                raise ServobusError("nothing was written")
    try:
        done = opened.undo_settings(torque_off=torque_off)
    except (BusError, PortError, NotRestored, KeyboardInterrupt):
        note(
            f"what is not brought back yet is so when this command is given again: `servobus robot apply {file} --undo`"
        )
        raise
    for who, names in done.items():
        click.echo(f"{who}: brought back {', '.join(names)}" if names else f"{who}: held it already")


def _undo_hint(file: str) -> str:
    return f"`servobus robot apply {file} --undo` brings it back"


def _note_broken_off(opened: Robot, file: str) -> None:
    run = Backups(opened.file).latest()
    if run is not None and run.state == "under way":
        note(
            f"an earlier apply was broken off ({run.folder}): `servobus robot apply {file}` does the rest; "
            f"{_undo_hint(file)}"
        )
    if run is not None and run.state == "being undone":
        note(f"an undo was broken off ({run.folder}): `servobus robot apply {file} --undo` does the rest")
