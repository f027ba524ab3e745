"""HerkuleX packets, where no packet of the manual shows it: limits, errors and replies."""

from typing import Any

import pytest

from servobus.core.framing import Corrupt, Decoder, Noise, Packet
from servobus.core.replies import ReplyCollector
from servobus.errors import BadValue, Refused
from servobus.families.herkulex import protocol as herkulex
from servobus.families.herkulex.models.magnetic import DRS0602
from servobus.families.herkulex.protocol import (
    FRAMING,
    Ack,
    Code,
    ControlMode,
    EepWrite,
    IJog,
    Jog,
    Keep,
    Led,
    RamWrite,
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

FAMILY = DRS0602.family
OK = b"\x00\x00"


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
