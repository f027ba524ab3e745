"""How `sniff` and `decode` print traffic: line by line as it comes, and a summary at the end."""

from collections.abc import Iterable

import click

from servobus.cli.output import compact
from servobus.traffic.events import TrafficEvent
from servobus.traffic.present import COLUMNS, event_entry, event_lines, summary_entry, table, totals_text
from servobus.traffic.tracker import Tracker


def print_events(events: Iterable[TrafficEvent], *, json: bool, timed: bool = True) -> None:
    """Print what was carried or heard; without its times if they are not known."""
    lines = [compact(event_entry(event, timed=timed)) if json else _coloured(event, timed=timed) for event in events]
    if lines:
        click.echo("\n".join(lines))


def print_summary(tracker: Tracker, *, json: bool, timed: bool = True) -> None:
    """Print what the traffic comes to, servo by servo; without times if they are not known."""
    if json:
        click.echo(compact(summary_entry(tracker, timed=timed)))
        return
    click.echo()
    if servos := table(tracker):
        rows = [COLUMNS, *servos]
        widths = [max(len(row[column]) for row in rows) for column in range(len(COLUMNS))]
        for row in rows:
            first, *others = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
            click.echo(" ".join([row[0].ljust(len(first)), *others]))
    click.echo(totals_text(tracker, timed=timed))


def _coloured(event: TrafficEvent, *, timed: bool) -> str:
    lines, text = event_lines(event, timed=timed)
    return "\n".join([*lines, click.style(text, fg="red") if event.trouble else text])
