"""The law of the LX-16A by itself, and on its motor."""

import math
from dataclasses import dataclass, replace

import pytest

from servobus.families.lewansoul.control import GAINS, STEPS, UNIT, Gains, hold, set_point, stands
from servobus.families.lewansoul.motors import LX16A as SET
from servobus.virtual.physics.motor import Load
from servobus.virtual.physics.shaft import Rail, Shaft

MOTOR = SET.params
TICK = 0.002


@dataclass
class Track:
    """What a simulated move was like, in units."""

    positions: list[float]
    outputs: list[float]
    standing: bool
    """Whether nothing changed any more in the end, to the last bit."""

    def settled(self, goal: float) -> float:
        """Give the time in s from which on it is within one unit of the goal."""
        away = [n for n, position in enumerate(self.positions) if abs(position - goal) > 1]
        return (away[-1] + 1 if away else 0) * TICK


def move(
    goal: float, time: float, seconds: float, load: Load | None = None, volts: float = 7.4, gains: Gains = GAINS
) -> Track:
    """Move a shaft from position 500 to a goal (units) in a time (0: at once), and watch for some seconds."""
    shaft = Shaft(MOTOR, 500 * UNIT, TICK, Rail(volts))
    shaft.load = load or Load()
    target = goal * UNIT
    speed = abs(target - shaft.position) / time if time else math.inf
    point = shaft.position if time else target
    last, total = shaft.position, 0.0
    track = Track([], [], False)
    for _ in range(round(seconds / TICK)):
        before, point = point, set_point(point, target, speed, TICK)
        position = shaft.position
        output, total = hold(gains, before - position, (point - before) / TICK, (position - last) / TICK, total, TICK)
        last = position
        shaft.drive(output)
        shaft.tick()
        track.positions.append(shaft.position / UNIT)
        track.outputs.append(output)
    track.standing = len({*track.outputs[-100:]}) == 1 == len({*track.positions[-100:]})
    return track


def test_the_set_point_goes_straight_and_stays_at_the_goal() -> None:
    points = [0.0]
    for _ in range(8):
        points.append(set_point(points[-1], 1.0, 2.0, 0.1))
    assert points == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0, 1.0, 1.0])
    assert points[-1] == 1.0
    assert set_point(0.0, -1.0, 2.0, 0.1) == pytest.approx(-0.2)
    assert set_point(0.0, -1.0, math.inf, 0.1) == -1.0
    assert set_point(3.0, 3.0, 0.0, 0.1) == 3.0


def test_the_output_is_the_sum_of_its_terms() -> None:
    gains = Gains(proportional=2.0, integral=10.0, derivative=0.1, feed_forward=0.5, dead=0.01)
    assert hold(gains, 0.1, 0.0, 0.0, 0.0, 0.002) == pytest.approx((0.202, 0.002))
    assert hold(gains, 0.0, 0.0, 1.0, 0.0, 0.002) == (-0.1, 0.0)
    assert hold(gains, 0.0, 1.0, 1.0, 0.25, 0.002) == (0.75, 0.25)


def test_the_total_rests_in_the_dead_zone_and_far_away() -> None:
    assert hold(GAINS, GAINS.dead, 0.0, 0.0, 0.1, TICK)[1] == 0.1
    assert hold(GAINS, -GAINS.dead, 0.0, 0.0, 0.1, TICK)[1] == 0.1
    assert hold(GAINS, 2 * GAINS.dead, 0.0, 0.0, 0.1, TICK)[1] > 0.1
    assert hold(GAINS, -2 * GAINS.dead, 0.0, 0.0, 0.1, TICK)[1] < 0.1
    assert hold(GAINS, 10 * UNIT, 0.0, 0.0, 0.1, TICK) == (1.0, 0.1)
    total = 0.0
    for _ in range(10_000):
        output, total = hold(GAINS, 2 * UNIT, 0.0, 0.0, total, TICK)
    assert (output, total) == (1.0, 1.0)


@pytest.mark.parametrize("error", [-100 * UNIT, -UNIT / 3, 0.0, UNIT / 7, 3 * UNIT])
def test_the_output_has_steps_and_ends_and_no_preferred_side(error: float) -> None:
    output, total = hold(GAINS, error, 0.0, 0.0, 0.0, TICK)
    assert -1 <= output <= 1
    assert output * STEPS == pytest.approx(round(output * STEPS), abs=1e-9)
    assert hold(GAINS, -error, 0.0, 0.0, 0.0, TICK) == (-output, -total)


def test_locked_is_full_output_without_motion() -> None:
    assert stands(1.0, 0.0)
    assert stands(-0.9, 0.9 * UNIT)
    assert not stands(0.89, 0.0)
    assert not stands(1.0, 1.1 * UNIT)
    assert not stands(1.0, -1.1 * UNIT)


LOADS = {
    "bare": Load(),
    "arm": Load(mass=0.5, length=0.1, down=2.0),
    "against": Load(torque=-1.0),
    "along": Load(torque=1.0),
    "wheel": Load(inertia=0.014),
}


@pytest.mark.parametrize("volts", [6.0, 7.4, 12.0])
@pytest.mark.parametrize("time", [0, 1.0, 3.0])
@pytest.mark.parametrize("load", LOADS)
def test_it_comes_to_rest_within_a_unit_whatever_the_load(load: str, time: float, volts: float) -> None:
    track = move(900, time, time + 3.0, LOADS[load], volts)
    assert track.settled(900) <= time + 1.5
    assert track.standing


@pytest.mark.parametrize("goal", [490, 498, 501, 503, 520])
def test_small_steps_arrive_too(goal: float) -> None:
    track = move(goal, 0, 1.0)
    assert track.positions[-1] == pytest.approx(goal, abs=0.5)
    assert track.settled(goal) < 0.2
    assert track.standing


def test_slow_moves_go_smoothly() -> None:
    track = move(530, 1.0, 1.5)
    steps = [b - a for a, b in zip(track.positions[50:480], track.positions[51:481], strict=True)]
    assert min(steps) > 0
    assert max(steps) < 2 * 30 * TICK


def test_a_bare_shaft_hardly_overshoots() -> None:
    assert max(move(1000, 0, 2.0).positions) < 1002
    assert max(move(1000, 1.0, 2.0).positions) < 1004  # it stops at once, from 500 units/s


def test_with_seven_times_its_inertia_it_is_still_stable() -> None:
    track = move(1000, 0, 4.0, Load(inertia=6 * MOTOR.inertia))
    assert track.settled(1000) < 2.0
    assert track.standing


def test_without_the_total_a_load_pushes_it_away() -> None:
    load = Load(torque=-1.2)
    assert move(900, 1.0, 3.0, load, gains=replace(GAINS, integral=0.0)).positions[-1] < 898
    assert move(900, 1.0, 3.0, load).positions[-1] == pytest.approx(900, abs=0.5)
