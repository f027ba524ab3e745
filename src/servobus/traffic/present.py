"""Traffic as JSON and as lines of text: event by event, and what it comes to servo by servo. Prints nothing."""

import textwrap
from typing import Any

from servobus.families.base import Family, Model
from servobus.traffic.events import UNASKED, EventKind, ServoTraffic, TrafficEvent
from servobus.traffic.recording import Chunk, Direction
from servobus.traffic.tracker import Tracker

BYTES_PER_LINE = 16
WIDTH = 80
MARGIN = 14
"""Columns of the time, up to 9999 s, and the direction."""
HEX_WIDTH = 3 * BYTES_PER_LINE
COLUMNS = ("servo", "requests", "answers", "median", "longest", "missing", "corrupt", "other", "errors")
"""Headings of `table`."""


def event_entry(event: TrafficEvent, *, timed: bool = True) -> dict[str, Any]:
    """Give one event; times in s, None where they are not known."""
    return {
        "kind": event.kind,
        "time": event.time if timed else None,
        "direction": None if event.direction is Direction.UNKNOWN else event.direction,
        "family": event.family.name if event.family else None,
        "id": event.id,
        "hex": event.raw.hex(" ").upper(),
        "text": event.text,
        "latency": None if event.latency is None else round(event.latency, 6),
        "trouble": event.trouble,
    }


def packet_entries(data: bytes, family: Family | None = None, model: type[Model] | None = None) -> list[dict[str, Any]]:
    """Explain bytes packet by packet, with what is broken or junk between them; `offset` is where each begins.

    Nothing tells when they came and who sent them: an answer without its question is nothing odd here, nor is silence.
    """
    tracker = Tracker(family, model)
    entries: list[dict[str, Any]] = []
    offset = 0
    for event in (*tracker.feed(Chunk(0.0, Direction.UNKNOWN, data)), *tracker.finish()):
        if event.kind is EventKind.SILENCE:
            continue
        entries.append(
            {
                "offset": offset,
                "hex": event.raw.hex(" ").upper(),
                "kind": "packet" if event.kind in (EventKind.REQUEST, EventKind.ANSWER) else event.kind,
                "family": event.family.name if event.family else None,
                "id": event.id,
                "text": event.text.removeprefix(UNASKED),
            }
        )
        offset += len(event.raw)
    return entries


def event_lines(event: TrafficEvent, *, timed: bool = True) -> tuple[list[str], str]:
    """Write one event: lines of hex bytes, the first with the time and the latency, and what they say below."""
    time = f"{event.time:11.6f}" if timed else " " * 11
    head, indent = f"{time} {event.direction} ", " " * MARGIN
    wait = "" if event.latency is None else f"+{_milliseconds(event.latency)}"
    lines = []
    for at in range(0, len(event.raw), BYTES_PER_LINE):
        row = event.raw[at : at + BYTES_PER_LINE].hex(" ").upper()
        lines.append(f"{head}{row:<{HEX_WIDTH}}{wait:>{WIDTH - len(head) - HEX_WIDTH}}".rstrip())
        head, wait = indent, ""
    text = head + event.text
    if len(text) > WIDTH:
        text = textwrap.fill(event.text, WIDTH, initial_indent=head, subsequent_indent=indent, replace_whitespace=False)
    return lines, text


def summary_entry(tracker: Tracker, *, timed: bool = True) -> dict[str, Any]:
    """Give the totals, and what each servo did; times in s."""
    return {
        "kind": "summary",
        "time": round(tracker.time, 6) if timed else None,
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


def totals_text(tracker: Tracker, *, timed: bool = True) -> str:
    """Say how long the line was watched, and what on it was no good packet."""
    return (
        (f"{tracker.time:.1f} s; " if timed else "") + f"{_count(tracker.junk, 'byte')} of junk, "
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
