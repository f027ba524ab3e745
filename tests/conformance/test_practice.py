"""Virtual servos as real ones are known, where that is not what the manuals say: the reading `practice`.

What the manual says is tested in the other files of this folder, on servos of the reading `manual`.
"""

from typing import Any

import pytest

from conformance.wire import Reply, Wire, dxl, lx
from servobus.core.units import deg
from servobus.families.registry import DRS0602, LX16A, RX28
from servobus.virtual.device.options import Reading
from servobus.virtual.device.servo import VirtualServo, virtual_servo
from servobus.virtual.wire.uart import ReceivedBytes

UNIT = 300 * deg / 1023
"""Of an RX-28."""


def rx28(*ids: int, **options: Any) -> Wire:
    return Wire(*(virtual_servo(RX28, id, position=150 * deg, options=options) for id in ids))


def lx16a(*ids: int, reading: Reading = "practice", **options: Any) -> Wire:
    return Wire(*(virtual_servo(LX16A, id, position=120 * deg, reading=reading, options=options) for id in ids))


# RX-28


def test_P1_a_goal_switches_the_torque_on() -> None:
    wire = rx28(2)
    assert wire.say("FF FF 02 07 03 1E BC 02 2C 01 EA") == "FF FF 02 02 00 FB"
    assert wire.say("FF FF 02 04 02 18 01 DE") == "FF FF 02 03 00 01 F9"
    wire.wait(2.0)
    assert wire.servo.position == pytest.approx(0x2BC * UNIT, abs=UNIT)


def test_P1_by_the_manual_it_does_not() -> None:
    wire = Wire(virtual_servo(RX28, 2, position=150 * deg, reading="manual"))
    assert wire.say("FF FF 02 07 03 1E BC 02 2C 01 EA") == "FF FF 02 02 00 FB"
    assert wire.say("FF FF 02 04 02 18 01 DE") == "FF FF 02 03 00 00 FA"
    wire.wait(2.0)
    assert wire.servo.position == pytest.approx(150 * deg, abs=UNIT)


@pytest.mark.parametrize(
    "packets",
    [
        ["FE 07 83 1E 02 02 BC 02"],  # SYNC_WRITE
        ["02 05 04 1E BC 02", "FE 02 05"],  # REG_WRITE and ACTION
        ["FE 05 03 1E BC 02"],  # broadcast WRITE_DATA
    ],
)
def test_P1_however_the_goal_is_written(packets: list[str]) -> None:
    wire = rx28(2)
    for packet in packets:
        wire.say(dxl(packet))
    assert wire.say("FF FF 02 04 02 18 01 DE") == "FF FF 02 03 00 01 F9"
    wire.wait(2.0)
    assert wire.servo.position == pytest.approx(0x2BC * UNIT, abs=UNIT)


def test_P1_a_goal_that_is_refused_switches_nothing_on() -> None:
    wire = rx28(2)
    wire.say(dxl("02 07 03 06 90 01 58 02"))  # limits 400 .. 600
    assert wire.say(dxl("02 05 03 1E BC 02")) == dxl("02 02 02").hex(" ").upper()
    assert wire.say("FF FF 02 04 02 18 01 DE") == "FF FF 02 03 00 00 FA"


def test_P7_a_broadcast_ping_is_answered_by_each_in_its_turn() -> None:
    wire = rx28(1, 2, 3, broadcast_ping="answered")
    heard = wire.say("FF FF FE 02 01 FE")
    assert heard == "FF FF 01 02 00 FC FF FF 02 02 00 FB FF FF 03 02 00 FA"
    assert rx28(1, 2, 3).say("FF FF FE 02 01 FE") == ""  # the manual of the RX-28: 3-2, 3-4-1


def test_P7_whatever_their_delays_are() -> None:
    wire = rx28(7, 1, 12, 253, broadcast_ping="answered")
    for servo in wire.line.servos:
        servo.put("return_delay_time", 0)
    heard = wire.say("FF FF FE 02 01 FE", listen=1.0)
    assert heard.bytes == b"".join(dxl(f"{id:02X} 02 00") for id in (1, 7, 12, 253))
    assert wire.say("FF FF FE 02 01 FF", listen=1.0) == ""  # a PING with a wrong checksum is not answered (3-5-5)


def test_P8_an_answer_begins_20_to_200_us_after_the_return_delay() -> None:
    wire = rx28(1)
    for code in (250, 0):
        wire.servo.put("return_delay_time", code)
        begins = [wire.say("FF FF 01 02 01 FB").first for _ in range(200)]
        assert 20e-6 <= min(begins) - code * 2e-6 < 30e-6
        assert 190e-6 < max(begins) - code * 2e-6 <= 200e-6


def test_P8_a_servo_takes_the_same_times_again() -> None:
    def times(id: int) -> list[float]:
        wire = rx28(id)
        return [wire.say(dxl(f"{id:02X} 02 01")).first for _ in range(10)]

    assert times(1) == times(1)
    assert times(1) != times(2)


def test_P8_a_goal_in_endless_turn_can_be_an_angle_error() -> None:
    for word, error in (("kept", 0), ("refused", 2)):
        wire = rx28(1, turn_goal=word)
        wire.say(dxl("01 07 03 06 00 00 00 00"))
        assert wire.say(dxl("01 05 03 1E BC 02")) == dxl(f"01 02 {error:02X}").hex(" ").upper()


def test_P8_a_servo_holds_what_it_was_found_with() -> None:
    held = {"ccw_angle_limit": 0xFFFF, "reserved_10": 1, "reserved_20": 0x12345678}
    wire = Wire(virtual_servo(RX28, 1, memory=held))
    assert wire.say(dxl("01 04 02 08 03")).bytes == dxl("01 05 00 FF FF 01")
    assert wire.say(dxl("01 04 02 14 04")).bytes == dxl("01 06 00 78 56 34 12")
    wire.power_cycle()
    assert wire.say(dxl("01 04 02 08 03")).bytes == dxl("01 05 00 FF FF 01")
    assert wire.say(dxl("01 05 03 1E FF 03")).bytes == dxl("01 02 00")  # a goal of 1023 is inside


@pytest.mark.parametrize(
    ("packet", "shortest", "longest"),
    [
        ("01 04 03 11 24", 5e-3, 7e-3),
        ("01 05 03 06 00 00", 10e-3, 14e-3),
        ("01 07 03 06 00 00 FF 03", 20e-3, 28e-3),
    ],
)
def test_P5_a_servo_is_deaf_while_it_writes_its_eeprom(packet: str, shortest: float, longest: float) -> None:
    write = dxl(packet)
    for pause in (shortest - 0.1e-3, longest + 0.1e-3):
        wire = rx28(1, eeprom_pause="on")
        answer = wire.say(write, listen=0)
        wait(wire, "FF FF 01 02 00 FC", pause)
        assert answer.text == ""
        assert (wire.say("FF FF 01 02 01 FB") == "FF FF 01 02 00 FC") == (pause > longest)
        assert wire.say("FF FF 01 02 01 FB") == "FF FF 01 02 00 FC"


def wait(wire: Wire, answer: str, pause: float) -> None:
    """Hear an answer to its end, and let a pause pass behind that."""
    runs: list[ReceivedBytes] = []
    while sum(len(run.data) for run in runs) < len(bytes.fromhex(answer)):
        wire.now += 50e-6
        runs += wire.line.arrivals(wire.now)
    assert b"".join(run.data for run in runs).hex(" ").upper() == answer
    wire.now = runs[-1].end + pause


def test_P5_ram_takes_no_time_and_by_default_no_byte_does() -> None:
    for wire, packet in ((rx28(1, eeprom_pause="on"), "01 04 03 19 01"), (rx28(1), "01 04 03 11 24")):
        wire.say(dxl(packet), listen=0)
        wait(wire, "FF FF 01 02 00 FC", 1e-4)
        assert wire.say("FF FF 01 02 01 FB") == "FF FF 01 02 00 FC"


def test_P5_other_servos_hear_meanwhile() -> None:
    wire = rx28(1, 2, eeprom_pause="1s")
    wire.say(dxl("01 04 03 11 24"))
    assert wire.say("FF FF 01 02 01 FB") == ""
    assert wire.say("FF FF 02 02 01 FA") == "FF FF 02 02 00 FB"


# LX-16A


def units(wire: Wire, servo: VirtualServo | None = None) -> float:
    wire.observe()
    return (servo or wire.servo).position / (0.24 * deg)


@pytest.mark.parametrize(
    "packets",
    [
        ["55 55 01 07 01 C8 00 F4 01 39"],
        [lx("01 07 07 C8 00 F4 01"), lx("01 03 0B")],
        [lx("01 07 07 C8 00 F4 01"), lx("FE 03 0B")],
        [lx("01 07 1D 00 00 00 00"), lx("01 07 01 C8 00 F4 01")],
        [lx("01 04 1F 00"), lx("01 07 01 C8 00 F4 01")],  # unloaded by hand, as to calibrate
    ],
)
def test_P2_a_move_makes_a_limp_servo_move(packets: list[str | bytes]) -> None:
    wire = lx16a(1)
    for packet in packets:
        wire.say(packet)
    wire.wait(2.0)
    assert wire.say(lx("01 03 20")).bytes == lx("01 04 20 01")
    assert units(wire) == pytest.approx(200, abs=3)


def test_P2_motor_mode_makes_a_limp_servo_turn() -> None:
    wire = lx16a(1)
    wire.say(lx("01 07 1D 01 00 F4 01"))
    wire.wait(1.0)
    assert units(wire) > 600
    assert wire.say(lx("01 03 20")).bytes == lx("01 04 20 01")


@pytest.mark.parametrize(
    "packet", [lx("01 07 07 C8 00 F4 01"), lx("01 03 0B"), lx("01 03 0C"), lx("01 07 1D 01 00 00 00")]
)
def test_P2_what_moves_nothing_loads_nothing(packet: bytes) -> None:
    wire = lx16a(1)
    wire.say(packet)
    assert wire.say(lx("01 03 20")).bytes == lx("01 04 20 00")


def test_P2_by_the_manual_command_31_comes_first() -> None:
    for packet in (lx("01 07 01 C8 00 F4 01"), lx("01 07 1D 01 00 F4 01")):
        wire = lx16a(1, reading="manual")
        wire.say(packet)
        wire.wait(1.0)
        assert units(wire) == pytest.approx(500, abs=1)


@pytest.mark.parametrize("surplus", ["00", "00 00", "55"])
@pytest.mark.parametrize(
    ("command", "question", "before", "after"),
    [
        ("1F 01", "20", "20 00", "20 01"),
        ("18 50", "19", "19 55", "19 50"),
        ("21 01", "22", "22 00", "22 01"),
        ("23 05", "24", "24 07", "24 05"),
        ("11 0A", "13", "13 00", "13 0A"),
    ],
)
def test_P4_surplus_bytes_do_not_keep_a_servo_from_obeying(
    command: str, question: str, before: str, after: str, surplus: str
) -> None:
    data = bytes.fromhex(command + surplus)
    for reading, expected in (("practice", after), ("manual", before)):
        wire = lx16a(1, reading=reading)  # type: ignore[arg-type]
        wire.say(lx(f"01 {len(data) + 2:02X} {data.hex()}"))
        assert wire.say(lx(f"01 03 {question}")).bytes == lx(f"01 04 {expected}")


def test_P4_an_id_and_a_question_with_a_surplus_byte() -> None:
    wire = lx16a(1)
    wire.say("55 55 01 05 1F 01 00 D9")
    assert wire.say(lx("01 03 20")).bytes == lx("01 04 20 01")
    wire.say(lx("01 05 0D 09 00"))
    assert wire.say(lx("09 04 1C 00")).bytes[:5] == bytes.fromhex("55 55 09 05 1C")
    assert lx16a(1, surplus="ignored").say(lx("01 04 1C 00")) == ""


def test_S6_START_and_STOP_with_a_surplus_byte() -> None:
    wire = lx16a(1, 2, 3)
    for id in (1, 2, 3):
        wire.say(lx(f"{id:02X} 07 07 20 03 E8 03"))  # to 800 in a second
    wire.say("55 55 FE 04 0B 00 F2")
    wire.wait(0.5)
    assert all(600 < units(wire, servo) < 720 for servo in wire.line.servos)
    wire.say(lx("FE 04 0C 00"))
    wire.wait(0.2)
    stopped = [units(wire, servo) for servo in wire.line.servos]
    wire.wait(1.0)
    assert [units(wire, servo) for servo in wire.line.servos] == pytest.approx(stopped, abs=2)
    assert max(stopped) < 760


def test_S6_OFFSET_WRITE_with_a_surplus_byte() -> None:
    for word, offset in (("obeyed", "0A"), ("ignored", "00")):
        wire = lx16a(1, surplus=word)
        wire.say(lx("01 04 11 0A"))
        wire.say(lx("01 04 12 00"))
        wire.power_cycle()
        assert wire.say(lx("01 03 13")).bytes == lx(f"01 04 13 {offset}")


def test_P8_an_lx16a_answers_2_ms_later_than_at_once() -> None:
    wire = lx16a(1)
    begins = [wire.say(lx("01 03 1C")).first for _ in range(200)]
    assert 2.0e-3 <= min(begins) < 2.05e-3
    assert 2.95e-3 < max(begins) <= 3.0e-3


def test_P8_a_high_voltage_model_holds_14_volts() -> None:
    wire = Wire(virtual_servo(LX16A, 1, memory={"max_voltage": 14_000, "min_voltage": 4500}))
    assert wire.say(lx("01 03 17")).bytes == lx("01 07 17 94 11 B0 36")


# DRS-0602


def hx(text: str) -> bytes:
    """Give the bytes of a packet to HerkuleX servos: id, command and data in hex."""
    id, code, *data = bytes.fromhex(text)
    check = 0
    for byte in (size := len(data) + 7, id, code, *data):
        check ^= byte
    return bytes([0xFF, 0xFF, size, id, code, check & 0xFE, ~check & 0xFE, *data])


STAT, REBOOT = hx("01 07"), hx("01 09")


def herkulex(**options: Any) -> Wire:
    return Wire(virtual_servo(DRS0602, 1, options=options))


def heard_after(wire: Wire, pause: float) -> Reply:
    wire.wait(pause)
    return wire.say(STAT)


def test_P6_a_restart_takes_as_long_as_it_takes() -> None:
    wire = herkulex()
    wire.say(REBOOT, listen=0)
    assert heard_after(wire, 0.2) == ""
    assert heard_after(wire, 0.25) != ""
    slow = herkulex(boot_time="2s")
    slow.say(REBOOT, listen=0)
    assert heard_after(slow, 1.9) == ""
    assert heard_after(slow, 0.1) != ""


@pytest.mark.parametrize(("model", "ping"), [(RX28, dxl("01 02 01")), (LX16A, lx("01 03 0E")), (DRS0602, STAT)])
def test_P6_so_does_a_supply_that_comes_back(model: Any, ping: bytes) -> None:
    wire = Wire(virtual_servo(model, 1, options={"boot_time": "300ms"}))
    assert wire.say(ping) != ""
    wire.line.unplug(wire.line.servos, wire.now)
    wire.wait(1.0)
    wire.line.plug(wire.line.servos, wire.now)
    assert wire.say(ping) == ""
    wire.wait(0.3)
    assert wire.say(ping) != ""


def test_P8_position_words_can_carry_a_flag() -> None:
    for word, high in (("off", 0x40), ("on", 0xC0)):
        wire = herkulex(position_flags=word)
        answer = wire.say(hx("01 04 3A 04")).bytes  # calibrated and absolute position, 58 to 61
        assert answer[9:13] == bytes([0, high, 0, high])  # 16384, the middle
