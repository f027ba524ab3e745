"""Recordings of the traffic on a bus as MCAP, for Foxglove, PlotJuggler and others; an extra: `servobus[mcap]`.

    topic                message (JSON)
    /header              what was recorded, once, at the beginning
    /bytes               {"direction": ">", "hex": "FF FF 01 ..."}
    /speed               {"baud": 1000000}, when the speed of the line changes
    /packets             the packets, explained, with troubles; see `servobus.traffic.present.event_entry`
    /telemetry/SERVO     {"present_position": 0.52, ...}: what was read of a servo, in its units
    /events              {"kind": "alarm", ...}: all other notes
    /end                 {}: up to here the line was watched

`/bytes`, `/speed` and the notes are what a recording as text has (servobus.traffic.recording); `/packets` follows from
them. Each message is in the file at once, so a file that was cut off is read up to its last message.
"""

import io
import json
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Self

from servobus.core.extras import library
from servobus.errors import ServobusError, UsageError
from servobus.traffic.present import event_entry
from servobus.traffic.recording import (
    Chunk,
    Direction,
    Header,
    Line,
    Note,
    Recording,
    Speed,
    TapEnd,
    header_of,
)
from servobus.traffic.tracker import Tracker

MAGIC = b"\x89MCAP0\r\n"
SUFFIX = ".mcap"
TELEMETRY = "telemetry"
"""Kind of the notes that hold what was read of a servo: {"servo": ..., "values": {register: value}}."""
NEEDS = "recordings in MCAP need"
TYPES = {bool: "boolean", int: "number", float: "number", str: "string"}


class McapRecording:
    """A recording that is being written as MCAP; as `RecordingFile`, which writes text.

    Raises UsageError for a file that is there already, and where the library is missing.
    """

    def __init__(
        self, path: Path, header: Header, on_failure: Callable[[ServobusError], object] = lambda _: None
    ) -> None:
        writer = library("mcap.writer", "mcap", NEEDS)
        self.failure: ServobusError | None = None
        self._path, self._on_failure = path, on_failure
        try:
            self._file = path.open("xb")
        except FileExistsError:
            raise UsageError(f"{path} exists already and is not replaced; choose another name") from None
        self._writer = writer.Writer(self._file, use_chunking=False)
        self._channels: dict[str, int] = {}
        self._tracker = Tracker(baud=header.baud)
        self._began = _nanoseconds(header.started)
        self._carefully(self._writer.start, library="servobus")
        self._put(0.0, "/header", asdict(header))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, entry: Line) -> None:
        """Append an entry, and the packets that it completes."""
        match entry:
            case Chunk():
                self._put(entry.time, "/bytes", {"direction": entry.direction, "hex": entry.data.hex(" ").upper()})
            case Speed():
                self._put(entry.time, "/speed", {"baud": entry.baud})
            case TapEnd():
                self._put(entry.time, "/end", {})
            case Note() if entry.kind == TELEMETRY:
                self._put(entry.time, f"/telemetry/{entry.data['servo']}", entry.data["values"])
            case Note():
                self._put(entry.time, "/events", {"kind": entry.kind, **entry.data})
        if not isinstance(entry, Note):
            for event in self._tracker.feed(entry):
                self._put(event.time, "/packets", event_entry(event))

    def close(self) -> None:
        """End the file, with its index."""
        for event in self._tracker.finish():
            self._put(event.time, "/packets", event_entry(event))
        self._carefully(self._writer.finish)
        with suppress(OSError):  # what could not be written was told
            self._file.close()

    def _put(self, seconds: float, topic: str, message: Mapping[str, Any]) -> None:
        def put() -> None:
            channel = self._channels.get(topic)
            if channel is None:
                schema = self._writer.register_schema(topic.strip("/"), "jsonschema", _schema(message))
                channel = self._channels[topic] = self._writer.register_channel(topic, "json", schema)
            when = self._began + round(seconds * 1e9)
            self._writer.add_message(channel, when, json.dumps(message).encode(), when)
            self._file.flush()

        self._carefully(put)

    def _carefully(self, work: Callable[..., object], **arguments: Any) -> None:
        """Write; where that fails the recording ends there, and nothing else does."""
        if self.failure is not None:
            return
        try:
            work(**arguments)
        except OSError as error:
            why = error.strerror or str(error)
            self.failure = ServobusError(f"{self._path}: {why}; the recording ends early, and can be read up to there")
            self._on_failure(self.failure)


def _nanoseconds(started: str) -> int:
    """Give the time at which a recording began, in ns since 1970; 0 where it is not known."""
    try:
        return round(datetime.fromisoformat(started).timestamp() * 1e6) * 1000
    except ValueError:
        return 0


def _schema(message: Mapping[str, Any]) -> bytes:
    """Describe a message by its first example: Foxglove wants a schema, and values may be missing later."""
    properties = {name: {"type": TYPES[type(value)]} if type(value) in TYPES else {} for name, value in message.items()}
    return json.dumps({"type": "object", "properties": properties}).encode()


def is_mcap(content: bytes) -> bool:
    """Tell an MCAP file from other files."""
    return content.startswith(MAGIC)


@dataclass(frozen=True, slots=True)
class McapMessage:
    """One message of an MCAP file. `time` is in ns of the writer's clock, `data` what its JSON says."""

    topic: str
    time: int
    data: Any


def mcap_messages(content: bytes) -> tuple[list[McapMessage], bool]:
    """Give the messages of an MCAP file up to where it ends, or was cut off; and whether it was.

    Raises UsageError for a file that is no MCAP, or whose messages are not JSON, and where the library is missing.
    """
    reader, exceptions = (library(f"mcap.{module}", "mcap", NEEDS) for module in ("reader", "exceptions"))
    found: list[McapMessage] = []
    try:
        for _, channel, message in reader.NonSeekingReader(io.BytesIO(content)).iter_messages(log_time_order=False):
            found.append(McapMessage(channel.topic, message.log_time, json.loads(message.data)))
    except (exceptions.EndOfFile, struct.error):
        return found, True
    except (exceptions.McapError, ValueError, KeyError) as error:
        raise UsageError(f"this MCAP file cannot be read: {error}") from None
    return found, False


def parse_mcap(content: bytes) -> Recording:
    """Read a recording. Raises UsageError for a file that is none of servobus, and where the library is missing."""
    messages, cut = mcap_messages(content)
    first = next((message for message in messages if message.topic == "/header"), None)
    if first is None:
        raise UsageError("this MCAP file is no recording of the traffic on a bus: it has no topic /header")
    try:
        header = header_of(first.data)
        lines = [line for one in messages for line in _lines((one.time - first.time) / 1e9, one.topic, one.data)]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"this MCAP file is no recording of servobus: {error}") from None
    return Recording(header, tuple(lines), cut)


def _lines(seconds: float, topic: str, data: dict[str, Any]) -> Iterator[Line]:
    if topic == "/bytes":
        yield Chunk(seconds, Direction(data["direction"]), bytes.fromhex(data["hex"]))
    elif topic == "/speed":
        yield Speed(seconds, int(data["baud"]))
    elif topic == "/end":
        yield TapEnd(seconds)
    elif topic == "/events":
        yield Note(seconds, str(data.pop("kind")), data)
    elif topic.startswith("/telemetry/"):
        yield Note(seconds, TELEMETRY, {"servo": topic.removeprefix("/telemetry/"), "values": data})
