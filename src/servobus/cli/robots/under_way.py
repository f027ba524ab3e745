"""What the verbs share that set a robot in motion: torque, a live table, recordings, motions by name or from a file."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from servobus.cli.output import console, note
from servobus.core.units import show, shown
from servobus.errors import ServobusError
from servobus.robots.blocking import Robot, RobotJoint
from servobus.robots.motions.motion import Motion
from servobus.robots.motions.recording import CSV, MCAP, Moment, recorder
from servobus.robots.values import ByJoint

if TYPE_CHECKING:
    from rich.console import RenderableType

DRAWN = 10
"""Drawings of a table in a second."""
SWITCH_INTERVAL = 0.0005
"""s after which Python takes the processor from the thread that draws; its 5 ms could be felt in the motion."""
Write: TypeAlias = Callable[[Mapping[str, float], Mapping[str, float]], None]
"""Takes the positions and the goals of a turn, joint -> rad."""
BAR = 24
"""Columns of the bar of a joint."""


def switch_on(joints: Sequence[RobotJoint], *, quiet: bool) -> None:
    """Switch the torque on of those that are limp, each where it stands: of all of them, or of none."""
    limp = [joint for joint in joints if not joint.look().torque]
    try:
        for joint in limp:
            joint.torque_on()
    except ServobusError:
        for joint in limp:
            joint.torque_off()
        raise
    if limp and not quiet:
        note(f"torque switched on: {', '.join(joint.name for joint in limp)}")


@contextmanager
def drawn(table: Callable[[], "RenderableType"], *, wanted: bool) -> Iterator[None]:
    """Draw a table again and again while the block runs, in a thread of its own; nothing where it is not wanted."""
    if not wanted or not console(stderr=True).is_terminal:
        yield
        return
    from rich.live import Live  # noqa: PLC0415 - slow to import, and only wanted on terminals

    sys.setswitchinterval(SWITCH_INTERVAL)
    live = Live(console=console(stderr=True), get_renderable=table, refresh_per_second=DRAWN, transient=True)
    live.start()
    try:
        yield
    finally:
        with suppress(OSError):  # a terminal that is gone
            live.stop()


def joint_table(
    head: str,
    joints: Sequence[RobotJoint],
    positions: ByJoint[float] | None,
    goals: Mapping[str, float],
    foot: str,
    marks: Mapping[str, str] | None = None,
) -> "RenderableType":
    """Draw joints: where they are, where they are sent, and a mark beside those that have one."""
    from rich.console import Group  # noqa: PLC0415 - as above
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    from servobus.cli.progress import angle_column, position_bar  # noqa: PLC0415 - needs rich

    table = Table.grid(padding=(0, 1))
    for joint in joints:
        name, goal = joint.name, goals.get(joint.name)
        cells: list[Any] = [name]
        if positions is None or name not in positions:
            cells += ["", Text("no answer" if positions is not None else "", style="bold red")]
        else:
            cells += [angle_column(positions[name]), position_bar(positions[name], goal, *joint.limits, BAR)]
        cells.append("" if goal is None else f"-> {angle_column(goal).strip()}")
        cells.append(Text((marks or {}).get(name, ""), style="yellow"))
        table.add_row(*cells)
    return Group(Text(head, style="bold"), table, Text(foot, style="dim"))


@contextmanager
def recording(
    path: str | None, robot: Robot, joints: Sequence[RobotJoint], goals: Sequence[RobotJoint]
) -> Iterator[Write]:
    """Give what writes positions and goals of a turn to a recording; it does nothing where there is none."""
    if path is None:
        yield lambda _positions, _goals: None
        return
    with recorder(Path(path), [joint.name for joint in joints], [joint.name for joint in goals]) as out:
        began: list[float] = []

        def write(positions: Mapping[str, float], goals: Mapping[str, float]) -> None:
            now = robot.ports.now()
            began.append(now)
            out.write(Moment(now - began[0], dict(positions), dict(goals)))
            del began[1:]

        yield write


def motion_named(robot: Robot, name: str) -> Motion:
    """Give a motion of the robot file; or, where a recording has this path, what was recorded."""
    if name not in robot.file.motions and Path(name).suffix.lower() in (CSV, MCAP):
        return motion_of_recording(robot, Path(name))
    motion = robot.motion(name)
    assert isinstance(motion, Motion)
    return motion


def motion_of_recording(robot: Robot, path: Path) -> Motion:
    """Make a motion of a recording, and tell what was lost in it."""
    from servobus.robots.motions.recording import read_recording  # noqa: PLC0415 - rarely wanted
    from servobus.robots.motions.thinning import kept  # noqa: PLC0415

    moments = read_recording(path)
    names = {name for moment in moments for name in moment.positions}
    found = kept(moments, robot.named(*names))
    for text in found.notes:
        note(text)
    return found.motion


def angles_entry(angles: Mapping[str, float]) -> dict[str, float]:
    """Give angles for JSON, in degrees."""
    return {name: round(shown(angle, "rad")[0], 3) for name, angle in angles.items()}


def angles_text(angles: Mapping[str, float]) -> str:
    """Write angles on one line."""
    return "  ".join(f"{name} {show(angle, 'rad')}" for name, angle in angles.items())
