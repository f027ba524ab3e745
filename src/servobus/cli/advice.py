"""Commands that the command line prints, to be copied: they find the servo that was meant."""

from dataclasses import replace

from servobus import BusServo
from servobus.cli.finding import Where
from servobus.doctor.findings import command


def command_for(servo: BusServo, where: Where, verb: str, port: str, *words: object, baud: int | None = None) -> str:
    """Write a command for a servo, with the options that were used to find it, as far as they are still needed.

    `baud` is the speed that the servo will have then, if another than now.
    """
    model = "" if where.model is None else f"--model {where.model.key()}"
    family = "" if where.family is None or model else f"--family {where.family}"
    speed = servo.baud if baud is None else baud
    found = {one.name: bauds for one, bauds in replace(where, baud=None).rounds()}
    option = "" if speed in found.get(servo.family.name, ()) else f"--baud {speed}"
    return command(verb, port, *words, family, model, option)
