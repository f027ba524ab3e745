"""Recordings of a robot under way: where its joints were at each turn, and where they were sent.

A recording is CSV, angles in degrees of the joint, a cell empty where a joint did not answer; or MCAP, for Foxglove and
other programs (an extra: `pip install "servobus[mcap]"`), angles in rad.

    time,shoulder,elbow,goal.shoulder,goal.elbow
    0.000,0.1,-45.2,0.0,-45.0
    0.010,,-45.2,0.0,-45.0

Each line is in the file at once, so a recording survives whatever ends the program.
"""

import csv
import json
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from servobus.core.extras import library
from servobus.core.units import deg, finite
from servobus.core.values import frozen
from servobus.errors import UsageError
from servobus.traffic.mcap_recording import mcap_messages

TIME, GOAL = "time", "goal."
"""Heading of the first column, and beginning of the headings of goals; no name of a joint has a dot."""
CSV, MCAP = ".csv", ".mcap"
TOPIC = "/joints"
"""Channel of an MCAP recording."""


@frozen
class Moment:
    """One turn of a recording.

    time       s since the first
    positions  joint -> angle, rad; joints that did not answer are missing
    goals      joint -> where it was sent, rad
    """

    time: float
    positions: Mapping[str, float]
    goals: Mapping[str, float]


class Recorder(ABC):
    """Writes a recording, in a `with`. A file that is there already is never replaced."""

    @abstractmethod
    def write(self, moment: Moment) -> None:
        """Add a turn. Raises UsageError if the file cannot be written any more."""

    @abstractmethod
    def close(self) -> None:
        """End the file."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def recorder(path: Path, joints: Sequence[str], goals: Sequence[str] = ()) -> Recorder:
    """Begin a recording of these joints, and of the goals of these.

    Raises UsageError if the name ends in neither .csv nor .mcap, if there is such a file, and for MCAP if its library
    is not installed.
    """
    if path.suffix.lower() == CSV:
        return CsvRecorder(path, joints, goals)
    if path.suffix.lower() == MCAP:
        return McapRecorder(path, joints, goals)
    raise UsageError(f"{path}: the name of a recording ends in {CSV} or {MCAP}")


class CsvRecorder(Recorder):
    """A recording as CSV; see the head of this module."""

    def __init__(self, path: Path, joints: Sequence[str], goals: Sequence[str] = ()) -> None:
        self._path, self._joints, self._goals = path, list(joints), list(goals)
        self._file = _new(path)
        self._write([TIME, *self._joints, *(f"{GOAL}{joint}" for joint in self._goals)])

    def write(self, moment: Moment) -> None:
        angles = [moment.positions.get(joint) for joint in self._joints]
        angles += [moment.goals.get(joint) for joint in self._goals]
        self._write([f"{moment.time:.4f}", *("" if angle is None else f"{angle / deg:.3f}" for angle in angles)])

    def close(self) -> None:
        with suppress(OSError):  # all lines are written
            self._file.close()

    def _write(self, cells: Sequence[str]) -> None:
        _put(self._file, self._path, (",".join(cells) + "\n").encode())


class McapRecorder(Recorder):
    """A recording as MCAP: one channel of JSON, whose schema says what stands in it."""

    def __init__(self, path: Path, joints: Sequence[str], goals: Sequence[str] = ()) -> None:
        writer = library("mcap.writer", "mcap", "recordings in CSV need nothing, those in MCAP need")
        self._path = path
        self._file = _new(path)
        # Without chunks each message is in the file at once, and can be read although the end of the file is missing.
        self._writer = writer.Writer(self._file, use_chunking=False)
        self._writer.start(library="servobus")
        schema = self._writer.register_schema(
            "servobus.Joints", "jsonschema", json.dumps(_schema(joints, goals)).encode()
        )
        self._channel = self._writer.register_channel(TOPIC, "json", schema)
        self._began = time.time_ns()

    def write(self, moment: Moment) -> None:
        data = {TIME: moment.time, "positions": dict(moment.positions), "goals": dict(moment.goals)}
        when = self._began + round(moment.time * 1e9)
        try:
            self._writer.add_message(self._channel, when, json.dumps(data).encode(), when)
            self._file.flush()
        except OSError as error:
            raise _cannot_write(self._path, error) from None

    def close(self) -> None:
        with suppress(OSError):
            self._writer.finish()
            self._file.close()


def _schema(joints: Sequence[str], goals: Sequence[str]) -> dict[str, Any]:
    def angles(names: Sequence[str], about: str) -> dict[str, Any]:
        return {"type": "object", "description": about, "properties": {name: {"type": "number"} for name in names}}

    return {
        "type": "object",
        "properties": {
            TIME: {"type": "number", "description": "s since the first turn"},
            "positions": angles(joints, "angle of each joint that answered, rad"),
            "goals": angles(goals, "where each joint was sent, rad"),
        },
    }


def _new(path: Path) -> Any:
    try:
        return path.open("xb")
    except FileExistsError:
        raise UsageError(f"{path} exists already and is not replaced; choose another name") from None
    except OSError as error:
        raise _cannot_write(path, error) from None


def _put(file: Any, path: Path, data: bytes) -> None:
    try:
        file.write(data)
        file.flush()
    except OSError as error:
        raise _cannot_write(path, error) from None


def _cannot_write(path: Path, error: OSError) -> UsageError:
    return UsageError(f"{path}: cannot be written: {error.strerror or error}")


# Reading


def read_recording(path: Path) -> list[Moment]:
    """Read a recording, also one that was broken off: its last line is left out where it has no end.

    A table of samples of a motion is one too. Raises UsageError with file, line and remedy.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror or error}") from None
    moments = list(_mcap_moments(path, data) if path.suffix.lower() == MCAP else _csv_moments(path, data))
    if not moments:
        raise UsageError(f"{path}: nothing was recorded")
    for before, after in pairwise(moments):
        if not after.time > before.time:
            raise UsageError(f"{path}: the time {after.time:g} s comes after {before.time:g} s; sort the recording")
    return moments


def _csv_moments(path: Path, data: bytes) -> Iterator[Moment]:
    try:
        whole = data[: data.rfind(b"\n") + 1].decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: cannot be read as text: {error}") from None
    rows = csv.reader(whole.splitlines())
    heads = [cell.strip() for cell in next(rows, [])]
    if heads[:1] != [TIME] or len(heads) < 2 or len(set(heads)) < len(heads):
        raise UsageError(f"{path}:1: the first line names the columns, each once, such as {TIME},shoulder,elbow")
    for line, row in enumerate(rows, 2):
        if not row:
            continue
        try:
            cells = [float(cell) if cell.strip() else None for cell in row]
        except ValueError as error:
            raise UsageError(f"{path}:{line}: {error}; write the time in s, then angles in degrees") from None
        moment, *angles = cells
        if moment is None or len(cells) != len(heads) or not all(cell is None or math.isfinite(cell) for cell in cells):
            raise UsageError(f"{path}:{line}: write the time and {len(heads) - 1} angles, or nothing for a lost one")
        named = {head: angle * deg for head, angle in zip(heads[1:], angles, strict=True) if angle is not None}
        yield Moment(
            moment,
            {head: angle for head, angle in named.items() if not head.startswith(GOAL)},
            {head.removeprefix(GOAL): angle for head, angle in named.items() if head.startswith(GOAL)},
        )


def _mcap_moments(path: Path, data: bytes) -> Iterator[Moment]:
    try:
        for message in mcap_messages(data)[0]:
            if message.topic != TOPIC:
                continue
            entry = message.data
            if finite(entry[TIME]) is None:
                raise UsageError(f"{path}: {entry[TIME]!r} is no time")
            yield Moment(float(entry[TIME]), _angles(path, entry["positions"]), _angles(path, entry["goals"]))
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{path}: this is no recording of servobus: {error}") from None


def _angles(path: Path, entry: Mapping[str, Any]) -> dict[str, float]:
    angles = {joint: finite(angle) for joint, angle in entry.items()}
    if wrong := [joint for joint, angle in angles.items() if angle is None]:
        raise UsageError(f"{path}: {wrong[0]}: {entry[wrong[0]]!r} is no angle")
    return {joint: angle for joint, angle in angles.items() if angle is not None}
