"""Joint space and servo space: there and back, for both directions, any zero and any ratio."""

import math

from hypothesis import given
from hypothesis import strategies as st
from pytest import approx  # noqa: PT013 - it stands in every line

from servobus.robots.axis import Axis

angles = st.floats(-50, 50)
axes = st.builds(Axis, zero=st.floats(-20, 20), direction=st.sampled_from([1, -1]), ratio=st.floats(0.01, 100))


def close(value: float) -> object:
    return approx(value, rel=1e-9, abs=1e-9)


@given(axes, angles)
def test_positions(axis: Axis, angle: float) -> None:
    assert axis.to_joint(axis.to_servo(angle)) == close(angle)
    assert axis.to_servo(axis.to_joint(angle)) == close(angle)
    assert axis.to_joint(axis.zero) == 0
    assert axis.to_servo(0.0) == axis.zero


@given(axes, angles)
def test_positions_are_those_of_the_formula(axis: Axis, angle: float) -> None:
    assert axis.to_joint(angle) == close(axis.direction * (angle - axis.zero) / axis.ratio)


@given(axes, angles, angles)
def test_changes_are_the_difference_of_positions(axis: Axis, one: float, other: float) -> None:
    change = axis.to_servo(other) - axis.to_servo(one)
    assert axis.change_to_servo(other - one) == approx(change, rel=1e-6, abs=1e-9)
    assert axis.change_to_joint(axis.change_to_servo(one)) == close(one)
    assert axis.change_to_servo(axis.change_to_joint(one)) == close(one)


@given(axes, angles, st.floats(-1, 1))
def test_speed_and_load_have_the_sign_of_the_motion(axis: Axis, speed: float, load: float) -> None:
    """A servo that turns the joint upwards has there a speed and a load above 0, whatever its direction."""
    assert math.copysign(1, axis.change_to_joint(axis.direction * abs(speed))) >= 0
    assert axis.load_to_joint(axis.direction * abs(load)) >= 0
    assert abs(axis.load_to_joint(load)) == abs(load)
    assert axis.load_to_joint(axis.load_to_joint(load)) == load


@given(axes, angles, angles)
def test_limits_are_ordered_after_the_sign(axis: Axis, one: float, other: float) -> None:
    low, high = sorted((one, other))
    servo = axis.range_to_servo(low, high)
    assert servo[0] <= servo[1]
    assert set(servo) == {axis.to_servo(low), axis.to_servo(high)}
    assert axis.range_to_joint(*servo) == (close(low), close(high))
    joint = axis.range_to_joint(low, high)
    assert joint[0] <= joint[1]


@given(axes, st.tuples(angles, angles, angles).map(sorted))
def test_what_is_inside_limits_is_inside_in_both_spaces(axis: Axis, three: list[float]) -> None:
    low, angle, high = three
    least, most = axis.range_to_servo(low, high)
    assert least - 1e-9 <= axis.to_servo(angle) <= most + 1e-9
