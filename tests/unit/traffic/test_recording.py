"""The file format of recordings."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobus.errors import UsageError
from servobus.traffic.recording import (
    Chunk,
    Direction,
    Entry,
    Header,
    Recording,
    Speed,
    TapEnd,
    is_recording,
    line,
    parse,
)

HEAD = Header("/dev/ttyUSB0", 57_600, "dynamixel", "rx28", "2026-01-02T03:04:05.678+00:00")
LINES = (
    '# servobus recording 1 {"port": "/dev/ttyUSB0", "baud": 57600, "family": "dynamixel", "model": "rx28", '
    '"started": "2026-01-02T03:04:05.678+00:00"}\n'
    "0.001042 > FF FF 01 02 01 FB\n"
    "0.002314 < FF FF 01 02 00 FC\n"
    "0.500000 - 00\n"
    "1.000000 = 1000000\n"
    "61.250000 .\n"
)
ENTRIES: tuple[Entry, ...] = (
    Chunk(0.001042, Direction.OUT, bytes.fromhex("FF FF 01 02 01 FB")),
    Chunk(0.002314, Direction.IN, bytes.fromhex("FF FF 01 02 00 FC")),
    Chunk(0.5, Direction.UNKNOWN, b"\x00"),
    Speed(1.0, 1_000_000),
    TapEnd(61.25),
)
BARE = HEAD.line().rstrip("\n")


def refused(content: str) -> str:
    with pytest.raises(UsageError) as caught:
        parse(content.encode())
    return str(caught.value)


def test_what_is_written() -> None:
    assert HEAD.line() + "".join(map(line, ENTRIES)) == LINES


def test_what_is_read() -> None:
    assert parse(LINES.encode()) == Recording(HEAD, ENTRIES, cut=False)
    assert parse(LINES.replace("\n", "\r\n").encode()).entries == ENTRIES  # as an editor may leave it


@given(
    st.lists(
        st.tuples(st.floats(0, 1e6), st.sampled_from(Direction), st.binary(min_size=1, max_size=40)),
        max_size=10,
    ),
    st.text(max_size=20),
)
def test_round_trip(pieces: list[tuple[float, Direction, bytes]], port: str) -> None:
    entries: list[Entry] = [Chunk(*piece) for piece in sorted(pieces, key=lambda piece: piece[0])]
    head = Header(port, 1, started="now")
    assert parse((head.line() + "".join(map(line, entries))).encode("ascii")) == Recording(head, tuple(entries))


@pytest.mark.parametrize("length", range(len(BARE) + 1, len(LINES)))
def test_cut_off_anywhere(length: int) -> None:
    content = LINES[:length]
    whole = content.count("\n") - 1
    assert parse(content.encode()) == Recording(HEAD, ENTRIES[:whole], cut=not content.endswith("\n"))


def test_cut_off_by_the_power() -> None:
    """The file has its new length; the bytes did not get there."""
    whole = "".join(LINES.splitlines(keepends=True)[:3])
    assert parse(whole.encode() + b"0.5000" + b"\0" * 100) == Recording(HEAD, ENTRIES[:2], cut=True)
    assert parse(whole.encode() + b"\0" * 100) == Recording(HEAD, ENTRIES[:2], cut=True)


def test_cut_off_at_once() -> None:
    assert "there is nothing in it" in refused(BARE)
    assert "there is nothing in it" in refused(BARE[:30])


@pytest.mark.parametrize(
    "bad",
    [
        "",
        "hello",
        "0.5 > FF GG",
        "0.5 >",
        "0.5 > ",
        "0.5 ? FF",
        "0.5 = fast",
        "0.5 = 0",
        "0.5 . 1",
        "x > FF",
        "nan > FF",
        "inf > FF",
        "> FF",
    ],
)
def test_a_line_that_is_none(bad: str) -> None:
    assert refused(f"{BARE}\n0.1 > FF\n{bad}\n0.7 > FF\n") == f"line 3 is no line of a recording: {bad!r}"


def test_time_does_not_go_back() -> None:
    assert refused(f"{BARE}\n0.2 > FF\n0.1 > FF\n") == "line 3: 0.100000 s is before the line above it"
    assert "line 2" in refused(f"{BARE}\n-0.1 > FF\n")


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ("", "line 1"),
        ("[]", "line 1"),
        ("{}", "line 1"),
        ('{"port": "x"}', "line 1"),
        ('{"port": "x", "baud": 0}', "baud is 0"),
        ('{"port": "x", "baud": "9600"}', "baud is '9600'"),
        ('{"port": 1, "baud": 9600}', "port is 1"),
        ('{"port": "x", "baud": 9600, "family": 3}', "family is 3"),
    ],
)
def test_a_bad_head(fields: str, why: str) -> None:
    assert why in refused(f"# servobus recording 1 {fields}\n")


def test_formats_to_come() -> None:
    assert "format '2' is not known here" in refused("# servobus recording 2 {}\n")
    more = json.dumps({"port": "x", "baud": 9600, "colour": "blue"})
    assert parse(f"# servobus recording 1 {more}\n".encode()).header == Header("x", 9600)


def test_a_recording_is_told_from_other_files() -> None:
    assert is_recording(LINES.encode())
    assert not is_recording(b"FF FF 01 02 01 FB")
    assert not is_recording(bytes.fromhex("FF FF 01 02 01 FB"))
