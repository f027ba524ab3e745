"""The blocking driver against scripted answers. Bytes are the RX-28 manual's, or built by its checksum rule."""

import math

import pytest

import servobus
from servobus import (
    LX16A,
    RX28,
    BadChecksum,
    BadValue,
    Bus,
    Garbled,
    NoReply,
    Refused,
    TorqueOff,
    UnknownName,
    UsageError,
    WrongReply,
    deg,
    dynamixel1,
    herkulex,
    lewansoul,
)
from servobus.core.replies import ReplyCollector
from unit.scripted import Scripted

TEMPERATURE = "FF FF 01 04 02 2B 01 CC"  # manual 3-5-1, Example 1
ANSWER = "FF FF 01 03 00 20 DB"
OK = "FF FF 01 02 00 FC"  # manual 3-5-5
PING = "FF FF 01 02 01 FB"  # manual 3-5-5
MODEL_BYTE = "FF FF 01 03 00 1C DF"  # 28, the low byte of the model number; ~(01+03+00+1C) = DF
UNLOCKED = "FF FF 01 03 00 00 FB"  # Lock is 0; it is asked before a write to the EEPROM


def bus_with(*script: str | None) -> tuple[Bus, Scripted]:
    port = Scripted(*script)
    return Bus(port, echo=False), port


def test_read_sends_the_manuals_bytes_and_gives_the_unit() -> None:
    bus, port = bus_with(ANSWER)
    assert bus.attach(RX28, 1).read(RX28.present_temperature) == 32.0
    assert port.requests == [TEMPERATURE]


def test_opening_and_attaching_send_nothing() -> None:
    bus, port = bus_with()
    servo = bus.attach(RX28, 1)
    str(servo)
    bus.close()
    assert port.requests == []
    assert port.closed


def test_alarm_stands_beside_the_value() -> None:
    bus, _ = bus_with("FF FF 01 03 24 20 B7")  # Example 1 with error 0x24
    servo = bus.attach(RX28, 1)
    assert servo.read(RX28.present_temperature) == 32.0
    assert servo.alarms == dynamixel1.Error.OVERLOAD | dynamixel1.Error.OVERHEATING
    assert "overheating+overload" in str(servo)


def test_alarms_end_with_the_next_good_reply() -> None:
    bus, _ = bus_with("FF FF 01 03 24 20 B7", ANSWER)
    servo = bus.attach(RX28, 1)
    servo.read(RX28.present_temperature)
    servo.read(RX28.present_temperature)
    assert servo.alarms == 0
    assert servo.latched == dynamixel1.Error.OVERLOAD | dynamixel1.Error.OVERHEATING
    assert str(servo) == "RX-28 id 1 at 57600, had ALARM overheating+overload"


def test_refusal_is_an_exception() -> None:
    bus, _ = bus_with("FF FF 01 02 08 F4")  # range error
    with pytest.raises(Refused, match="out of range") as caught:
        bus.attach(RX28, 1).write(RX28.led, True)
    assert caught.value.flags == dynamixel1.Error.RANGE


def test_silence() -> None:
    bus, _ = bus_with(None)
    with pytest.raises(NoReply, match="no reply"):
        bus.attach(RX28, 1).ping()


def test_wrong_checksum_is_never_a_value() -> None:
    bus, _ = bus_with("FF FF 01 03 00 21 DB")
    with pytest.raises(BadChecksum):
        bus.attach(RX28, 1).read(RX28.present_temperature)


def test_answer_of_another_servo_is_never_a_value() -> None:
    bus, _ = bus_with("FF FF 02 03 00 20 DA")
    with pytest.raises(WrongReply, match="from id 2"):
        bus.attach(RX28, 1).read(RX28.present_temperature)


def test_answer_of_another_length_is_never_a_value() -> None:
    bus, _ = bus_with("FF FF 01 04 00 20 03 D7")
    with pytest.raises(WrongReply):
        bus.attach(RX28, 1).read(RX28.present_temperature)


def test_junk_is_garbled() -> None:
    bus, _ = bus_with("12 34 56")
    with pytest.raises(Garbled, match="wrong baud") as caught:
        bus.attach(RX28, 1).ping()
    assert caught.value.heard == bytes.fromhex("12 34 56")


@pytest.mark.parametrize("junk", ["00", "FF", "FF FF", "FF FF 01", "FF FF 01 50", "FF FF FF FF FF"])
def test_junk_before_the_answer_does_not_swallow_it(junk: str) -> None:
    bus, _ = bus_with(f"{junk} {ANSWER}")
    assert bus.attach(RX28, 1).read(RX28.present_temperature) == 32.0


def test_left_over_bytes_do_not_answer_the_next_question() -> None:
    bus, _ = bus_with(f"{ANSWER} {ANSWER[:8]}", None, None)
    servo = bus.attach(RX28, 1)
    assert servo.read(RX28.present_temperature) == 32.0
    with pytest.raises(NoReply):
        servo.read(RX28.present_temperature)


@pytest.mark.parametrize("value", [math.nan, math.inf, 301 * deg, -1 * deg])
def test_a_goal_that_cannot_be_sends_nothing(value: float) -> None:
    bus, port = bus_with()
    servo = bus.attach(RX28, 1)
    with pytest.raises(BadValue):
        servo.write(RX28.goal_position, value)
    with pytest.raises(BadValue):
        servo.move(value)
    assert port.requests == []


@pytest.mark.parametrize(
    ("time", "speed"), [(0, None), (-1, None), (math.nan, None), (None, 0), (None, math.inf), (1, 1)]
)
def test_a_time_or_speed_that_cannot_be_sends_nothing(time: float | None, speed: float | None) -> None:
    bus, port = bus_with()
    with pytest.raises(BadValue):
        bus.attach(RX28, 1).move(90 * deg, time=time, speed=speed)
    assert port.requests == []


@pytest.mark.parametrize(
    ("angle", "hint"),
    [
        (90, "did you mean 90 * deg?"),
        (500, ""),  # nor could it go to 500°
        (6.5, ""),
        (400 * deg, ""),  # degrees they are
    ],
)
def test_forgotten_degrees_are_told_where_they_would_do(angle: float, hint: str) -> None:
    bus, _ = bus_with()
    with pytest.raises(BadValue, match=r"is outside 0.0° .. 300.0°") as caught:
        bus.attach(RX28, 1).move(angle)
    assert hint in str(caught.value)
    assert ("did you mean" in str(caught.value)) is bool(hint)


def test_what_is_no_number_sends_nothing() -> None:
    bus, port = bus_with()
    servo = bus.attach(RX28, 1)
    with pytest.raises(BadValue, match="'90' is not a number; an angle is in radians, such as 90 \\* deg"):
        servo.move("90")  # type: ignore[arg-type] # that is the point
    with pytest.raises(BadValue, match="speed '60' is not a number above 0"):
        servo.move(1.0, speed="60")  # type: ignore[arg-type] # here too
    assert port.requests == []


def test_read_only_and_foreign_registers_send_nothing() -> None:
    bus, port = bus_with()
    servo = bus.attach(RX28, 1)
    with pytest.raises(BadValue, match="only be read"):
        servo.write(RX28.present_position, 0.0)
    with pytest.raises(UsageError, match="not a register of RX-28"):
        servo.read(LX16A.present_position)
    assert port.requests == []


def test_broadcast_id_is_no_servo() -> None:
    bus, port = bus_with()
    with pytest.raises(BadValue, match="broadcast"):
        bus.find(254)
    with pytest.raises(BadValue, match="broadcast"):
        bus.attach(RX28, 254)
    assert port.requests == []


def test_unknown_servo_names_the_remedy() -> None:
    bus, _ = bus_with()
    bus.attach(RX28, 3)
    with pytest.raises(UnknownName, match=r"known: 3\); use scan"):
        bus[1]


SPEED_0 = "FF FF 01 04 00 00 00 FA"
STANCE = "FF FF 01 04 02 06 20 D2"  # read 6..37: limits, torque enable, present position


def motion_status(torque: int, position: int) -> str:
    """Answer to STANCE: limits 0..1023, position little-endian at 36."""
    data = bytearray(32)
    data[2:4] = (1023).to_bytes(2, "little")
    data[24 - 6] = torque
    data[34 - 6 : 36 - 6] = (1023).to_bytes(2, "little")  # torque limit
    data[30:32] = position.to_bytes(2, "little")
    body = bytes([1, 34, 0]) + data
    return (b"\xff\xff" + body + bytes([~sum(body) & 0xFF])).hex()


def torque_state(torque: int) -> str:
    """Answer to the read of 24 to 35: torque enable, and torque limit 1023."""
    body = bytes([1, 14, 0, torque, *bytes(9), 0xFF, 0x03])
    return (b"\xff\xff" + body + bytes([~sum(body) & 0xFF])).hex()


def test_move_needs_torque() -> None:
    bus, port = bus_with(motion_status(0, 512))
    with pytest.raises(TorqueOff):
        bus.attach(RX28, 1).move(90 * deg)
    assert port.requests == [STANCE]


def test_move_writes_goal_and_speed_in_one_packet() -> None:
    # From 512 (150.147°) to 307 (90.029°) at 60°/s = 10 rpm = 90 units of 0.111 rpm.
    bus, port = bus_with(motion_status(1, 512), SPEED_0, OK)
    move = bus.attach(RX28, 1).move(90 * deg, speed=60 * deg)
    assert port.requests == [STANCE, "FF FF 01 04 02 20 02 D6", "FF FF 01 07 03 1E 33 01 5A 00 48"]
    assert move.duration == pytest.approx((512 - 307) * 300 / 1023 / 60)


def test_torque_sets_the_goal_first_and_goes_off_even_after_an_error() -> None:
    bus, port = bus_with(torque_state(0), motion_status(0, 512), OK, OK, torque_state(1), OK)
    with pytest.raises(KeyError, match="boom"), bus.attach(RX28, 1).torque():
        raise KeyError("boom")
    assert port.requests == [
        "FF FF 01 04 02 18 0C D4",  # one that is on already stays so at the end
        STANCE,
        "FF FF 01 05 03 1E 00 02 D6",  # goal := 512
        "FF FF 01 04 03 18 01 DE",
        "FF FF 01 04 02 18 0C D4",  # is it on?
        "FF FF 01 04 03 18 00 DF",
    ]


def test_writing_return_level_0_is_answered_and_then_nothing_is_awaited() -> None:
    # manual Example 14 (checksum corrected, ED-01); from then on only PING is answered
    bus, port = bus_with("FF FF 01 03 00 02 F9", UNLOCKED, OK, OK)
    servo = bus.attach(RX28, 1)
    servo.write(RX28.status_return_level, 0)
    servo.write(RX28.led, True)
    assert port.requests[2:] == ["FF FF 01 04 03 10 00 E7", "FF FF 01 02 01 FB", "FF FF 01 04 03 19 01 DD"]
    with pytest.raises(UsageError, match="Status Return Level"):
        servo.read(RX28.led)


class TestEcho:
    def test_is_found_out_and_removed(self) -> None:
        bus = Bus(Scripted(TEMPERATURE + ANSWER, TEMPERATURE + ANSWER))
        servo = bus.attach(RX28, 1)
        assert servo.read(RX28.present_temperature) == 32.0
        assert bus.echo is True
        assert servo.read(RX28.present_temperature) == 32.0

    def test_is_found_absent(self) -> None:
        bus = Bus(Scripted(ANSWER))
        bus.attach(RX28, 1).read(RX28.present_temperature)
        assert bus.echo is False

    def test_is_found_absent_by_silence(self) -> None:
        bus = Bus(Scripted(None, None))
        with pytest.raises(NoReply):
            bus.attach(RX28, 1).read(RX28.present_temperature)
        assert bus.echo is False

    def test_a_ping_is_not_taken_for_the_answer_of_a_servo_with_a_voltage_error(self) -> None:
        # FF FF 01 02 01 FB is PING to id 1 and a status packet with error 0x01: a byte before it tells them apart.
        port = Scripted("00 FF FF 01 02 01 FB", "FF FF 01 02 01 FB")
        bus = Bus(port)
        with pytest.raises(NoReply):
            bus.do(dynamixel1.ping(1))
        assert bus.echo is True
        bus = Bus(Scripted("FF FF 01 02 01 FB"))
        servo = bus.attach(RX28, 1)
        servo.ping()
        assert bus.echo is False
        assert servo.alarms == dynamixel1.Error.INPUT_VOLTAGE

    def test_alone_is_silence(self) -> None:
        bus = Bus(Scripted(TEMPERATURE))
        with pytest.raises(NoReply):
            bus.attach(RX28, 1).read(RX28.present_temperature)

    def test_in_two_pieces(self) -> None:
        exchange = dynamixel1.read_data(1, 43, 1)
        collector = ReplyCollector([exchange], None)
        for byte in bytes.fromhex(TEMPERATURE + ANSWER):
            collector.feed(bytes([byte]))
        assert collector.done
        assert collector.result() == b"\x20"


def test_each_servo_is_spoken_to_at_its_own_speed() -> None:
    port = Scripted(ANSWER, "55 55 02 04 1A 24 BB")
    bus = Bus(port, echo=False)
    bus.attach(RX28, 1, baud=1_000_000)
    bus.attach(LX16A, 2)
    assert bus.read_all("present_temperature") == {1: 32.0, 2: 36.0}
    assert port.bauds == [1_000_000, 115_200]


def test_a_register_stands_for_its_name_on_all_models() -> None:
    with servobus.open("virtual:rx28@1,lx16a@2?clock=virtual") as bus:
        bus.scan(ids=[1, 2])
        assert bus.read_all(RX28.present_position) == bus.read_all("present_position")
        with pytest.raises(UnknownName, match="LX/HTS bus servo, model unknown has no register 'punch'"):
            bus.read_all(RX28.punch)


class TestSecondTry:
    def test_a_lost_read_is_asked_once_more(self) -> None:
        bus, port = bus_with(None, OK, ANSWER)
        assert bus.attach(RX28, 1).read(RX28.present_temperature) == 32.0
        assert port.requests == [TEMPERATURE, PING, TEMPERATURE]  # PING shows that nothing can come late any more

    def test_and_only_once(self) -> None:
        bus, port = bus_with(None, None, ANSWER)
        with pytest.raises(NoReply):
            bus.attach(RX28, 1).read(RX28.present_temperature)
        assert len(port.requests) == 2

    def test_an_action_is_never_repeated(self) -> None:
        bus, port = bus_with(None, OK)
        with pytest.raises(NoReply):
            bus.do(dynamixel1.action(1))
        assert port.requests == ["FF FF 01 02 05 F7"]

    def test_nor_is_a_write_to_the_eeprom(self) -> None:
        bus, port = bus_with("FF FF 01 03 00 24 D7", UNLOCKED, None, OK)
        with pytest.raises(NoReply):
            bus.attach(RX28, 1).write(RX28.alarm_led, dynamixel1.Error.OVERLOAD)
        assert port.requests[2:] == ["FF FF 01 04 03 11 20 C6"]

    def test_a_write_to_the_ram_is(self) -> None:
        bus, port = bus_with(None, MODEL_BYTE, OK)
        bus.attach(RX28, 1).write(RX28.led, True)
        led, model = "FF FF 01 04 03 19 01 DD", "FF FF 01 04 02 00 01 F7"
        assert port.requests == [led, model, led]  # PING is answered like a write: a read is asked between

    def test_a_refusal_stands(self) -> None:
        bus, port = bus_with("FF FF 01 02 08 F4", OK)
        with pytest.raises(Refused):
            bus.attach(RX28, 1).write(RX28.led, True)
        assert len(port.requests) == 1

    def test_after_a_change_of_speed_it_waits_until_servos_have_forgotten_half_a_packet(self) -> None:
        bus, port = bus_with(ANSWER)
        bus.attach(RX28, 1, baud=1_000_000).read(RX28.present_temperature)
        assert port.now() < 0.01  # nothing was sent at the first speed: nothing to forget
        port.script = [OK, ANSWER]
        bus.do(dynamixel1.ping(1), baud=57_600)
        bus[1].read(RX28.present_temperature)
        start = port.now()
        port.script = [OK, None, OK, ANSWER]
        bus.do(dynamixel1.ping(1), baud=57_600)
        assert bus[1].read(RX28.present_temperature) == 32.0
        assert 0.2 > port.now() - start > 0.1  # Byte to Byte Time, RX-28 manual, appendix

    def test_after_a_change_of_speed_a_write_waits_until_it_will_be_heard(self) -> None:
        bus, port = bus_with(ANSWER, OK)
        servo = bus.attach(RX28, 1)
        servo.read(RX28.present_temperature)
        start = port.now()
        bus.do(dynamixel1.write_data(1, 25, b"\x01"), baud=1_000_000)
        assert 0.2 > port.now() - start > 0.1

    def test_how_long_that_is_depends_on_what_is_asked(self) -> None:
        bus, port = bus_with(ANSWER)
        bus.attach(RX28, 1).read(RX28.present_temperature)
        start = port.now()
        bus.do(herkulex.ram_write(1, 53, b"\x01"), baud=115_200)
        assert port.now() - start > 0.2016  # Packet Garbage Check Period, HerkuleX manual 4-2 NO 35


def test_native_operations_are_values_too() -> None:
    with servobus.open("virtual:rx28@1-2?clock=virtual") as bus:
        bus.do(dynamixel1.reg_write(1, 25, b"\x01"), baud=57_600)
        bus.do(dynamixel1.reg_write(2, 25, b"\x01"))
        bus.do(dynamixel1.action())
        assert bus.do(dynamixel1.read_data(1, 25, 1)) == b"\x01"
        with pytest.raises(Refused):
            bus.do(dynamixel1.action(1))
    with servobus.open("virtual:drs0602@219?clock=virtual") as bus:
        assert bus.do(herkulex.stat(219)).status_error == herkulex.StatusError(0)
    with servobus.open("virtual:lx16a@1?clock=virtual") as bus:
        assert bus.do(lewansoul.query(1, lewansoul.Command.SERVO_ID_READ)) == (1,)
