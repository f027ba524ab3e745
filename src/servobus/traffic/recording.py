"""Recordings of the traffic on a bus: a text file that is written line by line and readable up to its last line.

    # servobus recording 1 {"port": "/dev/ttyUSB0", "baud": 57600, "family": null, "model": null, "started": "..."}
    0.001042 > FF FF 01 04 02 24 02 D2          bytes to the servos
    0.002314 < FF FF 01 04 00 00 02 F8          bytes from the servos
    0.512000 - FF FF 01 02 01 FB                bytes that were heard; from where is not known
    1.204310 = 1000000                          from here on the speed is another
    1.310000 ! {"kind": "alarm", "id": 1, ...}   a note: what else happened, or was read, as JSON
    9.730125 .                                  the end: up to here the line was watched

Times are seconds since the beginning. A line without a line end was cut off when the power or the program went; it
is left out. No port, no clock. The values of the lines are those that a tap tells (servobus.transports.tap).
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self, TypeAlias

from servobus.errors import ServobusError, UsageError
from servobus.transports.tap import DIGITS, Chunk, Direction, Entry, Speed, TapEnd

MAGIC = "# servobus recording "
FORMAT = 1


@dataclass(frozen=True, slots=True)
class Note:
    """What else happened, or was read, at a time in s: an event, values of servos, who asked. `data` is JSON."""

    time: float
    kind: str
    data: Mapping[str, Any]

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", round(self.time, DIGITS))


Line: TypeAlias = Entry | Note
"""What one line of a recording says."""


@dataclass(frozen=True, slots=True)
class Header:
    """What was recorded. `family` and `model` are None where they were not given but found out."""

    port: str
    baud: int
    family: str | None = None
    model: str | None = None
    started: str = ""
    """Date and time of the beginning, ISO 8601."""

    def line(self) -> str:
        return f"{MAGIC}{FORMAT} {json.dumps(asdict(self))}\n"


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording that was read back; `cut` tells whether its last line was cut off."""

    header: Header
    lines: tuple[Line, ...]
    cut: bool = False

    @property
    def entries(self) -> tuple[Entry, ...]:
        """What the line carried, without notes."""
        return tuple(line for line in self.lines if not isinstance(line, Note))


class RecordingFile:
    """A recording that is being written. No buffer holds entries back: what was told is there, whatever happens.

    Raises UsageError for a file that is there already. If the disk is full or the file gone, the recording ends there
    and nothing else does: `failure` says why, and `on_failure` is told once.
    """

    def __init__(
        self, path: Path, header: Header, on_failure: Callable[[ServobusError], object] = lambda _: None
    ) -> None:
        self.failure: ServobusError | None = None
        self._path, self._on_failure = path, on_failure
        try:
            self._file = path.open("xb", buffering=0)
        except FileExistsError:
            raise UsageError(f"{path} exists already and is not replaced; choose another name") from None
        self._write(header.line())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, entry: Line) -> None:
        """Append an entry."""
        self._write(line(entry))

    def close(self) -> None:
        self._file.close()

    def _write(self, text: str) -> None:
        if self.failure is not None:
            return
        data = text.encode("ascii")
        try:
            why = "the disk is full" if (self._file.write(data) or 0) < len(data) else ""
        except OSError as error:
            why = error.strerror or str(error)
        if why:
            self.failure = ServobusError(f"{self._path}: {why}; the recording ends early, and can be read up to there")
            self._on_failure(self.failure)


def line(entry: Line) -> str:
    """Give the line of an entry, with its end."""
    match entry:
        case Chunk():
            said = f"{entry.direction} {entry.data.hex(' ').upper()}"
        case Speed():
            said = f"= {entry.baud}"
        case Note():
            said = f"! {json.dumps({'kind': entry.kind, **entry.data})}"
        case TapEnd():
            said = "."
    return f"{entry.time:.{DIGITS}f} {said}\n"


def is_recording(content: bytes) -> bool:
    """Tell a recording from other files."""
    return content.startswith(MAGIC.encode())


def parse(content: bytes) -> Recording:
    """Read a recording. Raises UsageError for a line that is none, and for a format of later versions."""
    # After a power cut a file may have got its new length, but not yet the bytes.
    lines = content.rstrip(b"\0").decode("ascii", errors="replace").split("\n")
    rest = lines.pop()
    cut = bool(rest) or content.endswith(b"\0")
    if not lines:
        raise UsageError("the recording was cut off in its first line; there is nothing in it")
    return Recording(_header(lines[0]), tuple(_entries(lines[1:])), cut)


def _header(text: str) -> Header:
    number, _, fields = text.removeprefix(MAGIC).partition(" ")
    if number != str(FORMAT):
        raise UsageError(f"recording format {number!r} is not known here, only {FORMAT}; a newer servobus wrote it?")
    try:
        said = json.loads(fields)
    except ValueError as error:
        raise UsageError(f"line 1 is no head of a recording: {fields[:60]!r}") from error
    try:
        return header_of(said)
    except (ValueError, TypeError) as error:
        raise UsageError(f"line 1 is no head of a recording: {error}") from error


def header_of(said: Mapping[str, Any]) -> Header:
    """Make the header of what a file says. Raises ValueError or TypeError for what is none."""
    header = Header(**{name: said[name] for name in Header.__dataclass_fields__ if name in said})
    for name in Header.__dataclass_fields__:
        if not _is_right(name, value := getattr(header, name)):
            raise ValueError(f"{name} is {value!r}")
    return header


def _is_right(name: str, value: Any) -> bool:
    if name == "baud":
        return isinstance(value, int) and value > 0
    return isinstance(value, str) or (value is None and name in ("family", "model"))


def _entries(lines: Iterable[str]) -> Iterator[Line]:
    last = 0.0
    for number, text in enumerate(lines, 2):
        try:
            time, _, said = text.rstrip("\r").partition(" ")
            entry = _entry(float(time), *said.partition(" ")[::2])
        except (ValueError, OverflowError, KeyError, AttributeError, TypeError) as error:
            raise UsageError(f"line {number} is no line of a recording: {text[:60]!r}") from error
        if not last <= entry.time:
            raise UsageError(f"line {number}: {entry.time:.{DIGITS}f} s is before the line above it")
        last = entry.time
        yield entry


def _entry(time: float, mark: str, what: str) -> Line:
    if not math.isfinite(time):
        raise ValueError("no time")
    if mark == "." and not what:
        return TapEnd(time)
    if mark == "!":
        data = json.loads(what)
        return Note(time, str(data.pop("kind")), data)
    if mark == "=":
        if (baud := int(what)) <= 0:
            raise ValueError("no speed")
        return Speed(time, baud)
    if not (carried := bytes.fromhex(what)):
        raise ValueError("no bytes")
    return Chunk(time, Direction(mark), carried)


__all__ = [
    "DIGITS",
    "FORMAT",
    "MAGIC",
    "Chunk",
    "Direction",
    "Entry",
    "Header",
    "Line",
    "Note",
    "Recording",
    "RecordingFile",
    "Speed",
    "TapEnd",
    "header_of",
    "is_recording",
    "line",
    "parse",
]
