"""What stands before the bytes of a line: times, numbers, arrows, and words that say who sent them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from servobus.traffic.recording import Direction

OUT_WORDS = {
    "tx", "out", "send", "sent", "sending", "snd", "write", "wrote", "written", "request", "req", "instruction", "inst",
    "command", "cmd", "host", "pc", "master", "controller", "to", "query", "mosi",
}  # fmt: skip
IN_WORDS = {
    "rx", "in", "recv", "receive", "received", "rcvd", "rcv", "read", "reply", "response", "resp", "answer", "answered",
    "status", "servo", "slave", "device", "from", "got", "ack", "miso",
}  # fmt: skip
ARROWS = {
    ">": Direction.OUT, "->": Direction.OUT, "-->": Direction.OUT, ">>": Direction.OUT, ">>>": Direction.OUT,
    "=>": Direction.OUT, "==>": Direction.OUT, "→": Direction.OUT, "⇒": Direction.OUT,
    "<": Direction.IN, "<-": Direction.IN, "<--": Direction.IN, "<<": Direction.IN, "<<<": Direction.IN,
    "<=": Direction.IN, "<==": Direction.IN, "←": Direction.IN, "⇐": Direction.IN,
}  # fmt: skip
ARROW = "|".join(sorted(map(re.escape, ARROWS), key=len, reverse=True))
CLOCK = r"(?:\d{4}-\d\d-\d\d[T ])?(\d{1,2}):(\d\d):(\d\d)(?:(?:[.,]|:(?=\d{3}(?!\d)))(\d+))?(?:Z|[+-]\d\d:?\d\d)?"
TIME_OR_BYTES = re.compile(r"\d{1,2}:\d\d:\d\d:(\d{3})")
"""A time with milliseconds, or four decimal bytes: 12:34:56:100. With something behind it, it is a time."""
SECONDS = r"(\d+\.\d+)\s*(ms|us|µs|s)?"
UNITS = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "s": 1.0, None: 1.0}
DATE = r"(?:\d{4}[-/]\d\d[-/]\d\d|\d{1,2}[./]\d{1,2}[./]\d{4})"
NAME = r"[^\W\d_]\w*"
LEVELS = re.compile(r"(?:debug|info|notice|warn|warning|error|trace|verbose|log)\b[\s:,\]-]*", re.IGNORECASE)
"""Levels of a log, which say nothing of the bytes."""
BYTES_IN_NAME = re.compile(r"(?<!\w)(?:0[xX])?(?:[0-9a-fA-F]{1,2}|\d{3})\s+(?:0[xX])?(?:[0-9a-fA-F]{1,2}|\d{3})(?!\w)")
"""Two bytes in a row, which are no part of a name: `send FF FF 01 -> recv FF FF 02`."""
PLAIN = re.compile(r"[0-9a-fA-FxX\s,;]*")
"""A line of bytes with nothing before them."""


@dataclass(frozen=True, slots=True)
class Label:
    """What a line says of its bytes: when, s, and which way they went. None where it does not say."""

    time: float | None = None
    direction: Direction | None = None


def strip_label(line: str) -> tuple[Label, str]:
    """Give what a line says of its bytes, and the rest of it."""
    if PLAIN.fullmatch(line):
        return Label(), line.strip()
    label, rest = Label(), line.strip()
    while True:
        step = _step(rest)
        if step is None:
            return label, rest
        said, rest = step
        label = replace(
            label,
            time=said.time if label.time is None else label.time,
            direction=label.direction or said.direction,  # of several the first counts: it names who sends
        )


def without_numbers(lines: Sequence[str]) -> list[str]:
    """Leave out the numbers of lines, 1: 2: 3: or 1) 2) 3), where they count up."""
    filled = [n for n, line in enumerate(lines) if line.strip()]
    found = [re.match(r"\s*(\d+)[:.)]\s+(?=\S)", lines[n]) for n in filled]
    numbers = [int(one[1]) for one in found if one is not None]
    if len(filled) < 2 or numbers != list(range(numbers[0] if numbers else 0, (numbers or [0])[0] + len(filled))):
        return list(lines)
    cut = {n: one.end() for n, one in zip(filled, found, strict=True) if one is not None}
    return [line[cut.get(n, 0) :] for n, line in enumerate(lines)]


def _step(text: str) -> tuple[Label, str] | None:
    """Take one thing off the beginning of a line that is no byte."""
    if bracket := re.match(r"[\[(]([^\[\](){}]*)[\])]\s*[:,]?\s*(?=\S)", text):
        rest = text[bracket.end() :]
        said = _bracketed(bracket[1].strip(), rest)
        if said is not None:
            return said, rest
    if (number := re.match(r"#\s*\d+[:.)]?\s+", text)) and "#" not in text[number.end() :]:
        return Label(), text[number.end() :]
    if (clock := re.match(CLOCK + r"(?![\w:])[\s:,;|-]*", text)) and _is_clock(clock, text[clock.end() :]):
        return Label(_seconds(clock)), text[clock.end() :]
    if seconds := re.match(SECONDS + r"(?![\w.])\s*[:,;|]?\s*", text):
        return Label(float(seconds[1]) * UNITS[seconds[2]]), text[seconds.end() :]
    if date := re.match(DATE + r"[\s,]+", text):
        return Label(), text[date.end() :]
    if arrow := re.match(rf"({ARROW})\s*", text):
        return Label(direction=ARROWS[arrow[1]]), text[arrow.end() :]
    if dash := re.match(r"-\s+(?=(?:0[xX])?[0-9a-fA-F]{2}(?!\w)|\d{3}(?!\w))", text):
        return Label(), text[dash.end() :]
    if level := LEVELS.match(text):
        return Label(), text[level.end() :]
    return _named(text)


def _is_clock(clock: re.Match[str], rest: str) -> bool:
    """Tell a time from bytes that colons join, of which there are more then."""
    hour, minute, second, fraction = int(clock[1]), int(clock[2]), int(clock[3]), clock[4]
    if TIME_OR_BYTES.fullmatch(clock[0].rstrip(" \t:,;|-")):
        return bool(rest) and not TIME_OR_BYTES.match(rest)
    if fraction is not None:
        return True
    joined = re.search(r"[0-9a-fA-F]:[0-9a-fA-F]", rest)
    return bool(rest) and not joined and hour < 24 and minute < 60 and second < 60


def _bracketed(inside: str, rest: str) -> Label | None:
    """Read what stands in brackets before bytes: a time, a number or a name. None if it may be bytes itself."""
    if clock := re.fullmatch(CLOCK, inside):
        return Label(_seconds(clock))
    if seconds := re.fullmatch(SECONDS, inside):
        return Label(float(seconds[1]) * UNITS[seconds[2]])
    if re.fullmatch(rf"#?\d+|{DATE}", inside):
        return None if re.match(r"[\[(]\s*[0-9a-fA-F]{1,3}\s*[\])]", rest) else Label()
    if arrow := ARROWS.get(inside):
        return Label(direction=arrow)
    if re.fullmatch(rf"{NAME}[\w\s:#.]*", inside) and not re.fullmatch(r"[0-9a-fA-FxXhH\s]+", inside):
        return Label(direction=direction_of(inside))
    return None


def _named(text: str) -> tuple[Label, str] | None:
    """Read a name before bytes: TX FF FF, Sent packet: FF FF, servo -> PC: FF FF."""
    first = re.match(NAME, text)
    if first is None:
        return None
    if re.fullmatch(r"[0-9a-fA-F]+[hH]?|[xX][0-9a-fA-F]+", first[0]):
        # A: FF FF names a channel; bytes that colons join have more colons.
        channel = re.match(r"[A-Fa-f]:\s+(?=[^:]+$)", text)
        return None if channel is None else (Label(), text[channel.end() :])
    named = re.match(rf"([\w \t#./()\-]{{1,60}}?)\s*(?:(?:\[\d+\])?:|=(?!=)|({ARROW}))\s*(?=\S)", text)
    if named and not BYTES_IN_NAME.search(named[1]):
        direction = direction_of(named[1]) or (ARROWS[named[2]] if named[2] else None)
        return Label(direction=direction), text[named.end() :]
    if (direction := direction_of(first[0])) and (gap := re.match(r"[\s,;|]+(?=\S)", text[first.end() :])):
        return Label(direction=direction), text[first.end() + gap.end() :]
    return None


def names_what_follows(line: str) -> Label | None:
    """Read a line that is nothing but a label, of the bytes on the lines below it; None for other lines."""
    if PLAIN.fullmatch(line):
        return None
    label, rest = strip_label(line)
    named = re.fullmatch(rf"#?\s*({NAME}[\w \t#./()\-]{{0,60}}?)\s*(?::|{ARROW})", rest)
    if named is None or re.fullmatch(r"[0-9a-fA-F\s]+", named[1]) or BYTES_IN_NAME.search(named[1]):
        return None
    return replace(label, direction=label.direction or direction_of(named[1]))


def direction_of(name: str) -> Direction | None:
    """Tell from a name who sends: TX, host, request; RX, servo, answer. None if it does not say."""
    for word in re.findall(rf"{NAME}|{ARROW}", name):
        lower = re.sub(r"\d+$", "", word.lower())
        if lower in OUT_WORDS or lower in IN_WORDS:
            return Direction.OUT if lower in OUT_WORDS else Direction.IN
    return None


def _seconds(clock: re.Match[str]) -> float | None:
    """Give the time of a clock, s since midnight; None if it counts whole seconds, in which many packets fit."""
    if clock[4] is None:
        return None
    return int(clock[1]) * 3600 + int(clock[2]) * 60 + int(clock[3]) + float(f"0.{clock[4]}")
