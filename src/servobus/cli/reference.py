"""`ports`, `models`: what is plugged in, and what is known."""

import math
from collections.abc import Mapping
from typing import Any

import click

from servobus import MODELS
from servobus.bus import remembered
from servobus.cli import complete
from servobus.cli.options import as_json, verb
from servobus.cli.output import console, note, print_json
from servobus.cli.remember import who_of
from servobus.errors import UsageError
from servobus.families import registry
from servobus.families.present import figure, model_entry, model_lines, supply_text
from servobus.remote.address import Address
from servobus.remote.runtime import servers
from servobus.transports import usb_adapter


@verb("ports", "servobus ports", "servobus ports --json")
@as_json
def ports(json: bool) -> None:
    """List the ports of this computer, and what is remembered of the servos on each. Opens none of them.

    These are its serial ports, and the buses that servers of this user share.

    Ports that are not of this computer, or not plugged in, are listed behind the others if anything is remembered.
    """
    from serial.tools import list_ports  # noqa: PLC0415 - only this verb needs it

    try:
        kept = remembered.everything()
    except UsageError as error:
        kept = {}
        note(f"servobus: {error}; it is left out")
    found: list[dict[str, Any]] = []
    for port in sorted(list_ports.comports()):
        name = usb_adapter.lasting_name(port.device, usb_adapter.described(port))
        entry = {"port": port.device, "description": _known(port.description), "hardware": _known(port.hwid)}
        found.append({**entry, "remembered": _models(kept.pop(name, {})), "listed": True})
    for server in servers():
        for name, opened in server.buses:
            about = f"{opened}, shared by process {server.pid}"
            entry = {"port": str(Address("", 0, name)), "description": about, "hardware": ""}
            found.append({**entry, "remembered": {}, "listed": True})
    if json:
        for name, table in kept.items():
            if models := _models(table):
                entry = {"port": name, "description": table.get(remembered.ADAPTER, ""), "hardware": ""}
                found.append({**entry, "remembered": models, "listed": False})
        print_json(found)
        return
    for one in found:
        click.echo("  ".join(filter(None, (one["port"], one["description"], one["hardware"]))))
        _print_remembered(one["remembered"])
    if not found:
        note("no serial port is plugged in; `servobus demo` needs none")
    for name, table in kept.items():
        if models := _models(table):
            click.echo("  ".join(filter(None, (name, table.get(remembered.ADAPTER), "not listed here"))))
            _print_remembered(models)


def _models(table: Mapping[str, str]) -> dict[str, str]:
    """Give the models in a table of the file of remembered ones, by id."""
    return {id: name for id, name in table.items() if id != remembered.ADAPTER}


def _print_remembered(models: Mapping[str, str]) -> None:
    by_model: dict[str, list[str]] = {}
    for id, name in models.items():
        by_model.setdefault(name, []).append(id)
    for name, ids in by_model.items():
        known = MODELS.get(name)
        click.echo(f"    {who_of(ids, models)}: {known.title if known else name}, remembered")


def _known(text: str | None) -> str:
    return "" if text in (None, "n/a") else str(text)


@verb("models", "servobus models", "servobus models mx28", "servobus models --json")
@click.argument("names", metavar="[MODEL]...", nargs=-1, shell_complete=complete.models)
@as_json
def models(names: tuple[str, ...], json: bool) -> None:
    """List the models known here, or say what their makers tell of some, and how sure that is.

    Confidence is high for the maker's own text or a measurement, medium where several texts of others agree, low for a
    single mention or a figure taken over from a sibling.
    """
    found = [registry.model(name) for name in names] or registry.by_series()
    if json:
        from servobus.cli.virtual_motors import motor_entries  # noqa: PLC0415 - virtual servos are slow to import
        from servobus.cli.virtual_options import option_entries  # noqa: PLC0415

        print_json(
            [model_entry(model) | {"options": option_entries(model), "motor": motor_entries(model)} for model in found]
        )
        return
    if names:
        from servobus.cli.virtual_motors import motor_lines  # noqa: PLC0415 - virtual servos are slow to import

        out = console()
        for n, model in enumerate(found):
            if n:
                click.echo()
            for line in filter(None, [*model_lines(model), *motor_lines(model)]):
                out.print(line, markup=False, soft_wrap=not out.is_terminal)
        note(f"`servobus registers {found[0].key()}` shows what it can be asked and told")
        return
    from rich.table import Table  # noqa: PLC0415 - rich is slow to import and not always wanted

    table = Table(
        "name",
        "model",
        "series",
        "angle",
        "supply",
        "torque",
        "speed",
        "sure",
        box=None,
        pad_edge=False,
        padding=(0, 1),
    )
    for model in found:
        sheet = model.sheet
        table.add_row(
            model.key(),
            model.title,
            model.series,
            f"{math.degrees(sheet.angle):.0f}°",
            supply_text(model),
            "-" if sheet.stall_torque is None else f"{sheet.stall_torque:.2f} N·m",
            figure(sheet.speed, "rad/s"),
            str(sheet.confidence),
        )
    console().print(table)
    note("`servobus models NAME` tells more of one, `servobus registers NAME` shows what")
    note("it can be asked and told")
