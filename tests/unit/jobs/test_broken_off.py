"""Changes that break off half-way: what was there before is told, and one call brings it back."""

from collections.abc import Callable
from typing import Any

import pytest

import extent
from samples import (
    can_change_baud,
    can_reset,
    can_turn,
    limits_turn,
    models_that,
    other_bauds,
    sample_models,
    turning,
)
from servobus import MODELS, RX28, BusError, NoReply, PortLost, ServobusError, deg
from unit.lossy import CHOSEN_DRIVERS, DRIVERS, SYNC, Bench

LOW, HIGH = 68, 955
"""19.9 and 280.1 degrees, by the scale of manual 3-4-2."""


def limited(driver: str) -> Bench:
    bench = Bench("rx28", driver)
    bench.real.memory.store(RX28.cw_angle_limit, LOW)
    bench.real.memory.store(RX28.ccw_angle_limit, HIGH)
    return bench


def cut_from(bench: Bench, number: int, *, unplug: bool = False, reply: bool = False) -> None:
    """Have the line go with the request of this number, or with its reply."""
    seen = 0

    def cut(_request: bytes) -> bool:
        nonlocal seen
        seen += 1
        if seen == number and unplug:
            raise PortLost("the port is gone")
        if reply:
            bench.line._deaf = seen >= number
            return seen <= number
        return seen < number

    bench.line.on_request = cut


@DRIVERS
@pytest.mark.parametrize("how", ["request", "reply", "unplug"])
def test_N23_turn_that_breaks_off_tells_the_limits(driver: str, how: str) -> None:
    """At whatever packet: as soon as the limits may be lost, the error has them, and one call sets them again."""
    bench = limited(driver)
    bench.do(lambda servo: servo.torque_on())
    bench.line.lose()
    bench.do(lambda servo: servo.turn(output=0.2))
    count = len(bench.line.requests)
    told = 0
    for number in range(1, count + 1):
        bench = limited(driver)
        bench.do(lambda servo: servo.torque_on())
        cut_from(bench, number, unplug=how == "unplug", reply=how == "reply")
        with pytest.raises((BusError, PortLost)) as caught:
            bench.do(lambda servo: servo.turn(output=0.2))
        bench.line.on_request, bench.line._deaf = None, False
        bench.line.sleep(1.0)
        before = caught.value.before
        if bench.stored("cw_angle_limit") != LOW or bench.stored("ccw_angle_limit") != HIGH:
            assert before
        if before:
            told += 1
            assert before["cw_angle_limit"] == pytest.approx(19.94 * deg, abs=0.01)
            assert before["ccw_angle_limit"] == pytest.approx(280.06 * deg, abs=0.01)
            assert "19.9°" in str(caught.value)
            assert "position_mode((19.9 * deg, 280.1 * deg))" in str(caught.value)
            limits = before["cw_angle_limit"], before["ccw_angle_limit"]
            bench.do(lambda servo, limits=limits: servo.position_mode(limits))  # type: ignore[misc]
            assert (bench.stored("cw_angle_limit"), bench.stored("ccw_angle_limit")) == (LOW, HIGH)
    assert told > count / 2


def unplug_behind(bench: Bench, number: int) -> None:
    """Have the port go when the request of this number is out, and before its reply is read."""
    seen = 0

    def watch(_request: bytes) -> bool:
        nonlocal seen
        seen += 1
        bench.line.unplugged = seen >= number
        return True

    bench.line.on_request = watch


@CHOSEN_DRIVERS
@pytest.mark.parametrize("cut", [cut_from, unplug_behind])
@sample_models
def test_N23_an_id_that_may_have_changed_is_told(key: str, cut: Callable[[Bench, int], None], driver: str) -> None:
    """The line goes at each packet: the servo has one of two ids, and the error names the old one."""
    bench = Bench(key, driver)
    bench.line.lose()
    bench.do(lambda servo: servo.change_id(7))
    for number in range(3, len(bench.line.requests) + 1):
        bench = Bench(key, driver)
        cut(bench, number)
        with pytest.raises((NoReply, PortLost)) as caught:
            bench.do(lambda servo: servo.change_id(7))
        bench.line.on_request, bench.line.unplugged = None, False
        bench.line.sleep(1.0)
        if bench.real.id != 5:
            assert caught.value.before["id"] == 5
            assert "it had id 5 before; if it answers to 7 now, change_id(5) undoes that" in str(caught.value)


@models_that(can_change_baud)
def test_N23_a_speed_that_may_have_changed_is_told(key: str) -> None:
    new = other_bauds(MODELS[key])[0]
    old = MODELS[key].factory_baud
    bench = Bench(key, SYNC)
    bench.line.lose()
    bench.do(lambda servo: servo.change_baud(new))
    seen = 0
    for number in range(3, len(bench.line.requests) + 1):
        bench = Bench(key, SYNC)
        cut_from(bench, number)
        failure: ServobusError | None = None
        try:
            bench.do(lambda servo: servo.change_baud(new))
        except ServobusError as error:
            failure = error
        bench.line.on_request = None
        bench.line.sleep(1.0)
        if bench.servo.baud == new:
            assert bench.at() == bench.really_at()  # it was changed, and the object knows
            assert failure is None or failure.before["baud"] == old
        elif bench.really_at()[1] != old or bench.stored("baud") != MODELS[key].register("baud").default:
            seen += 1
            assert failure is not None
            assert failure.before["baud"] == old
            assert f"change_baud({old}) undoes that" in str(failure)
    assert seen


@CHOSEN_DRIVERS
@models_that(can_reset)
def test_N23_a_reset_that_breaks_off_has_the_settings_in_its_error(key: str, driver: str) -> None:
    model = MODELS[key]
    hot = model.register("max_temperature")
    bench = Bench(key, driver)
    bench.line.lose()
    bench.do(lambda servo: servo.reset())
    seen = 0
    for number in extent.spread(range(2, len(bench.line.requests) + 1), 12):
        bench = Bench(key, driver)
        bench.real.memory.store(hot, 55)
        cut_from(bench, number)
        failure: ServobusError | None = None
        try:
            bench.do(lambda servo: servo.reset())
        except ServobusError as error:
            failure = error
        bench.line.on_request = None
        bench.line.sleep(1.0)
        if failure is not None and bench.stored(hot.name) != 55:
            seen += 1
            assert failure.before[hot.name] == hot.decode(55)
            assert failure.before["id"] == 5
            assert "it was id 5 at" in str(failure)
    assert seen


@sample_models
@pytest.mark.parametrize("verb", ["write_many", "store"])
def test_N23_limits_whose_write_breaks_off_are_told(key: str, verb: str) -> None:
    model = MODELS[key]
    rows = model.register("min_position"), model.register("max_position")
    values: dict[Any, Any] = {row: row.decode((row.limits[0] + row.limits[1]) // 2 + n) for n, row in enumerate(rows)}
    bench = Bench(key, SYNC)
    bench.line.lose()
    bench.do(lambda servo: getattr(servo, verb)(values))
    old = Bench(key, SYNC).real.memory.stored()
    for number in range(1, len(bench.line.requests) + 1):
        bench = Bench(key, SYNC)
        cut_from(bench, number)
        failure: ServobusError | None = None
        try:
            bench.do(lambda servo: getattr(servo, verb)(values))
        except NoReply as error:
            failure = error
        bench.line.sleep(0.1)
        if failure is not None and bench.real.memory.stored() != old:
            told = {row.name: row.encode(failure.before[row.name]) for row in rows}
            assert told == {row.name: old[row.name] for row in rows}
            assert f"what was there before: {rows[0].name} = " in str(failure)


@models_that(lambda model: can_turn(model) and not limits_turn(model))
def test_N23_a_mode_that_loses_nothing_is_not_told_about(key: str) -> None:
    """HerkuleX and LX keep their limits in endless turn."""
    bench = Bench(key, SYNC)
    bench.do(lambda servo: servo.torque_on())
    before = bench.real.memory.stored()
    bench.do(lambda servo: servo.turn(**turning(MODELS[key])))
    bench.line.sleep(0.1)
    assert bench.real.memory.stored() == before
