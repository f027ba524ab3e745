"""What plans and watches a motion: profiles, ramps, stop detection, step counting."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobus.virtual.physics.trajectory import GoalTrajectory, Profile, Ramp, StepCounter, StopDetection, ramp_time

finite = st.floats(-1e4, 1e4)
shares = st.floats(0.05, 0.5)
durations = st.floats(0.05, 3.0)


# Profiles


@given(finite, finite, durations, shares, finite)
def test_area_is_distance(start: float, goal: float, duration: float, share: float, velocity: float) -> None:
    profile = Profile(start, goal, duration, duration * share, velocity)
    corners = [0.0, profile.ramp, duration - profile.ramp, math.nextafter(duration, 0) - 1e-9]
    # Between its corners the speed is a straight line.
    area = sum((b - a) * (profile.speed(a) + profile.speed(b)) / 2 for a, b in pairwise(corners))
    assert area == pytest.approx(goal - start, abs=1e-4)


@given(finite, finite, durations, shares, finite, st.floats(0.01, 0.99))
def test_speed_is_the_slope_of_position(
    start: float, goal: float, duration: float, share: float, velocity: float, at: float
) -> None:
    profile = Profile(start, goal, duration, duration * share, velocity)
    time, dt = at * duration, 1e-6
    slope = (profile.position(time + dt) - profile.position(time - dt)) / (2 * dt)
    steepest = max(abs(profile.cruise), abs(profile.cruise - velocity)) / profile.ramp
    assert slope == pytest.approx(profile.speed(time), abs=2 * dt * steepest + 0.01)


@given(finite, finite, durations, st.just(0.0) | shares, finite)
def test_a_profile_begins_and_ends(start: float, goal: float, duration: float, share: float, velocity: float) -> None:
    profile = Profile(start, goal, duration, duration * share, velocity)
    assert profile.position(0.0) == pytest.approx(start, abs=1e-6)
    assert profile.speed(0.0) == (pytest.approx(velocity) if profile.ramp else profile.cruise)
    for time in (duration, duration + 1e-12, duration - 1e-12, duration + 100):
        assert (profile.position(time), profile.speed(time), profile.over(time)) == (goal, 0.0, True)
    assert profile.position(duration - 1e-8) == pytest.approx(goal, abs=1e-2)


def test_a_trapezoid_in_numbers() -> None:
    profile = Profile(100.0, 180.0, 10.0, 2.0)
    assert profile.cruise == 10.0
    assert [profile.position(t) for t in (0, 1, 2, 5, 8, 9, 10)] == [100, 102.5, 110, 140, 170, 177.5, 180]
    assert [profile.speed(t) for t in (0, 1, 2, 5, 8, 9, 10)] == [0, 5, 10, 10, 10, 5, 0]


def test_a_triangle_in_numbers() -> None:
    profile = Profile(0.0, -50.0, 10.0, 5.0)
    assert [profile.position(t) for t in (0, 5, 10)] == [0, -25, -50]
    assert [profile.speed(t) for t in (0, 2.5, 5, 7.5, 10)] == [0, -5, -10, -5, 0]


def test_a_rectangle_in_numbers() -> None:
    profile = Profile(0.0, 50.0, 10.0)
    assert [profile.position(t) for t in (0, 5, 9, 10)] == [0, 25, 45, 50]
    assert [profile.speed(t) for t in (0, 5, 9, 10)] == [5, 5, 5, 0]


def test_from_a_speed_the_wrong_way() -> None:
    profile = Profile(0.0, 70.0, 10.0, 2.0, velocity=-10.0)
    assert profile.cruise == 10.0
    assert [profile.speed(t) for t in (0, 1, 2, 8, 10)] == [-10, 0, 10, 10, 0]
    assert [profile.position(t) for t in (0, 1, 2, 8, 10)] == [0, -5, 0, 60, 70]


def test_no_time_at_all() -> None:
    profile = Profile(1.0, 2.0)
    assert (profile.position(0.0), profile.speed(0.0), profile.over(0.0), profile.moving(0.0)) == (
        2.0,
        0.0,
        True,
        False,
    )


def test_going_nowhere_is_no_motion() -> None:
    assert not Profile(1.0, 1.0, 2.0, 0.5).moving(1.0)
    assert Profile(1.0, 1.0, 2.0, 0.5, velocity=1.0).moving(1.0)
    assert Profile(1.0, 1.1, 2.0, 0.5).moving(0.0)


def test_a_ramp_of_speed() -> None:
    ramp = Ramp(-2.0, 6.0, 4.0)
    assert [ramp.speed(t) for t in (0, 1, 2, 4, 99)] == [-2, 0, 2, 6, 6]
    assert [ramp.over(t) for t in (0, 3.9, 4)] == [False, False, True]
    assert Ramp(1.0, 3.0).speed(0.0) == 3.0
    assert not Ramp().moving(0.0)


def test_ramp_time() -> None:
    assert ramp_time(0.1, 0.2, 0.504) == pytest.approx(0.02)  # the manual's example of NO 15
    assert ramp_time(2.8448, 0.25, 0.504) == 0.504


def test_a_course_counts_loops() -> None:
    course = GoalTrajectory(0.5, Profile(0.0, 4.0, 2.0))
    seen = []
    for _ in range(6):
        seen.append((course.position, course.speed, course.over))
        course.step()
    assert seen == [(0, 2, False), (1, 2, False), (2, 2, False), (3, 2, False), (4, 0, True), (4, 0, True)]
    course.begin(Ramp(0.0, 3.0, 1.0))
    assert (course.time, course.position, course.speed, course.moving) == (0.0, None, 0.0, False)
    course.step()
    assert (course.speed, course.moving) == (1.5, True)


def test_stop_detection() -> None:
    stop = StopDetection(0.0)
    stop.threshold, stop.loops = 6.0, 3
    seen = []
    for position in (5, 6, 7, 11, 12, 13, 13, 13, 13, 13, 18, 19):
        stop.step(position, planned=False)
        seen.append(stop.moving)
    assert seen == [False, True, True, True, True, True, True, True, False, False, False, True]
    for _ in range(9):
        stop.step(19, planned=True)
    assert stop.moving


def test_step_counter() -> None:
    counter = StepCounter(0.5, 100, 1000)
    assert [counter.read(angle) for angle in (0.0, 0.5, -50.0, -50.2, -50.5, 449.5, 450.0)] == [
        100,
        101,
        0,
        0,
        999,
        999,
        0,
    ]
    assert counter.angle(counter.read(7.5)) == 7.5
    counter.place(7.5, 400)
    assert counter.read(7.5) == 400
    assert counter.angle(500) == 57.5
    counter.wrap(7.5 + 500 * 3)  # three turns on
    assert counter.read(7.5 + 500 * 3) == 400
    assert counter.angle(500) == 57.5 + 500 * 3


def test_just_below_0_is_still_0() -> None:
    counter = StepCounter(0.5, 100, 1000)
    counter.wrap(-50.0 - 1e-9)
    assert counter.angle(10) == pytest.approx(-45.0)
