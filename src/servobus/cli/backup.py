"""`backup` and `restore`: the settings of a servo as a file."""

import re
import shlex
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

import click

from servobus import BusServo, ServobusError
from servobus.cli.finding import Where, find, for_each, open_port
from servobus.cli.options import as_json, on_servo, on_servos_with, verb
from servobus.cli.output import json_entries, note, print_json, which
from servobus.cli.values import Ids, are_several
from servobus.core.present import change_entry, value_text
from servobus.errors import BusError, NotRestored, PortError, UsageError
from servobus.jobs.backup import Backup, Comparison, compare, settings


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
@as_json
def backup(
    port: str, ids: Ids, where: Where, files: tuple[str, ...], output: str | None, force: bool, json: bool
) -> None:
    """Save the settings of the servos ID... on PORT that survive power-off, to a FILE each.

    Without FILE names like rx28-id1.toml are chosen; `-` prints it. In FILE {id} and {model} stand for those of the
    servo. The file is TOML, with the meaning of each value beside it. Backups are not replaced unless --force says so.
    """
    if len(files) + (output is not None) > 1:
        raise click.UsageError("say one FILE")
    file = output if output is not None else next(iter(files), None)
    several = are_several(ids)
    if several and file is not None and "{id}" not in file:
        raise click.UsageError(f"{file} is one file for several servos: write {{id}} in it, as in 'arm-{{id}}.toml'")
    if file is not None and (unknown := set(re.findall(r"\{.*?\}", file)) - {"{id}", "{model}"}):
        named = ", ".join(sorted(unknown))
        raise click.UsageError(f"{file}: nothing stands for {named}; {{id}} and {{model}} stand for those of the servo")
    if json and file == "-":
        raise click.UsageError("--json tells of files: `-` prints the settings themselves")
    with open_port(port) as bus, json_entries(several=several) if json else nullcontext() as entries:
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
            if entries is not None:
                entry = {"file": str(path), "settings": len(saved.values)}
                entries.append({**which(servo), **entry} if several else entry)
                return
            click.echo(f"{len(saved.values)} settings of {saved.model.named(f'id {saved.id}')} saved to {path}")

        for_each(bus, where, ids, save)


@verb("restore", "servobus restore /dev/ttyUSB0 1 elbow.toml", "servobus restore /dev/ttyUSB0 1 elbow.toml --yes")
@on_servo
@click.argument("file", type=click.Path())
@click.option("--torque-off", is_flag=True, help="Switch the torque off first, if it is on.")
@click.option("--yes", is_flag=True, help="Do not ask, not even about a backup of another id.")
@as_json
def restore(port: str, id: int, where: Where, file: str, torque_off: bool, yes: bool, json: bool) -> None:
    """Write the settings in FILE to the servo ID on PORT, after showing what would change.

    It moves nothing: a servo with its torque on is refused, or goes limp first with --torque-off. Id and speed stay as
    they are, so that a backup can go into a replacement. What the servo cannot have or does not take is named at the
    end, when all the rest is written. --json gives what was written, as `write` does, and asks nothing: it needs --yes.
    """
    if json and not yes:
        raise click.UsageError("--json asks nothing: say --yes too")
    saved = read_backup(Path(file))
    with open_port(port) as bus:
        servo = find(bus, where, id)
        found = bus.do(compare(servo.target, saved), baud=servo.baud)
        if not json:
            show_changes(servo, saved, found)
        count = len(found.changes)
        if not count and not found.impossible:
            if json:
                print_json({})
            else:
                click.echo(f"{servo.target} has these settings already")
            return
        if count and found.driven and not torque_off:
            off = f"servobus torque {shlex.quote(port)} {id} off"
            raise UsageError(
                f"{servo.target}: its torque is on, and settings can move it: switch it off first (`{off}`), or say "
                "--torque-off; nothing was changed"
            )
        other = f"; the backup is of id {saved.id}, this is id {servo.id}" if saved.id != servo.id else ""
        asked = f"write {'it' if count == 1 else f'these {count}'} to {servo.target}{other}?"
        if count and not yes and not click.confirm(asked):
            raise ServobusError("nothing was changed")
        try:
            names = servo.restore(saved, torque_off=torque_off)
        except NotRestored as error:
            if json:
                _print_written(found, error.restored)
            raise
        except (BusError, PortError):
            note("what was not written yet is written when this command is given again")
            raise
        finally:
            if count and (found.driven or found.returns):
                note(f"torque switched off: id {servo.id}")
        if json:
            _print_written(found, names)
        else:
            click.echo(f"{servo.target}: restored {', '.join(names)}")


def _print_written(found: Comparison, names: Sequence[str]) -> None:
    """Print for programs what became of the settings that were written."""
    print_json(
        {
            row.name: change_entry(row, found.present[row], raw)
            for row, raw in found.changes.items()
            if row.name in names
        }
    )


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
        return Backup.parse(path.read_text(encoding="utf-8-sig"))
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise UsageError(f"{path}: this is not a backup file, or it is damaged: line {line} is no text") from None


def show_changes(servo: BusServo, saved: Backup, found: Comparison) -> None:
    """Print what restoring would change."""
    for row, raw in found.changes.items():
        click.echo(f"  {row.name}: {value_text(row, found.present[row])} -> {value_text(row, raw)}")
    for row, why in found.impossible.items():
        wanted = value_text(row, saved.values[row.name])
        note(f"  {row.name}: {value_text(row, found.present[row])} stays, {wanted} cannot be written: {why}")
    if (shift := servo.model.optional("calibration")) in found.changes:
        note(f"{shift.name}: the angles that are read change with it, the shaft stays where it is")
    if saved.id != servo.id:
        note(f"the backup is of id {saved.id}; the id stays {servo.id}")
    if lacking := [row.name for row in settings(servo.model) if row.name not in saved.values]:
        note(f"the backup lacks {', '.join(lacking)}: what the servo has there stays")
