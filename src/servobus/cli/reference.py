"""`ports`, `models`: what is plugged in, and what is known."""

from typing import Any

import click

from servobus import MODELS
from servobus.cli.options import as_json, verb
from servobus.cli.output import console, note, print_json
from servobus.core.units import show, shown
from servobus.families.base import Model


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
        print_json([sheet(model) for model in MODELS.values()])
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


def sheet(model: type[Model]) -> dict[str, Any]:
    """Give the maker's specification for JSON, in the units people use."""
    spec = model.sheet
    return {
        "name": model.key(),
        "model": model.title,
        "maker": spec.maker,
        "family": model.family.name,
        "number": model.number,
        "bauds": sorted(model.bauds),
        "default_baud": model.factory_baud,
        "angle": {"value": shown(spec.angle, "rad")[0], "unit": "°"},
        "resolution": {"value": shown(spec.resolution, "rad")[0], "unit": "°"},
        "voltage": {"value": list(spec.voltage), "unit": "V"},
        "temperature": {"value": list(spec.temperature), "unit": "°C"} if spec.temperature else None,
        "weight": {"value": round(spec.weight * 1000, 3), "unit": "g"} if spec.weight else None,
        "size": {"value": [round(side * 1000, 3) for side in spec.size], "unit": "mm"} if spec.size else None,
        "gear_ratio": spec.gear_ratio,
        "performance": [
            {
                "voltage": {"value": point.voltage, "unit": "V"},
                "stall_torque": {"value": round(point.stall_torque, 3), "unit": "N·m"},
                "speed": {"value": shown(point.speed, "rad/s")[0], "unit": "°/s"},
            }
            for point in spec.performance
        ],
        "link": spec.link,
    }
