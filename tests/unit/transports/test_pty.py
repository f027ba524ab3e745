import os
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from servobus.transports.pty import PseudoTerminal

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo terminals on Windows")

EVERY_BYTE = bytes(range(256))
LONGEST = 5.0
"""s for what takes a fraction of one on a computer that has nothing else to do."""


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + LONGEST
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.001)


def client(terminal: PseudoTerminal) -> int:
    handle = os.open(terminal.name, os.O_RDWR | os.O_NOCTTY)
    until(lambda: terminal.read() == b"" and terminal.has_client)
    return handle


def collect(read: Callable[[], bytes], size: int) -> bytes:
    data = b""
    end = time.monotonic() + LONGEST
    while len(data) < size and time.monotonic() < end:
        data += read()
    return data


def test_bytes_pass_as_they_are() -> None:
    with PseudoTerminal(57_600) as terminal:
        handle = client(terminal)
        os.write(handle, EVERY_BYTE)
        assert collect(lambda: terminal.read(0.1), 256) == EVERY_BYTE
        terminal.write(EVERY_BYTE)
        assert collect(lambda: os.read(handle, 256), 256) == EVERY_BYTE
        os.close(handle)


def test_the_speed_is_the_first_until_a_client_sets_one() -> None:
    with PseudoTerminal(57_600) as terminal:
        assert terminal.baud() == 57_600
        handle = client(terminal)
        settings = termios.tcgetattr(handle)
        settings[4] = settings[5] = termios.B115200
        termios.tcsetattr(handle, termios.TCSANOW, settings)
        assert terminal.baud() == 115_200
        os.close(handle)
        assert terminal.baud() == 115_200


def test_it_tells_when_the_client_leaves_and_drops_what_that_did_not_read() -> None:
    with PseudoTerminal(57_600) as terminal:
        assert not terminal.has_client
        terminal.write(b"lost")
        handle = client(terminal)
        terminal.write(b"unread")
        os.close(handle)
        if sys.platform == "linux":
            until(lambda: terminal.read() == b"" and not terminal.has_client)
            handle = client(terminal)
            os.set_blocking(handle, False)
            with pytest.raises(BlockingIOError):
                os.read(handle, 10)
            os.close(handle)


def test_a_link_is_there_as_long_as_it_is_open(tmp_path: Path) -> None:
    link = tmp_path / "arm"
    terminal = PseudoTerminal(57_600, link)
    for _ in range(2):  # it may be opened again
        with terminal:
            assert terminal.name == str(link)
            assert os.path.samestat(link.stat(), Path(os.path.realpath(link)).stat())
            handle = os.open(link, os.O_RDWR | os.O_NOCTTY)
            assert termios.tcgetattr(handle)[3] & termios.ECHO == 0
            os.close(handle)
        assert list(tmp_path.iterdir()) == []
