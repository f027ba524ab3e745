"""Printing: results to standard output, notes beside them to standard error."""

import contextlib
import json
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from servobus import BusServo
from servobus.core.units import shown
from servobus.families.present import model_name

if TYPE_CHECKING:
    from rich.console import Console

WIDE = 200
"""Columns of tables that go to a file or a program: nothing is folded there."""


def note(text: str) -> None:
    """Print a note beside the result, on standard error. A terminal that is gone is no reason to fail."""
    with contextlib.suppress(OSError):
        click.echo(text, err=True)


def print_json(data: Any) -> None:
    click.echo(json.dumps(data, indent=2, ensure_ascii=False))


def which(servo: BusServo) -> dict[str, Any]:
    """Say for programs which servo is meant, among several."""
    return {"family": servo.family.name, "model": model_name(servo.model), "id": servo.id, "baud": servo.baud}


def quantity_entry(value: float, unit: str) -> dict[str, Any] | None:
    """Give a value with the unit that people use; None for NaN, which stands for a unit that is not known."""
    if math.isnan(value):
        return None
    number, symbol = shown(value, unit)
    return {"value": number, "unit": symbol}


@contextmanager
def json_entries(*, several: bool) -> Iterator[list[Any]]:
    """Collect what is printed at the end, even if an error ends it: a list of several, else the one that came."""
    entries: list[Any] = []
    try:
        yield entries
    finally:
        for data in [entries] if several else entries:
            print_json(data)


def compact(data: Any) -> str:
    """Give JSON on one line, for output that goes on."""
    return json.dumps(data, ensure_ascii=False)


def console(*, stderr: bool = False) -> "Console":
    """Give rich's console: plain text unless it is a terminal."""
    from rich.console import Console  # noqa: PLC0415 - rich is slow to import and not always wanted

    stream = sys.stderr if stderr else sys.stdout
    return Console(file=stream, highlight=False, soft_wrap=False, width=None if stream.isatty() else WIDE, emoji=False)


def warn_alarms(servo: BusServo) -> None:
    """Note the alarms that a servo reported beside its replies."""
    if servo.alarms:
        note(f"{servo.target}: ALARM {servo.alarm_text()}")
