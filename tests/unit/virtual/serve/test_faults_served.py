"""Faults on the real clock, through the operating system: the same bytes, and ports that go away.

A little patience makes these safe on busy machines.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import serial

from servobus.virtual.serve.inprocess import connect
from servobus.virtual.serve.ports import Port, PtyPort, TcpPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url
from servobus.virtual.wire.faults import explain
from unit.served import served
from unit.virtual.wire.test_faults import FAMILIES, PING, PONG, ask, equip, every_family, port

needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo terminals on Windows")


def test_the_same_on_the_real_clock() -> None:
    faults = "seed=11,drop=0.2,flip=0.2,junk=0.2:1-8,stranger=0.1,mute=0.1,deaf=0.1,split=0.1:1ms"
    virtual, real = port(faults), connect(f"virtual:rx28@1?faults={faults}")
    for _ in range(20):
        expected = ask(virtual)
        real.write(PING)
        heard, deadline = b"", time.monotonic() + 5
        while len(heard) < len(expected) and time.monotonic() < deadline:
            heard += real.read(1)
        assert heard == expected
        if not expected:
            assert real.read(0.02) == b""


@pytest.mark.parametrize("kind", [pytest.param(PtyPort, marks=needs_pty), TcpPort])
@every_family
def test_the_same_through_the_system(kind: type[Port], servos: str) -> None:
    faults = "seed=11,drop=0.2,flip=0.2,pair=0.1,junk=0.2:1-8,stranger=0.1,mute=0.1,deaf=0.1,split=0.1:1ms,twin=0.05"
    request, _ = FAMILIES[servos]
    inside = port(faults, servos)
    expected = [ask(inside, request) for _ in range(40)]
    rig = build_rig(parse_url(f"virtual:{servos}?faults={faults}"))
    equip(rig)
    heard = []
    with served(kind(rig)) as outside:
        with serial.serial_for_url(outside.name, rig.default_baud, timeout=5) as client:
            for answer in expected:
                client.write(request)
                if answer:
                    heard.append(client.read(len(answer)))
                else:
                    time.sleep(0.03)
                    heard.append(b"")
            assert client.in_waiting == 0
        assert heard == expected
    assert rig.fault_counts == inside.rig.fault_counts


@needs_pty
def test_the_terminal_hangs_up_and_another_comes(tmp_path: Path) -> None:
    link = tmp_path / "arm"
    rig = build_rig(parse_url("virtual:rx28@1?faults=gone#2:200ms"))
    with served(PtyPort(rig, link)):
        with serial.Serial(str(link), 57600, timeout=5) as client:
            client.write(PING)
            assert client.read(6) == PONG
            client.write(PING)
            with pytest.raises((serial.SerialException, OSError)):
                assert client.read(6) == b""
                client.write(PING)
        assert not link.exists()
        deadline = time.monotonic() + 5
        while not link.exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        with serial.Serial(str(link), 57600, timeout=5) as client:
            client.write(PING)
            assert client.read(6) == PONG


def test_the_connection_is_closed_and_taken_again() -> None:
    rig = build_rig(parse_url("virtual:rx28@1?faults=gone#2:200ms"))
    with served(TcpPort(rig)) as outside:
        with serial.serial_for_url(outside.name, timeout=5) as client:
            client.write(PING)
            assert client.read(6) == PONG
            client.write(PING)
            with pytest.raises(serial.SerialException):
                client.read(6)
        deadline = time.monotonic() + 5
        while True:
            try:
                client = serial.serial_for_url(outside.name, timeout=5)
                break
            except serial.SerialException:
                assert time.monotonic() < deadline
                time.sleep(0.01)
        with client:
            client.write(PING)
            assert client.read(6) == PONG


@pytest.mark.skipif(os.name != "posix", reason="pseudo terminals and signals as on POSIX")
def test_the_command() -> None:
    command = [sys.executable, "-m", "servobus", "virtual", "rx28@1", "--faults"]
    with subprocess.Popen(
        [*command, "drop@3#2"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        path = process.stdout.readline().split()[1]
        with serial.Serial(path, 57600, timeout=5) as client:
            for reply in (PONG, PONG[:3] + PONG[4:], PONG):
                client.write(PING)
                assert client.read(len(reply)) == reply
        process.send_signal(signal.SIGTERM)
        _, stderr = process.communicate(timeout=10)
    assert (process.returncode, stderr) == (0, "faults: drop 1\n")
    shown = subprocess.run([*command, "help"], capture_output=True, text=True, timeout=30, check=True)
    assert shown.stdout == explain() + "\n"
    refused = subprocess.run([*command, "lose=1"], capture_output=True, text=True, timeout=30, check=False)
    assert refused.returncode != 0
    assert "there are mute, stranger" in refused.stderr
