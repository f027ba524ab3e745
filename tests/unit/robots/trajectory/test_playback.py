"""A motion under way: its pace changes, its way does not, and no limit is exceeded on the way to the servos."""

from typing import Any

import pytest

from servobus import BadValue
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import Trajectory
from servobus.robots.trajectory.playback import Playback
from servobus.robots.trajectory.profile import synchronised
from servobus.robots.trajectory.spline import Shape, fitted

LIMITS = {"a": JointLimits(3.0, 10.0), "b": JointLimits(2.0, 8.0)}
POSES = {"a": [0.0, 0.5, -0.2, 0.8, 0.3], "b": [0.0, 0.1, 0.1, -0.2, 0.3]}
TICK = 0.01
EVERY_MOTION = pytest.mark.parametrize("name", [*Shape, "trapezoid"])


def motion(name: str) -> Trajectory:
    if name == "trapezoid":
        return synchronised({"a": 0.0, "b": 1.0}, {"a": 1.5, "b": 0.0}, LIMITS)
    return fitted([0.0, 0.3, 0.6, 1.0, 1.4], POSES, LIMITS, name).trajectory


def play(playback: Playback, rates: dict[int, float], ticks: int = 2000) -> list[dict[str, float]]:
    """Play to the end with changes of rate at some ticks; check limits of the positions; give these."""
    sent = [{joint: state.position for joint, state in playback.states.items()}] * 2  # at rest
    for tick in range(ticks):
        if tick in rates:
            playback.set_rate(rates[tick])
        sent.append({joint: state.position for joint, state in playback.step().items()})
        for joint, limits in LIMITS.items():
            older, old, new = (one[joint] for one in sent[-3:])
            assert abs(new - old) / TICK <= limits.speed * (1 + 2e-6)
            assert abs(new - 2 * old + older) / TICK**2 <= limits.acceleration * (1 + 2e-6)
        if playback.finished:
            break
    return sent[2:]


@EVERY_MOTION
def test_without_a_change_the_motion_is_what_was_planned(name: str) -> None:
    planned = motion(name)
    playback = Playback(planned, LIMITS, TICK)
    sent = play(playback, {})
    for tick, positions in enumerate(sent, 1):
        assert positions == {joint: pytest.approx(state.position) for joint, state in planned.at(tick * TICK).items()}
    assert sent[-1] == planned.goal
    assert len(sent) == pytest.approx(planned.duration / TICK, abs=2.5)


@EVERY_MOTION
@pytest.mark.parametrize("at", range(5, 60, 9))
def test_a_pause_keeps_limits_and_way_and_the_motion_goes_on_to_its_end(name: str, at: int) -> None:
    planned = motion(name)
    playback = Playback(planned, LIMITS, TICK)
    sent = play(playback, {at: 0.0}, ticks=at + 100)
    assert playback.paused or playback.finished
    assert sent[-1] == sent[-3]
    times, joints = playback.time, sent[-1]
    assert joints == {joint: pytest.approx(state.position) for joint, state in planned.at(times).items()}
    playback.set_rate(1.0)
    sent = play(playback, {}) if not playback.finished else sent
    assert playback.finished
    assert sent[-1] == planned.goal


@EVERY_MOTION
def test_pace_may_change_at_any_tick(name: str) -> None:
    playback = Playback(motion(name), LIMITS, TICK)
    rates = {tick: (0.0, 1.0, 0.3, 0.7, 0.1)[tick % 5] for tick in range(0, 400, 7)} | {400: 1.0}
    assert play(playback, rates)[-1] == playback.trajectory.goal
    assert playback.finished


def test_slow_motion_takes_longer() -> None:
    planned = motion("quintic")
    playback = Playback(planned, LIMITS, TICK)
    sent = play(playback, {0: 0.25})
    assert len(sent) == pytest.approx(4 * planned.duration / TICK, abs=2.5)
    assert playback.rate == 0.25


def test_a_motion_beyond_its_limits_is_refused() -> None:
    quick = motion("cubic").slowed(0.5)
    with pytest.raises(BadValue, match=r"is more than .*: the motion has to take \d\.\d+ times as long"):
        Playback(quick, LIMITS, TICK)


@pytest.mark.parametrize("rate", [-0.1, 1.1, float("nan"), "1"])
def test_what_is_no_rate_is_refused(rate: Any) -> None:
    playback = Playback(motion("pchip"), LIMITS, TICK)
    with pytest.raises(BadValue, match="is no rate of a playback: give 0"):
        playback.set_rate(rate)
