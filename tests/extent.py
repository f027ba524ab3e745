"""How much a run of the tests covers; tests/conftest.py sets it before any other file of the tests is read."""

from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")

everything = False
"""Whether `--all` was given: each model where else a few stand for all, and more examples of each property."""


def some(values: Sequence[T], few: int) -> Sequence[T]:
    """Give the first few of these values; all of them with `--all`."""
    return values if everything else values[:few]


def spread(values: Sequence[T], few: int) -> list[T]:
    """Give so many of these values, spread evenly from the first to the last; all of them with `--all`."""
    last = len(values) - 1
    if everything or last < few:
        return list(values)
    return [values[n * last // (few - 1)] for n in range(few)]


def in_turn(*numbers: int, every: int) -> bool:
    """Tell whether a cell of a table, given by its number in each direction, is run: all of them with `--all`.

    Else one in so many is, in such a way that each has its share in every row, whichever direction that runs in.
    """
    return everything or sum(numbers) % every == 0
