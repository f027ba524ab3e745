"""`info`: one servo, all of it."""

import textwrap
from typing import Any

from servobus import BusServo, NoReply
from servobus.cli.options import Where, as_json, find, on_servo, open_port, verb
from servobus.cli.output import console, print_json
from servobus.core.present import value_entry, value_text
from servobus.core.registers import Access, Register
from servobus.errors import BusError, Refused
from servobus.families.present import model_entry, model_lines, servo_entry

WIDEST = 16
"""Columns that a value may take before its register's meaning makes room for it."""
ROOMY = 110
"""Columns from which on the meaning of a register is shown too."""


@verb("info", "servobus info /dev/ttyUSB0 1", "servobus info virtual:lx16a@1 1 --json")
@on_servo
@as_json
def info(port: str, id: int, where: Where, json: bool) -> None:
    """Show all of the servo ID on PORT: its maker's data, every register, its alarms."""
    with open_port(port) as bus:
        servo = find(bus, where, id)
        servo.look()
        raws = _read_all(servo)
    if json:
        registers = {row.name: value_entry(row, raw) for row, raw in raws.items() if raw is not None}
        alarms = servo.alarm_text().split("+") if servo.alarms else []
        print_json(
            {
                **servo_entry(servo.family, servo.model, servo.id, servo.baud, servo.firmware),
                "alarms": alarms,
                "registers": registers,
                "sheet": model_entry(servo.model),
            }
        )
        return
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


def _read_all(servo: BusServo) -> dict[Register[Any], int | None]:
    """Read every register; one by one if that fails, for there are servos that lack some."""
    rows = [row for row in servo.model.registers.values() if row.readable]
    try:
        return dict(zip(rows, servo.read_raw(rows), strict=True))
    except (NoReply, Refused) as error:
        first: BusError = error
    raws: dict[Register[Any], int | None] = {}
    for row in rows:
        try:
            (raws[row],) = servo.read_raw([row])
        except (NoReply, Refused):
            raws[row] = None
    if not any(raw is not None for raw in raws.values()):
        raise first
    return raws
