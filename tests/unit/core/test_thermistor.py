"""The scale of a temperature that is read from a thermistor."""

from typing import Any

import pytest

from servobus.core.units import Quantity, Thermistor
from servobus.families.herkulex.models.small import DRS0101

READINGS = {
    1: -72.89, 16: -32.49, 32: -18.68, 64: -1.34, 96: 12.14, 128: 25.00, 160: 39.07, 200: 62.71, 201: 63.48,
    216: 77.10, 222: 84.13, 223: 85.44, 240: 118.57, 250: 171.18, 255: 310.08,
}  # fmt: skip
"""Raw reading -> °C: some of the 256 lines that the program pyHerkuleX (ADC_TEMPERATURE) has for DRS-0101 and 0201."""
SCALE = DRS0101.temperature.scale


@pytest.mark.parametrize(("raw", "celsius"), READINGS.items())
def test_it_is_that_of_another_program(raw: int, celsius: float) -> None:
    assert SCALE.decode(raw) == pytest.approx(celsius, abs=0.01)


def test_the_limit_from_the_factory_is_what_the_manual_says() -> None:
    """The map has 0xDE, the words beside it 0xDF for 85 °C (DRS-0101/0201 manual, page 22)."""
    assert SCALE.encode(85.0) == 0xDF
    assert DRS0101.max_temperature.default == 0xDE


def test_every_raw_value_comes_back_and_more_is_hotter() -> None:
    told = [SCALE.decode(raw) for raw in range(256)]
    assert [SCALE.encode(one) for one in told] == [*range(256)]
    assert told == sorted(set(told))
    assert told[0] == pytest.approx(-80.57, abs=0.5)


def test_it_never_fails_to_read() -> None:
    assert SCALE.decode(-5) == SCALE.decode(0)
    assert SCALE.decode(10_000) == SCALE.decode(256)


@pytest.mark.parametrize("value", [-300.0, -273.15, float("nan"), float("inf"), True, None, "25"])
def test_what_is_no_temperature_is_refused(value: Any) -> None:
    with pytest.raises(ValueError, match=r"absolute zero|not a number"):
        SCALE.encode(value)


def test_the_coldest_and_the_hottest_have_a_raw_form() -> None:
    assert (SCALE.encode(-273.0), SCALE.encode(1e300)) == (0, 256)


def test_it_is_read_and_written_as_any_temperature() -> None:
    assert SCALE.unit == "degC"
    assert SCALE.parse("60 °C") == 60.0
    assert SCALE.show(SCALE.decode(222)) == "84 °C"
    assert isinstance(SCALE, Thermistor)
    assert not isinstance(SCALE, Quantity)
