"""`rearm`: torque again after the servo itself has switched it off."""

import click

from servobus import BusServo
from servobus.cli.finding import Where, for_each, open_port
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.options import check_to_limit, on_servos, to_limit_options, verb
from servobus.cli.output import warn_alarms
from servobus.cli.values import Ids


@verb(
    "rearm",
    "servobus rearm /dev/ttyUSB0 1",
    "servobus rearm /dev/ttyUSB0 1-4,7",
    "servobus rearm virtual:drs0602@219 219",
)
@on_servos
@to_limit_options
def rearm(port: str, ids: Ids, where: Where, to_limit: bool, speed: float | None) -> None:
    """Switch the torque of the servos ID... on PORT on again, after an alarm has switched it off.

    The alarm is cleared by the rule of the servo's family, and the goal becomes the present position, so nothing
    moves. Refused while the cause is still there, such as a servo that is too hot; then the torque is off. A servo that
    would run to its limits, because it stands outside of them, is refused too; --to-limit brings it there slowly.
    """
    check_to_limit(to_limit, speed)

    def rearm_one(servo: BusServo) -> None:
        servo.rearm(to_limit=to_limit, speed=speed)
        click.echo(f"{servo.target}: torque on, holds {servo.look().place}")
        warn_alarms(servo)

    with open_port(port) as bus, signals_as_interrupt():
        for_each(bus, where, ids, rearm_one)
