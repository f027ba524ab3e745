"""Through the operating system, in real time: a little patience makes these safe on busy machines."""

import os
import re
import socket
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
import serial

import servobus
from servobus.errors import PortError, PortLost
from servobus.virtual.serve.ports import PtyPort, TcpPort, serve_pty, serve_tcp
from servobus.virtual.serve.rig import Rig, build_rig
from servobus.virtual.serve.spec import parse_url
from unit.served import served

PING = bytes.fromhex("FF FF 01 02 01 FB")
PONG = bytes.fromhex("FF FF 01 02 00 FC")
needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo terminals on Windows")


def rig(spec: str = "rx28@1-3") -> Rig:
    return build_rig(parse_url(spec))


def ask(name: str, baud: int, request: bytes = PING, size: int = 6, timeout: float = 2.0) -> bytes:
    with serial.serial_for_url(name, baud, timeout=timeout) as client:
        client.write(request)
        heard: bytes = client.read(size)
        return heard


@needs_pty
@pytest.mark.parametrize("baud", [57600, 250_000, 1_000_000])
def test_pty_at_any_speed(baud: int) -> None:
    with served(PtyPort(rig(f"rx28@1?baud={baud}"))) as port:
        assert ask(port.name, baud) == PONG
        assert ask(port.name, 9600, timeout=0.1) == b""
        assert ask(port.name, baud) == PONG


@needs_pty
def test_pty_passes_every_byte_both_ways_and_echoes_none() -> None:
    special = bytes.fromhex("0A 0D 03 04 11 13 1A 1C 00 7F FF")
    body = bytes((1, len(special) + 3, 4, 26)) + special  # REG_WRITE past the end of nothing: refused, but heard
    request = b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))
    with served(PtyPort(rig())) as port:
        assert ask(port.name, 57600, request) == bytes.fromhex("FF FF 01 02 08 F4")


@needs_pty
def test_clients_that_flush_around_each_write() -> None:
    with served(PtyPort(rig("rx28@1?baud=1000000"))) as port, serial.Serial(port.name, 1_000_000) as client:
        client.timeout = 2
        for _ in range(20):
            client.reset_input_buffer()
            client.write(PING)
            client.flush()
            assert client.read(6) == PONG


@needs_pty
def test_what_nobody_reads_is_lost() -> None:
    with served(PtyPort(rig())) as port:
        with serial.Serial(port.name, 57600) as client:
            client.write(PING)
            time.sleep(0.2)  # the reply is there, and stays unread
        time.sleep(0.2)
        handle = os.open(port.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            with suppress(BlockingIOError):  # or nothing at all, as the last client's settings say
                assert os.read(handle, 100) == b""
        finally:
            os.close(handle)
        assert ask(port.name, 57600) == PONG


@needs_pty
def test_a_client_that_does_not_read_blocks_nothing() -> None:
    block = bytes.fromhex("FF FF 01 04 02 00 32 C6")  # 56 bytes come back
    with served(PtyPort(rig("rx28@1?baud=1000000"))) as port, serial.Serial(port.name, 1_000_000) as client:
        for _ in range(300):
            client.write(block)
            time.sleep(0.002)
        client.reset_input_buffer()
        time.sleep(0.1)
        client.reset_input_buffer()
        client.timeout = 2
        client.write(PING)
        assert client.read(6) == PONG


@needs_pty
def test_link(tmp_path: Path) -> None:
    link = tmp_path / "servos"
    with served(PtyPort(rig(), link)) as port:
        assert port.name == str(link)
        assert link.is_symlink()
        assert ask(str(link), 57600) == PONG
    assert list(tmp_path.iterdir()) == []


@needs_pty
def test_link_that_is_served_is_refused(tmp_path: Path) -> None:
    link = tmp_path / "servos"
    with served(PtyPort(rig(), link)):
        with pytest.raises(PortError, match=f"process {os.getpid()}"), PtyPort(rig(), link):
            pass
        assert ask(str(link), 57600) == PONG


@needs_pty
@pytest.mark.parametrize("target", ["/dev/pts/99999", "/dev/null"])
def test_link_of_a_crashed_program_is_replaced(tmp_path: Path, target: str) -> None:
    link = tmp_path / "servos"
    link.symlink_to(target)
    (tmp_path / ".servos.lock").write_text("12345\n")
    with served(PtyPort(rig(), link)):
        assert ask(str(link), 57600) == PONG
    assert list(tmp_path.iterdir()) == []


@needs_pty
def test_link_to_nowhere_is_replaced(tmp_path: Path) -> None:
    link = tmp_path / "servos"
    link.symlink_to(tmp_path / "gone")
    with served(PtyPort(rig(), link)):
        assert ask(str(link), 57600) == PONG


@needs_pty
def test_links_and_files_of_others_are_not_touched(tmp_path: Path) -> None:
    link, file = tmp_path / "servos", tmp_path / "file"
    link.symlink_to("/dev/null")
    file.write_text("precious")
    nowhere = tmp_path / "no" / "where"
    for path, why in ((link, "not made by servobus"), (file, "is no link"), (nowhere, "cannot be made")):
        with pytest.raises(PortError, match=why), PtyPort(rig(), path):
            pass
    assert str(link.readlink()) == "/dev/null"
    assert file.read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "servos"]


@needs_pty
def test_link_that_another_took_over_is_left_alone(tmp_path: Path) -> None:
    link = tmp_path / "servos"
    with PtyPort(rig(), link):
        link.unlink()
        link.symlink_to("/dev/null")
    assert str(link.readlink()) == "/dev/null"


def test_no_pseudo_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> tuple[int, int]:
        raise OSError(2, "out of pty devices")

    monkeypatch.setattr(os, "openpty", none, raising=False)
    with pytest.raises(PortError, match="--tcp"), PtyPort(rig()):
        pass


def test_tcp_one_client_after_the_other() -> None:
    with served(TcpPort(rig("rx28@1,lx16a@2"))) as port:
        assert port.name.startswith("socket://127.0.0.1:")
        for _ in range(3):
            assert ask(port.name, 57600) == PONG
        # A client over TCP has no speed: the LX-16A at 115200 understands it as well.
        heard = ask(port.name, 9600, bytes.fromhex("55 55 02 03 0E EC"), 7)
        assert heard == bytes.fromhex("55 55 02 04 0E 02 E9")


def test_tcp_second_client_is_hung_up_on() -> None:
    with served(TcpPort(rig())) as port, servobus.open(port.name) as bus:
        bus.find(1, family="dynamixel")
        with servobus.open(port.name) as other, pytest.raises(PortLost, match="serve another client"):
            other.find(1, family="dynamixel")
        bus[1].ping()  # the first one is served as before


def test_tcp_client_that_leaves_without_a_word() -> None:
    with served(TcpPort(rig())) as port:
        number = int(port.name.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", number)) as client:
            client.sendall(PING)
        time.sleep(0.1)  # else the old client's reply is still on the wire
        assert ask(port.name, 57600) == PONG


def test_tcp_port_in_use() -> None:
    with TcpPort(rig()) as port:
        number = int(port.name.rpartition(":")[2])
        with pytest.raises(PortError, match=str(number)), TcpPort(rig(), port=number):
            pass


def test_functions() -> None:
    stop, names = threading.Event(), []

    def ready(name: str) -> None:
        names.append(name)
        stop.set()

    serve_tcp(rig(), "127.0.0.1", 0, stop, ready)
    assert names[0].startswith("socket://")
    if sys.platform != "win32":
        serve_pty(rig(), None, stop, ready)
        assert names[1].startswith("/dev/")


def test_an_address_in_use_is_said_to_be_with_what_can_be_done() -> None:
    with served(TcpPort(rig("rx28@1"))) as outside:
        number = int(outside.name.rpartition(":")[2])
        said = f"cannot listen on 127.0.0.1 port {number}: another program listens there; end it, or take another port"
        with pytest.raises(PortError, match=re.escape(said)), TcpPort(rig("rx28@2"), port=number):
            pass
