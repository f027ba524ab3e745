"""Two servos with one id, of two families or at two speeds: none is lost, none gets what is meant for the other."""

import asyncio
import math
from typing import Any

import pytest

import servobus
from servobus import DRS0602, LX16A, RX28, Bus, Restarted, Stopped, UnknownName, UsageError, deg
from servobus.bus.by_servo import ByServo
from servobus.bus.servo import Servo
from servobus.core.registers import Register
from servobus.families.base import Answers
from servobus.families.lewansoul.models.table import UnknownLx
from servobus.virtual.device.servo import VirtualServo
from unit.lossy import ASYNC, SYNC

DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])


def twins(extra: str = "") -> tuple[Bus, Any, Any]:
    """Two RX-28 with id 1 on one line, one at 57600 and one at 1 Mbit/s; gives the virtual ones too."""
    bus = servobus.open(f"virtual:rx28@1,1?clock=virtual{extra}")
    slow, fast = bus.transport.servos  # type: ignore[attr-defined]
    fast.store_baud(1_000_000)
    slow.turn_shaft(200 * deg)
    fast.turn_shaft(20 * deg)
    return bus, slow, fast


class TestTwoSpeeds:
    def test_a_scan_finds_two_objects(self) -> None:
        bus, _, _ = twins()
        slow, fast = bus.scan(bauds=[57_600, 1_000_000], ids=[1])
        assert slow is not fast
        assert (slow.baud, fast.baud) == (57_600, 1_000_000)
        assert [round(servo.look().position / deg) for servo in (slow, fast)] == [200, 20]
        assert bus.scan(bauds=[57_600, 1_000_000], ids=[1]) == [slow, fast] == list(bus)

    def test_an_id_that_two_have_names_both(self) -> None:
        bus, _, _ = twins()
        slow, fast = bus.scan(bauds=[57_600, 1_000_000], ids=[1])
        for wrong in (lambda: bus[1], lambda: bus.read_all("led")[1], lambda: bus.attach(RX28, 1)):
            with pytest.raises(
                UnknownName, match="id 1 is not unique here: RX-28 id 1 at 57600 and RX-28 id 1 at 10000"
            ):
                wrong()
        assert bus[slow] is slow
        assert 1 in bus
        assert slow in bus
        assert bus.attach(RX28, 1, baud=1_000_000) is fast

    def test_what_is_done_with_several_reaches_each(self) -> None:
        bus, real_slow, real_fast = twins()
        slow, fast = bus.scan(bauds=[57_600, 1_000_000], ids=[1])
        seen = bus.read_all("present_position")
        assert [round(angle / deg) for angle in seen.values()] == [200, 20]
        assert (round(seen[slow] / deg), round(seen[fast] / deg)) == (200, 20)
        assert repr(seen).startswith("{RX-28 id 1 at 57600: 3.")
        with bus.torque():
            bus.move({slow: 190 * deg, fast: 30 * deg}).wait()
            assert [round(real.position / deg) for real in (real_slow, real_fast)] == [190, 30]
            assert list(bus.protect()) == [slow, fast]
        assert not real_slow.torque
        assert not real_fast.torque

    def test_alarms_are_those_of_the_one_that_sent_them(self) -> None:
        bus, real_slow, _ = twins()
        slow, fast = bus.scan(bauds=[57_600, 1_000_000], ids=[1])
        real_slow.temperature = 95.0
        for servo in (slow, fast, slow, fast):
            servo.read(RX28.present_temperature)
        assert (bool(slow.alarms), bool(fast.alarms)) == (True, False)
        real_slow.temperature = 25.0
        for servo in (fast, slow):
            servo.read(RX28.present_temperature)
        assert not slow.alarms

    def test_a_cycle_drives_both(self) -> None:
        bus, real_slow, real_fast = twins()
        slow, fast = bus.scan(bauds=[57_600, 1_000_000], ids=[1])
        bus.torque_on()
        cycle = bus.cycle(read=[RX28.present_position], servos=[slow, fast])
        for _ in range(40):
            seen = cycle.run({slow: 190 * deg, fast: 30 * deg})
            bus.transport.sleep(0.05)
        assert [round(seen[servo]["present_position"] / deg) for servo in (slow, fast)] == [190, 30]
        assert [round(real.position / deg) for real in (real_slow, real_fast)] == [190, 30]
        with pytest.raises(UnknownName, match="id 1 is not unique here"):
            cycle.run({1: 100 * deg})
        real_fast.power_off()
        seen = cycle.run()
        assert (list(seen), list(seen.lost)) == ([slow], [fast])
        assert seen.diagnosis == "id 1 (RX-28 id 1 at 1000000) alone does not answer: its plug or its power?"


def real_moves(real: VirtualServo) -> bool:
    """Tell whether a virtual servo still turns its shaft."""
    return abs(real.shaft.state.velocity) > 1 * deg


class TestTwoFamilies:
    def test_results_hold_both(self) -> None:
        bus = servobus.open("virtual:rx28@1,lx16a@1?clock=virtual")
        rx, lx = bus.scan(ids=[1])
        seen = bus.read_all("present_position")
        assert len(bus) == len(seen) == 2
        assert set(seen) == {rx, lx}
        with pytest.raises(
            UnknownName,
            match="not unique here: RX-28 id 1 at 57600 and LX/HTS bus servo, model unknown, id 1 at 115200",
        ):
            seen[1]
        assert list(bus.protect()) == [rx, lx]

    def test_the_reply_of_one_ends_no_alarm_of_the_other(self) -> None:
        bus = servobus.open("virtual:rx28@1,drs0602@1?clock=virtual")
        (rx,), (hx,) = bus.scan(ids=[1], family="dynamixel"), bus.scan(ids=[1], family="herkulex")
        real: Any = bus.transport.servos[0]  # type: ignore[attr-defined]
        real.temperature = 95.0
        rx.read(RX28.present_temperature)
        assert rx.alarms
        hx.read(DRS0602.temperature)
        assert rx.alarms
        real.temperature = 25.0
        rx.read(RX28.present_temperature)
        assert not rx.alarms

    @DRIVERS
    def test_a_move_starts_and_arrives_together(self, driver: str) -> None:
        opener: Any = servobus.open if driver == SYNC else servobus.open_async
        bus = opener("virtual:rx28@1,lx16a@2?clock=virtual")

        async def call(given: Any) -> Any:
            return given if driver == SYNC else await given

        async def main() -> None:
            rx, lx = await call(bus.scan(ids=[1, 2]))
            starts = {servo: servo.state.position for servo in (rx, lx)}
            await call(bus.torque_on())
            planned = await call(bus.start_move({1: starts[rx] + 10 * deg, lx: starts[lx] + 100 * deg}, speed=50 * deg))
            assert [axis.duration for axis in planned.axes] == [pytest.approx(2.0, abs=0.01)] * 2
            began = bus.transport.now()
            bus.transport.sleep(1.0)
            half = {servo.target: real.position for servo, real in zip((rx, lx), bus.transport.servos, strict=True)}
            assert half[rx.target] - starts[rx] == pytest.approx(5 * deg, abs=1.5 * deg)
            assert half[lx.target] - starts[lx] == pytest.approx(50 * deg, abs=15 * deg)
            bus.transport.sleep(began + 1.8 - bus.transport.now())
            assert await call(rx.read(RX28.moving))
            assert real_moves(bus.transport.servos[1])
            bus.transport.sleep(began + 2.2 - bus.transport.now())
            assert await call(bus.wait_arrival(planned, 0.0)) is None

        asyncio.run(main())

    def test_nothing_moves_if_one_of_the_other_family_cannot(self) -> None:
        bus = servobus.open("virtual:rx28@1,lx16a@2?clock=virtual")
        rx, lx = bus.scan(ids=[1, 2])
        rx.torque_on()
        here = [real.position for real in bus.transport.servos]  # type: ignore[attr-defined]
        with pytest.raises(servobus.TorqueOff, match="model unknown, id 2"):
            bus.move({rx: 100 * deg, lx: 100 * deg})
        with pytest.raises(servobus.BadValue, match="model unknown, id 2"):
            bus.move({rx: 100 * deg, lx: 500 * deg})
        bus.transport.sleep(1.0)
        assert [real.position for real in bus.transport.servos] == pytest.approx(here)  # type: ignore[attr-defined]


# Attaching


def test_attach_without_a_speed_gives_the_known_one() -> None:
    bus = servobus.open("virtual:rx28@1?clock=virtual&baud=1000000")
    (servo,) = bus.scan(ids=[1], family="dynamixel", bauds=1_000_000)
    assert bus.attach(RX28, 1) is servo
    assert (servo.baud, servo.target.answers) == (1_000_000, Answers.EVERYTHING)
    second = bus.attach(RX28, 1, baud=57_600)
    assert second is not servo
    assert {servo.baud, second.baud} == {57_600, 1_000_000}
    assert len(bus) == 2


def test_attach_wins_over_the_guess_of_a_scan_and_no_scan_replaces_an_object() -> None:
    rows = {name: row for name, row in vars(LX16A).items() if isinstance(row, Register)}
    LX224 = type("LX224", (LX16A,), {"title": "LX-224", **rows})  # noqa: N806 - it is a class
    bus = servobus.open("virtual:lx16a@1?clock=virtual")
    servo = bus.attach(LX224, 1)
    servo.torque_on()
    assert bus.scan(ids=[1], family="lewansoul") == [servo]
    assert bus.find(1, family="lewansoul") is servo is bus[1]
    assert servo.model is LX224
    bus.make_safe("free")
    bus.transport.sleep(0.1)
    assert not bus.transport.servos[0].torque  # type: ignore[attr-defined]


def test_an_assumed_speed_is_given_up_only_where_nothing_answers() -> None:
    bus, _, real_fast = twins()
    assumed = bus.attach(RX28, 1)
    (fast,) = bus.scan(ids=[1], family="dynamixel", bauds=1_000_000)
    assert fast is not assumed
    assert (assumed.baud, fast.baud) == (57_600, 1_000_000)
    assert round(assumed.look().position / deg) == 200
    assert round(fast.look().position / deg) == round(real_fast.position / deg) == 20


def test_what_was_replaced_by_attach_moves_no_more() -> None:
    class RX28B(RX28):
        title = "RX-28B"

    bus = servobus.open("virtual:rx28@1?clock=virtual")
    old = bus.attach(RX28, 1)
    bus.attach(RX28B, 1)
    with pytest.raises(Stopped, match="RX-28 id 1 is attached as RX-28B id 1 now"):
        old.torque_on()


def test_a_servo_can_be_forgotten() -> None:
    bus = servobus.open("virtual:rx28@1?clock=virtual")
    wrong, right = bus.attach(RX28, 77), bus.attach(RX28, 1)
    bus.forget(77)
    assert list(bus) == [right]
    assert list(bus.read_all("present_position")) == [right]
    with pytest.raises(Stopped, match="RX-28 id 77 was forgotten by its bus"):
        wrong.torque_on()
    right.torque_on()
    with pytest.raises(UsageError, match="RX-28 id 1 is driven by this bus"):
        bus.forget(right)
    right.torque_off()
    bus.forget(right)
    assert len(bus) == 0


def test_alarms_that_ended_are_told_after_a_reopen_too() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        (servo,) = bus.scan(ids=[1])
        real = bus.transport.servos[0]  # type: ignore[attr-defined]
        real.temperature = 95.0
        servo.read(RX28.present_temperature)
        assert servo.alarms
        real.temperature = 25.0
        assert repr(bus.reopen()) == "ReconnectReport(present=(1,), missing=(), restarted=())"
        servo.read(RX28.present_temperature)
        assert not servo.alarms


def test_a_report_is_asked_by_servo_or_id() -> None:
    bus = servobus.open("virtual:rx28@1-3?clock=virtual")
    one, two, three = bus.scan(ids=[1, 2, 3], family="dynamixel")
    real = bus.transport.servos  # type: ignore[attr-defined]
    one.torque_on()
    bus.transport.sleep(0.1)
    real[0].power_off()
    real[0].power_on(bus.transport.now())
    real[2].power_off()
    bus.transport.sleep(0.1)
    report = bus.reopen()
    assert report == {1: "restarted", 2: "present", 3: "missing"}
    assert (report[two], report[3]) == ("present", "missing")
    assert (report.present, report.restarted, report.missing) == ((one, two), (one,), (three,))
    with pytest.raises((Restarted, servobus.TorqueOff)):
        one.move(1.0)


# The mapping itself


def test_by_servo_reads_like_a_dict_of_ids_where_they_are_unique() -> None:
    bus = servobus.open("virtual:rx28@1-2,lx16a@1?clock=virtual")
    one, two = (bus.attach(RX28, id) for id in (1, 2))
    twin = bus.attach(LX16A, 1)
    both: ByServo[Servo, float] = ByServo({one: 1.5, two: math.pi})
    assert repr(both) == "{1: 1.5, 2: 3.141592653589793}"
    assert both == {1: 1.5, 2: math.pi} == both.by_id()
    assert both == {one: 1.5, two: math.pi}
    assert both != {1: 1.5}
    assert (both[1], both[two], both.get(3), both.get(3, 0.0)) == (1.5, math.pi, None, 0.0)
    keys: list[Any] = [1, two, 3, twin, "1"]
    assert [key in both for key in keys] == [True, True, False, False, False]
    with pytest.raises(UnknownName, match=r"no servo with id 3 is known here \(known: 1, 2\)"):
        both[3]
    with pytest.raises(UnknownName, match="no such servo as <LX-16A id 1 at 115200> is known here"):
        both[twin]
    mixed: ByServo[Servo, int] = ByServo({one: 1, twin: 2})
    assert repr(mixed) == "{RX-28 id 1 at 57600: 1, LX-16A id 1 at 115200: 2}"
    assert (mixed[one], mixed[twin]) == (1, 2)
    for wrong in (lambda: mixed[1], lambda: mixed.get(1), mixed.by_id):
        with pytest.raises(UnknownName, match="not unique here: RX-28 id 1 at 57600 and LX-16A id 1"):
            wrong()
    assert mixed != {1: 1}


# N13: an id that two families share


def test_N13_find_names_both_and_takes_neither() -> None:
    said = "id 1 is not unique here: RX-28 id 1 at 57600 and LX/HTS bus servo, model unknown, id 1 at 115200"
    with servobus.open("virtual:rx28@1,lx16a@1?clock=virtual") as bus:
        with pytest.raises(UnknownName, match=said):
            bus.find(1)
        assert len(bus) == 0
        assert bus.find(1, family="lewansoul").model is UnknownLx
        assert bus.find(1, bauds=57_600).model is RX28


def test_N13_find_does_so_on_an_asynchronous_bus() -> None:
    async def ask() -> None:
        async with servobus.open_async("virtual:rx28@1,lx16a@1?clock=virtual") as bus:
            with pytest.raises(UnknownName, match="RX-28 id 1 at 57600 and LX/HTS bus servo, model unknown, id 1"):
                await bus.find(1)
            assert (await bus.find(1, family="lewansoul")).model is UnknownLx

    asyncio.run(ask())


def test_N13_results_of_all_servos_drop_none() -> None:
    with servobus.open("virtual:rx28@1,lx16a@1?clock=virtual") as bus:
        rx, lx = bus.scan(ids=1)
        assert list(bus.read_all("present_voltage")) == [rx, lx]
        assert list(bus.protect()) == [rx, lx]
        with pytest.raises(UnknownName, match="not unique"):
            bus.read_all("present_voltage")[1]
