import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import pytest

from servobus import RX28, deg
from servobus.cli.virtual_console import HELP, VirtualConsole, describe, read_commands
from servobus.virtual.physics.motor import Load
from servobus.virtual.serve.rig import Rig, build_rig
from servobus.virtual.serve.spec import Setup, parse_specs

posix = pytest.mark.skipif(os.name != "posix", reason="pseudo terminals and pipes as on POSIX")


class Desk:
    """A rig and a console for it; the clock is at 1 s."""

    def __init__(self, specs: str = "rx28@1-3,lx16a@1") -> None:
        self.rig: Rig = build_rig(Setup(parse_specs(specs)))
        self.said: list[str] = []
        self.console = VirtualConsole(self.rig, self.said.append)

    def type(self, line: str) -> str:
        self.console.execute(line)
        assert self.rig.receive(1.0) == b""
        return self.said[-1]


def test_loads() -> None:
    desk = Desk()
    first, second, third, small = desk.rig.servos
    assert desk.type("load 2 mass=0.2 length=0.1") == "RX-28 id 2: load mass 0.2 kg, length 0.1 m"
    assert second.shaft.load == Load(mass=0.2, length=0.1)
    assert desk.type("load 2 torque=-0.5,down=90") == (
        "RX-28 id 2: load mass 0.2 kg, length 0.1 m, torque -0.5 N·m, down 90.0°"
    )
    assert second.shaft.load == Load(mass=0.2, length=0.1, torque=-0.5, down=90 * deg)
    assert desk.type("load 2") == desk.said[-1] == describe_of(second.shaft.load)
    assert desk.type("load 2 none") == "RX-28 id 2: load none"
    assert [one.shaft.load for one in (first, second, third, small)] == [Load()] * 4


def describe_of(load: Load) -> str:
    return f"RX-28 id 2: {describe(load)}"


def test_whom_it_is_about() -> None:
    desk = Desk()
    first, second, third, small = desk.rig.servos
    desk.type("block 1")
    assert [one.shaft.load.blocked for one in (first, second, third, small)] == [1, 0, 0, 1]
    desk.type("release rx28@1")
    assert [one.shaft.load.blocked for one in (first, second, third, small)] == [0, 0, 0, 1]
    desk.type("block 2-3")
    assert [one.shaft.load.blocked for one in (first, second, third, small)] == [0, 1, 1, 1]
    desk.type("RELEASE all")
    assert [one.shaft.load.blocked for one in (first, second, third, small)] == [0, 0, 0, 0]


def test_what_surrounds_them() -> None:
    desk = Desk()
    assert desk.type("voltage 11") == "4 servos: supply 11.0 V"
    assert {one.voltage for one in desk.rig.servos} == {11.0}
    assert desk.type("temperature 3 80C") == "RX-28 id 3: 80 °C"
    assert [one.temperature for one in desk.rig.servos] == [25.0, 25.0, 80.0, 25.0]
    assert desk.type("turn lx16a@1 60") == "LX-16A id 1: at 60.0°"
    assert desk.rig.servos[3].position == 60 * deg
    assert desk.type("help") == HELP


@pytest.mark.parametrize(
    ("line", "because"),
    [
        ("dance", "`help` lists them"),
        ("load 1 mass=1e9", "more than 1000"),
        ("load 1 torque=-1e9", "more than 10000"),
        ("load 1 inertia=1e5", "more than 1000"),
        ("load 1 length=1km", ""),
        ("load 1 down=1e9", "more than"),
        ("turn 1 1e9", "is not in -36000.0° .. 36000.0°"),
        ("turn 1 -1e9", "is not in"),
        ("turn 1 nan", ""),
        ("block 9", "there is no servo 9"),
        ("block x", "is no id"),
        ("block rx29@1", "no model"),
        ("voltage 300", "not in 0 .. 30"),
        ("voltage -1", "not in 0 .. 30"),
        ("voltage much", "is not a number"),
        ("temperature 1 5000", "not in"),
        ("load 1 mass=-1", "cannot be negative"),
        ("load 1 weight=1", "a load has inertia, mass"),
        ("load 1 mass=1lb", "is not a unit"),
        ("load 1 blocked=maybe", "neither on nor off"),
        ("load 1 mass=1e999", "no number to reckon with"),
    ],
)
def test_what_makes_no_sense_is_said_and_changes_nothing(line: str, because: str) -> None:
    desk = Desk()
    before = [(one.shaft.load, one.voltage, one.temperature) for one in desk.rig.servos]
    said = desk.type(line)
    assert said.startswith(f"{line}: ")
    assert because in said
    assert [(one.shaft.load, one.voltage, one.temperature) for one in desk.rig.servos] == before


@pytest.mark.parametrize(
    ("line", "takes"),
    [
        ("block", "block takes servos, such as `block 1`"),
        ("block 1 2", "block takes servos"),
        ("release", "release takes servos"),
        ("load", "load takes servos, and what hangs on them"),
        ("turn", "turn takes servos and an angle in degrees"),
        ("turn 1", "turn takes servos and an angle in degrees"),
        ("voltage", "voltage takes a supply in V, such as `voltage 11`"),
        ("voltage 1 2", "voltage takes a supply in V"),
        ("VOLTAGE", "voltage takes a supply in V"),
        ("temperature 80", "temperature takes servos and degrees Celsius"),
        ("options", "options takes servos"),
        ("unplug", "unplug takes servos, such as `unplug 3`"),
        ("plug", "plug takes servos"),
    ],
)
def test_M9_what_is_missing_is_named(line: str, takes: str) -> None:
    desk = Desk()
    before = [(one.shaft.load, one.voltage, one.temperature, one.powered) for one in desk.rig.servos]
    assert desk.type(line).startswith(f"{line}: {takes}")
    assert [(one.shaft.load, one.voltage, one.temperature, one.powered) for one in desk.rig.servos] == before


def ping(desk: Desk, id: int, now: float) -> bytes:
    desk.rig.send(RX28.family.ping(id).request, now)
    return desk.rig.receive(now + 0.1)


def test_M9_servos_are_unplugged_and_plugged_in_again() -> None:
    desk = Desk("rx28@1-3")
    assert ping(desk, 3, 1.0)
    assert desk.type("unplug 2-3") == "RX-28 id 2, RX-28 id 3: off the bus"
    assert [one.powered for one in desk.rig.servos] == [True, False, False]
    assert not ping(desk, 3, 2.0)
    assert ping(desk, 1, 3.0)
    desk.type("unplug 3")
    assert desk.type("plug 3") == "RX-28 id 3: on the bus"
    assert ping(desk, 3, 4.0)
    assert not ping(desk, 2, 5.0)
    desk.type("faults none")  # mends faults, and is no hand that plugs
    assert not ping(desk, 2, 6.0)
    assert "there is no servo 9" in desk.type("unplug 9")


def test_M9_plugging_in_what_is_plugged_in_changes_nothing() -> None:
    desk = Desk("rx28@1")
    desk.rig.servos[0].memory[RX28.led] = 1
    desk.type("plug 1")
    assert desk.rig.servos[0].memory[RX28.led] == 1
    desk.type("unplug all")
    desk.type("plug all")
    assert desk.rig.servos[0].memory[RX28.led] == 0


def test_M9_faults_begin_and_end_while_servos_are_served() -> None:
    desk = Desk("rx28@1")
    assert desk.type("faults") == "faults: none has happened"
    assert desk.type("faults mute") == "faults: mute from now on"
    assert not ping(desk, 1, 1.0)
    assert desk.type("faults") == "faults: mute 1"
    assert desk.type("faults seed=7 drop@3#2, late=0.0") == "faults: seed=7 drop@3#2, late=0.0 from now on"
    assert len(ping(desk, 1, 2.0)) == 6
    assert len(ping(desk, 1, 3.0)) == 5
    for wrong in ("faults rain", "faults mute=2"):
        assert desk.type(wrong).startswith(f"{wrong}: ")
        assert desk.rig.faults.faults
    assert "KIND[@WHERE]" in desk.type("faults help")
    assert desk.type("faults none") == "faults: none from now on"
    assert len(ping(desk, 1, 4.0)) == 6


def test_empty_lines_are_nothing() -> None:
    desk = Desk()
    desk.console.execute("   ")
    desk.rig.receive(1.0)
    assert desk.said == []


def test_a_held_shaft_cannot_be_turned() -> None:
    desk = Desk("lx16a@1")
    desk.rig.servos[0].memory[desk.rig.servos[0].row("torque_enable")] = 1
    desk.rig.advance(0.5)
    assert "holds its shaft" in desk.type("turn 1 10")


def test_things_happen_at_the_time_of_the_bus() -> None:
    desk = Desk("lx16a@1")
    (servo,) = desk.rig.servos
    desk.console.execute("voltage 5")
    assert servo.time == 0.0
    assert desk.rig.next_look() == float("-inf")  # whoever serves comes at once
    desk.rig.receive(2.5)
    assert servo.time == 2.5
    assert desk.rig.next_look() is None


@posix
def test_lines_come_from_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    desk = Desk("lx16a@1")
    stop = threading.Event()
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin, os.fdopen(writing, "wb", buffering=0) as pipe:
        monkeypatch.setattr(sys, "stdin", stdin)
        thread = read_commands(desk.console, stop)
        assert thread is not None
        pipe.write(b"voltage 6\nvolt")
        until(lambda: desk.rig.next_look() is not None)
        desk.rig.receive(1.0)
        assert desk.rig.servos[0].voltage == 6.0
        pipe.write(b"age 7")
        pipe.close()  # the last line needs no end
        thread.join(5)
        assert not thread.is_alive()
        desk.rig.receive(2.0)
        assert desk.rig.servos[0].voltage == 7.0
    monkeypatch.setattr(sys, "stdin", None)
    assert read_commands(desk.console, stop) is None


@posix
def test_the_reader_ends_with_the_servos(monkeypatch: pytest.MonkeyPatch) -> None:
    stop = threading.Event()
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin, os.fdopen(writing, "wb"):
        monkeypatch.setattr(sys, "stdin", stdin)
        thread = read_commands(Desk("lx16a@1").console, stop)
        assert thread is not None
        stop.set()
        thread.join(5)
        assert not thread.is_alive()


def until(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 5
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.005)


@posix
def test_a_server_obeys_and_outlives_its_input() -> None:
    command = [sys.executable, "-m", "servobus", "virtual", "lx16a@1", "--supply-resistance", "0.5"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as process:  # type: ignore[call-overload]
        assert process.stdout.readline().startswith("ready /dev/")
        process.stdin.write("load 1 torque=0.5\nnonsense\nvoltage 8\n")
        process.stdin.close()
        said = [process.stderr.readline() for _ in range(3)]
        assert said[0] == "LX-16A id 1: load torque 0.5 N·m\n"
        assert said[1].startswith("nonsense: ")
        assert said[2] == "LX-16A id 1: supply 8.0 V\n"
        time.sleep(0.3)
        assert process.poll() is None
        process.terminate()
        assert process.wait(10) == 0
        assert process.stderr.read() == ""
