"""`read --watch`: values of servos, live."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from servobus import BusServo
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.output import compact, console
from servobus.cli.samples import CsvFile, Sample, Sampler
from servobus.core.present import unit_text
from servobus.errors import BusError
from servobus.families.present import model_name

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live

DRAW_PERIOD = 0.05
"""s between two drawings of the table; values come as often as they are asked for."""


def watch(sampler: Sampler, *, seconds: float | None, csv: Path | None, json: bool) -> None:
    """Show samples until that time is over, or until Ctrl-C or SIGTERM: in a table that stays, or a line each time."""
    with ExitStack() as stack:
        table = stack.enter_context(CsvFile(csv)) if csv else None
        stack.enter_context(signals_as_interrupt())
        live = _live(stack) if console().is_terminal and not json else None
        drawn = -DRAW_PERIOD
        try:
            for samples in sampler.until(seconds):
                if table:
                    table.write(samples)
                if live is None:
                    _print_lines(samples, json=json)
                elif samples[0].time - drawn >= DRAW_PERIOD:
                    drawn = samples[0].time
                    live.update(_table(samples), refresh=True)
        except KeyboardInterrupt:
            pass  # that is how it ends
    sampler.tell_end()


def by_servo(samples: Sequence[Sample]) -> dict[BusServo, list[Sample]]:
    """Sort the samples of one turn by servo."""
    rows: dict[BusServo, list[Sample]] = {}
    for one in samples:
        rows.setdefault(one.servo, []).append(one)
    return rows


def _print_lines(samples: Sequence[Sample], *, json: bool) -> None:
    for servo, row in by_servo(samples).items():
        time, error = row[0].time, row[0].error
        if json:
            entry = {
                "time": round(time, 6),
                "family": servo.family.name,
                "model": model_name(servo.model),
                "id": servo.id,
            }
            if error is not None:
                entry["error"] = str(error)
            else:
                entry["registers"] = {one.name: {"value": one.shown, "unit": unit_text(one.row)} for one in row}
            click.echo(compact(entry))
        else:
            values = "  ".join(f"{one.name} {one}" for one in row) if error is None else _reason(error)
            click.echo(f"{time:8.2f} s  {servo.target}  {values}")


def _reason(error: BusError) -> str:
    return f"no answer ({type(error).__name__})"


def _live(stack: ExitStack) -> "Live":
    from rich.live import Live  # noqa: PLC0415 - slow to import, and only wanted on terminals

    return stack.enter_context(Live(console=console(), auto_refresh=False))


def _table(samples: Sequence[Sample]) -> "RenderableType":
    from rich.table import Table  # noqa: PLC0415 - slow to import, and only wanted on terminals
    from rich.text import Text  # noqa: PLC0415

    servos = by_servo(samples)
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="bold")
    table.add_column(f"{samples[0].time:.1f} s", no_wrap=True)
    for one in next(iter(servos.values())):
        table.add_column(one.name, justify="right", overflow="fold")
    for servo, row in servos.items():
        error = row[0].error
        cells = [Text(str(one), style="bold red" if error is not None else "") for one in row]
        table.add_row(Text(str(servo.target), style="dim" if error is not None else ""), *cells)
    return table
