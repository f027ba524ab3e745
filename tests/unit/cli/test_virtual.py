import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import servobus
from servobus import RX28
from unit.cli.conftest import Run
from unit.served import wait_for

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo terminals and signals as on POSIX")


@contextmanager
def served(*args: str, end: signal.Signals = signal.SIGTERM, notes: str = "") -> Iterator[str]:
    """Serve virtual servos from another process, as other programs see them; give the port."""
    command = [sys.executable, "-m", "servobus", "virtual", *args]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        word, _, port = process.stdout.readline().strip().partition(" ")
        try:
            assert word == "ready", process.communicate()
            yield port
        finally:
            process.send_signal(end)
            stdout, stderr = process.communicate(timeout=10)
        assert (process.returncode, stdout, stderr) == (0, "", notes)


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_terminal_with_a_link(tmp_path: Path, load: Callable[..., Any], end: signal.Signals) -> None:
    link = tmp_path / "arm"
    with served("rx28@1-2,7", "--pty", str(link), end=end) as port:
        assert port == str(link)
        assert link.is_symlink()
        found = load("scan", port, "--ids", "0-8", "--family", "dynamixel")
        assert [one["id"] for one in found] == [1, 2, 7]
    assert not link.is_symlink()


def test_a_terminal_without_a_link(load: Callable[..., Any]) -> None:
    with served("lx16a@1,2") as port:
        assert port.startswith("/dev/")
        assert load("read", port, 2, "present_voltage", "--family", "lewansoul")["present_voltage"]["value"] == 7.4


def test_a_tcp_port(load: Callable[..., Any]) -> None:
    with served("rx28@3", "--tcp", "127.0.0.1:0") as port:
        assert port.startswith("socket://127.0.0.1:")
        assert load("read", port, 3, "id", "--family", "dynamixel")["id"]["value"] == 3
        # The speed of a TCP port is set elsewhere: a servo answers at whatever speed, and is one servo nevertheless.
        for options in (("--family", "dynamixel"), ("--family", "dynamixel", "--baud", "all")):
            assert [found["id"] for found in load("scan", port, "--ids", "0-4", *options)] == [3]
        said = {one["check"]: one["what"] for one in load("doctor", port, "--ids", "0-4", "--reads", 10)}
        assert said["servos"] == "RX-28 id 3"


def test_a_tcp_port_needs_no_host() -> None:
    with served("rx28@3", "--tcp", "0") as port:
        assert port.startswith("socket://127.0.0.1:")


def test_twins_are_noted() -> None:
    said = "2 dynamixel servos with id 1: their answers collide, as those of real ones do\n"
    with served("rx28@1,1,2", "lx16a@1", notes=said):
        pass


def test_options_reach_the_servos(tmp_path: Path, load: Callable[..., Any]) -> None:
    state = tmp_path / "state.json"
    options = ("--baud", "1000000", "--voltage", "12V", "--echo", "--state", str(state))
    with served("rx28@1", "rx28@2", *options) as port:
        data = load("read", port, 2, "present_voltage", "--family", "dynamixel", "--baud", "1000000")
        assert data["present_voltage"]["value"] == 12
        with servobus.open(port, bauds=1000000) as bus:
            bus.find(1, family="dynamixel").write(RX28.max_torque, 0.5)
            assert bus.echo is True
    assert json.loads(state.read_text())["servos"]


def test_a_stale_link_is_replaced_and_one_in_use_is_not(tmp_path: Path, refused: Callable[..., str]) -> None:
    link = tmp_path / "arm"
    link.symlink_to("/dev/pts/99999")
    with served("rx28@1", "--pty", str(link)) as port:
        assert "is served by another program" in refused("virtual", "rx28@1", "--pty", port)
        assert link.exists()


def test_what_cannot_be_served(refused: Callable[..., str], tmp_path: Path) -> None:
    assert "no model 'rx29'" in refused("virtual", "rx29@1")
    assert "ids" in refused("virtual", "rx28@x")
    assert "254" in refused("virtual", "rx28@254")
    assert "write [HOST:]PORT" in refused("virtual", "rx28@1", "--tcp", "here", code=2)
    assert "write [HOST:]PORT" in refused("virtual", "rx28@1", "--tcp", "h:70000", code=2)
    assert "--voltage" in refused("virtual", "rx28@1", "--voltage", "much", code=2)
    assert "either --pty or --tcp" in refused("virtual", "rx28@1", "--pty", "a", "--tcp", "1", code=2)
    assert "not all" in refused("virtual", "rx28@1", "--baud", "all", code=2)
    taken = tmp_path / "file"
    taken.write_text("mine")
    assert "is no link" in refused("virtual", "rx28@1", "--pty", taken)
    assert taken.read_text() == "mine"
    (tmp_path / "state").write_text("{}")
    assert "state" in refused("virtual", "rx28@1", "--state", tmp_path / "state")


def test_demo(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("servobus.cli.demo_motion.APPROACH", 0.6)
    text = run("demo", "--seconds", "0.5").stdout
    for title in ("RX-28 id 4", "DRS-0602 id 220", "LX-16A id 3"):
        assert f"{title} at " in text
        assert any(line.strip().startswith(title) and line.endswith("torque off") for line in text.splitlines())
    assert "Torque is off." in text
    assert "servobus move /dev/ttyUSB0" in text
    assert "servobus scan /dev/pts/" in text or "servobus scan virtual:" in text or "/dev/tty" in text


def test_demo_of_a_robot(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("servobus.cli.demo_robot.PARKING", 1.0)
    text = run("demo", "robot", "--seconds", "1.2").stdout
    assert text.count(": all servos are there") == 2
    assert "  ready left /" in text
    assert " s  following base " in text
    assert "The follower is back at rest, its torque is off." in text


def test_demo_length(refused: Callable[..., str]) -> None:
    assert "--seconds 0 is not in" in refused("demo", "--seconds", "0", code=2)
    assert "--seconds nan is not in" in refused("demo", "--seconds", "nan", code=2)


def test_P3_the_adapter_is_chosen_by_an_option(load: Callable[..., Any], run: Run) -> None:
    with served("lx16a@1", "--adapter", "usb:16ms") as port, servobus.open(port) as bus:
        arm = bus.find(1, family="lewansoul")
        start = bus.transport.now()
        arm.ping()
        assert bus.transport.now() - start >= 0.016
    said = run("virtual", "lx16a@1", "--adapter", "ftdi", code=2)
    assert "whole, none, usb" in said.stderr


def test_M13_the_cases_have_a_temperature(load: Callable[..., Any]) -> None:
    with served("rx28@1", "--temperature", "60") as port:
        assert load("read", port, 1, "present_temperature")["present_temperature"]["value"] == 60


def test_M13_a_port_for_other_programs_has_no_virtual_clock(refused: Callable[..., str]) -> None:
    for words in (["--clock", "virtual"], ["--clock", "virtual", "--tcp", "0"]):
        assert "wait by their own clocks" in refused("virtual", "rx28@1", *words)
    for spec in ("rx28@1?clock=virtual", "virtual:rx28@1?clock=virtual", "rx28@1?voltage=11&clock=virtual"):
        assert "wait by their own clocks" in refused("virtual", spec, code=2)
    assert "is an option here" in refused("virtual", "rx28@1?voltage=11", code=2)
    assert "of the whole port: ?clock=... behind a port's name" in refused("virtual", "rx28@1,clock=virtual", code=1)
    assert "?supply_resistance=" in refused("info", "virtual:rx28@1,supply_resistance=1", 1)


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", "<&- >&- 2>&-"])
def test_polish_closed_streams_are_no_reason_to_fail(closed: str, tmp_path: Path) -> None:
    link = tmp_path / "servos"
    command = f"exec {shlex.quote(sys.executable)} -m servobus virtual rx28@1 --pty {link} {closed}"
    with subprocess.Popen(["sh", "-c", command], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE) as server:
        try:
            wait_for(link.is_symlink)
            with servobus.open(str(link)) as bus:
                assert bus.find(1).id == 1
            assert server.poll() is None
        finally:
            server.send_signal(signal.SIGINT)
            said = server.communicate(timeout=30)[1]
    assert b"Traceback" not in said
