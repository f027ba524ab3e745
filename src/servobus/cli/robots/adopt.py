"""`robot adopt`: a new servo in the place of a dead one."""

from contextlib import ExitStack
from pathlib import Path

import click

from servobus import ServobusError, open, robot
from servobus.cli.backup import read_backup
from servobus.cli.interrupts import signals_as_interrupt, unless_nobody_answers
from servobus.cli.options import verb
from servobus.cli.output import note
from servobus.cli.robots.settings import file_argument
from servobus.core.values import replace
from servobus.jobs.backup import Backup
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_file
from servobus.robots.opening import port_path
from servobus.robots.settings import adopting
from servobus.robots.settings.adopting import Vacancy
from servobus.robots.settings.backups import Backups


@verb(
    "adopt",
    "servobus robot adopt arm.toml",
    "servobus robot adopt arm.toml elbow --port /dev/ttyUSB1",
    "servobus robot adopt arm.toml elbow --backup elbow.toml",
)
@file_argument
@click.argument("joint", required=False)
@click.option("--port", metavar="PORT", help="Where the new servo is, if not on the port of its joint.")
@click.option("--backup", "backup_file", type=click.Path(), metavar="FILE", help="Settings of the old servo.")
@click.option("--yes", is_flag=True, help="Do not ask.")
def adopt(file: str, joint: str | None, port: str | None, backup_file: str | None, yes: bool) -> None:
    """Put a new servo in the place of the one of JOINT that does not answer any more.

    The new servo is the only one on the port that is in no joint of FILE; all speeds are tried. It gets the settings of
    the old one, as the last `robot apply` has kept them or as a backup has them, those in FILE, speed and id. Nothing
    moves. A new servo with the id of another one goes on an adapter of its own first: --port.
    """
    with ExitStack() as stack:
        opened = stack.enter_context(robot(read_file(file), incomplete=True))
        stack.enter_context(signals_as_interrupt())
        if joint is not None:
            opened[joint]  # a name that is none is told before anything is asked
        backups = Backups(opened.file)
        if (left := adopting.left_over(opened.attendance, opened.joints, backups, joint)) is not None:
            _finish(opened, backups, *left)
            return
        vacancy = adopting.vacant(opened.attendance, opened.joints, joint)
        name = vacancy.part.port if port is None else port
        elsewhere = name not in opened.buses
        bus = stack.enter_context(open(port_path(name))) if elsewhere else opened.buses[name]
        known = [] if elsewhere else [part for one in opened for part in one.parts if part.port == name]
        note(f"looking for the new servo of {vacancy} at all speeds; nothing moves")
        found = bus.do(adopting.newcomer(bus, vacancy, known))
        saved, source = _saved(backups, vacancy, backup_file)
        plan = bus.do(adopting.adoption(vacancy, found, saved, source))
        click.echo(str(plan))
        with unless_nobody_answers("--yes does so without a question"):
            if not yes and not click.confirm("write this to the new servo?"):
                raise ServobusError("nothing was written")
        kept_in = backups.keep_new(vacancy.joint.name, vacancy.n, plan.before)
        with backups.adopting(vacancy.joint.name, vacancy.n, plan.wanted):
            target = bus.do(adopting.carry_out(plan, bus.transport.name, kept_in))
            backups.keep_last(vacancy.joint.name, vacancy.n, plan.after)
        click.echo(f"{target} at {target.baud} baud takes the place of {vacancy}; as it was is in {kept_in}")
        if elsewhere:
            note(
                f"plug it in on port {vacancy.part.port} now; `servobus robot check {file}` tells whether all is there"
            )
            return
        vacancy.part.servo.target = replace(vacancy.part.servo.target, answers=target.answers)
        _check(opened)


def _finish(opened: Robot, backups: Backups, left: Vacancy, saved: Backup) -> None:
    """Give a servo what it lacks because its adoption was broken off. It was agreed to then."""
    bus, servo = opened.buses[left.part.port], left.part.servo
    with backups.adopting(left.joint.name, left.n, saved):
        servo.target = bus.do(adopting.finish(left, saved))
    click.echo(f"{left} was in its place already, and has all its settings now: its adoption had been broken off")
    _check(opened)


def _saved(backups: Backups, vacancy: Vacancy, file: str | None) -> tuple[Backup | None, str]:
    """Give the settings of the old servo, and where they come from."""
    if file is not None:
        return read_backup(Path(file)), file
    joint, n = vacancy.joint.name, vacancy.n
    return backups.last(joint, n), str(backups.last_path(joint, n))


def _check(opened: Robot) -> None:
    """Compare all servos with the file, now that the new one is in its place."""
    found = opened.check(strangers="near")
    click.echo(str(found))
    if found.grave:
        raise click.exceptions.Exit(1)
