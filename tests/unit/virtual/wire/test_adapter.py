"""In which pieces a client gets what is sent to it, by the adapter that is simulated.

An LX-16A at 115200 baud: a byte lasts ten bits. An answer of nine bytes is that of an RX-28 to a read of three bytes.
"""

import itertools
import os
import select
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from servobus.errors import BadValue, UsageError
from servobus.virtual.serve.inprocess import VirtualPort, connect
from servobus.virtual.serve.ports import PtyPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url
from servobus.virtual.wire.adapter import Adapter
from unit.served import served

BYTE = 10 / 115200
LX_READ = bytes.fromhex("55 55 01 03 15 E6")
"""ANGLE_LIMIT_READ of id 1 (LewanSoul Bus Servo Communication Protocol, command 21): ten bytes answer."""
RX_READ = bytes.fromhex("FF FF 01 04 02 24 03 D1")
"""READ_DATA of id 1, three bytes from address 36."""
HX_READ = bytes.fromhex("FF FF 09 FD 02 EC 12 1E 04")
"""EEP_READ of id 253 (HerkuleX manual, 6-1): 15 bytes answer."""
HX_READ_ALL = bytes.fromhex("FF FF 09 FD 02 C0 3E 00 36")
"""The same of 54 bytes from address 0: 65 bytes answer."""


def pieces(client: VirtualPort, request: bytes = LX_READ, quiet: float = 0.05) -> list[tuple[float, bytes]]:
    """Send a request; give when each piece of the answer came, s since the request, and the pieces."""
    start = client.now()
    client.write(request)
    got = []
    while chunk := client.read(quiet):
        got.append((client.now() - start, chunk))
    return got


def lx(adapter: str, options: str = "") -> VirtualPort:
    return connect(f"virtual:lx16a@1?clock=virtual&adapter={adapter}{options}")


def first_and_last() -> tuple[float, float, bytes]:
    """Give when the first and the last byte of the answer are on the line, and the answer, byte by byte."""
    got = pieces(lx("none"))
    return got[0][0], got[-1][0], b"".join(data for _, data in got)


def test_P3_whole_is_the_default_and_comes_with_its_last_byte() -> None:
    _, last, answer = first_and_last()
    for port in (lx("whole"), connect("virtual:lx16a@1?clock=virtual")):
        ((when, data),) = pieces(port)
        assert data == answer
        assert when == pytest.approx(last, abs=1e-8)


def test_P3_none_gives_each_byte_at_its_time() -> None:
    got = pieces(lx("none"))
    assert [len(data) for _, data in got] == [1] * 10
    gaps = [later - sooner for (sooner, _), (later, _) in itertools.pairwise(got)]
    assert gaps == pytest.approx([BYTE] * 9, abs=1e-8)


@pytest.mark.parametrize("milliseconds", [1, 16])
def test_P3_a_latency_timer_holds_the_bytes_back(milliseconds: int) -> None:
    first, _, answer = first_and_last()
    ((when, data),) = pieces(lx(f"usb:{milliseconds}ms"))
    assert data == answer
    assert when == pytest.approx(first + milliseconds / 1000, abs=1e-8)


def test_P3_a_usb_packet_is_sent_when_it_is_full() -> None:
    """Of 65 bytes 62 leave at once, as the 64 of a USB packet begin with two of the adapter itself."""
    byte_by_byte = pieces(connect("virtual:drs0602@253?clock=virtual&adapter=none"), HX_READ_ALL)
    got = pieces(connect("virtual:drs0602@253?clock=virtual&adapter=usb"), HX_READ_ALL)
    assert [len(data) for _, data in got] == [62, 3]
    times = [byte_by_byte[61][0], byte_by_byte[62][0] + 0.016]
    assert [when for when, _ in got] == pytest.approx(times, abs=1e-8)


def test_P3_a_fifo_calls_at_its_level_and_after_four_silent_bytes() -> None:
    first, last, answer = first_and_last()
    got = pieces(lx("fifo:4"))
    assert [data for _, data in got] == [answer[:4], answer[4:8], answer[8:]]
    times = [first + 3 * BYTE, first + 7 * BYTE, last + 4 * BYTE]
    assert [when for when, _ in got] == pytest.approx(times, abs=1e-8)
    ((when, data),) = pieces(lx("fifo"))  # level 14: only the time-out
    assert data == answer
    assert when == pytest.approx(last + 4 * BYTE, abs=1e-8)


@pytest.mark.parametrize("adapter", ["whole", "none", "usb", "usb:1ms", "fifo:1", "fifo:8"])
@pytest.mark.parametrize("servos", ["rx28@1", "lx16a@1", "drs0602@253"])
def test_P3_the_bytes_are_the_same_in_all_pieces(servos: str, adapter: str) -> None:
    request = {"rx28@1": RX_READ, "lx16a@1": LX_READ, "drs0602@253": HX_READ}
    plain = connect(f"virtual:{servos}?clock=virtual")
    other = connect(f"virtual:{servos}?clock=virtual&adapter={adapter}")
    expected = b"".join(data for _, data in pieces(plain, request[servos]))
    assert expected
    assert b"".join(data for _, data in pieces(other, request[servos])) == expected


def test_P3_answers_of_two_servos_come_apart() -> None:
    """Each is handed over at its own end, even if another one follows at once."""
    port = connect("virtual:drs0602@1,2?clock=virtual")
    stat = [bytes.fromhex(text) for text in ("FF FF 07 01 07 00 FE", "FF FF 07 02 07 02 FC")]
    got = pieces(port, bytes(4).join(stat))
    assert [data[3] for _, data in got if len(data) == 9] == [1, 2]


def test_P3_a_pause_within_a_whole_answer_cuts_it() -> None:
    _, last, answer = first_and_last()
    got = pieces(lx("whole", "&faults=split@4:3ms"))
    assert [data for _, data in got] == [answer[:4], answer[4:]]
    assert [when for when, _ in got] == pytest.approx([last - 6 * BYTE, last - 5 * BYTE + 0.003], abs=1e-8)


@pytest.mark.parametrize("text", ["", "ftdi", "usb:-1ms", "usb:1s", "usb:16V", "fifo:3", "fifo:x", "whole:3", "none:1"])
def test_P3_an_adapter_that_there_is_not(text: str) -> None:
    with pytest.raises(BadValue, match=r"adapter .*whole, none, usb"):
        Adapter.parse(text)
    with pytest.raises(UsageError, match="adapter"):
        connect(f"virtual:rx28@1?adapter={text}")


@pytest.mark.parametrize("text", ["whole", "none", "usb:16ms", "usb:1ms", "fifo:14", "fifo:8"])
def test_P3_an_adapter_is_written_as_it_is_read(text: str) -> None:
    assert str(Adapter.parse(text)) == text


@contextmanager
def raw_terminal(path: str) -> Iterator[int]:
    handle = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        tty.setraw(handle)
        settings = termios.tcgetattr(handle)
        settings[4] = settings[5] = termios.B57600
        termios.tcsetattr(handle, termios.TCSANOW, settings)
        yield handle
    finally:
        os.close(handle)


def test_P3_one_read_of_a_terminal_gives_the_whole_answer() -> None:
    """A program that does `os.read` once, as soon as something is there, has all nine bytes, each time."""
    with served(PtyPort(build_rig(parse_url("virtual:rx28@1")))) as port, raw_terminal(port.name) as handle:
        time.sleep(0.05)  # by then the server has seen that somebody is there
        for _ in range(50):
            os.write(handle, RX_READ)
            assert select.select([handle], [], [], 5.0)[0]
            assert len(os.read(handle, 9)) == 9
