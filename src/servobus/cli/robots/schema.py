"""`robot schema`: what an editor checks a robot file with."""

import click

from servobus.cli.options import verb
from servobus.robots.file.schema import shipped


@verb("schema", "servobus robot schema > robot.schema.json")
def schema() -> None:
    """Print the JSON Schema of robot files, with which an editor checks and completes them.

    Editors that know TOML by Taplo use it where the first line of the robot file is `#:schema ./robot.schema.json`.
    """
    click.echo(shipped(), nl=False)
