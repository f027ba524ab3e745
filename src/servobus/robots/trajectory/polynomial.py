"""Polynomials of one variable: their values, derivatives, roots and extrema.

A polynomial is the tuple of its coefficients, the constant first: (c0, c1, c2) is c0 + c1·t + c2·t².
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

Polynomial: TypeAlias = tuple[float, ...]

_STEPS = 100
"""More steps than the search for a root takes; about ten are usual."""
_CLOSE = 1e-15
"""Width of an interval, relative to its end, that holds no other float worth trying."""


def value(polynomial: Sequence[float], time: float) -> float:
    result = 0.0
    for coefficient in reversed(polynomial):
        result = result * time + coefficient
    return result


def derivative(polynomial: Sequence[float], order: int = 1) -> Polynomial:
    """Give the first, second ... derivative; () is the polynomial that is 0 everywhere."""
    result = polynomial
    for _ in range(order):
        result = [power * coefficient for power, coefficient in enumerate(result)][1:]  # a list is made quickest
    return tuple(result)


def crossings(polynomial: Sequence[float], end: float) -> list[float]:
    """Give the places between 0 and `end`, both exclusive, where the polynomial changes its sign, in order.

    Between two extrema a polynomial only rises or only falls, so it crosses zero there at most once; the extrema are
    the crossings of the derivative. A root without a change of sign is no extremum of the integral, and is left out.
    """
    while polynomial and polynomial[-1] == 0:
        polynomial = polynomial[:-1]
    if len(polynomial) < 2:
        return []
    if len(polynomial) == 2:
        root = -polynomial[0] / polynomial[1]
        return [root] if 0 < root < end else []
    if len(polynomial) == 3:
        return [root for root in _quadratic(*polynomial) if 0 < root < end]
    found = list[float]()
    for low, high in pairwise((0.0, *crossings(derivative(polynomial), end), end)):
        at_low, at_high = value(polynomial, low), value(polynomial, high)
        if at_low < 0 < at_high or at_high < 0 < at_low:
            found.append(_root(polynomial, (low, at_low), (high, at_high)))
    return found


def largest(polynomial: Sequence[float], slope: Sequence[float], end: float) -> tuple[float, float]:
    """Give the greatest magnitude from 0 to `end`, and the first time at which the polynomial has it.

    `slope` is its derivative, which whoever asks for one derivative after the other has at hand.
    """
    size, time = abs(polynomial[0]) if polynomial else 0.0, 0.0
    for turn in (*crossings(slope, end), end):
        there = abs(value(polynomial, turn))
        if there > size:
            size, time = there, turn
    return size, time


def at_most(polynomial: Sequence[float], end: float) -> float:
    """Give what the magnitude does not exceed from 0 to `end`; found much faster than the `largest`."""
    result = 0.0
    for coefficient in reversed(polynomial):
        result = result * end + abs(coefficient)
    return result


def extrema(polynomial: Sequence[float], end: float) -> list[tuple[float, float]]:
    """Give (value, time) at both ends of 0..`end` and wherever the polynomial turns in between, in order of time."""
    times = (0.0, *crossings(derivative(polynomial), end), end)
    return [(value(polynomial, time), time) for time in times]


def _quadratic(c: float, b: float, a: float) -> tuple[float, ...]:
    """Give the two roots of a t² + b t + c in order; none where they are one, as the sign does not change there."""
    under = b * b - 4 * a * c
    if not under > 0:
        return ()
    # The sum of two numbers of one sign: their difference would lose digits (W. Kahan).
    far = -(b + math.copysign(math.sqrt(under), b)) / 2
    one, other = far / a, c / far
    return (one, other) if one < other else (other, one)


def _root(polynomial: Sequence[float], low: tuple[float, float], high: tuple[float, float]) -> float:
    """Find the root in an interval, given as (time, value) of its ends, whose signs differ.

    Regula falsi; an end that stays twice running counts half, so that the interval shrinks from both sides: the
    Illinois algorithm (Dowell and Jarratt, BIT 11, 1971).
    """
    (left, at_left), (right, at_right) = low, high
    middle, moved = left, 0
    for _ in range(_STEPS):
        middle = (left * at_right - right * at_left) / (at_right - at_left)
        if not left < middle < right:  # by rounding
            middle = (left + right) / 2
        at_middle = value(polynomial, middle)
        if at_middle == 0 or right - left <= _CLOSE * right:
            break
        if (at_middle < 0) == (at_right < 0):
            right, at_right, at_left = middle, at_middle, at_left / 2 if moved > 0 else at_left
            moved = 1
        else:
            left, at_left, at_right = middle, at_middle, at_right / 2 if moved < 0 else at_right
            moved = -1
    return middle
