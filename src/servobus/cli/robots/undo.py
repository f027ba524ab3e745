"""`robot undo`: the robot file as it was before servobus changed it last."""

import difflib
from pathlib import Path

import click

from servobus.cli.options import verb
from servobus.robots.file import writing


@verb("undo", "servobus robot undo arm.toml")
@click.argument("file", type=click.Path())
def undo(file: str) -> None:
    """Bring back what stood in FILE before servobus changed it last: a calibration, a pose, a motion, an import.

    The lines that change are shown. The same again goes back further. What is undone is kept beside FILE, in a file
    whose name ends in .undone. No port is opened. `robot apply --undo` brings back settings of servos.
    """
    bring_back(file)


def bring_back(file: str) -> None:
    """Bring a robot file back as it was before the last change, and show what that changes. Raises RobotFileError."""
    path = Path(file)
    there = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
    made = writing.undo(file)
    for line in difflib.unified_diff(there.splitlines(), made.text.splitlines(), lineterm="", n=0):
        if not line.startswith(("---", "+++", "@@")):
            click.echo(line)
    click.echo(f"{file}: brought back; its joints are {', '.join(made.joints)}")
