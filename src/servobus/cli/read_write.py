"""`read` and `write`: single registers."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click

from servobus import Bus, BusServo
from servobus.cli import complete
from servobus.cli.finding import Where, find_all, for_each, open_port
from servobus.cli.options import as_json, on_servos_with, verb
from servobus.cli.output import json_entries, note, warn_alarms, which
from servobus.cli.values import SECONDS, Ids, are_several, check_above_0, readable, split_assignment
from servobus.core.present import change_entry, value_entry, value_text
from servobus.core.registers import Register
from servobus.errors import BadValue, BusError, UsageError
from servobus.families.base import Answers

WHO = 15
"""Columns for the name of a servo before its values, as long as most are."""


@verb(
    "read",
    "servobus read /dev/ttyUSB0 1 present_position",
    "servobus read /dev/ttyUSB0 1-4,7 present_voltage present_temperature --json",
    "servobus read /dev/ttyUSB0 all present_position",
    "servobus read /dev/ttyUSB0 1-4 present_position present_temperature --watch",
    "servobus read /dev/ttyUSB0 1 present_load --watch --interval 0.02 --csv a.csv",
)
@on_servos_with("names", "REGISTER...", shell_complete=complete.registers)
@click.option("--watch", is_flag=True, help="Read again and again, until Ctrl-C.")
@click.option("--interval", type=SECONDS, metavar="S", help="With --watch: seconds from reading to reading; else 0.2.")
@click.option("--seconds", type=SECONDS, metavar="S", help="With --watch: end after so long.")
@click.option("--csv", type=click.Path(path_type=Path), metavar="FILE", help="With --watch: keep all values in FILE.")
@as_json
def read(
    port: str,
    ids: Ids,
    where: Where,
    names: tuple[str, ...],
    watch: bool,
    interval: float | None,
    seconds: float | None,
    csv: Path | None,
    json: bool,
) -> None:
    """Read registers of the servos ID... on PORT: of 1, of 1-4,7, of several words, or of `all`.

    `servobus registers MODEL` lists their names; names like present_position work on every model. --json gives a
    list if several servos are named, or `all`.

    --watch shows values live: in a table on a terminal, else a line (--json: an object) for each servo each time. A
    servo that does not answer is shown so, and comes back; an id that is not there at the start joins in when it
    answers, and if it never does the exit code is 1. Nothing moves.
    """
    if watch:
        _watch(port, ids, where, names, interval, seconds, csv, json=json)
        return
    for option, value in (("--interval", interval), ("--seconds", seconds), ("--csv", csv)):
        if value is not None:
            raise click.UsageError(f"{option} goes with --watch")
    several = are_several(ids)

    def read_one(servo: BusServo) -> None:
        values = _values(servo, names)
        if json:
            registers = {name: value_entry(row, raw) for name, (row, raw) in values.items()}
            entries.append({**which(servo), "registers": registers} if several else registers)
        else:
            _print_rows(servo, {name: value_text(row, raw) for name, (row, raw) in values.items()}, several=several)
        warn_alarms(servo)

    with open_port(port) as bus:
        if not json:
            for_each(bus, where, ids, read_one)
            return
        with json_entries(several=several) as entries:
            for_each(bus, where, ids, read_one)


def _watch(
    port: str,
    ids: Ids,
    where: Where,
    names: tuple[str, ...],
    interval: float | None,
    seconds: float | None,
    csv: Path | None,
    *,
    json: bool,
) -> None:
    from servobus.cli.samples import Sampler  # noqa: PLC0415 - a single reading needs neither
    from servobus.cli.watch import watch  # noqa: PLC0415

    for option, value in (("--interval", interval), ("--seconds", seconds)):
        check_above_0(option, value)
    with open_port(port) as bus:
        sampler = Sampler(bus, where, ids, names, 0.2 if interval is None else interval)
        watch(sampler, seconds=seconds, csv=csv, json=json)


def _values(servo: BusServo, names: Sequence[str]) -> dict[str, tuple[Register[Any], int]]:
    """Read registers: name -> register and raw value."""
    rows = [readable(servo.model, name) for name in names]
    return dict(zip(names, zip(rows, servo.read_raw(rows), strict=True), strict=True))


def _print_rows(servo: BusServo, values: Mapping[str, str], *, several: bool) -> None:
    """Print name and value, a line each, with the servo before it if there are several."""
    head = f"{servo.target!s:<{WHO}}  " if several else ""
    width = max(map(len, values))
    for name, text in values.items():
        click.echo(f"{head}{name:<{width}}  {text}")


@verb(
    "write",
    "servobus write /dev/ttyUSB0 1 led=on",
    "servobus write /dev/ttyUSB0 1-4,7 max_position=200",
    "servobus write /dev/ttyUSB0 1 max_position=200deg min_position=20 --save",
    "servobus write /dev/ttyUSB0 219 status_error=0 status_detail=0",
)
@on_servos_with("settings", "REGISTER=VALUE...", shell_complete=complete.settings)
@click.option("--save", is_flag=True, help="Store it so that it survives power-off; a HerkuleX forgets it else.")
@as_json
def write(port: str, ids: Ids, where: Where, settings: tuple[str, ...], save: bool, json: bool) -> None:
    """Write registers of the servos ID... on PORT, read them back, and show old -> new.

    Values are typed as `read` shows them: 90 or 90deg for an angle, on, 0x20, overload+overheating.
    Nothing is written unless all ids, names and values are right. --json gives a list if several servos are named.
    """
    wanted = dict(split_assignment(setting, "REGISTER=VALUE, such as led=on") for setting in settings)
    if len(wanted) != len(settings):
        raise click.UsageError("a register is named twice")
    several = are_several(ids)
    with open_port(port) as bus:
        plans = [(servo, _encoded(servo, wanted)) for servo in find_all(bus, where, ids)]
        with json_entries(several=several) if json else nullcontext() as entries:
            for servo, raws in plans:
                _write(bus, servo, raws, save=save, entries=entries, several=several)


def _encoded(servo: BusServo, wanted: Mapping[str, str]) -> dict[Register[Any], int]:
    """Check names and values for a servo: register -> raw value."""
    values = {readable(servo.model, name): value for name, value in wanted.items()}
    if len(values) != len(wanted):
        raise BadValue("a register is named twice, once by an alias")
    return {row: _encode(servo, row, value) for row, value in values.items()}


def _write(
    bus: Bus, servo: BusServo, raws: dict[Register[Any], int], *, save: bool, entries: list[Any] | None, several: bool
) -> None:
    """Write, read back, and show what became of it. Raises BusError for a value that was not taken."""
    old = _read(bus, servo, list(raws), save=save)
    if save:
        servo.store({row: row.decode(raw) for row, raw in raws.items()})
    else:
        servo.write_raw(raws)
    new = _read(bus, servo, list(raws), save=save)
    before = dict(zip(raws, old, strict=True)) if old is not None else {}
    after = dict(zip(raws, new, strict=True)) if new is not None else raws
    if entries is not None:
        changes = {row.name: change_entry(row, before.get(row), after[row]) for row in raws}
        entries.append({**which(servo), "registers": changes} if several else changes)
    else:
        texts = {
            row.name: f"{value_text(row, before[row]) if row in before else '?'} -> {value_text(row, after[row])}"
            for row in raws
        }
        _print_rows(servo, texts, several=several)
    warn_alarms(servo)
    if new is None:
        note(f"{servo.target} answers no reads, so it was not read back")
        return
    for (row, raw), now in zip(raws.items(), new, strict=True):
        if not row.took(raw, now):
            raise BusError(
                f"{servo.target} did not take {row.name} = {value_text(row, raw)}: it is {value_text(row, now)}"
            )


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
