"""Ports that go away and ports that are taken (F16, F17), and a cross-section of faults through the system."""

import asyncio
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from inspect import isawaitable
from pathlib import Path
from typing import Any

import pytest

import servobus
from faults.rig import ALTERING, POSITION, FaultRig
from samples import goal_range, one_model_of_each_family, sample_models, sample_of
from servobus import MODELS, RX28, BusError, PortError
from servobus.errors import PortLost
from servobus.virtual.serve.ports import Port, PtyPort, TcpPort
from servobus.virtual.serve.rig import Rig, build_rig
from servobus.virtual.serve.spec import parse_url
from unit.lossy import ASYNC, DRIVERS, SYNC
from unit.served import served

PROMPT = 3.0
"""s; far more than anything here takes, far less than for ever."""
needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo terminals on Windows")


@DRIVERS
@sample_models
@pytest.mark.parametrize("when", ["gone@read#2:20ms", "gone@write#2:20ms", "gone#2s:20ms"])
def test_F16_a_port_that_goes_away_raises_at_once(key: str, when: str, driver: str) -> None:
    """While reading, while writing or while nobody does either: PortLost, no value, no waiting; opened again, all is
    as before."""
    rig = FaultRig(key, driver)
    rig.inject(when)
    assert rig.try_position() == "right"
    if when.startswith("gone#2s"):
        rig.port.sleep(2.01)
    start = rig.port.now()
    for _ in range(2):
        with pytest.raises(PortLost):
            rig.read()
    assert rig.port.now() - start < 0.5
    rig.port.sleep(0.05)
    assert rig.do(lambda bus: bus.reopen()) == {1: "present", 2: "present", 3: "present"}
    rig.inject(None)
    assert [rig.try_position() for _ in range(2)] == ["right", "right"]
    rig.bus.close()
    rig.bus.close()


class Served:
    """A real port with virtual servos behind it, and either driver; all in one event loop."""

    def __init__(self, name: str, driver: str) -> None:
        self.bus: Any = servobus.open(name) if driver == SYNC else servobus.open_async(name)
        self.loop = asyncio.new_event_loop()

    def do(self, job: Callable[[Any], Any]) -> Any:
        async def wait() -> Any:
            done = job(self.bus)
            return await done if isawaitable(done) else done

        return self.loop.run_until_complete(wait())

    def close(self) -> None:
        self.bus.close()
        self.loop.close()


@contextmanager
def client(name: str, driver: str) -> Iterator[Served]:
    made = Served(name, driver)
    try:
        yield made
    finally:
        made.close()


@needs_pty
@DRIVERS
def test_F16_a_terminal_that_hangs_up_and_comes_back(driver: str, tmp_path: Path) -> None:
    """Through the system: PortLost at once, `reopen` finds the port under its name again, and reads are right."""
    servos_rig = build_rig(parse_url("virtual:rx28@1?faults=gone#3:200ms"))
    link = tmp_path / "arm"
    with served(PtyPort(servos_rig, link)), client(str(link), driver) as made:
        servo = made.bus.attach(RX28, 1)
        with pytest.raises(PortLost):
            for _ in range(5):
                made.do(lambda _: servo.ping())
        start = time.monotonic()
        with pytest.raises(PortError):
            made.do(lambda _: servo.ping())
        assert time.monotonic() - start < PROMPT
        deadline = time.monotonic() + PROMPT
        while True:
            try:
                made.bus.transport.reopen()
                break
            except PortError:
                assert time.monotonic() < deadline
                time.sleep(0.02)
        made.do(lambda _: servo.ping())


@needs_pty
@DRIVERS
def test_F17_a_port_in_use_is_refused_and_its_holder_named(driver: str) -> None:
    """A second program on the port: PortError with the name and number of the first, before a byte is sent."""
    with served(PtyPort(build_rig(parse_url("virtual:rx28@1")))) as port:
        holder = "import sys, servobus; bus = servobus.open(sys.argv[1]); print('ready', flush=True); sys.stdin.read()"
        command = [sys.executable, "-c", holder, port.name]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            with pytest.raises(PortError, match=f"in use by .*{process.pid}"):
                Served(port.name, driver)
            process.communicate("")
        with client(port.name, driver) as made:  # it is free again
            made.do(lambda bus: bus.attach(RX28, 1).ping())


CHANGED = "drop=0.06,flip=0.06,junk=0.06:1-16,split=0.06:2ms"
LOST = "mute=0.05,deaf=0.05,stranger=0.05,stall=0.03:60ms,glue=0.03"
READS = 16


def turn(servos_rig: Rig, raw: int) -> None:
    """Turn the shaft by hand, between two events of the line, and wait until that is done."""
    done = threading.Event()
    real = servos_rig.servos[0]

    def act(now: float) -> None:
        servos_rig.advance(now)
        real.turn_shaft(real.model.register(POSITION).decode(raw))
        done.set()

    servos_rig.post(act)
    assert done.wait(PROMPT)


@pytest.mark.parametrize(("kind", "driver"), [pytest.param(PtyPort, SYNC, marks=needs_pty), (TcpPort, ASYNC)])
@one_model_of_each_family
def test_F7_through_the_system_no_value_is_wrong(key: str, driver: str, kind: type[Port]) -> None:
    """A mix of faults through a pseudo terminal and through TCP, on the real clock: each value is the one that the
    servo had when it was asked, or there is an exception; and afterwards all is well."""
    row, (low, _) = MODELS[key].register(POSITION), goal_range(MODELS[key])
    servos_rig = build_rig(parse_url(f"virtual:{key}@1"))
    with served(kind(servos_rig)) as port, client(port.name, driver) as made:
        servo = made.bus.attach(MODELS[key], 1)
        made.do(lambda _: servo.ping())
        servos_rig.post(lambda now: servos_rig.inject(f"seed=5,{CHANGED},{LOST}", now))
        heard: list[bytes] = []
        read = made.bus.transport.read

        def tapped(timeout: float) -> bytes:
            data: bytes = read(timeout)
            heard.append(data)
            return data

        made.bus.transport.read = tapped
        right = 0
        for number in range(READS + 8):
            if number == READS:
                servos_rig.post(lambda now: servos_rig.inject(None, now))
            raw = low + number * 397 % 1000
            turn(servos_rig, raw)
            heard.clear()
            hits = servos_rig.fault_counts
            try:
                value = row.scale.encode(made.do(lambda _: servo.read(row)))
            except BusError:
                assert number < READS + 4
                continue
            right += value == raw
            altered = any(servos_rig.fault_counts[kind] > hits[kind] for kind in ALTERING)
            provable = altered and value in sample_of(key).positions(1, b"".join(heard))  # nobody could know
            assert value == raw or provable
        assert right > READS // 2


@pytest.mark.parametrize("driver", [SYNC, ASYNC])
def test_F16_a_closed_connection_is_taken_again(driver: str) -> None:
    """Over TCP: the other end closes, PortLost; `reopen` connects anew."""
    servos_rig = build_rig(parse_url("virtual:rx28@1?faults=gone#3:100ms"))
    with served(TcpPort(servos_rig)) as port, client(port.name, driver) as made:
        servo = made.bus.attach(RX28, 1)
        with pytest.raises(PortLost):
            for _ in range(5):
                made.do(lambda _: servo.ping())
        deadline = time.monotonic() + PROMPT
        while True:
            try:
                made.bus.transport.reopen()
                made.do(lambda _: servo.ping())
                break
            except (PortError, BusError):
                assert time.monotonic() < deadline
                time.sleep(0.02)
