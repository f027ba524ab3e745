"""The shaft: a motor in a servo, with a load and a supply, tick by tick."""

import pytest

from servobus.families.dynamixel.motors import RX28_MANUAL
from servobus.virtual.physics.motor import Load, no_load_speed
from servobus.virtual.physics.shaft import Rail, Shaft

MOTOR = RX28_MANUAL.params


def shaft(position: float = 1.0) -> Shaft:
    return Shaft(MOTOR, position, 0.001, Rail(12.0))


def test_a_driven_shaft_runs_up_to_its_speed() -> None:
    driven = shaft()
    driven.drive(1.0)
    driven.tick(200)
    assert driven.velocity == pytest.approx(no_load_speed(MOTOR, 12.0), rel=1e-6)
    driven.drive(-0.5)
    driven.tick(200)
    assert driven.velocity == pytest.approx(-no_load_speed(MOTOR, 6.0), rel=1e-3)
    assert not driven.at_rest


def test_a_braked_shaft_stops_sooner_than_a_free_one() -> None:
    braked, free = shaft(), shaft()
    for one in (braked, free):
        one.drive(1.0)
        one.tick(200)
    start = braked.position
    braked.brake()
    free.release()
    for one in (braked, free):
        one.tick(1000)
        one.tick()
        assert one.at_rest
        assert one.velocity == 0
    assert start < braked.position < free.position
    assert free.current == 0


def test_a_shaft_without_power_stands() -> None:
    stopped = shaft()
    stopped.drive(1.0)
    stopped.tick(50)
    position = stopped.position
    stopped.rest()
    assert (stopped.velocity, stopped.current, stopped.position) == (0, 0, position)


def test_a_shaft_in_a_vice_takes_the_current_of_a_stall() -> None:
    held = shaft()
    held.load = Load(blocked=1.0)
    held.drive(1.0)
    held.tick(10)
    assert held.position == 1.0
    assert held.current == pytest.approx(12.0 / MOTOR.resistance)


def test_servos_pull_down_a_supply_they_share() -> None:
    rail = Rail(12.0, 1.0)
    one, other = Shaft(MOTOR, 0.0, 0.001, rail), Shaft(MOTOR, 0.0, 0.001, rail)
    idle = rail.voltage
    assert 11.8 < idle < 12.0  # the electronics of both
    for held in (one, other):
        held.load = Load(blocked=1.0)
        held.drive(1.0)
        held.tick()
    assert rail.voltage == pytest.approx((12.0 - (12.0 - idle)) / (1 + 2 / MOTOR.resistance))
    for held in (one, other):
        held.release()
        held.tick()
    assert rail.voltage == pytest.approx(idle)
