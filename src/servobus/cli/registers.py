"""`registers`: the table of a model, as reference."""

import click

from servobus.cli import complete
from servobus.cli.options import as_json, verb
from servobus.cli.output import console, print_json
from servobus.core.present import place_text, register_entry, title_text, writable_text
from servobus.families import registry
from servobus.families.base import Model


@verb(
    "registers",
    "servobus registers rx28",
    "servobus registers lx16a goal_position max_position",
    "servobus registers drs0602 --json",
)
@click.argument("model", metavar="MODEL", shell_complete=complete.models)
@click.argument("names", metavar="[REGISTER]...", nargs=-1, shell_complete=complete.registers)
@as_json
def registers(model: str, names: tuple[str, ...], json: bool) -> None:
    """Show the register table of a model, or some registers of it with the notes about them.

    Names in parentheses are aliases: a register has the same alias in all models that have it.
    """
    table = registry.model(model)
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
