"""A handle to virtual servos that are served to other programs."""

import math
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import servobus
from samples import one_model_of_each_family
from servobus import deg
from servobus.errors import BadValue, NoReply, PortError, PortLost, ServobusError, UnknownName, UsageError
from servobus.virtual.physics.motor import Load
from servobus.virtual.serve.background import ServedPort, serve
from servobus.virtual.serve.ports import PtyPort, TcpPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url
from unit.served import wait_for

posix = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo terminals on Windows")
pytestmark = posix


@pytest.fixture
def port() -> Iterator[ServedPort]:
    with serve("virtual:rx28@1-3,lx16a@1") as port:
        yield port


def test_M9_the_handle_is_the_name(port: ServedPort) -> None:
    assert isinstance(port, str)
    assert os.path.realpath(port).startswith("/dev/")
    assert Path(port).is_symlink()
    assert f"{port}" == port == str(port)
    with servobus.open(port) as bus:
        assert bus.find(2).id == 2
    folder = Path(port).parent
    assert folder.exists()


def test_M9_nothing_is_left_of_it() -> None:
    before = threading.active_count()
    with serve("virtual:rx28@1") as port:
        assert threading.active_count() == before + 1
    assert threading.active_count() == before
    assert not Path(port).parent.exists()
    with pytest.raises(PortError, match="no longer served"):
        port.inject(None)


@one_model_of_each_family
def test_M9_the_truth_of_a_servo(key: str) -> None:
    with serve(f"virtual:{key}@5,6") as port, servobus.open(port) as bus:
        arm, real = bus.find(5), port.servo(5)
        real.turn(100 * deg)
        assert real.angle == pytest.approx(100 * deg)
        assert arm.read("present_position") == pytest.approx(100 * deg, abs=1 * deg)
        assert not real.torque
        with arm.torque():
            assert real.look().torque
            with pytest.raises(UsageError, match="holds its shaft"):
                real.turn(0.0)
            real.block()
            before = real.angle
            arm.move(140 * deg, time=0.3)
            wait_for(lambda: abs(real.look().current) > 0)
            assert real.angle == pytest.approx(before, abs=1e-6)
            real.release()
            wait_for(lambda: abs(real.angle - 140 * deg) < 5 * deg)
        assert not real.torque
        real.temperature = 60
        assert real.temperature == pytest.approx(60, abs=1)
        real.voltage = 7.0
        assert real.voltage == pytest.approx(7.0, abs=0.1)
        real.load = "mass=0.1,length=0.05"
        assert real.load == Load(mass=0.1, length=0.05)
        real.load = Load()
        assert real.load == Load()
        assert real.do(lambda servo: servo.get("id")) == 5


def test_M9_which_servo(port: ServedPort) -> None:
    assert [servo.id for servo in port.servos] == [1, 2, 3, 1]
    assert port.servo(2).model is servobus.RX28
    assert port.servo(1, "lx16a").model is port.servo(1, servobus.LX16A).model is servobus.LX16A
    with pytest.raises(UsageError, match=r"several servos are id 1.*servo\(1, 'rx28'\)"):
        port.servo(1)
    with pytest.raises(UnknownName, match="no servo id 9 here; there are rx28@1, rx28@2"):
        port.servo(9)
    with pytest.raises(UnknownName, match="no servo drs0602@1"):
        port.servo(1, "drs0602")
    with pytest.raises(UnknownName, match="no servo id 9"):
        port.unplug(1, 9)
    assert all(servo.powered for servo in port.servos)


def test_M9_off_the_bus_and_on_it_again(port: ServedPort) -> None:
    with servobus.open(port) as bus:
        two, three = (bus.attach(servobus.RX28, id) for id in (2, 3))
        port.unplug(3)
        assert [servo.powered for servo in port.servos] == [True, True, False, True]
        two.ping()
        with pytest.raises(NoReply):
            three.ping()
        port.plug()
        three.ping()
        port.servo(2).unplug()
        with pytest.raises(NoReply):
            two.ping()
        port.servo(2).plug()
        two.ping()


def test_M9_faults_begin_later_and_end(port: ServedPort) -> None:
    with servobus.open(port) as bus:
        two = bus.find(2)
        port.inject("mute#1")
        bus.attach(servobus.RX28, 3)
        two.ping()
        assert port.fault_counts["mute"] == 1
        assert [one.kind for one in port.injected] == ["mute"]
        with pytest.raises(BadValue):
            port.inject("rain")
        port.inject(None)
        assert not port.fault_counts


@pytest.mark.parametrize("tcp", [False, True])
def test_M9_a_port_that_is_gone_comes_back_under_its_name(tcp: bool) -> None:
    with serve("virtual:rx28@1", tcp=tcp) as port:
        with servobus.open(port) as bus:
            arm = bus.find(1)
            port.inject("gone#0s")
            with pytest.raises((PortLost, PortError, NoReply)):
                for _ in range(50):
                    arm.ping()
            with pytest.raises(ServobusError):
                servobus.open(port)
            assert port.servo(1).angle > 0  # the servos are there all the while
            port.inject(None)
        back = None
        for _ in range(200):
            try:
                back = servobus.open(port)
                break
            except PortError:
                threading.Event().wait(0.02)
        assert back is not None
        with back:
            assert back.find(1).id == 1


def test_M9_from_many_threads(port: ServedPort) -> None:
    wrong: list[BaseException] = []

    def use(id: int) -> None:
        try:
            for n in range(20):
                port.servo(id).turn(n * deg)
                assert port.servo(id).angle == pytest.approx(n * deg)
                port.inject("jitter=1ms" if n % 2 else None)
        except BaseException as error:  # noqa: BLE001
            wrong.append(error)

    threads = [threading.Thread(target=use, args=[id]) for id in (2, 3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert wrong == []


@pytest.mark.parametrize("angle", [1e9, -1e9, math.inf, math.nan])
def test_M9_what_makes_no_sense_changes_nothing(port: ServedPort, angle: float) -> None:
    real = port.servo(2)
    before = real.look()
    with pytest.raises(BadValue):
        real.turn(angle)
    for name, value in (("temperature", angle), ("voltage", angle), ("load", "mass=1e9")):
        with pytest.raises(BadValue):
            setattr(real, name, value)
    after = real.look()
    assert (before.angle, before.temperature, before.voltage) == (after.angle, after.temperature, after.voltage)
    assert real.load == Load()


@pytest.mark.parametrize("kind", [PtyPort, TcpPort])
def test_M13_a_port_for_other_programs_has_no_virtual_clock(kind: type[PtyPort | TcpPort]) -> None:
    with pytest.raises(UsageError, match="wait by their own clocks"):
        kind(build_rig(parse_url("virtual:rx28@1?clock=virtual")))
    with pytest.raises(UsageError, match="wait by their own clocks"), serve("virtual:rx28@1?clock=virtual"):
        pass
