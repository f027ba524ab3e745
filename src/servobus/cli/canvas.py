"""Curves as characters: braille where colours tell the curves apart, else a mark for each curve."""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from servobus.core.values import frozen

if TYPE_CHECKING:
    from rich.text import Text

COLOURS = ("cyan", "yellow", "magenta", "green", "red", "blue", "bright_white", "bright_black")
MARKS = "*x+o#%@&"
"""What stands for a curve where there is no colour; with more curves they begin again."""
LABEL = 10
"""Columns left of a panel, for what its edges mean."""
SMALLEST = 1.0
"""Least difference between top and bottom, in the unit shown: noise is not to fill the picture."""
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Braille patterns are U+2800 and the sum of these: row, column -> bit."""


@frozen
class Curve:
    """Points (time in s, value) of one curve, in the order of time; nan breaks the line."""

    label: str
    points: deque[tuple[float, float]]


@frozen
class Panel:
    """Curves that share a unit, and so an axis."""

    unit: str
    curves: Sequence[Curve]

    def bounds(self) -> tuple[float, float]:
        """Give the values at the bottom and at the top."""
        values = [value for curve in self.curves for _, value in curve.points if not math.isnan(value)]
        low, high = (min(values), max(values)) if values else (0.0, 0.0)
        missing = max(0.0, SMALLEST - (high - low)) / 2
        return low - missing, high + missing


def draw(panels: Sequence[Panel], span: tuple[float, float], width: int, height: int, *, colour: bool) -> "Text":
    """Draw panels below each other, and a legend, into so many columns and lines."""
    from rich.text import Text  # noqa: PLC0415 - slow to import

    columns = max(width - LABEL - 1, 10)
    lines = max((height - 2 - sum(len(_legend(panel, columns)) for panel in panels)) // max(len(panels), 1), 3)
    picture = Text()
    number = 0
    for panel in panels:
        low, high = panel.bounds()
        rows = _braille if colour else _marks
        for at, row in enumerate(rows(panel, span, (low, high), columns, lines, number)):
            value = {0: high, lines - 1: low}.get(at)
            label = "" if value is None else _edge(value, panel.unit)
            picture.append(f"{label:>{LABEL}} ", style="dim")
            picture.append_text(row)
            picture.append("\n")
        for legend in _legend(panel, columns):
            picture.append(" " * (LABEL + 1))
            for curve in legend:
                style = COLOURS[number % len(COLOURS)] if colour else ""
                mark = "━━" if colour else MARKS[number % len(MARKS)]
                picture.append(f"{mark} {curve.label}   ", style=style)
                number += 1
            picture.append("\n")
    left, right = (f"{moment:.1f} s" for moment in span)
    picture.append(" " * (LABEL + 1) + left + right.rjust(columns - len(left)), style="dim")
    return picture


def _edge(value: float, unit: str) -> str:
    """Write what an edge of a panel means."""
    text = f"{value:.1f}"
    room = LABEL - len(unit) - 1
    return f"{text if len(text) <= room else f'{value:.2g}'} {unit}".strip()


def _legend(panel: Panel, columns: int) -> list[list[Curve]]:
    """Sort the curves of a panel into lines of its legend."""
    lines: list[list[Curve]] = []
    left = 0
    for curve in panel.curves:
        size = len(curve.label) + 6
        if size > left:
            lines.append([])
            left = columns
        lines[-1].append(curve)
        left -= size
    return lines


def _dots(
    curve: Curve, span: tuple[float, float], bounds: tuple[float, float], width: int, height: int
) -> Iterator[tuple[int, int]]:
    """Give the places of a curve on a grid, row and column from the top left, joined by straight lines."""
    (start, end), (low, high) = span, bounds
    before: tuple[int, int] | None = None
    for time, value in curve.points:
        if math.isnan(value) or not start <= time <= end:
            before = None
            continue
        column = round((time - start) / (end - start or 1.0) * (width - 1))
        row = round((high - value) / (high - low) * (height - 1))
        last_row, last_column = before or (row, column)
        steps = max(abs(row - last_row), abs(column - last_column), 1)
        for step in range(steps + 1):
            yield (
                last_row + round((row - last_row) * step / steps),
                last_column + round((column - last_column) * step / steps),
            )
        before = row, column


def _braille(
    panel: Panel, span: tuple[float, float], bounds: tuple[float, float], columns: int, lines: int, first: int
) -> "Iterator[Text]":
    """Draw with dots: two columns and four rows of them in each character, in the colour of the last curve there."""
    from rich.text import Text  # noqa: PLC0415

    cells = [[0] * columns for _ in range(lines)]
    owners = [[first] * columns for _ in range(lines)]
    for number, curve in enumerate(panel.curves, first):
        for down, right in _dots(curve, span, bounds, columns * 2, lines * 4):
            cells[down // 4][right // 2] |= _DOTS[down % 4][right % 2]
            owners[down // 4][right // 2] = number
    for row, owner in zip(cells, owners, strict=True):
        text = Text()
        for number, run in groupby(zip(row, owner, strict=True), key=lambda cell: cell[1]):
            text.append("".join(chr(0x2800 + dots) if dots else " " for dots, _ in run), COLOURS[number % len(COLOURS)])
        yield text


def _marks(
    panel: Panel, span: tuple[float, float], bounds: tuple[float, float], columns: int, lines: int, first: int
) -> "Iterator[Text]":
    """Draw with one mark for each curve, one in each character."""
    from rich.text import Text  # noqa: PLC0415

    cells = [[" "] * columns for _ in range(lines)]
    for number, curve in enumerate(panel.curves, first):
        for down, right in _dots(curve, span, bounds, columns, lines):
            cells[down][right] = MARKS[number % len(MARKS)]
    for row in cells:
        yield Text("".join(row).rstrip())
