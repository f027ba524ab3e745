"""`turn`: endless turn, as a wheel."""

import click

from servobus import Bus, BusServo, ServobusError
from servobus.cli.advice import command_for
from servobus.cli.finding import Where, find, open_port
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.options import as_json, on_servo, verb
from servobus.cli.output import note, print_json, quantity_entry, warn_alarms
from servobus.cli.stop import stop_all
from servobus.cli.values import ANGLE, CURRENT, SHARE, SPEED
from servobus.core.units import show
from servobus.errors import BadValue, UsageError
from servobus.families.base import require_model, require_turning


@verb(
    "turn",
    "servobus turn /dev/ttyUSB0 1 --output 30%      # RX-28, LX-16A",
    "servobus turn /dev/ttyUSB0 219 --speed -90     # HerkuleX, MX",
    "servobus stop /dev/ttyUSB0 1",
    "servobus turn /dev/ttyUSB0 1 --end --limits 20 280",
    "servobus turn /dev/ttyUSB0 1 --multi           # MX: goals of several turns",
)
@on_servo
@click.option("--output", type=SHARE, metavar="PERCENT", help="Share of full output, -100 to 100 %.")
@click.option("--speed", type=SPEED, metavar="DEG/S", help="Speed, where the servo controls its speed.")
@click.option("--current", type=CURRENT, metavar="A", help="Current, where the servo controls its current: MX-64.")
@click.option("--end", is_flag=True, help="Stop turning and hold the position: back to angles.")
@click.option("--multi", is_flag=True, help="Count angles over several turns, and hold the position: MX.")
@click.option("--limits", type=ANGLE, nargs=2, metavar="LOW HIGH", help="With --end: angle limits to set again.")
@as_json
def turn(
    port: str,
    id: int,
    where: Where,
    output: float | None,
    speed: float | None,
    current: float | None,
    end: bool,
    multi: bool,
    limits: tuple[float, float] | None,
    json: bool,
) -> None:
    """Turn the servo ID on PORT without end, as a wheel, until it is stopped.

    Plus is the direction in which the position grows. Torque that is off is switched on. An RX-28 gives up
    its angle limits for this; --end --limits sets them again. --end also ends torque control and several turns.
    """
    if [output is not None, speed is not None, current is not None, end, multi].count(True) != 1:
        raise click.UsageError("say one of --output, --speed, --current, --end and --multi")
    if output is not None and abs(output) > 1:
        raise click.BadParameter(f"{100 * output:g} % is not in -100 .. 100", param_hint="--output")
    if limits is not None and not end:
        raise click.UsageError("--limits goes with --end")
    with open_port(port) as bus, signals_as_interrupt():
        servo = find(bus, where, id)
        if end or multi:
            if limits is not None:
                _check_limits(servo, *limits)
            servo.position_mode(limits, multi_turn=multi)
            here: float = servo.read("present_position")
            if json:
                print_json({"turning": False, "position": quantity_entry(here, "rad")})
            else:
                now = "takes angles of several turns" if multi else "takes angles again"
                click.echo(f"{servo.target} {now}; it is at {show(here, 'rad')}")
        else:
            _check_option(servo, output, speed)
            if current is not None:
                servo.family.check_current(servo.target, current)
            _turn(bus, servo, where, {"output": output, "speed": speed, "current": current}, json=json)
        warn_alarms(servo)


def _check_limits(servo: BusServo, low: float, high: float) -> None:
    require_model(servo.target, "get angle limits")
    for name, angle in (("min_position", low), ("max_position", high)):
        servo.model.register(name).encode(angle)
    if low >= high:
        raise BadValue(f"--limits: {show(low, 'rad')} is not below {show(high, 'rad')}")


def _check_option(servo: BusServo, output: float | None, speed: float | None) -> None:
    require_turning(servo.target)
    if servo.model.turns_at_speed() and output is not None:
        raise UsageError(f"{servo.target} controls the speed at which it turns: give --speed DEG/S")
    if speed is not None and not servo.model.turns_at_speed():
        raise UsageError(f"{servo.target} cannot control the speed at which it turns: give --output PERCENT")


UNITS = {"output": "1", "speed": "rad/s", "current": "A"}


def _turn(bus: Bus, servo: BusServo, where: Where, pace: dict[str, float | None], *, json: bool) -> None:
    motion_status = bus.do(servo.family.motion_status(servo.target), baud=servo.baud)
    port = bus.transport.name
    rows = [servo.model.register(name) for name in ("min_position", "max_position")]
    raws = servo.read_raw(rows)
    low, high = (row.said(raw).removesuffix("°") for row, raw in zip(rows, raws, strict=True))
    several = tuple(raws) == servo.family.multi_turn_limits(servo.model)
    words = ("--multi",) if several else ("--end", "--limits", low, high)
    back = f"back to angles: {command_for(servo, where, 'turn', port, servo.id, *words)}"
    overwrites = pace["current"] is None and any(pair.equal for pair in servo.model.limit_pairs)
    gives_up = overwrites and not motion_status.turning
    if gives_up:  # before anything is sent: whatever ends this, the limits are told
        said = "the limits of several turns" if several else f"its angle limits, {low}° to {high}°"
        note(f"it gives up {said}, for that; {back}")
    try:
        if not motion_status.torque:
            # A HerkuleX takes a speed only while it is driven, so the torque comes first, and holds where it is.
            servo.torque_on()
        try:
            servo.turn(**pace)
        except ServobusError as error:
            if error.before:
                note(back)
            if not motion_status.torque:
                try:
                    servo.torque_off()  # leave it as it was
                except ServobusError as another:
                    note(f"{servo.target} may have torque and turn: {another}")
            raise
        if not motion_status.torque:
            note(f"torque switched on: id {servo.id}")
    except KeyboardInterrupt:
        stop_all(bus, [servo])
        raise click.exceptions.Exit(130) from None
    if json:
        told = {name: quantity_entry(value, UNITS[name]) for name, value in pace.items() if value is not None}
        print_json({"turning": True, **told})
        return
    name, value = next((name, value) for name, value in pace.items() if value is not None)
    shown = show(value, UNITS[name]) + (" of full output" if name == "output" else "")
    click.echo(f"{servo.target} turns at {shown}; `{command_for(servo, where, 'stop', port, servo.id)}` stops it")
    if not motion_status.turning and not gives_up:
        note(back)
