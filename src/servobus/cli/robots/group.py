"""The verbs behind `servobus robot`: which there are, and what help says of them."""

from typing import ClassVar

import click

from servobus.cli.app import VerbGroup


class RobotGroup(VerbGroup):
    """The verbs of robots, each loaded when it is used."""

    verbs: ClassVar = {
        "Robot": {
            "init": ("robots.init:init", "Write a robot file from the servos of ports."),
            "check": ("robots.check:check", "Compare who answers with the robot file."),
            "show": ("robots.show:show", "Show the joints, live."),
            "move": ("robots.move:move", "Move joints to angles, together."),
            "torque": ("robots.torque:torque", "Hold the joints where they are, or let them go."),
            "stop": ("robots.torque:stop", "Stop the joints where they are."),
            "calibrate": ("robots.calibrate:calibrate", "Find zero, direction and limits of joints by hand."),
            "plan": ("robots.settings:plan", "Compare the servos' settings with the robot file."),
            "apply": ("robots.settings:apply", "Write the settings of the robot file."),
            "adopt": ("robots.adopt:adopt", "Put a new servo in the place of a dead one."),
            "undo": ("robots.undo:undo", "Bring the robot file back as it was before the last change."),
            "sync-limits": ("robots.settings:sync_limits", "Keep the limits of the joints in the servos too."),
            "export": ("robots.files:export", "Write a file of another program."),
            "import": ("robots.files:import_", "Take in a file of another program."),
            "schema": ("robots.schema:schema", "Print what an editor checks a robot file with."),
        },
    }


@click.group("robot", cls=RobotGroup, subcommand_metavar="COMMAND ...")
def robot() -> None:
    """Joints by name, over all ports and families: a robot file says which servos a robot has.

    FILE is a robot file (TOML). Angles are degrees, of the joint and not of its servo.
    """
