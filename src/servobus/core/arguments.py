"""Arguments of callers without type checks: what is none is refused in a sentence, before anything is sent."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from servobus.core.units import finite, said
from servobus.errors import BadValue, UsageError

T = TypeVar("T")

FASTEST = 4_000_000
"""bit/s; no adapter or servo here is faster."""


def check_baud(baud: int) -> int:
    """Give a speed in bit/s back. Raises BadValue."""
    number = finite(baud)
    if number is None or number != int(number) or not 1 <= number <= FASTEST:
        raise BadValue(
            f"{said(baud)} is not a speed in baud: give a whole number of bit/s from 1 to {FASTEST}, such as 115200"
        )
    return int(baud)


def check_bauds(bauds: int | Iterable[int] | None) -> tuple[int, ...] | None:
    """Give one speed or several as a tuple; None where none is said. Raises BadValue."""
    if bauds is None:
        return None
    if isinstance(bauds, str | bytes | Mapping) or not isinstance(bauds, Iterable):
        return (check_baud(bauds),)  # type: ignore[arg-type] # refused there if it is no number
    speeds = tuple(check_baud(baud) for baud in bauds)
    if not speeds:
        raise BadValue("no speed is given: None stands for the factory speeds")
    return speeds


def check_above_0(name: str, value: float) -> float:
    """Give a finite number above 0 back. Raises BadValue."""
    number = finite(value)
    if number is None or not number > 0:
        raise BadValue(f"{name} {said(value)} is not a number above 0")
    return number


def check_mapping(name: str, values: Mapping[Any, T], example: str) -> Mapping[Any, T]:
    """Give a mapping back. Raises UsageError, with an example, for anything else."""
    if not isinstance(values, Mapping):
        raise UsageError(f"{name} {said(values)} are no mapping: give them as in {example}")
    return values


def one_or_several(things: Any, is_one: Callable[[Any], bool]) -> list[Any]:
    """Give what may be one thing or several as a list; a thing that is neither stands in it alone."""
    if is_one(things) or isinstance(things, str | bytes) or not isinstance(things, Iterable):
        return [things]
    return list(things)
