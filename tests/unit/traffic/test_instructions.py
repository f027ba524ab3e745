"""Every instruction of protocol 1.0 in use, and values whose model is not known (T6). Checksums by hand."""

from collections.abc import Callable
from typing import Any

import pytest

from servobus.errors import Refused
from servobus.families.dynamixel import protocol
from servobus.families.registry import DRS0602, FAMILIES, RX28
from servobus.traffic.events import EventKind, TrafficEvent, Trouble
from servobus.traffic.present import packet_entries
from servobus.traffic.recording import Chunk, Direction
from servobus.traffic.tracker import Tracker
from unit.cli.conftest import load, run  # noqa: F401 - fixtures

OUT, IN, UNKNOWN = Direction.OUT, Direction.IN, Direction.UNKNOWN


def frame(body: str) -> bytes:
    """Put a packet into its frame: FF FF before it, ~sum behind it (RX-28 manual 3-2)."""
    data = bytes.fromhex(body)
    return b"\xff\xff" + data + bytes((~sum(data) & 0xFF,))


BULK_READ = frame("FE 09 92 00 02 01 1E 02 02 24")
"""ROBOTIS e-manual, Protocol 1.0, Bulk Read: 2 bytes from 30 of id 1, 2 bytes from 36 of id 2."""
SYNC_READ = frame("FE 06 84 24 02 01 02")
"""USB2AX: 2 bytes from 36 of ids 1 and 2."""
OF_1, OF_2 = frame("01 04 00 00 02"), frame("02 04 00 20 03")
OF_BOTH = frame("FD 06 00 00 02 20 03")
PING_ALL = frame("FE 02 01")
PONGS = frame("01 02 00") + frame("02 02 00") + frame("03 02 00")


def watch(*script: tuple[float, Direction, bytes], tracker: Tracker | None = None) -> list[TrafficEvent]:
    tracker = tracker or Tracker()
    entries = [Chunk(time, direction, data) for time, direction, data in script]
    return [event for entry in entries for event in tracker.feed(entry)] + tracker.finish()


def said(events: list[TrafficEvent]) -> list[str]:
    return [event.text for event in events]


def troubles(events: list[TrafficEvent]) -> list[Trouble]:
    return [event.trouble for event in events if event.trouble]


# Instructions


@pytest.mark.parametrize("sides", [(OUT, IN), (UNKNOWN, UNKNOWN)], ids=["between", "listening"])
def test_T6_bulk_read(sides: tuple[Direction, Direction]) -> None:
    tracker = Tracker()
    events = watch((0.0, sides[0], BULK_READ), (0.002, sides[1], OF_1 + OF_2), tracker=tracker)
    assert said(events) == [
        "BULK_READ to all, for ids 1, 2: id 1: 2 bytes from address 30; id 2: 2 bytes from address 36",
        "status of id 1: ok, address 30: 00 02",
        "status of id 2: ok, address 36: 20 03",
    ]
    assert troubles(events) == []
    assert [(servo.id, servo.answers) for servo in tracker.servos] == [(1, 1), (2, 1), (254, 0)]


def test_T6_a_servo_that_a_bulk_read_misses_is_missing() -> None:
    events = watch((0.0, OUT, BULK_READ), (0.002, IN, OF_1), (1.0, OUT, PING_ALL))
    assert [(event.id, event.trouble) for event in events if event.trouble] == [(2, Trouble.SILENT)]


def test_T6_a_bulk_read_with_units() -> None:
    events = watch((0.0, OUT, BULK_READ), (0.002, IN, OF_1 + OF_2), tracker=Tracker(model=RX28))
    assert said(events)[1:] == [
        "status of id 1: ok, goal_position 150.1°",
        "status of id 2: ok, present_position 234.6°",
    ]


@pytest.mark.parametrize("code", [0x84, 0x82])
@pytest.mark.parametrize("sides", [(OUT, IN), (UNKNOWN, UNKNOWN)], ids=["between", "listening"])
def test_T6_sync_read(code: int, sides: tuple[Direction, Direction]) -> None:
    request = frame(f"FE 06 {code:02X} 24 02 01 02")
    events = watch((0.0, sides[0], request), (0.002, sides[1], OF_1 + OF_2))
    assert said(events) == [
        "SYNC_READ to all, for ids 1, 2: 2 bytes from address 36",
        "status of id 1: ok, address 36: 00 02",
        "status of id 2: ok, address 36: 20 03",
    ]
    assert troubles(events) == []


def test_T6_a_sync_read_that_an_adapter_answers_for_all() -> None:
    events = watch((0.0, OUT, SYNC_READ), (0.002, IN, OF_BOTH), (1.0, OUT, SYNC_READ), (1.002, IN, OF_BOTH))
    assert troubles(events) == []
    assert events[1].text == (
        "status of id 253: ok, for all that were asked; id 1: address 36: 00 02; id 2: address 36: 20 03"
    )


def test_T6_a_sync_read_does_not_make_commands_answered() -> None:
    write = frame("01 04 03 19 01")
    events = watch((0.0, OUT, SYNC_READ), (0.002, IN, OF_1 + OF_2), (1.0, OUT, write), (2.0, OUT, write))
    assert troubles(events) == []


@pytest.mark.parametrize("sides", [(OUT, IN), (UNKNOWN, UNKNOWN)], ids=["between", "listening"])
def test_T6_ping_to_all_and_its_answers(sides: tuple[Direction, Direction]) -> None:
    tracker = Tracker()
    events = watch((0.0, sides[0], PING_ALL), (0.002, sides[1], PONGS), (1.0, sides[0], PING_ALL), tracker=tracker)
    assert said(events)[:4] == [
        "PING to all", "status of id 1: ok", "status of id 2: ok", "status of id 3: ok",
    ]  # fmt: skip
    assert troubles(events) == []
    assert [(servo.id, servo.answers, servo.other) for servo in tracker.servos[:3]] == [(1, 1, 0), (2, 1, 0), (3, 1, 0)]


def test_T6_a_ping_to_all_that_nobody_answers_is_no_trouble() -> None:
    assert troubles(watch((0.0, OUT, PING_ALL), (1.0, OUT, PING_ALL))) == []


def test_T6_the_echo_of_a_ping_to_all_is_an_echo() -> None:
    events = watch((0.0, OUT, PING_ALL), (0.001, IN, PING_ALL + PONGS))
    assert [event.kind for event in events] == [EventKind.REQUEST, EventKind.ECHO, *[EventKind.ANSWER] * 3]


def test_T6_a_stranger_is_still_one() -> None:
    events = watch((0.0, OUT, BULK_READ), (0.002, IN, OF_1 + frame("03 04 00 20 03") + OF_2))
    assert [(event.id, event.trouble) for event in events if event.trouble] == [(3, Trouble.STRANGER)]
    assert troubles(watch((0.0, IN, OF_1))) == [Trouble.UNASKED]


def test_T6_an_instruction_nobody_knows_is_a_request() -> None:
    events = watch((0.0, UNKNOWN, frame("01 03 95 07")), (0.5, UNKNOWN, frame("FE 02 0A")))
    assert [(event.kind, event.text) for event in events] == [
        (EventKind.REQUEST, "undefined instruction 0x95, id 1, data 07"),
        (EventKind.REQUEST, "undefined instruction 0x0a, to all"),
    ]


def test_T6_instructions_both_ways() -> None:
    for message in (
        protocol.BulkRead((protocol.ReadData(1, 30, 2), protocol.ReadData(2, 36, 2))),
        protocol.SyncRead(36, 2, (1, 2)),
    ):
        (event,) = protocol.FRAMING.decode(protocol.encode(message))
        assert protocol.parse_instruction(event) == message  # type: ignore[arg-type] # it is a packet
    assert protocol.encode(protocol.BulkRead((protocol.ReadData(1, 30, 2), protocol.ReadData(2, 36, 2)))) == BULK_READ
    assert protocol.encode(protocol.SyncRead(36, 2, (1, 2))) == SYNC_READ


def test_T6_error_bit_7_is_refused_in_words_and_by_the_driver() -> None:
    (answer,) = packet_entries(frame("01 02 80"))
    assert answer["text"] == "status of id 1: refused, 0x80"
    (event,) = protocol.FRAMING.decode(frame("01 02 80"))
    with pytest.raises(Refused, match="error 0x80"):
        protocol.reset(1).interpret(event)  # type: ignore[arg-type] # it is a packet


# Whose registers


def test_T6_without_a_model_values_are_bytes() -> None:
    write = frame("01 07 03 1E 00 02 00 02")
    assert said(watch((0.0, OUT, write))) == ["WRITE_DATA id 1: address 30: 00 02 00 02"]
    assert said(watch((0.0, OUT, write), tracker=Tracker(RX28.family))) == ["WRITE_DATA id 1: address 30: 00 02 00 02"]
    assert said(watch((0.0, OUT, write), tracker=Tracker(model=RX28))) == [
        "WRITE_DATA id 1: goal_position 150.1°, moving_speed 341.0°/s"
    ]


NUMBER, RX, STRANGE = frame("01 04 02 00 02"), frame("01 04 00 1C 00"), frame("01 04 00 24 04")
POSITION, HERE = frame("01 04 02 24 02"), frame("01 04 00 00 02")


def test_T6_a_model_number_in_the_traffic_tells_the_model() -> None:
    events = watch(
        (0.0, OUT, POSITION), (0.002, IN, HERE), (0.1, OUT, NUMBER), (0.102, IN, RX),
        (0.2, OUT, POSITION), (0.202, IN, HERE),
    )  # fmt: skip
    assert said(events) == [
        "READ_DATA id 1: 2 bytes from address 36",
        "status of id 1: ok, address 36: 00 02",
        "READ_DATA id 1: 2 bytes from address 0",
        "status of id 1: ok, model_number 28; id 1 is of model RX-28: from here on its registers are shown",
        "READ_DATA id 1: 2 bytes from address 36, present_position",
        "status of id 1: ok, present_position 150.1°",
    ]


def test_T6_it_tells_the_model_of_that_servo_alone() -> None:
    other = frame("02 04 02 24 02")
    events = watch((0.0, OUT, NUMBER), (0.002, IN, RX), (0.1, OUT, other))
    assert events[-1].text == "READ_DATA id 2: 2 bytes from address 36"
    both = frame("FE 0A 83 1E 02 01 00 02 02 00 02")
    assert (
        "id 1: goal_position 150.1°; id 2: address 30: 00 02"
        in watch((0.0, OUT, NUMBER), (0.002, IN, RX), (0.1, OUT, both))[-1].text
    )


def test_T6_an_unknown_model_stays_unknown() -> None:
    events = watch((0.0, OUT, NUMBER), (0.002, IN, STRANGE), (0.1, OUT, POSITION), (0.102, IN, HERE))
    assert events[1].text == (
        "status of id 1: ok, address 0: 24 04; id 1 is of model 1060, which is not known here: its registers stay bytes"
    )
    assert events[3].text == "status of id 1: ok, address 36: 00 02"


def test_T6_another_servo_under_the_same_id_is_noticed() -> None:
    events = watch(
        (0.0, OUT, NUMBER), (0.002, IN, RX), (0.1, OUT, NUMBER), (0.102, IN, STRANGE),
        (0.2, OUT, POSITION), (0.202, IN, HERE),
    )  # fmt: skip
    assert events[-1].text == "status of id 1: ok, address 36: 00 02"


def test_T6_the_model_of_a_herkulex() -> None:
    herkulex = DRS0602.family
    ask = next(iter([herkulex.identify(2).send(None)])).request  # type: ignore[union-attr] # an exchange
    # EEP 0 to 3: 06 02 00 90; 0F ^ 02 ^ 42 ^ 00 ^ 04 ^ 06 ^ 02 ^ 00 ^ 90 ^ 00 ^ 40 = 9F: 9E, 60
    answer = bytes.fromhex("FF FF 0F 02 42 9E 60 00 04 06 02 00 90 00 40")
    position = bytes.fromhex("FF FF 0D 02 44 B4 4A 3A 02 00 40 00 40")  # 0D^02^44^3A^02^00^40^00^40 = 73
    tracker = Tracker()
    events = watch((0.0, OUT, ask), (0.003, IN, answer), tracker=tracker)
    assert "model_no1 6, model_no2 2" in events[1].text
    assert events[1].text.endswith("; id 2 is of model DRS-0602: from here on its registers are shown")
    assert position[5] == 0xB4


def test_T6_a_herkulex_jog_without_a_model_is_raw() -> None:
    jog = bytes.fromhex("FF FF 0C 01 05")
    body = bytes((0x00, 0x02, 0x04, 0x01, 0x3C))
    xor = 0x0C ^ 0x01 ^ 0x05
    for byte in body:
        xor ^= byte
    packet = jog + bytes((xor & 0xFE, ~xor & 0xFE)) + body
    assert said(watch((0.0, OUT, packet))) == ["I_JOG id 1: id 1 to 512 (green, playtime 672 ms)"]
    assert "to -440.8°" in watch((0.0, OUT, packet), tracker=Tracker(model=DRS0602))[0].text
    reserved = bytes((0x00, 0x82, 0x04, 0x01, 0x3C))
    packet = jog + bytes(((xor ^ 0x80) & 0xFE, ~(xor ^ 0x80) & 0xFE)) + reserved
    assert (
        "to 512 (green, playtime 672 ms, a reserved bit set, which servos ignore)" in watch((0.0, OUT, packet))[0].text
    )


def test_T6_lewansoul_commands_say_their_units_for_all_models() -> None:
    assert FAMILIES["lewansoul"].one_table
    events = watch((0.0, OUT, bytes.fromhex("55 55 01 07 01 F4 01 E8 03 16")))
    assert events[0].text == "SERVO_MOVE_TIME_WRITE id 1: goal_position 120.0°, goal_time 1 s"


def test_T6_decode_says_whose_registers_they_are(run: Callable[..., Any]) -> None:  # noqa: F811 - the fixture
    text = run("decode", "FF FF 01 04 02 24 02 D2").stdout
    assert "values are bytes at addresses until the model is known" in " ".join(text.split())
    assert "; all its models have the same registers" in run("decode", "55 55 01 03 1C DF").stdout


def test_T3_decode_says_what_is_out_of_range(load: Callable[..., Any]) -> None:  # noqa: F811 - the fixture
    args = "FF FF 01 04 02 26 02 D0 FF FF 01 04 00 51 0D 9C"
    assert load("decode", "--model", "rx28", args)[1]["text"] == (
        "status of id 1: ok, present_speed out of range (raw 0x0d51)"
    )
    assert load("decode", args)[1]["text"] == "status of id 1: ok, address 38: 51 0D"


@pytest.mark.parametrize(
    ("packet", "words"),
    [
        ("55 55 01 05 1F 01 00 D9", "SERVO_LOAD_OR_UNLOAD_WRITE id 1: torque_enable on, and 00 more than it has"),
        ("55 55 FE 04 0B 00 F2", "SERVO_MOVE_START to all, and 00 more than it has"),
    ],
)
@pytest.mark.parametrize("side", [OUT, UNKNOWN])
def test_T6_surplus_bytes_of_a_lewansoul_command_are_told(packet: str, words: str, side: Direction) -> None:
    (event,) = watch((0.0, side, bytes.fromhex(packet)))
    assert (event.kind, event.text) == (EventKind.REQUEST, f"{words}, which servos ignore")
