"""`set-id` and `set-baud`: under which name a servo is reached."""

import click

from servobus.cli.advice import command_for
from servobus.cli.finding import Where, find, open_port
from servobus.cli.options import as_json, on_port, on_servo, verb
from servobus.cli.output import note, print_json
from servobus.cli.values import ID
from servobus.errors import BusError, PortError
from servobus.families import registry
from servobus.jobs.reconfigure import is_one_speed, listed_baud


@verb("set-id", "servobus set-id /dev/ttyUSB0 1 7", "servobus set-id /dev/ttyUSB0 1 7 --family dynamixel")
@on_port
@click.argument("old", type=ID)
@click.argument("new", type=ID)
@as_json
def set_id(port: str, where: Where, old: int, new: int, json: bool) -> None:
    """Give the servo OLD on PORT the id NEW, for good. Refused if a servo answers to NEW already.

    New servos all have the same id: connect one alone, give it an id of its own, then the next.
    """
    with open_port(port) as bus:
        servo = find(bus, where, old)
        try:
            servo.change_id(new)
        except (BusError, PortError):
            note(f"if it answers to id {new} now, {command_for(servo, where, 'set-id', port, new, old)} brings it back")
            raise
        if json:
            print_json({"id": {"old": old, "new": new, "unit": ""}})
        else:
            click.echo(f"{servo.model.named(f'id {old}')} is now id {new}")


@verb("set-baud", "servobus set-baud /dev/ttyUSB0 1 1000000", "servobus set-baud /dev/ttyUSB0 1 57600 --baud all")
@on_servo
@click.argument("new", metavar="BAUD", type=click.INT)
@as_json
def set_baud(port: str, id: int, where: Where, new: int, json: bool) -> None:
    """Set the servo ID on PORT to another speed, for good, and check that it answers there.

    The speeds of its model are those that `--baud all` looks at; at another one no scan would find it, so it is
    refused. All servos on one bus should have the same speed.
    """
    with open_port(port) as bus:
        servo = find(bus, where, id)
        old = servo.baud
        try:
            servo.change_baud(new)
        except (BusError, PortError):
            back = command_for(servo, where, "set-baud", port, id, old, baud=listed_baud(servo.target, new))
            note(f"if it answers at {new} baud now, {back} brings it back")
            raise
        if json:
            print_json({"baud": {"old": old, "new": servo.baud, "unit": "baud"}})
            return
        same = f"; {new} is the same to it" if servo.baud != new else ""
        if is_one_speed(servo.model, old, servo.baud):
            click.echo(f"{servo.target} talks at {servo.baud} baud already{same}")
        else:
            click.echo(f"{servo.target} talks at {servo.baud} baud now (before: {old}){same}")
        if servo.baud not in registry.factory_bauds(servo.family):
            click.echo(f"find it with --baud {servo.baud}")
