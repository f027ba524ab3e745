"""A tap changes nothing and tells everything; what it told can be played back."""

import asyncio
import os
import sys
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from servobus import RX28, Bus, NoReply
from servobus.bus.asyncio import AsyncBus
from servobus.connect import transport
from servobus.errors import ServobusError, UsageError
from servobus.traffic.recording import Header, RecordingFile, parse
from servobus.transports.base import Transport
from servobus.transports.serial_port import SerialPort
from servobus.transports.tap import Chunk, Direction, Entry, ReplayTransport, Speed, TapEnd, TapTransport
from servobus.virtual.serve.inprocess import connect

PING = bytes.fromhex("FF FF 01 02 01 FB")
PONG = bytes.fromhex("FF FF 01 02 00 FC")
SERVOS = "virtual:rx28@1-2,lx16a@3?clock=virtual"
needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo terminals on Windows")


@pytest.fixture
def ends() -> Iterator[tuple[int, SerialPort]]:
    """Give the far end of a terminal, and the port that is open on its near end."""
    far, near = os.openpty()
    tty.setraw(near)
    port = SerialPort(os.ttyname(near), 57_600)
    yield far, port
    port.close()
    os.close(far)
    os.close(near)


def session(port: Transport) -> list[object]:
    """Do what a program does: look around, read, move, meet an id that nobody has."""
    results: list[object] = []
    with Bus(port) as bus:
        results += [str(servo) for servo in bus.scan(ids=range(1, 5))]
        results.append(bus.read_all("present_position").by_id())
        servo = bus.find(1, family="dynamixel")
        servo.torque_on()
        servo.move(1.0, time=0.2).wait()
        results.append(servo.read(RX28.present_position))
        with pytest.raises(NoReply):
            bus.do(servo.family.ping(9))
    return results


def test_a_session_is_told_and_played_back() -> None:
    told: list[Entry] = []
    untapped = session(connect(SERVOS))
    assert session(TapTransport(connect(SERVOS), told.append)) == untapped
    replay = ReplayTransport(told)
    assert session(replay) == untapped
    assert replay.finished
    assert {type(entry) for entry in told} == {Chunk, Speed}
    assert [entry.time for entry in told] == sorted(entry.time for entry in told)


def test_a_recording_is_a_file_and_plays_back_from_it(tmp_path: Path) -> None:
    path = tmp_path / "arm.rec"
    with RecordingFile(path, Header(SERVOS, 115_200)) as file:
        tap = TapTransport(connect(SERVOS), file.write)
        done = session(tap)
        file.write(TapEnd(tap.elapsed()))
    recording = parse(path.read_bytes())
    assert not recording.cut
    assert isinstance(recording.entries[-1], TapEnd)
    assert session(ReplayTransport(recording.entries)) == done
    with pytest.raises(UsageError, match="exists already"):
        RecordingFile(path, Header(SERVOS, 115_200))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a disk that is always full")
def test_a_full_disk_ends_the_recording_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[ServobusError] = []
    file = RecordingFile(tmp_path / "arm.rec", Header("port", 57_600), told.append)
    assert file.failure is None
    file.close()
    with Path("/dev/full").open("wb", buffering=0) as full:
        monkeypatch.setattr(file, "_file", full)
        for _ in range(2):
            file.write(Chunk(1.0, Direction.OUT, PING))
    assert told == [file.failure]
    assert "the recording ends early" in str(told[0])


class TestTap:
    def test_times_and_directions(self) -> None:
        port = connect("virtual:rx28@1?clock=virtual&answer_time=off")
        port.set_baud(57_600)
        port.sleep(5.0)  # the clock of a tap begins when it is made
        told: list[Entry] = []
        tap = TapTransport(port, told.append)
        tap.write(PING)
        assert tap.read(0.1) == PONG
        assert tap.read(0.01) == b""
        tap.set_baud(57_600)  # nothing new
        tap.set_baud(1_000_000)
        request, answer, speed = told
        assert request == Chunk(0.0, Direction.OUT, PING)
        # Twelve bytes of 10 bits at 57600 baud are 2.08 ms, and the servo waits 0.5 ms (RX-28 manual 3-4-1).
        assert answer == Chunk(answer.time, Direction.IN, PONG)
        assert answer.time == pytest.approx(0.00258, abs=5e-5)
        assert speed == Speed(answer.time + 0.01, 1_000_000)

    def test_what_is_discarded_is_told_too(self) -> None:
        told: list[Entry] = []
        tap = TapTransport(connect("virtual:rx28@1?clock=virtual&baud=57600"), told.append, heard=Direction.UNKNOWN)
        tap.set_baud(57_600)
        tap.write(PING)
        tap.sleep(0.1)
        assert tap.discard() == PONG
        assert [entry.direction for entry in told if isinstance(entry, Chunk)] == [Direction.OUT, Direction.UNKNOWN]

    def test_it_has_what_the_transport_has(self) -> None:
        inner = connect("virtual:rx28@1?clock=virtual")
        tap = TapTransport(inner, lambda _: None)
        assert (tap.name, tap.timed, tap.blocking(), tap.fileno()) == (inner.name, True, False, None)
        tap.latency = 0.2  # settings reach it
        assert inner.latency == 0.2
        assert tap.rig is inner.rig
        assert not hasattr(tap, "low_latency")

    @needs_pty
    def test_the_fast_path_stays(self, ends: tuple[int, SerialPort]) -> None:
        far, port = ends
        tap = TapTransport(port, lambda _: None)
        assert tap.fileno() == port.fileno()
        assert not tap.pending()
        os.write(far, b"\x00")
        end = time.monotonic() + 5
        while not tap.pending():
            assert time.monotonic() < end
        assert tap.read(1) == b"\x00"

    @needs_pty
    def test_both_drivers_work_through_it(self, tmp_path: Path) -> None:
        from servobus.virtual.serve.ports import PtyPort  # noqa: PLC0415
        from servobus.virtual.serve.rig import build_rig  # noqa: PLC0415
        from servobus.virtual.serve.spec import parse_url  # noqa: PLC0415
        from unit.served import served  # noqa: PLC0415 - there is none on Windows

        async def ask(port: Transport) -> float:
            async with AsyncBus(port) as bus:
                servo = await bus.find(1, family="dynamixel")
                heat: float = await servo.read(RX28.present_temperature)
                return heat

        told: list[Entry] = []
        with served(PtyPort(build_rig(parse_url("rx28@1")), tmp_path / "arm")) as port:
            tap = TapTransport(transport(port.name), told.append)
            tap.latency = 0.2  # on a busy computer
            with Bus(tap) as bus:
                assert bus.find(1, family="dynamixel").read(RX28.present_temperature) == 25.0
            blocking = len(told)
            assert blocking
            tap = TapTransport(transport(port.name), told.append)
            tap.latency = 0.2
            assert asyncio.run(ask(tap)) == 25.0
            assert len(told) > blocking


class TestReplay:
    def test_answers_come_as_long_after_the_request_as_then(self) -> None:
        replay = ReplayTransport([Chunk(1.0, Direction.OUT, PING), Chunk(1.25, Direction.IN, PONG)])
        replay.sleep(10.0)
        replay.write(PING)
        assert replay.read(0.2) == b""
        assert replay.read(1.0) == PONG
        assert replay.now() == pytest.approx(10.25)

    def test_pieces_may_be_cut_otherwise(self) -> None:
        replay = ReplayTransport(
            [Chunk(0.0, Direction.OUT, PING[:2]), Chunk(0.1, Direction.OUT, PING[2:]), Chunk(0.2, Direction.IN, PONG)]
        )
        for byte in PING:
            assert not replay.finished
            replay.write(bytes((byte,)))
        assert replay.read(1) == PONG
        assert replay.finished

    def test_what_was_only_heard_is_played_by_its_times(self) -> None:
        replay = ReplayTransport([Chunk(0.5, Direction.UNKNOWN, PING), Chunk(0.6, Direction.UNKNOWN, PONG)])
        assert (replay.read(1), replay.now()) == (PING, 0.5)
        assert (replay.read(1), replay.now()) == (PONG, 0.6)
        assert (replay.read(1), replay.now()) == (b"", 1.6)

    @pytest.mark.parametrize(
        ("written", "why"),
        [(PONG, r"FF FF 01 02 00 FC was written where the recording has FF FF 01"), (PING + PING, "no more requests")],
    )
    def test_other_requests_are_refused(self, written: bytes, why: str) -> None:
        replay = ReplayTransport([Chunk(0.0, Direction.OUT, PING), Chunk(0.1, Direction.IN, PONG)])
        with pytest.raises(UsageError, match=why):
            replay.write(written)
