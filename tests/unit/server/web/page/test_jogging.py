"""A held button: how far it takes a goal, and that old messages and silence move nothing."""

import pytest

from servobus.server.web.page.parts.jogging import BEAT, GONE, LATE, REACH, Freshness, Jog, wheel


def test_a_goal_goes_along_at_the_speed_of_the_jog() -> None:
    jog = Jog(speed=1.0, low=-9.0, high=9.0)
    now, goal = 10.0, 0.5
    for n in range(5):
        goal = jog.step(1, now + n * BEAT, 0.5) or goal
    assert goal == pytest.approx(0.5 + 5 * BEAT)


def test_after_silence_a_jog_begins_where_the_servo_is() -> None:
    jog = Jog(speed=1.0, low=-9.0, high=9.0)
    jog.step(1, 0.0, 0.0)
    assert jog.idle(GONE + 0.01)
    assert jog.step(-1, GONE + 0.01, 3.0) == pytest.approx(3.0 - BEAT)


def test_a_late_message_is_worth_no_more_than_a_short_way() -> None:
    jog = Jog(speed=1.0, low=-9.0, high=9.0)
    jog.step(1, 0.0, 0.0)
    assert jog.step(1, GONE - 0.01, 0.0) == pytest.approx(BEAT + REACH)


def test_the_limits_end_a_jog_and_a_servo_beyond_them_is_not_taken_further_out() -> None:
    jog = Jog(speed=10.0, low=-1.0, high=0.5)
    assert jog.step(1, 0.0, 0.0) == 0.5
    assert jog.step(1, BEAT, 0.0) is None
    beyond = Jog(speed=1.0, low=-1.0, high=0.5)
    assert beyond.step(1, 0.0, 0.8) == 0.8
    beyond.end()
    assert beyond.step(-1, 0.0, 0.8) == pytest.approx(0.8 - BEAT)


def test_a_message_that_waited_moves_nothing_however_the_clocks_differ() -> None:
    seen = Freshness()
    assert seen.fresh(0, 100.0, 5000.02)
    assert seen.fresh(1, 100.06, 5000.08 + LATE / 2)
    assert not seen.fresh(2, 100.12, 5000.15 + LATE)  # it came after a pause of the page
    assert seen.fresh(3, 101.0, 5001.02)
    assert not seen.fresh(3, 101.06, 5001.08)  # it comes twice


@pytest.mark.parametrize(("share", "direction", "turns"), [(0.5, 1, 3.0), (0.5, -1, -3.0), (2.0, 1, 6.0), (-1, 1, 0.0)])
def test_a_wheel_turns_at_a_share_of_its_speed(share: float, direction: int, turns: float) -> None:
    assert wheel(share, direction, 6.0) == turns
