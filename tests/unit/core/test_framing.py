"""The decoder, with the frames of every family: what a bus really carries, and the worst it could carry."""

from collections.abc import Iterator

import pytest

from servobus.core.framing import Corrupt, Decoder, Event, Framing, Noise, Packet
from servobus.families.dynamixel.protocol import Dynamixel1Framing
from servobus.families.herkulex.protocol import HerkulexFraming
from servobus.families.lewansoul.protocol import LewansoulFraming

FRAMINGS: list[Framing] = [HerkulexFraming(), Dynamixel1Framing(), LewansoulFraming()]
PACKETS = [Packet(1, 1, b"\x02\x03"), Packet(253, 2, b""), Packet(9, 3, b"\x00\x01\x00\x02")]
LIES = {
    HerkulexFraming: bytes.fromhex("FF FF DF 01"),
    Dynamixel1Framing: bytes.fromhex("FF FF 01 8B"),
    LewansoulFraming: bytes.fromhex("55 55 01 07"),
}
"""The start of a packet that says it is as long as can be."""


@pytest.fixture(params=FRAMINGS, ids=lambda framing: type(framing).__name__)
def framing(request: pytest.FixtureRequest) -> Framing:
    found: Framing = request.param
    return found


def chunks(stream: bytes, size: int) -> Iterator[bytes]:
    return (stream[at : at + size] for at in range(0, len(stream), size))


def cut(framing: Framing, stream: bytes, size: int) -> list[Event]:
    decoder = Decoder(framing)
    events = [event for chunk in chunks(stream, size) for event in decoder.feed(chunk)]
    return events + decoder.flush()


def packets(events: list[Event]) -> list[Packet]:
    return [event for event in events if isinstance(event, Packet)]


def noise(events: list[Event]) -> bytes:
    return b"".join(event.raw for event in events if isinstance(event, Noise))


class Counting(Framing):
    """Another framing that counts how often it is asked."""

    def __init__(self, framing: Framing) -> None:
        self.header, self.overhead, self.max_size = framing.header, framing.overhead, framing.max_size
        self.framing = framing
        self.sizes = self.unframes = 0

    def size(self, buffer: bytes | bytearray, at: int) -> int:
        self.sizes += 1
        return self.framing.size(buffer, at)

    def frame(self, packet: Packet) -> bytes:
        return self.framing.frame(packet)

    def unframe(self, raw: bytes) -> tuple[Packet, bool]:
        self.unframes += 1
        return self.framing.unframe(raw)


# Good packets


@pytest.mark.parametrize("size", [1, 2, 3, 5, 7, 1000])
def test_packets_are_found_however_the_stream_is_chunked(framing: Framing, size: int) -> None:
    stream = b"".join(map(framing.frame, PACKETS))
    assert cut(framing, stream, size) == PACKETS


def test_the_end_of_a_packet_is_its_place_in_the_stream(framing: Framing) -> None:
    frames = [framing.frame(packet) for packet in PACKETS]
    for size in (1, 4, 1000):
        ends = [packet.end for packet in packets(cut(framing, b"\x07" + b"".join(frames), size))]
        assert ends == [1 + len(b"".join(frames[: n + 1])) for n in range(len(frames))]


def test_a_packet_comes_out_with_its_last_byte_and_not_before(framing: Framing) -> None:
    decoder = Decoder(framing)
    raw = framing.frame(PACKETS[0])
    assert decoder.feed(raw[:-1]) == []
    assert decoder.pending == len(raw) - 1
    assert decoder.feed(raw[-1:]) == [PACKETS[0]]
    assert (decoder.pending, decoder.position) == (0, len(raw))


def test_the_shortest_and_the_longest_packet_fit(framing: Framing) -> None:
    longest = Packet(1, 1, bytes(framing.max_size - framing.overhead))
    assert len(framing.frame(longest)) == framing.max_size
    assert framing.decode(framing.frame(longest) + framing.frame(Packet(1, 1))) == [longest, Packet(1, 1)]
    with pytest.raises(ValueError):
        framing.frame(Packet(1, 1, bytes(framing.max_size - framing.overhead + 1)))


# Junk


def test_junk_before_between_and_behind_packets_is_noise(framing: Framing) -> None:
    frames = [framing.frame(packet) for packet in PACKETS]
    stream = b"\x01" + b"\x02\x03".join(frames) + b"\x04"
    events = cut(framing, stream, 1000)
    first, last, between = Noise(b"\x01"), Noise(b"\x04"), Noise(b"\x02\x03")
    assert events == [first, PACKETS[0], between, PACKETS[1], between, PACKETS[2], last]
    for size in (1, 3):
        events = cut(framing, stream, size)
        assert packets(events) == PACKETS
        assert noise(events) == b"\x01\x02\x03\x02\x03\x04"


def test_a_run_of_header_bytes_before_a_packet_does_not_hide_it(framing: Framing) -> None:
    raw = framing.frame(Packet(9, 3, b"\x01"))
    for count in range(1, 12):
        for size in (1, 1000):
            assert packets(cut(framing, framing.header[:1] * count + raw, size)) == [Packet(9, 3, b"\x01")]


def test_header_bytes_inside_a_packet_are_data(framing: Framing) -> None:
    packet = Packet(1, 1, framing.header + framing.header)
    assert framing.decode(framing.frame(packet) * 2) == [packet, packet]


def test_half_a_header_at_the_end_waits_for_the_other_half(framing: Framing) -> None:
    decoder = Decoder(framing)
    raw = framing.frame(PACKETS[0])
    assert decoder.feed(b"\x01" + raw[:1]) == []
    assert decoder.pending == 1
    assert decoder.feed(raw[1:]) == [Noise(b"\x01"), PACKETS[0]]


# Wrong checksums and lying lengths


def test_a_wrong_checksum_is_corrupt_and_the_next_packet_is_found(framing: Framing) -> None:
    raw = bytearray(framing.frame(PACKETS[0]))
    raw[-1] ^= 0x40
    corrupt, packet = framing.decode(bytes(raw) + framing.frame(PACKETS[1]))
    assert isinstance(corrupt, Corrupt)
    assert corrupt.raw == bytes(raw)
    assert corrupt.packet.id == PACKETS[0].id
    assert packet == PACKETS[1]


def test_a_packet_behind_a_false_header_is_found_once_the_lie_is_out(framing: Framing) -> None:
    raw = framing.frame(Packet(9, 3, b"\x01"))
    lie = LIES[type(framing)]
    decoder = Decoder(framing)
    events = decoder.feed(lie + raw * (framing.max_size // len(raw) + 2))
    assert isinstance(events[0], Corrupt)
    assert packets(events + decoder.flush()) == [Packet(9, 3, b"\x01")] * (framing.max_size // len(raw) + 2)


def test_a_packet_behind_a_false_header_is_found_when_the_line_goes_quiet(framing: Framing) -> None:
    lie = LIES[type(framing)][:3]
    decoder = Decoder(framing)
    raw = framing.frame(PACKETS[1])
    events = decoder.feed(lie + raw) + decoder.flush()
    assert packets(events) == [PACKETS[1]]
    assert decoder.pending == 0


def test_bytes_of_a_corrupt_are_not_told_again_as_noise(framing: Framing) -> None:
    raw = bytearray(framing.frame(Packet(1, 1, b"\x01\x02")))
    raw[-1] ^= 0x40
    events = framing.decode(bytes(raw) + b"\x07\x08")
    assert [type(event) for event in events] == [Corrupt, Noise]
    assert noise(events) == b"\x07\x08"


def test_who_waits_for_a_short_packet_does_not_wait_for_a_long_lie(framing: Framing) -> None:
    raw = framing.frame(Packet(1, 1))
    lie = LIES[type(framing)]
    decoder = Decoder(framing, len(raw))
    assert decoder.feed(lie + raw) == [Noise(lie), Packet(1, 1)]


def test_a_limit_above_the_longest_packet_changes_nothing(framing: Framing) -> None:
    decoder = Decoder(framing, 10_000)
    assert decoder.feed(framing.frame(PACKETS[0])) == [PACKETS[0]]


# Silence


def test_flush_tells_what_is_incomplete_as_noise_and_starts_afresh(framing: Framing) -> None:
    decoder = Decoder(framing)
    raw = framing.frame(PACKETS[0])
    assert decoder.feed(b"\x01" + raw[:-1]) == []
    assert decoder.flush() == [Noise(b"\x01" + raw[:-1])]
    assert decoder.flush() == []
    # The rest of that packet comes too late.
    assert decoder.feed(raw[-1:] + framing.frame(PACKETS[1])) == [Noise(raw[-1:]), PACKETS[1]]


def test_drop_forgets_what_is_incomplete(framing: Framing) -> None:
    decoder = Decoder(framing)
    raw = framing.frame(PACKETS[0])
    decoder.feed(b"\x01" + raw[:-1])
    assert decoder.drop() == raw[:-1]
    assert (decoder.pending, decoder.position) == (0, len(raw))
    assert decoder.feed(framing.frame(PACKETS[1])) == [PACKETS[1]]
    assert decoder.drop() == b""


# Work and memory


@pytest.mark.parametrize("chunk", [1, 64, 100_000])
def test_header_bytes_without_end_cost_linear_work_and_keep_less_than_a_packet(framing: Framing, chunk: int) -> None:
    counting = Counting(framing)
    decoder = Decoder(counting)
    for part in chunks(framing.header[:1] * 100_000, chunk):
        decoder.feed(part)
        assert decoder.pending < framing.max_size
    assert counting.sizes <= 2 * 100_000
    assert counting.unframes == 0


@pytest.mark.parametrize("chunk", [1, 64, 100_000])
def test_lies_without_end_cost_linear_work_and_keep_less_than_a_packet(framing: Framing, chunk: int) -> None:
    counting = Counting(framing)
    decoder = Decoder(counting)
    lie = LIES[type(framing)]
    for part in chunks(lie * 25_000, chunk):
        decoder.feed(part)
        assert decoder.pending < framing.max_size
    # Once per header it is taken apart, and once per chunk its size is asked again.
    assert counting.unframes <= 25_000
    assert counting.sizes <= 25_000 + 100_000


def test_a_flush_of_the_longest_lie_is_cheap(framing: Framing) -> None:
    counting = Counting(framing)
    decoder = Decoder(counting)
    decoder.feed((LIES[type(framing)] * framing.max_size)[: framing.max_size - 1])
    decoder.flush()
    assert counting.sizes <= framing.max_size**2 / 4
