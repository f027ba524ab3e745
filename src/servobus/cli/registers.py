"""`registers`: the table of a model, as reference."""

from typing import Any

import click

from servobus.cli.options import as_json, verb
from servobus.cli.output import console, plain, print_json, text, unit
from servobus.core.registers import Access, Register
from servobus.core.units import Choice, Flags, Switch
from servobus.families import registry
from servobus.families.base import Model

ACCESS = {Access.READ: "read", Access.READ_WRITE: "read, write", Access.RESERVED: "reserved"}


@verb(
    "registers",
    "servobus registers rx28",
    "servobus registers lx16a goal_position max_position",
    "servobus registers drs0602 --json",
)
@click.argument("model", metavar="MODEL")
@click.argument("names", metavar="[REGISTER]...", nargs=-1)
@as_json
def registers(model: str, names: tuple[str, ...], json: bool) -> None:
    """Show the register table of a model, or some registers of it with the notes about them.

    Names in parentheses are aliases: a register has the same alias in all models that have it.
    """
    table = registry.model(model)
    rows = [table.register(name) for name in names] or list(table.registers.values())
    if json:
        print_json([describe(table, row) for row in rows])
        return
    out = console()
    for row in rows:
        out.print(*_heading(table, row), sep="  ", markup=False)
        for line in (row.meaning, _range(row), *([row.note] if names and row.note else [])):
            if line:
                _indented(line)


def describe(model: type[Model], row: Register[Any]) -> dict[str, Any]:
    """Give one row for JSON: limits and default in the unit people use, and raw."""
    low, high = row.limits
    return {
        "name": row.name,
        "aliases": aliases(model, row),
        **row.place.json(),
        "size": row.layout.size,
        "access": row.access.value,
        "area": row.area.value,
        "limits": [plain(row, low), plain(row, high)] if row.writable else None,
        "allowed": [plain(row, raw) for raw in row.allowed] if row.allowed else None,
        "default": None if row.default is None else plain(row, row.default),
        "unit": unit(row),
        "meaning": row.meaning,
        "note": row.note,
        "raw": {
            "limits": [low, high] if row.writable else None,
            "allowed": list(row.allowed) if row.allowed else None,
            "default": None if row.default is None else int(row.default),
        },
    }


def aliases(model: type[Model], row: Register[Any]) -> list[str]:
    return [alias for alias, name in model.aliases.items() if name == row.name]


def _heading(model: type[Model], row: Register[Any]) -> tuple[str, ...]:
    names = aliases(model, row)
    size = "1 byte" if row.layout.size == 1 else f"{row.layout.size} bytes"
    title = f"{row.name} ({', '.join(names)})" if names else row.name
    return (f"{title:<38}", f"{row.place.text(row.area)}, {size}, {ACCESS[row.access]}")


def _range(row: Register[Any]) -> str:
    if not row.writable:
        return ""
    factory = "" if row.default is None else f"; factory setting {text(row, row.default)}"
    return _choices(row) + factory


def _choices(row: Register[Any]) -> str:
    """Say what can be written, as it is typed."""
    scale = row.scale
    if isinstance(scale, Switch):
        return "on or off"
    if isinstance(scale, Flags):
        return "any of " + ", ".join(scale.show(flag) for flag in scale.options) + ", joined by +"
    if row.allowed is not None:
        return ", ".join(text(row, raw) for raw in row.allowed)
    low, high = row.limits
    if isinstance(scale, Choice):
        return ", ".join(scale.show(option) for option in scale.options if low <= option <= high)
    return " .. ".join(text(row, raw) for raw in (low, high))


def _indented(line: str) -> None:
    click.echo(click.wrap_text(line, 78, "    ", "    "))
