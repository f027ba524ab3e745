"""Behaviours H-1 to H-121 of HerkuleX: what the manual of the DRS-0602 says, in bytes, seconds and steps.

`ask` frames a request and unframes the ACK with arithmetic of its own, so that a test reads

    assert ask(wire, "FD 07") == "FD 47 00 00"      id 253, STAT -> id 253, its ACK, no error, no detail
"""

import re

import pytest

from conformance.wire import Reply, Wire
from servobus.core.units import deg
from servobus.errors import UsageError
from servobus.families.herkulex.places import EEP, RAM
from servobus.families.registry import DRS0602, MODELS
from servobus.virtual.device.servo import VirtualServo, virtual_servo
from servobus.virtual.physics.motor import Load

TICK = 0.0112
LOOP = TICK / 4
"""s; how finely motion is cut."""
REST = 1
"""Position units from the goal at which friction may hold the shaft: it holds against 8.8 pwm at 14.8 V (10.9 at 12 V),
and the factory's Kp gives 8.75 for one unit."""
SETTLED = 0.1
"""s after the end of a profile at which the shaft rests: eight time constants of the motor."""
STEP = 360 / 12962
"""degrees; one position unit (2-3)."""
CENTRE = 16384
TOP_SPEED = 60 / 0.164
"""degrees/s at 14.8 V (2-3)."""
SPEED_UNIT = 0.034
"""degrees/s; one unit of Desired Velocity (NO 60)."""

EEP_WRITE, EEP_READ, RAM_WRITE, RAM_READ = range(1, 5)
TURN_MODE, STOP, INVALID, NO_OVERRIDE = 0x02, 0x01, 0x20, 0x40
"""Bits of SET (6-6)."""
STATUS, TORQUE, LED, MODE, CALIBRATED, ABSOLUTE, DIFFERENTIAL, PWM = 48, 52, 53, 56, 58, 60, 62, 64
SECOND, GOAL, TRAJECTORY, VELOCITY = 66, 68, 70, 72
"""RAM addresses (4-2 NO 43 to 60)."""
MOVING, INPOSITION, TORQUE_ON = 0x01, 0x02, 0x40
"""Bits of Status Detail."""


def servo(id: int = 0xFD, *, position: float = 0.0, voltage: float = 14.8) -> VirtualServo:
    return virtual_servo(DRS0602, id, position=position * deg, voltage=voltage, reading="manual")


SUPPLY = {"drs0602": 14.8, "drs0101": 7.4, "drs0401": 14.8}
"""V; one model of each firmware. What the manuals of all have in common is tested with each."""


@pytest.fixture(params=SUPPLY)
def wire(request: pytest.FixtureRequest) -> Wire:
    return Wire(virtual_servo(MODELS[request.param], 0xFD, voltage=SUPPLY[request.param], reading="manual"))


the_drs0602 = pytest.mark.parametrize("wire", ["drs0602"], indirect=True)
"""For figures of the DRS-0602; those of the others are in tests/unit/families/herkulex/test_series.py."""


def framed(text: str) -> bytes:
    """Put id, command and data into a frame (4-1)."""
    body = bytes.fromhex(text)
    size = len(body) + 5
    xor = size
    for byte in body:
        xor ^= byte
    return b"\xff\xff" + bytes((size, *body[:2], xor & 0xFE, ~xor & 0xFE)) + body[2:]


def unframed(reply: Reply) -> str:
    """Take id, command and data out of an ACK; "" for silence."""
    raw = reply.bytes
    if not raw:
        return ""
    assert raw == framed((raw[3:5] + raw[7:]).hex())
    return (raw[3:5] + raw[7:]).hex(" ").upper()


def ask(wire: Wire, text: str, listen: float = 0.02) -> str:
    return unframed(wire.say(framed(text), listen=listen))


def tell(wire: Wire, text: str) -> float:
    """Send a request that is not answered; give the time of its last bit."""
    assert ask(wire, text, listen=0.0) == ""
    return wire.now


def write(wire: Wire, address: int, *data: int, id: int = 0xFD) -> float:
    return tell(wire, bytes((id, RAM_WRITE, address, len(data), *data)).hex())


def write_eep(wire: Wire, address: int, *data: int) -> float:
    return tell(wire, bytes((0xFD, EEP_WRITE, address, len(data), *data)).hex())


def read(wire: Wire, address: int, length: int = 1, *, id: int = 0xFD, eep: bool = False, signed: bool = False) -> int:
    """Read a number, low byte first, status aside."""
    command = EEP_READ if eep else RAM_READ
    reply = ask(wire, bytes((id, command, address, length)).hex(), listen=0.005 + length * 10 / wire.baud)
    raw = bytes.fromhex(reply)
    assert raw[:4] == bytes((id, command | 0x40, address, length))
    assert len(raw) == 6 + length
    return int.from_bytes(raw[4:-2], "little", signed=signed)


def read_at(wire: Wire, time: float, address: int, length: int = 2, *, signed: bool = True) -> int:
    """Read a number with a request whose last bit comes at that time."""
    wire.wait(time - wire.now - 9 * 10 / wire.baud)
    return read(wire, address, length, signed=signed)


def status(wire: Wire, id: int = 0xFD) -> tuple[int, int]:
    """Ask for Status Error and Status Detail."""
    raw = bytes.fromhex(ask(wire, f"{id:02X} 07", listen=0.005))
    assert raw[:2] == bytes((id, 0x47))
    return raw[2], raw[3]


def clear(wire: Wire) -> None:
    write(wire, STATUS, 0, 0)


def torque_on(wire: Wire, id: int = 0xFD) -> None:
    write(wire, TORQUE, 0x60, id=id)


def entry(value: int, flags: int = 0, id: int = 0xFD) -> str:
    """Four bytes of a JOG: LSB, MSB, SET, ID."""
    return bytes((value & 0xFF, value >> 8, flags, id)).hex()


def jog(wire: Wire, value: int, playtime: int = 0, flags: int = 0, *, id: int = 0xFD) -> float:
    """Move one servo; give the time at which it starts."""
    return tell(wire, f"{id:02X} 05 {entry(value, flags, id)} {playtime:02X}")


def driven(*, position: float = 0.0, voltage: float = 14.8) -> Wire:
    """Give a servo with its torque on, and all limits out of the way."""
    wire = Wire(servo(position=position, voltage=voltage))
    write(wire, 20, 0x00, 0x00, 0xFF, 0x7F)
    torque_on(wire)
    return wire


def held(**options: float) -> Wire:
    """Give the same with the shaft in a vice and without overload detection, so that PWM shows the law."""
    wire = driven(**options)
    write(wire, 42, 0)
    wire.servo.shaft.load = Load(blocked=1)
    return wire


def gains(wire: Wire, kp: int = 0, kd: int = 0, ki: int = 0, forward: int = 0, forward2: int = 0) -> None:
    """Set the gains of position control."""
    write(wire, 24, *b"".join(gain.to_bytes(2, "little") for gain in (kp, kd, ki, forward, forward2)))


def speed_gains(wire: Wire, kp: int, ki: int) -> None:
    write(wire, 34, *kp.to_bytes(2, "little"), *ki.to_bytes(2, "little"))


def output(wire: Wire) -> int:
    """Give the output of the next loop."""
    wire.wait(LOOP)
    return read(wire, PWM, 2, signed=True)


def output_at(wire: Wire, error: int) -> int:
    """Give the output of a held servo at an error in position units."""
    jog(wire, CENTRE + error)
    return output(wire)


def output_in_turn(wire: Wire, speed: int) -> int:
    """Give the output of a held servo that is to turn with a speed in its units."""
    jog(wire, speed if speed >= 0 else 0x4000 - speed, 0, TURN_MODE)
    return output(wire)


def shape(wire: Wire, ratio: int, longest: int) -> None:
    """Set Acceleration Ratio and Max. Acceleration Time."""
    write(wire, 8, ratio, longest)


def shaft(wire: Wire) -> float:
    """Where the shaft is now, in steps from the middle."""
    wire.observe()
    return wire.servo.position / deg / STEP


def speeds(wire: Wire, start: float, *times: float) -> list[float]:
    """Read Desired Velocity at times after a start, in degrees/s."""
    return [SPEED_UNIT * read_at(wire, start + time, VELOCITY) for time in times]


def lights(wire: Wire, seconds: float, grain: float = 0.01) -> list[str]:
    """Watchdog the light for a while; give what it shows one after the other."""
    seen = [wire.servo.led]
    for _ in range(round(seconds / grain)):
        wire.wait(grain)
        if wire.servo.led != seen[-1]:
            seen.append(wire.servo.led)
    return seen


# State at start


def test_H_1_eep_is_in_ram_after_every_start(wire: Wire) -> None:
    def both() -> list[int]:
        return [read(wire, 6, 48, eep=True), read(wire, 0, 48)]

    eep, ram = both()
    assert eep == ram
    write_eep(wire, 8, 0x2A, 0x14)
    write_eep(wire, 30, 0xC8, 0x00, 0xE8, 0x03)
    write(wire, 24, 0x11, 0x11)
    eep, ram = both()
    assert eep != ram
    tell(wire, "FD 09")
    wire.wait(0.5)
    eep, ram = both()
    assert eep == ram
    assert read(wire, 24, 4) == 0x03E800C8
    write(wire, 24, 0x11, 0x11)
    wire.power_cycle()
    assert both() == [eep, ram]


def test_H_2_off_dark_faultless_and_in_position_mode(wire: Wire) -> None:
    def reboot() -> None:
        tell(wire, "FD 09")
        wire.wait(0.5)

    for restart in (wire.power_cycle, reboot):
        write(wire, LED, 7)
        torque_on(wire)
        jog(wire, 100, 0, TURN_MODE | 0x08)
        tell(wire, "FD 0A")
        assert [read(wire, at) for at in (TORQUE, LED, STATUS, MODE)] == [0x60, 2, 8, 1]
        restart()
        assert [read(wire, at) for at in (TORQUE, LED, STATUS, MODE)] == [0, 0, 0, 0]


def test_H_3_the_light_blinks_once(wire: Wire) -> None:
    wire.power_cycle()
    blink, after = lights(wire, 3.0)
    assert blink != "off"
    assert after == "off"


@pytest.mark.parametrize(
    ("turned", "recognised"), [(0, 0), (90, 90), (-90, -90), (159, 159), (270, -90), (400, 40), (-730, -10)]
)
def test_H_4_turns_are_forgotten(turned: int, recognised: int) -> None:
    wire = Wire(servo(position=turned))
    assert read(wire, ABSOLUTE, 2) == pytest.approx(CENTRE + recognised / STEP, abs=0.6)
    more = -360 if recognised > 0 else 360
    wire.servo.turn_shaft((turned + more) * deg)
    assert read(wire, ABSOLUTE, 2) == pytest.approx(CENTRE + (recognised + more) / STEP, abs=0.6)
    wire.power_cycle()
    assert read(wire, ABSOLUTE, 2) == pytest.approx(CENTRE + recognised / STEP, abs=0.6)


def test_H_5_factory_settings() -> None:
    wire = Wire(virtual_servo(DRS0602, reading="manual"))
    assert wire.baud == pytest.approx(115200, rel=0.03)
    #                                                baud  - id policy LED torque
    assert ask(wire, "DB 02 04 06") == "DB 42 04 06 10 00 DB 01 5F 15 00 00"


def test_H_6_eight_data_bits_no_parity_one_stop_bit(wire: Wire) -> None:
    reply = wire.say(framed("FD 02 00 04"))
    assert len(reply.bytes) == 15
    # Start bit, eight bits and a stop bit make ten.
    assert reply.last - reply.first == pytest.approx(15 * 10 / wire.baud, abs=1e-6)


# Packets in


def test_H_7_the_frame(wire: Wire) -> None:
    assert wire.say("FF FF 07 FD 07 FC 02") == "FF FF 09 FD 47 B2 4C 00 00"


def test_H_8_both_checksums_must_match(wire: Wire) -> None:
    assert wire.say("FF FF 07 FD 07 FC 02") != ""
    for bit in range(8):
        for first, second in ((0xFC ^ 1 << bit, 0x02), (0xFC, 0x02 ^ 1 << bit)):
            assert wire.say(bytes((0xFF, 0xFF, 7, 0xFD, 7, first, second))) == ""


def test_H_9_bit_0_is_not_checked(wire: Wire) -> None:
    wire.say("FF FF 0A FD 03 C0 3E 35 01 01")
    assert read(wire, LED) == 1
    wire.say("FF FF 0A FD 03 C0 3E 35 01 00")
    assert read(wire, LED) == 0
    assert status(wire) == (0, 0)


def test_H_10_what_is_before_a_header_is_skipped(wire: Wire) -> None:
    pong = "FF FF 09 FD 47 B2 4C 00 00"
    assert wire.say("00 12 FF 00 FF FF 07 FD 07 FC 02") == pong
    assert wire.say("FF FF FF 07 FD 07 FC 02") == pong
    assert wire.say("FF FF FF FF FF FF 07 FD 07 FC 02") == pong


def test_H_11_sizes_that_are_none(wire: Wire) -> None:
    for size in (0x00, 0x06, 0xE0, 0xFE):
        junk = bytes((0xFF, 0xFF, size, 0xFD, 0x07, 0, 0))
        assert wire.say(junk) == ""
        assert wire.say(junk + bytes.fromhex("FF FF 07 FD 07 FC 02")) == "FF FF 09 FD 47 B2 4C 00 00"
    data = bytes(214)  # 223 bytes in all is a packet
    assert ask(wire, (bytes((0xFD, EEP_WRITE, 6, len(data))) + data).hex()) == ""
    assert status(wire) == (0x08, 0x10)


def test_H_12_only_who_is_called_acts() -> None:
    wire = Wire(servo(1), servo(2))
    write(wire, LED, 1, id=1)
    assert [read(wire, LED, id=id) for id in (1, 2)] == [1, 0]
    write(wire, LED, 4, id=254)
    assert [read(wire, LED, id=id) for id in (1, 2)] == [4, 4]
    write(wire, LED, 2, id=3)
    assert [read(wire, LED, id=id) for id in (1, 2)] == [4, 4]


def test_H_13_wrong_checksum(wire: Wire) -> None:
    ask(wire, "FD 03 01 01 02")
    assert wire.say("FF FF 0A FD 03 C0 3C 35 01 01") == ""
    assert wire.say("FF FF 07 FD 07 FC 00") == ""
    assert status(wire) == (0x08, 0x04)
    assert read(wire, LED) == 0


@pytest.mark.parametrize("command", [0x00, 0x0A, 0x0B, 0x0C, 0x41, 0x47, 0xFF])
def test_H_14_unknown_command(wire: Wire, command: int) -> None:
    ask(wire, "FD 03 01 01 02")
    assert ask(wire, f"FD {command:02X}") == ""
    assert status(wire) == (0x08, 0x08)


@pytest.mark.parametrize(
    ("request_", "accepted"),
    [
        ("FD 04 49 01", True), ("FD 02 35 01", True), ("FD 04 00 4A", True), ("FD 02 00 36", True),
        ("FD 04 4A 01", False), ("FD 04 49 02", False), ("FD 02 36 01", False), ("FD 02 35 02", False),
        ("FD 04 00 4B", False), ("FD 02 FF FF", False),
    ],
)  # fmt: skip
def test_H_15_reading_outside_the_map(wire: Wire, request_: str, accepted: bool) -> None:
    reply = bytes.fromhex(ask(wire, request_))
    if accepted:
        assert len(reply) == 6 + bytes.fromhex(request_)[3]
        assert status(wire)[0] == 0
    else:
        assert reply == bytes((0xFD, bytes.fromhex(request_)[1] | 0x40, 0x08, 0x10))


def test_H_15_writing_outside_the_map(wire: Wire) -> None:
    for map_, address, size in (("01", 52, 3), ("01", 54, 1), ("03", 52, 23), ("03", 74, 1), ("03", 200, 2)):
        clear(wire)
        ask(wire, f"FD {map_} {address:02X} {size:02X} {'01' * size}")
        assert status(wire) == (0x08, 0x10)
    assert read(wire, 52, 2, eep=True) == 0
    assert read(wire, TORQUE) == 0


@pytest.mark.parametrize(
    "request_",
    ["FD 03 35 02 01", "FD 03 35 01 01 01", "FD 03 35", "FD 04 35", "FD 02 00 01 00", "FD 07 00", "FD 09 00", "FD 05",
     "FD 05 00 40 00 FD", "FD 06 3C", "FD 06 3C 00 40 00", "FD 08 01"],
)  # fmt: skip
def test_H_16_data_of_the_wrong_length(wire: Wire, request_: str) -> None:
    ask(wire, "FD 03 01 01 02")
    assert ask(wire, request_) == ""
    assert status(wire) == (0x08, 0x00)
    assert read(wire, LED) == 0


def test_H_17_an_old_incomplete_packet_is_dropped(wire: Wire) -> None:
    wire.say("FF FF 07 FD", listen=0.2025)
    assert wire.say("07 FC 02") == ""
    assert status(wire) == (0x08, 0x20)
    clear(wire)
    write(wire, 40, 36)
    wire.say("FF FF 07 FD", listen=0.402)
    assert wire.say("07 FC 02") == "FF FF 09 FD 47 B2 4C 00 00"
    wire.say("FF", listen=0.404)
    assert status(wire) == (0x08, 0x20)


def test_H_18_a_shorter_pause_does_not_matter(wire: Wire) -> None:
    wire.say("FF", listen=0.201)
    wire.say("FF 07 FD 07 FC", listen=0.201)
    assert wire.say("02") == "FF FF 09 FD 47 B2 4C 00 00"


@the_drs0602
def test_H_19_errors_stay_until_they_are_cleared(wire: Wire) -> None:
    tell(wire, "FD 0A")
    wire.say("FF FF 07 FD 07 FC 00")
    wire.wait(60.0)
    assert status(wire) == (0x08, 0x0C)
    assert wire.say("FF FF 0B FD 03 C6 38 30 02 00 00") == ""
    assert status(wire) == (0, 0)
    wire.servo.voltage = 8.0
    wire.wait(0.6)
    wire.servo.voltage = 12.0
    wire.wait(10.0)
    assert status(wire) == (0x01, 0)
    wire.servo.voltage = 8.0
    wire.wait(0.6)
    clear(wire)
    wire.wait(LOOP)
    assert status(wire) == (0x01, 0)


def test_H_20_replies_of_others_are_no_requests() -> None:
    wire = Wire(servo(0xFD), servo(1))
    write(wire, TORQUE, 0x60, id=1)
    assert status(wire, 1) == (0, 0x42)
    assert status(wire) == (0, 0)
    # On one wire it would hear them; they are for no one's id but the sender's.
    wire = Wire(servo(0xFD))
    assert wire.say("FF FF 0C 01 44 7C 82 35 01 01 00 00") == ""
    assert status(wire) == (0, 0)


# Replies


REQUESTS = {
    "01 06 01 FD": 2, "02 06 01": 1, "03 35 01 01": 2, "04 35 01": 1, "05 00 00 00 FD 3C": 2, "06 3C 00 00 00 FD": 2,
    "07": 0, "08 01 01": 2, "09": 2,
}  # fmt: skip
"""Each request, and the lowest ACK Policy under which it is answered."""


def test_H_21_an_ack_is_the_command_and_40(wire: Wire) -> None:
    ask(wire, "FD 03 01 01 02")
    for request in REQUESTS:
        reply = bytes.fromhex(ask(wire, f"FD {request}"))
        assert reply[:2] == bytes((0xFD, bytes.fromhex(request)[0] + 0x40))


def test_H_22_the_status_ends_every_ack(wire: Wire) -> None:
    torque_on(wire)
    tell(wire, "FD 0A")
    assert ask(wire, "FD 07") == "FD 47 08 4A"
    assert ask(wire, "FD 04 35 01") == "FD 44 35 01 00 08 4A"
    assert ask(wire, "FD 03 01 01 02") == "FD 43 08 4A"


def test_H_23_acks_of_reads(wire: Wire) -> None:
    torque_on(wire)
    write(wire, LED, 1)
    # The manual's example (6-4).
    assert wire.say("FF FF 09 FD 04 C4 3A 35 01") == "FF FF 0C FD 44 C2 3C 35 01 01 00 42"
    assert wire.say("FF FF 09 FD 02 EC 12 1E 04").text.startswith("FF FF 0F FD 42")
    assert len(wire.say(framed("FD 04 00 4A")).bytes) == 11 + 74


def test_H_24_other_acks_are_the_status_alone(wire: Wire) -> None:
    assert ask(wire, "FD 03 01 01 02") == "FD 43 00 00"
    assert ask(wire, "FD 01 06 01 FD") == "FD 41 00 00"
    assert ask(wire, f"FD 05 {entry(CENTRE)} 3C") == "FD 45 00 00"
    assert ask(wire, f"FD 06 3C {entry(CENTRE)}") == "FD 46 00 00"
    assert wire.say("FF FF 09 FD 08 FC 02 01 01") == "FF FF 09 FD 48 BC 42 00 00"
    assert wire.say("FF FF 07 FD 09 F2 0C") == "FF FF 09 FD 49 BC 42 00 00"


def answered(wire: Wire, policy: int, id: str = "FD") -> set[str]:
    ask(wire, f"FD 03 01 01 {policy:02X}")
    return {request for request in REQUESTS if ask(wire, f"{id} {request}")}


def test_H_25_policy_0_answers_stat(wire: Wire) -> None:
    assert answered(wire, 0) == {"07"}


def test_H_26_policy_1_answers_reads(wire: Wire) -> None:
    assert answered(wire, 1) == {"02 06 01", "04 35 01", "07"}


def test_H_27_policy_2_answers_everything(wire: Wire) -> None:
    assert answered(wire, 2) == {*REQUESTS}


@pytest.mark.parametrize("policy", [0, 1, 2])
def test_H_28_to_all_only_stat_is_answered(wire: Wire, policy: int) -> None:
    assert answered(wire, policy, "FE") == {"07"}


def test_H_29_stat_to_all() -> None:
    assert Wire(servo(0xFD)).say("FF FF 07 FE 07 FE 00") == "FF FF 09 FD 47 B2 4C 00 00"
    one, two = (Wire(servo(id)).say("FF FF 07 FE 07 FE 00").bytes for id in (1, 2))
    together = Wire(servo(1), servo(2)).say("FF FF 07 FE 07 FE 00").bytes
    assert together == bytes(a & b for a, b in zip(one, two, strict=True))  # low bits win on the wire


def test_H_30_a_new_policy_holds_at_once(wire: Wire) -> None:
    assert ask(wire, "FD 03 01 01 02") == "FD 43 00 00"
    assert ask(wire, "FD 03 01 01 01") == ""


def test_H_31_the_stat_example(wire: Wire) -> None:
    jog(wire, 0, 0, TURN_MODE)  # not in position, as the goal is a speed
    torque_on(wire)
    assert wire.say("FF FF 07 FD 07 FC 02") == "FF FF 09 FD 47 F2 0C 00 40"


# Registers


def test_H_32_neighbours_in_one_write(wire: Wire) -> None:
    tell(wire, "FD 0A")
    assert wire.say("FF FF 0B FD 03 C6 38 30 02 00 00") == ""
    assert status(wire) == (0, 0)
    write(wire, 24, 1, 2, 3, 4, 5, 6)
    assert [read(wire, at, 2) for at in (24, 26, 28)] == [0x0201, 0x0403, 0x0605]


@the_drs0602
def test_H_33_ram_acts_at_once_and_is_lost(wire: Wire) -> None:
    assert wire.say("FF FF 0A FD 03 A0 5E 34 01 60") == ""
    assert status(wire) == (0, TORQUE_ON | INPOSITION)
    write(wire, 24, 0xC8, 0x00)
    tell(wire, "FD 09")
    wire.wait(0.5)
    assert status(wire) == (0, 0)
    assert read(wire, 24, 2) == 70


@the_drs0602
def test_H_34_eep_acts_after_a_restart(wire: Wire) -> None:
    assert wire.say("FF FF 0D FD 01 C8 36 1E 04 C8 00 E8 03") == ""
    assert wire.say("FF FF 09 FD 02 EC 12 1E 04").text.endswith("1E 04 C8 00 E8 03 00 00")
    assert ask(wire, "FD 04 18 04") == "FD 44 18 04 46 00 00 00 00 00"
    tell(wire, "FD 09")
    wire.wait(0.5)
    assert ask(wire, "FD 04 18 04") == "FD 44 18 04 C8 00 E8 03 00 00"


def test_H_35_low_byte_first(wire: Wire) -> None:
    write_eep(wire, 30, 0x34, 0x12)
    assert read(wire, 30, eep=True) == 0x34
    assert read(wire, 31, eep=True) == 0x12
    assert wire.servo.memory.eeprom[DRS0602.position_kp] == 0x1234


def test_H_36_a_new_id_in_ram_acts_at_once(wire: Wire) -> None:
    ask(wire, "FD 03 01 01 02")
    assert ask(wire, "FD 03 00 01 07") == "FD 43 00 00"
    assert ask(wire, "07 07") == "07 47 00 00"
    assert ask(wire, "FD 07") == ""
    wire.power_cycle()
    assert ask(wire, "FD 07") == "FD 47 00 00"


@the_drs0602
@pytest.mark.parametrize(
    ("code", "baud"),
    [
        (0x01, 1_000_000), (0x02, 666_666), (0x03, 500_000), (0x04, 400_000),
        (0x07, 250_000), (0x09, 200_000), (0x10, 117_647), (0x22, 57_143),
    ],
)  # fmt: skip
def test_H_37_eep_id_and_baud_wait_for_the_restart(wire: Wire, code: int, baud: float) -> None:
    write_eep(wire, 4, code)
    write_eep(wire, 6, 0x07)
    assert ask(wire, "FD 07") == "FD 47 00 00"
    tell(wire, "FD 09")
    wire.wait(0.5)
    reply = wire.say(framed("07 07"), baud=baud)
    assert reply == framed("07 47 00 00").hex(" ").upper()
    assert reply.last - reply.first == pytest.approx(90 / baud, rel=1e-5)


@pytest.mark.parametrize(
    "request_",
    [
        "01 00 01 07", "01 03 01 00", "01 03 02 00 10",
        "03 36 01 00", "03 39 01 00", "03 48 02 00 00", "03 35 02 07 00",
    ],
)  # fmt: skip
def test_H_38_read_only(wire: Wire, request_: str) -> None:
    before = wire.servo.memory.space(EEP), read(wire, MODE), read(wire, LED)
    ask(wire, "FD 03 01 01 02")
    assert ask(wire, f"FD {request_}").endswith("08 10")
    assert (wire.servo.memory.space(EEP), read(wire, MODE), read(wire, LED)) == before
    assert status(wire) == (0x08, 0x10)


@the_drs0602
def test_H_39_reserved_bytes_stay_0(wire: Wire) -> None:
    write(wire, 3, 0x11, 0xFF, 0x22)
    assert read(wire, 3, 3) == 0x220011
    write(wire, 45, 0xFF)
    write(wire, 51, 0xFF, 0x40)
    assert [read(wire, at) for at in (45, 51, 52)] == [0, 0, 0x40]
    write_eep(wire, 4, 0x01, 0xFF, 0x05)
    assert read(wire, 4, 3, eep=True) == 0x050001
    write_eep(wire, 10, 0xFF)
    write_eep(wire, 51, 0xFF)
    assert [read(wire, at, eep=True) for at in (10, 51)] == [0, 0]
    assert status(wire)[0] == 0


@the_drs0602
@pytest.mark.parametrize(
    "request_",
    [
        "03 00 01 FE", "03 01 01 03", "03 02 01 80", "03 05 01 6F", "03 06 01 5B", "03 07 01 C9", "03 08 01 33",
        "03 09 01 FF", "03 10 02 00 04", "03 14 02 00 80", "03 18 02 00 80", "03 30 01 80", "03 32 01 07",
        "03 35 01 08", "03 35 01 FF", "01 04 01 05", "01 06 01 FE", "01 1E 04 01 00 00 80", "03 2E 02 D8 05",
    ],
)  # fmt: skip
def test_H_40_values_out_of_range(wire: Wire, request_: str) -> None:
    before = wire.servo.memory.space(EEP), wire.servo.memory.space(RAM)
    tell(wire, f"FD {request_}")
    assert wire.servo.memory.space(EEP) == before[0]
    assert wire.servo.memory.space(RAM)[:48] == before[1][:48]
    assert wire.servo.memory.space(RAM)[50:54] == before[1][50:54]
    assert status(wire) == (0x08, 0x10)


def test_H_41_status_detail_is_cleared_in_part(wire: Wire) -> None:
    torque_on(wire)
    tell(wire, "FD 0A")
    wire.say("FF FF 07 FD 07 FC 00")
    assert status(wire) == (0x08, 0x4E)
    write(wire, 49, 0x08)
    assert status(wire) == (0x08, 0x4A)
    write(wire, 49, 0x00)
    assert status(wire) == (0x08, 0x42)
    write(wire, TORQUE, 0)
    write(wire, 49, 0x7F)
    assert status(wire) == (0x08, 0x3C)


def test_H_42_half_a_register_can_be_read(wire: Wire) -> None:
    write(wire, 24, 0x34, 0x12, 0x78, 0x56)
    assert read(wire, 25) == 0x12
    assert read(wire, 25, 2) == 0x7812
    assert read(wire, 26, 1) == 0x78


@the_drs0602
def test_H_43_model_and_version(wire: Wire) -> None:
    assert wire.say("FF FF 09 FD 02 F2 0C 00 04") == "FF FF 0F FD 42 20 DE 00 04 06 02 00 90 00 00"


def test_H_44_voltage_and_temperature() -> None:
    wire = Wire(virtual_servo(DRS0602, 0xFD, voltage=12.34, temperature=41.0, reading="manual"))
    assert [read(wire, 54), read(wire, 55)] == [123, 41]


def test_H_45_the_tick(wire: Wire) -> None:
    assert read_at(wire, 0.9 * TICK, 57, 1, signed=False) == 0
    assert read_at(wire, 9.9 * TICK, 57, 1, signed=False) == 9
    assert read_at(wire, 10.1 * TICK, 57, 1, signed=False) == 10
    assert read_at(wire, 255.9 * TICK, 57, 1, signed=False) == 255
    assert read_at(wire, 256.1 * TICK, 57, 1, signed=False) == 0
    assert read_at(wire, (1000 * 256 + 77.5) * TICK, 57, 1, signed=False) == 77


@pytest.mark.parametrize(
    ("written", "state"),
    [
        (0x60, 0x60), (0x7F, 0x60), (0xE1, 0x60), (0x40, 0x40), (0x5F, 0x40),
        (0x20, 0x00), (0x3F, 0x00), (0x9F, 0x00), (0x00, 0x00),
    ],
)  # fmt: skip
def test_H_46_two_bits_of_torque_control_count(wire: Wire, written: int, state: int) -> None:
    write(wire, TORQUE, written)
    assert read(wire, TORQUE) == state
    assert bool(status(wire)[1] & TORQUE_ON) == (state == 0x60)
    assert wire.servo.torque == (state != 0)


# Torque and lights


def test_H_47_torque_on(wire: Wire) -> None:
    assert status(wire) == (0, 0)
    assert wire.say("FF FF 0A FD 03 A0 5E 34 01 60", listen=0.0) == ""
    assert status(wire) == (0, TORQUE_ON | INPOSITION)
    write(wire, TORQUE, 0)
    assert status(wire) == (0, 0)


def test_H_48_brake(wire: Wire) -> None:
    write(wire, TORQUE, 0x40)
    assert status(wire) == (0, 0)
    with pytest.raises(UsageError):
        wire.servo.turn_shaft(1.0)
    jog(wire, 18000, 10)
    wire.wait(1.0)
    assert shaft(wire) == 0


@the_drs0602
def test_H_48_a_braked_shaft_resists(wire: Wire) -> None:
    def turned() -> list[float]:
        before = shaft(wire)
        wire.wait(1.0)
        middle = shaft(wire)
        wire.wait(1.0)
        return [middle - before, shaft(wire) - middle]

    wire.servo.shaft.load = Load(torque=1.0)
    write(wire, TORQUE, 0x40)
    first, second = turned()
    # The winding, closed, brakes like oil: with 1 N·m less 0.066 of friction at 1.30 N·m·s/rad (ACTUATORS of DRS-0602).
    assert second == pytest.approx(0.934 / 1.298 / deg / STEP, rel=0.02)
    assert first == pytest.approx(second, rel=0.05)
    write(wire, TORQUE, 0x00)
    first, second = turned()
    assert second > 2 * first > 100 * 360  # nothing but friction holds it back


@the_drs0602
def test_H_49_free(wire: Wire) -> None:
    wire.servo.turn_shaft(10 * deg)
    jog(wire, 18000, 10)
    wire.wait(1.0)
    assert wire.servo.position == 10 * deg
    assert read(wire, ABSOLUTE, 2) == 16744


def test_H_50_torque_on_resumes_the_mode(wire: Wire) -> None:
    jog(wire, 100, 0, TURN_MODE)
    torque_on(wire)
    assert read(wire, MODE) == 1
    assert not status(wire)[1] & INPOSITION
    write(wire, TORQUE, 0)
    jog(wire, CENTRE)
    torque_on(wire)
    assert read(wire, MODE) == 0
    assert status(wire)[1] & INPOSITION


def test_H_51_torque_on_holds_the_present_position() -> None:
    wire = driven()
    jog(wire, 18000, 10)
    wire.wait(1.0)
    write(wire, TORQUE, 0)
    wire.servo.turn_shaft(-30 * deg)
    torque_on(wire)
    wire.wait(1.0)
    assert wire.servo.position == -30 * deg
    assert read(wire, GOAL, 2) == read(wire, ABSOLUTE, 2) == 15304
    assert read(wire, PWM, 2) == 0
    torque_on(wire)  # on already: the goal stays
    jog(wire, 18000, 10)
    torque_on(wire)
    wire.wait(1.0)
    assert read(wire, GOAL, 2) == 18000
    assert read(wire, ABSOLUTE, 2) == pytest.approx(18000, abs=REST)


def test_H_52_an_error_of_the_policy_releases_torque() -> None:
    wire = driven()
    jog(wire, 20000, 100)
    wire.wait(0.3)
    write(wire, STATUS, 0x04)
    assert status(wire)[1] & TORQUE_ON == 0
    assert read(wire, TORQUE) == 0
    assert read(wire, PWM, 2) == 0
    where = shaft(wire)
    wire.wait(1.0)
    stopped = shaft(wire)
    assert where < stopped < 3000  # it runs out, and not to its goal
    wire.wait(5.0)
    assert shaft(wire) == stopped
    wire.servo.turn_shaft(0.0)


def test_H_53_torque_stays_off_while_it_holds(wire: Wire) -> None:
    write(wire, STATUS, 0x01)
    for state in (0x60, 0x40):
        write(wire, TORQUE, state)
        assert status(wire) == (0x01, 0)
        assert read(wire, TORQUE) == 0


def test_H_54_torque_waits_to_be_switched_on_again(wire: Wire) -> None:
    torque_on(wire)
    write(wire, STATUS, 0x01)
    clear(wire)
    wire.wait(1.0)
    assert status(wire) == (0, 0)
    torque_on(wire)
    assert status(wire) == (0, TORQUE_ON | INPOSITION)


@pytest.mark.parametrize(
    ("error", "released"), [(0x01, True), (0x02, False), (0x04, True), (0x08, False), (0x10, True), (0x40, False)]
)
def test_H_55_errors_of_the_default_policy(wire: Wire, error: int, released: bool) -> None:
    torque_on(wire)
    write(wire, STATUS, error)
    assert (read(wire, TORQUE) == 0) == released
    assert status(wire)[0] == error


def test_H_55_overload_as_it_happens() -> None:
    wire = driven()
    wire.servo.shaft.load = Load(blocked=1)
    jog(wire, CENTRE + 2000)
    wire.wait(1.0)
    assert status(wire) == (0x10, 0)
    assert read(wire, TORQUE) == 0


def test_H_56_the_red_light_blinks(wire: Wire) -> None:
    wire.wait(1.0)
    write(wire, LED, 1)
    tell(wire, "FD 0A")
    seen = lights(wire, 5.04)
    assert {*seen} == {"red", "off"}
    assert len(seen) - 1 == pytest.approx(2 * 5.04 / 0.504, abs=1)
    write(wire, LED, 2)
    assert {*lights(wire, 1.0)} == {"red", "off"}
    write(wire, 38, 90)
    assert len(lights(wire, 5.04)) - 1 == pytest.approx(5.04 / 0.504, abs=1)
    write(wire, 2, 0x57)
    assert lights(wire, 1.0) == ["blue"]


def test_H_57_then_it_shows_led_control_again(wire: Wire) -> None:
    tell(wire, "FD 0A")
    write(wire, LED, 2)
    wire.wait(1.0)
    clear(wire)
    assert lights(wire, 2.0) == ["blue"]


def test_H_58_colours(wire: Wire) -> None:
    wire.wait(1.0)
    shown = {
        0: "off", 1: "green", 2: "blue", 3: "green+blue",
        4: "red", 5: "green+red", 6: "blue+red", 7: "green+blue+red",
    }  # fmt: skip
    for bits, colour in shown.items():
        write(wire, LED, bits)
        assert wire.servo.led == colour


@the_drs0602
def test_H_59_no_driver_fault(wire: Wire) -> None:
    write(wire, STATUS, 0x7F)
    assert status(wire)[0] == 0x5F
    clear(wire)
    write(wire, 3, 0x20)
    write(wire, STATUS, 0x20)
    torque_on(wire)
    assert status(wire) == (0, 0x42)


# Protections and detection


@the_drs0602
@pytest.mark.parametrize("voltage", [9.4, 17.1, 5.0, 30.0])
def test_H_60_voltage(wire: Wire, voltage: float) -> None:
    torque_on(wire)
    for right in (9.5, 17.0):
        wire.servo.voltage = right
        wire.wait(2.0)
        assert status(wire)[0] == 0
    wire.servo.voltage = voltage
    wire.wait(0.495)
    assert status(wire) == (0, 0x42)
    wire.wait(0.010)
    assert status(wire) == (0x01, 0)


@the_drs0602
def test_H_61_temperature(wire: Wire) -> None:
    wire.servo.temperature = 80.0
    wire.wait(2.0)
    assert status(wire) == (0, 0)
    wire.servo.temperature = 81.0
    wire.wait(0.490)
    assert status(wire) == (0, 0)
    wire.wait(0.010)
    assert status(wire) == (0x04, 0)


@the_drs0602
def test_H_62_a_shorter_excursion(wire: Wire) -> None:
    for _ in range(10):
        wire.servo.voltage, wire.servo.temperature = 8.0, 100.0
        wire.wait(0.5)
        wire.servo.voltage, wire.servo.temperature = 12.0, 25.0
        wire.wait(0.01)
    assert status(wire) == (0, 0)
    write(wire, 39, 0)
    wire.servo.voltage = 8.0
    wire.wait(LOOP)
    assert status(wire) == (0x01, 0)


def stalled(wire: Wire, error: int, seconds: float) -> int:
    """Hold the shaft away from its goal for a while; give Status Error."""
    clear(wire)
    jog(wire, CENTRE + error)
    wire.wait(seconds)
    found = status(wire)[0]
    torque_on(wire)
    jog(wire, CENTRE)
    return found


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(("period", "seconds"), [(150, 0.6), (50, 0.2), (254, 1.016)])
def test_H_63_overload(period: int, seconds: float, direction: int) -> None:
    wire = held()
    write(wire, 42, period)
    start = jog(wire, CENTRE + 1000 * direction)
    wire.wait(start + seconds - 0.003 - wire.now)
    assert read(wire, PWM, 2, signed=True) == 1023 * direction
    wire.wait(start + seconds - 0.001 - wire.now)
    assert status(wire)[0] == 0
    wire.wait(start + seconds + 2 * LOOP - wire.now)
    error, detail = status(wire)
    assert (error, detail & TORQUE_ON) == (0x10, 0)


def test_H_63_only_above_the_threshold_and_without_a_pause() -> None:
    wire = held()
    gains(wire, kp=8)  # 1 pwm for each unit
    write(wire, 42, 150)
    assert stalled(wire, 1022, 2.0) == 0
    assert stalled(wire, 1023, 2.0) == 0x10
    write(wire, 18, 0xF4, 0x01)
    assert stalled(wire, 500, 2.0) == 0
    assert stalled(wire, -501, 2.0) == 0x10
    clear(wire)
    torque_on(wire)
    for _ in range(5):
        jog(wire, CENTRE + 600)
        wire.wait(0.5)
        jog(wire, CENTRE)
        wire.wait(0.01)
    assert status(wire)[0] == 0


def test_H_64_no_overload_without_a_period() -> None:
    wire = held()
    assert read(wire, 42) == 0
    assert stalled(wire, 1000, 5.0) == 0


def test_H_65_no_overload_at_threshold_1023() -> None:
    wire = held()
    write(wire, 42, 150)
    write(wire, 18, 0xFF, 0x03)
    assert stalled(wire, 1000, 5.0) == 0
    write(wire, 18, 0xFE, 0x03)
    assert stalled(wire, 1000, 5.0) == 0x10


@the_drs0602
def test_H_66_position_limits(wire: Wire) -> None:
    torque_on(wire)
    # I_JOG Example 1 (6-5): 512, far below the lowest position.
    assert wire.say("FF FF 0C FD 05 32 CC 00 02 04 FD 3C", listen=0.0) == ""
    assert status(wire) == (0x02, MOVING | TORQUE_ON)
    assert read(wire, GOAL, 2) == 10627
    wire.wait(1.0)
    assert read(wire, ABSOLUTE, 2) == pytest.approx(10627, abs=REST)
    clear(wire)
    jog(wire, 22130, 160)
    assert status(wire)[0] == 0x02
    assert read(wire, GOAL, 2) == 22129
    wire.wait(2.0)
    assert read(wire, ABSOLUTE, 2) == pytest.approx(22129, abs=REST)
    clear(wire)
    for value in (22129, 10627):
        jog(wire, value, 160)
        wire.wait(3.0)
        assert status(wire) == (0, TORQUE_ON | INPOSITION)
    write(wire, 3, 0x17)
    jog(wire, 0, 60)
    assert status(wire) == (0x02, 0)


@pytest.mark.parametrize(("period", "seconds"), [(27, 0.302), (54, 0.605)])
def test_H_67_standing_for_long_enough_is_a_stop(period: int, seconds: float) -> None:
    wire = driven()
    write(wire, 41, period)
    start = jog(wire, 17000, 60)
    seen = []
    while status(wire)[1] & MOVING:
        seen.append((wire.now, read(wire, ABSOLUTE, 2)))
        assert wire.now < start + 2
    stopped = wire.now
    # Not a change of six units since the last one that was; reading took up to 10 ms.
    assert max(abs(at - seen[-1][1]) for then, at in seen if then > stopped - seconds + 0.01) < 6
    assert max(abs(at - seen[-1][1]) for then, at in seen if then > stopped - seconds - 0.05) >= 6
    assert stopped == pytest.approx(start + 0.672 + seconds, abs=0.05)
    wire.wait(1.0)
    assert status(wire)[1] & MOVING == 0


def test_H_67_what_counts_as_motion() -> None:
    wire = driven()
    jog(wire, 17000, 60)
    wire.wait(2.0)
    # By hand: five steps are no motion, six are.
    write(wire, TORQUE, 0)
    wire.wait(1.0)
    wire.servo.turn_shaft(wire.servo.position + 5 * STEP * deg)
    wire.wait(0.01)
    assert status(wire) == (0, 0)
    wire.servo.turn_shaft(wire.servo.position + 1 * STEP * deg)
    wire.wait(0.01)
    assert status(wire) == (0, MOVING)
    wire.wait(1.0)
    assert status(wire) == (0, 0)


def test_H_68_inposition() -> None:
    wire = driven()
    jog(wire, 17384, 100)
    seen = set()
    for _ in range(300):
        detail = status(wire)[1]
        seen.add((abs(17384 - read(wire, ABSOLUTE, 2)) < 6, bool(detail & INPOSITION)))
    assert {(False, False), (True, True)} <= seen
    write(wire, 44, 0)
    assert not status(wire)[1] & INPOSITION


def test_H_69_the_moving_flag() -> None:
    wire = driven()
    assert not status(wire)[1] & MOVING
    start = jog(wire, 17000, 254)
    while wire.now < start + 2.8:
        assert status(wire)[1] & MOVING
    wire.wait(1.0)
    assert not status(wire)[1] & MOVING
    jog(wire, 17000, 254)  # there already
    wire.wait(0.5)
    assert not status(wire)[1] & MOVING


# JOG


def test_H_70_i_jog_of_43_servos() -> None:
    wire = Wire(*(servo(id) for id in range(43)))
    write(wire, TORQUE, 0x60, id=254)
    entries = "".join(f"{entry(CENTRE + 10 * id, 0, id)} {10 + id:02X}" for id in range(43))
    packet = framed(f"FE 05 {entries}")
    assert len(packet) == 222
    wire.say(packet)
    wire.wait(1.0)
    assert [read(wire, GOAL, 2, id=id) for id in range(43)] == [CENTRE + 10 * id for id in range(43)]
    there = [read(wire, ABSOLUTE, 2, id=id) for id in range(43)]
    assert there == pytest.approx([CENTRE + 10 * id for id in range(43)], abs=REST)


def test_H_71_s_jog_of_53_servos() -> None:
    wire = Wire(*(servo(id) for id in range(53)))
    write(wire, TORQUE, 0x60, id=254)
    packet = framed(f"FE 06 3C {''.join(entry(CENTRE + 10 * id, 0, id) for id in range(53))}")
    assert len(packet) == 220
    wire.say(packet)
    wire.wait(1.0)
    assert [read(wire, GOAL, 2, id=id) for id in range(53)] == [CENTRE + 10 * id for id in range(53)]
    there = [read(wire, ABSOLUTE, 2, id=id) for id in range(53)]
    assert there == pytest.approx([CENTRE + 10 * id for id in range(53)], abs=REST)


def test_H_72_only_the_own_entry_counts() -> None:
    wire = driven()
    tell(wire, f"FD 05 {entry(17000, 0, 1)} 0A {entry(18000, 0, 0xFD)} 0A {entry(19000, 0, 2)} 0A")
    assert read(wire, GOAL, 2) == 18000
    tell(wire, f"FD 06 0A {entry(17000, 0, 1)}")
    assert read(wire, GOAL, 2) == 18000


def test_H_73_an_entry_for_all() -> None:
    wire = Wire(servo(1), servo(2))
    write(wire, TORQUE, 0x60, id=254)
    tell(wire, f"FE 06 0A {entry(17000, 0, 0xFE)}")
    assert [read(wire, GOAL, 2, id=id) for id in (1, 2)] == [17000, 17000]


def test_H_74_the_later_entry_wins() -> None:
    wire = driven()
    tell(wire, f"FD 06 00 {entry(17000, 0x04)} {entry(18000, 0x08)}")
    wire.wait(1.0)
    assert [read(wire, GOAL, 2), read(wire, LED)] == [18000, 2]
    assert read(wire, ABSOLUTE, 2) == pytest.approx(18000, abs=REST)


def test_H_75_the_id_in_the_header_counts_first() -> None:
    wire = driven()
    tell(wire, f"07 05 {entry(18000)} 0A")
    assert read(wire, GOAL, 2) == CENTRE
    assert status(wire) == (0, TORQUE_ON | INPOSITION)


def test_H_76_goals_are_calibrated() -> None:
    wire = driven()
    write(wire, 46, 0x64, 0x00)
    jog(wire, 17000, 10)
    wire.wait(1.0)
    assert read(wire, GOAL, 2) == 17100
    assert [read(wire, at, 2) for at in (ABSOLUTE, CALIBRATED)] == pytest.approx([17100, 17000], abs=REST)
    write(wire, 46, 0x9C, 0xFF)
    jog(wire, 17000, 10)
    wire.wait(1.0)
    assert read(wire, GOAL, 2) == 16900
    assert [read(wire, at, 2) for at in (ABSOLUTE, CALIBRATED)] == pytest.approx([16900, 17000], abs=REST)


@pytest.mark.parametrize(("value", "speed"), [(0x0140, 198.4), (0x4140, -198.4), (0x0001, 0.62), (0x4000, 0.0)])
def test_H_77_speed_in_infinite_turn(value: int, speed: float) -> None:
    wire = driven()
    jog(wire, value, 60, TURN_MODE)
    wire.wait(1.0)
    before = shaft(wire)
    wire.wait(900 * TICK)
    assert (shaft(wire) - before) * STEP / (900 * TICK) == pytest.approx(speed, abs=0.01)
    assert read(wire, DIFFERENTIAL, 2, signed=True) == pytest.approx(round(speed / 0.62), abs=2)
    assert read(wire, VELOCITY, 2, signed=True) == round(speed / 0.034)


def test_H_78_reserved_bits_are_not_looked_at() -> None:
    wire = driven()
    jog(wire, 18000 | 0x8000, 10, 0x80)
    assert read(wire, GOAL, 2) == 18000
    jog(wire, 0x8140, 60, TURN_MODE | 0x80)
    wire.wait(1.0)
    assert read(wire, VELOCITY, 2, signed=True) == round(198.4 / 0.034)
    assert read(wire, DIFFERENTIAL, 2, signed=True) == pytest.approx(320, abs=2)
    assert status(wire)[0] == 0


def test_H_79_the_mode_bit() -> None:
    wire = driven()
    jog(wire, 0, 0, TURN_MODE)
    assert read(wire, MODE) == 1
    jog(wire, CENTRE)
    assert read(wire, MODE) == 0


@the_drs0602
@pytest.mark.parametrize("state", [0x00, 0x40])
def test_H_80_without_torque_only_the_mode_changes(wire: Wire, state: int) -> None:
    write(wire, TORQUE, state)
    jog(wire, 100, 60, TURN_MODE)
    assert read(wire, MODE) == 1
    wire.wait(1.0)
    assert shaft(wire) == 0
    jog(wire, 0, 60)
    assert read(wire, MODE) == 0
    assert status(wire) == (0, 0)
    assert read(wire, GOAL, 2) == CENTRE
    torque_on(wire)
    wire.wait(1.0)
    assert shaft(wire) == 0


def test_H_81_a_jog_sets_the_lights(wire: Wire) -> None:
    wire.wait(1.0)
    for flags, bits, colour in ((0x04, 1, "green"), (0x08, 2, "blue"), (0x10, 4, "red"), (0x18, 6, "blue+red")):
        jog(wire, CENTRE, 10, flags)
        assert read(wire, LED) == bits
        assert wire.servo.led == colour
    jog(wire, CENTRE, 10)
    assert wire.servo.led == "off"


def test_H_82_stop() -> None:
    wire = driven()
    jog(wire, 22000, 200)
    wire.wait(1.0)
    jog(wire, 22000, 200, STOP)
    where = shaft(wire)
    assert read(wire, GOAL, 2) == pytest.approx(CENTRE + where, abs=80 / STEP * LOOP)  # it has 73 degrees/s
    wire.wait(1.0)
    assert shaft(wire) == pytest.approx(read(wire, GOAL, 2) - CENTRE, abs=REST + 0.5)
    assert shaft(wire) == pytest.approx(where, abs=80 / STEP * LOOP)
    assert status(wire) == (0, TORQUE_ON | INPOSITION)
    jog(wire, 300, 60, TURN_MODE)
    wire.wait(1.0)
    jog(wire, 300, 60, TURN_MODE | STOP)
    assert read(wire, VELOCITY, 2) == 0
    wire.wait(0.3)  # the speed controller sees speed over 44.8 ms
    assert abs(read(wire, DIFFERENTIAL, 2, signed=True)) <= 5
    wire.wait(1.0)
    where = shaft(wire)
    wire.wait(1.0)
    assert shaft(wire) == where
    assert read(wire, MODE) == 1


def test_H_83_invalid() -> None:
    wire = driven()
    write(wire, LED, 1)
    jog(wire, 100, 60, INVALID | TURN_MODE | 0x08)
    wire.wait(1.0)
    assert [read(wire, at) for at in (MODE, LED)] == [0, 1]
    assert shaft(wire) == 0
    jog(wire, 18000, 100)
    wire.wait(0.3)
    jog(wire, 18000, 100, INVALID | STOP)
    wire.wait(1.0)
    assert read(wire, ABSOLUTE, 2) == pytest.approx(18000, abs=REST)


@pytest.mark.parametrize(("playtime", "duration"), [(60, 0.672), (254, 2.8448), (10, 0.112)])
def test_H_84_playtime(playtime: int, duration: float) -> None:
    wire = driven()
    start = jog(wire, 17000, playtime)
    assert read_at(wire, start + duration - 0.006, VELOCITY) > 0
    assert read_at(wire, start + duration + LOOP, VELOCITY) == 0
    assert read(wire, TRAJECTORY, 2) == 17000
    wire.wait(SETTLED)
    assert shaft(wire) == pytest.approx(616, abs=REST + 0.5)


def test_H_85_playtime_0_is_as_fast_as_it_goes() -> None:
    wire = driven()
    start = jog(wire, CENTRE + 5000, 0)
    assert read(wire, TRAJECTORY, 2) == CENTRE + 5000
    assert status(wire) == (0, MOVING | TORQUE_ON)
    assert read_at(wire, start + 0.2, PWM) == 1023
    assert read(wire, DIFFERENTIAL, 2) == pytest.approx(TOP_SPEED / 0.62, rel=0.01)
    soonest = start + 5000 * STEP / TOP_SPEED
    wire.wait(soonest - wire.now)
    assert 4500 < shaft(wire) < 5000
    wire.wait(0.05 + SETTLED)  # speeding up, it lost a little
    assert shaft(wire) == pytest.approx(5000, abs=REST + 0.5)


def test_H_86_too_short_a_playtime() -> None:
    wire = driven()
    start = jog(wire, CENTRE + 5000, 20)  # 0.224 s, for which 366 degrees/s are not enough
    assert read_at(wire, start + 0.23, TRAJECTORY) == CENTRE + 5000
    assert read_at(wire, start + 0.24, DIFFERENTIAL) == pytest.approx(TOP_SPEED / 0.62, rel=0.01)
    wire.wait(start + 5000 * STEP / TOP_SPEED - wire.now)
    assert 4000 < shaft(wire) < 5000
    wire.wait(0.05 + SETTLED)
    assert shaft(wire) == pytest.approx(5000, abs=REST + 0.5)
    slow = driven(voltage=11.1)
    jog(slow, CENTRE + 5000, 0)
    assert read_at(slow, slow.now + 0.2, DIFFERENTIAL) == pytest.approx(0.75 * TOP_SPEED / 0.62, rel=0.01)


def test_H_87_s_jog_arrives_together() -> None:
    def velocities(command: str, *times: float) -> list[list[bool]]:
        """Tell for each servo whether its trajectory still moves."""
        seen = []
        for id in (1, 2):  # one at a time, so that both are asked at the same time
            wire = Wire(servo(1), servo(2))
            write(wire, TORQUE, 0x60, id=254)
            start = tell(wire, command)
            moving = []
            for time in times:
                wire.wait(start + time - wire.now - 9 * 10 / wire.baud)
                moving.append(read(wire, VELOCITY, 2, id=id, signed=True) != 0)
            wire.wait(SETTLED)
            assert read(wire, ABSOLUTE, 2, id=id) == pytest.approx((17000, 12000)[id - 1], abs=REST)
            seen.append(moving)
        return seen

    together = velocities(f"FE 06 3C {entry(17000, 0, 1)} {entry(12000, 0, 2)}", 0.3, 0.672 - 0.006, 0.672 + LOOP)
    assert together == [[True, True, False], [True, True, False]]
    apart = velocities(f"FE 05 {entry(17000, 0, 1)} 3C {entry(12000, 0, 2)} 50", 0.3, 0.68, 0.9)
    assert apart == [[True, False, False], [True, True, False]]


def test_H_88_speed_that_is_not_reached_delays_the_next_one() -> None:
    def delay(speed: int) -> float:
        wire = driven()
        write(wire, 42, 0)
        jog(wire, speed, 0, TURN_MODE)
        wire.wait(2.0)
        start = jog(wire, 200, 0, TURN_MODE)
        while read(wire, DIFFERENTIAL, 2) > 220:
            assert wire.now < start + 10
        return wire.now - start

    assert pytest.approx(590, abs=1) == TOP_SPEED / 0.62
    assert delay(580) < 0.1
    assert 0.5 < delay(700) < delay(900)


def test_H_89_who_answers_a_jog() -> None:
    wire = Wire(servo(1), servo(2))
    body = f"{entry(CENTRE, 0, 1)} 3C {entry(CENTRE, 0, 2)} 3C"
    assert ask(wire, f"01 05 {body}") == ""
    for id in (1, 2):
        ask(wire, f"{id:02X} 03 01 01 02")
    assert ask(wire, f"FE 05 {body}") == ""
    assert ask(wire, f"01 05 {body}") == "01 45 00 00"
    assert ask(wire, f"02 06 3C {entry(CENTRE, 0, 1)} {entry(CENTRE, 0, 2)} {entry(CENTRE, 0, 2)}") == "02 46 00 00"


# Speed profile


def test_H_90_acceleration_and_deceleration_time() -> None:
    wire = driven()
    shape(wire, 20, 254)
    start = jog(wire, CENTRE + 5000, 100)  # 1.12 s, of which 0.224 s to speed up
    top = 5000 * STEP / (1.12 - 0.224)
    seen = speeds(wire, start, 0.112, 0.224, 0.5, 0.896, 1.008)
    assert seen == pytest.approx([top / 2, top, top, top, top / 2], rel=0.01)


def test_H_91_longest_acceleration_time() -> None:
    wire = driven()
    start = jog(wire, CENTRE + 5000, 254)  # a quarter of 2.8448 s would be 0.711 s
    top = 5000 * STEP / (2.8448 - 0.504)
    seen = speeds(wire, start, 0.252, 0.505, 1.5, 2.33, 2.8448 - 0.252)
    assert seen == pytest.approx([top / 2, top, top, top, top / 2], rel=0.01)
    wire.wait(1.0)
    shape(wire, 25, 10)
    start = jog(wire, CENTRE, 254)
    top = -5000 * STEP / (2.8448 - 0.112)
    assert speeds(wire, start, 0.056, 0.113) == pytest.approx([top / 2, top], rel=0.02)


@pytest.mark.parametrize(("ratio", "longest"), [(0, 45), (25, 0)])
def test_H_92_rectangle(ratio: int, longest: int) -> None:
    wire = driven()
    shape(wire, ratio, longest)
    start = jog(wire, CENTRE + 5000, 100)
    assert speeds(wire, start, 0.002, 0.5, 1.118, 1.13) == pytest.approx([*3 * [5000 * STEP / 1.12], 0], rel=0.001)


def test_H_93_triangle_and_trapezoid() -> None:
    wire = driven()
    shape(wire, 50, 254)
    start = jog(wire, CENTRE + 5000, 100)
    top = 2 * 5000 * STEP / 1.12
    seen = speeds(wire, start, 0.14, 0.28, 0.42, 0.56, 0.7, 0.84, 0.98)
    assert seen == pytest.approx([top * share for share in (0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25)], rel=0.01)
    wire.wait(1.0)
    shape(wire, 49, 254)
    start = jog(wire, CENTRE, 100)
    flat = speeds(wire, start, 0.55, 0.57)
    assert flat[0] == flat[1] == pytest.approx(-5000 * STEP / (0.51 * 1.12), rel=0.001)


def test_H_94_trajectory_and_goal() -> None:
    wire = driven()
    shape(wire, 0, 0)
    start = jog(wire, CENTRE + 5600, 100)
    for time in (0.01, 0.28, 0.56, 0.84, 1.1):
        expected = CENTRE + 5000 * time
        assert read_at(wire, start + time, TRAJECTORY) == pytest.approx(expected, abs=5000 * LOOP + 1)
        assert read(wire, GOAL, 2) == CENTRE + 5600
    assert read_at(wire, start + 1.13, TRAJECTORY) == CENTRE + 5600


def test_H_95_desired_velocity() -> None:
    wire = driven()
    shape(wire, 0, 0)
    assert read(wire, VELOCITY, 2) == 0
    start = jog(wire, CENTRE + 1224, 100)  # 34 degrees in 1.12 s
    assert read_at(wire, start + 0.5, VELOCITY) == pytest.approx(1000 / 1.12, abs=1)
    assert read_at(wire, start + 1.13, VELOCITY) == 0
    start = jog(wire, CENTRE, 100)
    assert read_at(wire, start + 0.5, VELOCITY) == pytest.approx(-1000 / 1.12, abs=1)


def test_H_96_after_the_end_a_jog_starts_anew() -> None:
    wire = driven()
    start = jog(wire, CENTRE + 3000, 100)
    first = speeds(wire, start, 0.05, 0.28, 0.6)
    wire.wait(start + 2.0 - wire.now)
    start = jog(wire, CENTRE + 6000, 100)
    one_loop = 3000 * STEP / (1.12 - 0.28) / 0.28 * LOOP
    assert speeds(wire, start, 0.05, 0.28, 0.6) == pytest.approx(first, abs=one_loop + SPEED_UNIT)


def test_H_97_velocity_override() -> None:
    wire = driven()
    start = jog(wire, CENTRE + 3000, 100)
    cruise = 3000 * STEP / (1.12 - 0.28)
    assert speeds(wire, start, 0.49) == pytest.approx([cruise], rel=0.001)
    wire.wait(start + 0.5 - wire.now)
    again = jog(wire, CENTRE + 6000, 100)
    where = read_at(wire, again + 0.002, TRAJECTORY)
    assert where == pytest.approx(CENTRE + cruise / STEP * (again - start - 0.14), abs=2 * cruise / STEP * LOOP + 8)
    at_once = speeds(wire, again, 0.004)
    assert at_once == pytest.approx([cruise], rel=0.05)
    assert read_at(wire, again + 1.125, TRAJECTORY) == CENTRE + 6000


def test_H_98_without_override_speed_breaks() -> None:
    wire = driven()
    start = jog(wire, CENTRE + 3000, 100)
    wire.wait(start + 0.5 - wire.now)
    again = jog(wire, CENTRE + 6000, 100, NO_OVERRIDE)
    assert speeds(wire, again, 0.002)[0] < 2
    assert read_at(wire, again + 1.125, TRAJECTORY) == CENTRE + 6000


# Positions


@the_drs0602
def test_H_99_calibrated_position(wire: Wire) -> None:
    wire.servo.turn_shaft(20 * deg)
    absolute = read(wire, ABSOLUTE, 2)
    for difference in (0, 1, -1, 255, -1495, 1495):
        write(wire, 46, *difference.to_bytes(2, "little", signed=True))
        assert read(wire, CALIBRATED, 2) == absolute - difference
        assert read(wire, ABSOLUTE, 2) == absolute


@the_drs0602
def test_H_100_calibration_of_the_middle(wire: Wire) -> None:
    wire.servo.turn_shaft(-25 * deg)
    difference = read(wire, ABSOLUTE, 2) - 16384
    write(wire, 46, *difference.to_bytes(2, "little", signed=True))
    assert read(wire, CALIBRATED, 2) == 16384


@the_drs0602
def test_H_101_calibration_difference_is_signed(wire: Wire) -> None:
    for written, difference in (((0xD7, 0x05), 1495), ((0x29, 0xFA), -1495), ((0xFF, 0xFF), -1)):
        write(wire, 46, *written)
        assert read(wire, 46, 2, signed=True) == difference
        assert read(wire, CALIBRATED, 2) == CENTRE - difference
    for written in ((0xD8, 0x05), (0x28, 0xFA), (0xFF, 0x7F)):
        clear(wire)
        write(wire, 46, *written)
        assert status(wire) == (0x08, 0x10)
        assert read(wire, 46, 2, signed=True) == -1


@the_drs0602
@pytest.mark.parametrize(("choice", "position"), [(2, 0), (3, 9903), (4, 16384), (5, 22865), (6, 32767)])
def test_H_102_absolute_position_set_anew(wire: Wire, choice: int, position: int) -> None:
    wire.servo.turn_shaft(33 * deg)
    write(wire, 50, choice)
    assert read(wire, ABSOLUTE, 2) == position
    wire.servo.turn_shaft(wire.servo.position + (-90 if choice == 6 else 90) * deg)
    assert read(wire, ABSOLUTE, 2) == pytest.approx(position + (-3240.5 if choice == 6 else 3240.5), abs=0.6)


@the_drs0602
def test_H_103_absolute_position_from_the_potentiometer(wire: Wire) -> None:
    wire.servo.turn_shaft(33 * deg)
    before = read(wire, ABSOLUTE, 2)
    write(wire, 50, 5)
    assert read(wire, ABSOLUTE, 2) == 22865
    write(wire, 50, 1)
    assert read(wire, ABSOLUTE, 2) == before
    assert read(wire, SECOND, 2) == pytest.approx(1024 + (before - CENTRE) * STEP / 0.163, abs=1)


def test_H_104_aux_1_reads_0_and_nothing_jumps() -> None:
    wire = driven()
    jog(wire, 17000, 10)
    wire.wait(1.0)
    where, off = shaft(wire), read(wire, GOAL, 2) - read(wire, ABSOLUTE, 2)
    write(wire, 50, 3)
    assert read(wire, 50) == 0
    assert [read(wire, at, 2) for at in (ABSOLUTE, GOAL)] == [9903, 9903 + off]
    wire.wait(1.0)
    assert shaft(wire) == where
    jog(wire, 10903, 10)
    wire.wait(1.0)
    assert shaft(wire) == pytest.approx(where + 1000, abs=REST + 0.5)
    # In the middle of a motion the rest of the way stays the same.
    jog(wire, 11903, 100)
    wire.wait(0.5)
    write(wire, 50, 2)
    wire.wait(1.0)
    there = shaft(wire)
    assert there == pytest.approx(where + 2000, abs=REST + 0.5)
    # At the very end the servo must not take the long way round.
    write(wire, 50, 2)
    jog(wire, 5, 10)
    wire.wait(1.0)
    assert shaft(wire) == pytest.approx(there + 5, abs=REST + 0.5)


@pytest.mark.parametrize("angle", [0, 90, -90, 159.9, -159.9])
def test_H_105_the_middle_is_0_degrees(angle: float) -> None:
    assert read(Wire(servo(position=angle)), CALIBRATED, 2) == pytest.approx(16384 + angle / 0.02778, abs=1.5)


@pytest.mark.parametrize("angle", [0, 90, -90, 150])
def test_H_106_the_second_position(angle: float) -> None:
    assert read(Wire(servo(position=angle)), SECOND, 2) == pytest.approx(1024 + angle / 0.163, abs=0.6)


def test_H_107_more_than_two_turns() -> None:
    wire = driven()
    for goal in (10, CENTRE, 32757):  # not all at once: full speed for 600 ms is an overload
        jog(wire, goal, 254)
        wire.wait(5.0)
        assert read(wire, ABSOLUTE, 2) == pytest.approx(goal, abs=REST)
        assert shaft(wire) == pytest.approx(goal - CENTRE, abs=REST + 0.5)
    assert status(wire) == (0, TORQUE_ON | INPOSITION)


# Control


def test_H_108_position_gains() -> None:
    wire = held()
    for kp, error, pwm in ((8, 20, 20), (70, 20, 175), (70, -20, -175), (70, 1, 8), (400, 10, 500)):
        gains(wire, kp=kp)
        assert output_at(wire, error) == pwm
    # Ki: assumption, the error counts once in 11.2 ms.
    gains(wire, ki=16384)
    jog(wire, CENTRE + 5)
    wire.wait(10 * TICK)
    first = read(wire, PWM, 2, signed=True)
    before = wire.now
    wire.wait(20 * TICK)
    assert read(wire, PWM, 2, signed=True) - first == pytest.approx(5 * (wire.now - before) / TICK, abs=5)
    # Kd: assumption, it acts on the change in 0.8 ms.
    gains(wire, kd=800)
    shape(wire, 0, 0)
    jog(wire, CENTRE)
    jog(wire, CENTRE + 5600, 100)
    wire.wait(0.5)
    assert read(wire, PWM, 2, signed=True) == 800 / 8 * 4  # 5000 units/s are 4 in 0.8 ms


def test_H_108_speed_gains() -> None:
    for kp, ki, speed, pwm in ((64, 0, 300, 300), (100, 0, -160, -250), (6400, 0, 5, 500)):
        wire = held()
        speed_gains(wire, kp, ki)
        assert output_in_turn(wire, speed) == pwm
    wire = held()
    speed_gains(wire, 0, 8192)
    jog(wire, 20, 0, TURN_MODE)
    wire.wait(TICK)
    first = read(wire, PWM, 2, signed=True)
    before = wire.now
    wire.wait(30 * TICK)
    assert read(wire, PWM, 2, signed=True) - first == pytest.approx(10 * (wire.now - before) / TICK, abs=5)


def lag(wire: Wire, time: float) -> int:
    """How far the shaft is behind the trajectory at a time into a move, in position units."""
    start = jog(wire, CENTRE + 5000, 100)
    wire.wait(start + time - wire.now)
    both = bytes.fromhex(ask(wire, "FD 04 3C 0C"))[4:-2]
    return int.from_bytes(both[10:12], "little") - int.from_bytes(both[0:2], "little")


def test_H_109_feedforward() -> None:
    plain, fast, both = driven(), driven(), driven()
    gains(fast, kp=70, forward=100)
    gains(both, kp=70, forward=100, forward2=100)
    # At steady speed what the first gain does not give, the error must: 165 degrees/s need 460 pwm.
    assert lag(plain, 0.5) == pytest.approx(460 / 8.75, rel=0.1)
    assert lag(fast, 0.5) < 0.2 * lag(driven(), 0.5)
    # While it speeds up, the second gain helps too.
    plain, fast, both = driven(), driven(), driven()
    gains(fast, kp=70, forward=100)
    gains(both, kp=70, forward=100, forward2=100)
    assert lag(plain, 0.2) > lag(fast, 0.2) > lag(both, 0.2)


def test_H_110_dead_zone() -> None:
    wire = held()
    write(wire, 10, 10)
    write(wire, 14, 50)  # not even an offset
    assert [output_at(wire, error) for error in (9, -9, 0)] == [0, 0, 0]
    assert [output_at(wire, error) for error in (10, -10)] == [87 + 50, -87 + 50]
    speed_gains(wire, 64, 0)
    assert output_in_turn(wire, 5) == 5


def test_H_110_the_shaft_stays_in_the_dead_zone() -> None:
    wire = driven()
    write(wire, 10, 100)
    jog(wire, CENTRE + 90)
    wire.wait(1.0)
    assert shaft(wire) == 0
    jog(wire, CENTRE + 1000)
    wire.wait(1.0)
    assert 900 <= shaft(wire) <= 1100
    assert read(wire, PWM, 2) == 0


def test_H_111_pwm_offset() -> None:
    wire = held()
    for offset in (50, 127, -128):
        write(wire, 14, offset & 0xFF)
        assert [output_at(wire, error) for error in (20, 0, -20)] == [175 + offset, offset, -175 + offset]
    speed_gains(wire, 64, 0)
    assert output_in_turn(wire, 100) == 100


def test_H_112_lowest_pwm() -> None:
    wire = held()
    write(wire, 15, 100)
    assert [output_at(wire, error) for error in (2, -2, 20, -20, 0)] == [100, -100, 175, -175, 0]
    write(wire, 10, 10)
    assert output_at(wire, 9) == 0
    assert output_at(wire, 100) == 875
    write(wire, TORQUE, 0)
    assert output(wire) == 0
    torque_on(wire)
    speed_gains(wire, 64, 0)
    assert [output_in_turn(wire, speed) for speed in (5, -5, 0)] == [100, -100, 0]


def test_H_113_highest_pwm() -> None:
    wire = held()
    assert [output_at(wire, error) for error in (5000, -5000)] == [1023, -1023]
    write(wire, 16, 0x2C, 0x01)
    assert [output_at(wire, error) for error in (5000, -5000, 20)] == [300, -300, 175]
    speed_gains(wire, 64, 0)
    assert output_in_turn(wire, 500) == 300
    write(wire, 16, 0, 0)
    assert output_in_turn(wire, 500) == 0


def test_H_114_saturator() -> None:
    wire = held()
    write(wire, 11, 10, 0x00, 0x02)  # 10 at the goal, and 2 for each unit
    assert [output_at(wire, error) for error in (20, -20, 100, 600)] == [50, -50, 210, 1023]
    write(wire, 11, 10, 0x80, 0x00)  # half a pwm for each unit
    assert [output_at(wire, error) for error in (20, 100)] == [20, 60]
    write(wire, 11, 10, 0x00, 0x00)
    assert output_at(wire, 20) == 175
    write(wire, 11, 10, 0x01, 0x00)
    speed_gains(wire, 64, 0)
    assert output_in_turn(wire, 500) == 500


def test_H_115_order_of_the_stages() -> None:
    wire = held()
    write(wire, 14, -5 & 0xFF, 20)
    assert output_at(wire, 1) == 20  # 8.75 - 5, and then at least 20
    write(wire, 11, 0, 0x00, 0x01)
    assert output_at(wire, 1) == 1  # which the saturator limits to 1 for each unit
    assert output_at(wire, 100) == 100
    write(wire, 16, 60, 0)
    assert output_at(wire, 100) == 60  # and Max. PWM in any case
    write(wire, 15, 200)
    write(wire, 11, 0, 0x00, 0x00)
    assert output_at(wire, 1) == 60
    write(wire, 10, 2)
    assert output_at(wire, 1) == 0


# ROLLBACK, REBOOT


@the_drs0602
def test_H_116_rollback_is_for_eep(wire: Wire) -> None:
    write_eep(wire, 30, 0xC8, 0x00)
    tell(wire, "FD 09")
    wire.wait(0.5)
    tell(wire, "FD 08 01 01")
    assert read(wire, 30, 2, eep=True) == 70
    assert read(wire, 24, 2) == 200
    tell(wire, "FD 09")
    wire.wait(0.5)
    assert read(wire, 24, 2) == 70


@the_drs0602
@pytest.mark.parametrize(
    ("skip", "kept"), [("00 00", ()), ("01 00", (6,)), ("10 00", (52,)), ("00 01", (4,)), ("11 01", (4, 6, 52))]
)
def test_H_117_skips(wire: Wire, skip: str, kept: tuple[int, ...]) -> None:
    own, factory = {4: 0x09, 6: 0x07, 52: 0x21, 30: 0xC8}, {4: 0x10, 6: 0xDB, 52: 0x00, 30: 0x46}
    for address, value in own.items():
        write_eep(wire, address, value)
    tell(wire, f"FD 08 {skip}")
    after = {address: read(wire, address, eep=True) for address in own}
    assert after == {address: (own if address in kept else factory)[address] for address in own}


def test_H_118_rollback_of_everything() -> None:
    first = servo(7)
    first.store_baud(1_000_000)
    wire = Wire(first)
    assert wire.baud == 1_000_000
    tell(wire, "07 08 00 00")
    tell(wire, "07 09")
    wire.wait(0.5)
    assert wire.say(framed("DB 07"), baud=115_200) == "FF FF 09 DB 47 94 6A 00 00"


def test_H_119_rollback_needs_its_data(wire: Wire) -> None:
    write_eep(wire, 30, 0xC8, 0x00)
    ask(wire, "FD 03 01 01 02")
    for request in ("FD 08", "FD 08 01", "FD 08 01 01 01"):
        assert ask(wire, "FD 03 30 02 00 00") == "FD 43 00 00"
        assert ask(wire, request) == ""
        assert status(wire) == (0x08, 0)
    assert read(wire, 30, 2, eep=True) == 200


def test_H_120_reboot() -> None:
    wire = driven()
    jog(wire, 20000, 100)
    wire.wait(0.3)
    ask(wire, "FD 03 01 01 02")
    assert read(wire, 24, 2) == 70
    assert wire.say("FF FF 07 FD 09 F2 0C", listen=0.05).text.startswith("FF FF 09 FD 49")
    where = shaft(wire)
    assert ask(wire, "FD 07") == ""  # starting
    wire.wait(0.5)
    assert status(wire) == (0, 0)
    assert [read(wire, at) for at in (1, TORQUE, LED, MODE)] == [1, 0, 0, 0]
    assert read(wire, 24, 2) == 70
    assert shaft(wire) == where


def test_H_121_reboot_of_all() -> None:
    wire = Wire(servo(1), servo(2))
    for id in (1, 2):
        ask(wire, f"{id:02X} 03 01 01 02")
        ask(wire, f"{id:02X} 03 34 01 60")
    assert wire.say("FF FF 07 FE 09 F0 0E", listen=0.5) == ""
    assert [status(wire, id) for id in (1, 2)] == [(0, 0), (0, 0)]


# The list


def test_every_behaviour_is_tested() -> None:
    found = [re.match(r"test_H_(\d+)_", name) for name in globals()]
    assert {int(match[1]) for match in found if match} == set(range(1, 122))
