"""LewanSoul packets: frames, messages and exchanges."""

import pytest

from servobus.core.framing import INCOMPLETE, NOT_A_FRAME, Corrupt, Noise, Packet
from servobus.core.replies import ReplyCollector
from servobus.errors import BadValue
from servobus.families.lewansoul.protocol import (
    FRAMING,
    Answer,
    Command,
    Request,
    angle_offset_adjust,
    encode,
    id_read,
    id_write,
    move_start,
    move_time_write,
    parse_answer,
    parse_request,
    query,
    send,
)
from servobus.families.lewansoul.verbs import Lewansoul

FAMILY = Lewansoul()


# Frames


def test_the_size_comes_from_the_length_byte_and_is_believed_between_3_and_7_only() -> None:
    assert FRAMING.size(b"\x55\x55\x01", 0) == INCOMPLETE
    sizes = [FRAMING.size(bytes((0x55, 0x55, 1, length)), 0) for length in (2, 3, 7, 8)]
    assert sizes == [NOT_A_FRAME, 6, 10, NOT_A_FRAME]


def test_more_than_four_parameter_bytes_do_not_fit() -> None:
    with pytest.raises(BadValue):
        FRAMING.frame(Packet(1, 1, bytes(5)))


def test_id_85_looks_like_a_third_header_byte_and_is_found() -> None:
    raw = encode(Request(0x55, Command.SERVO_POS_READ))
    assert raw[:3] == b"\x55\x55\x55"
    assert FRAMING.decode(raw) == [Packet(0x55, 28)]


def test_a_stray_header_byte_before_a_packet_does_not_hide_it() -> None:
    # The first pair makes a frame of id 85 and length 5, which fails its checksum (L-11).
    raw = encode(Request(5, Command.SERVO_TEMP_MAX_LIMIT_WRITE, (85,)))
    corrupt, packet = FRAMING.decode(b"\x55" + raw)
    assert isinstance(corrupt, Corrupt)
    assert packet == Packet(5, 24, b"\x55")


def test_a_wrong_checksum_is_told_as_corrupt() -> None:
    raw = bytearray(encode(Request(1, Command.SERVO_MOVE_TIME_WRITE, (500, 1000))))
    raw[-1] ^= 1
    assert FRAMING.decode(bytes(raw)) == [Corrupt(Packet(1, 1, b"\xf4\x01\xe8\x03", 10), bytes(raw))]


def test_a_length_above_7_is_noise() -> None:
    assert FRAMING.decode(b"\x55\x55\x01\x08\x01") == [Noise(b"\x55\x55\x01\x08\x01")]


# Messages


def test_all_28_commands_are_known_and_write_commands_are_never_answered() -> None:
    assert len(Command) == 28
    assert all(command.name.endswith("_READ") == bool(command.reply) for command in Command)
    assert not any(command.params and command.reply for command in Command)


@pytest.mark.parametrize("command", Command)
def test_requests_and_answers_come_back_as_they_were_sent(command: Command) -> None:
    for bound in (0, 1):
        request = Request(7, command, tuple(layout.range[bound] for _, layout in command.params))
        (packet,) = FRAMING.decode(encode(request))
        assert isinstance(packet, Packet)
        assert parse_request(packet) == request
        if command.reply:
            answer = Answer(7, command, tuple(layout.range[bound] for _, layout in command.reply))
            (packet,) = FRAMING.decode(encode(answer))
            assert isinstance(packet, Packet)
            assert parse_answer(packet) == answer


def test_unknown_commands_and_wrong_lengths_are_no_messages() -> None:
    for packet in (
        Packet(1, 0),
        Packet(1, 3),
        Packet(1, 37),
        Packet(1, 1, bytes(3)),
        Packet(1, 28, bytes(2)),
    ):
        with pytest.raises(ValueError):
            parse_request(packet)
    for packet in (Packet(1, 28), Packet(1, 11), Packet(1, 1, bytes(4))):
        with pytest.raises(ValueError):
            parse_answer(packet)


def test_values_that_do_not_fit_their_parameters_are_refused() -> None:
    with pytest.raises(BadValue, match="offset 128 is not in"):
        angle_offset_adjust(1, 128)
    with pytest.raises(BadValue, match="parameters: angle, time_ms; 1 were given"):
        send(1, Command.SERVO_MOVE_TIME_WRITE, 500)
    with pytest.raises(BadValue, match="parameters: none; 1 were given"):
        send(1, Command.SERVO_MOVE_START, 1)


def test_packets_are_explained_by_their_length() -> None:
    assert FAMILY.explain(Packet(1, 1, b"\xf4\x01\xe8\x03")) == "SERVO_MOVE_TIME_WRITE id 1, angle 500, time_ms 1000"
    assert FAMILY.explain(Packet(1, 28)) == "SERVO_POS_READ id 1"
    assert FAMILY.explain(Packet(1, 28, b"\xf4\xff")) == "answer to SERVO_POS_READ id 1, position -12"
    assert FAMILY.explain(Packet(1, 99)) == "unknown command 99, id 1"
    assert FAMILY.explain(Packet(1, 1, b"\x01")) == "SERVO_MOVE_TIME_WRITE with 1 parameter bytes, id 1"


# Exchanges


def test_only_questions_wait_for_an_answer() -> None:
    assert move_time_write(1, 500, 1000).reply is None
    assert move_start().request == bytes.fromhex("55 55 FE 03 0B F3")
    exchange = query(1, Command.SERVO_OR_MOTOR_MODE_READ)
    assert exchange.reply_size == 10
    assert exchange.repeatable
    with pytest.raises(BadValue, match="question"):
        send(1, Command.SERVO_POS_READ)
    with pytest.raises(BadValue, match="never answered"):
        query(1, Command.SERVO_MOVE_START)


def test_to_the_broadcast_id_only_the_question_for_the_id_is_answered() -> None:
    collector = ReplyCollector([id_read()])
    collector.feed(encode(Answer(9, Command.SERVO_ID_READ, (9,))))
    assert collector.result() == 9
    with pytest.raises(BadValue, match="254"):
        query(254, Command.SERVO_POS_READ)


def test_the_echo_of_the_question_is_not_taken_for_its_answer() -> None:
    collector = ReplyCollector([query(1, Command.SERVO_POS_READ)], echo=None)
    collector.feed(bytes.fromhex("55 55 01 03 1C DF"))
    assert not collector.done
    collector.feed(bytes.fromhex("55 55 01 05 1C F4 FF EA"))
    assert collector.result() == (-12,)


def test_the_broadcast_id_cannot_be_given_to_a_servo() -> None:
    with pytest.raises(BadValue):
        id_write(1, 254)
    with pytest.raises(BadValue):
        FAMILY.ping(254)
