"""`registers`: the table of a model, as reference."""

from typing import Any

import click

from servobus.cli import complete
from servobus.cli.options import as_json, verb
from servobus.cli.output import console, print_json
from servobus.core.present import place_text, register_entry, title_text, writable_text
from servobus.core.registers import Register
from servobus.families import registry
from servobus.families.base import Model
from servobus.families.present import differences


@verb(
    "registers",
    "servobus registers rx28",
    "servobus registers lx16a goal_position max_position",
    "servobus registers drs0602 --json",
    "servobus registers mx28 --diff mx64",
)
@click.argument("model", metavar="MODEL", shell_complete=complete.models)
@click.argument("names", metavar="[REGISTER]...", nargs=-1, shell_complete=complete.registers)
@click.option("--diff", "other", metavar="MODEL", shell_complete=complete.models, help="What differs in this model.")
@as_json
def registers(model: str, names: tuple[str, ...], other: str | None, json: bool) -> None:
    """Show the register table of a model, or some registers of it with the notes about them.

    Names in parentheses are aliases: a register has the same alias in all models that have it.
    """
    table = registry.model(model)
    if other is not None:
        _difference(table, registry.model(other), names, json=json)
        return
    rows = [table.register(name) for name in names] or list(table.registers.values())
    if json:
        print_json([register_entry(row) for row in rows])
        return
    out = console()
    for row in rows:
        out.print(f"{title_text(row):<38}", place_text(row), sep="  ", markup=False)
        for line in (row.meaning, writable_text(row), *([row.note] if names and row.note else [])):
            if line:
                _indented(line)
    if not names:
        _options(table)


def _difference(one: type[Model], other: type[Model], names: tuple[str, ...], *, json: bool) -> None:
    """Show what differs between two tables; of some registers, where names are given."""
    wanted = {row.name for name in names for row in _rows_called(name, one, other)}
    found = [row for row in differences(one, other) if not wanted or row[0] in wanted]
    if json:
        keys = "register", "what", one.key(), other.key()
        print_json([dict(zip(keys, row, strict=True)) for row in found])
        return
    if not found:
        click.echo(f"{one.title} and {other.title}: no difference")
    from rich.table import Table  # noqa: PLC0415 - rich is slow to import and not always wanted

    table = Table("register", "what", one.title, other.title, box=None, pad_edge=False, padding=(0, 1))
    for row in found:
        table.add_row(*row)
    if found:
        console().print(table)


def _rows_called(name: str, *models: type[Model]) -> list[Register[Any]]:
    """Give the rows of this name in those of the models that have it. Raises UnknownName if none has."""
    found = [model.register(name) for model in models if name in model.registers or name in model.aliases]
    return found or [models[0].register(name)]


def _options(model: type[Model]) -> None:
    """Show what a virtual servo of this model can do otherwise."""
    from servobus.cli.virtual_options import option_rows  # noqa: PLC0415 - virtual servos are slow to import

    rows = option_rows(model)
    if rows:
        click.echo(f"\nOptions of a virtual {model.title}, such as {model.key()}@1,{rows[0][0]}")
    for name, text in rows:
        click.echo(name)
        _indented(text)


def _indented(line: str) -> None:
    click.echo(click.wrap_text(line, 78, "    ", "    "))
