"""How traffic is shown: line by line as it comes, and what it comes to at the end. For `sniff` and `decode`."""

from collections.abc import Iterable
from typing import Any

import click

from servobus.cli.output import compact
from servobus.traffic.events import ServoTraffic, TrafficEvent
from servobus.traffic.recording import Direction
from servobus.traffic.tracker import Tracker

ROW = 16
"""Bytes shown on one line."""
WIDTH = 80
MARGIN = 14
"""Columns of the time and the direction."""
HEX_WIDTH = 3 * ROW
HEADS = ("servo", "requests", "answers", "median", "longest", "missing", "corrupt", "other", "errors")


def show(sight: TrafficEvent) -> str:
    """Write one thing that was seen, for people."""
    head, indent = f"{sight.time:11.6f} {sight.direction} ", " " * MARGIN
    wait = "" if sight.latency is None else f"+{milliseconds(sight.latency)}"
    lines = []
    for at in range(0, len(sight.raw), ROW):
        row = sight.raw[at : at + ROW].hex(" ").upper()
        lines.append(f"{head}{row:<{HEX_WIDTH}}{wait:>{WIDTH - MARGIN - HEX_WIDTH}}".rstrip())
        head, wait = indent, ""
    text = head + sight.text
    if len(text) > WIDTH:
        text = click.wrap_text(sight.text, WIDTH, head, indent)
    return "\n".join([*lines, click.style(text, fg="red") if sight.trouble else text])


def entry(sight: TrafficEvent) -> dict[str, Any]:
    """Give one thing that was seen for JSON; times in s."""
    return {
        "kind": sight.kind,
        "time": sight.time,
        "direction": None if sight.direction is Direction.UNKNOWN else sight.direction,
        "family": sight.family.name if sight.family else None,
        "id": sight.id,
        "hex": sight.raw.hex(" ").upper(),
        "text": sight.text,
        "latency": None if sight.latency is None else round(sight.latency, 6),
        "trouble": sight.trouble,
    }


def report(sights: Iterable[TrafficEvent], *, json: bool) -> None:
    """Print what was seen."""
    lines = [compact(entry(sight)) if json else show(sight) for sight in sights]
    if lines:
        click.echo("\n".join(lines))


def conclude(tracker: Tracker, *, json: bool) -> None:
    """Print what it comes to, servo by servo."""
    if json:
        servos = [_servo(tally) for tally in tracker.servos]
        totals = {
            "kind": "summary",
            "time": round(tracker.time, 6),
            "junk": tracker.junk,
            "corrupt": tracker.corrupt,
            "cut_short": tracker.cut_short,
        }
        click.echo(compact({**totals, "servos": servos}))
        return
    rows = [HEADS, *(_row(tally) for tally in tracker.servos)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADS))]
    click.echo()
    for row in rows if len(rows) > 1 else []:
        first, *others = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        click.echo(" ".join([row[0].ljust(len(first)), *others]))
    click.echo(
        f"{tracker.time:.1f} s; {_count(tracker.junk, 'byte')} of junk, "
        f"{_count(tracker.corrupt, 'packet')} with a wrong checksum"
        + (f", {tracker.cut_short} cut short" if tracker.cut_short else "")
    )


def _row(tally: ServoTraffic) -> tuple[str, ...]:
    rate = tally.error_rate
    return (
        f"{tally.family.name} {'all' if tally.everybody else tally.id}",
        str(tally.requests),
        str(tally.answers),
        milliseconds(tally.median),
        milliseconds(tally.worst),
        str(tally.missing),
        str(tally.corrupt),
        str(tally.other),
        "" if rate is None else f"{100 * rate:.3g} %",
    )


def _servo(tally: ServoTraffic) -> dict[str, Any]:
    rate = tally.error_rate
    return {
        "family": tally.family.name,
        "id": tally.id,
        "requests": tally.requests,
        "answers": tally.answers,
        "latency_median": None if tally.median is None else round(tally.median, 6),
        "latency_longest": None if tally.worst is None else round(tally.worst, 6),
        "missing": tally.missing,
        "corrupt": tally.corrupt,
        "other": tally.other,
        "error_rate": None if rate is None else round(rate, 6),
    }


def milliseconds(seconds: float | None) -> str:
    return "" if seconds is None else f"{1000 * seconds:.2f} ms"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
