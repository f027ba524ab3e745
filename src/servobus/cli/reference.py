"""`ports`, `models`: what is plugged in, and what is known."""

import click

from servobus import MODELS
from servobus.cli.options import as_json, verb
from servobus.cli.output import console, note, print_json
from servobus.core.units import show
from servobus.families.present import model_entry


@verb("ports", "servobus ports", "servobus ports --json")
@as_json
def ports(json: bool) -> None:
    """List the serial ports of this computer. Opens none of them."""
    from serial.tools import list_ports  # noqa: PLC0415 - only this verb needs it

    found = [
        {"port": port.device, "description": _known(port.description), "hardware": _known(port.hwid)}
        for port in sorted(list_ports.comports())
    ]
    if json:
        print_json(found)
        return
    for port in found:
        click.echo("  ".join(filter(None, (port["port"], port["description"], port["hardware"]))))
    if not found:
        note("no serial port is plugged in; `servobus demo` needs none")


def _known(text: str | None) -> str:
    return "" if text in (None, "n/a") else str(text)


@verb("models", "servobus models", "servobus models --json")
@as_json
def models(json: bool) -> None:
    """List the models known here, with the data of their makers."""
    if json:
        from servobus.cli.virtual_options import option_entries  # noqa: PLC0415 - virtual servos are slow to import

        print_json([model_entry(model) | {"options": option_entries(model)} for model in MODELS.values()])
        return
    from rich.table import Table  # noqa: PLC0415 - rich is slow to import and not always wanted

    table = Table("name", "model", "family", "angle", "supply", "torque", "speed", box=None, pad_edge=False)
    for model in MODELS.values():
        best = model.sheet.performance[-1]
        low, high = model.sheet.voltage
        table.add_row(
            model.key(),
            model.title,
            model.family.name,
            show(model.sheet.angle, "rad"),
            f"{low:g}-{high:g} V",
            f"{best.stall_torque:.2f} N·m",
            show(best.speed, "rad/s"),
        )
    console().print(table)
    note("`servobus registers NAME` shows what a model can be asked and told")
