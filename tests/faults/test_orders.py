"""What is asked of servos and must not harm: floods, lost halves of changes, long packets, wild goals (F18 to F24)."""

import math

import pytest

from faults.rig import FaultRig
from samples import (
    SAMPLE_KEYS,
    can_change_baud,
    every_model,
    goal_range,
    models_that,
    one_model_of_each_family,
    other_bauds,
    sample_models,
    sample_of,
    seams,
)
from servobus import MODELS, RX28, BadValue, EepromWear, UsageError, deg
from unit.lossy import CHOSEN_DRIVERS, DRIVERS, SYNC, Bench


@DRIVERS
@sample_models
def test_F18_a_flood_of_eeprom_writes_is_braked(key: str, driver: str) -> None:
    """A loop that stores another value each time: ten reach the EEPROM, then EepromWear, which names a remedy; the same
    value again writes nothing."""
    rig = FaultRig(key, driver)
    row = rig.model.register("max_temperature")
    stored: list[int] = []
    rig.real().memory.on_store = lambda: stored.append(1)

    def flood() -> None:
        for celsius in range(50, 70):
            rig.do(lambda bus: bus[1].store({row: float(celsius)}))  # noqa: B023 - carried out at once

    with pytest.raises(EepromWear, match="wait"):
        flood()
    rig.port.sleep(0.1)
    assert rig.bus[1].eeprom_writes == len(stored) == 10
    rig.do(lambda bus: bus[1].store({row: 59.0}))
    assert rig.bus[1].eeprom_writes == 10


@DRIVERS
def test_F18_a_locked_table_is_said_to_be(driver: str) -> None:
    """RX-28 Lock: UsageError with the addresses that stay open, and nothing is written."""
    rig = FaultRig("rx28", driver)
    rig.do(lambda bus: bus[1].write(rig.model.register("lock"), True))
    rig.inject(None)
    with pytest.raises(UsageError, match="24 to 35"):
        rig.do(lambda bus: bus[1].store({rig.model.register("max_torque"): 0.5}))
    assert [request for request in rig.port.sent if request[4] == 3] == []


@CHOSEN_DRIVERS
@sample_models
@pytest.mark.parametrize("lost", ["request", "reply"])
def test_F19_an_id_change_that_is_cut_off_is_finished(key: str, lost: str, driver: str) -> None:
    """Whichever packet of a change of id is lost, on its way there or back: the servo is found, under the new id."""
    for number in range(1, 9):
        bench = Bench(key, driver)
        bench.line.lose(**{lost: number})
        bench.do(lambda servo: servo.change_id(7))
        assert bench.at() == bench.really_at()
        assert bench.at()[0] == 7


@CHOSEN_DRIVERS
@models_that(can_change_baud)
@pytest.mark.parametrize("lost", ["request", "reply"])
def test_F19_a_baud_change_that_is_cut_off_is_finished(key: str, lost: str, driver: str) -> None:
    """The same for the speed: servo and bus are at the new one together."""
    baud = other_bauds(MODELS[key])[0]
    for number in range(1, 9):
        bench = Bench(key, driver)
        bench.line.lose(**{lost: number})
        bench.do(lambda servo: servo.change_baud(baud))
        assert bench.at() == bench.really_at() == (5, baud)
        assert bench.line.baud == baud


@DRIVERS
@every_model
def test_F19_a_broadcast_id_is_refused(key: str, driver: str) -> None:
    """Id 254 for one servo, as an id to ask or to give: BadValue, and nothing is sent."""
    rig = FaultRig(key, driver)
    rig.inject(None)
    with pytest.raises(BadValue, match="broadcast"):
        rig.do(lambda bus: bus[1].change_id(254))
    with pytest.raises(BadValue, match="broadcast"):
        rig.bus.attach(rig.model, 254)
    assert rig.port.sent == []


@CHOSEN_DRIVERS
@one_model_of_each_family
def test_F20_a_move_of_many_is_split_and_none_is_left_out(key: str, driver: str) -> None:
    """More servos than one packet holds (RX-28 manual 3-5-7: 143 bytes; DRS-0602 manual 5-1: 223): every one gets its
    goal, and no packet is too long."""
    count, longest = sample_of(key).crowd, sample_of(key).longest
    rig = FaultRig(key, driver, ids=f"1-{count}", settle=False)
    start = rig.real().position
    rig.do(lambda bus: bus.torque_on(list(bus)))
    rig.inject(None)
    rig.do(lambda bus: bus.start_move({id: start + (5 + id / 10) * deg for id in range(1, count + 1)}, time=1.0))
    assert max(map(len, rig.port.sent)) <= longest
    rig.port.sleep(3.0)
    for real in rig.reals:
        assert real.position == pytest.approx(start + (5 + real.id / 10) * deg, abs=3 * deg)


WILD = [math.nan, math.inf, -math.inf, 1e9, -100.0]


@DRIVERS
@sample_models
@pytest.mark.parametrize("goal", WILD)
def test_F23_wild_numbers_stay_off_the_wire(key: str, goal: float, driver: str) -> None:
    """NaN, infinities, angles that cannot be: BadValue before a byte is sent, for goals, times and speeds."""
    rig = FaultRig(key, driver)
    rig.inject(None)
    row = rig.model.register("goal_position")
    with pytest.raises((BadValue, UsageError)):
        rig.do(lambda bus: bus[1].write(row, goal))
    for options in ({}, {"time": 1.0}):
        with pytest.raises(BadValue):
            rig.do(lambda bus, chosen: bus[1].start_move(goal, **chosen), options)
    for options in ({"time": -abs(goal)}, {"speed": -abs(goal)}):
        with pytest.raises(BadValue):
            rig.do(lambda bus, chosen: bus[1].start_move(1.0, **chosen), options)
    assert rig.port.sent == []


@DRIVERS
@sample_models
def test_F23_a_step_too_far_and_degrees_for_radians(key: str, driver: str) -> None:
    """Beyond `max_step`: refused before anything moves. 90 in place of 90 * deg: refused, with the hint."""
    rig = FaultRig(key, driver)
    rig.do(lambda bus: bus[1].torque_on())
    start = rig.real().position
    rig.bus[1].max_step = 5 * deg
    with pytest.raises(BadValue, match="max_step"):
        rig.do(lambda bus: bus[1].start_move(start + 30 * deg, time=1.0))
    with pytest.raises(BadValue, match="did you mean 90 \\* deg"):
        rig.do(lambda bus: bus[1].start_move(90.0))
    rig.port.sleep(1.0)
    assert rig.real().position == pytest.approx(start, abs=0.5 * deg)


AT_SEAMS = [(key, raw) for key in SAMPLE_KEYS for raw in seams(MODELS[key])]


@DRIVERS
@pytest.mark.parametrize(("key", "raw"), AT_SEAMS)
def test_F24_torque_at_the_end_of_the_range_moves_nothing(key: str, raw: int, driver: str) -> None:
    """At the ends of the range, and beyond them where a servo tells such angles: what is read is where the shaft is,
    and the torque comes on there without a jump."""
    rig = FaultRig(key, driver, ids="1")
    row = rig.model.register("present_position")
    here = row.decode(raw)
    rig.real().turn_shaft(here)
    rig.port.sleep(0.05)
    assert rig.do(lambda bus: bus[1].read(row)) == pytest.approx(here, abs=0.5 * deg)
    rig.do(lambda bus: bus[1].torque_on())
    first, last = goal_range(rig.model)
    inside = min(max(raw, first), last)  # it can be sent nowhere else
    for _ in range(50):
        rig.port.sleep(0.02)
        low, high = sorted((here, row.decode(inside)))
        assert low - 1.5 * deg <= rig.real().position <= high + 1.5 * deg


@DRIVERS
def test_F24_a_herkulex_past_a_whole_turn(driver: str) -> None:
    """Multi-turn: 400° from the middle read as they are, not 40°, and a calibration across the seam of the counter
    changes the reading by just that."""
    rig = FaultRig("drs0602", driver, ids="1")
    row, difference = rig.model.register("present_position"), rig.model.register("calibration_difference")
    before = rig.read()
    rig.do(lambda bus: bus[1].write_raw({difference: 100}))
    assert (rig.read() - before) % 32_768 == 32_768 - 100
    rig.do(lambda bus: bus[1].write_raw({difference: 0}))
    assert rig.read() == before
    for degrees in range(0, 401, 20):  # turned by hand, step by step, as the counter follows
        rig.real().turn_shaft(row.decode(16_384) + degrees * deg)
        rig.port.sleep(0.05)
        value = rig.do(lambda bus: bus[1].read(row))
        assert value == pytest.approx(row.decode(16_384) + degrees * deg, abs=0.5 * deg)


def test_F24_the_dead_zone_of_an_rx28_is_never_a_goal() -> None:
    """Goals in the 60° that an RX-28 cannot reach are refused, so that none is wrapped to the other end."""
    rig = FaultRig("rx28", SYNC)
    for degrees in (-1, 301, 330, 359, 360, 361):
        with pytest.raises(BadValue):
            rig.do(lambda bus, angle: bus[1].write(RX28.goal_position, angle), degrees * deg)
