"""`step`: the answer of a servo to a step of its goal, virtual or real."""

import contextlib
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import servobus
from servobus import MODELS, Bus, BusServo, UsageError, deg
from servobus.cli import complete, plot
from servobus.cli.finding import Where, find, open_port
from servobus.cli.interrupts import signals_as_interrupt, unless_nobody_answers
from servobus.cli.options import as_json, verb, where_options
from servobus.cli.output import note, print_json
from servobus.cli.response import Response, Sample
from servobus.cli.stop import stop_all
from servobus.cli.values import ANGLE, SECONDS, check_above_0, split_assignment
from servobus.core.ids import check_id
from servobus.core.units import show, shown
from servobus.errors import BadValue, ServobusError
from servobus.families import registry
from servobus.families.base import require_model
from servobus.jobs.move import SHORTEST

if TYPE_CHECKING:
    from servobus.virtual.device.servo import VirtualServo
    from servobus.virtual.serve.inprocess import VirtualPort

SAMPLE_PERIOD = 0.001
"""s between two samples of a virtual servo."""
SETTLE_TIME = 0.5
"""s that a virtual servo is given to come to rest before the step."""
LONGEST = 60.0
"""s that can be looked on: all samples are kept."""
STEP = 45 * deg
"""rad that a step is long if nothing is said."""
RETURN_SPEED = 60 * deg
"""rad/s at which a real servo goes back."""


@verb(
    "step",
    "servobus step rx28 --to 90deg",
    "servobus step drs0602 --set position_kp=200 --load inertia=0.02 --plot a.png",
    "servobus step /dev/ttyUSB0 1 --to 90 --limits 60 120",
)
@click.argument("what", metavar="MODEL|PORT", shell_complete=complete.models)
@click.argument("id", required=False, type=int)
@click.option("--to", "to", type=ANGLE, metavar="ANGLE", help="Goal; 45° from where it is by default.")
@click.option("--start", type=ANGLE, metavar="ANGLE", help="Where a virtual servo starts; the middle by default.")
@click.option("--time", "time_", type=SECONDS, metavar="S", help="Time of the move; as fast as it goes by default.")
@click.option("--seconds", type=SECONDS, default=2.0, metavar="S", help="How long to look on; 2 s by default.")
@click.option("--set", "settings", multiple=True, metavar="REGISTER=VALUE", help="Write a register first.")
@click.option("--load", metavar="LOAD", help="What hangs on a virtual shaft: mass=0.5,length=0.1,inertia=...")
@click.option("--voltage", type=float, metavar="V", help="Supply of a virtual servo.")
@click.option("--motor", metavar="NAME", help="Set of motor data of a virtual servo.")
@click.option("--limits", nargs=2, type=ANGLE, metavar="LOW HIGH", help="How far a real servo may go; else asked.")
@click.option("--plot", "picture", type=click.Path(path_type=Path), metavar="FILE", help="Draw it: png, svg or pdf.")
@where_options
@as_json
def step(
    what: str,
    id: int | None,
    to: float | None,
    start: float | None,
    time_: float | None,
    seconds: float,
    settings: tuple[str, ...],
    load: str | None,
    voltage: float | None,
    motor: str | None,
    limits: tuple[float, float] | None,
    picture: Path | None,
    where: Where,
    json: bool,
) -> None:
    """Give a servo a step of its goal and measure what it does.

    With the name of a MODEL a virtual servo takes the step, faster than real time. With a PORT and an ID a real
    one does, within limits that are asked for first; it then goes back slowly, and registers set by --set stay.
    Ctrl-C stops it where it is; its torque is then as it was before.
    """
    if not 0 < seconds <= LONGEST:
        raise click.BadParameter(f"{seconds:g} is not above 0 and up to {LONGEST:g}", param_hint="--seconds")
    check_above_0("--time", time_)
    if picture is not None:
        plot.check(picture)
    if id is None:
        if what.replace("-", "").lower() not in MODELS and _is_port(what):
            raise click.UsageError(f"{what} is a port: name the ID of a servo on it too, as in {what} 1")
        if limits is not None:
            raise click.UsageError("--limits are for real servos; a virtual one breaks nothing")
        response, title = _virtual_response(what, to, start, time_, seconds, settings, load, voltage, motor)
    else:
        for name, value in (("--load", load), ("--voltage", voltage), ("--motor", motor), ("--start", start)):
            if value is not None:
                raise click.UsageError(f"{name} is for virtual servos: `servobus step MODEL ...`")
        response, title = _real_response(what, check_id(id), where, to, time_, seconds, settings, limits)
    _print_figures(response, title, json=json)
    if picture is not None:
        plot.draw(response, title, picture)
        note(f"drawn: {picture}")


def _is_port(what: str) -> bool:
    return "/" in what or ":" in what or what.startswith("COM") or Path(what).exists()


# A virtual servo


def _virtual_response(
    name: str,
    to: float | None,
    start: float | None,
    duration: float | None,
    seconds: float,
    settings: tuple[str, ...],
    load: str | None,
    voltage: float | None,
    motor: str | None,
) -> tuple[Response, str]:
    model = registry.model(name)
    options = {"clock": "virtual", "motor": motor, "load": load, "voltage": voltage}
    query = "&".join(f"{key}={value}" for key, value in options.items() if value is not None)
    with servobus.open(f"virtual:{model.key()}@1?{query}") as bus:
        port: VirtualPort = bus.transport  # type: ignore[assignment] # a virtual: port is one
        servo = bus.find(1, family=model.family)
        _set(servo, settings)
        bounds = _bounds(bus, servo)
        if start is not None:
            _check_start(servo, start, bounds)
            port.servos[0].turn_shaft(start)
        servo.torque_on()
        port.sleep(SETTLE_TIME)
        here = servo.look().position
        goal = _goal(here, bounds) if to is None else to
        begin = port.now()
        servo.start_move(goal, time=duration or SHORTEST)
        samples = [_sample(port.servos[0], port.now() - begin)]
        while port.now() - begin < seconds:
            port.sleep(SAMPLE_PERIOD)
            samples.append(_sample(port.servos[0], port.now() - begin))
    return Response(here, goal, tuple(samples), model.sheet.resolution), f"{model.title}, virtual"


def _bounds(bus: Bus, servo: BusServo) -> tuple[float, float]:
    """Give the lowest and the highest goal that a servo takes now, rad."""
    row = servo.model.register("goal_position")
    status = bus.do(servo.family.motion_status(servo.target), baud=servo.baud)
    return row.decode(status.low), row.decode(status.high)


def _check_start(servo: BusServo, start: float, bounds: tuple[float, float]) -> None:
    """Refuse a start where no goal could be. Raises BadParameter."""
    low, high = bounds
    if not low <= start <= high:
        where = f"{show(low, 'rad')} .. {show(high, 'rad')}, where {servo.model.title} takes goals"
        raise click.BadParameter(f"{show(start, 'rad')} is not in {where}", param_hint="--start")


def _goal(here: float, bounds: tuple[float, float]) -> float:
    """Choose a goal where none is said: STEP on from here, or back where that is too far."""
    return here + STEP if here + STEP <= bounds[1] else here - STEP


def _sample(servo: "VirtualServo", moment: float) -> Sample:
    shaft, trajectory = servo.shaft, servo.trajectory
    return Sample(
        moment, servo.position, math.nan if trajectory is None else trajectory,
        shaft.velocity, shaft.duty, shaft.current, servo.voltage, servo.temperature,
    )  # fmt: skip


# A real one


def _real_response(
    port: str,
    id: int,
    where: Where,
    to: float | None,
    duration: float | None,
    seconds: float,
    settings: tuple[str, ...],
    limits: tuple[float, float] | None,
) -> tuple[Response, str]:
    with open_port(port) as bus, signals_as_interrupt():
        servo = find(bus, where, id)
        require_model(servo.target, "take a step")
        state = servo.look()
        here = state.position
        goal = _goal(here, _bounds(bus, servo)) if to is None else to
        low, high = limits or _ask_limits(servo, here, goal)
        if not low <= min(here, goal) <= max(here, goal) <= high:
            way = f"{show(here, 'rad')} to {show(goal, 'rad')}"
            raise BadValue(f"{servo.target}: the way from {way} leaves {show(low, 'rad')} .. {show(high, 'rad')}")
        _set(servo, settings)
        samples: list[Sample] = []
        with _torque_restored(servo, torque=state.torque):
            begin = time.monotonic()
            servo.start_move(goal, time=duration or SHORTEST)
            row = servo.model.register("present_position")
            while (moment := time.monotonic() - begin) < seconds:
                samples.append(Sample(moment, servo.read(row)))
            servo.move(here, speed=RETURN_SPEED).wait()
    return Response(here, goal, tuple(samples), row.scale.decode(1) - row.scale.decode(0)), f"{servo.target} on {port}"


def _ask_limits(servo: BusServo, here: float, goal: float) -> tuple[float, float]:
    """Ask how far the servo may go: a step is as fast as the servo can, and may hit something."""
    note(f"{servo.target} is at {show(here, 'rad')} and will jump to {show(goal, 'rad')} as fast as it can.")
    with unless_nobody_answers("say --limits LOW HIGH, the lowest and the highest angle that are safe"):
        low = click.prompt("lowest angle that is safe", type=ANGLE, err=True)
        high = click.prompt("highest angle that is safe", type=ANGLE, err=True)
    return low, high


@contextlib.contextmanager
def _torque_restored(servo: BusServo, *, torque: bool) -> Iterator[None]:
    """Torque on inside; afterwards as it was, and so is the speed that moves set in some. What fails stops it first."""
    speed = servo.model.optional("goal_speed")
    old_speed = None if speed is None else servo.read(speed)

    def restore() -> None:
        if not torque:
            servo.torque_off()
        if speed is not None:
            servo.write(speed, old_speed)

    try:
        if not torque:
            servo.torque_on()
        yield
    except (KeyboardInterrupt, ServobusError) as error:
        stop_all(servo._bus, [servo])
        try:
            restore()
        except ServobusError as failure:  # the first error is the one that is told
            note(f"servobus: {servo.target} may not be as it was before: {failure}")
        if isinstance(error, KeyboardInterrupt):
            raise click.exceptions.Exit(130) from None
        raise
    restore()


def _set(servo: BusServo, settings: tuple[str, ...]) -> None:
    values: dict[Any, Any] = {}
    for text in settings:
        name, value = split_assignment(text, "REGISTER=VALUE, such as position_kp=200")
        register = servo.model.register(name)
        if register in values:
            raise UsageError(f"{name} is set twice")
        values[register] = register.parse(value)
    servo.write_many(values)


# Printing


def _print_figures(response: Response, title: str, *, json: bool) -> None:
    figures = response.figures()
    rows = (
        ("rise_time", figures.rise_time, "s", "10 % to 90 % of the way"),
        ("overshoot", figures.overshoot, "1", "of the way"),
        ("settling_time", figures.settling_time, "s", "until it stays within 2 % of the way"),
        ("steady_error", figures.steady_error, "rad", "where it ends up, less the goal"),
        ("peak_current", figures.peak_current, "A", "of the motor"),
    )
    if json:
        data: dict[str, Any] = {"servo": title, "arrived": figures.arrived}
        for name, angle in (("start", response.start), ("goal", response.goal)):
            data[name] = {"value": shown(angle, "rad")[0], "unit": "°"}
        for name, value, unit, _ in rows:
            number, symbol = shown(value, unit)
            data[name] = {"value": None if math.isnan(value) else number, "unit": symbol}
        print_json(data)
        return
    click.echo(f"{title}: {show(response.start, 'rad')} to {show(response.goal, 'rad')}")
    for name, value, unit, meaning in rows:
        text = "-" if math.isnan(value) else show(round(value, 4) if unit in ("A", "s") else value, unit)
        click.echo(f"  {name.replace('_', ' '):<14} {text:>10}   {meaning}")
    if not figures.arrived:
        click.echo(f"  it did not arrive: it ends up at {show(response.goal + figures.steady_error, 'rad')}")
