"""`robot check`: who is there, compared with the robot file."""

import click

from servobus import robot
from servobus.cli.options import verb
from servobus.cli.output import print_json


@verb("check", "servobus robot check arm.toml", "servobus robot check arm.toml --json")
@click.argument("file", type=click.Path())
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def check(file: str, as_json: bool) -> None:
    """Compare who answers on the ports of FILE with what FILE says: missing, strangers, wrong or swapped models.

    Nothing moves and nothing is written. The exit code is 1 where something is not as the file says.
    """
    with robot(file, incomplete=True) as opened:
        found = opened.check()
    if as_json:
        fields = ("kind", "joint", "port", "text")
        print_json([{field: getattr(finding, field) for field in fields} for finding in found.findings])
    else:
        click.echo(str(found))
    if not found:
        raise click.exceptions.Exit(1)
