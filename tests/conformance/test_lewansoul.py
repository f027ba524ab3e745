"""The virtual LX-16A against its manual: one test for each behaviour, named by its number.

What is sent and what is heard is written here as bytes from the id to the last parameter; `packet` puts the
header before and the checksum behind, by the manual's rule. Two-byte values have the low byte first.
"""

import inspect
import itertools
import math
import re
import sys
from time import process_time
from typing import Any

import pytest

from conformance.wire import Wire
from servobus.core.framing import Packet
from servobus.core.units import deg
from servobus.errors import UsageError
from servobus.families.lewansoul.firmware import LewansoulServo
from servobus.families.lewansoul.models.lx import LX16A
from servobus.virtual.device.motors import motor
from servobus.virtual.device.servo import VirtualServo, virtual_servo
from servobus.virtual.physics.motor import Load, no_load_speed, operating_point
from servobus.virtual.physics.shaft import Rail

UNIT = 0.24 * deg
MOTOR = motor(LX16A)
TOP_SPEED = 60 * deg / 0.16
"""rad/s without load at 7.4 V, by the product pages."""

READS = {2: 4, 8: 4, 14: 1, 19: 1, 21: 4, 23: 4, 25: 1, 26: 1, 27: 2, 28: 2, 30: 4, 32: 1, 34: 1, 36: 1}
"""Read command -> parameter bytes of its answer: length in table 4, less 3."""
WRITES = {
    1: "90 01 E8 03", 7: "90 01 E8 03", 13: "07", 17: "14", 20: "64 00 84 03", 22: "70 17 F8 2A", 24: "46",
    29: "01 00 F4 01", 31: "01", 33: "01", 35: "03", 11: "", 12: "", 18: "",
}  # fmt: skip
"""Write command -> parameters that it takes and that change something; 11, 12 and 18 have none."""


def packet(body: str) -> str:
    """Give a whole packet in hex: `body` is id, length, command, parameters."""
    data = bytes.fromhex(body)
    checksum = ~sum(data) & 0xFF
    return f"55 55 {data.hex(' ')} {checksum:02X}".upper()


def command(number: int, parameters: str = "", id: int = 1) -> str:
    data = bytes.fromhex(parameters)
    return packet(bytes((id, len(data) + 3, number, *data)).hex(" "))


def servo(id: int | None = 1, **surroundings: Any) -> VirtualServo:
    return virtual_servo(LX16A, id, reading="manual", **surroundings)


def limp(**surroundings: Any) -> Wire:
    """One servo with id 1 as it comes from its box: position 500, torque off."""
    return Wire(servo(**surroundings))


def loaded(**surroundings: Any) -> Wire:
    """The same with its torque on."""
    wire = limp(**surroundings)
    tell(wire, "01 04 1F 01")
    return wire


def tell(wire: Wire, body: str) -> None:
    """Send a command and check that nothing is answered; no time passes after its last bit."""
    assert wire.say(packet(body), listen=0) == ""


def ask(wire: Wire, body: str) -> str:
    """Send a question and give the answer from the id to the last parameter, "" for silence."""
    reply = wire.say(packet(body), listen=0.005)
    if reply == "":
        return ""
    assert reply.text == packet(reply.bytes[2:-1].hex(" "))
    return reply.bytes[2:-1].hex(" ").upper()


def units(wire: Wire) -> float:
    """Where the shaft of the first servo is, in position units from its own zero."""
    wire.observe()
    return wire.servo.position / UNIT


def about(value: float) -> Any:
    """Compare positions in units, of a shaft that has come to rest: the loop holds within one."""
    return pytest.approx(value, abs=1.0)


def passing(value: float) -> Any:
    """Compare positions in units, on the way: at 500 units/s a tick of 2 ms is one, and the loop has an error too."""
    return pytest.approx(value, abs=2.0)


def arrival(wire: Wire, goal: float, within: float = 1.0) -> float:
    """Wait until the shaft is at a goal (units) and stands there; give the seconds until it came there to stay."""
    start, came, since = wire.now, 0.0, 0.0
    while wire.now - start < 60:
        wire.wait(0.002)
        if units(wire) != pytest.approx(goal, abs=within):
            came = 0.0
        elif not came:
            came = since = wire.now
        elif wire.now - since > 0.2:
            return came - start
    raise AssertionError(f"never at {goal}, but at {units(wire)}")


def block(wire: Wire, blocked: bool = True) -> None:
    """Hold the shaft in a vice, or let it go."""
    wire.servo.shaft.load = Load(blocked=1.0 if blocked else 0.0)


def memory(wire: Wire) -> dict[str, bytes]:
    return wire.servo.memory.image()


def light(wire: Wire, seconds: float = 2.0) -> str:
    """Watchdog the light for a while: on, off or flashing."""
    seen = []
    for _ in range(round(seconds / 0.05)):
        wire.wait(0.05)
        seen.append(wire.servo.led)
    changes = sum(one != other for one, other in itertools.pairwise(seen))
    if changes > 2:
        return "flashing"
    assert changes == 0
    return seen[0]


def holds(wire: Wire) -> bool:
    """Tell whether the shaft resists being turned by hand."""
    wire.observe()
    try:
        wire.servo.turn_shaft(wire.servo.position)
    except UsageError:
        return True
    return False


# Framing and bus


def test_L_1_one_speed_one_wire() -> None:
    wire = Wire(servo(), echo=True)
    question = packet("01 03 0E")
    reply = wire.say(question)
    # On one wire the client hears itself, and then the servo.
    assert reply.text == question + " " + packet("01 04 0E 01")
    assert Wire(servo()).baud == 115_200
    quiet = Wire(servo())
    answer = quiet.say(question)
    assert answer.last - answer.first == pytest.approx(7 * 10 / 115_200)  # 8N1: ten bits a byte
    assert quiet.say(question, baud=57_600) == ""
    assert quiet.say(question, baud=1_000_000) == ""
    # Whoever sends while the servo answers spoils the answer.
    quiet.say(question, listen=answer.first)
    assert quiet.say("00 00 00 00 00 00 00") != answer.text


def test_L_2_frame() -> None:
    wire = limp()
    assert wire.say("55 55 01 03 0E ED") == "55 55 01 04 0E 01 EB"
    assert wire.say("55 55 01 03 15 E6") == "55 55 01 07 15 00 00 E8 03 F7"
    assert wire.say("55 55 01 04 0E EC") == ""  # one parameter announced and none there
    wire.wait(1.0)
    assert wire.say("55 55 01 02 0E EE") == ""  # length 2 has no room for a command


def test_L_3_checksum() -> None:
    wire = limp()
    # 01 + 03 + 1B = 1F, and its complement is E0: the one packet known from a user's scope (EL-20).
    reply = wire.say("55 55 01 03 1B E0")
    assert reply == "55 55 01 05 1B E8 1C DA"
    assert sum(reply.bytes[2:]) & 0xFF == 0xFF
    # The sum is above 255: its low byte counts.
    wire.say("55 55 01 07 14 64 00 84 03 F8", listen=0)
    assert wire.say("55 55 01 03 15 E6") == "55 55 01 07 15 64 00 84 03 F7"


def test_L_4_only_the_one_that_is_meant_acts_and_all_on_254() -> None:
    wire = Wire(servo(1), servo(2), servo(3))
    tell(wire, "02 04 21 01")
    assert [one.led for one in wire.line.servos] == ["on", "off", "on"]
    tell(wire, "04 04 21 01")
    assert [one.led for one in wire.line.servos] == ["on", "off", "on"]
    tell(wire, "FE 04 21 01")
    assert [one.led for one in wire.line.servos] == ["off", "off", "off"]


def test_L_5_nothing_but_ID_READ_is_answered_on_254() -> None:
    wire = limp()
    for number in READS:
        assert (wire.say(command(number, id=254)) != "") == (number == 14)
    for number, parameters in WRITES.items():
        assert wire.say(command(number, parameters, id=254)) == ""


def test_L_6_every_servo_answers_ID_READ_on_254() -> None:
    assert limp().say("55 55 FE 03 0E F0") == "55 55 01 04 0E 01 EB"
    # 01 .. 01 EB and 02 .. 02 E9 at once: a wire that somebody pulls low is low.
    assert Wire(servo(1), servo(2)).say("55 55 FE 03 0E F0") == "55 55 00 04 0E 00 E9"


@pytest.mark.parametrize("number", WRITES)
def test_L_7_write_commands_are_never_answered(number: int) -> None:
    assert limp().say(command(number, WRITES[number]), listen=0.5) == ""


@pytest.mark.parametrize("number", READS)
def test_L_8_read_commands_are_answered_at_once_with_the_same_command(number: int) -> None:
    reply = limp().say(command(number))
    assert reply.bytes[4] == number
    assert reply.bytes[5:-1] != b""
    assert reply.last < 0.020  # what drivers in the field wait, at the least


def test_L_9_answers_have_the_same_frame_and_the_id_of_the_servo() -> None:
    wire = Wire(servo(0x2A))
    for number in READS:
        reply = wire.say(command(number, id=0x2A))
        assert reply.bytes[:3] == b"\x55\x55\x2a"
        assert reply.bytes[3] == len(reply.bytes) - 3
        assert sum(reply.bytes[2:]) & 0xFF == 0xFF


def test_L_10_bad_checksum_unknown_command_wrong_length_are_ignored() -> None:
    wire = limp()
    before = memory(wire)
    for bad in (
        "55 55 01 03 0E EC",  # checksum one too low
        "55 55 01 04 21 01 D9",
        packet("01 03 03"),  # commands that there are not
        packet("01 03 25"),
        packet("01 07 FF 01 02 03 04"),
        packet("01 04 0E 01"),  # a question with a parameter, as in an answer
        packet("01 03 21"),  # a command without its parameter
        packet("01 05 21 01 00"),  # and with one too many
    ):
        assert wire.say(bad) == ""
    assert memory(wire) == before
    assert ask(wire, "01 03 0E") == "01 04 0E 01"


def test_L_11_noise_before_the_header_is_skipped() -> None:
    wire = limp()
    answer = "55 55 01 04 0E 01 EB"
    assert wire.say("00 FF 13 37 55 01 55 55 01 03 0E ED") == answer
    # Of three 55 the last two are the header ...
    assert wire.say("55 55 55 01 03 0E ED") == answer
    # ... unless the first two are, and the third is id 85.
    assert Wire(servo(85)).say("55 55 55 03 0E 99") == "55 55 55 04 0E 55 43"


def test_L_12_an_incomplete_packet_is_dropped_after_a_pause() -> None:
    wire = limp()
    wire.say("55 55 01 04 21", listen=1.0)
    wire.say("01 D8")
    assert wire.servo.led == "on"  # what came after the pause did not complete it
    wire.say("55 55 01 04 21", listen=1.0)
    assert ask(wire, "01 03 0E") == "01 04 0E 01"
    wire.say("55 55 01 04 21", listen=0.001)
    wire.say("01 D8")
    assert wire.servo.led == "off"


def test_L_13_lengths_of_requests() -> None:
    right = {1: 7, 7: 7, 20: 7, 22: 7, 29: 7, 13: 4, 17: 4, 24: 4, 31: 4, 33: 4, 35: 4}
    assert {*WRITES, *READS} == {*right, 2, 8, 11, 12, 14, 18, 19, 21, 23, 25, 26, 27, 28, 30, 32, 34, 36}
    for number in {*WRITES, *READS}:
        for length in range(3, 8):
            wire = limp()
            before = memory(wire)
            given = bytes.fromhex(WRITES.get(number, ""))
            reply = wire.say(command(number, (given + bytes(4))[: length - 3].hex()))
            fits = length == right.get(number, 3)
            assert (reply != "") == (fits and number in READS)
            if number in right:
                assert (memory(wire) != before) == fits


@pytest.mark.parametrize("number", READS)
def test_L_14_lengths_of_answers(number: int) -> None:
    right = {2: 7, 8: 7, 21: 7, 23: 7, 30: 7, 27: 5, 28: 5, 14: 4, 19: 4, 25: 4, 26: 4, 32: 4, 34: 4, 36: 4}
    reply = limp().say(command(number))
    assert reply.bytes[3] == right[number]
    assert len(reply.bytes) == right[number] + 3


def test_L_15_ids_from_0_to_253() -> None:
    for id in (0, 1, 85, 253):
        reply = Wire(servo(id)).say(command(14, id=id))
        assert (reply.bytes[2], reply.bytes[5]) == (id, id)
    wire = limp()
    for old, new in ((1, 0), (0, 253), (253, 85)):
        tell(wire, f"{old:02X} 04 0D {new:02X}")
        assert ask(wire, f"{new:02X} 03 0E") == f"{new:02X} 04 0E {new:02X}"


def test_L_16_low_byte_first() -> None:
    wire = limp()
    tell(wire, "01 07 01 23 01 57 04")
    assert ask(wire, "01 03 02") == "01 07 02 23 01 57 04"
    tell(wire, "01 04 1F 01")  # the move begins now
    wire.wait(2.0)
    assert units(wire) == about(0x0123)


# Moves


def test_L_17_a_move_starts_at_once_at_uniform_speed_and_arrives_in_time() -> None:
    wire = loaded()
    tell(wire, "01 07 01 E8 03 E8 03")  # to 1000 in 1000 ms
    wire.wait(0.004)
    assert wire.servo.shaft.velocity > 0
    wire.wait(0.096)
    track = []
    for _ in range(10):
        track.append(units(wire))
        assert wire.servo.shaft.velocity == pytest.approx(500 * UNIT, rel=0.02)
        wire.wait(0.1)
    assert track == [passing(550 + 50 * i) for i in range(10)]
    assert units(wire) == about(1000)
    assert ask(wire, "01 03 1C") == "01 05 1C E8 03"
    tell(wire, "01 07 01 00 00 30 75")  # to 0 in 30000 ms
    wire.wait(15)
    assert units(wire) == passing(500)
    wire.wait(15)
    assert units(wire) == about(0)
    for raw, seconds in (("FA 00", 0.25), ("E8 03", 1.0), ("88 13", 5.0)):
        tell(wire, "01 07 01 00 00 00 00")
        wire.wait(1.0)
        tell(wire, f"01 07 01 2C 01 {raw}")  # to 300
        wire.wait(seconds)
        assert units(wire) == pytest.approx(300, abs=1 + 0.004 * 300 / seconds)  # two ticks at its speed
        assert arrival(wire, 300) <= 0.08  # it has to brake, from its speed at the last moment


def test_L_18_a_unit_is_a_quarter_degree_less_a_hundredth() -> None:
    wire = loaded()
    for raw, angle in (("00 00", 0.0), ("01 00", 0.24), ("F4 01", 120.0), ("E8 03", 240.0)):
        tell(wire, f"01 07 01 {raw} 00 00")
        wire.wait(1.0)
        assert math.degrees(wire.servo.position) == pytest.approx(angle, abs=0.12)  # half a unit
        assert ask(wire, "01 03 1C") == f"01 05 1C {raw}"


def test_L_19_the_last_move_can_be_read() -> None:
    wire = loaded()
    tell(wire, "01 07 01 90 01 D0 07")
    assert ask(wire, "01 03 02") == "01 07 02 90 01 D0 07"
    tell(wire, "01 07 01 F4 01 64 00")
    assert ask(wire, "01 03 02") == "01 07 02 F4 01 64 00"
    wire.wait(1.0)
    assert ask(wire, "01 03 02") == "01 07 02 F4 01 64 00"


def test_L_20_before_any_move_there_is_the_present_position() -> None:
    wire = limp()
    assert ask(wire, "01 03 02") == "01 07 02 F4 01 00 00"
    wire.servo.turn_shaft(300 * UNIT)
    assert ask(wire, "01 03 02") == "01 07 02 2C 01 00 00"
    wire.servo.turn_shaft(-20 * UNIT)  # the answer has 0 .. 1000
    assert ask(wire, "01 03 02") == "01 07 02 00 00 00 00"


def test_L_21_a_kept_move_starts_nothing() -> None:
    wire = loaded()
    tell(wire, "01 07 07 E8 03 00 00")
    wire.wait(2.0)
    assert units(wire) == about(500)


def test_L_22_the_kept_move_is_started() -> None:
    wire = loaded()
    tell(wire, "01 07 07 E8 03 E8 03")
    wire.wait(1.0)
    tell(wire, "01 03 0B")
    wire.wait(0.5)
    assert units(wire) == passing(750)
    wire.wait(0.6)
    assert units(wire) == about(1000)


def test_L_23_a_kept_move_is_used_up() -> None:
    wire = loaded()
    tell(wire, "01 03 0B")  # nothing is kept
    wire.wait(1.0)
    assert units(wire) == about(500)
    tell(wire, "01 07 07 E8 03 00 00")
    tell(wire, "01 03 0B")
    wire.wait(1.0)
    tell(wire, "01 07 01 00 00 00 00")
    wire.wait(1.0)
    tell(wire, "01 03 0B")
    wire.wait(1.0)
    assert units(wire) == about(0)


def test_L_24_the_kept_move_can_be_read() -> None:
    wire = limp()
    tell(wire, "01 07 07 90 01 D0 07")
    assert ask(wire, "01 03 08") == "01 07 08 90 01 D0 07"


def test_L_25_the_kept_move_can_still_be_read_after_its_start() -> None:
    wire = loaded()
    tell(wire, "01 07 07 90 01 64 00")
    tell(wire, "01 03 0B")
    wire.wait(1.0)
    assert ask(wire, "01 03 08") == "01 07 08 90 01 64 00"


def test_L_26_a_kept_move_is_replaced_by_another_and_not_by_a_move() -> None:
    wire = loaded()
    tell(wire, "01 07 07 E8 03 00 00")
    tell(wire, "01 07 07 64 00 00 00")
    tell(wire, "01 07 01 90 01 00 00")
    wire.wait(1.0)
    assert units(wire) == about(400)
    assert ask(wire, "01 03 08") == "01 07 08 64 00 00 00"
    tell(wire, "01 03 0B")
    wire.wait(1.0)
    assert units(wire) == about(100)


def test_L_27_all_kept_moves_start_together() -> None:
    wire = Wire(servo(1), servo(2), servo(3))
    tell(wire, "FE 04 1F 01")
    tell(wire, "01 07 07 E8 03 E8 03")
    tell(wire, "02 07 07 00 00 E8 03")
    wire.wait(1.0)
    tell(wire, "FE 03 0B")
    for passed in (0.25, 0.5, 0.75):
        wire.wait(0.25)
        positions = [one.position / UNIT for one in wire.line.servos]
        assert positions == [passing(500 + 500 * passed), passing(500 - 500 * passed), about(500)]
    wire.wait(0.3)
    assert [one.position / UNIT for one in wire.line.servos] == [about(1000), about(0), about(500)]


def test_L_28_stop_holds() -> None:
    for time, wait in (("E8 03", 0.5), ("00 00", 0.15)):
        wire = loaded()
        tell(wire, f"01 07 01 E8 03 {time}")
        wire.wait(wait)
        tell(wire, "01 03 0C")
        stopped, speed = units(wire), wire.servo.shaft.velocity / UNIT
        assert 600 < stopped < 900
        farthest = stopped
        for _ in range(100):
            wire.wait(0.002)
            farthest = max(farthest, units(wire))
        assert farthest - stopped < 0.03 * speed  # what it needs to brake from full speed
        wire.wait(1.0)
        assert units(wire) == about(stopped)
        assert wire.servo.shaft.velocity == 0
        assert holds(wire)


def test_L_29_stop_does_nothing_at_rest() -> None:
    wire = loaded()
    before = memory(wire)
    tell(wire, "01 03 0C")
    wire.wait(1.0)
    assert units(wire) == about(500)
    assert holds(wire)
    assert memory(wire) == before
    free = limp()
    tell(free, "01 03 0C")
    assert not holds(free)


def test_L_30_a_new_move_begins_where_the_servo_is_and_takes_its_own_time() -> None:
    wire = loaded()
    tell(wire, "01 07 01 E8 03 E8 03")
    wire.wait(0.5)  # at 750
    tell(wire, "01 07 01 26 02 D0 07")  # to 550 in 2000 ms
    wire.wait(1.0)
    assert units(wire) == passing(650)
    wire.wait(1.0)
    assert units(wire) == about(550)


def test_L_31_goals_are_cut_to_the_angle_limits() -> None:
    wire = loaded()
    tell(wire, "01 07 14 2C 01 BC 02")  # 300 .. 700
    for goal, reached in (("E8 03", 700), ("00 00", 300), ("90 01", 400)):
        tell(wire, f"01 07 01 {goal} 00 00")
        wire.wait(1.0)
        assert units(wire) == about(reached)
    tell(wire, "01 07 07 E8 03 00 00")
    tell(wire, "01 03 0B")
    wire.wait(1.0)
    assert units(wire) == about(700)


def test_L_32_time_0_is_as_fast_as_possible_and_30000_the_longest() -> None:
    wire = loaded()
    tell(wire, "01 07 01 E8 03 00 00")
    while units(wire) < 900:
        wire.wait(0.002)
        assert wire.servo.shaft.duty == 1  # nothing is held back
    wire = loaded()
    tell(wire, "01 07 01 E8 03 00 00")
    assert 0.32 < arrival(wire, 1000) < 0.45  # 120 degrees at 60 in 0.16 s; to run up and to brake takes the rest
    tell(wire, "01 07 01 00 00 FF FF")
    assert ask(wire, "01 03 02") == "01 07 02 00 00 30 75"
    wire.wait(15)
    assert units(wire) == passing(500)
    wire.wait(15)
    assert units(wire) == about(0)
    tell(wire, "01 07 07 00 00 31 75")
    assert ask(wire, "01 03 08") == "01 07 08 00 00 30 75"


def test_L_33_goals_above_1000_are_1000() -> None:
    wire = loaded()
    for goal in ("E9 03", "FF FF"):
        tell(wire, "01 07 01 F4 01 00 00")
        wire.wait(1.0)
        tell(wire, f"01 07 01 {goal} 00 00")
        assert ask(wire, "01 03 02") == "01 07 02 E8 03 00 00"
        wire.wait(1.0)
        assert units(wire) == about(1000)
    tell(wire, "01 07 07 FF FF 00 00")
    assert ask(wire, "01 03 08") == "01 07 08 E8 03 00 00"


def test_L_34_a_time_too_short_is_late_at_full_speed() -> None:
    for volts, per_60 in ((7.4, 0.16), (6.0, 0.20)):  # the product pages
        late = []
        for time in ("00 00", "64 00"):  # 120 degrees as fast as possible, and in 100 ms
            wire = loaded(voltage=volts)
            tell(wire, "01 07 16 94 11 E0 2E")  # the limit is below 6 V, so that it works at all
            tell(wire, f"01 07 01 E8 03 {time}")
            wire.wait(0.25)
            assert wire.servo.shaft.velocity == pytest.approx(60 * deg / per_60, rel=0.02)
            late.append(0.25 + arrival(wire, 1000))
        assert 2 * per_60 < late[1] < 2 * per_60 + 0.13
        assert late[1] == pytest.approx(late[0], abs=0.02)


# Id


def test_L_35_the_id_is_1_and_can_be_set_for_good() -> None:
    wire = Wire(servo(None))
    assert ask(wire, "01 03 0E") == "01 04 0E 01"
    tell(wire, "01 04 0D 07")
    wire.power_cycle()
    assert ask(wire, "07 03 0E") == "07 04 0E 07"
    assert ask(wire, "01 03 0E") == ""


def test_L_36_the_id_can_be_read() -> None:
    assert Wire(servo(201)).say("55 55 C9 03 0E 25") == "55 55 C9 04 0E C9 5B"


@pytest.mark.parametrize("id", ["FE", "FF"])
def test_L_37_ids_254_and_255_are_refused(id: str) -> None:
    wire = limp()
    tell(wire, f"01 04 0D {id}")
    assert ask(wire, "01 03 0E") == "01 04 0E 01"
    assert ask(wire, "FE 03 0E") == "01 04 0E 01"


def test_L_38_ID_WRITE_to_254_gives_every_servo_that_id() -> None:
    wire = Wire(servo(1), servo(2), servo(3))
    tell(wire, "FE 04 0D 09")
    assert [one.id for one in wire.line.servos] == [9, 9, 9]
    assert ask(wire, "02 03 0E") == ""
    assert ask(wire, "09 03 0E") == "09 04 0E 09"  # three equal answers at once


def test_L_39_the_new_id_acts_at_once() -> None:
    wire = limp()
    tell(wire, "01 04 0D 07")
    assert ask(wire, "01 03 0E") == ""
    assert ask(wire, "07 03 0E") == "07 04 0E 07"


# Offset


def test_L_40_the_servo_turns_at_once_by_the_change_of_the_offset() -> None:
    wire = loaded()
    for raw, angle in (("32", 12.0), ("7D", 30.0), ("83", -30.0), ("00", 0.0)):
        tell(wire, f"01 04 11 {raw}")
        wire.wait(0.01)
        assert wire.servo.shaft.velocity * (120 + angle - math.degrees(wire.servo.position)) > 0
        wire.wait(0.4)
        assert math.degrees(wire.servo.position) == pytest.approx(120 + angle, abs=0.12)
        assert ask(wire, "01 03 13") == f"01 04 13 {raw}"
    tell(wire, "01 07 01 F5 01 30 75")  # a very slow move does not make the next turn slow
    wire.wait(30.1)
    tell(wire, "01 04 11 32")
    wire.wait(0.4)
    assert units(wire) == about(551)
    # Beyond 125 it is cut (EL-15): 127 is 125, -128 is -125.
    tell(wire, "01 04 11 7F")
    assert ask(wire, "01 03 13") == "01 04 13 7D"
    tell(wire, "01 04 11 80")
    assert ask(wire, "01 03 13") == "01 04 13 83"


def test_L_41_the_offset_is_a_signed_byte() -> None:
    wire = loaded()
    tell(wire, "01 04 11 CE")  # -50
    wire.wait(0.4)
    assert math.degrees(wire.servo.position) == pytest.approx(120 - 12, abs=0.12)
    assert ask(wire, "01 03 13") == "01 04 13 CE"


def test_L_42_an_offset_that_is_not_saved_is_lost_at_power_off() -> None:
    wire = limp()
    tell(wire, "01 04 11 CE")
    wire.power_cycle()
    assert ask(wire, "01 03 13") == "01 04 13 00"


def test_L_43_the_offset_is_saved_by_a_command_without_parameters() -> None:
    wire = limp()
    tell(wire, "01 04 11 CE")
    wire.say("55 55 01 03 12 E9")
    tell(wire, "01 04 11 14")  # not saved any more
    wire.power_cycle()
    assert ask(wire, "01 03 13") == "01 04 13 CE"


def test_L_44_the_offset_in_use_can_be_read_and_is_0() -> None:
    wire = limp()
    assert wire.say("55 55 01 03 13 E8") == "55 55 01 04 13 00 E7"
    tell(wire, "01 04 11 14")
    assert ask(wire, "01 03 13") == "01 04 13 14"


def test_L_45_positions_count_from_the_shifted_zero() -> None:
    wire = loaded()
    tell(wire, "01 04 11 64")  # 100 units
    wire.wait(0.4)
    assert units(wire) == about(600)
    assert ask(wire, "01 03 1C") == "01 05 1C F4 01"  # still 500
    tell(wire, "01 07 01 E8 03 00 00")
    wire.wait(1.0)
    assert units(wire) == about(1100)
    assert ask(wire, "01 03 1C") == "01 05 1C E8 03"
    tell(wire, "01 04 1F 00")
    tell(wire, "01 04 11 00")  # nothing turns without torque: the same place has another number
    wire.wait(0.2)
    assert units(wire) == about(1100)
    assert ask(wire, "01 03 1C") == "01 05 1C 4C 04"


# Limits


def test_L_46_angle_limits_are_set_for_good() -> None:
    wire = loaded()
    tell(wire, "01 07 14 64 00 84 03")  # 100 .. 900
    assert ask(wire, "01 03 15") == "01 07 15 64 00 84 03"
    wire.power_cycle()
    assert ask(wire, "01 03 15") == "01 07 15 64 00 84 03"
    tell(wire, "01 07 14 E7 03 FF FF")  # above 1000 is 1000 (EL-15)
    assert ask(wire, "01 03 15") == "01 07 15 E7 03 E8 03"


@pytest.mark.parametrize("limits", ["84 03 64 00", "F4 01 F4 01", "E8 03 E8 03", "4C 04 B0 04"])
def test_L_47_a_lower_limit_not_below_the_upper_one_is_refused(limits: str) -> None:
    wire = limp()
    tell(wire, "01 07 14 64 00 84 03")
    tell(wire, f"01 07 14 {limits}")
    assert ask(wire, "01 03 15") == "01 07 15 64 00 84 03"


def test_L_48_angle_limits_are_0_and_1000() -> None:
    assert limp().say("55 55 01 03 15 E6") == "55 55 01 07 15 00 00 E8 03 F7"


def test_L_49_voltage_limits_are_set_for_good() -> None:
    wire = limp()
    tell(wire, "01 07 16 70 17 F8 2A")  # 6000 .. 11000 mV
    assert ask(wire, "01 03 17") == "01 07 17 70 17 F8 2A"
    wire.power_cycle()
    assert ask(wire, "01 03 17") == "01 07 17 70 17 F8 2A"
    tell(wire, "01 07 16 00 00 FF FF")  # cut to 4500 .. 12000 (EL-15)
    assert ask(wire, "01 03 17") == "01 07 17 94 11 E0 2E"
    for refused in ("F8 2A 70 17", "70 17 70 17", "01 00 02 00", "E0 2E FF FF"):
        tell(wire, f"01 07 16 {refused}")
        assert ask(wire, "01 03 17") == "01 07 17 94 11 E0 2E"


def test_L_50_voltage_limits_are_6500_and_12000() -> None:
    assert limp().say("55 55 01 03 17 E4") == "55 55 01 07 17 64 19 E0 2E 55"


@pytest.mark.parametrize("volts", [6.4, 12.1])
def test_L_51_a_voltage_outside_the_limits_unloads_and_flashes(volts: float) -> None:
    wire = loaded()
    assert holds(wire)
    for mask, seen in (("02", "flashing"), ("05", "on"), ("07", "flashing")):
        tell(wire, f"01 04 23 {mask}")
        wire.servo.voltage = volts
        wire.wait(0.01)
        assert not holds(wire)
        assert light(wire) == seen
        tell(wire, "01 07 01 E8 03 00 00")
        wire.wait(1.0)
        assert units(wire) == about(500)
        tell(wire, "01 03 0C")
        wire.servo.voltage = 7.4
        wire.wait(0.2)
    for at_the_limit in (6.5, 12.0):
        wire.servo.voltage = at_the_limit
        wire.wait(0.2)
        assert holds(wire)


@pytest.mark.parametrize("volts", [6.4, 12.1])
def test_L_52_torque_returns_with_the_voltage(volts: float) -> None:
    wire = loaded()
    wire.servo.voltage = volts
    wire.wait(0.1)
    assert not holds(wire)
    wire.servo.voltage = 7.4
    wire.wait(0.2)
    assert holds(wire)
    tell(wire, "01 07 01 E8 03 00 00")
    wire.wait(1.0)
    assert units(wire) == about(1000)


def test_L_53_the_temperature_limit_is_85_and_can_be_set_for_good() -> None:
    wire = limp()
    assert ask(wire, "01 03 19") == "01 04 19 55"
    tell(wire, "01 04 18 46")
    assert ask(wire, "01 03 19") == "01 04 19 46"
    wire.power_cycle()
    assert ask(wire, "01 03 19") == "01 04 19 46"
    for raw, kept in (("32", "32"), ("64", "64"), ("00", "32"), ("FF", "64")):  # cut to 50 .. 100 (EL-15)
        tell(wire, f"01 04 18 {raw}")
        assert ask(wire, "01 03 19") == f"01 04 19 {kept}"


def test_L_54_heat_unloads_and_flashes_until_it_is_below_the_limit() -> None:
    wire = loaded()
    for mask, seen in (("01", "flashing"), ("06", "on"), ("07", "flashing")):
        tell(wire, f"01 04 23 {mask}")
        wire.servo.temperature = 85.0
        wire.wait(0.01)
        assert holds(wire)  # the limit itself is not above the limit
        wire.servo.temperature = 86.0
        wire.wait(0.01)
        assert not holds(wire)
        assert light(wire) == seen
        wire.servo.temperature = 85.0
        wire.wait(0.01)
        assert not holds(wire)  # and not below it
        wire.servo.temperature = 84.0
        wire.wait(0.01)
        assert holds(wire)
    tell(wire, "01 07 01 E8 03 00 00")
    wire.wait(1.0)
    assert units(wire) == about(1000)


def test_L_55_the_temperature_limit_can_be_read() -> None:
    assert limp().say("55 55 01 03 19 E2") == "55 55 01 04 19 55 8C"


# Measurements


@pytest.mark.parametrize(("celsius", "byte"), [(25.0, "19"), (61.4, "3D"), (-5.0, "00"), (0.0, "00")])
def test_L_56_temperature_is_a_byte_in_degrees(celsius: float, byte: str) -> None:
    assert ask(limp(temperature=celsius), "01 03 1A") == f"01 04 1A {byte}"


@pytest.mark.parametrize(("volts", "raw"), [(7.4, "E8 1C"), (12.0, "E0 2E"), (5.0, "88 13")])
def test_L_57_voltage_is_in_millivolts(volts: float, raw: str) -> None:
    assert ask(limp(voltage=volts), "01 03 1B") == f"01 05 1B {raw}"


@pytest.mark.parametrize(("position", "raw"), [(-12, "F4 FF"), (0, "00 00"), (1000, "E8 03"), (1100, "4C 04")])
def test_L_58_position_is_signed(position: int, raw: str) -> None:
    wire = limp()
    wire.servo.turn_shaft(position * UNIT)
    assert ask(wire, "01 03 1C") == f"01 05 1C {raw}"


# Mode


def test_L_59_motor_mode_turns_forward_and_reverse() -> None:
    wire = loaded()
    for speed, share in (("E8 03", 1.0), ("F4 01", 0.5), ("00 00", 0.0), ("0C FE", -0.5), ("18 FC", -1.0)):
        tell(wire, f"01 07 1D 01 00 {speed}")
        wire.wait(1.0)
        assert wire.servo.shaft.duty == share
        before = wire.servo.position
        wire.wait(2.0)
        pace = (wire.servo.position - before) / 2.0
        # A share of the output is a little less of the speed, because friction remains.
        assert pace == pytest.approx(no_load_speed(MOTOR, 7.4 * share), rel=0.005, abs=1e-9)
        assert pace == pytest.approx(share * TOP_SPEED, abs=0.03 * TOP_SPEED)
        if abs(share) == 1:
            assert abs(pace) == pytest.approx(TOP_SPEED, rel=0.01)
    # It is an output, and no loop: a load slows it down.
    tell(wire, "01 07 1D 01 00 F4 01")
    wire.servo.shaft.load = Load(torque=-0.4)
    wire.wait(2.0)
    assert wire.servo.shaft.velocity == pytest.approx(operating_point(MOTOR, 3.7, -0.4)[0], rel=0.02)
    assert 0 < wire.servo.shaft.velocity < 0.35 * TOP_SPEED


def test_L_60_position_mode_ignores_the_speed() -> None:
    wire = loaded()
    tell(wire, "01 07 1D 00 00 F4 01")
    wire.wait(1.0)
    assert units(wire) == about(500)
    tell(wire, "01 07 01 E8 03 00 00")
    wire.wait(1.0)
    assert units(wire) == about(1000)


def test_L_61_after_power_on_it_is_in_position_mode() -> None:
    wire = loaded()
    tell(wire, "01 07 1D 01 00 F4 01")
    wire.wait(0.5)
    wire.power_cycle()
    assert ask(wire, "01 03 1E") == "01 07 1E 00 00 00 00"
    tell(wire, "01 04 1F 01")
    here = units(wire)
    wire.wait(1.0)
    assert units(wire) == here


def test_L_62_mode_and_speed_can_be_read() -> None:
    wire = limp()
    assert ask(wire, "01 03 1E") == "01 07 1E 00 00 00 00"
    tell(wire, "01 07 1D 01 00 0C FE")
    assert ask(wire, "01 03 1E") == "01 07 1E 01 00 0C FE"
    tell(wire, "01 07 1D 01 AA 20 00")  # the null byte is not kept
    assert ask(wire, "01 03 1E") == "01 07 1E 01 00 20 00"
    tell(wire, "01 07 1D 00 00 0C FE")
    assert ask(wire, "01 03 1E") == "01 07 1E 00 00 00 00"


def test_L_63_back_in_position_mode_it_holds_where_it_is() -> None:
    wire = loaded()
    tell(wire, "01 07 01 F4 01 00 00")
    tell(wire, "01 07 1D 01 00 E8 03")
    wire.wait(0.2)
    tell(wire, "01 07 1D 00 00 00 00")
    here = units(wire)
    assert 700 < here < 500 + 0.2 * TOP_SPEED / UNIT
    wire.wait(1.0)
    assert units(wire) == about(here)
    assert holds(wire)
    wire.wait(1.0)
    assert wire.servo.shaft.velocity == 0


def test_L_64_moves_do_nothing_in_motor_mode_and_angle_limits_neither() -> None:
    wire = loaded()
    tell(wire, "01 07 14 C2 01 26 02")  # 450 .. 550
    tell(wire, "01 07 1D 01 00 00 00")
    tell(wire, "01 07 01 E8 03 00 00")
    wire.wait(1.0)
    assert units(wire) == about(500)
    assert ask(wire, "01 03 02") == "01 07 02 E8 03 00 00"
    tell(wire, "01 07 07 00 00 00 00")
    tell(wire, "01 03 0B")
    wire.wait(1.0)
    assert units(wire) == about(500)
    tell(wire, "01 07 1D 01 00 E8 03")
    wire.wait(1.0)
    assert units(wire) > 500 + 0.9 * TOP_SPEED / UNIT
    tell(wire, "01 07 1D 00 00 00 00")
    here = units(wire)
    wire.wait(1.0)
    assert units(wire) == about(here)  # the moves of before are forgotten
    free = limp()
    tell(free, "01 07 01 E8 03 00 00")
    tell(free, "01 07 1D 01 00 00 00")
    tell(free, "01 07 1D 00 00 00 00")
    tell(free, "01 04 1F 01")
    free.wait(1.0)
    assert units(free) == about(500)


def test_L_65_mode_above_1_is_refused_and_speed_is_cut_to_1000() -> None:
    wire = limp()
    for mode in ("02", "FF"):
        tell(wire, f"01 07 1D {mode} 00 F4 01")
        assert ask(wire, "01 03 1E") == "01 07 1E 00 00 00 00"
    for speed, kept in (("E9 03", "E8 03"), ("FF 7F", "E8 03"), ("17 FC", "18 FC"), ("00 80", "18 FC")):
        tell(wire, f"01 07 1D 01 00 {speed}")
        assert ask(wire, "01 03 1E") == f"01 07 1E 01 00 {kept}"
    tell(wire, "01 07 1D 02 00 00 00")
    assert ask(wire, "01 03 1E") == "01 07 1E 01 00 18 FC"


# Torque


def test_L_66_torque_off_and_on() -> None:
    wire = loaded()
    assert holds(wire)
    tell(wire, "01 07 01 E8 03 E8 03")
    wire.wait(0.5)
    tell(wire, "01 04 1F 00")
    here, speed = units(wire), wire.servo.shaft.velocity / UNIT
    assert here == passing(750)
    wire.wait(0.01)
    assert wire.servo.shaft.current == 0
    wire.wait(1.0)
    # Nothing brakes it but friction, and nothing takes it any further than that lets it go.
    slowing = MOTOR.coulomb / MOTOR.inertia / UNIT
    assert units(wire) == pytest.approx(here + speed**2 / (2 * slowing), abs=3.0)
    assert wire.servo.shaft.velocity == 0
    wire.servo.turn_shaft(123 * UNIT)
    assert ask(wire, "01 03 1C") == "01 05 1C 7B 00"
    tell(wire, "01 04 1F 01")
    assert holds(wire)


def test_L_67_torque_is_off_at_power_on() -> None:
    wire = loaded()
    wire.power_cycle()
    assert not holds(wire)
    assert ask(wire, "01 03 20") == "01 04 20 00"


def test_L_68_the_torque_can_be_read() -> None:
    wire = limp()
    assert ask(wire, "01 03 20") == "01 04 20 00"
    tell(wire, "01 04 1F 01")
    assert ask(wire, "01 03 20") == "01 04 20 01"
    tell(wire, "01 04 1F 00")
    assert ask(wire, "01 03 20") == "01 04 20 00"
    tell(wire, "01 04 1F FF")  # cut to 1 (EL-15)
    assert ask(wire, "01 03 20") == "01 04 20 01"


def test_L_69_a_move_without_torque_waits_for_it() -> None:
    wire = limp()
    tell(wire, "01 07 01 E8 03 E8 03")
    wire.wait(2.0)
    assert units(wire) == about(500)
    assert ask(wire, "01 03 02") == "01 07 02 E8 03 E8 03"
    tell(wire, "01 04 1F 01")
    wire.wait(0.5)
    assert units(wire) == passing(750)
    wire.wait(0.6)
    assert units(wire) == about(1000)


def test_L_70_torque_on_holds_where_the_shaft_is() -> None:
    wire = loaded()
    tell(wire, "01 07 01 E8 03 E8 03")
    wire.wait(0.5)
    tell(wire, "01 04 1F 00")
    wire.servo.turn_shaft(300 * UNIT)
    tell(wire, "01 04 1F 01")
    for _ in range(20):
        wire.wait(0.1)
        assert units(wire) == about(300)
    wire.servo.shaft.load = Load(torque=0.5)
    wire.wait(1.0)
    assert units(wire) == about(300)  # and it holds


# Light


def test_L_71_the_light_is_on_at_0_off_at_1_and_saved() -> None:
    wire = limp()
    assert light(wire) == "on"
    tell(wire, "01 04 21 01")
    assert light(wire) == "off"
    wire.power_cycle()
    assert light(wire) == "off"
    tell(wire, "01 04 21 00")
    assert light(wire) == "on"
    wire.servo.power_off()
    assert wire.servo.led == "off"


def test_L_72_the_setting_of_the_light_can_be_read() -> None:
    wire = limp()
    assert ask(wire, "01 03 22") == "01 04 22 00"
    tell(wire, "01 04 21 01")
    assert ask(wire, "01 03 22") == "01 04 22 01"
    tell(wire, "01 04 21 02")  # cut to 1 (EL-15)
    assert ask(wire, "01 03 22") == "01 04 22 01"


@pytest.mark.parametrize("mask", range(8))
def test_L_73_the_mask_says_which_faults_flash(mask: int) -> None:
    wire = loaded()
    tell(wire, f"01 04 23 {mask:02X}")
    tell(wire, "01 07 01 E8 03 00 00")
    wire.wait(1.0)
    assert light(wire) == "on"
    block(wire)
    tell(wire, "01 07 01 00 00 00 00")
    wire.wait(1.5)
    assert light(wire) == ("flashing" if mask & 4 else "on")
    # The manual unloads for heat and for voltage only: this goes on pushing.
    assert holds(wire)
    assert wire.servo.shaft.duty == -1
    wire.servo.temperature = 90.0
    assert light(wire) == ("flashing" if mask & 1 else "on")  # unloaded, it pushes no more
    wire.servo.temperature = 25.0
    wire.servo.voltage = 5.0
    assert light(wire) == ("flashing" if mask & 2 else "on")
    wire.servo.temperature = 90.0
    assert light(wire) == ("flashing" if mask & 3 else "on")
    assert not holds(wire)


def test_locked_is_a_rotor_that_stands_for_a_second_at_nearly_full_output() -> None:
    wire = loaded()
    block(wire)
    tell(wire, "01 07 01 E8 03 00 00")
    wire.wait(0.9)
    assert light(wire, 0.05) == "on"
    block(wire, False)
    wire.wait(1.0)
    assert units(wire) == about(1000)
    assert light(wire) == "on"
    # A load just too heavy locks it, in motor mode too; a heavy one that it still turns does not.
    for torque, mode, seen in ((-1.6, "E8 03", "on"), (-2.0, "E8 03", "flashing"), (0.0, "E8 03", "on")):
        tell(wire, f"01 07 1D 01 00 {mode}")
        wire.servo.shaft.load = Load(torque=torque)
        wire.wait(1.5)
        assert light(wire) == seen
    # Half the output against a vice is not nearly full, however long.
    block(wire)
    tell(wire, "01 07 1D 01 00 F4 01")
    wire.wait(3.0)
    assert light(wire) == "on"


def test_a_small_error_that_cannot_be_put_right_locks_in_the_end() -> None:
    wire = loaded()
    block(wire)
    tell(wire, "01 07 01 F6 01 00 00")  # two units away
    wire.wait(3.0)
    assert light(wire) == "flashing"


@pytest.mark.parametrize("led", ["00", "01"])
@pytest.mark.parametrize("fault", ["heat", "voltage", "locked rotor"])
def test_L_74_a_fault_flashes_whether_the_light_is_on_or_off(led: str, fault: str) -> None:
    wire = loaded()
    tell(wire, f"01 04 21 {led}")
    match fault:
        case "heat":
            wire.servo.temperature = 90.0
        case "voltage":
            wire.servo.voltage = 5.0
        case _:
            block(wire)
            tell(wire, "01 07 01 E8 03 00 00")
            wire.wait(1.5)
    assert light(wire) == "flashing"
    assert ask(wire, "01 03 22") == f"01 04 22 {led}"


@pytest.mark.parametrize(("name", "value"), [("temperature", 90.0), ("voltage", 5.0)])
def test_L_75_mask_0_is_no_alarm_and_still_protects(name: str, value: float) -> None:
    wire = loaded()
    tell(wire, "01 04 23 00")
    setattr(wire.servo, name, value)
    assert light(wire) == "on"
    assert not holds(wire)


def test_L_76_the_mask_can_be_read() -> None:
    wire = limp()
    for mask in range(8):
        tell(wire, f"01 04 23 {mask:02X}")
        assert ask(wire, "01 03 24") == f"01 04 24 {mask:02X}"
    tell(wire, "01 04 23 08")  # cut to 7 (EL-15)
    assert ask(wire, "01 03 24") == "01 04 24 07"


@pytest.mark.parametrize(("led", "after"), [("00", "on"), ("01", "off")])
def test_L_77_after_the_fault_the_light_is_as_it_was_set(led: str, after: str) -> None:
    wire = limp()
    tell(wire, f"01 04 21 {led}")
    wire.servo.voltage = 5.0
    assert light(wire) == "flashing"
    wire.servo.voltage = 7.4
    wire.wait(0.2)
    assert light(wire) == after
    tell(wire, "01 04 1F 01")
    block(wire)
    tell(wire, "01 07 01 E8 03 00 00")
    wire.wait(1.5)
    assert light(wire) == "flashing"
    block(wire, False)
    wire.wait(0.2)
    assert light(wire) == after


def test_L_78_the_mask_is_7_and_saved() -> None:
    wire = limp()
    assert ask(wire, "01 03 24") == "01 04 24 07"
    tell(wire, "01 04 23 05")
    wire.power_cycle()
    assert ask(wire, "01 03 24") == "01 04 24 05"


# Readings that have no L number


def test_EL_04_a_servo_can_be_silent_on_command_8() -> None:
    wire = limp()
    assert isinstance(wire.servo, LewansoulServo)
    wire.servo.wait_read = "silent"
    assert ask(wire, "01 03 08") == ""
    assert ask(wire, "01 03 02") != ""


def test_EL_08_a_move_can_switch_the_torque_on() -> None:
    wire = limp()
    assert isinstance(wire.servo, LewansoulServo)
    wire.servo.goal_torque = True
    tell(wire, "01 07 07 E8 03 00 00")
    assert not holds(wire)
    tell(wire, "01 03 0B")
    assert holds(wire)
    wire.wait(1.0)
    assert units(wire) == about(1000)


def test_EL_19_the_servo_answers_254_with_its_own_id() -> None:
    assert Wire(servo(0x2A)).say("55 55 FE 03 0E F0") == "55 55 2A 04 0E 2A 99"


def test_position_beyond_what_the_sensor_covers_reads_as_the_nearer_end() -> None:
    wire = limp()
    for position, raw in ((-190, "42 FF"), (-200, "42 FF"), (1194, "AA 04"), (1200, "AA 04"), (1500, "00 00")):
        wire.servo.turn_shaft(position * UNIT)
        assert ask(wire, "01 03 1C") == f"01 05 1C {raw}"
    assert isinstance(wire.servo, LewansoulServo)
    wire.servo.sensor = 0, 1000
    wire.servo.turn_shaft(-12 * UNIT)
    assert ask(wire, "01 03 1C") == "01 05 1C 00 00"


def test_after_whole_turns_a_move_takes_the_way_that_the_sensor_shows() -> None:
    wire = loaded()
    tell(wire, "01 07 1D 01 00 E8 03")
    wire.wait(5.0)
    tell(wire, "01 07 1D 00 00 00 00")
    tell(wire, "01 07 01 F4 01 00 00")
    wire.wait(2.0)
    assert wire.servo.position > 4 * math.pi
    assert ask(wire, "01 03 1C") == "01 05 1C F4 01"


def test_without_a_kept_move_command_8_answers_as_command_2_does() -> None:
    assert ask(limp(), "01 03 08") == "01 07 08 F4 01 00 00"


def test_a_protection_shows_in_command_32_and_ends_without_a_jump() -> None:
    wire = loaded()
    tell(wire, "01 07 01 E8 03 E8 03")
    wire.wait(0.5)
    wire.servo.voltage = 5.0
    wire.wait(0.5)
    assert ask(wire, "01 03 20") == "01 04 20 00"
    here = units(wire)
    assert 750 < here < 900  # it ran out
    wire.servo.voltage = 7.4
    wire.wait(1.0)
    assert ask(wire, "01 03 20") == "01 04 20 01"
    assert units(wire) == about(here)


def test_an_offset_during_a_move_shifts_where_it_ends() -> None:
    wire = loaded()
    tell(wire, "01 07 01 20 03 E8 03")  # to 800 in 1000 ms
    wire.wait(0.5)
    tell(wire, "01 04 11 32")
    wire.wait(0.1)
    assert units(wire) == passing(680)
    wire.wait(1.0)
    assert units(wire) == about(850)
    assert ask(wire, "01 03 1C") == "01 05 1C 20 03"


def test_power_off_forgets_moves_and_faults() -> None:
    wire = limp()
    tell(wire, "01 07 01 E8 03 00 00")  # waits for torque
    tell(wire, "01 07 07 E8 03 00 00")  # waits for command 11
    wire.servo.temperature = 86.0
    wire.wait(0.01)
    wire.servo.temperature = 85.0
    wire.power_cycle()
    tell(wire, "01 04 1F 01")
    wire.wait(0.01)
    assert holds(wire)  # 85 degrees are not above the limit, if nobody knows what was before
    tell(wire, "01 03 0B")
    wire.wait(1.0)
    assert units(wire) == about(500)
    assert ask(wire, "01 03 02") == "01 07 02 F4 01 00 00"
    assert ask(wire, "01 03 08") == "01 07 08 F4 01 00 00"


def test_commands_act_before_the_next_one_however_close() -> None:
    wire = loaded()
    one = wire.servo
    one.hear(Packet(1, 31, b"\x00"), one.time)  # torque off, move, and torque on, at one moment
    one.hear(Packet(1, 1, b"\x2c\x01\x00\x00"), one.time)
    one.hear(Packet(1, 31, b"\x01"), one.time)
    wire.wait(1.0)
    assert units(wire) == about(300)
    one.hear(Packet(1, 31, b"\x00"), one.time)
    one.turn_shaft(100 * UNIT)
    one.hear(Packet(1, 31, b"\x01"), one.time)
    wire.wait(1.0)
    assert units(wire) == about(100)


def test_how_finely_time_is_cut_makes_no_difference() -> None:
    tracks = []
    for step in (1, 7, 50):
        wire = loaded()
        tell(wire, "01 07 01 E8 03 E8 03")
        start = wire.now
        for i in range(1, 700 // step + 1):
            wire.line.run(start + i * step / 1000)
            wire.servo.advance(start + i * step / 1000)
        wire.now = start + 0.7
        tracks.append(units(wire))
    assert tracks[0] == tracks[1] == tracks[2]


@pytest.mark.parametrize("load", [Load(), Load(mass=0.4, length=0.1), Load(blocked=1.0)])
def test_nor_does_it_to_a_servo_that_stands(load: Load) -> None:
    ends = []
    for step in (0.002, 0.017, 0.3, 2.0):
        wire = loaded()
        wire.servo.shaft.load = load
        for command_ in ("01 07 01 E8 03 E8 03", "01 07 01 64 00 00 00"):
            tell(wire, command_)
            end = wire.now + 4.0
            for i in range(1, math.ceil(4.0 / step)):
                wire.servo.advance(end - 4.0 + i * step)
            wire.now = end
            wire.observe()
        ends.append((wire.servo.position, wire.servo.temperature, wire.servo.shaft.current, wire.servo.led))
    assert ends[0] == ends[1] == ends[2] == ends[3]


def test_a_stalled_servo_gets_too_hot_even_if_nobody_looks() -> None:
    wire = loaded()
    block(wire)
    tell(wire, "01 07 01 E8 03 00 00")
    wire.wait(120.0)
    assert not holds(wire) or wire.servo.temperature < 85
    assert 80 < wire.servo.temperature < 92  # it lets go and takes hold


def test_a_weak_supply_that_the_motor_pulls_down_does_not_make_it_rattle() -> None:
    wire = Wire(servo(1), servo(2), supply=Rail(7.4, 0.5))
    tell(wire, "FE 04 1F 01")
    tell(wire, "FE 07 01 E8 03 00 00")
    changes, before = 0, True
    for _ in range(500):
        wire.wait(0.002)
        changes += wire.servo.torque != before
        before = wire.servo.torque
    assert 1 <= changes <= 20  # tenths of a second apart


def test_a_stall_pulls_the_supply_of_a_neighbour_out_of_its_limits() -> None:
    wire = Wire(servo(1), servo(2), supply=Rail(7.4, 0.5))
    tell(wire, "01 07 16 94 11 E0 2E")  # id 1 works from 4.5 V, id 2 from 6.5 V
    tell(wire, "02 04 1F 01")
    wire.wait(1.0)
    neighbour = wire.line.servos[1]
    assert (neighbour.led, neighbour.torque) == ("on", True)
    block(wire)
    tell(wire, "01 04 1F 01")
    tell(wire, "01 07 01 E8 03 00 00")
    wire.wait(0.1)
    assert not neighbour.torque
    reply = ask(wire, "02 03 1B")
    millivolts = int.from_bytes(bytes.fromhex(reply)[3:], "little")
    assert millivolts == pytest.approx(1000 * (7.4 - 0.5 * 0.1) / (1 + 0.5 / 2.9), rel=0.005)
    seen = set()
    for _ in range(10):
        wire.wait(0.1)
        seen.add(neighbour.led)
    assert seen == {"on", "off"}
    block(wire, False)
    wire.wait(1.0)
    assert neighbour.torque


def test_a_resting_servo_costs_next_to_nothing() -> None:
    wire = loaded()
    wire.wait(1.0)
    started = process_time()
    wire.wait(1000.0)
    assert process_time() - started < 2.0  # 500,000 ticks


def test_every_behaviour_is_tested_once() -> None:
    functions = inspect.getmembers(sys.modules[__name__], inspect.isfunction)
    tested = [int(match[1]) for name, _ in functions if (match := re.match(r"test_L_(\d+)_", name))]
    assert sorted(tested) == list(range(1, 79))
