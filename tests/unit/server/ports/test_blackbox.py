"""The last minute of a port: bounded in time and size, and a recording like any other when it is saved."""

import asyncio
from pathlib import Path

import pytest

from servobus.errors import ServobusError
from servobus.server.ports.blackbox import BlackBox
from servobus.traffic.recording import Chunk, Direction, Header, Note, Speed, TapEnd, parse

HEADER = Header("/dev/ttyUSB0", 57_600)


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def box(**bounds: float) -> tuple[BlackBox, Clock]:
    clock = Clock()
    return BlackBox(HEADER, clock, **bounds), clock  # type: ignore[arg-type] # seconds and most


def test_the_window_begins_at_0_and_ends_now() -> None:
    kept, clock = box()
    for second in range(100):
        clock.now = float(second)
        kept.add(Chunk(clock.now, Direction.OUT, bytes([second])))
    clock.now = 100.0
    header, lines = kept.window()
    assert header.port == HEADER.port
    assert header.started
    assert lines[0] == Chunk(0.0, Direction.OUT, bytes([39]))  # 60 s before the last
    assert lines[-2] == Chunk(60.0, Direction.OUT, bytes([99]))
    assert lines[-1] == TapEnd(61.0)


def test_a_speed_that_is_too_old_to_be_kept_is_that_of_the_beginning() -> None:
    kept, clock = box(seconds=10)
    kept.add(Speed(0.0, 1_000_000))
    clock.now = 20.0
    kept.add(Chunk(20.0, Direction.OUT, b"\x01"))
    header, lines = kept.window()
    assert header.baud == 1_000_000
    assert lines == [Chunk(0.0, Direction.OUT, b"\x01"), TapEnd(0.0)]


def test_the_size_is_bounded_and_the_newest_stays() -> None:
    kept, _ = box(most=100_000)
    for n in range(10_000):
        kept.add(Chunk(n * 1e-3, Direction.IN, bytes(100)))
    assert 200 < len(kept) < 1_000
    _, lines = kept.window()
    assert isinstance(lines[-2], Chunk)


def test_one_that_is_larger_than_all_that_may_be_kept_does_no_harm() -> None:
    kept, _ = box(most=100)
    kept.add(Chunk(1.0, Direction.IN, bytes(1000)))
    assert len(kept) == 0
    assert kept.window()[1] == [TapEnd(0.0)]


def test_what_is_saved_is_a_recording(tmp_path: Path) -> None:
    kept, clock = box()
    clock.now = 5.0
    kept.add(Chunk(5.0, Direction.OUT, b"\xff\xff"))
    clock.now = 6.0
    kept.note("alarm", {"servo": "dynamixel:1@57600", "text": "overheating"})

    async def save() -> list[Path]:
        return [await kept.save(tmp_path / "boxes", "arm/left", "alarm: overheating!") for _ in range(2)]

    first, second = asyncio.run(save())
    assert first != second
    assert first.name.endswith("arm-left-alarm-overheating.rec")
    recording = parse(first.read_bytes())
    assert recording.lines[:2] == (
        Chunk(0.0, Direction.OUT, b"\xff\xff"),
        Note(1.0, "alarm", {"servo": "dynamixel:1@57600", "text": "overheating"}),
    )
    assert not recording.cut


def test_a_folder_that_cannot_be_written_is_an_error_that_names_it(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    kept, _ = box()
    with pytest.raises(ServobusError, match=r"file: cannot be written"):
        asyncio.run(kept.save(tmp_path / "file", "arm", "asked"))
