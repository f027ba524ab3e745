"""Changes of settings: which values contradict each other, and what was there before a change that broke off."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from servobus.core.registers import Register
from servobus.errors import BadValue, ServobusError
from servobus.families.model import LimitPair, Model


def pairs_touched(model: type[Model], rows: Mapping[Register[Any], int]) -> list[LimitPair]:
    """List the pairs of limits of which one at least is among these rows."""
    return [pair for pair in model.limit_pairs if any(row in rows for row in pair.rows(model))]


def check_pairs(model: type[Model], values: Mapping[Register[Any], int], who: str) -> None:
    """Refuse limits of which the lower is not below the upper. Raises BadValue.

    Pairs of which one limit is not among the values are left out.
    """
    for pair in pairs_touched(model, values):
        low, high = pair.rows(model)
        if low in values and high in values and not pair.fits(values[low], values[high]):
            raise BadValue(
                f"{who}: {said(low, values[low])} is not below {said(high, values[high])}; "
                "the lower limit must be below the upper one, and nothing was written"
            )


def said(row: Register[Any], raw: int) -> str:
    """Write a register with a value for people: "max_torque = 50.0 %"."""
    return f"{row.name} = {row.said(raw)}"


def value(row: Register[Any], raw: int) -> Any:
    """Give the value of a raw integer, or that integer where it has no meaning."""
    try:
        return row.decode(raw)
    except ServobusError:
        return raw


@contextmanager
def before_told(before: Mapping[Register[Any], int]) -> Iterator[None]:
    """Have an error that breaks off what is written inside tell what was there before."""
    try:
        yield
    except ServobusError as error:
        if before:
            values = ", ".join(said(row, raw) for row, raw in before.items())
            found = {row.name: value(row, raw) for row, raw in before.items()}
            error.tell_before(found, f"what was there before: {values}")
        raise
