"""What is minded about a servo: its EEPROM (F18), its RAM after a brownout (F14), and how far one step goes (F23)."""

import math
from typing import Any

import pytest

from samples import (
    can_be_silenced,
    every_model,
    factory_answers,
    keeps_twice,
    models_that,
    ram_setting,
    sample_models,
    sample_of,
    turning,
)
from servobus import DRS0602, LX16A, MODELS, RX28, BadValue, EepromWear, NoReply, Restarted, TorqueOff, UsageError, deg
from servobus.core.registers import Register
from servobus.families.base import Answers
from servobus.jobs.backup import Backup
from unit.lossy import ASYNC, SYNC, Bench

DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])


def bench_for(key: str, driver: str = SYNC) -> Any:
    return Bench(key, driver, factory_answers(MODELS[key]))


def setting(key: str) -> Register[Any]:
    """Give a register in EEPROM: the temperature limit. 60 °C is allowed by all, and no factory setting."""
    return MODELS[key].register("max_temperature")


def stores(bench: Bench) -> list[int]:
    """Count, from now on, how often the servo's EEPROM is changed or written; one entry for each time."""
    times: list[int] = []
    bench.real.memory.on_store = lambda: times.append(1)
    return times


def eeprom_writes(bench: Bench, key: str) -> int:
    """Count the requests on the wire that write to the EEPROM."""
    return sum(sample_of(key).writes_eeprom(request) for request in bench.line.requests)


# EEPROM


@DRIVERS
@sample_models
def test_only_what_differs_goes_to_the_eeprom(key: str, driver: str) -> None:
    bench, row = bench_for(key, driver), setting(key)
    bench.do(lambda servo: servo.store({row: row.decode(int(row.default or 0))}))
    assert eeprom_writes(bench, key) == bench.servo.eeprom_writes == 0
    for _ in range(3):
        bench.do(lambda servo: servo.store({row: 60.0}))
    bench.line.sleep(0.01)
    assert bench.stored(row.name) == row.scale.encode(60.0)
    assert eeprom_writes(bench, key) == bench.servo.eeprom_writes == 1


@models_that(lambda model: not keeps_twice(model))
def test_a_plain_write_of_what_lives_in_eeprom_is_as_careful(key: str) -> None:
    bench, row = bench_for(key), setting(key)
    servo: Any = bench.servo
    servo.write(row, 60.0)
    servo.write_many({row: 60.0})
    servo.write_raw({row: 60})
    assert eeprom_writes(bench, key) == servo.eeprom_writes == 1


def test_of_several_registers_only_those_that_differ_are_written() -> None:
    bench = bench_for("rx28")
    bench.do(lambda servo: servo.store({RX28.lowest_limit_voltage: 6.0, RX28.highest_limit_voltage: 20.0}))
    (write,) = [request for request in bench.line.requests if sample_of("rx28").writes_eeprom(request)]
    assert write == bytes.fromhex("FF FF 05 04 03 0D C8 1E")  # 20.0 V to address 13; 05+04+03+0D+C8 = E1
    assert bench.servo.eeprom_writes == 1


def test_a_herkulex_writes_to_ram_without_a_limit_and_without_wear() -> None:
    bench = bench_for("drs0602")
    servo: Any = bench.servo
    for raw in range(50):
        servo.write_raw({DRS0602.position_kp: raw})
    assert eeprom_writes(bench, "drs0602") == servo.eeprom_writes == 0


def test_what_a_herkulex_keeps_already_still_goes_to_its_ram() -> None:
    bench = bench_for("drs0602")
    servo: Any = bench.servo
    servo.write(DRS0602.max_temperature, 70.0)
    servo.store({DRS0602.max_temperature: 80.0})  # EEP has 80 from the factory, RAM 70
    assert servo.read(DRS0602.max_temperature) == 80.0
    assert servo.eeprom_writes == 0


def test_an_offset_of_an_lx16a_is_saved_though_it_is_in_use() -> None:
    bench = bench_for("lx16a")
    servo: Any = bench.servo
    servo.write(LX16A.angle_offset, 5 * 0.24 * deg)
    assert servo.eeprom_writes == 0
    servo.store({LX16A.angle_offset: 5 * 0.24 * deg})  # command 19 tells the one in use, which is 5 by now
    bench.line.sleep(0.01)
    assert bench.stored("angle_offset") == 5
    assert servo.eeprom_writes == 1


def test_the_light_of_an_lx16a_is_eeprom_too() -> None:
    bench = bench_for("lx16a")
    servo: Any = bench.servo
    for colour in ("on", "off", "off", "off"):
        servo.led(colour)
    assert eeprom_writes(bench, "lx16a") == bench.servo.eeprom_writes == 1  # it was on (L-71)


@models_that(can_be_silenced)
def test_a_servo_that_answers_nothing_is_written_to_unseen(key: str) -> None:
    bench, row = Bench(key, SYNC, Answers.NOTHING), setting(key)
    for _ in range(2):
        bench.do(lambda servo: servo.store({row: 60.0}))
    bench.line.sleep(0.01)
    assert bench.stored(row.name) == row.scale.encode(60.0)
    assert eeprom_writes(bench, key) == bench.servo.eeprom_writes == 2


@DRIVERS
@sample_models
def test_a_flood_of_writes_is_stopped_until_a_minute_has_passed(key: str, driver: str) -> None:
    bench, row = bench_for(key, driver), setting(key)
    now = 1000.0
    bench.servo.record.clock = lambda: now
    for count in range(10):
        now += 1.0
        bench.do(lambda servo, count=count: servo.store({row: 60.0 + count}))
    bench.line.lose()
    with pytest.raises(
        EepromWear, match=rf"{row.name} was written to EEPROM 10 times within 60 s.*wait 51 s"
    ) as caught:
        bench.do(lambda servo: servo.store({row: 50.0}))
    assert isinstance(caught.value, UsageError)
    assert ("write() sets it in RAM" in str(caught.value)) == keeps_twice(MODELS[key])
    assert eeprom_writes(bench, key) == 0
    bench.do(lambda servo: servo.store({row: 69.0}))  # what is there already wears nothing
    now += 51.0  # the first of the ten was at 1001 s
    bench.do(lambda servo: servo.store({row: 50.0}))
    bench.line.sleep(0.01)
    assert bench.stored(row.name) == row.scale.encode(50.0)
    assert bench.servo.eeprom_writes == 11


def test_other_registers_have_brakes_of_their_own_and_it_can_be_taken_off() -> None:
    bench = bench_for("rx28")
    servo: Any = bench.servo
    for raw in range(11, 21):
        servo.write_raw({RX28.highest_limit_temperature: raw})
    servo.write_raw({RX28.max_torque: 500})
    with pytest.raises(EepromWear):
        servo.write_raw({RX28.highest_limit_temperature: 30})
    servo.record.most = None
    servo.write_raw({RX28.highest_limit_temperature: 30})
    assert servo.eeprom_writes == 12


def test_a_write_whose_answer_is_lost_counts() -> None:
    bench = bench_for("rx28")
    bench.line.lose(reply=3)  # the value, Lock, the write
    with pytest.raises(NoReply):
        bench.servo.store({RX28.max_torque: 0.5})
    assert bench.stored("max_torque") == 512
    assert bench.servo.eeprom_writes == 1


@sample_models
def test_a_restored_backup_is_counted(key: str) -> None:
    bench, row = bench_for(key), setting(key)
    servo: Any = bench.servo
    saved = servo.backup()
    servo.store({row: 60.0})
    assert servo.restore(saved) == [row.name]
    assert servo.restore(Backup.parse(saved.text())) == []
    assert eeprom_writes(bench, key) == servo.eeprom_writes == 2


class TestLock:
    """RX-28 Lock: only addresses 24 to 35 can be written until power-off (3-4-2)."""

    def test_a_locked_table_is_refused_before_anything_is_written(self) -> None:
        bench = bench_for("rx28")
        servo: Any = bench.servo
        servo.write(RX28.lock, True)
        bench.line.lose()
        with pytest.raises(UsageError, match="locked, so max_torque cannot be written: until its power goes off only"):
            servo.write(RX28.max_torque, 0.5)
        with pytest.raises(UsageError, match="locked, so id cannot"):
            servo.change_id(9)
        assert [request for request in bench.line.requests if request[4] == 3] == []
        assert servo.eeprom_writes == 0
        assert servo.id == 5

    def test_what_is_there_already_and_what_stays_open_are_not_refused(self) -> None:
        bench = bench_for("rx28")
        servo: Any = bench.servo
        servo.write(RX28.lock, True)
        servo.write(RX28.max_torque, 1.0)
        servo.write(RX28.torque_limit, 0.5)
        servo.torque_on()

    def test_power_off_opens_it(self) -> None:
        bench = bench_for("rx28")
        servo: Any = bench.servo
        servo.write(RX28.lock, True)
        bench.real.power_off()
        bench.real.power_on(bench.line.now())
        servo.write(RX28.max_torque, 0.5)
        assert bench.stored("max_torque") == 512


# RAM


def restart(bench: Bench) -> None:
    """Let the supply break down for a moment, after the last request has arrived."""
    bench.line.sleep(0.01)
    bench.real.power_off()
    bench.real.power_on(bench.line.now())
    bench.line.sleep(0.1)


@DRIVERS
@sample_models
def test_a_servo_that_lost_its_torque_with_its_ram_is_found_out(key: str, driver: str) -> None:
    bench = bench_for(key, driver)
    bench.do(lambda servo: servo.torque_on())
    bench.do(lambda servo: servo.verify())
    restart(bench)
    with pytest.raises(Restarted, match=r"has lost what was set in it.*(torque_enable|torque_control) is"):
        bench.do(lambda servo: servo.verify())
    assert bench.servo.restarted
    assert str(bench.servo).endswith(", RESTARTED")
    goal = bench.real.position + 10 * deg
    with pytest.raises(TorqueOff):
        bench.do(lambda servo: servo.start_move(goal, time=0.5))
    bench.do(lambda servo: servo.torque_on())
    assert not bench.servo.restarted
    bench.do(lambda servo: servo.verify())
    bench.do(lambda servo: servo.start_move(goal, time=0.5))


@sample_models
def test_it_is_not_moved_even_if_its_torque_is_on(key: str) -> None:
    bench = bench_for(key)
    bench.do(lambda servo: servo.torque_on())
    restart(bench)
    with pytest.raises(Restarted):
        bench.do(lambda servo: servo.verify())
    bench.real.put("torque_enable", sample_of(key).on)  # some are told to come up so (EL-08)
    bench.line.lose()
    with pytest.raises(TorqueOff):
        bench.do(lambda servo: servo.start_move(bench.real.position + 10 * deg, time=0.5))
    bench.do(lambda servo: servo.rearm())
    assert not bench.servo.restarted


@models_that(lambda model: ram_setting(model) is not None)
def test_a_value_in_ram_tells_it_too(key: str) -> None:
    bench, row = bench_for(key), ram_setting(MODELS[key])
    assert row is not None
    servo: Any = bench.servo
    servo.verify()  # nothing was set: nothing to tell by
    servo.write_raw({row: (row.default or 0) + 1})
    servo.verify()
    restart(bench)
    with pytest.raises(Restarted, match=row.name):
        servo.verify()
    servo.verify()  # it is told once


@sample_models
def test_an_alarm_that_took_the_torque_is_no_restart(key: str) -> None:
    bench = bench_for(key)
    bench.do(lambda servo: servo.torque_on())
    bench.real.temperature = 110.0
    bench.line.sleep(1.0)
    assert not bench.real.torque
    bench.do(lambda servo: servo.verify())
    assert not bench.servo.restarted


@sample_models
def test_moves_and_torque_off_are_no_restart(key: str) -> None:
    bench = bench_for(key)
    bench.do(lambda servo: servo.torque_on())
    for colour in ("off", "on"):
        bench.do(lambda servo, colour=colour: servo.led(colour))
    bench.do(lambda servo: servo.start_move(bench.real.position + 10 * deg, time=0.3))
    bench.line.sleep(1.0)
    bench.do(lambda servo: servo.verify())
    bench.do(lambda servo: servo.torque_off())
    bench.do(lambda servo: servo.verify())


def test_a_write_whose_answer_is_lost_is_no_restart() -> None:
    bench = Bench("drs0602", SYNC, Answers.EVERYTHING)
    servo: Any = bench.servo
    servo.write(DRS0602.position_kp, 20.0)
    bench.line.lose(reply=1)
    with pytest.raises(NoReply):
        servo.write(DRS0602.position_kp, 30.0)
    assert servo.read(DRS0602.position_kp) == 30.0
    servo.verify()


def test_our_own_restart_is_none() -> None:
    bench = bench_for("drs0602")
    bench.do(lambda servo: servo.torque_on())
    bench.do(lambda servo: servo.reboot())
    bench.do(lambda servo: servo.verify())
    assert not bench.servo.restarted


def test_a_restarted_herkulex_is_listened_to_by_its_old_policy_again() -> None:
    bench = bench_for("drs0602")
    servo: Any = bench.servo
    servo.write(DRS0602.ack_policy, Answers.EVERYTHING)
    assert servo.target.answers.name == "EVERYTHING"
    restart(bench)
    with pytest.raises(Restarted, match="ack_policy"):
        servo.verify()
    assert servo.target.answers.name == "READS"
    servo.torque_on()


# Steps


@DRIVERS
@sample_models
def test_a_step_beyond_max_step_is_refused_and_nothing_is_sent(key: str, driver: str) -> None:
    bench = bench_for(key, driver)
    here = bench.real.position
    bench.do(lambda servo: servo.torque_on())
    bench.servo.max_step = 20 * deg
    goal: Any = bench.servo.model.register("goal_position")
    for far in (here + 22 * deg, here - 22 * deg):
        with pytest.raises(BadValue, match=r"2[12]\.\d° in one step is more than its max_step, 20\.0°"):
            bench.do(lambda servo, far=far: servo.start_move(far, time=1.0))
        if goal.writable:
            with pytest.raises(BadValue, match="max_step"):
                bench.do(lambda servo, far=far: servo.write(goal, far))
    bench.line.sleep(1.0)
    assert bench.real.position == pytest.approx(here, abs=0.5 * deg)
    bench.do(lambda servo: servo.start_move(here + 19 * deg, time=0.5))
    bench.servo.max_step = None
    bench.do(lambda servo: servo.start_move(here + 40 * deg, time=0.5))


def test_max_step_holds_in_a_move_of_several_too() -> None:
    bench = bench_for("rx28")
    bus: Any = bench.bus
    bench.do(lambda servo: servo.torque_on())
    bench.servo.max_step = 5 * deg
    with pytest.raises(BadValue, match="max_step"):
        bus.start_move({5: 170 * deg})


@pytest.mark.parametrize("step", [0, -1.0, math.nan, math.inf])
def test_max_step_is_an_angle(step: float) -> None:
    bench = bench_for("rx28")
    with pytest.raises(BadValue, match="max_step"):
        bench.servo.max_step = step


@every_model
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_refused_before_the_wire(key: str, value: float) -> None:
    bench = bench_for(key)
    servo: Any = bench.servo
    row = servo.model.register("min_position")
    jobs = [
        (servo.start_move, (value,), {}),
        (servo.start_move, (1.0,), {"time": value}),
        (servo.start_move, (1.0,), {"speed": value}),
        (servo.write, (row, value), {}),
        (servo.write_many, ({row: value},), {}),
        (servo.store, ({row: value},), {}),
        *([(servo.turn, (), turning(servo.model, value))] if servo.model.turns else []),
        (servo.position_mode, ((value, 1.0),), {}),
        (bench.bus.start_move, ({5: value},), {}),
    ]
    for job, arguments, named in jobs:
        with pytest.raises(BadValue):
            job(*arguments, **named)
    assert [request for request in bench.line.requests if sample_of(key).writes(request)] == []


def test_waiting_for_no_number_of_seconds_is_refused() -> None:
    bench = bench_for("rx28")
    bench.do(lambda servo: servo.torque_on())
    course = bench.do(lambda servo: servo.start_move(160 * deg, time=0.1))
    with pytest.raises(BadValue, match="timeout nan"):
        bench.bus.wait_arrival(course, math.nan)
