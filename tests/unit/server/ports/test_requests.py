"""The requests of a program, cut from its bytes; and the exchanges that carry them out."""

import random

import pytest

from servobus import MODELS
from servobus.core.effect import Effect, Kind, Touch
from servobus.core.exchange import Exchange, GroupExchange
from servobus.core.framing import Packet
from servobus.families.base import Answers, Family
from servobus.server.ports.requests import DEAF, AnswerHabits, Request, RequestCutter, exchange_of

RX28, DRS0602, LX16A = MODELS["rx28"], MODELS["drs0602"], MODELS["lx16a"]
D, H, L = RX28.family, DRS0602.family, LX16A.family

# RX-28 manual 3-5 and 3-3, DRS-0602 manual 6-4 and 5, the protocol document of the LX
READ_POSITION = bytes.fromhex("FFFF 01 04 02 24 02 D2")
GOAL = bytes.fromhex("FFFF 01 05 03 1E 00 02 D6")
PING_219 = bytes.fromhex("FFFF DB 02 01 21")
STAT = bytes.fromhex("FFFF 07 DB 07 DA 24")
LX_POSITION = bytes.fromhex("5555 01 03 1C DF")
ALL = [(D, READ_POSITION), (D, GOAL), (D, PING_219), (H, STAT), (L, LX_POSITION)]


def cutter(*families: Family) -> RequestCutter:
    return RequestCutter(lambda: families or (D, H, L))


def cut(one: RequestCutter, *pieces: bytes) -> list[tuple[Family, bytes]]:
    return [(request.family, request.raw) for piece in pieces for request in one.feed(piece)]


@pytest.mark.parametrize(("family", "raw"), ALL)
def test_each_family_in_any_pieces(family: Family, raw: bytes) -> None:
    assert family.framing.whole(raw) is not None
    for at in range(1, len(raw)):
        one = cutter()
        assert cut(one, raw[:at], raw[at:]) == [(family, raw)]
        assert (one.begun, one.garbage) == (False, 0)
    assert cut(cutter(), *(raw[n : n + 1] for n in range(len(raw)))) == [(family, raw)]


def test_all_families_by_one_program() -> None:
    """Also where one has the beginning of the other: FF FF DB is a HerkuleX packet of 219 bytes."""
    one = cutter()
    sent = [ALL[n] for n in (3, 2, 4, 0, 3, 2, 2, 1, 4, 3)]
    assert cut(one, *(raw for _, raw in sent)) == sent
    assert cut(cutter(), b"".join(raw for _, raw in sent)) == sent
    assert one.garbage == 0


@pytest.mark.parametrize("order", [(D, H), (H, D)])
def test_the_whole_piece_tells_the_family(order: tuple[Family, ...]) -> None:
    """Whatever its first bytes would be to the other family, and whichever that is."""
    for id in range(254):
        for family in order:
            for request in (family.ping(id).request, *(one.request for one in family.fences(id))):
                assert cut(cutter(*order), request) == [(family, request)]


def test_garbage_is_dropped_and_counted() -> None:
    one = cutter()
    assert cut(one, b"\x00\x12\xff" + READ_POSITION) == [(D, READ_POSITION)]
    assert one.garbage == 3
    broken = READ_POSITION[:-1] + b"\x00"
    assert cut(one, broken + LX_POSITION) == [(L, LX_POSITION)]
    assert one.garbage == 3 + len(broken)


def test_the_beginning_of_a_request_waits_until_a_whole_one_comes() -> None:
    one = cutter()
    assert cut(one, GOAL[:5]) == []
    assert one.begun
    assert cut(one, READ_POSITION) == [(D, READ_POSITION)]
    assert (one.begun, one.garbage) == (False, 5)
    assert cut(one, GOAL[:5]) == []
    one.drop()
    assert (one.begun, one.garbage) == (False, 10)
    assert cut(one, GOAL[5:], READ_POSITION) == [(D, READ_POSITION)]


def test_nothing_is_made_of_noise_and_nothing_is_kept_for_ever() -> None:
    dice, one = random.Random(7), cutter()
    for _ in range(300):
        for request in one.feed(dice.randbytes(dice.randrange(60))):
            assert request.family.framing.whole(request.raw) is not None
    assert len(one._buffer) <= 300


def exchange(raw: bytes, family: Family, *, awaited: bool = True, reads: bool = False) -> Exchange[object]:
    packet = family.framing.whole(raw)
    assert packet is not None
    return exchange_of(Request(family, packet, raw), reads=reads, awaited=awaited)


def test_a_question_is_answered_within_what_the_servo_may_be_set_to() -> None:
    asked = exchange(READ_POSITION, D, reads=True)
    assert (asked.request, asked.repeatable) == (READ_POSITION, True)
    assert asked.reply is not None
    assert (asked.reply.id, asked.reply.sizes) == (1, (2, 0))
    assert asked.max_delay == pytest.approx(254 * 2e-6)  # Return Delay Time at its highest (RX-28 manual 3-4-1)
    packet = Packet(1, 0x20, b"\x01\x02")
    assert asked.interpret(packet) is packet  # an error bit is the program's to see


def test_what_need_not_be_answered() -> None:
    assert exchange(GOAL, D).reply is not None
    assert exchange(GOAL, D, awaited=False).reply is None
    assert not exchange(GOAL, D).repeatable
    assert exchange(READ_POSITION, D, awaited=False).reply is not None
    everybody = D.framing.frame(Packet(254, 3, bytes([24, 0])))
    assert exchange(everybody, D).replies == ()


def test_several_that_answer() -> None:
    bulk = exchange(D.framing.frame(Packet(254, 0x92, bytes([0, 2, 3, 36, 1, 5, 43]))), D, reads=True)
    assert isinstance(bulk, GroupExchange)
    assert [(reply.id, reply.sizes) for reply in bulk.replies] == [(3, (2, 0)), (5, (1, 0))]
    assert not bulk.repeatable  # no part is asked alone: the program did not ask that


def test_an_answer_is_awaited_as_long_as_it_comes() -> None:
    habits = AnswerHabits()
    assert habits.expects(D, 1, None, 0.0)
    assert habits.expects(D, 1, Answers.EVERYTHING, 0.0)
    assert not habits.expects(D, 1, Answers.READS, 0.0)
    habits.note(D, 1, False, 0.0)
    assert habits.expects(D, 1, None, 0.0)
    habits.note(D, 1, False, 0.0)
    assert not habits.expects(D, 1, None, DEAF / 2)
    assert habits.expects(D, 2, None, DEAF / 2)
    assert habits.expects(D, 1, None, DEAF)
    habits.note(D, 1, True, DEAF)
    assert habits.expects(D, 1, Answers.READS, DEAF)


def test_the_program_itself_tells_what_is_answered() -> None:
    habits = AnswerHabits()

    def written(raw: int) -> Effect:
        return Effect((Touch(1, Kind.STORES, {RX28.register("answer_level"): raw}),))

    habits.note_written(D, written(1), 0.0)
    assert not habits.expects(D, 1, Answers.EVERYTHING, 0.0)
    habits.note_written(D, written(2), 0.0)
    assert habits.expects(D, 1, Answers.READS, 0.0)
