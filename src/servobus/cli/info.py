"""`info`: one servo, all of it."""

from typing import Any

from servobus import BusServo, NoReply
from servobus.cli.options import Where, as_json, find, on_servo, opened, verb
from servobus.cli.output import console, entry, identity, print_json, text
from servobus.cli.reference import sheet
from servobus.errors import BusError, Refused
from servobus.families.base import Model
from servobus.registers import Access, Register
from servobus.units import show

WIDEST = 24
"""Columns that a value may take before it is folded."""


@verb("info", "servobus info /dev/ttyUSB0 1", "servobus info virtual:lx16a@1 1 --json")
@on_servo
@as_json
def info(port: str, id: int, where: Where, json: bool) -> None:
    """Show all of the servo ID on PORT: its maker's data, every register, its alarms."""
    with opened(port) as bus:
        servo = find(bus, where, id)
        servo.look()
        raws = _read_all(servo)
    if json:
        registers = {row.name: entry(row, raw) for row, raw in raws.items() if raw is not None}
        alarms = servo.alarm_text().split("+") if servo.alarms else []
        print_json({**identity(servo), "alarms": alarms, "registers": registers, "sheet": sheet(servo.model)})
        return
    from rich.table import Column, Table  # noqa: PLC0415 - rich is slow to import and not always wanted

    out = console()
    out.print(str(servo), style="bold", markup=False)
    out.print(f"firmware {servo.firmware or 'unknown: it cannot be asked'}", markup=False)
    for line in _sheet_lines(servo.model):
        out.print(line, markup=False)
    values = {row: "no answer" if raw is None else text(row, raw) for row, raw in raws.items()}
    table = Table(
        # One line for each register; `servobus registers` has room for all of the meaning.
        Column("register", no_wrap=True, min_width=max(len(row.name) for row in raws)),
        Column("value", overflow="fold", min_width=min(max(map(len, values.values())), WIDEST)),
        Column("meaning", no_wrap=True),
        box=None,
        pad_edge=False,
    )
    for row, value in values.items():
        table.add_row(row.name, value, row.meaning, style="dim" if row.access is Access.READ else None)
    out.print()
    out.print(table)


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


def _sheet_lines(model: type[Model]) -> list[str]:
    spec = model.sheet
    low, high = spec.voltage
    lines = [
        f"{spec.maker} {model.title}, {model.family.title}",
        f"{show(spec.angle, 'rad')} in steps of {spec.resolution * 57.29577951:.3f}°, supply {low:g} to {high:g} V",
    ]
    lines += [
        f"at {point.voltage:g} V: {point.stall_torque:.2f} N·m, {show(point.speed, 'rad/s')}"
        for point in spec.performance
    ]
    body = [
        f"{spec.weight * 1000:g} g" if spec.weight else "",
        " x ".join(f"{side * 1000:.1f}" for side in spec.size) + " mm" if spec.size else "",
        f"gear 1:{spec.gear_ratio:g} {spec.gear}".strip(", ") if spec.gear_ratio else "",
        spec.motor,
    ]
    lines += [", ".join(filter(None, body)), spec.link]
    return lines
