"""HerkuleX: what no packet of the manual shows: limits, errors, replies and the shared verbs."""

from collections.abc import Sequence
from typing import Any

import pytest

from servobus.core.exchange import Exchange, Pause, Procedure
from servobus.core.framing import Corrupt, Decoder, Noise, Packet
from servobus.core.registers import Register
from servobus.core.replies import ReplyCollector
from servobus.core.units import deg
from servobus.errors import BadValue, NoReply, Refused, UsageError
from servobus.families.base import Answers, AxisMove, Identity, KnownServo, ServoRef
from servobus.families.herkulex import protocol as herkulex
from servobus.families.herkulex.models.drs0602 import DRS0602
from servobus.families.herkulex.protocol import (
    BOOT_TIME,
    EEP_TIME,
    FRAMING,
    Ack,
    Code,
    ControlMode,
    EepRead,
    EepWrite,
    IJog,
    Jog,
    Keep,
    Led,
    RamRead,
    RamWrite,
    Reboot,
    Request,
    Rollback,
    SJog,
    Stat,
    StatusDetail,
    StatusError,
    UnknownCommandError,
    WrongLengthError,
    encode,
    parse_ack,
    parse_request,
)

SERVO = KnownServo.of(ServoRef(219, DRS0602, Answers.READS), 115200)
TALKER = KnownServo.of(ServoRef(219, DRS0602, Answers.EVERYTHING), 115200)
MUTE = KnownServo.of(ServoRef(219, DRS0602, Answers.NOTHING), 115200)
FAMILY = DRS0602.family
OK = b"\x00\x00"


def said(exchange: Exchange[Any]) -> Request:
    (packet,) = FRAMING.decode(exchange.request)
    assert isinstance(packet, Packet)
    return parse_request(packet)


def play(procedure: Procedure[Any], *answers: bytes | Exception) -> tuple[Any, list[Request | Pause]]:
    """Carry a procedure out: each exchange that waits for a reply gets the data of the next answer."""
    left, steps = list(answers), list[Request | Pause]()
    reply: Any = None
    step = next(procedure)
    while True:
        if isinstance(step, Exchange):
            steps.append(said(step))
            answer = left.pop(0) if step.reply else b""
        else:
            assert isinstance(step, Pause)
            steps.append(step)
            answer = b""
        try:
            if isinstance(answer, Exception):
                step = procedure.throw(answer)
                continue
            if isinstance(step, Exchange) and step.reply:
                packet = Packet(steps[-1].id, step.reply.code or 0, answer)  # type: ignore[union-attr]
                assert step.reply.fits(packet)
                reply = step.interpret(packet)
            else:
                reply = None
            step = procedure.send(reply)
        except StopIteration as stop:
            assert not left, "an answer was not asked for"
            return stop.value, steps


def image(start: int, size: int, **registers: int) -> bytes:
    """Give the data of a RAM_READ ACK in which these registers stand."""
    data = bytearray(size)
    for name, raw in registers.items():
        row = DRS0602.register(name)
        at = getattr(row.place, "ram", 0) - start
        data[at : at + row.layout.size] = row.layout.pack(raw)
    return bytes((start, size)) + bytes(data) + OK


def motion_status(
    position: int = 16384, torque: int = 0x60, mode: int = 0, low: int = 10627, high: int = 22129
) -> tuple[bytes, bytes]:
    return (
        image(20, 4, min_position=low, max_position=high),
        image(52, 8, torque_control=torque, current_control_mode=mode, calibrated_position=position),
    )


# Frames


def test_of_many_ff_the_last_two_are_the_header() -> None:
    packet = encode(Stat(253))
    assert FRAMING.decode(b"\xff\xff\xff" + packet) == [Noise(b"\xff\xff\xff"), Packet(253, 7)]


@pytest.mark.parametrize("size", [0, 1, 6, 224, 0xFE, 0xFF])
def test_a_size_outside_7_to_223_is_no_packet(size: int) -> None:
    packet = encode(Stat(1))
    junk = bytes((0xFF, 0xFF, size, 1, 7))
    events = FRAMING.decode(junk + packet)
    assert [event for event in events if isinstance(event, Packet)] == [Packet(1, 7)]
    assert b"".join(event.raw for event in events if isinstance(event, Noise)) == junk


def test_longest_packet() -> None:
    data = bytes(range(214))
    packet = encode(EepWrite(1, 0, data))
    assert len(packet) == 223
    (event,) = FRAMING.decode(packet)
    assert isinstance(event, Packet)
    assert parse_request(event) == EepWrite(1, 0, data)
    with pytest.raises(BadValue, match=r"length 215 is not in 0 \.\. 214"):
        encode(EepWrite(1, 0, data + b"\x00"))
    with pytest.raises(BadValue, match="224 bytes is too long"):
        FRAMING.frame(Packet(1, 1, bytes(217)))


def test_bit_0_is_not_protected_and_every_other_bit_is() -> None:
    packet = encode(RamWrite(253, 53, b"\x01"))
    for position in range(2, len(packet)):
        for bit in range(8):
            damaged = bytearray(packet)
            damaged[position] ^= 1 << bit
            good = [event for event in FRAMING.decode(bytes(damaged)) if isinstance(event, Packet)]
            # A checksum's own bit 0 is always 0, and the size must still fit the bytes.
            blind = bit == 0 and position in (3, 4, 7, 8, 9)
            assert bool(good) == blind, (position, bit)


def test_a_false_header_does_not_hide_a_packet() -> None:
    decoder = Decoder(FRAMING)
    events = decoder.feed(b"\xff\xff\x0a\xff" + encode(Stat(5)))
    events += decoder.flush()
    assert [event for event in events if isinstance(event, Packet)] == [Packet(5, 7)]
    assert isinstance(events[0], Corrupt)


# Values


@pytest.mark.parametrize("code", [0x00, 0x0A, 0x0C, 0x41, 0xFF])
def test_unknown_command(code: int) -> None:
    with pytest.raises(UnknownCommandError, match=f"{code:#04x}"):
        parse_request(Packet(1, code))


@pytest.mark.parametrize(
    ("code", "data"),
    [
        (Code.EEP_READ, b"\x00"),
        (Code.RAM_READ, b"\x00\x01\x00"),
        (Code.EEP_WRITE, b"\x06"),
        (Code.RAM_WRITE, b"\x06\x02\x01"),
        (Code.I_JOG, b""),
        (Code.I_JOG, bytes(6)),
        (Code.S_JOG, b"\x3c"),
        (Code.S_JOG, bytes(6)),
        (Code.STAT, b"\x00"),
        (Code.ROLLBACK, b""),
        (Code.ROLLBACK, b"\x01"),
        (Code.REBOOT, b"\x00"),
    ],
)
def test_wrong_length(code: Code, data: bytes) -> None:
    with pytest.raises(WrongLengthError, match=f"{code.name} with {len(data)} data bytes"):
        parse_request(Packet(1, code, data))


@pytest.mark.parametrize("packet", [Packet(1, 0x07, OK), Packet(1, 0x47, b"\x00"), Packet(1, 0x4A, OK)])
def test_no_ack(packet: Packet) -> None:
    with pytest.raises(ValueError):
        parse_ack(packet)


def test_jog_bits() -> None:
    jog = Jog(7, -1, ControlMode.INFINITE_TURN, Led.RED | Led.GREEN, 254, stop=True, invalid=True, no_override=True)
    assert encode(IJog(254, (jog,)))[7:] == bytes((0x01, 0x40, 0b0111_0111, 7, 254))
    assert parse_request(Packet(254, 5, b"\x01\x40\x77\x07\xfe")) == IJog(254, (jog,))


def test_reserved_jog_bits_are_not_looked_at() -> None:
    assert parse_request(Packet(1, 6, b"\x00\xff\xff\x80\x01")) == SJog(1, 0, (Jog(1, 0x7FFF),))


def test_position_is_unsigned_and_speed_is_sign_and_magnitude() -> None:
    assert encode(IJog(1, (Jog(1, 32767),)))[7:9] == b"\xff\x7f"
    assert encode(IJog(1, (Jog(1, -16383, ControlMode.INFINITE_TURN),)))[7:9] == b"\xff\x7f"


@pytest.mark.parametrize(
    ("jog", "reason"),
    [
        (Jog(1, -1), "position -1 is not in 0 .. 32767"),
        (Jog(1, 32768), "position 32768"),
        (Jog(1, 16384, ControlMode.INFINITE_TURN), "speed 16384 is not in -16383 .. 16383"),
        (Jog(255, 0), "id 255 is not in 0 .. 254"),
        (Jog(1, 0, playtime=255), "playtime 255 is not in 0 .. 254"),
    ],
)
def test_jog_limits(jog: Jog, reason: str) -> None:
    with pytest.raises(BadValue, match=reason):
        encode(IJog(254, (jog,)))


def test_how_many_servos_one_jog_moves() -> None:
    jogs = [Jog(id, 16384) for id in range(54)]
    assert len(herkulex.i_jog(254, jogs[:43]).request) == 7 + 5 * 43
    assert len(herkulex.s_jog(254, 60, jogs[:53]).request) == 8 + 4 * 53
    with pytest.raises(BadValue, match="I_JOG 44 is not in"):
        herkulex.i_jog(254, jogs[:44])
    with pytest.raises(BadValue, match="S_JOG 54 is not in"):
        herkulex.s_jog(254, 60, jogs)
    with pytest.raises(BadValue, match="S_JOG 0 "):
        herkulex.s_jog(254, 60, [])
    with pytest.raises(BadValue, match="one playtime for all"):
        herkulex.s_jog(254, 60, [Jog(1, 0, playtime=5)])


def test_skip_options() -> None:
    assert encode(Rollback(1, Keep.CALIBRATION))[7:] == b"\x10\x00"
    assert encode(Rollback(1, Keep.BAUD))[7:] == b"\x00\x01"
    assert parse_request(Packet(1, 8, b"\x00\x00")) == Rollback(1)


# Native operations


@pytest.mark.parametrize(
    "build",
    [
        lambda answered: herkulex.eep_write(1, 6, b"\x01", answered=answered),
        lambda answered: herkulex.ram_write(1, 0, b"\x01", answered=answered),
        lambda answered: herkulex.i_jog(1, [Jog(1, 0)], answered=answered),
        lambda answered: herkulex.s_jog(1, 60, [Jog(1, 0)], answered=answered),
        lambda answered: herkulex.rollback(1, answered=answered),
        lambda answered: herkulex.reboot(1, answered=answered),
    ],
)
def test_commands_are_answered_under_policy_2_only(build: Any) -> None:
    silent, answered = build(False), build(True)
    assert silent.request == answered.request
    assert silent.reply is None
    assert answered.reply.fits(Packet(1, silent.request[4] | 0x40, OK))
    assert answered.reply_size == 9


def test_nobody_answers_a_broadcast_but_stat() -> None:
    assert herkulex.reboot(254, answered=True).reply is None
    assert herkulex.ram_write(254, 53, b"\x01", answered=True).reply is None
    stat = herkulex.stat(254)
    assert stat.reply is not None
    assert stat.reply.fits(Packet(17, 0x47, OK))
    with pytest.raises(BadValue, match="broadcast"):
        herkulex.ram_read(254, 0, 1)


def test_stat() -> None:
    stat = herkulex.stat(5)
    assert stat.interpret(Packet(5, 0x47, b"\x10\x42")) == Ack(
        5, Code.STAT, b"", StatusError.OVERLOAD, StatusDetail.INPOSITION | StatusDetail.TORQUE_ON
    )
    assert FAMILY.ping(5).request == stat.request


@pytest.mark.parametrize(("build", "code"), [(herkulex.eep_read, 0x42), (herkulex.ram_read, 0x44)])
def test_read(build: Any, code: int) -> None:
    exchange = build(5, 30, 2)
    collector = ReplyCollector([exchange])
    collector.feed(FRAMING.frame(Packet(5, code, b"\x1e\x02\x46\x00\x08\x44")))
    assert collector.result() == b"\x46\x00"
    # The error bit left from some earlier packet is an alarm beside the data, not a refusal.
    assert exchange.alarms(collector.packets[0]) == StatusError.INVALID_PACKET


def test_a_refused_read_says_why() -> None:
    exchange = herkulex.ram_read(5, 74, 2)
    assert exchange.reply is not None
    packet = Packet(5, 0x44, b"\x08\x50")
    assert exchange.reply.fits(packet)
    with pytest.raises(Refused, match=r"RAM_READ id 5.*invalid_packet; exceed_reg_range\+torque_on") as caught:
        exchange.interpret(packet)
    assert caught.value.flags == 8


def test_an_answer_about_another_address_is_no_answer() -> None:
    reply = herkulex.ram_read(5, 60, 2).reply
    assert reply is not None
    assert reply.fits(Packet(5, 0x44, b"\x3c\x02\x00\x40\x00\x00"))
    assert not reply.fits(Packet(5, 0x44, b"\x3a\x02\x00\x40\x00\x00"))


def test_a_write_with_an_old_error_is_no_failure() -> None:
    exchange = herkulex.ram_write(5, 53, b"\x01", answered=True)
    packet = Packet(5, 0x43, b"\x08\x04")
    exchange.interpret(packet)
    assert exchange.alarms is not None
    assert exchange.alarms(packet) == StatusError.INVALID_PACKET


@pytest.mark.parametrize("length", [0, 213])
def test_read_length(length: int) -> None:
    with pytest.raises(BadValue, match=r"not in 1 \.\. 212"):
        herkulex.ram_read(1, 0, length)


def test_what_must_not_be_repeated() -> None:
    assert not herkulex.rollback(1).repeatable
    assert not herkulex.reboot(1).repeatable
    assert herkulex.ram_read(1, 0, 1).repeatable


# Identity


def test_identify() -> None:
    identity, steps = play(FAMILY.identify(219), b"\x00\x04\x06\x02\x00\x90" + OK, b"\x01\x01\x02" + OK)
    assert identity == Identity(0x0602, "0.90", Answers.EVERYTHING)
    assert steps == [EepRead(219, 0, 4), RamRead(219, 1, 1)]


def test_identify_a_servo_that_answers_stat_alone() -> None:
    identity, steps = play(FAMILY.identify(219), NoReply("silence"), OK)
    assert identity == Identity(None, "", Answers.NOTHING)
    assert steps == [EepRead(219, 0, 4), Stat(219)]


def test_identify_nobody() -> None:
    with pytest.raises(NoReply):
        play(FAMILY.identify(219), NoReply("silence"), NoReply("silence"))


# Registers


def rows(*names: str) -> list[Register[Any]]:
    return [DRS0602.register(name) for name in names]


def test_read_goes_to_ram_and_bridges_small_gaps() -> None:
    data = image(48, 12, status_error=8, voltage=120, calibrated_position=20000)
    values, steps = play(FAMILY.read(SERVO, rows("calibrated_position", "status_error", "voltage")), data)
    assert values == [20000, 8, 120]
    assert steps == [RamRead(219, 48, 12)]


def test_read_in_both_maps() -> None:
    wanted = rows("baud", "id", "desired_velocity")
    values, steps = play(
        FAMILY.read(SERVO, wanted), b"\x00\x01\xdb" + OK, b"\x48\x02\xff\xff" + OK, b"\x04\x01\x10" + OK
    )
    assert values == [16, 219, -1]
    assert steps == [RamRead(219, 0, 1), RamRead(219, 72, 2), EepRead(219, 4, 1)]


def test_read_stored() -> None:
    values, steps = play(
        FAMILY.read_stored(SERVO, rows("id", "led_control")), b"\x35\x01\x02" + OK, b"\x06\x01\x07" + OK
    )
    assert values == [7, 2]
    assert steps == [RamRead(219, 53, 1), EepRead(219, 6, 1)]


def test_a_mute_servo_cannot_be_read() -> None:
    with pytest.raises(UsageError, match="ACK Policy is 0"):
        play(FAMILY.read(MUTE, rows("id")))


def test_write_joins_neighbours() -> None:
    values = dict(zip(rows("max_position", "baud", "min_position"), [20000, 1, 12000], strict=True))
    _, steps = play(FAMILY.put(TALKER, values, keep=False), OK, OK)
    assert steps == [EepWrite(219, 4, b"\x01"), RamWrite(219, 20, b"\xe0\x2e\x20\x4e")]


def test_store_writes_both_maps() -> None:
    _, steps = play(FAMILY.put(SERVO, dict(zip(rows("position_kp", "baud"), [80, 1], strict=True)), keep=True))
    assert steps == [EepWrite(219, 4, b"\x01"), EepWrite(219, 30, b"\x50\x00"), RamWrite(219, 24, b"\x50\x00")]


def test_store_refuses_what_is_lost() -> None:
    with pytest.raises(UsageError, match="led_control lives in RAM"):
        play(FAMILY.store(SERVO, {DRS0602.led_control: 1}))


def test_the_policy_is_written_last_and_its_answer_not_waited_for() -> None:
    _, steps = play(FAMILY.write(TALKER, dict(zip(rows("ack_policy", "led_control"), [1, 1], strict=True))), OK)
    assert steps == [RamWrite(219, 53, b"\x01"), RamWrite(219, 1, b"\x01"), Pause(2 * herkulex.TURNAROUND)]


# Motion


def axis(id: int, goal: int, duration: float = 1.0) -> AxisMove:
    return AxisMove(KnownServo.of(ServoRef(id, DRS0602, Answers.READS), 115200), goal, 1.0, duration)


def launched(axes: Sequence[AxisMove]) -> list[Any]:
    return play(FAMILY.start_moves(axes))[1]


def test_stance() -> None:
    found, steps = play(FAMILY.motion_status(SERVO), *motion_status(position=22865, mode=1))
    assert found.position == pytest.approx(180 * deg)
    assert (found.torque, found.turning, found.low, found.high) == (True, True, 10627, 22129)
    assert steps == [RamRead(219, 20, 4), RamRead(219, 52, 8)]


@pytest.mark.parametrize("torque", [0x00, 0x40])
def test_neither_free_nor_braked_is_torque(torque: int) -> None:
    found, _ = play(FAMILY.motion_status(SERVO), *motion_status(torque=torque))
    assert not found.torque


@pytest.mark.parametrize(
    ("duration", "playtime"), [(0.0001, 1), (0.0112, 1), (0.0113, 2), (0.672, 60), (1.0, 90), (2.8448, 254)]
)
def test_playtime_is_rounded_up(duration: float, playtime: int) -> None:
    assert launched([axis(7, 16384, duration)]) == [IJog(7, (Jog(7, 16384, playtime=playtime),))]


def test_a_move_can_take_too_long() -> None:
    assert DRS0602.max_move_time == pytest.approx(2.8448)
    with pytest.raises(BadValue, match=r"2.845 s is longer than 2.8448 s"):
        launched([axis(7, 16384, 2.845)])


def test_a_single_move_waits_for_its_ack() -> None:
    _, steps = play(FAMILY.start_moves([AxisMove(TALKER, 16384, 1.0, 0.672)]), OK)
    assert steps == [IJog(219, (Jog(219, 16384, playtime=60),))]


def test_equal_durations_go_in_s_jog() -> None:
    assert launched([axis(1, 16384), axis(2, 20000)]) == [SJog(254, 90, (Jog(1, 16384), Jog(2, 20000)))]


def test_different_durations_go_in_i_jog() -> None:
    assert launched([axis(1, 16384, 0.672), axis(2, 20000)]) == [
        IJog(254, (Jog(1, 16384, playtime=60), Jog(2, 20000, playtime=90)))
    ]


def test_many_servos_are_split() -> None:
    assert [len(step.jogs) for step in launched([axis(id, 16384) for id in range(110)])] == [53, 53, 4]
    mixed = [axis(id, 16384, 1 + id % 2) for id in range(90)]
    assert [len(step.jogs) for step in launched(mixed)] == [43, 43, 4]


@pytest.mark.parametrize(("detail", "moving"), [(0x41, True), (0x42, False)])
def test_moving(detail: int, moving: bool) -> None:
    assert play(FAMILY.moving(MUTE), bytes((0, detail))) == (moving, [Stat(219)])


def test_stop_holds_the_present_position() -> None:
    _, steps = play(FAMILY.stop(SERVO), *motion_status(position=17000))
    assert steps[-1] == IJog(219, (Jog(219, 17000, stop=True),))


def test_stop_a_turning_servo() -> None:
    _, steps = play(FAMILY.stop(SERVO), *motion_status(mode=1))
    assert steps[-1] == IJog(219, (Jog(219, 0, ControlMode.INFINITE_TURN, stop=True),))


def test_torque() -> None:
    assert play(FAMILY.torque(SERVO, on=False))[1] == [RamWrite(219, 52, b"\x00")]
    assert play(FAMILY.torque(SERVO, on=True), b"\x08\x40")[1] == [RamWrite(219, 52, b"\x60"), Stat(219)]


def test_torque_that_stays_off_is_told() -> None:
    with pytest.raises(Refused, match="torque stays off because of overload") as caught:
        play(FAMILY.torque(SERVO, on=True), b"\x10\x00")
    assert caught.value.flags == StatusError.OVERLOAD


@pytest.mark.parametrize(("speed", "raw"), [(198.4 * deg, 320), (-198.4 * deg, -320), (0.0, 0)])
def test_turn(speed: float, raw: int) -> None:
    _, steps = play(FAMILY.turn(SERVO, speed=speed, output=None))
    assert steps == [IJog(219, (Jog(219, raw, ControlMode.INFINITE_TURN, playtime=60),))]


def test_turn_takes_a_speed_it_can_say() -> None:
    with pytest.raises(UsageError, match="give speed"):
        play(FAMILY.turn(SERVO, speed=None, output=0.5))
    for speed in (10_158 * deg, float("nan"), float("inf")):
        with pytest.raises(BadValue, match="is beyond"):
            play(FAMILY.turn(SERVO, speed=speed, output=None))


def test_position_mode() -> None:
    _, steps = play(FAMILY.position_mode(SERVO, None), *motion_status(position=17000, mode=1))
    assert steps[2:] == [IJog(219, (Jog(219, 17000),))]


def test_position_mode_sets_limits() -> None:
    _, steps = play(FAMILY.position_mode(SERVO, (12000, 20000)), *motion_status(low=12000, high=20000))
    assert steps[0] == RamWrite(219, 20, b"\xe0\x2e\x20\x4e")
    assert len(steps) == 3


def test_position_mode_outside_the_limits_does_not_run_back() -> None:
    _, steps = play(FAMILY.position_mode(SERVO, None), *motion_status(position=30000, mode=1), b"\x00\x40")
    assert steps[2:] == [
        RamWrite(219, 52, b"\x00"),
        IJog(219, (Jog(219, 22129),)),
        RamWrite(219, 52, b"\x60"),
        Stat(219),
    ]


# Light, life and identity


@pytest.mark.parametrize(
    ("colour", "bits"),
    [
        ("off", 0),
        ("on", 7),
        ("white", 7),
        ("green", 1),
        ("blue", 2),
        ("red", 4),
        ("cyan", 3),
        ("magenta", 6),
        ("yellow", 5),
    ],
)
def test_led(colour: str, bits: int) -> None:
    assert play(FAMILY.led(SERVO, colour))[1] == [RamWrite(219, 53, bytes((bits,)))]


def test_no_such_colour() -> None:
    with pytest.raises(BadValue, match="no light 'pink'"):
        play(FAMILY.led(SERVO, "pink"))


def test_reboot() -> None:
    assert play(FAMILY.reboot(SERVO))[1] == [Reboot(219), Pause(BOOT_TIME)]


def test_reset() -> None:
    found, steps = play(
        FAMILY.reset(KnownServo.of(ServoRef(3, DRS0602, Answers.EVERYTHING), 115200), frozenset()), OK, OK
    )
    assert found == (219, 115_200)
    assert steps == [Rollback(3), Pause(EEP_TIME), Reboot(3), Pause(BOOT_TIME)]


def test_reset_keeps() -> None:
    keep = frozenset({"id", "baud", "calibration"})
    target = KnownServo.of(ServoRef(3, DRS0602, Answers.READS), 115200)
    found, steps = play(FAMILY.reset(target, keep), b"\x06\x01\x03" + OK, b"\x04\x01\x01" + OK)
    assert found == (3, 1_000_000)
    assert steps[2] == Rollback(3, Keep.ID | Keep.BAUD | Keep.CALIBRATION)


def test_reset_keeps_nothing_else() -> None:
    with pytest.raises(UsageError, match="cannot keep gains"):
        play(FAMILY.reset(SERVO, frozenset({"gains"})))


def test_set_id_ends_with_the_write_that_acts() -> None:
    before, after = b"\x06\x01\xdb" + OK, b"\x06\x01\x04" + OK
    _, steps = play(FAMILY.set_id(TALKER, 4), before, OK, after, OK)
    look = EepRead(219, 6, 1)
    assert steps == [look, EepWrite(219, 6, b"\x04"), look, RamWrite(219, 0, b"\x04")]
    with pytest.raises(BadValue, match="broadcast"):
        play(FAMILY.set_id(SERVO, 254))


def test_set_baud_restarts() -> None:
    _, steps = play(FAMILY.set_baud(SERVO, 1_000_000), b"\x04\x01\x10" + OK, b"\x04\x01\x01" + OK)
    look = EepRead(219, 4, 1)
    assert steps == [look, EepWrite(219, 4, b"\x01"), look, Pause(EEP_TIME), Reboot(219), Pause(BOOT_TIME)]
    with pytest.raises(BadValue, match="9600"):
        play(FAMILY.set_baud(SERVO, 9600))


@pytest.mark.parametrize(
    ("packet", "words"),
    [
        (Packet(1, 4, b"\x3a\x02"), "RAM_READ id 1: 2 bytes from address 58"),
        (Packet(1, 0x47, b"\x10\x00"), "ACK of STAT from id 1: ALARM overload"),
        (Packet(1, 0x0A), "unknown command 0x0a"),
        (Packet(1, 0x5F, OK), "unknown command 0x1f"),
        (Packet(1, 7, b"\x00"), "STAT with 1 data bytes"),
    ],
)
def test_explain(packet: Packet, words: str) -> None:
    assert words in FAMILY.explain(packet)


def test_speeds() -> None:
    assert DRS0602.bauds[0] == DRS0602.factory_baud == 115_200
    assert len(DRS0602.bauds) == 8
    assert FAMILY.full_duplex
