"""The control laws of HerkuleX servos, alone."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobus.families.herkulex.control import (
    CHANGE,
    LONGEST_SUM,
    UNIT,
    OverloadTimer,
    PositionControl,
    SpeedControl,
    Speedometer,
    Stages,
)

TICK = UNIT / 4
FULL = 1023


def test_p_is_an_eighth() -> None:
    law = PositionControl(TICK, FULL)
    law.tune(70, 0, 0)
    assert [law.output(error) for error in (0, 1, -8)] == [0, 8.75, -70]


def test_i_adds_the_error_once_in_a_unit() -> None:
    law = PositionControl(TICK, FULL)
    law.tune(0, 0, 16384)
    assert [law.output(4) for _ in range(8)] == pytest.approx([1, 2, 3, 4, 5, 6, 7, 8])
    assert not law.steady(4)
    assert [law.output(1e6), law.output(-8)] == [FULL, pytest.approx(FULL - 2)]
    law.reset()
    assert law.output(0) == 0
    assert law.steady(0)


def test_d_sees_the_change_but_not_the_beginning() -> None:
    law = PositionControl(TICK, FULL)
    law.tune(0, 8, 0)
    assert law.output(100) == 0
    assert law.output(107) == pytest.approx(7 * CHANGE / TICK)
    assert not law.steady(106)
    assert law.output(107) == 0
    assert law.steady(107)


def test_feed_forward_of_speed_and_acceleration() -> None:
    law = PositionControl(TICK, FULL)
    law.tune(0, 0, 0, 128, 64)
    assert law.output(0, 10) == pytest.approx(20 + 40)  # 10 in a loop are 40 in 11.2 ms
    assert law.output(0, 10) == pytest.approx(20)
    assert law.output(0, 0) == pytest.approx(-40)


def test_speed_control_sums_up_what_it_cannot_reach() -> None:
    law = SpeedControl(TICK)
    law.tune(64, 16384)
    assert [law.output(8), law.output(8), law.output(0)] == pytest.approx([10, 12, 4])
    for _ in range(10_000):
        law.output(200)
    assert law.output(0) == LONGEST_SUM > 10 * FULL
    law.reset()
    assert law.output(0) == 0


def test_the_loop_rate_makes_no_difference_to_a_steady_error() -> None:
    outputs = []
    for parts in (1, 4, 14):
        law = SpeedControl(UNIT / parts)
        law.tune(100, 12000)
        outputs.append([law.output(3) for _ in range(parts * 10)][-1])
    assert outputs == pytest.approx([outputs[0]] * 3)


wants = st.floats(-1e5, 1e5)
stages = st.builds(
    Stages,
    st.integers(0, 254),
    st.integers(-128, 127),
    st.integers(0, 254),
    st.integers(0, FULL),
    st.integers(0, 254),
    st.integers(0, 32767),
)


@given(stages, wants, st.integers(-5000, 5000))
def test_no_output_is_above_the_limits(stage: Stages, wanted: float, error: int) -> None:
    pwm = stage.position(wanted, error)
    assert abs(pwm) <= stage.highest
    if stage.saturator_slope:
        assert abs(pwm) <= stage.saturator_offset + stage.saturator_slope / 256 * abs(error)
    elif pwm:
        assert abs(pwm) >= min(stage.lowest, stage.highest)
    if abs(error) < stage.dead_zone:
        assert pwm == 0
    assert pwm * (wanted + stage.offset) >= 0
    assert abs(stage.speed(wanted)) <= stage.highest


@given(stages, wants)
def test_both_directions_are_alike(stage: Stages, wanted: float) -> None:
    assert stage.speed(-wanted) == -stage.speed(wanted)


def test_fractions_are_cut() -> None:
    stage = Stages(0, 0, 0, FULL)
    assert [stage.position(wanted, 9) for wanted in (8.75, -8.75, 0.9, 2000, -2000)] == [8, -8, 0, 1023, -1023]


def test_speedometer() -> None:
    meter = Speedometer(16, 100)
    assert meter.steady
    seen = []
    for count in [*range(102, 142, 2), *[140] * 17]:
        meter.step(count)
        seen.append(meter.way)
    assert seen[:16] == [*range(2, 34, 2)]
    assert seen[16:20] == [32] * 4
    assert seen[-1] == 0
    assert meter.steady
    meter.step(141)
    assert not meter.steady


def test_watch() -> None:
    watch = OverloadTimer()
    watch.limit = 2
    assert [watch.step(wrong) for wrong in (True, True, False, True, True, True, True)] == [
        *[False] * 5,
        True,
        True,
    ]
    assert not watch.waiting
    watch.step(False)
    assert not watch.waiting
    watch.step(True)
    assert watch.waiting
