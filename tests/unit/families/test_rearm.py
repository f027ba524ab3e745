"""Alarms latch, and what they switched off comes back without a jump (F12, F13)."""

from typing import Any

import pytest

from samples import (
    can_turn,
    factory_answers,
    has,
    minds_overload,
    models_that,
    sample_models,
    sample_of,
    turning,
)
from servobus import MODELS, RX28, BusError, Refused, herkulex, lewansoul
from servobus.core.units import deg
from servobus.families.lewansoul.protocol import Alarm
from servobus.virtual.physics.motor import Load
from unit.lossy import ASYNC, SYNC, Bench

DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])


def bench_for(key: str, driver: str = SYNC) -> Bench:
    return Bench(key, driver, factory_answers(MODELS[key]))


def let_go(bench: Bench) -> float:
    """Turn the free shaft away from its goal by hand, as a fallen arm would; give where it is."""
    real = bench.real
    bench.line.sleep(0.1)
    assert not real.torque
    goal = real.get("goal_position")
    here = real.position + 40 * deg
    real.turn_shaft(here)
    bench.line.sleep(0.1)
    if "goal_position" in real.model.registers:
        real.put("goal_position", goal)  # a servo whose goal does not follow the shaft, unlike the virtual RX-28
    return here


def assert_held(bench: Bench, here: float) -> None:
    """Watchdog the shaft for 2 s: it holds where it was, to two units of an LX-16A."""
    for _ in range(100):
        bench.line.sleep(0.02)
        assert bench.real.position == pytest.approx(here, abs=0.5 * deg)
    assert bench.real.torque


@DRIVERS
@sample_models
def test_an_overheated_servo_is_rearmed_when_it_is_cool(key: str, driver: str) -> None:
    bench = bench_for(key, driver)
    bench.do(lambda servo: servo.torque_on())
    bench.real.temperature = 110.0
    bench.line.sleep(1.0)  # HerkuleX looks for 504 ms before it calls it an alarm (4-2 NO 34)
    here = let_go(bench)

    with pytest.raises(Refused, match=r"(?i)cause is still there: over.?heating|temperature") as caught:
        bench.do(lambda servo: servo.rearm())
    assert caught.value.flags & sample_of(key).hot
    bench.line.sleep(0.5)
    assert not bench.real.torque
    assert bench.real.position == pytest.approx(here, abs=0.5 * deg)
    assert bench.do(lambda servo: servo.read_alarms()) == sample_of(key).hot
    assert bench.servo.latched == sample_of(key).hot

    bench.real.temperature = 25.0
    if sample_of(key).recovers:
        bench.line.sleep(0.1)
        assert bench.real.torque  # and holds where it is
    bench.do(lambda servo: servo.rearm())
    assert bench.servo.alarms == bench.servo.latched == 0
    assert_held(bench, here)


@DRIVERS
@models_that(minds_overload)
def test_an_overloaded_servo_is_rearmed_where_it_is(key: str, driver: str) -> None:
    bench = bench_for(key, driver)
    start = bench.real.position
    bench.do(lambda servo: servo.torque_on())
    bench.real.shaft.load = Load(blocked=1.0)
    bench.do(lambda servo: servo.start_move(start + 60 * deg, time=0.5))
    bench.line.sleep(3.0)
    bench.do(lambda servo: servo.ping())
    assert bench.servo.alarms
    bench.real.shaft.load = Load()
    here = let_go(bench)
    bench.do(lambda servo: servo.rearm())
    assert bench.servo.alarms == bench.servo.latched == 0
    assert_held(bench, here)
    bench.do(lambda servo: servo.start_move(here - 20 * deg, time=0.5))
    bench.line.sleep(1.5)
    assert bench.real.position == pytest.approx(here - 20 * deg, abs=2 * deg)


def test_an_rx28_gets_its_torque_limit_back_only_after_its_goal() -> None:
    """The order of the packets: manual 3-4-1 Alarm Shutdown, and nothing jumps."""
    bench = bench_for("rx28")
    bench.real.memory.store(RX28.max_torque, 600)
    bench.do(lambda servo: servo.torque_on())
    bench.real.put("torque_limit", 0)
    bench.line.lose()
    bench.do(lambda servo: servo.rearm())
    writes = [(request[5], request[6:-1]) for request in bench.line.requests if request[4] == 3]
    assert [address for address, _ in writes] == [24, 34, 30, 24]  # enable off, limit, goal, enable on
    assert writes[0][1] == b"\x00"
    assert writes[1][1] == (600).to_bytes(2, "little")
    assert writes[3][1] == b"\x01"


def test_a_herkulex_that_is_hot_is_refused_before_it_calls_it_an_alarm() -> None:
    bench = bench_for("drs0602")
    bench.real.temperature = 110.0
    bench.line.sleep(0.05)  # less than the 504 ms of ADC Fault Check Period
    assert bench.real.get("status_error") == 0
    with pytest.raises(Refused, match="cause is still there: temperature"):
        bench.do(lambda servo: servo.rearm())
    assert not bench.real.torque


def test_a_herkulex_in_infinite_turn_is_told_to_stop_before_its_torque_comes_on() -> None:
    bench = bench_for("drs0602")
    bench.do(lambda servo: servo.torque_on())
    bench.do(lambda servo: servo.turn(speed=90 * deg))
    bench.do(lambda servo: servo.torque_off())
    bench.line.lose()
    bench.do(lambda servo: servo.rearm())
    sets = [(request[4], request[7:]) for request in bench.line.requests if request[4] in (3, 5)]
    assert [code for code, _ in sets] == [3, 5, 3, 5, 5, 5]
    assert sets[0][1] == bytes((48, 2, 0, 0))  # both status bytes (6-3 Example 2)
    assert sets[1][1] == bytes((0, 0, 0x03, 5, 0))  # speed 0, stop flag and mode (6-6), id 5
    assert sets[2][1] == bytes((52, 1, 0x60))  # Torque Control on (4-2 NO 47)
    assert [data for _, data in sets[3:]] == [sets[1][1]] * 3  # again, in case it kept a speed


def test_an_lx16a_that_lost_its_torque_is_rearmed_at_its_place() -> None:
    bench = bench_for("lx16a")
    bench.real.goal_torque = False  # type: ignore[attr-defined]
    bench.bus.do(lewansoul.move_time_write(5, 833, 0))  # as a program would that knows nothing of the torque
    bench.line.sleep(0.1)  # a move that waits for the torque (L-69)
    here = bench.real.position
    bench.do(lambda servo: servo.rearm())
    assert_held(bench, here)


@pytest.mark.parametrize("position", [-40, 1050])
def test_an_lx16a_outside_its_range_is_rearmed_there(position: int) -> None:
    bench = bench_for("lx16a")
    here = position * 0.24 * deg
    bench.real.turn_shaft(here)
    bench.do(lambda servo: servo.rearm())
    assert_held(bench, here)


@models_that(can_turn)
def test_a_servo_that_turned_does_not_go_on_turning(key: str) -> None:
    bench = bench_for(key)
    bench.do(lambda servo: servo.torque_on())
    bench.do(lambda servo: servo.turn(**turning(servo.model)))
    bench.line.sleep(0.5)
    bench.do(lambda servo: servo.torque_off())
    bench.line.sleep(1.0)  # until it stands
    here = bench.real.position
    bench.do(lambda servo: servo.rearm())
    bench.line.sleep(1.0)
    assert bench.real.position == pytest.approx(here, abs=0.5 * deg)


def test_a_herkulex_that_turned_until_it_was_hot_does_not_go_on_turning() -> None:
    bench = bench_for("drs0602")
    bench.do(lambda servo: servo.torque_on())
    bench.do(lambda servo: servo.turn(speed=90 * deg))
    bench.line.sleep(0.5)
    bench.real.temperature = 110.0
    bench.line.sleep(1.0)
    bench.real.temperature = 25.0
    bench.line.sleep(0.5)
    here = bench.real.position
    bench.do(lambda servo: servo.rearm())
    bench.line.sleep(1.0)
    assert bench.real.position == pytest.approx(here, abs=0.5 * deg)


@sample_models
def test_a_servo_with_torque_is_not_let_go(key: str) -> None:
    bench = bench_for(key)
    bench.do(lambda servo: servo.torque_on())
    held = []

    def watch(_: bytes) -> bool:
        held.append(bench.real.torque)
        return True

    bench.line.on_request = watch
    bench.do(lambda servo: servo.rearm())
    assert held
    assert all(held)
    assert bench.real.torque


def test_clearing_a_herkulex_survives_one_lost_write() -> None:
    for number in range(1, 12):
        bench = bench_for("drs0602")
        bench.real.put("status_error", herkulex.StatusError.OVERLOAD)
        bench.line.lose(request=number)
        try:
            bench.do(lambda servo: servo.rearm())
        except BusError:
            # Only the write that switches the torque on can end so: it is not answered, and seen to have failed.
            assert not bench.real.torque
            assert bench.real.get("status_error") == 0
        else:
            assert bench.real.torque


@sample_models
def test_alarms_that_are_over_stay_until_the_servo_is_rearmed(key: str) -> None:
    bench = bench_for(key)
    bench.real.temperature = 110.0
    bench.line.sleep(1.0)
    bench.do(lambda servo: servo.read_alarms())
    assert "ALARM" in str(bench.servo)
    bench.real.temperature = 25.0
    bench.line.sleep(0.5)
    servo: Any = bench.servo
    if has(servo.model, "status_error"):  # it keeps its errors until they are written 0
        servo.write_raw({servo.model.register("status_error"): 0})
    assert servo.read_alarms() == servo.alarms == 0
    assert servo.latched == sample_of(key).hot
    assert str(servo).endswith(f", had ALARM {sample_of(key).hot_word}")
    servo.clear_latched()
    assert servo.latched == 0
    assert "ALARM" not in str(servo)


def test_supply_out_of_limits_is_told_by_an_lx16a_too() -> None:
    bench = bench_for("lx16a")
    bench.real.voltage = 4.0  # the limits are 6.5 and 12 V from the factory (L-50)
    assert bench.do(lambda servo: servo.read_alarms()) == Alarm.OVER_VOLTAGE
