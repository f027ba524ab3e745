"""How results are printed: the same value for people and for programs."""

import json
import sys
from typing import TYPE_CHECKING, Any

import click

from servobus import BusServo
from servobus.core.registers import Register
from servobus.core.units import Choice, Flags, Quantity, shown

if TYPE_CHECKING:
    from rich.console import Console

WIDE = 200
"""Columns of tables that go to a file or a program: nothing is folded there."""


def note(text: str) -> None:
    """Tell people something beside the result."""
    click.echo(text, err=True)


def print_json(data: Any) -> None:
    click.echo(json.dumps(data, indent=2, ensure_ascii=False))


def compact(data: Any) -> str:
    """Give JSON on one line, for output that goes on."""
    return json.dumps(data, ensure_ascii=False)


def console(*, stderr: bool = False) -> "Console":
    """Give rich's console: plain text unless it is a terminal."""
    from rich.console import Console  # noqa: PLC0415 - rich is slow to import and not always wanted

    stream = sys.stderr if stderr else sys.stdout
    return Console(file=stream, highlight=False, soft_wrap=False, width=None if stream.isatty() else WIDE, emoji=False)


def plain(register: Register[Any], raw: int) -> Any:
    """Give a value for JSON, in the unit people use; the raw integer where it has no meaning."""
    try:
        value = register.decode(raw)
    except ValueError:
        return raw
    scale = register.scale
    if isinstance(scale, Quantity):
        return shown(value, scale.unit)[0]
    if isinstance(scale, Choice | Flags):
        return scale.show(value)
    return value


def unit(register: Register[Any]) -> str:
    """Give the unit that goes with `plain`; empty for switches, choices and plain numbers."""
    return shown(0.0, register.unit)[1] if register.unit else ""


def text(register: Register[Any], raw: int) -> str:
    """Write a raw integer as people read it."""
    try:
        return register.show(register.decode(raw))
    except ValueError:
        return f"raw {raw} (no known meaning)"


def entry(register: Register[Any], raw: int) -> dict[str, Any]:
    """Give one value for JSON."""
    return {"value": plain(register, raw), "unit": unit(register), "raw": raw}


def identity(servo: BusServo) -> dict[str, Any]:
    """Say for JSON who a servo is."""
    return {
        "family": servo.family.name,
        "model": servo.model.key(),
        "id": servo.id,
        "baud": servo.baud,
        "firmware": servo.firmware,
    }


def warn_alarms(servo: BusServo) -> None:
    """Say the alarms that stand beside what a servo answered."""
    if servo.alarms:
        note(f"{servo.target}: ALARM {servo.alarm_text()}")
