"""`plot`: readings of servos as curves in the terminal, live."""

import math
from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from servobus.cli import complete
from servobus.cli.canvas import Curve, Panel, draw
from servobus.cli.finding import Where, open_port
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.options import on_servos_with, verb
from servobus.cli.output import console
from servobus.cli.samples import CsvFile, Sample, Sampler
from servobus.cli.values import SECONDS, Ids, check_above_0
from servobus.core.present import unit_text
from servobus.core.units import Measure

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

DRAW_PERIOD = 0.1
"""s between two drawings; values are read as often as they are asked for."""
TALLEST = 40
"""Lines that a picture takes at most."""
PRINTED = 20
"""Lines of a picture that goes to a file or a program."""
WIDEST = 80
"""Columns of such a picture."""
MOST = 100_000
"""Points of a curve that are drawn; older ones are in the file, if there is one."""
FASTEST = 1000.0
"""Readings a second that can be asked for."""


@verb(
    "plot",
    "servobus plot /dev/ttyUSB0 1 present_position",
    "servobus plot /dev/ttyUSB0 1-3 present_position present_temperature --span 60",
    "servobus plot /dev/ttyUSB0 1 present_load --rate 100 --seconds 5 --csv a.csv",
    "servobus plot virtual:rx28@1-2 all present_voltage",
)
@on_servos_with("names", "REGISTER...", shell_complete=complete.registers)
@click.option("--rate", type=float, default=20.0, show_default=True, metavar="HZ", help="Readings a second.")
@click.option("--seconds", type=SECONDS, metavar="S", help="End after so long; else with Ctrl-C.")
@click.option("--span", type=SECONDS, default=10.0, metavar="S", help="How much of the past is shown; 10 s by default.")
@click.option("--csv", type=click.Path(path_type=Path), metavar="FILE", help="Keep all values in FILE.")
def plot(
    port: str,
    ids: Ids,
    where: Where,
    names: tuple[str, ...],
    rate: float,
    seconds: float | None,
    span: float,
    csv: Path | None,
) -> None:
    """Draw registers of the servos ID... on PORT as curves, live. Moves nothing.

    Registers of one unit share a picture. A servo that does not answer leaves a gap, and comes back; an id that is not
    there at the start joins in when it answers. Where there is no terminal the curves are printed once, at the end.
    """
    for option, value in (("--seconds", seconds), ("--span", span)):
        check_above_0(option, value)
    if not 0 < rate <= FASTEST:  # not true of nan either
        raise click.BadParameter(f"{rate:g} is not above 0 and up to {FASTEST:g}", param_hint="--rate")
    out = console()
    with open_port(port) as bus, ExitStack() as stack:
        sampler = Sampler(bus, where, ids, names, 1 / rate)
        history = History(sampler, span)
        table = stack.enter_context(CsvFile(csv)) if csv else None
        stack.enter_context(signals_as_interrupt())
        try:
            if out.is_terminal:
                _show(out, sampler, history, seconds, table)
            else:
                for samples in sampler.until(seconds):
                    _keep(samples, history, table)
        except KeyboardInterrupt:
            pass  # that is how it ends
    if not out.is_terminal:
        click.echo(history.picture(WIDEST, PRINTED, colour=False).plain)
    sampler.tell_end()


def _keep(samples: Sequence[Sample], history: "History", table: CsvFile | None) -> None:
    history.add(samples)
    if table:
        table.write(samples)


def _show(out: "Console", sampler: Sampler, history: "History", seconds: float | None, table: CsvFile | None) -> None:
    from rich.live import Live  # noqa: PLC0415 - slow to import, and only wanted on terminals

    drawn = -DRAW_PERIOD
    with Live(console=out, auto_refresh=False) as live:
        for samples in sampler.until(seconds):
            _keep(samples, history, table)
            if samples[0].time - drawn >= DRAW_PERIOD:
                drawn = samples[0].time
                height = min(out.height - 1, TALLEST)
                live.update(history.picture(out.width, height, colour=out.color_system is not None), refresh=True)


class History:
    """The points of each curve within the last seconds."""

    def __init__(self, sampler: Sampler, span: float) -> None:
        self._span = span
        self._last = 0.0
        self._several = len({name for _, name, _ in sampler.columns}) > 1
        self._curves: list[Curve] = []
        self._units: list[str] = []

    def add(self, samples: Sequence[Sample]) -> None:
        """Take the samples of one turn."""
        self._last = samples[0].time
        for one in samples[len(self._curves) :]:  # all of them at the start, later those of servos that join in
            label = f"{one.servo.target} {one.name}" if self._several else str(one.servo.target)
            self._curves.append(Curve(label, deque(maxlen=MOST)))
            self._units.append(unit_text(one.row))
        for curve, one in zip(self._curves, samples, strict=True):
            curve.points.append((one.time, _number(one)))
            while curve.points[0][0] < self._last - self._span:
                curve.points.popleft()

    def picture(self, width: int, height: int, *, colour: bool) -> "Text":
        """Draw what there is."""
        panels: dict[str, list[Curve]] = {}
        for unit, curve in zip(self._units, self._curves, strict=True):
            panels.setdefault(unit, []).append(curve)
        start = max(0.0, self._last - self._span)
        span = start, max(self._last, start + min(self._span, 1.0))
        return draw([Panel(unit, curves) for unit, curves in panels.items()], span, width, height, colour=colour)


def _number(sample: Sample) -> float:
    """Give a value as the height of a point, in the unit that is shown; nan where none came."""
    if sample.error is not None:
        return math.nan
    value = sample.shown if isinstance(sample.row.scale, Measure) else sample.value
    return float(value)
