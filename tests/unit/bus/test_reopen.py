"""A port that goes away and comes back (F16), and servos that are met again: what is known of them stays."""

import asyncio
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import servobus
from samples import sample_models
from servobus import LX16A, MODELS, RX28, PortError, PortLost, Restarted, TorqueOff, UsageError, deg
from servobus.bus.blocking import BusServo
from servobus.bus.reconnect import ReconnectReport
from servobus.families.base import Answers
from servobus.virtual.serve.inprocess import VirtualPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import parse_url
from unit.lossy import ASYNC, SYNC
from unit.served import PATIENCE, wait_for

DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])
Job = Callable[[Any], Any]
ALL = "rx28@1-2,drs0602@3,lx16a@4"


class Port:
    """A bus of virtual servos on a virtual clock, with either driver."""

    def __init__(self, spec: str, driver: str, **options: Any) -> None:
        opener: Any = servobus.open if driver == SYNC else servobus.open_async
        self.bus = opener(f"virtual:{spec}?clock=virtual", **options)
        self.line: VirtualPort = self.bus.transport
        self._driver = driver

    def do(self, job: Job) -> Any:
        if self._driver == SYNC:
            return job(self.bus)

        async def main() -> Any:
            return await job(self.bus)

        return asyncio.run(main())

    @staticmethod
    def on(number: int, job: Job) -> Job:
        """Make a job for a bus of one for its servo with this id."""
        return lambda bus: job(bus[number])

    def know(self, *ids: int) -> None:
        for servo in self.line.rig.servos:
            if servo.id in ids:
                self.bus.attach(servo.model, servo.id)

    def lose(self, kind: str = "gone@read#1") -> None:
        """Have the port go away with the next request, for 0.1 s."""
        self.line.inject(f"{kind}:0.1s")
        with pytest.raises(PortLost):
            self.do(lambda bus: bus.read_all("present_position"))
        with pytest.raises(PortError):
            self.do(lambda bus: bus.read_all("present_position"))
        self.line.sleep(0.2)
        self.line.inject(None)
        with pytest.raises(PortLost):  # it stays lost until somebody asks for it
            self.do(lambda bus: bus.read_all("present_position"))


@DRIVERS
@pytest.mark.parametrize("kind", ["gone@read#1", "gone@write#1"])
def test_after_reopening_everybody_is_there_and_answers(driver: str, kind: str) -> None:
    port = Port(ALL, driver)
    port.know(1, 2, 3, 4)
    before = port.do(lambda bus: bus.read_all("present_position"))
    port.lose(kind)
    assert repr(port.do(lambda bus: bus.reopen())) == "ReconnectReport(present=(1, 2, 3, 4), missing=(), restarted=())"
    assert port.do(lambda bus: bus.read_all("present_position")) == before


@DRIVERS
def test_who_is_missing_and_who_restarted_is_told(driver: str) -> None:
    port = Port(ALL, driver)
    port.know(1, 2, 3, 4)
    for number in (1, 3, 4):
        port.do(port.on(number, lambda servo: servo.torque_on()))
    port.lose()
    rx28, gone, drs0602, _ = port.line.servos
    gone.power_off()
    for servo in (rx28, drs0602):
        servo.power_off()
        servo.power_on(port.line.now())
    port.line.sleep(0.1)
    assert (
        repr(port.do(lambda bus: bus.reopen())) == "ReconnectReport(present=(1, 3, 4), missing=(2,), restarted=(1, 3))"
    )
    assert [port.bus[id].restarted for id in (1, 2, 3, 4)] == [True, False, True, False]
    for number in (1, 3):
        with pytest.raises(TorqueOff):
            port.do(port.on(number, lambda servo: servo.start_move(10 * deg, time=1.0)))
    with pytest.raises(Restarted):
        port.do(lambda bus: bus[1].write(RX28.goal_position, 1.0))
    port.do(lambda bus: bus[4].start_move(100 * deg, time=1.0))


@DRIVERS
def test_one_that_answers_a_ping_and_then_no_more_is_missing(driver: str) -> None:
    port = Port("lx16a@1", driver)
    port.know(1)
    port.do(lambda bus: bus[1].torque_on())
    port.lose()
    port.line.inject("mute#2-")
    assert repr(port.do(lambda bus: bus.reopen())) == "ReconnectReport(present=(), missing=(1,), restarted=())"


@DRIVERS
def test_an_answer_of_the_old_port_is_none_on_the_new_one(driver: str) -> None:
    """And what was known of the line is found out anew: the new adapter may echo."""
    port = Port("rx28@1", driver)
    port.know(1)
    port.do(lambda bus: bus[1].look())
    assert not port.bus.echo
    old = port.bus.link
    sent = port.bus.stats.total.sent
    port.lose()
    assert old.log.late_replies
    port.line.rig.lines[0].echo = True
    port.do(lambda bus: bus.reopen())
    assert port.bus.echo is True
    assert port.bus.link is not old
    assert port.bus.stats.total.sent > sent  # the counters go on
    assert port.do(lambda bus: bus[1].read(RX28.present_temperature)) == 25.0


@DRIVERS
def test_what_the_user_said_of_the_echo_still_holds(driver: str) -> None:
    port = Port("rx28@1", driver, echo=False)
    port.know(1)
    port.lose()
    port.do(lambda bus: bus.reopen())
    assert port.bus.echo is False


@DRIVERS
def test_a_port_that_is_not_back_says_so_and_can_be_asked_again(driver: str) -> None:
    port = Port("rx28@1", driver)
    port.know(1)
    port.line.inject("gone#1:1s")
    with pytest.raises(PortLost):
        port.do(lambda bus: bus[1].ping())
    with pytest.raises(PortError):
        port.do(lambda bus: bus.reopen())
    port.line.sleep(2.0)
    assert port.do(lambda bus: bus.reopen()).present == (port.bus[1],)


@DRIVERS
def test_a_port_that_was_closed_can_be_reopened(driver: str) -> None:
    port = Port("rx28@1", driver)
    port.know(1)
    port.bus.close()
    with pytest.raises(PortError):
        port.do(lambda bus: bus[1].ping())
    assert port.do(lambda bus: bus.reopen()).present == (port.bus[1],)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo terminals")
class TestSerial:
    """A pseudo terminal that hangs up and comes back as another one, under the same link."""

    @staticmethod
    def run(tmp_path: Path, job: Callable[[str], None], spec: str = "lx16a@1,2") -> None:
        from servobus.virtual.serve.ports import PtyPort  # noqa: PLC0415 - there is none on Windows

        rig = build_rig(parse_url(f"virtual:{spec}"))
        rig.inject("gone#60:0.3s", 0.0)
        stop = threading.Event()
        with PtyPort(rig, tmp_path / "arm") as port:
            server = threading.Thread(target=port.serve, args=[stop], daemon=True)
            server.start()
            try:
                job(str(tmp_path / "arm"))
            finally:
                stop.set()
                server.join(PATIENCE)

    def test_blocking(self, tmp_path: Path) -> None:
        def job(name: str) -> None:
            with servobus.open(name, echo=False) as bus:
                servos = [bus.attach(LX16A, id) for id in (1, 2)]
                servos[0].torque_on()
                with pytest.raises(PortLost):
                    for _ in range(80):
                        servos[1].ping()
                reports: list[ReconnectReport[BusServo]] = []

                def back() -> bool:
                    try:
                        reports.append(bus.reopen())
                    except PortError:
                        return False
                    return True

                wait_for(back)
                assert reports[0] == {1: "present", 2: "present"}
                servos[0].start_move(100 * deg, time=1.0)

        self.run(tmp_path, job)

    def test_asyncio(self, tmp_path: Path) -> None:
        async def main(name: str) -> None:
            async with servobus.open_async(name, echo=False) as bus:
                servos = [bus.attach(LX16A, id) for id in (1, 2)]
                await servos[0].torque_on()
                with pytest.raises(PortLost):
                    for _ in range(80):
                        await servos[1].ping()
                for _ in range(1000):
                    try:
                        report = await bus.reopen()
                    except PortError:
                        await asyncio.sleep(0.01)
                    else:
                        break
                assert report == {1: "present", 2: "present"}
                await servos[0].start_move(100 * deg, time=1.0)
                await asyncio.gather(*(servo.look() for servo in servos * 5))

        self.run(tmp_path, lambda name: asyncio.run(main(name)))

    def test_what_the_watch_could_not_stop_is_stopped_when_the_port_is_back(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        def job(name: str) -> None:
            with servobus.open(name, echo=False) as bus:
                servo, other = (bus.attach(LX16A, id) for id in (1, 2))
                servo.safe_action = "free"
                servo.torque_on()
                with pytest.raises(PortLost):
                    for _ in range(80):
                        other.ping()
                watch = bus.watch(0.02)
                assert watch.wait(PATIENCE)
                assert "LX-16A id 1 may still move" in caplog.text

                def back() -> bool:
                    try:
                        bus.reopen()
                    except PortError:
                        return False
                    return True

                wait_for(back)
                assert not servo.look().torque

        self.run(tmp_path, job)


# Known servos stay what they are


@DRIVERS
@sample_models
def test_a_scan_keeps_what_is_known_of_a_servo(key: str, driver: str) -> None:
    port = Port(f"{key}@1", driver)
    family = MODELS[key].family.name
    (servo,) = port.do(lambda bus: bus.scan(family=family, ids=[1]))
    servo.max_step = 30 * deg
    servo.safe_action = "free"
    servo.latched = 4
    servo.record.eeprom_writes = 7
    servo.record.restarted = True
    record, permit = servo.record, servo.permit
    (again,) = port.do(lambda bus: bus.scan(family=family, ids=[1]))
    assert again is servo is port.bus[1]
    assert again.record is record is again.target.record
    assert again.permit is permit is again.target.permit
    assert (again.max_step, again.safe_action, again.eeprom_writes, again.restarted) == (30 * deg, "free", 7, True)
    assert again.latched == 4
    assert again.state is not None
    assert port.do(lambda bus: bus.find(1, family=family)) is servo


def test_a_servo_that_is_met_again_follows_where_it_is_now() -> None:
    bus = servobus.open("virtual:rx28@1?clock=virtual&baud=1000000")
    servo = bus.attach(RX28, 1, answers=Answers.READS)
    bus.scan(family="dynamixel", bauds=[1_000_000], ids=[1])
    assert (servo.baud, servo.target.answers) == (1_000_000, Answers.EVERYTHING)
    assert servo.read(RX28.present_temperature) == 25.0


def test_another_model_in_its_place_keeps_what_was_chosen_and_is_still_stopped() -> None:
    class RX28B(RX28):
        title = "RX-28B"

    bus = servobus.open("virtual:rx28@1?clock=virtual")
    servo = bus.attach(RX28, 1)
    servo.max_step, servo.safe_action = 0.5, "free"
    servo.torque_on()
    other = bus.attach(RX28B, 1)
    assert other is not servo
    assert bus[1] is other
    assert (other.max_step, other.safe_action, other.record.ram, other.permit.driven) == (0.5, "free", {}, True)


def test_a_restarted_servo_is_still_held_back_after_a_scan() -> None:
    bus = servobus.open("virtual:rx28@1?clock=virtual")
    servo = bus.attach(RX28, 1)
    servo.torque_on()
    real = bus.transport.servos[0]  # type: ignore[attr-defined]
    real.power_off()
    real.power_on(bus.transport.now())
    with pytest.raises(Restarted):
        servo.verify()
    bus.scan(family="dynamixel", ids=[1])
    with pytest.raises((TorqueOff, UsageError)):
        bus[1].start_move(1.0)
