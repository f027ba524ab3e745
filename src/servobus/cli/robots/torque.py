"""`robot torque` and `robot stop`: joints held, let go, and stopped."""

import click

from servobus import robot
from servobus.cli import complete
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.options import as_json, verb
from servobus.cli.output import print_json
from servobus.cli.robots.under_way import switch_on
from servobus.core.operation import Priority
from servobus.errors import RobotMismatch
from servobus.robots.blocking import Robot, RobotJoint
from servobus.robots.file.reading import read_file
from servobus.robots.joints import jobs

file_argument = click.argument("file", type=click.Path())
joints_argument = click.argument("joints", metavar="[JOINT]...", nargs=-1, shell_complete=complete.joints)


@verb(
    "torque",
    "servobus robot torque arm.toml off",
    "servobus robot torque arm.toml on shoulder elbow",
)
@file_argument
@click.argument("state", metavar="on|off", type=click.Choice(["on", "off"]))
@joints_argument
@as_json
def torque(file: str, state: str, joints: tuple[str, ...], json: bool) -> None:
    """Switch the torque of the joints of FILE on or off, of all of them or of those that are named.

    On: each holds where it is, nothing moves, and none is switched on unless all can be. Off: the joints turn freely,
    so hold what would fall; each is switched off, though others do not answer.
    """
    with robot(read_file(file), incomplete=True) as arm, signals_as_interrupt():
        wanted = arm.named(*joints)
        if state == "on":
            _check_there(arm, wanted)
            switch_on(wanted, quiet=True)
        else:
            arm.do(jobs.torque_off(wanted), priority=Priority.MOTION)
    names = [joint.name for joint in wanted]
    if json:
        print_json({"torque": state == "on", "joints": names})
    else:
        click.echo(f"torque {state}: {', '.join(names)}")


@verb("stop", "servobus robot stop arm.toml", "servobus robot stop arm.toml grip")
@file_argument
@joints_argument
@as_json
def stop(file: str, joints: tuple[str, ...], json: bool) -> None:
    """Stop the joints of FILE where they are, all of them or those that are named.

    A joint is held where it is, or let go where its servo stands outside its limits; what was done is printed. What may
    still move is told at the end. A port that another program uses is not free for this: Ctrl-C there stops its joints.
    """
    with robot(read_file(file), incomplete=True) as arm, signals_as_interrupt():
        wanted = arm.named(*joints)
        done = arm.do(jobs.stop(wanted), priority=Priority.STOP)
    # What a servo says of itself has its own angles in it, which are not those of the joint.
    said = {
        name: "; ".join(dict.fromkeys(end.text if end.let_go else "held where it is" for end in ends))
        for name, ends in done.items()
    }
    if json:
        held = {name: not any(end.let_go for end in ends) for name, ends in done.items()}
        print_json({name: {"held": held[name], "done": text} for name, text in said.items()})
        return
    for name, text in said.items():
        click.echo(f"{name}: {text}")


def _check_there(arm: Robot, joints: list[RobotJoint]) -> None:
    """Raise RobotMismatch where a joint is not there as the file says."""
    if why := arm.attendance.unusable(joints):
        raise RobotMismatch(f"{'; '.join(dict.fromkeys(why.values()))}; nothing was done", arm.attendance.grave)
