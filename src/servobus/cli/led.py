"""`led`: a servo's light."""

import click

from servobus.cli.options import Where, find, on_servo, open_port, verb
from servobus.cli.output import warn_alarms


@verb("led", "servobus led /dev/ttyUSB0 1 on", "servobus led /dev/ttyUSB0 219 magenta")
@on_servo
@click.argument("colour", metavar="on|off|COLOUR")
def led(port: str, id: int, where: Where, colour: str) -> None:
    """Switch the light of the servo ID on PORT: the way to see which servo that is.

    Colours are those the model has: green, blue, red, cyan, magenta, yellow and white on a HerkuleX.
    """
    with open_port(port) as bus:
        servo = find(bus, where, id)
        servo.led(colour.lower())
        click.echo(f"{servo.target}: light {colour.lower()}")
        warn_alarms(servo)
