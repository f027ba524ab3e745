"""What the DRS-0602's specification (2-3) and register map promise about motion, measured through the bus."""

import math

import pytest

from conformance.test_herkulex import (
    ABSOLUTE,
    CENTRE,
    DIFFERENTIAL,
    LOOP,
    MOVING,
    PWM,
    SPEED_UNIT,
    STATUS,
    STEP,
    TORQUE,
    TORQUE_ON,
    TRAJECTORY,
    clear,
    driven,
    entry,
    jog,
    read,
    read_at,
    servo,
    shaft,
    shape,
    status,
    tell,
    torque_on,
    write,
)  # fmt: skip
from conformance.wire import Wire
from servobus.core.units import deg
from servobus.virtual.physics.motor import Load
from servobus.virtual.physics.shaft import Rail, Shaft
from servobus.virtual.physics.trajectory import Profile


def test_speed_without_load() -> None:
    """0.164 s for 60 degrees at 14.8 V: a goal that is far away, and the time between two positions on the way."""
    wire = driven()
    start = jog(wire, CENTRE + 8000)
    first = read_at(wire, start + 0.15, ABSOLUTE)
    last = read_at(wire, start + 0.35, ABSOLUTE)
    assert read(wire, PWM, 2) == 1023
    assert 60 / ((last - first) * STEP / 0.2) == pytest.approx(0.164, rel=0.01, abs=LOOP / 0.2 * 0.164 / 2)
    assert read(wire, DIFFERENTIAL, 2) * 0.62 == pytest.approx(60 / 0.164, rel=0.01)


def pushes(torque: float) -> bool:
    """Tell whether the shaft gets ahead against a torque, at full output."""
    wire = driven()
    start = jog(wire, CENTRE + 8000)
    wire.servo.shaft.load = Load(torque=-torque)
    before = read_at(wire, start + 0.1, ABSOLUTE)
    assert read(wire, PWM, 2) == 1023
    return read_at(wire, start + 0.3, ABSOLUTE) > before


def test_stall_torque() -> None:
    """7.6 N·m at 14.8 V: what it just cannot lift any more."""
    low, high = 5.0, 10.0
    while high - low > 0.005:
        middle = (low + high) / 2
        low, high = (middle, high) if pushes(middle) else (low, middle)
    assert low == pytest.approx(7.6, rel=0.01)


def test_a_move_of_672_ms() -> None:
    wire = driven()
    start = jog(wire, CENTRE + 3000, 60)
    way, ended = 0.0, math.inf
    for loop in range(1, 260):
        wire.wait(start + loop * LOOP - wire.now)
        wire.servo._sense()  # type: ignore[attr-defined]
        speed = wire.servo.get("desired_velocity") * SPEED_UNIT
        way += speed * LOOP
        if not speed and loop > 100:
            ended = min(ended, loop * LOOP)
    assert ended == pytest.approx(0.672, abs=LOOP)
    assert way / STEP == pytest.approx(3000, rel=0.001)
    assert read(wire, TRAJECTORY, 2) == CENTRE + 3000


@pytest.mark.parametrize("ratio", [0, 25, 50])
def test_profiles_at_every_tick(ratio: int) -> None:
    wire = driven()
    shape(wire, ratio, 254)
    start = jog(wire, CENTRE + 3000, 60)
    begin = math.floor(start / LOOP + 1e-6)
    profile = Profile(0, 3000, 0.672, 0.672 * ratio / 100)
    ramp, top = 0.672 * ratio / 100, 3000 / (0.672 * (1 - ratio / 100))
    for loop in range(250):
        wire.now = (begin + loop + 0.5) * LOOP if loop else wire.now
        wire.line.run(wire.now)
        wire.observe()
        wire.servo._sense()  # type: ignore[attr-defined]
        time = loop * LOOP
        if time >= 0.672 - 1e-9:
            where, speed = 3000.0, 0.0
        elif time < ramp:
            where, speed = top * time**2 / (2 * ramp), top * time / ramp
        elif time <= 0.672 - ramp:
            where, speed = top * (time - ramp / 2), top
        else:
            where, speed = 3000 - top * (0.672 - time) ** 2 / (2 * ramp), top * (0.672 - time) / ramp
        assert wire.servo.get("absolute_desired_trajectory_position") - CENTRE == pytest.approx(where, abs=0.501)
        assert wire.servo.get("desired_velocity") * SPEED_UNIT == pytest.approx(speed * STEP, abs=0.51 * SPEED_UNIT)
        assert profile.position(time) == pytest.approx(where, abs=1e-6)


def test_s_jog_ends_everywhere_in_the_same_tick() -> None:
    wire = Wire(*(servo(id, position=id) for id in range(10)))
    write(wire, TORQUE, 0x60, id=254)
    goals = [CENTRE - 4000 + 900 * id for id in range(10)]
    start = tell(wire, f"FE 06 3C {''.join(entry(goal, 0, id) for id, goal in enumerate(goals))}")
    ends = [math.inf] * 10
    for loop in range(1, 250):
        wire.wait(start + loop * LOOP - wire.now)
        for id, made in enumerate(wire.line.servos):
            made._sense()  # type: ignore[attr-defined]
            if made.get("absolute_desired_trajectory_position") == goals[id] and not made.get("desired_velocity"):
                ends[id] = min(ends[id], loop)
    assert ends == [ends[0]] * 10
    assert ends[0] * LOOP == pytest.approx(0.672, abs=LOOP)


def test_overload_comes_before_heat_and_heat_comes_then() -> None:
    wire = driven()
    wire.servo.shaft.load = Load(blocked=1)
    start = jog(wire, CENTRE + 2000)
    wire.wait(0.59)
    assert status(wire)[0] == 0
    wire.wait(start + 0.61 - wire.now)
    assert status(wire)[0] == 0x10
    assert wire.servo.temperature < 30
    assert (read(wire, TORQUE), read(wire, PWM, 2)) == (0, 0)
    # It comes back neither by itself, nor by a JOG, nor before the error is cleared.
    wire.wait(5.0)
    jog(wire, CENTRE + 2000)
    torque_on(wire)
    assert status(wire)[1] & TORQUE_ON == 0
    clear(wire)
    wire.wait(1.0)
    assert status(wire)[1] & TORQUE_ON == 0
    torque_on(wire)
    assert status(wire)[1] & TORQUE_ON
    # Without overload detection it is the case that stops it, once above 80 degrees.
    write(wire, 42, 0)
    jog(wire, CENTRE + 2000)
    while not (error := status(wire)[0]):
        hot = read(wire, 55)
        wire.wait(1.0)
        assert wire.now < 600
    assert (error, read(wire, TORQUE)) == (0x04, 0)
    assert 79 <= hot <= 82
    write(wire, STATUS, 0, 0)
    torque_on(wire)
    wire.wait(1.0)
    assert status(wire) == (0x04, 0)  # hot still
    wire.servo.temperature = 30.0
    clear(wire)
    torque_on(wire)
    wire.wait(1.0)
    assert status(wire)[0] == 0
    assert status(wire)[1] & TORQUE_ON


@pytest.mark.parametrize("voltage", [9.5, 12.0, 14.8, 17.0])
@pytest.mark.parametrize("way", [1, 37, 400, 3000])
def test_at_rest_nothing_moves(voltage: float, way: int) -> None:
    wire = driven(voltage=voltage)
    jog(wire, CENTRE + way, 60)
    wire.wait(1.2)
    where, pwm = shaft(wire), read(wire, PWM, 2)
    assert where == pytest.approx(way, abs=2)  # 9.5 V hold it against friction of 13.7 pwm
    for _ in range(100):
        wire.wait(0.1)
        assert (shaft(wire), read(wire, PWM, 2)) == (where, pwm)
    assert not status(wire)[1] & MOVING


def test_brown_out() -> None:
    """One servo stalls, and the weak supply they share is too low for the other."""
    for resistance, error in ((0.1, 0), (3.0, 0x01)):
        wire = Wire(servo(1), servo(2), supply=Rail(14.8, resistance))
        torque_on(wire, 1)
        write(wire, 42, 0, id=1)
        wire.line.servos[0].shaft.load = Load(blocked=1)
        wire.wait(1.0)
        assert status(wire, 2)[0] == 0
        jog(wire, CENTRE + 2000, id=1)
        wire.wait(0.3)
        assert (read(wire, 54, id=2) < 95) == bool(error)
        wire.wait(0.3)
        assert status(wire, 2)[0] == error


def test_halving_the_step_changes_nothing() -> None:
    """The step of the motor, that is; the firmware's loop is part of the law."""

    def move(parts: int) -> list[float]:
        wire = driven()
        old = wire.servo.shaft
        new = Shaft(old.motor, old.position, LOOP / parts, old.rail)
        tick = new.tick
        new.tick = lambda ticks=1: tick(ticks * parts)  # type: ignore[method-assign]
        wire.servo.shaft = new
        write(wire, TORQUE, 0)
        torque_on(wire)
        jog(wire, CENTRE + round(90 / STEP), 60)
        seen = []
        for _ in range(400):
            wire.wait(LOOP)
            seen.append(wire.servo.position / (STEP * deg))
        return seen

    whole, half, quarter = move(1), move(2), move(4)
    assert max(abs(a - b) for a, b in zip(whole, half, strict=True)) < 1
    assert max(abs(a - b) for a, b in zip(half, quarter, strict=True)) < 1
    assert abs(whole[-1] - half[-1]) < 1
