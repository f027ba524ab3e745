"""Roots and extrema of polynomials, against polynomials made from their roots."""

import math
import random
from itertools import pairwise

import pytest

from servobus.robots.trajectory.polynomial import crossings, derivative, extrema, largest, value


def with_roots(*roots: float) -> tuple[float, ...]:
    product = [1.0]
    for root in roots:
        product = [a - root * b for a, b in zip([0.0, *product], [*product, 0.0], strict=True)]
    return tuple(product)


def test_values_and_derivatives() -> None:
    assert value((1.0, -2.0, 3.0), 2.0) == 9.0
    assert value((), 2.0) == 0.0
    assert derivative((1.0, -2.0, 3.0)) == (-2.0, 6.0)
    assert derivative((1.0, -2.0, 3.0), 2) == (6.0,)
    assert derivative((1.0,)) == ()


@pytest.mark.parametrize("count", range(1, 6))
def test_every_crossing_is_found(count: int) -> None:
    draw = random.Random(count)
    for _ in range(50):
        roots = sorted(draw.uniform(0.0, 2.0) for _ in range(count))
        if any(b - a < 0.02 for a, b in pairwise(roots)):
            continue
        inside = [root for root in roots if root < 1.5]
        assert crossings(with_roots(*roots), 1.5) == pytest.approx(inside, abs=1e-9)


def test_a_root_that_is_only_touched_is_no_crossing() -> None:
    assert crossings(with_roots(0.5, 0.5), 1.0) == []
    assert crossings(with_roots(0.5, 0.5, 0.5), 1.0) == pytest.approx([0.5], abs=1e-4)


def test_leading_zeros_and_constants_cross_nothing() -> None:
    assert crossings((), 1.0) == crossings((0.0, 0.0), 1.0) == crossings((3.0, 0.0, 0.0), 1.0) == []


def test_extrema_of_a_sine_series() -> None:
    sine = tuple((0, 1, 0, -1)[n % 4] / math.factorial(n) for n in range(16))
    (_, low), (top, at), _ = extrema(sine, 2.0)
    assert (low, top, at) == pytest.approx((0.0, 1.0, math.pi / 2), abs=1e-9)
    assert largest(sine, derivative(sine), 2.0) == (top, at)
    assert largest((-3.0, 1.0), (1.0,), 2.0) == (3.0, 0.0)
    assert largest((), (), 2.0) == (0.0, 0.0)
