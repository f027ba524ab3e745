"""`robot show`: the joints of a robot, once or live."""

from typing import TYPE_CHECKING, Any

import click

from servobus import robot
from servobus.bus.rate import Rate
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.options import as_json, verb
from servobus.cli.output import console, print_json, quantity_entry
from servobus.cli.robots.under_way import recording
from servobus.core.units import show as shown
from servobus.robots.blocking import Robot, RobotJoint
from servobus.robots.file.reading import read_file
from servobus.robots.joints.jobs import JointState
from servobus.robots.values import ByJoint

if TYPE_CHECKING:
    from rich.console import RenderableType

PERIOD = 0.1
"""s between two drawings."""
BAR = 20
"""Columns of the bar between the limits of a joint."""


@verb(
    "show",
    "servobus robot show arm.toml",
    "servobus robot show arm.toml --once",
    "servobus robot show arm.toml --json",
    "servobus robot show arm.toml --record run.csv",
)
@click.argument("file", type=click.Path())
@click.option("--once", is_flag=True, help="Show it once, and end.")
@click.option("--record", metavar="OUT", help="Keep the angles in a file until Ctrl-C: OUT.csv or OUT.mcap.")
@as_json
def show(file: str, once: bool, record: str | None, json: bool) -> None:
    """Show the joints of FILE: angle and goal between the limits, voltage, temperature, torque, alarms. Moves nothing.

    On a terminal the table is drawn again and again until Ctrl-C; else, or with --once, it is shown once. Joints that
    do not answer are named.
    """
    if record is not None and (once or json):
        raise click.UsageError("--record goes on until Ctrl-C: leave --once and --json out")
    with robot(read_file(file), incomplete=True) as arm, signals_as_interrupt():
        if json:
            seen, goals = arm.look(), arm.read("goal_position")
            print_json([_entry(joint, seen, goals) for joint in arm])
            return
        if once or (record is None and not console().is_terminal):
            console().print(_table(arm, arm.look(), arm.read("goal_position")))
            return
        from rich.live import Live  # noqa: PLC0415 - slow to import, and only wanted on terminals

        try:
            with (
                recording(record, arm, list(arm), []) as write,
                Live(console=console(), auto_refresh=False) as live,
            ):
                for _ in Rate(arm, arm.ports.now, PERIOD):
                    seen = arm.look()
                    write({name: state.position for name, state in seen.items()}, {})
                    if console().is_terminal:
                        live.update(_table(arm, seen, arm.read("goal_position")), refresh=True)
        except KeyboardInterrupt:
            pass  # that is how it ends


def _alarms(joint: RobotJoint) -> str:
    return "; ".join(part.servo.alarm_text() for part in joint.parts if part.servo.alarms)


def _goal(joint: RobotJoint, seen: ByJoint[JointState], goals: ByJoint[float]) -> float | None:
    """Give where a joint is sent; None for a limp one, which goes nowhere."""
    return goals[joint.name] if seen[joint.name].torque and joint.name in goals else None


def _entry(joint: RobotJoint, seen: ByJoint[JointState], goals: ByJoint[float]) -> dict[str, Any]:
    low, high = joint.limits
    entry: dict[str, Any] = {
        "joint": joint.name,
        "limits": [quantity_entry(low, "rad"), quantity_entry(high, "rad")],
    }
    if joint.name in seen.lost:
        return {**entry, "error": str(seen.lost[joint.name])}
    state, goal = seen[joint.name], _goal(joint, seen, goals)
    return {
        **entry,
        "position": quantity_entry(state.position, "rad"),
        "goal": None if goal is None else quantity_entry(goal, "rad"),
        "voltage": quantity_entry(state.voltage, "V"),
        "temperature": quantity_entry(state.temperature, "degC"),
        "torque": state.torque,
        "alarms": _alarms(joint) or None,
        "disagreement": quantity_entry(state.disagreement, "rad") if len(joint.parts) > 1 else None,
    }


def _table(arm: Robot, seen: ByJoint[JointState], goals: ByJoint[float]) -> "RenderableType":
    from rich.table import Table  # noqa: PLC0415 - slow to import
    from rich.text import Text  # noqa: PLC0415

    from servobus.cli.progress import angle_column, position_bar  # noqa: PLC0415 - needs rich

    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, header_style="bold")
    for header in ("joint", "angle", "goal", "limits", "V", "°C"):
        table.add_column(header, justify="left" if header in ("joint", "limits") else "right", no_wrap=True)
    table.add_column("torque", no_wrap=True)
    table.add_column("alarms", overflow="fold")
    for joint in arm:
        if joint.name in seen.lost:
            table.add_row(
                joint.name, "", "", Text("another servo" if joint.mistaken else "no answer", style="bold red")
            )
            continue
        state, goal = seen[joint.name], _goal(joint, seen, goals)
        apart = f"{shown(state.disagreement, 'rad')} apart" if state.disagreement > joint.disagreement else ""
        trouble = "; ".join(text for text in (_alarms(joint), state.shutdown, apart) if text)
        table.add_row(
            joint.name,
            angle_column(state.position),
            "" if goal is None else angle_column(goal),
            position_bar(state.position, goal, *joint.limits, BAR),
            f"{state.voltage:.1f}",
            f"{state.temperature:.0f}",
            "half" if state.half else "on" if state.torque else "off",
            Text(trouble, style="bold red"),
        )
    return table
