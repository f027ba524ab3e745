"""`stop` and `torque`: stop servos, and switch their torque."""

from collections.abc import Callable

import click

from servobus import Bus, BusServo, ServobusError
from servobus.cli.options import ALL, Ids, Where, find_all, on_servos, open_port, verb
from servobus.cli.output import note, warn_alarms
from servobus.core.ids import BROADCAST, LAST_ID
from servobus.errors import NoReply
from servobus.families.base import Answers, KnownServo, ServoRef
from servobus.jobs.scan import ScanProgress, scan


@verb(
    "stop",
    "servobus stop /dev/ttyUSB0 1-4,7",
    "servobus stop /dev/ttyUSB0 all --family lewansoul",
    "servobus torque /dev/ttyUSB0 all off    # quickest: one broadcast",
)
@on_servos
def stop(port: str, ids: Ids, where: Where) -> None:
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
        if ids != ALL:
            for servo in find_all(bus, where, ids, shared=True):
                stop_one(servo)
        else:
            _find_every_servo(bus, where, stop_one)
    if failed:
        raise ServobusError("; ".join(failed))


@verb(
    "torque",
    "servobus torque /dev/ttyUSB0 1-4,7 on",
    "servobus torque /dev/ttyUSB0 all off",
)
@on_servos
@click.argument("state", metavar="on|off", type=click.Choice(["on", "off"]))
def torque(port: str, ids: Ids, where: Where, state: str) -> None:
    """Switch the torque of servos on PORT on or off.

    On: each holds where it is, nothing jumps. Off: each shaft turns freely, so support what it carries.
    `all off` is one broadcast per family, which every servo obeys at once and none answers.
    """
    with open_port(port) as bus:
        if ids == ALL and state == "off":
            _broadcast_torque_off(bus, where)
            return
        servos = find_all(bus, where, ids, shared=state == "off")
        if state == "on":
            bus.torque_on(servos)
        else:
            bus.torque_off(servos)
        for servo in servos:
            click.echo(f"{servo.target}: torque {state}")
            warn_alarms(servo)


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
