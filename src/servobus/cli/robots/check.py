"""`robot check`: who is there, compared with the robot file."""

from collections.abc import Iterable
from contextlib import ExitStack

import click

from servobus import robot
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.options import verb
from servobus.cli.output import note, print_json
from servobus.cli.scan import ProgressBar
from servobus.robots.blocking import Robot
from servobus.robots.joints.attendance import Finding, Sought, ids_to_ask


@verb(
    "check",
    "servobus robot check arm.toml",
    "servobus robot check arm.toml --quick",
    "servobus robot check arm.toml --json",
)
@click.argument("file", type=click.Path())
@click.option("--quick", is_flag=True, help="Look for strangers of the families and at the speeds in FILE alone.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def check(file: str, quick: bool, as_json: bool) -> None:
    """Compare who answers on the ports of FILE with what FILE says: missing, strangers, wrong or swapped servos.

    What is wrong with the servos in FILE is told at once. Then strangers are looked for, at every id, in every family
    and at every speed, which takes half a minute or more; Ctrl-C ends that. Nothing moves and nothing is written. The
    exit code is 1 where something is not as FILE says.
    """
    with robot(file, incomplete=True) as opened, signals_as_interrupt():
        first = opened.attendance.findings
        if not as_json:
            _tell(opened, first)
        found = _searched(opened, "file" if quick else "everywhere")
    if found is None:
        note("strangers were not looked for everywhere: that was broken off")
        if as_json:
            print_json([_entry(one) for one in first])
        raise click.exceptions.Exit(130)
    if as_json:
        print_json([_entry(one) for one in found])
    else:
        _tell(opened, [one for one in found if one not in first])
        if not found:
            click.echo(str(opened.attendance))
    if found:
        raise click.exceptions.Exit(1)


def _searched(opened: Robot, strangers: Sought) -> tuple[Finding, ...] | None:
    """Compare all, and show how far that is. Gives None where it was broken off."""
    with ExitStack() as stack:
        bar = ProgressBar(stack, ids_to_ask(opened.buses, opened, strangers))
        try:
            return opened.check(strangers=strangers, watch=lambda _: bar.advance()).findings
        except KeyboardInterrupt:
            bar.remove()
            return None


def _tell(opened: Robot, findings: Iterable[Finding]) -> None:
    for finding in findings:
        click.echo(f"{opened.file.name}: {finding.text}")


def _entry(finding: Finding) -> dict[str, str]:
    return {field: getattr(finding, field) for field in ("kind", "joint", "port", "text")}
