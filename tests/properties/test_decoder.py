"""The decoder against streams that nobody thought of."""

from itertools import groupby

from hypothesis import given
from hypothesis import strategies as st

from servobus.core.framing import Corrupt, Decoder, Event, Framing, Noise, Packet
from servobus.families.dynamixel.protocol import Dynamixel1Framing
from servobus.families.herkulex.protocol import HerkulexFraming
from servobus.families.lewansoul.protocol import LewansoulFraming

FRAMINGS: list[Framing] = [HerkulexFraming(), Dynamixel1Framing(), LewansoulFraming()]


@st.composite
def packets(draw: st.DrawFn, framing: Framing) -> Packet:
    longest = min(8, framing.max_size - framing.overhead)
    data = st.binary(max_size=longest) | st.just(framing.header[:1] * longest)
    return Packet(draw(st.integers(0, 254)), draw(st.integers(0, 254)), draw(data))


@st.composite
def streams(draw: st.DrawFn, framing: Framing) -> bytes:
    """Pieces of everything: packets, broken and cut ones, headers, small numbers that pass for lengths."""
    frames = packets(framing).map(framing.frame)
    bad = st.tuples(frames, st.integers(2, 12), st.integers(1, 255)).map(
        lambda parts: bytes(b ^ parts[2] if n == parts[1] else b for n, b in enumerate(parts[0]))
    )
    cut = st.tuples(frames, st.integers(1, 12)).map(lambda parts: parts[0][: parts[1]])
    header = st.integers(1, 5).map(lambda count: framing.header[:1] * count)
    small = st.lists(st.integers(0, 12), max_size=4).map(bytes)
    pieces = st.lists(frames | bad | cut | header | small | st.binary(max_size=6), max_size=12)
    return b"".join(draw(pieces))


cases = st.sampled_from(FRAMINGS).flatmap(lambda framing: st.tuples(st.just(framing), streams(framing)))
cuts = st.lists(st.integers(1, 20), min_size=1, max_size=10)


def fed(framing: Framing, stream: bytes, sizes: list[int]) -> list[Event]:
    """Decode a stream in chunks of these sizes, over and over."""
    decoder = Decoder(framing)
    events: list[Event] = []
    at = turn = 0
    while at < len(stream):
        size = sizes[turn % len(sizes)]
        events += decoder.feed(stream[at : at + size])
        assert decoder.pending < framing.max_size
        at, turn = at + size, turn + 1
    events += decoder.flush()
    assert (decoder.pending, decoder.position) == (0, len(stream))
    return events


def joined(events: list[Event]) -> list[Event]:
    """Join noise to noise: where it is cut depends on the chunks."""
    result: list[Event] = []
    for is_noise, group in groupby(events, lambda event: isinstance(event, Noise)):
        found = list(group)
        result += [Noise(b"".join(event.raw for event in found if isinstance(event, Noise)))] if is_noise else found
    return result


def size_of(framing: Framing, event: Packet | Corrupt) -> int:
    return len(event.raw) if isinstance(event, Corrupt) else framing.overhead + len(event.data)


@given(cases, cuts)
def test_chunks_do_not_matter(case: tuple[Framing, bytes], sizes: list[int]) -> None:
    framing, stream = case
    assert joined(fed(framing, stream, sizes)) == joined(framing.decode(stream))


@given(cases, cuts)
def test_it_finds_what_looking_at_every_byte_finds(case: tuple[Framing, bytes], sizes: list[int]) -> None:
    framing, stream = case
    found: list[tuple[Packet, int]] = []
    at = 0
    while at < len(stream):
        size = framing.size(stream, at) if stream.startswith(framing.header, at) else 0
        if 0 < size <= len(stream) - at:
            packet, good = framing.unframe(stream[at : at + size])
            if good:
                found.append((packet, at + size))
                at += size
                continue
        at += 1
    events = fed(framing, stream, sizes)
    assert [(event, event.end) for event in events if isinstance(event, Packet)] == found


@given(cases, cuts)
def test_every_byte_is_told_and_none_of_a_packet_as_noise(case: tuple[Framing, bytes], sizes: list[int]) -> None:
    framing, stream = case
    events = fed(framing, stream, sizes)
    shaped: set[int] = set()
    for event in events:
        if not isinstance(event, Noise):
            end = event.packet.end if isinstance(event, Corrupt) else event.end
            shaped |= set(range(end - size_of(framing, event), end))
    rest = bytes(byte for at, byte in enumerate(stream) if at not in shaped)
    assert b"".join(event.raw for event in events if isinstance(event, Noise)) == rest


@given(st.data(), st.sampled_from(FRAMINGS), cuts)
def test_packets_in_junk_without_header_bytes_are_all_found(
    data: st.DataObject, framing: Framing, sizes: list[int]
) -> None:
    junk = st.binary(max_size=20).map(lambda raw: raw.replace(framing.header[:1], b""))
    meant = data.draw(st.lists(packets(framing), max_size=8))
    stream = b"".join(data.draw(junk) + framing.frame(packet) for packet in meant) + data.draw(junk)
    events = fed(framing, stream, sizes)
    assert [event for event in events if isinstance(event, Packet)] == meant
    assert not any(isinstance(event, Corrupt) for event in events)


@given(st.data(), st.sampled_from(FRAMINGS))
def test_what_is_framed_is_unframed(data: st.DataObject, framing: Framing) -> None:
    packet = data.draw(packets(framing))
    raw = framing.frame(packet)
    assert framing.size(raw, 0) == len(raw)
    assert framing.unframe(raw) == (packet, True)
    assert framing.decode(raw) == [packet]
