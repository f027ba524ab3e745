"""The specification of the RX-28 (manual 1-3) as a host can measure it: goals written, positions read, time taken.

What hangs on the shaft, and what is blown at it, is the test's; everything that is measured comes over the wire.
"""

from collections.abc import Iterator
from dataclasses import replace
from statistics import linear_regression

import pytest

from conformance.test_dynamixel import OK, UNIT, ask, framed, read, write
from conformance.wire import Wire
from servobus.core.units import deg
from servobus.families.dynamixel.firmware import ComplianceServo
from servobus.families.registry import RX28
from servobus.virtual.device.servo import VirtualServo, virtual_servo
from servobus.virtual.physics.motor import REFERENCE, Load

KGF_CM = 0.0980665
TABLE = [(12.0, 28.3 * KGF_CM, 0.167), (16.0, 37.7 * KGF_CM, 0.126)]
"""V, N·m at a stall, s for 60° without load: manual 1-3."""
ENABLE, GO = "01 03 18 01", "01 03 18 01 00 00 00 20 20 FF 03 00 00"
"""Torque Enable; the same with margins 0, slopes 32, goal 1023 and no speed control."""


def bench(voltage: float, unit: float = 512.0) -> Wire:
    servo = virtual_servo(RX28, 1, voltage=voltage, position=unit * UNIT)
    servo.store_baud(1_000_000)
    wire = Wire(servo)
    ask(wire, "01 03 05 00")  # answers at once
    return wire


def quickly(wire: Wire, request: str) -> None:
    assert wire.say(framed(request), listen=0.001).text


def positions(wire: Wire, seconds: float) -> Iterator[tuple[float, int]]:
    """Read the position every 2 ms or so; give it with the time at which the request had been sent."""
    end = wire.now + seconds
    while wire.now < end:
        reply = wire.say(framed("01 02 24 02"), listen=0.002)
        yield wire.now - 0.002, int.from_bytes(reply.bytes[5:7], "little")


# Speed


@pytest.mark.parametrize(("voltage", "_torque", "seconds"), TABLE)
def test_time_for_60_degrees_without_load(voltage: float, _torque: float, seconds: float) -> None:
    wire = bench(voltage, unit=0)
    quickly(wire, GO)
    run = [(time, unit) for time, unit in positions(wire, 0.9) if 150 <= unit <= 900]
    assert len(run) > 100
    speed = linear_regression([time for time, _ in run], [unit for _, unit in run]).slope
    assert 60 * deg / UNIT / speed == pytest.approx(seconds, rel=0.01)


# Torque


def moves(voltage: float, torque: float) -> bool:
    """Tell whether it turns against a torque: from just below the border of two units, so that a hair's width shows.

    All is over before the winding gets warm, as it is when a stall torque is measured by hand and with a watch.
    """
    wire = bench(voltage, unit=511.48)
    wire.servo.shaft.load = Load(blocked=1.0)
    assert read(wire, 36, 2) == 511
    quickly(wire, GO)
    wire.observe()
    wire.servo.shaft.load = Load(torque=-torque)
    wire.wait(0.05)
    assert abs(wire.servo.shaft.state.winding - REFERENCE) < 3
    return read(wire, 36, 2) > 511


@pytest.mark.parametrize(("voltage", "torque", "_seconds"), TABLE)
def test_stall_torque(voltage: float, torque: float, _seconds: float) -> None:
    low, high = 0.5 * torque, 1.5 * torque
    assert moves(voltage, low)
    assert not moves(voltage, high)
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (middle, high) if moves(voltage, middle) else (low, middle)
    assert low == pytest.approx(torque, rel=0.01)


@pytest.mark.parametrize(("voltage", "torque", "_seconds"), TABLE)
@pytest.mark.parametrize("limit", [256, 512])
def test_torque_limit_scales_the_stall_torque(voltage: float, torque: float, _seconds: float, limit: int) -> None:
    for share, yields in ((0.93, True), (1.07, False)):
        wire = bench(voltage, unit=511.48)
        wire.servo.shaft.load = Load(blocked=1.0)
        write(wire, 34, limit, 2)
        quickly(wire, GO)
        wire.observe()
        wire.servo.shaft.load = Load(torque=-share * torque * limit / 1023)
        wire.wait(0.05)
        assert (read(wire, 36, 2) > 511) is yields


def test_a_blocked_shaft_shows_full_load_and_does_not_move() -> None:
    wire = bench(16.0)
    wire.servo.shaft.load = Load(blocked=1.0)
    quickly(wire, GO)
    wire.wait(0.5)
    assert (read(wire, 36, 2), read(wire, 38, 2), read(wire, 40, 2)) == (512, 0, 1023)


# Rest


@pytest.mark.parametrize("slope", [1, 8, 32, 128, 254])
@pytest.mark.parametrize("torque", [0.0, 0.8, -1.5])
def test_it_holds_still(slope: int, torque: float) -> None:
    """Static friction holds: no drift, no limit cycle. Heat is left out: as the winding warms up, a load sags."""
    wire = bench(14.4)
    wire.servo.shaft.motor = replace(wire.servo.shaft.motor, copper=0.0)
    ask(wire, f"01 03 1C {slope:02X} {slope:02X}")
    ask(wire, ENABLE)
    write(wire, 30, 600, 2)
    wire.servo.shaft.load = Load(torque=torque)
    wire.wait(3)
    before, seen = wire.servo.position, set()
    for _ in range(240):
        wire.wait(0.25)
        seen.add(wire.servo.position)
    # A load may sit where no unit of compliance fits it: then the friction lets it change over within that unit.
    assert all(abs(position - before) < UNIT for position in seen)
    if not torque:
        assert seen == {before}
        assert wire.servo.shaft.current == 0


def test_a_free_shaft_stays_where_it_is() -> None:
    wire = bench(14.4)
    before = wire.servo.position
    wire.servo.shaft.load = Load(torque=0.04)  # friction carries 0.05 N·m
    wire.wait(60)
    assert wire.servo.position == before
    wire.servo.shaft.load = Load(torque=0.06)
    wire.wait(1)
    assert wire.servo.position > before


# The step of the simulation


@pytest.mark.parametrize("speed", [0, 300])
def test_half_the_tick_changes_a_move_by_less_than_a_unit(speed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def move() -> list[float]:
        servo = virtual_servo(RX28, 1, voltage=14.4, position=300 * UNIT)
        servo.put("torque_enable", 1)
        servo.put("moving_speed", speed)
        servo.advance(1.0)
        servo.put("goal_position", 607)  # 90° on, at a time that is a tick of both
        path = []
        for n in range(1, 1001):
            servo.advance(1.0 + 0.002 * n)
            path.append(servo.position / UNIT)
        return path

    coarse = move()
    monkeypatch.setattr(ComplianceServo, "tick", ComplianceServo.tick / 2)
    fine = move()
    assert coarse[-1] == pytest.approx(607, abs=0.5)
    assert max(abs(one - other) for one, other in zip(coarse, fine, strict=True)) < 1


# Heat


def stalled(voltage: float = 16.0) -> tuple[Wire, VirtualServo]:
    wire = bench(voltage)
    wire.servo.shaft.load = Load(blocked=1.0)
    quickly(wire, GO)
    return wire, wire.servo


def first(wire: Wire, error: int, seconds: float) -> float:
    """Ping until an error shows; give the time that took."""
    start = wire.now
    while wire.now < start + seconds:
        wire.wait(0.05)
        if int(ask(wire, "01 01")[3:], 16) & error:
            return wire.now - start
    raise AssertionError


def test_overload_comes_before_heat() -> None:
    wire, servo = stalled()
    assert first(wire, 0x20, 10) == pytest.approx(1.5, abs=0.15)
    assert ask(wire, "01 01") == "01 20"
    assert servo.temperature < 40
    assert (read(wire, 34, 2), servo.torque) == (0, False)
    wire.wait(60)
    assert servo.temperature < 40


def test_heat_shuts_down_where_overload_may_not() -> None:
    wire, servo = stalled()
    ask(wire, "01 03 12 04")  # Alarm Shutdown: heat alone
    first(wire, 0x20, 10)
    assert servo.torque
    assert 10 < first(wire, 0x04, 120) < 60
    assert read(wire, 43) == 81  # the first above the limit of 80
    assert ask(wire, "01 01") == "01 24"
    assert (read(wire, 34, 2), servo.torque) == (0, False)


def test_heat_alone() -> None:
    wire, servo = stalled()
    assert isinstance(servo, ComplianceServo)
    servo.overload_time = float("inf")
    assert first(wire, 0x24, 120) > 10
    assert ask(wire, "01 01") == "01 04"
    assert not servo.torque


def test_torque_returns_only_when_torque_limit_is_written_and_it_is_cool() -> None:
    wire, servo = stalled()
    ask(wire, "01 03 12 04")
    first(wire, 0x04, 120)
    servo.shaft.load = Load()
    write(wire, 34, 1023, 2)  # too early
    wire.wait(0.05)
    assert (read(wire, 34, 2), servo.torque) == (0, False)
    while ask(wire, "01 01") != OK:
        wire.wait(1)
    wire.wait(60)
    for address, value in ((30, 100), (24, 0), (24, 1), (30, 100)):  # nothing else brings it back
        assert write(wire, address, value, 2 if address == 30 else 1) == OK
        wire.wait(0.5)
        assert (read(wire, 36, 2), servo.torque) == (512, False)
    write(wire, 34, 1023, 2)
    write(wire, 30, 100, 2)
    wire.wait(2)
    assert (read(wire, 36, 2), servo.torque) == (100, True)
