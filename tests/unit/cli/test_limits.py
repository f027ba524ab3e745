"""Limits that cross are refused, by whatever way they are written, and bits that a servo sets itself are no failure."""

import itertools
from collections.abc import Callable
from typing import Any

import pytest

from samples import may_be_equal, sample_models
from servobus import DRS0602, MODELS, RX28, BadValue
from servobus.core.registers import Register
from unit.cli.conftest import DRS, RX, Run
from unit.lossy import ASYNC, SYNC, Bench
from unit.served import Arm

DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])
VERBS = pytest.mark.parametrize("verb", ["write_many", "store", "write_raw"])
PAIRS = pytest.mark.parametrize("pair", [("min_position", "max_position"), ("min_voltage", "max_voltage")])


def rows_of(key: str, pair: tuple[str, str]) -> tuple[Register[Any], Register[Any]]:
    return MODELS[key].register(pair[0]), MODELS[key].register(pair[1])


def put(bench: Bench, verb: str, values: dict[Register[Any], int]) -> None:
    given = values if verb == "write_raw" else {row: row.decode(raw) for row, raw in values.items()}
    bench.do(lambda servo: getattr(servo, verb)(given))


def kept(bench: Bench) -> dict[str, int]:
    bench.line.sleep(0.01)
    return bench.real.memory.stored()


@DRIVERS
@VERBS
@PAIRS
@sample_models
def test_N21_crossed_limits_are_refused_and_nothing_is_written(
    key: str, pair: tuple[str, str], verb: str, driver: str
) -> None:
    """Crossed and equal, both given or one against the one that the servo has."""
    bench = Bench(key, driver)
    low, high = rows_of(key, pair)
    first, last = max(low.limits[0], high.limits[0]), min(low.limits[1], high.limits[1])
    middle = (first + last) // 2
    before = kept(bench)
    have_low, have_high = before[low.name], before[high.name]
    equal = may_be_equal(MODELS[key], pair)
    crossed = [{low: last, high: first}, {low: middle, high: middle}]
    if have_high < low.limits[1]:
        crossed.append({low: have_high + 1})
    elif have_high not in equal:
        crossed.append({low: have_high})
    if have_low >= high.limits[0] and have_low not in equal:
        crossed.append({high: have_low})
    for values in crossed:
        with pytest.raises(BadValue, match=rf"{low.name} = .* is not below {high.name} = .*nothing was written"):
            put(bench, verb, values)
        assert kept(bench) == before


@PAIRS
@sample_models
def test_N21_limits_in_order_are_taken(key: str, pair: tuple[str, str]) -> None:
    bench = Bench(key, SYNC)
    low, high = rows_of(key, pair)
    first, last = max(low.limits[0], high.limits[0]), min(low.limits[1], high.limits[1])
    for values in itertools.permutations({low: last - 1, high: last}.items()):
        put(bench, "store", dict(values))
        assert (kept(bench)[low.name], kept(bench)[high.name]) == (last - 1, last)
        put(bench, "store", {low: first, high: first + 1})
        assert (kept(bench)[low.name], kept(bench)[high.name]) == (first, first + 1)


def test_N21_both_zero_is_endless_turn_of_an_rx28_alone() -> None:
    bench = Bench("rx28", SYNC)
    put(bench, "write_raw", {RX28.cw_angle_limit: 0, RX28.ccw_angle_limit: 0})
    assert bench.real.endless  # type: ignore[attr-defined] # it is an RX-28
    bench = Bench("drs0602", SYNC)
    with pytest.raises(BadValue, match="is not below"):
        put(bench, "write_raw", {DRS0602.min_position: 0, DRS0602.max_position: 0})


def test_N21_write_says_it_in_degrees_and_volts(refused: Callable[..., str]) -> None:
    said = refused("write", RX, 1, "max_position=20", "min_position=200")
    assert "cw_angle_limit = 200.0° is not below ccw_angle_limit = 19.9°" in said
    said = refused("write", RX, 1, "max_voltage=8", "min_voltage=12")
    assert "lowest_limit_voltage = 12.0 V is not below highest_limit_voltage = 8.0 V" in said
    assert "is not below" in refused("write", DRS, 219, "min_position=161", "--save")


@pytest.mark.parametrize("torque", ["on", "off"])
def test_N14_the_mend_for_a_latched_error_works(run: Run, torque: str) -> None:
    """The example of `write --help`, which `doctor` prints too: the bits for the torque come back at once."""
    with Arm("drs0602@219") as arm:
        run("torque", arm.name, 219, torque)
        said = run("write", arm.name, 219, "status_error=0", "status_detail=0").stdout
        with arm.open() as bus:
            (now,) = bus.find(219, family="herkulex").read_raw([DRS0602.status_detail])
    assert ("torque_on" in said.splitlines()[1]) == (torque == "on") == bool(now & 0x40)


def test_N14_live_bits_are_those_of_the_manual() -> None:
    """Status Detail: moving 0x01, in position 0x02, torque on 0x40; the others are causes that stay (4-2 NO 44)."""
    assert DRS0602.status_detail.live == 0x43
    for cause in (0x04, 0x08, 0x10, 0x20):
        assert not DRS0602.status_detail.took(0, cause | 0x42)
    assert not DRS0602.status_error.took(0, 0x01)


@sample_models
def test_N14_no_other_register_of_a_backup_has_live_bits(key: str) -> None:
    """What a backup holds is compared whole."""
    model = MODELS[key]
    assert all(not row.live for row in model.registers.values() if row.name in Bench(key, SYNC).real.memory.stored())
