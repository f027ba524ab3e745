"""`led`: a servo's light."""

import click

from servobus import BusServo
from servobus.cli.finding import Where, for_each, open_port
from servobus.cli.options import on_servos, verb
from servobus.cli.output import warn_alarms
from servobus.cli.values import Ids


@verb(
    "led",
    "servobus led /dev/ttyUSB0 1 on",
    "servobus led /dev/ttyUSB0 219 magenta",
    "servobus led /dev/ttyUSB0 all off",
)
@on_servos
@click.argument("colour", metavar="on|off|COLOUR")
def led(port: str, ids: Ids, where: Where, colour: str) -> None:
    """Switch the light of the servos ID... on PORT: the way to see which servo that is.

    Colours are those the model has: green, blue, red, cyan, magenta, yellow and white on a HerkuleX.
    """

    def switch(servo: BusServo) -> None:
        servo.led(colour.lower())
        click.echo(f"{servo.target}: light {colour.lower()}")
        warn_alarms(servo)

    with open_port(port) as bus:
        for_each(bus, where, ids, switch)
