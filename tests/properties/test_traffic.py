"""The tracker under anything that a line can carry: it never fails, loses no byte, and the clock changes nothing."""

from hypothesis import given
from hypothesis import strategies as st

from golden.golden import load
from servobus.families.base import Family
from servobus.families.registry import FAMILIES
from servobus.traffic.events import EventKind, TrafficEvent
from servobus.traffic.recording import Chunk, Direction, Entry, Header, Speed, TapEnd, line, parse
from servobus.traffic.tracker import Tracker

PACKETS = [case.packet for family in FAMILIES for case in load(family)]

pieces = st.one_of(
    st.sampled_from(PACKETS),
    st.binary(min_size=1, max_size=12),
    st.sampled_from([b"\xff\xff", b"\x55\x55", b"\xff\xff\x01\x8b", b"\xff\xff\xdf\x01"]),
    st.tuples(st.sampled_from(PACKETS), st.integers(0, 99), st.integers(1, 255)).map(
        lambda hurt: bytes(byte ^ (hurt[2] if at == hurt[1] % len(hurt[0]) else 0) for at, byte in enumerate(hurt[0]))
    ),
    st.lists(st.sampled_from(PACKETS), min_size=2, max_size=3).map(b"".join),
)
gaps = st.sampled_from([0.0, 0.0005, 0.003, 0.049, 0.05, 0.06, 0.099, 0.11, 0.5, 1.5])
traffic = st.lists(st.tuples(gaps, st.sampled_from(Direction), pieces), max_size=14)
speeds = st.sampled_from([9600, 57_600, 1_000_000])
families = st.sampled_from([None, *FAMILIES.values()])


def entries(script: list[tuple[float, Direction, bytes]]) -> list[Entry]:
    time, made = 0.0, list[Entry]()
    for gap, direction, data in script:
        time += gap
        made.append(Chunk(time, direction, data))
    return [*made, Speed(time, 115_200), TapEnd(time + 2)]


def watch(tracker: Tracker, script: list[Entry]) -> list[TrafficEvent]:
    return [sight for entry in script for sight in tracker.feed(entry)] + tracker.finish()


@given(traffic, families, speeds)
def test_every_byte_is_shown(script: list[tuple[float, Direction, bytes]], family: Family | None, baud: int) -> None:
    seen = watch(Tracker(family, baud=baud), entries(script))
    for direction in Direction:
        sent = b"".join(data for _, to, data in script if to is direction)
        shown = [sight for sight in seen if sight.direction is direction]
        raw = b"".join(sight.raw for sight in shown)
        # A corrupt packet may lie across the one that hides in it: then bytes are shown twice.
        assert raw == sent or (any(one.kind is EventKind.CORRUPT for one in shown) and len(raw) >= len(sent))
    assert all(sight.time >= 0 for sight in seen)


@given(traffic, families, speeds, st.sampled_from([0.001, 0.007, 0.02, 0.3]))
def test_looking_at_the_clock_changes_nothing(
    script: list[tuple[float, Direction, bytes]], family: Family | None, baud: int, step: float
) -> None:
    plain, live = Tracker(family, baud=baud), Tracker(family, baud=baud)
    seen = list[TrafficEvent]()
    for entry in entries(script):
        while live.time + step < entry.time:
            seen += live.pass_time(live.time + step)
        seen += live.feed(entry)
    assert seen + live.finish() == watch(plain, entries(script))
    assert live.servos == plain.servos


@given(traffic, families, speeds)
def test_a_recording_says_the_same(
    script: list[tuple[float, Direction, bytes]], family: Family | None, baud: int
) -> None:
    made = entries(script)
    text = Header("port", baud).line() + "".join(line(entry) for entry in made)
    read = list(parse(text.encode()).entries)
    assert watch(Tracker(family, baud=baud), read) == watch(Tracker(family, baud=baud), made)


@given(traffic, families, speeds)
def test_the_counts_add_up(script: list[tuple[float, Direction, bytes]], family: Family | None, baud: int) -> None:
    tracker = Tracker(family, baud=baud)
    kinds = [sight.kind for sight in watch(tracker, entries(script))]
    assert sum(tally.requests for tally in tracker.servos) == kinds.count(EventKind.REQUEST)
    assert sum(tally.missing for tally in tracker.servos) == kinds.count(EventKind.SILENCE)
    assert tracker.corrupt == kinds.count(EventKind.CORRUPT)
    for tally in tracker.servos:
        assert tally.answered + tally.failed <= tally.requests
        assert tally.latencies.total() <= kinds.count(EventKind.ANSWER)
