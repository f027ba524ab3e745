"""`rearm`: torque again after the servo itself has switched it off."""

import click

from servobus import BusServo
from servobus.cli.options import Ids, Where, for_each, on_servos, open_port, verb
from servobus.cli.output import warn_alarms
from servobus.core.units import show


@verb(
    "rearm",
    "servobus rearm /dev/ttyUSB0 1",
    "servobus rearm /dev/ttyUSB0 1-4,7",
    "servobus rearm virtual:drs0602@219 219",
)
@on_servos
def rearm(port: str, ids: Ids, where: Where) -> None:
    """Switch the torque of the servos ID... on PORT on again, after an alarm has switched it off.

    The alarm is cleared by the rule of the servo's family, and the goal becomes the present position, so nothing
    jumps. Refused while the cause is still there, such as a servo that is too hot; then the torque is off.
    """

    def rearm_one(servo: BusServo) -> None:
        servo.rearm()
        state = servo.look()
        click.echo(f"{servo.target}: torque on, holds {show(state.position, 'rad')}")
        warn_alarms(servo)

    with open_port(port) as bus:
        for_each(bus, where, ids, rearm_one)
