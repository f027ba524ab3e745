from servobus.families.registry import RX28
from servobus.traffic.present import (
    COLUMNS,
    event_entry,
    event_lines,
    packet_entries,
    summary_entry,
    table,
    totals_text,
)  # fmt: skip
from servobus.traffic.recording import Chunk, Direction, TapEnd
from servobus.traffic.tracker import Tracker

PING = bytes.fromhex("FF FF 01 02 01 FB")
PONG = bytes.fromhex("FF FF 01 02 00 FC")
READ = bytes.fromhex("FF FF 01 04 02 2B 01 CC")
"""READ_DATA of present_temperature, and its answer 32 °C: RX-28 manual 3-5-2."""
HEAT = bytes.fromhex("FF FF 01 03 00 20 DB")


def test_events() -> None:
    tracker = Tracker(baud=57_600)
    (request,) = tracker.feed(Chunk(0.001, Direction.OUT, PING))
    (answer,) = tracker.feed(Chunk(0.0035, Direction.IN, PONG))
    assert event_entry(request)["hex"] == "FF FF 01 02 01 FB"
    entry = event_entry(answer)
    assert (entry["kind"], entry["direction"], entry["id"], entry["trouble"]) == ("answer", "<", 1, None)
    # The request is out 60 bits after 1 ms: 1.0417 ms at 57600 baud.
    assert abs(entry["latency"] - 0.0014583) < 1e-6
    (line,), text = event_lines(answer)
    assert " ".join(line.split()) == "0.003500 < FF FF 01 02 00 FC +1.46 ms"
    assert text.strip() == "status of id 1: ok"
    _, text = event_lines(request)
    assert text.strip() == "PING id 1"


def test_a_long_packet_takes_several_lines_and_no_line_is_wide() -> None:
    tracker = Tracker(baud=57_600)
    data = bytes.fromhex("FE 22 83 1E 04") + b"".join(bytes((id, 0, 2, 0, 2)) for id in range(1, 7))
    data = b"\xff\xff" + data + bytes((~sum(data) & 0xFF,))
    (event,) = tracker.feed(Chunk(0.5, Direction.OUT, data))
    lines, text = event_lines(event)
    assert len(lines) > 1
    assert text.count("\n") > 0
    assert max(map(len, [*lines, *text.split("\n")])) <= 80


def test_a_line_is_no_wider_after_hours() -> None:
    tracker = Tracker(baud=57_600)
    data = bytes.fromhex("FF FF 01 0E 00") + bytes(12)
    tracker.feed(Chunk(123_456.0, Direction.OUT, bytes.fromhex("FF FF 01 04 02 18 0C D4")))
    (answer,) = tracker.feed(Chunk(123_456.1, Direction.IN, data + bytes((~sum(data[2:]) & 0xFF,))))
    lines, text = event_lines(answer)
    assert lines[0].startswith("123456.100000 < FF FF 01 0E 00 00")
    assert lines[0].endswith(" ms")
    assert max(map(len, [*lines, *text.split("\n")])) <= 80


def test_what_it_comes_to() -> None:
    tracker = Tracker(baud=57_600)
    for time, direction, data in (
        (0.001, Direction.OUT, PING), (0.0035, Direction.IN, PONG), (1.0, Direction.OUT, PING),
    ):  # fmt: skip
        tracker.feed(Chunk(time, direction, data))
    tracker.feed(TapEnd(2.0))
    summary = summary_entry(tracker)
    assert (summary["time"], summary["junk"], summary["corrupt"]) == (2.0, 0, 0)
    (servo,) = summary["servos"]
    assert (servo["id"], servo["requests"], servo["answers"], servo["missing"]) == (1, 2, 1, 1)
    assert servo["error_rate"] == 0.5
    (row,) = table(tracker)
    assert dict(zip(COLUMNS, row, strict=True))["errors"] == "50 %"
    assert totals_text(tracker) == "2.0 s; 0 bytes of junk, 0 packets with a wrong checksum"


def test_packets_and_what_is_between_them() -> None:
    data = READ + HEAT + b"\x00" + HEAT[:-1] + b"\x00"
    entries = packet_entries(data, model=RX28)
    assert [(one["offset"], one["kind"], one["id"]) for one in entries] == [
        (0, "packet", 1), (8, "packet", 1), (15, "noise", None), (16, "corrupt", 1),
    ]  # fmt: skip
    assert bytes.fromhex("".join(one["hex"] for one in entries)) == data
    texts = [one["text"] for one in entries]
    assert texts[1] == "status of id 1: ok, present_temperature 32 °C"
    assert texts[2] == "JUNK: a byte that is no packet"
    assert texts[3].startswith("CHECKSUM WRONG: would be status of id 1")
