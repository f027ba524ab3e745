"""Recordings as MCAP: the same as a recording as text, whatever was recorded, and wherever the file was cut off."""

import errno
import io
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servobus.errors import ServobusError, UsageError
from servobus.traffic.mcap_recording import McapRecording, is_mcap, parse_mcap
from servobus.traffic.recording import (
    Chunk,
    Direction,
    Header,
    Line,
    Note,
    RecordingFile,
    Speed,
    TapEnd,
    is_recording,
    parse,
)

reader = pytest.importorskip("mcap.reader")

HEADER = Header("/dev/ttyUSB0", 57_600, started="2026-11-28T10:00:00+00:00")
PING = bytes.fromhex("FFFF010201FB")  # RX-28 manual 3-4: PING of id 1
STATUS = bytes.fromhex("FFFF010200FC")  # RX-28 manual 3-4: its answer

values = st.dictionaries(st.sampled_from(["a", "b"]), st.floats(allow_nan=False) | st.integers(-9, 9) | st.text())
lines = st.lists(
    st.one_of(
        st.builds(Chunk, st.just(0.0), st.sampled_from(Direction), st.binary(min_size=1, max_size=20)),
        st.builds(Speed, st.just(0.0), st.sampled_from([9_600, 1_000_000])),
        st.builds(Note, st.just(0.0), st.sampled_from(["alarm", "asked"]), values),
        st.builds(
            lambda read: Note(0.0, "telemetry", {"servo": "dynamixel:1@57600", "values": read}),
            values,
        ),
    )
)


def spaced(script: list[Line]) -> list[Line]:
    """Give the same entries, 1 ms apart, with an end."""
    return [*(replace(line, time=n / 1000) for n, line in enumerate(script)), TapEnd(len(script) / 1000)]


def written(kind: Any, path: Path, script: list[Line]) -> bytes:
    path.unlink(missing_ok=True)
    with kind(path, HEADER) as file:
        for line in script:
            file.write(line)
    return path.read_bytes()


@given(script=lines)
@settings(max_examples=40)
def test_both_formats_say_the_same(tmp_path_factory: pytest.TempPathFactory, script: list[Line]) -> None:
    folder, whole = tmp_path_factory.getbasetemp(), spaced(script)
    text = parse(written(RecordingFile, folder / "a.rec", whole))
    mcap = parse_mcap(written(McapRecording, folder / "a.mcap", whole))
    assert text.header == mcap.header == HEADER
    assert list(text.lines) == list(mcap.lines) == whole
    assert not text.cut
    assert not mcap.cut


def test_a_file_that_was_cut_off_anywhere_is_read_up_to_there(tmp_path: Path) -> None:
    whole = spaced([Chunk(0.0, Direction.OUT, PING), Chunk(0.0, Direction.IN, STATUS), Note(0.0, "alarm", {"id": 1})])
    content = written(McapRecording, tmp_path / "a.mcap", whole)
    complete = list(parse_mcap(content).lines)
    seen = set()
    for size in range(len(content)):
        try:
            recording = parse_mcap(content[:size])
        except UsageError:
            continue  # not even the header is there
        assert list(recording.lines) == complete[: len(recording.lines)]
        seen.add(len(recording.lines))
    assert seen == {0, 1, 2, 3, 4}


def test_other_programs_find_packets_telemetry_and_schemas(tmp_path: Path) -> None:
    told = Note(0.0, "telemetry", {"servo": "dynamixel:1@57600", "values": {"present_position": 0.5}})
    whole = spaced([Chunk(0.0, Direction.OUT, PING), Chunk(0.0, Direction.IN, STATUS), told])
    content = written(McapRecording, tmp_path / "a.mcap", whole)
    found: dict[str, list[Any]] = {}
    for schema, channel, message in reader.make_reader(io.BytesIO(content)).iter_messages():
        assert channel.message_encoding == "json"
        assert schema.encoding == "jsonschema"
        assert json.loads(schema.data)["type"] == "object"
        found.setdefault(channel.topic, []).append(json.loads(message.data))
    assert found["/telemetry/dynamixel:1@57600"] == [{"present_position": 0.5}]
    assert [packet["kind"] for packet in found["/packets"]] == ["request", "answer"]
    assert found["/packets"][0]["text"].startswith("PING")


def test_files_are_told_apart(tmp_path: Path) -> None:
    mcap, text = written(McapRecording, tmp_path / "a.mcap", []), written(RecordingFile, tmp_path / "a.rec", [])
    assert is_mcap(mcap)
    assert not is_recording(mcap)
    assert is_recording(text)
    assert not is_mcap(text)
    with pytest.raises(UsageError, match="exists already and is not replaced"):
        McapRecording(tmp_path / "a.mcap", HEADER)


def test_mcap_of_another_program_is_refused(tmp_path: Path) -> None:
    writer = pytest.importorskip("mcap.writer")
    with (tmp_path / "other.mcap").open("wb") as stream:
        other = writer.Writer(stream)
        other.start()
        schema = other.register_schema("x", "jsonschema", b"{}")
        other.add_message(other.register_channel("/imu", "json", schema), 0, b"{}", 0)
        other.finish()
    with pytest.raises(UsageError, match="it has no topic /header"):
        parse_mcap((tmp_path / "other.mcap").read_bytes())


class FullDisk(io.BytesIO):
    """A file on a disk with room for so many bytes."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self.room = room

    def write(self, data: Any) -> int:
        if self.tell() + len(data) > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)

    def close(self) -> None:
        """Keep what was written, to be looked at."""


@pytest.mark.parametrize("room", [2_000, 20_000])
def test_a_full_disk_ends_the_recording_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    disk = FullDisk(room)
    monkeypatch.setattr(Path, "open", lambda *_: disk)
    told: list[ServobusError] = []
    with McapRecording(tmp_path / "a.mcap", HEADER, told.append) as file:
        for n in range(1_000):
            file.write(Note(n / 100, "alarm", {"id": n}))
    assert [str(one) for one in told] == [str(file.failure)]
    assert "No space left" in str(file.failure)
    kept = parse_mcap(disk.getvalue()).lines
    assert len(kept) > 3
    assert [line.data["id"] for line in kept if isinstance(line, Note)] == list(range(len(kept)))
