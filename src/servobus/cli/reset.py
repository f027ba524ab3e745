"""`reset` and `reboot`."""

import shlex
import time
from pathlib import Path

import click

from servobus import BusServo, ServobusError
from servobus.cli.advice import command_for
from servobus.cli.backup import write_backup
from servobus.cli.finding import Where, find, for_each, open_port
from servobus.cli.options import on_servo, on_servos, verb
from servobus.cli.output import note
from servobus.cli.values import Ids
from servobus.errors import UsageError
from servobus.families import registry


@verb(
    "reset",
    "servobus reset /dev/ttyUSB0 1",
    "servobus reset /dev/ttyUSB0 219 --keep id,baud --yes",
)
@on_servo
@click.option("--keep", metavar="LIST", default="", help="Leave alone: id, baud, calibration, where the family can.")
@click.option("--backup", "file", metavar="FILE", help="Where to save the settings first; else a name is chosen.")
@click.option("--yes", is_flag=True, help="Do not ask.")
def reset(port: str, id: int, where: Where, keep: str, file: str | None, yes: bool) -> None:
    """Restore the factory settings of the servo ID on PORT, id and speed included.

    Its settings are saved to a file first, and the commands that undo the reset are printed.
    """
    kept = frozenset(word.strip() for word in keep.split(",") if word.strip())
    if kept:
        keepable = dict.fromkeys(word for family in registry.FAMILIES.values() for word in family.keepable)
        if unknown := kept - keepable.keys():
            raise click.UsageError(f"--keep {', '.join(sorted(unknown))}: only {', '.join(keepable)} can be kept")
    with open_port(port) as bus:
        servo = find(bus, where, id)
        servo.family.check_reset(servo.target, kept)
        old_baud = servo.baud
        saved = servo.backup()
        less = f", less {', '.join(sorted(kept))}" if kept else ", id and speed included"
        if not yes and not click.confirm(f"reset {servo.target} to factory settings{less}?"):
            raise ServobusError("nothing was changed")
        path = Path(file or time.strftime(f"{saved.model.key()}-id{id}-%Y%m%d-%H%M%S.toml"))
        write_backup(saved, path)
        factory_id = id if "id" in kept else servo.model.register("id").default or 0
        end = factory_id, old_baud if "baud" in kept else servo.model.factory_baud
        undo = _undo(servo, where, port, path, end)
        try:
            servo.reset(keep=kept)
        except UsageError:
            path.unlink()  # refused before anything was sent: there is nothing to undo
            raise
        except BaseException:
            note(f"its settings before are in {path}")
            note(f"if it is reset it is id {end[0]} at {end[1]} baud now, and to undo that:")
            for line in undo:
                note(line)
            raise
    click.echo(f"{saved.model.named(f'id {id}')} is reset: id {servo.id} at {servo.baud} baud now")
    click.echo(f"its settings before are in {path}; to undo:")
    for line in undo:
        click.echo(line)


def _undo(servo: BusServo, where: Where, port: str, path: Path, end: tuple[int, int]) -> list[str]:
    """Write the commands that bring a servo back, which has this id and speed after its reset."""
    id, baud = end
    lines = [command_for(servo, where, "restore", port, id, shlex.quote(str(path)), baud=baud)]
    if servo.id != id:
        lines.append(command_for(servo, where, "set-id", port, id, servo.id, baud=baud))
    if servo.baud != baud:
        lines.append(command_for(servo, where, "set-baud", port, servo.id, servo.baud, baud=baud))
    return [f"  {line}" for line in lines]


@verb("reboot", "servobus reboot /dev/ttyUSB0 219", "servobus reboot /dev/ttyUSB0 219,220")
@on_servos
def reboot(port: str, ids: Ids, where: Where) -> None:
    """Restart the servos ID... on PORT: their torque goes off, and what was not stored is forgotten.

    Few families have a command for that, as HerkuleX has; other servos are switched off and on.
    """

    def restart(servo: BusServo) -> None:
        servo.reboot()
        servo.ping()
        click.echo(f"{servo.target} restarted; its torque is off")

    with open_port(port) as bus:
        for_each(bus, where, ids, restart)
