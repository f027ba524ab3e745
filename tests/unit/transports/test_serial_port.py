"""Real ports on pseudo terminals and sockets. Times are limits against hanging, not measurements."""

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from servobus.errors import PortError, PortLost
from servobus.transports import serial_port
from servobus.transports import usb_adapter as facts
from servobus.transports.serial_port import SerialPort
from servobus.transports.usb_adapter import Adapter, Holder, Holders

if sys.platform == "win32":
    pytest.skip("no pseudo terminals on Windows", allow_module_level=True)

import termios

PROMPT = 3.0
"""s; far less than the time-outs that these tests ask for, far more than a busy machine needs."""


class Terminal:
    """A pseudo terminal whose other end the test holds."""

    def __init__(self) -> None:
        self.master, slave = os.openpty()
        self.name = os.ttyname(slave)
        os.close(slave)

    def hang_up(self) -> None:
        master, self.master = self.master, -1  # first, for a timer and the end of the test may both hang up
        if master >= 0:
            os.close(master)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    terminal = Terminal()
    yield terminal
    terminal.hang_up()


@pytest.fixture
def port(terminal: Terminal) -> Iterator[SerialPort]:
    port = SerialPort(terminal.name, 57_600)
    yield port
    port.close()


def test_carries_every_byte_both_ways(terminal: Terminal, port: SerialPort) -> None:
    every = bytes(range(256))
    port.write(every)
    assert os.read(terminal.master, 1000) == every
    assert not port.pending()
    os.write(terminal.master, every)
    assert port.read(PROMPT) == every
    assert port.read(0) == b""
    assert port.read(0.001) == b""
    assert port.read(-1) == b""


def test_tells_what_is_pending(terminal: Terminal, port: SerialPort) -> None:
    os.write(terminal.master, b"\x01")
    port.read(PROMPT)
    os.write(terminal.master, b"\x02")
    while not port.pending():
        time.sleep(0.001)
    assert port.discard() == b"\x02"
    assert not port.pending()


def test_descriptors_above_1024() -> None:
    import resource  # noqa: PLC0415 - not there on Windows

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 2048:
        pytest.skip("this system allows too few files")
    with contextlib.ExitStack() as stack:
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2048), hard))
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        terminal = Terminal()
        stack.callback(terminal.hang_up)
        for _ in range(1100):
            stack.callback(os.close, os.open(os.devnull, os.O_RDONLY))
        port = SerialPort(terminal.name, 57_600)
        stack.callback(port.close)
        assert (port.fileno() or 0) > 1024
        os.write(terminal.master, b"\x01")
        assert port.read(PROMPT) == b"\x01"


class TestLost:
    """The other end of the pseudo terminal goes away, as an adapter does that is unplugged."""

    def test_while_reading(self, terminal: Terminal, port: SerialPort) -> None:
        threading.Timer(0.05, terminal.hang_up).start()
        start = time.monotonic()
        with pytest.raises(PortLost, match=f"{terminal.name}: the port went away while reading"):
            port.read(60)
        assert time.monotonic() - start < PROMPT

    @pytest.mark.parametrize(
        "use",
        [
            lambda port: port.read(60),
            lambda port: port.read(0),
            lambda port: port.write(b"\x01"),
            lambda port: port.set_baud(1_000_000),
            lambda port: port.pending() and port.read(0),
            lambda port: port.discard(),
        ],
        ids=["read", "read at once", "write", "set_baud", "pending", "discard"],
    )
    def test_while_idle(self, terminal: Terminal, port: SerialPort, use: Callable[[SerialPort], object]) -> None:
        terminal.hang_up()
        start = time.monotonic()
        for _ in range(2):
            with pytest.raises(PortLost, match="went away"):
                use(port)
        assert time.monotonic() - start < PROMPT

    def test_after_the_last_bytes_were_read(self, terminal: Terminal, port: SerialPort) -> None:
        os.write(terminal.master, b"\x01")
        assert port.read(PROMPT) == b"\x01"
        terminal.hang_up()
        with pytest.raises(PortLost):
            port.read(60)

    def test_while_writing_much(self, terminal: Terminal, port: SerialPort) -> None:
        threading.Timer(0.05, terminal.hang_up).start()
        start = time.monotonic()
        with pytest.raises(PortLost, match="while writing"):
            port.write(bytes(1_000_000))  # more than a terminal keeps for its reader
        assert time.monotonic() - start < PROMPT

    def test_because_nobody_takes_the_bytes(self, port: SerialPort, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(serial_port, "STUCK", 0.05)
        with pytest.raises(PortLost, match=r"took \d+ of 1000000 bytes and no more within 0.05 s"):
            port.write(bytes(1_000_000))

    def test_because_the_descriptor_was_closed(self, port: SerialPort) -> None:
        os.close(port.fileno() or -1)
        with pytest.raises(PortLost, match="Bad file descriptor"):
            port.read(0.05)  # the system does not wake who waits for a closed one: it is found out afterwards
        with pytest.raises(PortLost, match="Bad file descriptor"):
            port.write(b"\x01")
        port._port.fd = os.open(os.devnull, os.O_RDWR)  # what `close` will close instead

    def test_but_not_because_another_was_faster(self, terminal: Terminal, port: SerialPort) -> None:
        # Between the look and the read somebody throws away what had arrived.
        wait = port._wait

        def slow(timeout: float) -> list[tuple[int, int]]:
            events = wait(timeout)
            termios.tcflush(port.fileno() or -1, termios.TCIFLUSH)
            return events

        port._wait = slow
        os.write(terminal.master, b"\x01")
        assert port.read(PROMPT) == b""


def test_a_slow_reader_gets_everything(terminal: Terminal, port: SerialPort) -> None:
    much = bytes(range(256)) * 1000
    got = bytearray()

    def take() -> None:
        while len(got) < len(much):
            got.extend(os.read(terminal.master, 1000))

    reader = threading.Thread(target=take)
    reader.start()
    port.write(much)
    reader.join(PROMPT)
    assert bytes(got) == much


@pytest.mark.parametrize("use", ["read", "write", "set_baud", "pending"])
def test_closed(port: SerialPort, use: str) -> None:
    port.close()
    port.close()
    arguments = {"read": (60,), "write": (b"\x01",), "set_baud": (1_000_000,), "pending": ()}[use]
    with pytest.raises(PortError, match=r"is closed$"):
        getattr(port, use)(*arguments)
    assert port.fileno() is None


class TestOpening:
    def test_a_port_in_use_names_its_holder(self, terminal: Terminal) -> None:
        code = (
            "import sys, serial\n"
            f"port = serial.Serial({terminal.name!r}, exclusive=True)\n"
            "print('ready', flush=True)\n"
            "sys.stdin.read()"
        )
        with subprocess.Popen(
            [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as other:
            assert other.stdout is not None
            assert other.stdout.readline() == "ready\n"
            with pytest.raises(PortError) as caught:
                SerialPort(terminal.name, 57_600)
            other.communicate()
        assert f"{terminal.name}: in use by {Path(sys.executable).name} -c import sys" in str(caught.value)
        assert str(caught.value).endswith(f"(pid {other.pid}); end that first")
        SerialPort(terminal.name, 57_600).close()

    def test_a_port_that_is_open_here_already(self, port: SerialPort) -> None:
        with pytest.raises(PortError, match="in use by this process; end that first"):
            SerialPort(port.name, 57_600)

    def test_a_program_that_asks_for_no_lock_is_found_too(
        self, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(facts, "is_wired", lambda _: True)
        monkeypatch.setattr(facts, "holders", lambda _: Holders((Holder(4711, "python3 arm.py"),)))
        with pytest.raises(PortError, match=r"in use by python3 arm.py \(pid 4711\); end that first"):
            SerialPort(terminal.name, 57_600)

    def test_without_permission(self, terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
        def refuse(*_: object) -> int:
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(os, "open", refuse)
        about = facts.PortAccess("/dev/ttyUSB0", exists=True, group="dialout")
        monkeypatch.setattr(facts, "access", lambda _: about)
        with pytest.raises(PortError, match=r"group dialout: sudo usermod -aG dialout \$USER, then log out"):
            SerialPort(terminal.name, 57_600)

    @pytest.mark.parametrize(
        ("name", "why"),
        [
            ("/dev/null", "is no serial port"),
            ("/no/such/port", "no such port; `servobus ports`"),
            ("tcp://pi.local:3333", "a TCP port is written socket://pi.local:3333"),
            ("127.0.0.1:3333", "a TCP port is written socket://127.0.0.1:3333"),
            ("[::1]:3333", r"a TCP port is written socket://\[::1\]:3333"),
        ],
    )
    def test_what_is_no_port(self, name: str, why: str) -> None:
        with pytest.raises(PortError, match=why):
            SerialPort(name, 57_600)

    def test_the_adapter_tells_the_first_guess_of_the_latency(
        self, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(facts, "is_wired", lambda _: True)
        monkeypatch.setattr(facts, "adapter", lambda name: Adapter(name, driver="ftdi_sio", latency_timer=1))
        port = SerialPort(terminal.name, 57_600)
        try:
            assert port.latency == pytest.approx(0.003)  # 1 ms, and 2 ms for the system
        finally:
            port.close()

    def test_a_pseudo_terminal_has_no_low_latency_mode_and_works(self, port: SerialPort) -> None:
        assert not port.low_latency
        assert port.adapter is None
        assert port.latency == 0.025


class TestReopening:
    def test_under_the_same_name_keeps_the_speed(self, terminal: Terminal, port: SerialPort) -> None:
        port.set_baud(1_000_000)
        port.reopen()
        assert termios.tcgetattr(port.fileno() or -1)[5] == termios.B1000000
        os.write(terminal.master, b"\x01")
        assert port.read(PROMPT) == b"\x01"

    def test_of_what_is_gone(self, terminal: Terminal, port: SerialPort) -> None:
        terminal.hang_up()
        for _ in range(2):
            with pytest.raises(PortError, match="no such port"):
                port.reopen()
        with pytest.raises(PortError, match="is closed"):
            port.read(60)

    def test_finds_the_adapter_under_its_new_name(
        self, terminal: Terminal, port: SerialPort, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        port.adapter = Adapter(terminal.name, 0x0403, 0x6001, serial_number="A50285BI", location="1-1.2")
        terminal.hang_up()
        with pytest.raises(PortLost):
            port.read(60)
        other = Terminal()
        try:
            stranger = Adapter("/dev/ttyUSB9", 0x0403, 0x6001, serial_number="A9007UX1")
            moved = Adapter(other.name, 0x0403, 0x6001, serial_number="A50285BI", location="1-1.4")
            monkeypatch.setattr(facts, "adapters", lambda: [stranger])
            with pytest.raises(PortError, match=r"A50285BI is not plugged in; there is: /dev/ttyUSB9"):
                port.reopen()
            monkeypatch.setattr(facts, "adapters", lambda: [stranger, moved])
            port.reopen()
            assert port.name == other.name
            port.write(b"\x01")
            assert os.read(other.master, 10) == b"\x01"
        finally:
            other.hang_up()


class TestWithoutDescriptor:
    """Ports whose bytes pyserial carries: here its own loop, elsewhere all of Windows, and rfc2217."""

    def test_carries_bytes(self) -> None:
        port = SerialPort("loop://", 115_200)
        assert port.fileno() is None
        assert not port.pending()
        port.write(b"\x01\x02\x03")
        assert port.pending()
        assert port.read(PROMPT) == b"\x01\x02\x03"
        assert port.read(0.001) == b""
        port.close()
        with pytest.raises(PortError, match="is closed"):
            port.read(60)
        port.reopen()
        port.write(b"\x04")
        assert port.read(PROMPT) == b"\x04"
        port.close()

    @pytest.mark.filterwarnings("ignore::DeprecationWarning")  # pyserial's, about its thread
    def test_rfc2217_whose_server_goes_away(self) -> None:
        from serial import rfc2217, serial_for_url  # noqa: PLC0415 - only here

        class Connection:
            def __init__(self, client: socket.socket) -> None:
                self.write = client.sendall

        def serve() -> None:
            client, _ = listener.accept()
            far = serial_for_url("loop://", timeout=0)
            manager = rfc2217.PortManager(far, Connection(client))  # type: ignore[arg-type] # what its examples do
            while not quit.is_set():
                with contextlib.suppress(TimeoutError):
                    client.settimeout(0.02)
                    far.write(b"".join(manager.filter(client.recv(1000))))
                client.sendall(b"".join(manager.escape(far.read(1000))))
            client.close()

        quit = threading.Event()
        with socket.create_server(("127.0.0.1", 0)) as listener:
            server = threading.Thread(target=serve)
            server.start()
            port = SerialPort(f"rfc2217://127.0.0.1:{listener.getsockname()[1]}", 115_200)
            port.write(b"\x01\xff\x02")
            heard = b""
            while len(heard) < 3:
                heard += port.read(PROMPT)
            assert heard == b"\x01\xff\x02"
            quit.set()
            with pytest.raises(PortLost):
                port.read(60)
            server.join()
            port.close()


class TestSocket:
    @pytest.fixture
    def listener(self) -> Iterator[socket.socket]:
        with socket.create_server(("127.0.0.1", 0)) as listener:
            yield listener

    def test_end_of_file_and_a_new_connection(self, listener: socket.socket) -> None:
        port = SerialPort(f"socket://127.0.0.1:{listener.getsockname()[1]}", 115_200)
        client, _ = listener.accept()
        client.sendall(b"\x01")
        assert port.read(PROMPT) == b"\x01"
        client.close()
        with pytest.raises(PortLost, match="went away while reading"):
            port.read(60)
        port.reopen()
        client, _ = listener.accept()
        port.write(b"\x02")
        assert client.recv(10) == b"\x02"
        client.close()
        port.close()

    def test_nobody_listens_any_more(self, listener: socket.socket) -> None:
        port = SerialPort(f"socket://127.0.0.1:{listener.getsockname()[1]}", 115_200)
        listener.accept()[0].close()
        listener.close()
        with pytest.raises(PortError, match="cannot be opened"):
            port.reopen()
