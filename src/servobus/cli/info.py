"""`info`: one servo, all of it."""

import textwrap
from collections.abc import Mapping
from typing import Any

import click

from servobus import BusServo
from servobus.cli.advice import note_unknown
from servobus.cli.finding import Where, for_each, open_port
from servobus.cli.options import as_json, on_servos, verb
from servobus.cli.output import console, json_entries
from servobus.cli.values import Ids, are_several
from servobus.connect import VIRTUAL
from servobus.core.present import value_entry, value_text
from servobus.core.registers import Access, Register
from servobus.families.present import model_entry, model_lines, servo_entry
from servobus.jobs.look import read_table

WIDEST = 16
"""Columns that a value may take before its register's meaning makes room for it."""
ROOMY = 110
"""Columns from which on the meaning of a register is shown too."""


@verb(
    "info",
    "servobus info /dev/ttyUSB0 1",
    "servobus info /dev/ttyUSB0 1-4,7",
    "servobus info virtual:lx16a@1 1 --json",
)
@on_servos
@as_json
def info(port: str, ids: Ids, where: Where, json: bool) -> None:
    """Show all of the servos ID... on PORT: their makers' data, every register, their alarms.

    ID is 1, 1-4,7, several words, or `all`. --json gives a list if several are named, or `all`.
    """
    shown: list[BusServo] = []

    def show_one(servo: BusServo) -> None:
        servo.look()
        raws = servo._bus.do(read_table(servo.target), baud=servo.baud)
        if shown:
            click.echo()
        shown.append(servo)
        _print(servo, raws)

    with open_port(port) as bus:
        if not json:
            try:
                for_each(bus, where, ids, show_one)
            finally:
                note_unknown(port, [(servo.id, servo.model) for servo in shown])
            return
        with json_entries(several=are_several(ids)) as entries:
            for_each(bus, where, ids, lambda servo: entries.append(_entry(servo)))


def _entry(servo: BusServo) -> dict[str, Any]:
    servo.look()
    raws = servo._bus.do(read_table(servo.target), baud=servo.baud)
    return {
        **servo_entry(servo.family, servo.model, servo.id, servo.baud, servo.firmware),
        "alarms": servo.alarm_text().split("+") if servo.alarms else [],
        "registers": {row.name: value_entry(row, raw) for row, raw in raws.items() if raw is not None},
        **({"options": options} if (options := _options(servo)) else {}),
        "sheet": model_entry(servo.model),
    }


def _print(servo: BusServo, raws: Mapping[Register[Any], int | None]) -> None:
    out = console()
    out.print(str(servo), style="bold", markup=False)
    out.print(f"firmware {servo.firmware or 'unknown: it cannot be asked'}", markup=False)
    for line in model_lines(servo.model):
        out.print(line, markup=False)
    out.print()
    values = {row: "no answer" if raw is None else value_text(row, raw) for row, raw in raws.items()}
    name_width = max(len(row.name) for row in values)
    value_width = max(len(value) for value in values.values() if len(value) <= WIDEST)
    for row, value in values.items():
        style = "dim" if row.access is Access.READ else None
        first, *rest = textwrap.wrap(value, max(out.width - name_width - 3, WIDEST))
        # A narrow terminal has no room for it; `servobus registers` tells.
        meaning = f"  {row.meaning}" if len(first) <= value_width and out.width >= ROOMY else ""
        line = f"{row.name:<{name_width}}  {first:<{value_width}}{meaning}"
        # One line for each register; `servobus registers` has room for all of the meaning.
        out.print(line, style=style, markup=False, no_wrap=True, overflow="ellipsis")
        for more in rest:
            out.print(" " * name_width + "  " + more, style=style, markup=False, no_wrap=True)
    if options := _options(servo):
        out.print("\noptions of this virtual servo:", markup=False)
        for name, word in options.items():
            out.print(f"{name:<{name_width}}  {word}", markup=False)


def _options(servo: BusServo) -> dict[str, str]:
    """Give the options of a virtual servo of this process; a real one has none."""
    transport = servo._bus.transport
    if not transport.name.startswith(VIRTUAL):
        return {}
    from servobus.cli.virtual_options import options_at  # noqa: PLC0415 - virtual servos are slow to import

    return options_at(transport, servo.model, servo.id)
