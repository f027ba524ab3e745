"""Commands that the command line prints, to be copied: they find the servo that was meant."""

from collections.abc import Iterable
from dataclasses import replace

from servobus import BusServo
from servobus.cli.finding import Where
from servobus.cli.output import note
from servobus.core.ids import shown_ids
from servobus.doctor.findings import command
from servobus.families import registry
from servobus.families.base import Model


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


def note_unknown(port: str, servos: Iterable[tuple[int, type[Model] | None]]) -> None:
    """Note, once for all of them, how to say what those servos are that cannot say it: id and model of each."""
    ids = [id for id, model in servos if model is not None and registry.never_told(model)]
    if ids:
        said = command("remember", port, shown_ids(ids).partition(" ")[2], "MODEL")
        note(f"{shown_ids(ids)}: no such servo can say its model; `{said}` keeps it, --model says it once")
