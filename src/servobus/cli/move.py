"""`move`: servos to angles."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import click

from servobus import Bus, BusServo, ByServo, Move, MoveTimeout, ServobusError
from servobus.cli.finding import Where, find_all, open_port
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.options import as_json, on_port, verb
from servobus.cli.output import console, note, print_json
from servobus.cli.stop import stop_all
from servobus.cli.values import ALL, IDS, SECONDS, SPEED, split_assignment
from servobus.core.units import parse, show, shown
from servobus.core.values import frozen
from servobus.errors import BadValue, UsageError
from servobus.families.present import model_name
from servobus.jobs.move import GRACE

if TYPE_CHECKING:
    from rich.console import RenderableType

DRAW_PERIOD = 0.04
"""s between two drawings of the way."""
LONGEST = 3600.0
"""s that a move may take: nothing moves that slowly on purpose."""


@verb(
    "move",
    "servobus move /dev/ttyUSB0 1=90",
    "servobus move /dev/ttyUSB0 1=90 2=45.5 3=1.2rad --time 1.5",
    "servobus move /dev/ttyUSB0 1-4,7=150",
    "servobus move /dev/ttyUSB0 1+=5 2-=5      # 5° further, 5° back",
    "servobus move virtual:lx16a@1,2 1=0 2=240 --speed 60deg/s",
)
@on_port
@click.argument("goals", metavar="ID=ANGLE...", nargs=-1, required=True)
@click.option("--time", type=SECONDS, metavar="S", help="Seconds that the move takes.")
@click.option("--speed", type=SPEED, metavar="DEG/S", help="Speed of the servo with the longest way; else 90°/s.")
@click.option("--no-wait", is_flag=True, help="Come back as soon as they move.")
@as_json
def move(
    port: str,
    where: Where,
    goals: tuple[str, ...],
    time: float | None,
    speed: float | None,
    no_wait: bool,
    json: bool,
) -> None:
    """Move servos on PORT to angles, so that they start and arrive together.

    Angles are degrees (90, 90deg) or 1.57rad; 1=-5 is the angle -5°. From where a servo is, 1+=5 (or 1=+5) goes 5°
    further and 1-=5 goes 5° back. ID is 1, 1-4,7 or `all`. Torque that is off is switched on, from where each servo is,
    and stays on. Nothing moves unless all of it can be done. Ctrl-C stops the servos where they are.
    """
    if time is not None and speed is not None:
        raise click.UsageError("a move takes either --time or --speed, not both")
    for name, value in (("--time", time), ("--speed", speed)):
        if value is not None and value <= 0:
            raise click.UsageError(f"{name} must be above 0")
    if time is not None and time > LONGEST:
        raise click.UsageError(f"--time {time:g} is more than {LONGEST:g} s")
    wanted = _goals(goals)
    with open_port(port) as bus, signals_as_interrupt():
        angles = _by_servo(bus, where, wanted)
        servos = list(angles)
        try:
            under_way = _start(bus, angles, time, speed, no_wait=no_wait, quiet=json)
            if no_wait:
                if not json:
                    click.echo(f"moving for {under_way.duration:.2f} s")
            elif console().is_terminal and not json:
                _show_progress(bus, servos, angles, under_way)
            else:
                under_way.wait()
        except KeyboardInterrupt:
            stop_all(bus, servos)
            raise click.exceptions.Exit(130) from None
        except MoveTimeout:
            _print_positions(bus, servos, angles, json=json)
            raise
        if json or not no_wait:
            _print_positions(bus, servos, angles, json=json)


@frozen
class Goal:
    """Where a servo is to go: an angle in rad, or so far from where it is."""

    angle: float
    relative: bool

    @classmethod
    def parse(cls, sign: str, text: str) -> "Goal":
        """Read what stands before and behind the = of "1=90", "1=+5", "1+=5" and "1-=5". Raises ValueError."""
        try:
            angle = parse(text, "rad")
        except ValueError as error:
            hint = "; an angle is 90, 90deg or 1.57rad" if "unit" in str(error) else ""
            raise ValueError(f"{error}{hint}") from None
        if abs(angle) > 4 * math.pi and text.lower().rstrip().endswith("rad"):
            degrees = text.lower().rstrip().removesuffix("rad").strip()
            raise ValueError(f"{text} are {show(angle, 'rad')}; did you mean {degrees}, in degrees?")
        return cls(-angle if sign == "-" else angle, bool(sign) or text.startswith("+"))

    def of(self, servo: BusServo) -> float:
        """Give the angle that is meant for a servo; a relative one asks where it is."""
        if not self.relative:
            return self.angle
        here: float = servo.read("present_position")
        return here + self.angle


def _goals(texts: Sequence[str]) -> dict[int | Literal["all"], Goal]:
    """Read ID=ANGLE..., where ID may be 1-4,7 or `all`."""
    goals: dict[int | Literal["all"], Goal] = {}
    for text in texts:
        word, angle = split_assignment(text, "ID=ANGLE, such as 1=90, or 1+=5 for 5° further")
        sign = word[-1] if word.endswith(("+", "-")) else ""
        try:
            ids = IDS.convert(word.removesuffix(sign), None, None)
        except BadValue as error:
            raise click.UsageError(str(error)) from None
        try:
            goal = Goal.parse(sign, angle)
        except ValueError as error:
            raise click.UsageError(f"id {word}: {error}") from None
        for id in [ALL] if isinstance(ids, str) else ids:
            if id in goals:
                raise click.UsageError(f"id {id} is named twice")
            goals[id] = goal
    if ALL in goals and len(goals) > 1:
        raise click.UsageError(f"say either ids or `{ALL}`")
    return goals


def _by_servo(bus: Bus, where: Where, goals: Mapping[int | Literal["all"], Goal]) -> dict[BusServo, float]:
    """Find the servos, and give the angle that each shall go to. Raises ServobusError if one of them is not there."""
    if ALL in goals:
        return {servo: goals[ALL].of(servo) for servo in find_all(bus, where, ALL)}
    servos = find_all(bus, where, tuple(id for id in goals if id != ALL))
    return {servo: goals[servo.id].of(servo) for servo in servos}


def _start(
    bus: Bus, angles: Mapping[BusServo, float], time: float | None, speed: float | None, *, no_wait: bool, quiet: bool
) -> Move:
    """Check everything, then switch the torque on where it is off, then start."""
    planned = bus.plan_move(angles, time=time, speed=speed)
    if no_wait and len(planned.legs) > 1:
        step = show(planned.duration / len(planned.legs), "s")
        raise UsageError(
            f"this move takes {show(planned.duration, 's')}, and goes to the servo in parts of {step}, so the command "
            "must wait for it; leave --no-wait out, or go faster"
        )
    without_torque = [servo for servo in angles if servo.target in planned.without_torque]
    try:
        if without_torque:
            bus.torque_on(without_torque)
        bus.start_planned(planned)
    except ServobusError:
        bus.torque_off(without_torque)  # leave them as they were
        raise
    if without_torque and not quiet:
        note(f"torque switched on: {', '.join(f'id {servo.id}' for servo in without_torque)}")
    return Move(bus, planned)


def _show_progress(bus: Bus, servos: Sequence[BusServo], angles: Mapping[BusServo, float], under_way: Move) -> None:
    """Show the way until all have arrived. Raises MoveTimeout."""
    from rich.live import Live  # noqa: PLC0415 - slow to import, and only wanted on terminals

    clock = bus.transport
    end = clock.now() + under_way.duration + GRACE
    with Live(console=console(), auto_refresh=False, transient=True) as live:
        while True:
            live.update(_progress_table(servos, angles, bus.read_all("present_position")), refresh=True)
            if clock.now() >= end or under_way.done:
                break
            clock.sleep(DRAW_PERIOD)
    under_way.wait()


def _progress_table(
    servos: Sequence[BusServo], angles: Mapping[BusServo, float], positions: ByServo[BusServo, float]
) -> "RenderableType":
    from rich.table import Table  # noqa: PLC0415 - slow to import, and only wanted on terminals

    from servobus.cli.progress import angle_column, goal_range, position_bar  # noqa: PLC0415 - needs rich

    table = Table.grid(padding=(0, 1))
    for servo in servos:
        here, goal = positions[servo], angles[servo]
        way = position_bar(here, goal, *goal_range(servo.model), 32)
        table.add_row(f"{servo.target}", angle_column(here), way, f"-> {angle_column(goal).strip()}")
    return table


def _print_positions(bus: Bus, servos: Sequence[BusServo], angles: Mapping[BusServo, float], *, json: bool) -> None:
    """Print where all servos are."""
    positions = bus.read_all("present_position")
    if json:
        print_json(
            [
                {
                    "id": servo.id,
                    "model": model_name(servo.model),
                    "position": shown(positions[servo], "rad")[0],
                    "goal": shown(angles[servo], "rad")[0],
                    "unit": "°",
                }
                for servo in servos
            ]
        )
        return
    width = max(len(str(servo.target)) for servo in servos)
    for servo in servos:
        alarm = f"  ALARM {servo.alarm_text()}" if servo.alarms else ""
        click.echo(f"{servo.target!s:<{width}}  {show(positions[servo], 'rad')}{alarm}")
