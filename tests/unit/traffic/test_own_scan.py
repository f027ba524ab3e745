"""What servobus itself sends, read by the tracker (N18): a scan of all families on one line, without a false alarm."""

from collections import Counter

import pytest

import servobus
from golden.golden import load
from servobus.families.registry import DRS0602, FAMILIES, LX16A, RX28
from servobus.traffic.events import EventKind, TrafficEvent, Trouble
from servobus.traffic.recording import Chunk, Direction, Entry
from servobus.traffic.tracker import Tracker
from servobus.transports.tap import TapTransport
from servobus.virtual.serve.inprocess import connect

GOLDEN = {(family, case.name): case.packet for family in FAMILIES for case in load(family)}
SPEC = "virtual:rx28@1-4,rx28@219,drs0602@2,drs0602@219,lx16a@7,lx16a@10,lx16a@253?clock=virtual"
"""No RX-28 has id 7 or 9, the sizes of HerkuleX packets: it would answer these, whose checksum is wrong to it."""
SPEEDS = [57_600, 115_200, 1_000_000]
HARMLESS = {None, Trouble.SILENT}
"""A scan asks who is not there."""


@pytest.fixture(scope="module")
def scan() -> list[Entry]:
    """A scan of all ids of all families at three speeds."""
    carried: list[Entry] = []
    tap = TapTransport(connect(SPEC), carried.append, heard=Direction.IN)
    found = servobus.Bus(tap).scan(bauds=SPEEDS)
    assert {(servo.family.name, servo.id) for servo in found} >= {
        ("dynamixel", 1), ("dynamixel", 219), ("herkulex", 2), ("herkulex", 219), ("lewansoul", 7), ("lewansoul", 253),
    }  # fmt: skip
    return carried


def heard(entries: list[Entry]) -> list[Entry]:
    """The same as a second adapter hears it: nobody says who sends."""
    return [Chunk(one.time, Direction.UNKNOWN, one.data) if isinstance(one, Chunk) else one for one in entries]


def glued(entries: list[Entry]) -> list[Entry]:
    """The same in pieces as an adapter with a latency timer of 16 ms hands them over."""
    pieces: dict[tuple[int, Direction], bytes] = {}
    for one in entries:
        if isinstance(one, Chunk):
            key = int(one.time / 0.016), one.direction
            pieces[key] = pieces.get(key, b"") + one.data
    return [Chunk((slot + 1) * 0.016, direction, data) for (slot, direction), data in pieces.items()]


def watch(tracker: Tracker, entries: list[Entry]) -> list[TrafficEvent]:
    return [event for entry in entries for event in tracker.feed(entry)] + tracker.finish()


@pytest.mark.parametrize("way", ["between", "listening"])
def test_N18_a_scan_of_all_families_has_no_junk_and_no_alarm(scan: list[Entry], way: str) -> None:
    tracker = Tracker(baud=115_200)
    events = watch(tracker, scan if way == "between" else heard(scan))
    assert {event.trouble for event in events} <= HARMLESS
    assert (tracker.junk, tracker.corrupt, tracker.cut_short) == (0, 0, 0)
    assert "CHECKSUM" not in " ".join(event.text for event in events)
    asked = Counter(event.family.name for event in events if event.kind is EventKind.REQUEST and event.family)
    assert all(asked[name] >= 254 for name in ("dynamixel", "herkulex", "lewansoul"))
    assert {event.kind for event in events if event.raw.strip(b"\0") == b"" and event.raw} <= {
        EventKind.PADDING, EventKind.PROBE,
    }  # fmt: skip


def test_N18_a_scan_in_the_pieces_of_a_slow_adapter(scan: list[Entry]) -> None:
    tracker = Tracker(baud=115_200)
    watch(tracker, glued(heard(scan)))
    assert (tracker.junk, tracker.corrupt, tracker.cut_short) == (0, 0, 0)


@pytest.mark.parametrize("name", ["dynamixel", "herkulex", "lewansoul"])
def test_N18_with_one_family_the_others_are_other_traffic(scan: list[Entry], name: str) -> None:
    tracker = Tracker(FAMILIES[name], baud=115_200)
    events = watch(tracker, scan)
    assert (tracker.junk, tracker.corrupt, tracker.cut_short) == (0, 0, 0)
    assert {event.trouble for event in events} <= HARMLESS
    assert {servo.family.name for servo in tracker.servos} == {name}
    others = {event.family.name for event in events if event.kind is EventKind.OTHER and event.family}
    assert others == {"dynamixel", "herkulex", "lewansoul"} - {name}


@pytest.mark.parametrize("id", [2, 7, 8, 219, 253])
def test_N18_the_request_of_a_herkulex_is_no_damaged_status(id: int) -> None:
    """FF FF 07 .. may begin a Dynamixel packet of id 7."""
    stat = DRS0602.family.ping(id).request
    for pieces in ([stat], [stat[:n] + b"" for n in (3,)] + [stat[3:]], [bytes((byte,)) for byte in stat]):
        tracker = Tracker()
        events = [
            event for n, piece in enumerate(pieces) for event in tracker.feed(Chunk(0.0001 * n, Direction.OUT, piece))
        ] + tracker.finish()
        assert [(event.kind, event.text) for event in events] == [(EventKind.REQUEST, f"STAT id {id}")]


def test_N18_the_checksum_tells_between_two_families() -> None:
    """FF FF 07 02 07 02 FC is a STAT of id 2 and has the shape of a Dynamixel packet of id 7; so has its answer."""
    stat, ping = DRS0602.family.ping(2).request, RX28.family.ping(7).request
    tracker = Tracker()
    events = watch(tracker, [Chunk(0.0, Direction.OUT, ping + stat + ping + stat)])
    assert [event.family.name for event in events if event.family and event.raw] == ["dynamixel", "herkulex"] * 2


def test_N18_padding_is_named_and_is_no_junk() -> None:
    stat = GOLDEN["herkulex", "stat_request"]
    tracker = Tracker()
    events = watch(tracker, [Chunk(0.0, Direction.OUT, stat + bytes(12) + stat)])
    assert [event.kind for event in events if event.raw] == [EventKind.REQUEST, EventKind.PADDING, EventKind.REQUEST]
    assert events[1].text == "padding: 12 bytes between requests, which servos skip"
    assert tracker.junk == 0


def test_N18_zeros_that_nobody_sent_are_junk() -> None:
    tracker = Tracker()
    stat, answer = GOLDEN["herkulex", "stat_request"], GOLDEN["herkulex", "stat_reply"]
    events = watch(tracker, [Chunk(0.0, Direction.OUT, stat), Chunk(0.003, Direction.IN, bytes(3) + answer)])
    assert [event.kind for event in events] == [EventKind.REQUEST, EventKind.NOISE, EventKind.ANSWER]
    assert tracker.junk == 3


def test_N18_damage_is_read_as_the_family_that_was_asked() -> None:
    """FF FF 09 02 .. has the shape of a Dynamixel packet of id 9 as well."""
    stat = DRS0602.family.ping(2).request
    answer = bytes.fromhex("FF FF 09 02 47 4C B2 00 40")  # 09 ^ 02 ^ 47 ^ 00 ^ 40 = 0C: checksum 0C, F2
    tracker = Tracker()
    events = watch(tracker, [Chunk(0.0, Direction.OUT, stat), Chunk(0.003, Direction.IN, answer)])
    assert events[1].family is DRS0602.family
    assert events[1].text.startswith("CHECKSUM WRONG: would be ACK of STAT from id 2")


def test_N18_three_families_take_turns_in_one_piece() -> None:
    data = GOLDEN["dynamixel", "ex3_ping"] + GOLDEN["herkulex", "stat_request"] + GOLDEN["lewansoul", "pos_read"]
    tracker = Tracker()
    events = watch(tracker, [Chunk(0.0, Direction.UNKNOWN, data * 3)])
    names = [event.family.name for event in events if event.kind is EventKind.REQUEST and event.family]
    assert names == ["dynamixel", "herkulex", "lewansoul"] * 3
    assert LX16A.family.name in names
    assert tracker.junk == 0
