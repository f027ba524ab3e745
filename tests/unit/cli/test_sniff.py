import json
import os
import select
import signal
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any, Self

import pytest
import serial

import servobus
from servobus import RX28
from servobus.traffic.recording import Chunk, Direction, Recording, TapEnd, parse
from unit.cli.conftest import Run

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo terminals and signals as on POSIX")

PING = bytes.fromhex("FF FF 01 02 01 FB")
PONG = bytes.fromhex("FF FF 01 02 00 FC")
READ_TEMPERATURE = bytes.fromhex("FF FF 01 04 02 2B 01 CC")
HEAT = bytes.fromhex("FF FF 01 03 00 20 DB")
PATIENCE = 20
"""s for what takes a fraction of one on a computer that has nothing else to do."""


class Process:
    """A servobus command in a process of its own; `port` is what its first line names."""

    def __init__(self, *args: str, **options: Any) -> None:
        command = [sys.executable, "-m", "servobus", *args]
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL}
        self._process = subprocess.Popen(command, text=True, **pipes, **options)
        self.first = self._process.stdout.readline() if self._process.stdout else ""
        self.port = self.first.removeprefix("ready ").strip()
        self.code = 0
        self.stderr = ""

    def end(self, by: signal.Signals | None = signal.SIGINT) -> list[str]:
        """End it, and give the lines it printed, the first included."""
        if by is not None:
            self._process.send_signal(by)
        stdout, self.stderr = self._process.communicate(timeout=PATIENCE)
        self.code = self._process.returncode
        return [self.first.rstrip("\n"), *stdout.splitlines()]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()


@contextmanager
def servos(*args: str) -> Iterator[str]:
    with Process("virtual", *args) as process:
        assert process.first.startswith("ready "), process.end(None)
        yield process.port
        process.end(signal.SIGTERM)
        assert (process.code, process.stderr) == (0, "")


@contextmanager
def wire() -> Iterator[tuple[FileIO, str]]:
    """Give the far end of a line, and the name of the port at the near end."""
    handle, near = os.openpty()
    tty.setraw(near)
    name = os.ttyname(near)
    os.close(near)
    with FileIO(handle, "r+") as far:
        yield far, name


@pytest.fixture(autouse=True)
def _signals_as_they_were() -> Iterator[None]:
    names = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(name) for name in names]
    yield
    for name, handler in zip(names, before, strict=True):
        signal.signal(name, handler)


def ask(port: str, request: bytes, size: int, baud: int = 57_600) -> bytes:
    with serial.Serial(port, baud, timeout=PATIENCE) as client:
        client.write(request)
        return client.read(size)


def packets(lines: list[str]) -> list[str]:
    """Give the lines without their times and latencies."""
    return [line[12:61].rstrip() if line[:3] == "   " and line[9:10].isdigit() else line.strip() for line in lines]


# Between an application and the servos


def test_between_an_application_and_its_servos(tmp_path: Path, run: Run) -> None:
    saved = tmp_path / "arm.rec"
    with (
        servos("rx28@1-2") as port,
        Process("sniff", port, "--app", str(tmp_path / "app"), "--save", str(saved)) as sniffer,
    ):
        assert sniffer.port == str(tmp_path / "app")
        with servobus.open(sniffer.port, bauds=57_600) as bus:
            bus.transport.latency = 0.2  # on a busy computer
            assert bus.find(1, family="dynamixel").read(RX28.present_temperature) == 25.0
        lines = sniffer.end()
        assert (sniffer.code, sniffer.stderr) == (0, "")
        assert not (tmp_path / "app").is_symlink()
    assert max(map(len, lines[1:])) <= 80  # the first names the terminal, which a program reads: never wrapped
    seen = packets(lines)
    asked = seen.index("> FF FF 01 04 02 2B 01 CC")
    assert seen[asked + 1] == "READ_DATA id 1: 1 byte from address 43, present_temperature"
    assert seen[asked + 2] == "< FF FF 01 03 00 19 E2"  # 0x19 = 25, ~(1 + 3 + 0x19) = E2
    assert seen[asked + 3] == "status of id 1: ok, present_temperature 25 °C"
    answer = next(line for line in lines if "< FF FF 01 03 00 19 E2" in line)
    assert answer.endswith(" ms")
    table = lines[-3:]
    assert table[0].split()[:4] == ["servo", "requests", "answers", "median"]
    assert table[1].startswith("dynamixel 1")
    assert table[1].endswith(" 0 %")
    assert "0 packets with a wrong checksum" in table[2]
    again = run("decode", saved).stdout.splitlines()
    assert again[0].startswith(f"{port} at 115200 baud, recorded 20")
    assert again[1:] == lines[1:]


def test_bytes_pass_as_they_are_both_ways(tmp_path: Path) -> None:
    every = bytes(range(256)) * 4
    with wire() as (far, port), Process("sniff", port, "--app") as sniffer:
        with serial.Serial(sniffer.port, 115_200, timeout=PATIENCE) as client:
            client.write(every)
            assert collect(far, len(every)) == every
            far.write(every)
            assert client.read(len(every)) == every
        sniffer.end()
        assert (sniffer.code, sniffer.stderr) == (0, "")


def collect(far: FileIO, size: int) -> bytes:
    data = b""
    while len(data) < size and select.select([far], [], [], PATIENCE)[0]:
        data += far.read(4096)
    return data


def test_the_line_takes_the_speed_of_the_application() -> None:
    with servos("rx28@1", "--baud", "1000000") as port, Process("sniff", port, "--app", "--baud", "57600") as sniffer:
        assert ask(sniffer.port, PING, 6, 1_000_000) == PONG
        lines = sniffer.end()
    assert "- the line is at 1000000 baud from here on" in packets(lines)[1]


@pytest.mark.parametrize("spec", ["virtual:rx28@1", "tcp"])
def test_ports_that_are_no_terminals(spec: str) -> None:
    with servos("rx28@1", "--tcp", "127.0.0.1:0") as tcp:
        port = tcp if spec == "tcp" else spec
        with Process("sniff", port, "--app", "--family", "dynamixel") as sniffer:
            assert ask(sniffer.port, PING, 6) == PONG
            assert [line for line in packets(sniffer.end()) if line[:1] in "<>"][:2] == [
                f"> {PING.hex(' ').upper()}",
                f"< {PONG.hex(' ').upper()}",
            ]


def test_until_the_application_closes_its_port(tmp_path: Path) -> None:
    saved = tmp_path / "arm.rec"
    with (
        servos("rx28@1") as port,
        Process("sniff", port, "--app", "--once", "--json", "--baud", "57600", "--save", str(saved)) as sniffer,
    ):
        name = json.loads(sniffer.first)["port"]
        assert ask(name, PING, 6) == PONG
        lines = [json.loads(line) for line in sniffer.end(None)]
        assert (sniffer.code, sniffer.stderr) == (0, "")
    ready, request, answer, summary = lines
    assert ready == {"kind": "ready", "port": name, "baud": 57_600}
    same = {"family": "dynamixel", "id": 1, "trouble": None}
    time, latency = request.pop("time"), answer.pop("latency")
    assert request == {
        **same, "kind": "request", "direction": ">", "hex": PING.hex(" ").upper(), "text": "PING id 1", "latency": None,
    }  # fmt: skip
    assert answer.pop("time") > time
    assert latency >= 0
    assert answer == {
        **same, "kind": "answer", "direction": "<", "hex": PONG.hex(" ").upper(), "text": "status of id 1: ok",
    }  # fmt: skip
    (servo,) = summary["servos"]
    assert (summary["kind"], summary["junk"], summary["corrupt"]) == ("summary", 0, 0)
    assert servo["latency_median"] == servo["latency_longest"] == pytest.approx(latency, abs=1e-5)
    assert (servo["id"], servo["requests"], servo["answers"], servo["error_rate"]) == (1, 1, 1, 0.0)
    recorded = parse(saved.read_bytes())
    assert isinstance(recorded.entries[-1], TapEnd)
    assert (data(recorded, Direction.OUT), data(recorded, Direction.IN)) == (PING, PONG)


def data(recording: Recording, direction: Direction) -> bytes:
    chunks = (entry for entry in recording.entries if isinstance(entry, Chunk))
    return b"".join(chunk.data for chunk in chunks if chunk.direction is direction)


def test_troubles_are_told(tmp_path: Path) -> None:
    with wire() as (far, port), Process("sniff", port, "--app", "--family", "dynamixel") as sniffer:
        with serial.Serial(sniffer.port, 115_200, timeout=PATIENCE) as client:
            for answer in (PONG, PONG[:-1] + b"\x00", bytes.fromhex("FF FF 02 02 00 FB")):
                client.write(PING)
                assert collect(far, 6) == PING
                far.write(answer)
                assert client.read(6) == answer
        lines = sniffer.end()
    said = [line.strip() for line in lines]
    assert "CHECKSUM WRONG: would be status of id 1: ok" in said
    assert "STRANGER, id 1 was asked: status of id 2: ok" in said
    first = next(line.split() for line in lines if line.startswith("dynamixel 1"))
    # 3 requests, 1 answer with its latency; 1 corrupt. The last question may still be answered, or is missing by now.
    assert first[2:4] == ["3", "1"]
    assert first[9] == "1"
    assert lines[-1].endswith("1 packet with a wrong checksum")


# Only listening


def test_listening_sends_nothing(tmp_path: Path, run: Run) -> None:
    saved = tmp_path / "heard.rec"
    with (
        wire() as (far, port),
        Process("sniff", port, "--baud", "57600", "--save", str(saved), "--model", "rx28") as sniffer,
    ):
        assert sniffer.first == f"listening on {port} at 57600 baud\n"
        far.write(READ_TEMPERATURE)
        until(lambda: heard(saved) == READ_TEMPERATURE)
        far.write(HEAT)
        until(lambda: heard(saved) == READ_TEMPERATURE + HEAT)
        sent = select.select([far], [], [], 0)[0]  # while it is open: a port that nobody has open is readable too
        lines = sniffer.end()
        assert (sniffer.code, sniffer.stderr, sent) == (0, "", [])
    assert packets(lines)[1:5] == [
        "- FF FF 01 04 02 2B 01 CC",
        "READ_DATA id 1: 1 byte from address 43, present_temperature",
        "- FF FF 01 03 00 20 DB",
        "status of id 1: ok, present_temperature 32 °C",
    ]
    assert run("decode", saved).stdout.splitlines()[1:] == lines[1:]


def heard(saved: Path) -> bytes:
    return data(parse(saved.read_bytes()), Direction.UNKNOWN)


def until(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_port_that_goes_away(tmp_path: Path, run: Run) -> None:
    saved = tmp_path / "heard.rec"
    with wire() as (far, port), Process("sniff", port, "--save", str(saved)) as sniffer:
        far.write(PING + PONG)
        until(lambda: heard(saved) == PING + PONG)
        far.close()
        lines = sniffer.end(None)
    assert sniffer.code == 1
    assert "the port went away" in sniffer.stderr
    assert "status of id 1: ok" in [line.strip() for line in lines]
    assert lines[-2].startswith("dynamixel 1")
    assert run("decode", saved).stdout.splitlines()[1:] == lines[1:]


# Recordings


def test_a_recording_of_a_sniffer_that_was_killed(tmp_path: Path, run: Run) -> None:
    saved = tmp_path / "arm.rec"
    with servos("rx28@1") as port, Process("sniff", port, "--app", "--save", str(saved)) as sniffer:
        assert ask(sniffer.port, PING, 6) == PONG
        until(lambda: data(parse(saved.read_bytes()), Direction.IN) == PONG)
        sniffer.end(signal.SIGKILL)
    assert "status of id 1: ok" in run("decode", saved).stdout


@pytest.mark.skipif(sys.platform != "linux", reason="limits as on Linux")
def test_a_full_disk_ends_the_recording_and_nothing_else(tmp_path: Path, run: Run) -> None:
    import resource  # noqa: PLC0415 - there is none on Windows

    saved = tmp_path / "arm.rec"
    limit = {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (250, 250))}
    with servos("rx28@1") as port, Process("sniff", port, "--app", "--save", str(saved), **limit) as sniffer:
        for _ in range(10):
            assert ask(sniffer.port, PING, 6) == PONG
        lines = sniffer.end()
    assert sniffer.code == 1
    assert "the recording ends early" in sniffer.stderr
    assert sum("status of id 1: ok" in line for line in lines) == 10
    decoded = run("decode", saved)
    assert 0 < decoded.stdout.count("status of id 1: ok") < 10
    assert "the last line was cut off" in decoded.stderr


RECORDING = """\
# servobus recording 1 {"port": "COM4", "baud": 57600, "family": null, "model": null, "started": "2026-01-02T03:04:05"}
1.000000 > FF FF 01 04 02 2B 01 CC
1.003000 < FF FF 01 03 00 20 DB
2.000000 > FF FF 02 02 01 FA
"""
SHOWN = [
    "COM4 at 57600 baud, recorded 2026-01-02T03:04:05",
    "   1.000000 > FF FF 01 04 02 2B 01 CC",
    "              READ_DATA id 1: 1 byte from address 43, present_temperature",
    # 3 ms less the 80 bits of the request: 3 - 80 / 57.6 = 1.61
    "   1.003000 < FF FF 01 03 00 20 DB                                      +1.61 ms",
    "              status of id 1: ok, present_temperature 32 °C",
    "   2.000000 > FF FF 02 02 01 FA",
    "              PING id 2",
]
ENDED = [
    # 2 s, 60 bits of the request and of the answer, and 0.1 s to wait
    "   2.102083 < NO ANSWER to PING id 2",
    "",
    "servo       requests answers  median longest missing corrupt other errors",
    "dynamixel 1        1       1 1.61 ms 1.61 ms       0       0     0    0 %",
    "dynamixel 2        1       0                       1       0     0  100 %",
    "9.0 s; 0 bytes of junk, 0 packets with a wrong checksum",
]


def test_a_recording_is_shown(tmp_path: Path, run: Run) -> None:
    file = tmp_path / "a.rec"
    file.write_text(RECORDING + "9.000000 .\n")
    result = run("decode", file, "--model", "rx28")
    assert result.stdout.splitlines() == SHOWN + ENDED
    assert result.stderr == ""
    assert run("decode", "-", "--model", "rx28", input=file.read_bytes()).stdout == result.stdout


def test_a_recording_that_was_cut_off(tmp_path: Path, run: Run) -> None:
    file = tmp_path / "a.rec"
    file.write_text(RECORDING + "2.003000 < FF FF 02 0")
    result = run("decode", file, "--model", "rx28")
    assert result.stdout.splitlines()[: len(SHOWN)] == SHOWN
    assert "NO ANSWER" not in result.stdout  # nobody knows
    assert result.stderr == f"{file}: the last line was cut off and is left out\n"


def test_a_recording_for_programs(tmp_path: Path, run: Run) -> None:
    file = tmp_path / "a.rec"
    file.write_text(RECORDING + "9.000000 .\n")
    lines = [json.loads(line) for line in run("decode", file, "--json").stdout.splitlines()]
    assert [line["kind"] for line in lines] == ["request", "answer", "request", "silence", "summary"]
    assert lines[1]["latency"] == pytest.approx(0.001611)
    assert [servo["missing"] for servo in lines[-1]["servos"]] == [0, 1]


def test_whose_packets_a_recording_has_can_be_said(tmp_path: Path, run: Run) -> None:
    file = tmp_path / "a.rec"
    file.write_text(RECORDING.replace('"family": null', '"family": "herkulex"'))
    assert "other traffic, Dynamixel protocol 1.0: PING" in run("decode", file).stdout
    assert "other traffic" not in run("decode", file, "--model", "rx28").stdout


def test_what_is_no_recording(tmp_path: Path, refused: Callable[..., str]) -> None:
    file = tmp_path / "a.rec"
    file.write_text(RECORDING + "hello\n3.0 > FF\n")
    assert f"{file}: line 5 is no line of a recording: 'hello'" in refused("decode", file)
    file.write_text(RECORDING.replace('"baud": 57600', '"baud": "fast"'))
    assert "line 1 is no head of a recording: baud is 'fast'" in refused("decode", file)
    file.write_text(RECORDING.replace('"family": null', '"family": "feetech"'))
    assert f"{file}: no family 'feetech'" in refused("decode", file)
    file.write_text(RECORDING[:60])
    assert "in its first line" in refused("decode", file)


@pytest.mark.skipif(getattr(os, "geteuid", int)() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read(tmp_path: Path, refused: Callable[..., str]) -> None:
    file = tmp_path / "a.rec"
    file.touch(0)
    assert f"{file}: Permission denied" in refused("decode", file)


# What cannot be


def test_what_makes_no_sense(refused: Callable[..., str]) -> None:
    assert "--once needs --app" in refused("sniff", "/dev/null", "--once", code=2)
    assert "one speed, not all" in refused("sniff", "/dev/null", "--baud", "all", code=2)
    assert "the name of the port is empty" in refused("sniff", " ")
    assert "no model 'rx29'" in refused("sniff", "/dev/null", "--model", "rx29")
    clash = refused("sniff", "/dev/null", "--model", "rx28", "--family", "herkulex")
    assert "RX-28 is of the family dynamixel" in clash


def test_ports_and_files_that_cannot_be_had(tmp_path: Path, refused: Callable[..., str]) -> None:
    assert "no such port" in refused("sniff", "/dev/ttyNONE0")
    taken = tmp_path / "mine"
    taken.write_text("mine")
    with wire() as (_, port):
        assert "exists and is no link" in refused("sniff", port, "--app", taken)
        assert f"{taken} exists already and is not replaced" in refused("sniff", port, "--save", taken)
        assert f"there is no folder {tmp_path / 'no'}" in refused("sniff", port, "--save", tmp_path / "no" / "file")
        with serial.Serial(port, exclusive=True):
            assert "in use by this process" in refused("sniff", port)
    assert taken.read_text() == "mine"


def test_N18_a_virtual_port_alone_has_nobody_who_talks(refused: Callable[..., str]) -> None:
    assert "--app gives an application a way to it" in refused("sniff", "virtual:rx28@1")
