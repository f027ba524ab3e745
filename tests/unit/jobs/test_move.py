"""Waiting for a move: it ends when the servos are there, or at the time-out that was asked."""

import asyncio
from typing import Any

import pytest

import servobus
from samples import sample_models
from servobus import MODELS, RX28, BadValue, MoveTimeout, Stopped, UsageError, deg
from unit.lossy import ASYNC, SYNC

MIXED = "virtual:rx28@1-3,drs0602@219,lx16a@7,8?clock=virtual"
DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])
LOOK = 0.15
"""s that the last look may take: that of an LX-16A compares two positions 50 ms apart."""


def blocked(key: str) -> Any:
    """A servo whose shaft is blocked, with its torque on."""
    bus = servobus.open(f"virtual:{key}@1?clock=virtual&load=blocked")
    (servo,) = bus.scan(ids=[1], family=MODELS[key].family)
    servo.torque_on()
    return servo


@sample_models
@pytest.mark.parametrize("timeout", [0.0, 0.1, 0.31, 2.0])
def test_it_ends_at_the_time_out_that_was_asked(key: str, timeout: float) -> None:
    servo = blocked(key)
    clock = servo._bus.transport
    move = servo.move(servo.look().position + 20 * deg, time=0.3)
    began = clock.now()
    with pytest.raises(MoveTimeout, match="did not reach"):
        move.wait(timeout=timeout)
    assert timeout <= clock.now() - began <= timeout + LOOK


@sample_models
def test_without_a_time_out_it_ends_2_s_after_it_should_have(key: str) -> None:
    servo = blocked(key)
    clock = servo._bus.transport
    move = servo.move(servo.look().position + 20 * deg, time=0.3)
    began = clock.now()
    with pytest.raises(MoveTimeout):
        move.wait()
    assert 2.3 <= clock.now() - began <= 2.3 + LOOK


@sample_models
def test_lost_answers_do_not_make_it_longer(key: str) -> None:
    """Where every third answer is lost each look takes longer, and there are fewer of them."""
    servo = blocked(key)
    clock = servo._bus.transport
    move = servo.move(servo.look().position + 20 * deg, time=0.3)
    clock.inject(",".join(f"mute#{number}" for number in range(3, 300, 3)))
    began = clock.now()
    with pytest.raises(MoveTimeout):
        move.wait(timeout=2.0)
    assert servo._bus.stats.total.retries > 5
    assert 2.0 <= clock.now() - began <= 2.0 + 4 * LOOK  # with what ends the move


@DRIVERS
def test_one_that_was_stopped_is_told_at_once(driver: str) -> None:
    opener: Any = servobus.open if driver == SYNC else servobus.open_async
    bus = opener("virtual:rx28@1,lx16a@2?clock=virtual", models="lx16a")

    async def call(given: Any) -> Any:
        return given if driver == SYNC else await given

    async def main() -> None:
        servos = await call(bus.scan(ids=[1, 2]))
        await call(bus.torque_on())
        planned = await call(bus.start_move({servo: servo.state.position + 60 * deg for servo in servos}, time=3.0))
        await call(servos[1].stop())
        began = bus.transport.now()
        with pytest.raises(Stopped, match="LX-16A id 2 is at"):
            await call(bus.wait_arrival(planned))
        assert bus.transport.now() - began < LOOK

    asyncio.run(main())


def test_a_move_of_nothing_is_refused() -> None:
    bus = servobus.open("virtual:rx28@1?clock=virtual")
    with pytest.raises(UsageError, match="a move of no servos"):
        bus.move({})
    servo = bus.attach(RX28, 1)
    with pytest.raises(UsageError, match="given two goals"):
        bus.move({servo: 1.0, 1: 1.0})
    with pytest.raises(BadValue, match="not a number of seconds"), servo.torque():
        servo.move(1.0).wait(timeout=-1)


def test_group_moves_start_and_arrive_together() -> None:
    with servobus.open(MIXED) as bus:
        bus.scan()
        start = bus.read_all("present_position")
        goals = {servo: position + (10 + servo.id % 5) * deg for servo, position in start.items()}
        with bus.torque():
            bus.move(goals, time=1.0).wait()
            for servo, position in bus.read_all("present_position").items():
                assert position == pytest.approx(goals[servo], abs=1 * deg)


def test_a_servo_that_cannot_arrive_is_named() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.find(1, family="dynamixel")
        with servo.torque():
            move = servo.move(10 * deg, time=2.0)
            servo.write(RX28.torque_limit, 0.0)  # free run: it will not go on
            with pytest.raises(MoveTimeout, match="RX-28 id 1 is at"):
                move.wait()


def test_position_mode_sets_limits_that_are_given() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.find(1, family="dynamixel")
        servo.position_mode((20 * deg, 160 * deg))
        with servo.torque(), pytest.raises(BadValue, match="outside the limits set in it"):
            servo.move(10 * deg)


def test_lx_servos_that_were_moved_together_stay_there_when_their_time_is_given_back() -> None:
    """The time stands in command 1, whose goal is still the one from before a move by commands 7 and 11 (point 2)."""
    bus = servobus.open("virtual:lx16a@1-2?clock=virtual", models="lx16a")
    bus.scan(ids=[1, 2])
    port: Any = bus.transport
    bus.torque_on()  # at 120°
    bus[1].move(118 * deg).wait()
    bus.move({1: 116 * deg, 2: 123 * deg}).wait()
    port.sleep(1.0)
    assert [servo.shaft.position / deg for servo in port.servos] == pytest.approx([116, 123], abs=0.6)


@sample_models
@pytest.mark.parametrize("time", [5e-324, 1e-300, 1e-9])
def test_a_time_too_short_to_reckon_with_is_as_fast_as_possible(key: str, time: float) -> None:
    bus = servobus.open(f"virtual:{key}@1?clock=virtual")
    (servo,) = bus.scan(ids=[1], family=MODELS[key].family)
    servo.torque_on()
    goal = servo.look().position - 20 * deg if servo.look().position > 30 * deg else servo.look().position + 20 * deg
    servo.move(goal, time=time).wait()
    assert servo.look().position == pytest.approx(goal, abs=3 * deg)
