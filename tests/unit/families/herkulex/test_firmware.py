"""The virtual HerkuleX, where no packet of the manual shows it."""

import math
from collections.abc import Callable

import pytest

import servobus
from servobus.core.framing import Decoder
from servobus.core.units import deg
from servobus.errors import TorqueOff, UsageError
from servobus.families.herkulex.firmware import HerkulexServo
from servobus.families.herkulex.places import RAM
from servobus.families.herkulex.protocol import (
    FRAMING,
    LONGEST_BOOT,
    ControlMode,
    EepWrite,
    IJog,
    Jog,
    RamRead,
    RamWrite,
    Reboot,
    Request,
    StatusDetail,
    StatusError,
    encode,
)
from servobus.families.registry import DRS0602
from servobus.virtual.device.options import Span
from servobus.virtual.device.servo import virtual_servo
from servobus.virtual.serve.inprocess import VirtualPort

STEP = 360 * deg / 12962


def servo(*, position: float = 0.0) -> HerkulexServo:
    made = virtual_servo(DRS0602, 1, voltage=14.8, position=position)
    assert isinstance(made, HerkulexServo)
    return made


def say(servo: HerkulexServo, request: Request, now: float) -> bytes:
    servo.advance(now)
    (packet,) = Decoder(FRAMING).feed(encode(request))
    return b"".join(data for _, data in servo.hear(packet, now))  # type: ignore[arg-type]


def ram(servo: HerkulexServo, address: int, *data: int, now: float = 0.0) -> None:
    assert say(servo, RamWrite(1, address, bytes(data)), now) == b""


def look(servo: HerkulexServo, address: int, length: int = 2) -> int:
    return int.from_bytes(say(servo, RamRead(1, address, length), servo.time)[9:-2], "little", signed=True)


def jog(
    servo: HerkulexServo,
    now: float,
    value: int,
    playtime: int = 0,
    mode: ControlMode = ControlMode.POSITION,
    *,
    stop: bool = False,
    no_override: bool = False,
) -> None:
    entry = Jog(1, value, mode, playtime=playtime, stop=stop, no_override=no_override)
    assert say(servo, IJog(1, (entry,)), now) == b""


def turn(servo: HerkulexServo, now: float, value: int, playtime: int = 0, *, no_override: bool = False) -> None:
    jog(servo, now, value, playtime, ControlMode.INFINITE_TURN, no_override=no_override)


def test_the_driver_waits_for_the_restart() -> None:
    assert HerkulexServo.boot_time.practice.high < LONGEST_BOOT


def test_it_hears_nothing_while_it_starts() -> None:
    made = servo()
    made.boot_time = Span(0.3, 0.3)
    say(made, Reboot(1), 1.0)
    assert (made.started, made.deaf_until) == (1.0, 1.3)
    made.power_off()
    assert made.led == "off"
    made.power_on(5.0)
    assert made.deaf_until < 5.0


@pytest.mark.parametrize("cuts", [1, 3, 1000, 7777])
def test_how_time_is_cut_makes_no_difference(cuts: int) -> None:
    def life(cuts: int) -> tuple[object, ...]:
        made = servo()
        ram(made, 52, 0x60)
        events: list[tuple[float, Callable[[], object]]] = [
            (0.0, lambda: jog(made, 0.0, 20000, 50)),
            (0.3, lambda: jog(made, 0.3, 12000, 0)),
            (0.7, lambda: turn(made, 0.7, 300, 60)),
            (2.1, lambda: jog(made, 2.1, 16384, 30)),
            (2.2, lambda: setattr(made, "voltage", 8.0)),
            (3.5, lambda: setattr(made, "voltage", 12.0)),
        ]
        for start, event in events:
            before = made.time
            for cut in range(cuts):
                made.advance(before + (start - before) * cut / cuts)
            made.advance(start)
            event()
        made.advance(4.0)
        say(made, RamRead(1, 0, 74), 4.0)
        return made.memory.space(RAM), made.position, made.shaft.velocity

    assert life(cuts) == life(1)


def test_time_without_events_costs_nothing() -> None:
    made = servo()
    ram(made, 52, 0x60)
    jog(made, 0.0, 20000, 50)
    made.advance(1e8)  # three years, at 1250 loops a second
    assert look(made, 60) == 20000
    assert look(made, 57, 1) & 0xFF == math.floor(1e8 / 0.0112) % 256


def test_a_fault_that_was_there_before_counts_anew() -> None:
    made = servo()
    made.voltage = 8.0
    made.advance(1.0)
    made.voltage = 12.0
    made.advance(2.0)
    assert look(made, 48, 1) == StatusError.INPUT_VOLTAGE
    made.voltage = 8.0
    made.advance(2.4)
    ram(made, 48, 0, now=2.4)
    made.advance(2.45)
    assert look(made, 48, 1) == 0
    made.advance(2.6)
    assert look(made, 48, 1) == StatusError.INPUT_VOLTAGE


def test_infinite_turn_counts_round_and_round() -> None:
    made = servo()
    ram(made, 52, 0x60)
    turn(made, 0.0, 500)
    made.advance(20.0)  # seventeen turns
    turned = made.position / STEP
    assert turned == pytest.approx(20 * 310 * deg / STEP, rel=0.001)  # it had to speed up
    assert look(made, 60) == round(16384 + turned) % 32768
    # A goal then is the one in the round that it is in.
    jog(made, 20.0, 16384, 100)
    made.advance(25.0)
    assert made.position == pytest.approx(round(turned / 32768) * 32768 * STEP, abs=1.5 * STEP)
    assert look(made, 60) == pytest.approx(16384, abs=1)
    assert look(made, 68) == 16384


def test_out_of_a_turn_the_speed_goes_on() -> None:
    made = servo()
    ram(made, 52, 0x60)
    turn(made, 0.0, 200)
    made.advance(1.0)
    jog(made, 1.0, 20000, 100)
    made.advance(1.01)
    assert look(made, 72) == pytest.approx(124 / 0.034, rel=0.05)
    assert made.shaft.velocity > 0.5 * 124 * deg  # position control has to fall behind first
    made.advance(3.0)
    assert look(made, 60) == pytest.approx(20000, abs=1)


def wanted_speed(made: HerkulexServo) -> float:
    """Desired Velocity in the unit of JOGs."""
    return look(made, 72) * 0.034 / 0.62


def test_infinite_turn_ramps() -> None:
    made = servo()
    ram(made, 52, 0x60)
    turn(made, 0.0, 300, 100)  # a quarter of 1.12 s
    made.advance(0.14)
    assert wanted_speed(made) == pytest.approx(150, abs=0.1)
    assert 90 < look(made, 62) < 150  # as seen over 44.8 ms
    made.advance(0.281)
    assert wanted_speed(made) == pytest.approx(300, abs=0.1)
    made.advance(1.0)
    assert look(made, 62) == pytest.approx(300, abs=2)
    turn(made, 1.0, -300, 100)
    made.advance(1.14)
    assert abs(wanted_speed(made)) < 600 * 0.0028 / 0.28
    made.advance(1.29)
    assert wanted_speed(made) == pytest.approx(-300, abs=0.1)
    made.advance(2.0)
    assert look(made, 62) == pytest.approx(-300, abs=2)
    turn(made, 2.0, -100, 100, no_override=True)
    made.advance(2.14)
    assert wanted_speed(made) == pytest.approx(-50, abs=1.1)


def test_infinite_turn_no_faster_than_it_goes() -> None:
    made = servo()
    ram(made, 42, 0)
    ram(made, 52, 0x60)
    turn(made, 0.0, 16383)
    made.advance(1.0)
    assert look(made, 62) == pytest.approx(60 / 0.164 / 0.62, rel=0.01)
    assert look(made, 72) == 32767  # the speed asked for is more than its register holds
    # What it does not reach is not brought along.
    turn(made, 1.0, 0, 100)
    made.advance(1.14)
    assert wanted_speed(made) == pytest.approx(60 / 0.164 / 0.62 / 2, rel=0.03)
    turn(made, 8.0, 16383)
    made.advance(9.0)
    jog(made, 9.0, 16384, 100)
    turned = made.position
    made.advance(9.02)
    assert 0 < made.position - turned < 8 * deg


def test_speed_that_is_not_reached_is_an_overload() -> None:
    made = servo()
    ram(made, 52, 0x60)
    turn(made, 0.0, 700)
    made.advance(1.0)
    assert look(made, 48, 1) == StatusError.OVERLOAD


def test_a_late_shaft_keeps_the_trajectory() -> None:
    made = servo()
    ram(made, 52, 0x60)
    jog(made, 0.0, 22000, 1)
    made.advance(0.1)
    assert look(made, 70) == 22000
    jog(made, 0.1, 20000, 50)
    made.advance(0.101)
    assert look(made, 70) == pytest.approx(22000, abs=2)
    made.advance(2.0)
    assert look(made, 60) == pytest.approx(20000, abs=1)
    jog(made, 2.0, 11000, 0)
    made.advance(2.1)
    jog(made, 2.1, 11000, 50, stop=True)
    assert look(made, 70) == look(made, 60) == look(made, 68)


def test_half_a_register_can_be_written() -> None:
    made = servo()
    ram(made, 24, 0x34)
    assert look(made, 24) == 0x34
    ram(made, 25, 0x12)
    assert look(made, 24) == 0x1234
    ram(made, 25, 0x80)  # both together would be out of range
    assert look(made, 24) == 0x1234
    ram(made, 47, 0x80)
    assert look(made, 46) == 0


@pytest.mark.parametrize(("turned", "seen"), [(165, 160), (179, 160), (-170, -160), (190, -160), (-200, 160)])
def test_what_the_potentiometer_does_not_cover(turned: float, seen: float) -> None:
    made = servo(position=turned * deg)
    assert look(made, 60) == round(16384 + seen * deg / STEP)
    assert look(made, 66) == round(1024 + seen / 0.163)


def test_a_goal_that_calibration_puts_beyond_the_end() -> None:
    made = servo()
    ram(made, 20, 0, 0, 0xFF, 0x7F)
    ram(made, 46, 0xD7, 0x05)
    ram(made, 52, 0x60)
    jog(made, 0.0, 32767, 200)
    made.advance(5.0)
    assert look(made, 68) == 32767
    assert made.position / STEP == pytest.approx(32767 - 16384, abs=1.5)


def test_settings_in_eep_wait() -> None:
    made = servo()
    say(made, EepWrite(1, 46, bytes((36,))), 0.0)
    assert made.garbage_timeout == pytest.approx(18 * 0.0112)
    made.power_off()
    made.power_on(1.0)
    assert made.garbage_timeout == pytest.approx(36 * 0.0112)


def test_every_speed_is_within_3_percent() -> None:
    for code, baud in DRS0602.baud_rate.scale.codes.items():  # type: ignore[attr-defined]
        made = servo()
        made.store_baud(baud)
        assert made.baud == pytest.approx(2e6 / (code + 1))
        assert made.baud == pytest.approx(baud, rel=0.03)


def test_a_held_shaft_cannot_be_turned() -> None:
    made = servo()
    ram(made, 52, 0x60)
    with pytest.raises(UsageError):
        made.turn_shaft(1.0)
    made.power_off()
    made.turn_shaft(1.0)
    made.power_on(1.0)
    assert look(made, 60) == round(16384 + 1 / STEP)


def test_with_the_driver() -> None:
    with servobus.open("virtual:drs0602@1?clock=virtual&voltage=14.8") as bus:
        arm = bus.attach(DRS0602, 1)
        assert isinstance(bus.transport, VirtualPort)
        (virtual,) = bus.transport.servos
        with arm.torque():
            arm.move(90 * deg, speed=120 * deg).wait()
            assert arm.read(DRS0602.present_position) == pytest.approx(90 * deg, abs=6 * STEP)
            arm.turn(speed=-2.0)
            bus.transport.sleep(4.0)
            arm.stop()
            arm.position_mode()
            assert not arm.read(DRS0602.current_control_mode)
        virtual.voltage = 8.0
        bus.transport.sleep(1.0)
        with pytest.raises(TorqueOff, match="input_voltage"):
            arm.torque_on()
        virtual.voltage = 14.8
        arm.write_many({DRS0602.status_error: StatusError(0), DRS0602.status_detail: StatusDetail(0)})
        arm.torque_on()
        arm.reboot()
        assert not virtual.torque
        arm.change_id(7)
        arm.change_baud(1_000_000)
        arm.reset(keep=frozenset({"id"}))
        assert (arm.id, arm.baud, virtual.id) == (7, 115_200, 7)
