"""`backup` and `restore`: the settings of a servo as a file."""

from pathlib import Path

import click

from servobus import Bus, BusServo, ServobusError
from servobus.cli.options import Ids, Where, are_several, find, for_each, on_servo, on_servos_with, open_port, verb
from servobus.cli.output import note
from servobus.core.present import value_text
from servobus.errors import UsageError
from servobus.jobs.backup import Backup, identity_names


@verb(
    "backup",
    "servobus backup /dev/ttyUSB0 1",
    "servobus backup /dev/ttyUSB0 1 elbow.toml",
    "servobus backup /dev/ttyUSB0 all -o 'arm-{id}.toml'",
    "servobus backup /dev/ttyUSB0 1 - | less",
)
@on_servos_with("files", "[FILE]", needed=False)
@click.option("-o", "--output", metavar="FILE", help="The same as FILE: where to save it.")
@click.option("--force", is_flag=True, help="Replace FILE if it exists.")
def backup(port: str, ids: Ids, where: Where, files: tuple[str, ...], output: str | None, force: bool) -> None:
    """Save the settings of the servos ID... on PORT that survive power-off, to a FILE each.

    Without FILE names like rx28-id1.toml are chosen; `-` prints it. In FILE {id} and {model} stand for those of the
    servo. The file is TOML, with the meaning of each value beside it. Backups are not replaced unless --force says so.
    """
    if len(files) + (output is not None) > 1:
        raise click.UsageError("say one FILE")
    file = output if output is not None else next(iter(files), None)
    if are_several(ids) and file is not None and "{id}" not in file:
        raise click.UsageError(f"{file} is one file for several servos: write {{id}} in it, as in 'arm-{{id}}.toml'")
    with open_port(port) as bus:
        taken: set[Path] = set()

        def save(servo: BusServo) -> None:
            saved = servo.backup()
            if file == "-":
                click.echo(saved.text(), nl=False)
                return
            name = file or "{model}-id{id}.toml"
            path = Path(name.replace("{id}", str(saved.id)).replace("{model}", saved.model.key()))
            if path in taken:
                raise UsageError(f"{servo.target}: {path} is that of another servo by now; write {{model}} in it too")
            taken.add(path)
            write_backup(saved, path, force=force, otherwise="choose another name, or replace it with --force")
            click.echo(f"{len(saved.values)} settings of {saved.model.named(f'id {saved.id}')} saved to {path}")

        for_each(bus, where, ids, save)


@verb("restore", "servobus restore /dev/ttyUSB0 1 elbow.toml", "servobus restore /dev/ttyUSB0 1 elbow.toml --yes")
@on_servo
@click.argument("file")
@click.option("--yes", is_flag=True, help="Do not ask.")
def restore(port: str, id: int, where: Where, file: str, yes: bool) -> None:
    """Write the settings in FILE to the servo ID on PORT, after showing what would change.

    Id and speed stay as they are, so that a backup can go into a replacement.
    """
    saved = read_backup(Path(file))
    with open_port(port) as bus:
        servo = find(bus, where, id)
        changes = show_changes(bus, servo, saved)
        if not changes:
            click.echo(f"{servo.target} has these settings already")
            return
        if not yes and not click.confirm(f"write {'it' if changes == 1 else f'these {changes}'}?"):
            raise ServobusError("nothing was changed")
        names = servo.restore(saved)
        click.echo(f"{servo.target}: restored {', '.join(names)}")


def write_backup(saved: Backup, path: Path, *, force: bool = False, otherwise: str = "choose another name") -> None:
    """Write a backup file, replacing none. Raises UsageError, with what can be done otherwise."""
    try:
        with path.open("w" if force else "x", encoding="utf-8") as file:
            file.write(saved.text())
    except FileExistsError:
        raise UsageError(f"{path} exists already and is not replaced; {otherwise}") from None


def read_backup(path: Path) -> Backup:
    """Read a backup file. Raises UsageError."""
    try:
        return Backup.parse(path.read_text(encoding="utf-8"))
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: this is not a backup file: it is no text") from None


def show_changes(bus: Bus, servo: BusServo, saved: Backup) -> int:
    """Print what restoring would change; give the number of settings. Raises UsageError for another model."""
    if saved.model is not servo.model:
        raise UsageError(f"the backup is of a {saved.model.title}, {servo.target} is another model")
    skip = identity_names(saved.model)
    rows = [saved.model.registers[name] for name in saved.values if name not in skip]
    present = bus.do(servo.family.read_stored(servo.target, rows), baud=servo.baud)
    count = 0
    for row, raw in zip(rows, present, strict=True):
        if raw != saved.values[row.name]:
            click.echo(f"  {row.name}: {value_text(row, raw)} -> {value_text(row, saved.values[row.name])}")
            count += 1
    if saved.id != servo.id:
        note(f"the backup is of id {saved.id}; the id stays {servo.id}")
    return count
