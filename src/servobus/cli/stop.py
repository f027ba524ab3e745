"""`stop` and `torque`: stop servos, and switch their torque."""

from collections.abc import Callable, Sequence
from typing import Literal

import click

from servobus import Bus, BusServo, ServobusError
from servobus.cli.options import (
    ALL,
    ID_OR_ALL,
    Where,
    check_to_limit,
    check_unique,
    find_all,
    on_port,
    open_port,
    sigterm_as_interrupt,
    to_limit_options,
    verb,
)
from servobus.cli.output import note, warn_alarms
from servobus.core.ids import BROADCAST, LAST_ID
from servobus.errors import BusError, MotionError, NoReply
from servobus.families.base import Answers, KnownServo, ServoRef
from servobus.jobs.scan import ScanProgress, scan

Ids = tuple[int | Literal["all"], ...]


@verb(
    "stop",
    "servobus stop /dev/ttyUSB0 1 2",
    "servobus stop /dev/ttyUSB0 all --family lewansoul",
    "servobus torque /dev/ttyUSB0 all off    # quickest: one broadcast",
)
@on_port
@click.argument("ids", metavar="ID...|all", type=ID_OR_ALL, nargs=-1, required=True)
def stop(port: str, where: Where, ids: Ids) -> None:
    """Stop servos on PORT where they are. Their torque stays on.

    `all` looks for every servo and stops each as soon as it is found, which takes up to half a minute;
    `servobus torque PORT all off` takes the power at once.
    """
    failed: list[str] = []

    def stop_one(servo: BusServo) -> None:
        try:
            servo.stop()
        except ServobusError as error:
            failed.append(f"{servo.target} may still move: {error}")
        else:
            click.echo(f"{servo.target} stopped")

    with open_port(port) as bus:
        if wanted := _named_ids(ids):
            for servo in find_all(bus, where, wanted):
                stop_one(servo)
        else:
            _find_every_servo(bus, where, stop_one)
    if failed:
        raise ServobusError("; ".join(failed))


@verb(
    "torque",
    "servobus torque /dev/ttyUSB0 1 2 on",
    "servobus torque /dev/ttyUSB0 1 on --to-limit --speed 10",
    "servobus torque /dev/ttyUSB0 all off",
)
@on_port
@click.argument("ids", metavar="ID...|all", type=ID_OR_ALL, nargs=-1, required=True)
@click.argument("state", metavar="on|off", type=click.Choice(["on", "off"]))
@to_limit_options
def torque(port: str, where: Where, ids: Ids, state: str, to_limit: bool, speed: float | None) -> None:
    """Switch the torque of servos on PORT on or off.

    On: each holds where it is, nothing moves. A servo that would run to its limits, because it stands outside of them,
    is refused; --to-limit brings it there slowly. Off: each shaft turns freely, so support what it carries.
    `all off` is one broadcast per family, which every servo obeys at once and none answers.
    """
    wanted = _named_ids(ids)
    if state == "off" and to_limit:
        raise click.UsageError("--to-limit goes with on")
    check_to_limit(to_limit, speed)
    with open_port(port) as bus, sigterm_as_interrupt():
        if not wanted and state == "off":
            _broadcast_torque_off(bus, where)
            return
        servos = find_all(bus, where, wanted) if wanted else _find_every_servo(bus, where, lambda _: None)
        if state == "on":
            _torque_on(servos, to_limit=to_limit, speed=speed)
            return
        bus.torque_off(servos)
        for servo in servos:
            click.echo(f"{servo.target}: torque off")
            warn_alarms(servo)


def _torque_on(servos: Sequence[BusServo], *, to_limit: bool, speed: float | None) -> None:
    """Switch each on, even if another fails; what failed is told at the end."""
    failed: list[str] = []
    for servo in servos:
        try:
            servo.torque_on(to_limit=to_limit, speed=speed)
        except (BusError, MotionError) as error:
            failed.append(str(error))
        else:
            click.echo(f"{servo.target}: torque on")
        warn_alarms(servo)
    if failed:
        raise ServobusError("; ".join(failed))


def _named_ids(ids: Ids) -> list[int]:
    """Give the ids that are named, none for `all`."""
    if ALL in ids:
        if len(ids) > 1:
            raise click.UsageError("say either ids or `all`")
        return []
    numbers = [id for id in ids if isinstance(id, int)]
    check_unique(numbers)
    return numbers


def _find_every_servo(bus: Bus, where: Where, then: Callable[[BusServo], None]) -> list[BusServo]:
    """Find every servo, and do something with each as soon as it is found. Raises NoReply if there is none."""
    servos: list[BusServo] = []

    def watch(progress: ScanProgress) -> None:
        found = progress.found
        if found is None or found.model is None:
            return
        # Nothing is on the line while a watcher is called, so it may use the bus.
        servo = bus.attach(found.model, found.id, baud=found.baud, answers=found.identity.answers)
        then(servo)
        servos.append(servo)

    bus.models = where.model
    for family, bauds in where.rounds():
        bus.do(scan([family], bauds, range(LAST_ID + 1), watch, identify=bus.identify))
    if not servos:
        raise NoReply(f"{bus.transport.name}: no servo answers ({where})")
    return servos


def _broadcast_torque_off(bus: Bus, where: Where) -> None:
    for family, bauds in where.rounds():
        # One broadcast for each place at which models of this family have their torque.
        models = {model.register("torque_enable").place: model for model in where.models_of(family)}
        for model in models.values():
            for baud in bauds:
                everyone = KnownServo.of(ServoRef(BROADCAST, model, Answers.READS), baud)
                bus.do(family.torque(everyone, on=False), baud=baud)
    click.echo(f"torque off: told every servo ({where})")
    note("no servo answers a broadcast; `servobus scan` shows which obeyed")
