import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobus.families.dynamixel import control as dynamixel1
from servobus.families.dynamixel.control import (
    EMANUAL_LEVELS,
    LEVELS,
    SPAN,
    STANDSTILL,
    arrived,
    compliance,
    endless,
    follow,
    pursue,
    strained,
    width,
)

units = st.integers(-1023, 1023)
shares = st.floats(0, 1)


def test_it_knows_nothing_of_the_rest() -> None:
    assert not [name for name, value in vars(dynamixel1).items() if "servobus" in getattr(value, "__module__", "")
                and value.__module__ != dynamixel1.__name__]  # fmt: skip


# Compliance


def test_the_example_of_the_manual() -> None:
    outputs = {unit: compliance(512 - unit, 5, 16, 10 / 1023, 1.0) for unit in range(1024)}
    assert {outputs[unit] for unit in range(492)} == {1.0}
    assert {outputs[unit] for unit in range(507, 518)} == {0.0}
    assert {outputs[unit] for unit in range(533, 1024)} == {-1.0}
    falling = [outputs[unit] for unit in range(491, 507)]
    steps = [before - after for before, after in itertools.pairwise(falling)]
    assert steps == pytest.approx([(1 - 10 / 1023) / 16] * 15)
    assert falling[-1] - steps[-1] == pytest.approx(10 / 1023)  # at 507 it would be Punch


@given(error=units, margin=st.integers(0, 254), slope=st.sampled_from((4, 8, 16, 32, 64, 128, 254)), punch=shares,
       limit=shares)  # fmt: skip
def test_compliance_pushes_towards_the_goal_within_the_limit(
    error: int, margin: int, slope: int, punch: float, limit: float
) -> None:
    output = compliance(error, margin, slope, punch, limit)
    assert abs(output) <= limit
    assert output * error >= 0
    if abs(error) <= margin:
        assert output == 0
    else:
        assert abs(output) >= min(punch, limit)
        assert output == -compliance(-error, margin, slope, punch, limit)
    if abs(error) >= margin + slope:
        assert abs(output) == limit or error == 0
    further = error + (1 if error >= 0 else -1)
    assert abs(compliance(further, margin, slope, punch, limit)) >= abs(output)


def test_seven_levels() -> None:
    assert [width(slope) for slope in (1, 5, 6, 11, 12, 23, 24, 32, 47, 48, 95, 96, 191, 192, 254)] == [
        4, 4, 8, 8, 16, 16, 32, 32, 32, 64, 64, 128, 128, 254, 254,
    ]  # fmt: skip
    assert [width(slope, EMANUAL_LEVELS) for slope in (1, 3, 4, 32, 254, 255)] == [2, 2, 4, 32, 128, 128]
    for _, level in LEVELS:
        assert width(level) == level


# Speed


def test_without_speed_control_the_set_point_is_the_goal() -> None:
    assert follow(3.0, 500, 1000, math.inf) == 1000


def test_the_set_point_goes_on_by_steps_and_stops_at_the_goal() -> None:
    points = [100.0]
    while points[-1] != 103:
        points.append(follow(points[-1], 100, 103, 0.75))
    assert points == [100, 100.75, 101.5, 102.25, 103]
    assert follow(103.0, 100, 103, 0.75) == 103
    assert follow(103.0, 100, 90, 0.75) == 102.25


@given(set_point=st.floats(-2000, 2000), position=units, goal=units, step=st.floats(0.001, 50))
def test_the_set_point_waits_for_the_shaft(set_point: float, position: int, goal: int, step: float) -> None:
    after = follow(set_point, position, goal, step)
    assert abs(after - position) <= SPAN + step + 1e-9 or after == goal
    held = max(min(set_point, position + SPAN), position - SPAN)
    assert abs(after - held) <= step * (1 + 1e-9) + 1e-9
    assert abs(goal - after) <= abs(goal - held)


def test_a_shaft_that_hangs_back_gets_all_there_is() -> None:
    assert pursue(SPAN, 1.0) == 1.0
    assert pursue(SPAN, 0.3) == 0.3
    assert pursue(-SPAN, 0.3) == -0.3
    assert pursue(SPAN / 4, 1.0) == 0.25
    assert pursue(SPAN / 4, -1.0) == 0.25
    assert pursue(5, 0.0) == 0


# Endless turn, load


def test_endless_turn_is_a_share_up_to_the_limit() -> None:
    assert [endless(share, 0.5) for share in (-1.0, -0.3, 0.0, 0.5, 0.7)] == [-0.5, -0.3, 0, 0.5, 0.5]


def test_what_is_too_much() -> None:
    assert strained(1.0, 1.0, 0.0)
    assert strained(-1.0, 1.0, 0.0)
    assert strained(-0.2, 0.2, STANDSTILL / 2)
    assert strained(1.0, 1.0, -3.0)  # it is even driven back
    assert not strained(1.0, 1.0, 2 * STANDSTILL)
    assert not strained(-1.0, 1.0, -2 * STANDSTILL)
    assert not strained(0.9, 1.0, 0.0)
    assert not strained(0.0, 0.0, 0.0)


def test_when_a_goal_is_reached() -> None:
    assert arrived(0, 0, 32, 0.0, False)
    assert arrived(-3, 3, 32, 0.0, False)
    assert not arrived(0, 0, 32, 1.0, False)
    assert not arrived(1, 0, 32, 0.0, False)
    assert arrived(31, 0, 32, 0.0, True)
    assert not arrived(-32, 0, 32, 0.0, True)
    assert not arrived(31, 0, 32, 0.0, False)
