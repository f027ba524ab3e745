"""Traffic as JSON and as lines of text: event by event, and what it comes to servo by servo. Prints nothing."""

import textwrap
from typing import Any

from servobus.traffic.events import ServoTraffic, TrafficEvent
from servobus.traffic.recording import Direction
from servobus.traffic.tracker import Tracker

BYTES_PER_LINE = 16
WIDTH = 80
MARGIN = 14
"""Columns of the time and the direction."""
HEX_WIDTH = 3 * BYTES_PER_LINE
COLUMNS = ("servo", "requests", "answers", "median", "longest", "missing", "corrupt", "other", "errors")
"""Headings of `table`."""


def event_entry(event: TrafficEvent) -> dict[str, Any]:
    """Give one event; times in s."""
    return {
        "kind": event.kind,
        "time": event.time,
        "direction": None if event.direction is Direction.UNKNOWN else event.direction,
        "family": event.family.name if event.family else None,
        "id": event.id,
        "hex": event.raw.hex(" ").upper(),
        "text": event.text,
        "latency": None if event.latency is None else round(event.latency, 6),
        "trouble": event.trouble,
    }


def event_lines(event: TrafficEvent) -> tuple[list[str], str]:
    """Write one event: lines of hex bytes, the first with the time and the latency, and what they say below."""
    head, indent = f"{event.time:11.6f} {event.direction} ", " " * MARGIN
    wait = "" if event.latency is None else f"+{_milliseconds(event.latency)}"
    lines = []
    for at in range(0, len(event.raw), BYTES_PER_LINE):
        row = event.raw[at : at + BYTES_PER_LINE].hex(" ").upper()
        lines.append(f"{head}{row:<{HEX_WIDTH}}{wait:>{WIDTH - MARGIN - HEX_WIDTH}}".rstrip())
        head, wait = indent, ""
    text = head + event.text
    if len(text) > WIDTH:
        text = textwrap.fill(event.text, WIDTH, initial_indent=head, subsequent_indent=indent, replace_whitespace=False)
    return lines, text


def summary_entry(tracker: Tracker) -> dict[str, Any]:
    """Give the totals, and what each servo did; times in s."""
    return {
        "kind": "summary",
        "time": round(tracker.time, 6),
        "junk": tracker.junk,
        "corrupt": tracker.corrupt,
        "cut_short": tracker.cut_short,
        "servos": [servo_entry(servo) for servo in tracker.servos],
    }


def servo_entry(servo: ServoTraffic) -> dict[str, Any]:
    """Give what one servo did; times in s."""
    rate = servo.error_rate
    return {
        "family": servo.family.name,
        "id": servo.id,
        "requests": servo.requests,
        "answers": servo.answers,
        "latency_median": None if servo.median is None else round(servo.median, 6),
        "latency_longest": None if servo.worst is None else round(servo.worst, 6),
        "missing": servo.missing,
        "corrupt": servo.corrupt,
        "other": servo.other,
        "error_rate": None if rate is None else round(rate, 6),
    }


def table(tracker: Tracker) -> list[tuple[str, ...]]:
    """Write what each servo did, one row a servo, in the columns of COLUMNS."""
    return [_row(servo) for servo in tracker.servos]


def totals_text(tracker: Tracker) -> str:
    """Say how long the line was watched, and what on it was no good packet."""
    return (
        f"{tracker.time:.1f} s; {_count(tracker.junk, 'byte')} of junk, "
        f"{_count(tracker.corrupt, 'packet')} with a wrong checksum"
        + (f", {tracker.cut_short} cut short" if tracker.cut_short else "")
    )


def _row(servo: ServoTraffic) -> tuple[str, ...]:
    rate = servo.error_rate
    return (
        f"{servo.family.name} {'all' if servo.broadcast else servo.id}",
        str(servo.requests),
        str(servo.answers),
        _milliseconds(servo.median),
        _milliseconds(servo.worst),
        str(servo.missing),
        str(servo.corrupt),
        str(servo.other),
        "" if rate is None else f"{100 * rate:.3g} %",
    )


def _milliseconds(seconds: float | None) -> str:
    return "" if seconds is None else f"{1000 * seconds:.2f} ms"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
