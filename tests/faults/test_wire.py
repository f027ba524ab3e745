"""What a wire does to a reply: bytes lost, bits flipped, junk, pieces, echoes (F1 to F6)."""

import itertools
import random

import pytest

from faults.rig import POSITION, FaultRig
from samples import ONE_OF_EACH_FAMILY, one_model_of_each_family, sample_of
from servobus import MODELS, BusError
from servobus.core.exchange import Exchange
from servobus.core.framing import Decoder
from servobus.core.replies import ReplyCollector
from servobus.families.base import Answers, ServoRef
from unit.lossy import ASYNC, CHOSEN_DRIVERS, DRIVERS, SYNC

PLACES = [(key, place) for key in ONE_OF_EACH_FAMILY for place in range(sample_of(key).answer_size)]
"""Every byte of the answer with a position."""


def question(key: str) -> Exchange[bytes]:
    """What asks servo 1 for its position."""
    target = ServoRef(1, MODELS[key], Answers.READS)
    (exchange,) = MODELS[key].family.reading(target, [MODELS[key].register(POSITION)]).exchanges
    return exchange


@one_model_of_each_family
def test_F2_the_answers_here_are_those_that_come(key: str) -> None:
    """The bytes that are worked out here are those of the virtual servo."""
    rig = FaultRig(key)
    rig.inject(None)
    assert rig.port.heard == b""
    raw = rig.turn()
    rig.read()
    heard = rig.port.heard
    assert rig.sample.without_state(heard) == rig.sample.position_answer(1, raw)
    assert rig.sample.positions(1, heard) == [raw]
    assert len(heard) == rig.sample.answer_size


@DRIVERS
@pytest.mark.parametrize(("key", "place"), PLACES)
def test_F1_a_lost_byte_costs_one_retry_and_no_value(key: str, place: int, driver: str) -> None:
    """Whichever byte of a reply is lost, the read is right with the second try, and so is the next one."""
    rig = FaultRig(key, driver)
    rig.inject(f"drop@{place}#1")
    assert [rig.try_position(), rig.try_position()] == ["right", "right"]
    assert rig.port.rig.fault_counts == {"drop": 1}
    assert rig.bus.stats[1].retries == 1


@CHOSEN_DRIVERS
@one_model_of_each_family
def test_F2_a_flipped_bit_is_never_accepted_but_where_no_checksum_sees_it(key: str, driver: str) -> None:
    """Each bit in turn: noticed and asked again, but for those that the checksum leaves out.

    A sum changes with every bit. HerkuleX leaves bit 0 out of its checksum (5-2): so bit 0 of each byte that is
    neither known beforehand (header, size, id, command, address, length) nor a check byte is not protected: 4 bits, 2
    of which change the value by 1 or 256.
    """
    rig = FaultRig(key, driver)
    accepted, unseen = [], rig.sample.unseen
    for bit in range(8 * rig.sample.answer_size):
        before = rig.bus.stats[1].retries
        rig.inject(f"flip@{bit}#1")
        truth = rig.turn()
        value = rig.read()
        if rig.bus.stats[1].retries == before:
            accepted.append(bit)
        assert value == truth ^ unseen.get(bit, 0), bit
    assert accepted == sorted(unseen)


@one_model_of_each_family
def test_F3_two_flipped_bits_pass_only_where_they_cancel(key: str) -> None:
    """Every pair of bits: taken for the answer only if the checksum provably fits, and id, command and length too."""
    raw, pairs, unseen = sample_of(key).pairs
    whole = sample_of(key).position_answer(1, raw)
    accepted, expected, count = [], [], 0
    full = len(whole) - MODELS[key].family.framing.overhead
    for one, other in itertools.combinations(range(8 * len(whole)), 2):
        count += 1
        bad = bytearray(whole)
        bad[one // 8] ^= 1 << one % 8
        bad[other // 8] ^= 1 << other % 8
        collector = ReplyCollector([question(key)])
        collector.feed(bytes(bad))
        collector.end()
        if collector.packets[0] is not None and len(collector.packets[0].data) == full:  # a shorter one is a refusal
            accepted.append((one, other))
        if sample_of(key).cancel(whole, one, other):
            expected.append((one, other))
    assert accepted == expected
    assert (count, len(accepted)) == (pairs, unseen)


@CHOSEN_DRIVERS
@one_model_of_each_family
def test_F3_pairs_that_cancel_are_the_only_wrong_values(key: str, driver: str) -> None:
    """Of many reads with two bits flipped by chance so that the checksum fits, each is right, refused, or one whose
    bits were in the value."""
    rig = FaultRig(key, driver, ids="1")
    first = rig.sample.value_at
    rig.inject("seed=3,pair=0.5")
    for _ in range(300):
        hits = len(rig.port.rig.injected)
        if rig.try_position() == "provable":
            fresh = rig.port.rig.injected[hits:]
            places = [int(bit) // 8 for one in fresh for bit in one.where.removeprefix("bits ").split(", ")]
            assert any(place in (first, first + 1) for place in places)
    assert "provable" in rig.verdicts  # else this would show nothing
    assert "wrong" not in rig.verdicts


JUNK = [
    "01",
    "FF",
    "55",
    "FFFF",
    "5555",
    "FFFFFF",
    "FFFF01",
    "555501",
    "FFFF0104",
    "FFFF0D01",
    "55550105",
    "FFFFFFFFFF",
]


@CHOSEN_DRIVERS
@one_model_of_each_family
@pytest.mark.parametrize("junk", JUNK)
def test_F4_header_bytes_before_inside_and_behind_a_reply(key: str, junk: str, driver: str) -> None:
    """Bytes that look like the beginning of a packet, at every place of a reply: the read is right, with one retry at
    most."""
    rig = FaultRig(key, driver)
    for place in ("before", *range(1, rig.sample.answer_size), "after"):
        before = rig.bus.stats[1].retries
        rig.inject(f"junk@{place}#1:0x{junk}")
        # Where junk pushes bytes out of a packet whose checksum then fits by chance, nobody can know.
        assert rig.try_position() in ("right", "provable"), place
        assert rig.bus.stats[1].retries - before <= 1
        assert rig.try_position() == "right"
    assert rig.verdicts.count("provable") <= rig.sample.by_chance


@CHOSEN_DRIVERS
@one_model_of_each_family
def test_F4_one_to_64_bytes_of_junk(key: str, driver: str) -> None:
    """Junk of every length in every place: each read is right, unless both tries were hit, and none is wrong."""
    rig = FaultRig(key, driver)
    rig.inject("seed=4,junk@before=0.3,junk@inside=0.3,junk@after=0.3")
    for _ in range(200):
        rig.try_position()
    assert "wrong" not in rig.verdicts
    assert rig.verdicts.count("right") > 150
    rig.inject(None)
    assert [rig.try_position() for _ in range(3)] == ["right"] * 3


@one_model_of_each_family
def test_F4_junk_takes_linear_time_and_bounded_memory(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice as much junk takes twice as many looks, even if it is all headers; and no more than a packet is kept."""
    framing = MODELS[key].family.framing
    looks = 0
    size = type(framing).size

    def counted(self: object, buffer: bytes, at: int) -> int:
        nonlocal looks
        looks += 1
        return size(self, buffer, at)  # type: ignore[arg-type]

    monkeypatch.setattr(type(framing), "size", counted)
    rng, spent = random.Random(4), []
    stream = b"".join(framing.header + rng.randbytes(rng.randint(0, 3)) for _ in range(8000))
    for length in (10_000, 20_000):
        looks, decoder = 0, Decoder(framing)
        for at in range(0, length, 64):
            decoder.feed(stream[at : min(at + 64, length)])
            assert decoder.pending <= framing.max_size
        spent.append(looks)
    assert spent[1] <= 2.2 * spent[0]


@DRIVERS
@pytest.mark.parametrize(("key", "place"), [(key, place) for key, place in PLACES if place])
def test_F5_a_reply_in_two_pieces(key: str, place: int, driver: str) -> None:
    """A pause before any byte of a reply changes nothing: the same value, and nothing is asked again."""
    rig = FaultRig(key, driver)
    rig.inject(f"split@{place}:1ms")
    assert [rig.try_position() for _ in range(3)] == ["right"] * 3
    assert rig.bus.stats.total.retries == 0


@DRIVERS
@one_model_of_each_family
def test_F5_two_replies_glued_together(key: str, driver: str) -> None:
    """A reply that comes with the next one in one piece: that one is told from it, and the value is right."""
    rig = FaultRig(key, driver)
    rig.inject("glue#1,glue#4")
    assert [rig.try_position() for _ in range(4)] == ["right"] * 4
    assert rig.bus.stats.total.late >= 1


@DRIVERS
@one_model_of_each_family
def test_F6_a_full_echo_is_found_out(key: str, driver: str) -> None:
    """An adapter that hears what it sends: found out with the first exchange, and never taken for data."""
    rig = FaultRig(key, driver, options="&echo=on")
    assert rig.bus.echo is True
    assert [rig.try_position() for _ in range(20)] == ["right"] * 20
    assert rig.bus.stats.total.echo == rig.bus.stats.total.retries == 0


@DRIVERS
@one_model_of_each_family
def test_F6_a_broken_echo_is_an_error_and_no_data(key: str, driver: str) -> None:
    """Part of the echo, none of it, or one bad byte in any place: asked again, and the value is right."""
    rig = FaultRig(key, driver, options="&echo=on")
    size = len(question(key).request)
    broken = 0
    for fault in (
        *(f"echo@part#1:{n}" for n in range(1, size)),
        *(f"echo@bad#1:{n}" for n in range(size)),
        "echo@none#1",
    ):
        rig.inject(f"seed=6,{fault}")
        before = rig.bus.stats.total.echo
        assert rig.try_position() == "right", fault
        broken += rig.bus.stats.total.echo - before
        assert rig.try_position() == "right", fault
        assert rig.bus.echo is True
    assert broken >= 2 * size - 1


@DRIVERS
@one_model_of_each_family
def test_F6_an_echo_that_comes_up_later(key: str, driver: str) -> None:
    """An adapter that begins to echo: no echo is taken for an answer, and reads go on."""
    rig = FaultRig(key, driver)
    assert rig.bus.echo is False
    rig.inject("echo@full")
    for _ in range(10):
        rig.try_position()
    assert rig.verdicts == ["right"] * 10


@pytest.mark.parametrize("driver", [SYNC, ASYNC])
def test_F6_a_ping_whose_echo_looks_like_its_answer(driver: str) -> None:
    """An RX-28's PING is its own answer with a voltage error: with a new echo and nobody there it is no answer."""
    rig = FaultRig("rx28", driver)
    rig.inject("echo@full,mute")
    with pytest.raises(BusError):
        rig.do(lambda bus: bus[1].ping())
