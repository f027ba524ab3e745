"""servobus itself drives virtual servos that are served like any other port."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

import servobus
from clients.conftest import Servers
from servobus.core.units import deg
from servobus.families.registry import LX16A, RX28

Serve = Callable[..., str]
LINKS = {"pty": (), "tcp": ("--tcp", "127.0.0.1:0")}


@contextmanager
def opened(name: str, bauds: int | None = None) -> Iterator[servobus.Bus]:
    with servobus.open(name, bauds=bauds) as bus:
        bus.transport.latency = 0.1  # on a busy computer the process of the servos may be late
        yield bus


@pytest.mark.parametrize("link", LINKS)
def test_two_families_behind_one_port(serve: Serve, link: str) -> None:
    with opened(serve("rx28@1-2,lx16a@3", "--baud", "115200", *LINKS[link]), bauds=115_200) as bus:
        bus.models = "lx16a"
        for id, model in ((1, RX28), (2, RX28), (3, LX16A)):
            assert bus.find(id, family=model.family).model is model
        with bus.torque():
            goals = {1: 60 * deg, 2: 200 * deg, 3: 180 * deg}
            bus.move(goals, time=0.4).wait()
            assert bus.read_all("present_position").by_id() == pytest.approx(goals, abs=0.3 * deg)
        bus[3].write(LX16A.led, False)
        assert bus[3].read(LX16A.led) is False
        bus[1].change_id(4)
        assert bus.find(4, family=RX28.family).model is RX28


def test_a_port_that_gives_back_what_is_sent(serve: Serve) -> None:
    with opened(serve("lx16a@7", "--echo")) as bus:
        servo = bus.find(7, family=LX16A.family)
        with servo.torque():
            servo.move(150 * deg, time=0.3).wait()
            assert servo.read(LX16A.present_position) == pytest.approx(150 * deg)


def test_servos_that_remember(serve: Servers, tmp_path_factory: pytest.TempPathFactory) -> None:
    state = str(tmp_path_factory.mktemp("state") / "arm.json")
    with opened(serve("lx16a@7", "--state", state)) as bus:
        bus.find(7, family=LX16A.family).change_id(8)
        bus[8].write(LX16A.max_temperature, 70.0)
        assert bus[8].read(LX16A.max_temperature) == 70.0
    serve.end()  # a state file belongs to one server at a time
    with opened(serve("lx16a@7", "--state", state)) as bus:
        assert bus.find(8, family=LX16A.family).read(LX16A.max_temperature) == 70.0
