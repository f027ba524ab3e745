"""Whatever a caller writes: every register takes it, or refuses it with BadValue and a sentence."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from samples import every_model
from servobus import MODELS, RX28, BadValue
from servobus.core.registers import Register
from servobus.core.units import BaudDivisor, Quantity, Switch


def written(key: str) -> list[Register[Any]]:
    """Give the registers of a model that can be written."""
    return [row for row in MODELS[key].registers.values() if row.writable]


ROWS = [row for key in MODELS for row in written(key)]
rows = st.sampled_from(ROWS)
NO_NUMBERS: list[Any] = [
    "3", "", b"\x03", None, [], {}, object(), 3j, math.inf, -math.inf, math.nan, 10**400, -(10**5000),
]  # fmt: skip
"""What no register can mean, whatever its scale."""
anything = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(), st.binary(), st.fractions(), st.complex_numbers(),
    st.sampled_from(NO_NUMBERS),
)  # fmt: skip


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: f"{value!r:.12}" if value != NO_NUMBERS[-1] else "huge")
@every_model
def test_what_is_no_number_is_refused_with_a_sentence(key: str, value: Any) -> None:
    for row in written(key):
        with pytest.raises(BadValue, match=f"{row.name}: ") as caught:
            row.encode(value)
        assert len(str(caught.value)) < 1000


@every_model
def test_true_is_no_number(key: str) -> None:
    for row in written(key):
        if isinstance(row.scale, Switch):
            continue
        for value in (True, False):
            with pytest.raises(BadValue, match=f"{row.name}: {value} (baud )?is no"):
                row.encode(value)


@given(rows, anything)
def test_a_value_is_taken_or_refused_and_nothing_else(row: Register[Any], value: Any) -> None:
    try:
        raw = row.encode(value)
    except BadValue:
        return
    assert type(raw) is int
    assert row.accepts(raw)


@given(rows, st.floats(allow_nan=False, allow_infinity=False), st.integers(0, 2**16))
def test_a_share_of_a_unit_is_refused_where_units_are_counted(row: Register[Any], part: float, whole: int) -> None:
    value = whole + math.modf(part)[0]
    if isinstance(row.scale, Quantity | BaudDivisor) or value == int(value):  # a speed is taken within 3 %
        return
    with pytest.raises(BadValue):
        row.encode(value)


@pytest.mark.parametrize("raw", [3.7, 3.0, "3", None, True, math.nan, math.inf])
def test_a_raw_value_is_a_whole_number(raw: Any) -> None:
    with pytest.raises(BadValue, match=r"max_torque: .* is not a whole number"):
        RX28.max_torque.check(raw)
    with pytest.raises(BadValue, match="max_torque: an int of 16610 bits is not in"):
        RX28.max_torque.check(10**5000)


def test_flags_are_not_rounded() -> None:
    with pytest.raises(BadValue, match=r"alarm_led: 3\.7 is no set of flags: give Error, or a whole number"):
        RX28.alarm_led.encode(3.7)  # type: ignore[arg-type] # that is the point
