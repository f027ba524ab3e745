"""`read` and `write`: single registers."""

from collections.abc import Sequence
from typing import Any

import click

from servobus import Bus, BusServo
from servobus.cli.options import Where, as_json, find, on_servo, open_port, split_assignment, verb
from servobus.cli.output import note, print_json, warn_alarms
from servobus.core.present import json_value, unit_text, value_entry, value_text
from servobus.core.registers import Register
from servobus.errors import BadValue, BusError, UsageError
from servobus.families.base import Answers


@verb(
    "read",
    "servobus read /dev/ttyUSB0 1 present_position",
    "servobus read /dev/ttyUSB0 1 present_voltage present_temperature --json",
)
@on_servo
@click.argument("names", metavar="REGISTER...", nargs=-1, required=True)
@as_json
def read(port: str, id: int, where: Where, names: tuple[str, ...], json: bool) -> None:
    """Read registers of the servo ID on PORT.

    `servobus registers MODEL` lists their names; names like present_position work on every model.
    """
    with open_port(port) as bus:
        servo = find(bus, where, id)
        rows = [_readable(servo, name) for name in names]
        raws = servo.read_raw(rows)
    if json:
        print_json({name: value_entry(row, raw) for name, row, raw in zip(names, rows, raws, strict=True)})
    else:
        width = max(map(len, names))
        for name, row, raw in zip(names, rows, raws, strict=True):
            click.echo(f"{name:<{width}}  {value_text(row, raw)}")
    warn_alarms(servo)


@verb(
    "write",
    "servobus write /dev/ttyUSB0 1 led=on",
    "servobus write /dev/ttyUSB0 1 max_position=200deg min_position=20 --save",
    "servobus write /dev/ttyUSB0 219 status_error=0 status_detail=0",
)
@on_servo
@click.argument("settings", metavar="REGISTER=VALUE...", nargs=-1, required=True)
@click.option("--save", is_flag=True, help="Store it so that it survives power-off; a HerkuleX forgets it else.")
@as_json
def write(port: str, id: int, where: Where, settings: tuple[str, ...], save: bool, json: bool) -> None:
    """Write registers of the servo ID on PORT, read them back, and show old -> new.

    Values are typed as `read` shows them: 90 or 90deg for an angle, on, 0x20, overload+overheating.
    Nothing is written unless all names and values are right.
    """
    wanted = dict(split_assignment(setting, "REGISTER=VALUE, such as led=on") for setting in settings)
    if len(wanted) != len(settings):
        raise BadValue("a register is named twice")
    with open_port(port) as bus:
        servo = find(bus, where, id)
        values = {_readable(servo, name): value for name, value in wanted.items()}
        if len(values) != len(wanted):
            raise BadValue("a register is named twice, once by an alias")
        raws = {row: _encode(servo, row, value) for row, value in values.items()}
        old = _read(bus, servo, list(raws), save=save)
        if save:
            servo.store({row: row.decode(raw) for row, raw in raws.items()})
        else:
            servo.write_raw(raws)
        new = _read(bus, servo, list(raws), save=save)
    _show(raws, old, new, json=json)
    warn_alarms(servo)
    if new is None:
        note(f"{servo.target} answers no reads, so it was not read back")
        return
    for (row, raw), now in zip(raws.items(), new, strict=True):
        if now != raw:
            raise BusError(
                f"{servo.target} did not take {row.name} = {value_text(row, raw)}: it is {value_text(row, now)}"
            )


def _readable(servo: BusServo, name: str) -> Register[Any]:
    row = servo.model.register(name)
    if not row.readable:
        raise UsageError(f"{row.model} {row.name} is reserved: it has no meaning")
    return row


def _encode(servo: BusServo, row: Register[Any], value: str) -> int:
    # These two change under which name the servo is reached, which needs care that a plain write does not take.
    for special, other in ((servo.model.register("id"), "set-id"), (servo.model.optional("baud"), "set-baud")):
        if row is special:
            raise UsageError(
                f"{row.model} {row.name} is changed by `servobus {other}`, which checks first that it can be"
            )
    return row.encode(row.parse(value))


def _read(bus: Bus, servo: BusServo, rows: Sequence[Register[Any]], *, save: bool) -> list[int] | None:
    """Read what acts, or with `save` what survives power-off; None if the servo answers nothing."""
    if servo.target.answers is Answers.NOTHING:
        return None
    if save:
        return bus.do(servo.family.read_stored(servo.target, rows), baud=servo.baud)
    return servo.read_raw(rows)


def _show(raws: dict[Register[Any], int], old: list[int] | None, new: list[int] | None, *, json: bool) -> None:
    before = dict(zip(raws, old, strict=True)) if old is not None else {}
    after = dict(zip(raws, new, strict=True)) if new is not None else raws
    if json:
        print_json(
            {
                row.name: {
                    "old": json_value(row, before[row]) if row in before else None,
                    "new": json_value(row, after[row]),
                    "unit": unit_text(row),
                }
                for row in raws
            }
        )
        return
    width = max(len(row.name) for row in raws)
    for row in raws:
        was = value_text(row, before[row]) if row in before else "?"
        click.echo(f"{row.name:<{width}}  {was} -> {value_text(row, after[row])}")
