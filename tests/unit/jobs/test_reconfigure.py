"""Changes of id, speed and settings on a line that loses requests and replies, one after the other (F19)."""

from collections.abc import Callable
from typing import Any

import pytest

import extent
import servobus
from samples import (
    answer_levels,
    can_be_silenced,
    can_change_baud,
    can_reset,
    every_model,
    factory_answers,
    factory_baud,
    keys_that,
    models_that,
    other_bauds,
    sample_models,
    sample_of,
)
from servobus import DRS0602, MODELS, RX28, BadValue, Bus, BusError, NoReply, UsageError
from servobus.families.base import Answers, Model
from unit.lossy import CHOSEN_DRIVERS, DRIVERS, SYNC, Bench, Job, Lossy


def kinds_that(can: Callable[[type[Model]], bool]) -> pytest.MarkDecorator:
    """Run a test with each of the models that can something, at each answer level that answers reads."""
    kinds = [(key, level) for key in keys_that(can) for level in answer_levels(MODELS[key]) if level]
    return pytest.mark.parametrize(("key", "answers"), kinds)


def factory(key: str) -> int:
    return factory_baud(MODELS[key])


def other(key: str) -> int:
    """Give a speed that is not that from the factory."""
    return other_bauds(MODELS[key])[0]


def lose_each(make: Callable[[], Bench], job: Job, check: Callable[[Bench], None]) -> None:
    """Do a job once undisturbed, then once for each request and each reply of it that can be lost.

    Of a job of many packets, without `--all`, some are lost that are spread over it.
    """
    bench = make()
    bench.line.lose()
    bench.do(job)
    check(bench)
    count = len(bench.line.requests)
    assert count >= 3
    for number in extent.spread(range(1, count + 1), 12):
        for lost in ({"request": number}, {"reply": number}):
            bench = make()
            bench.line.lose(**lost)
            bench.do(job)
            assert len(bench.line.requests) >= number
            check(bench)


@CHOSEN_DRIVERS
@kinds_that(lambda _: True)
def test_an_id_changes_whatever_single_packet_is_lost(key: str, answers: Answers, driver: str) -> None:
    def check(bench: Bench) -> None:
        assert bench.at() == bench.really_at() == (7, factory(key))
        assert bench.stored("id") == 7
        assert bench.servo.target.answers is answers

    lose_each(lambda: Bench(key, driver, answers), lambda servo: servo.change_id(7), check)


@CHOSEN_DRIVERS
@kinds_that(can_change_baud)
def test_a_speed_changes_whatever_single_packet_is_lost(key: str, answers: Answers, driver: str) -> None:
    def check(bench: Bench) -> None:
        assert bench.at() == bench.really_at() == (5, other(key))
        assert bench.line.baud == other(key)

    lose_each(lambda: Bench(key, driver, answers), lambda servo: servo.change_baud(other(key)), check)


@CHOSEN_DRIVERS
@kinds_that(can_reset)
def test_a_reset_happens_whatever_single_packet_is_lost(key: str, answers: Answers, driver: str) -> None:
    first_id = MODELS[key].register("id").default

    def check(bench: Bench) -> None:
        assert bench.at() == bench.really_at() == (first_id, factory(key))
        assert bench.servo.target.answers == factory_answers(MODELS[key])

    lose_each(lambda: Bench(key, driver, answers), lambda servo: servo.reset(), check)


@pytest.mark.parametrize("answers", [Answers.READS, Answers.EVERYTHING])
def test_a_reset_that_keeps_id_and_speed_is_told_by_the_settings(answers: Answers) -> None:
    def make() -> Bench:
        bench = Bench("drs0602", SYNC, answers)
        bench.real.memory.store(DRS0602.position_kp, 300)
        return bench

    def check(bench: Bench) -> None:
        assert bench.at() == bench.really_at() == (5, 115_200)
        assert bench.stored("position_kp") == 70  # manual 4-2

    lose_each(make, lambda servo: servo.reset(keep=frozenset({"id", "baud"})), check)


@models_that(lambda model: can_be_silenced(model) and can_change_baud(model) and can_reset(model))
def test_servos_that_answer_nothing_can_be_changed_too(key: str) -> None:
    bench = Bench(key, SYNC, Answers.NOTHING)
    bench.do(lambda servo: servo.change_id(7))
    assert bench.at() == bench.really_at() == (7, factory(key))
    bench.do(lambda servo: servo.change_baud(other(key)))
    assert bench.at() == bench.really_at() == (7, other(key))
    bench.do(lambda servo: servo.reset())
    assert bench.at() == bench.really_at() == (MODELS[key].register("id").default, factory(key))


@DRIVERS
@sample_models
def test_a_servo_that_does_not_take_the_id_is_told_twice_and_stays(key: str, driver: str) -> None:
    bench = Bench(key, driver, Answers.READS)
    told = 0

    def lose_id_writes(request: bytes) -> bool:
        nonlocal told
        told += sample_of(key).writes_id(request)
        return not sample_of(key).writes_id(request)

    bench.line.on_request = lose_id_writes
    with pytest.raises(BusError, match=r"still at id 5 at \d+ baud: it was told twice") as caught:
        bench.do(lambda servo: servo.change_id(7))
    assert not isinstance(caught.value, NoReply)
    assert told == 2
    assert bench.at() == bench.really_at()
    assert bench.stored("id") == 5  # also after its next start
    bench.line.on_request = None
    bench.do(lambda servo: servo.ping())
    bench.do(lambda servo: servo.change_id(7))
    assert bench.at() == bench.really_at() == (7, bench.servo.baud)


@DRIVERS
@sample_models
def test_a_servo_that_is_found_nowhere_is_said_to_be(key: str, driver: str) -> None:
    bench = Bench(key, driver, Answers.READS)

    def cut_the_power(request: bytes) -> bool:
        if sample_of(key).writes_id(request):
            bench.real.power_off()
        return True

    bench.line.on_request = cut_the_power
    with pytest.raises(NoReply, match=r"go to id 7 at \d+ baud and answers neither there nor at id 5"):
        bench.do(lambda servo: servo.change_id(7))
    assert bench.servo.id == 5


@models_that(can_change_baud)
def test_a_servo_whose_speed_does_not_change_is_spoken_to_at_the_old_one(key: str) -> None:
    bench = Bench(key, SYNC, Answers.READS)
    bench.line.on_request = lambda request: not sample_of(key).changes_speed(request)
    with pytest.raises(BusError, match=f"still at id 5 at {factory(key)} baud"):
        bench.do(lambda servo: servo.change_baud(other(key)))
    assert bench.at() == bench.really_at() == (5, factory(key))
    assert bench.line.baud == factory(key)
    assert bench.stored("baud") == MODELS[key].register("baud").default  # also after its next start
    bench.do(lambda servo: servo.ping())


def test_a_herkulex_stopped_between_its_two_ids_is_finished() -> None:
    bench = Bench("drs0602", SYNC, Answers.READS)
    bench.real.memory.eeprom[DRS0602.id] = 7  # as another program left it: EEP has the new id, RAM the old one
    bench.do(lambda servo: servo.change_id(7))
    assert bench.at() == bench.really_at() == (7, 115_200)
    assert bench.servo.eeprom_writes == 0  # it was there already


def test_a_second_servo_with_the_new_id_keeps_both_apart() -> None:
    line = Lossy("rx28@5,7")
    bus = Bus(line, echo=False)
    with pytest.raises(UsageError, match="id 7 is not free"):
        bus.attach(RX28, 5).change_id(7)
    assert [servo.id for servo in line.servos] == [5, 7]


@every_model
@pytest.mark.parametrize("id", [254, 255, -1])
def test_broadcast_ids_are_refused_before_anything_is_sent(key: str, id: int) -> None:
    bench = Bench(key, SYNC, Answers.READS)
    with pytest.raises(BadValue, match=r"is not in 0 \.\. 253"):
        bench.do(lambda servo: servo.change_id(id))
    assert bench.line.requests == []


@every_model
def test_id_and_speed_cannot_be_written_as_if_they_were_settings(key: str) -> None:
    bench = Bench(key, SYNC, Answers.READS)
    model = MODELS[key]
    rows = [(model.register("id"), 7, "change_id")]
    if can_change_baud(model):
        rows.append((model.register("baud"), other(key), "change_baud"))
    servo: Any = bench.servo
    for row, value, verb in rows:
        jobs = [
            (servo.write, (row, value)),
            (servo.write_many, ({row: value},)),
            (servo.write_raw, ({row: row.encode(value)},)),
            (servo.store, ({row: value},)),
        ]
        for job, arguments in jobs:
            with pytest.raises(UsageError, match=rf"use {verb}\(\)"):
                job(*arguments)
    assert bench.line.requests == []


def test_a_port_that_goes_away_during_a_change_says_so() -> None:
    bench = Bench("rx28", SYNC, Answers.EVERYTHING)

    def unplug(request: bytes) -> bool:
        if sample_of("rx28").writes_id(request):
            raise OSError("unplugged")
        return True

    bench.line.on_request = unplug
    with pytest.raises(OSError, match="unplugged"):
        bench.do(lambda servo: servo.change_id(7))
    assert bench.at() == bench.really_at()


# On a line that loses nothing


def test_change_baud_of_an_rx28() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.find(1, family="dynamixel")
        servo.change_baud(1_000_000)
        assert servo.read(RX28.baud) == 1_000_000
        assert bus.transport.baud == 1_000_000


def test_change_baud_of_a_drs0602() -> None:
    with servobus.open("virtual:drs0602@1?clock=virtual") as bus:
        servo = bus.find(1, family="herkulex")
        servo.change_baud(500_000)
        assert servo.read(DRS0602.baud) == 500_000
        assert bus.transport.baud == 500_000


def test_the_lx16a_has_one_speed() -> None:
    with servobus.open("virtual:lx16a@1?clock=virtual") as bus, pytest.raises(UsageError, match="115200"):
        bus.find(1, family="lewansoul").change_baud(9600)


def test_reset_of_an_rx28() -> None:
    with servobus.open("virtual:rx28@9?clock=virtual") as bus:
        servo = bus.find(9, family="dynamixel")
        servo.write(RX28.highest_limit_temperature, 50)
        servo.reset()
        assert servo.id == 1
        assert servo.read(RX28.highest_limit_temperature) == 80


def test_reset_of_a_drs0602_keeps_what_is_named() -> None:
    with servobus.open("virtual:drs0602@9?clock=virtual") as bus:
        servo = bus.find(9, family="herkulex")
        servo.store({DRS0602.max_temperature: 60.0})
        servo.reset(keep=frozenset({"id"}))
        assert servo.id == 9
        assert servo.read(DRS0602.max_temperature) == 80.0
        servo.reset()
        assert servo.id == 219


def test_a_speed_where_the_id_is_taken_is_refused() -> None:
    with servobus.open("virtual:rx28@1,2?clock=virtual") as bus:
        one, two = bus.scan(family="dynamixel", ids=[1, 2])
        two.change_baud(1_000_000)
        two.change_id(1)  # not the same speed: nobody is in the way
        with pytest.raises(UsageError, match="another servo answers to id 1 at 57600"):
            two.change_baud(57_600)
        two.ping()
        one.ping()


def test_a_reset_that_would_make_twins_is_refused() -> None:
    with servobus.open("virtual:rx28@1,2?clock=virtual") as bus:
        one, two = bus.scan(family="dynamixel", ids=[1, 2])
        two.change_baud(1_000_000)
        with pytest.raises(UsageError, match="would get id 1 at 57600 baud"):
            two.reset()
        two.ping()
        one.ping()
