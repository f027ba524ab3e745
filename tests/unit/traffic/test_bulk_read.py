"""What is told of BULK_READ by those who listen, with MX-28 that answer it, and an AX-12A that does not.

The packets are made here, by the e-manual (Protocol 1.0, Bulk Read); checksums by the rule of its section Packet.
"""

import json
from typing import Any

import pytest

from servobus.traffic.events import EventKind, TrafficEvent, Trouble
from servobus.traffic.present import event_entry, packet_entries
from servobus.traffic.recording import Chunk, Direction
from servobus.traffic.tracker import Tracker
from servobus.virtual.serve.inprocess import connect
from unit.traffic.test_instructions import frame

OUT, IN, UNKNOWN = Direction.OUT, Direction.IN, Direction.UNKNOWN
PING_1 = frame("01 02 01")
POSITION, VOLTAGE = "02 {:02X} 24", "01 {:02X} 2A"
"""Two bytes from 36, one from 42, of a servo."""


def bulk_read(*reads: str) -> bytes:
    return frame(f"FE {3 + 3 * len(reads):02X} 92 00 " + " ".join(reads))


def who(id: int) -> bytes:
    """READ_DATA of the model number: what tells a listener whose registers these are."""
    return frame(f"{id:02X} 04 02 00 02")


def listen(spec: str, *requests: bytes, faults: str = "", hides: bool = False) -> tuple[list[TrafficEvent], Tracker]:
    """Send requests to virtual servos, and give what a listener says of the line."""
    port = connect(f"virtual:{spec}?clock=virtual&baud=1000000")
    port.set_baud(1_000_000)
    tracker, events = Tracker(), list[TrafficEvent]()
    for n, request in enumerate(requests):
        if n == len(requests) - 1 and faults:
            port.inject(faults)
        events += tracker.feed(Chunk(port.now(), UNKNOWN if hides else OUT, request))
        port.write(request)
        while answer := port.read(0.01):
            events += tracker.feed(Chunk(port.now(), UNKNOWN if hides else IN, answer))
        port.sleep(0.3)
    return [*events, *tracker.pass_time(port.now()), *tracker.finish()], tracker


def told(events: list[TrafficEvent], of: bytes) -> list[TrafficEvent]:
    """Give what was said from this request on."""
    at = next(n for n, event in enumerate(events) if event.raw == of)
    return events[at:]


def values(events: list[TrafficEvent]) -> list[tuple[int | None, str]]:
    return [(event.id, event.text.split(", ", 1)[-1]) for event in events if event.kind is EventKind.ANSWER]


def test_a_request_to_different_models_names_the_registers_of_each() -> None:
    """An MX-64 has Current at 68 (its e-manual), an MX-28 nothing; of servo 3 the model was never told."""
    request = bulk_read(POSITION.format(1), "02 02 44", POSITION.format(3))
    events, _ = listen("mx28@1,mx64@2,mx28@3", who(1), who(2), request)
    assert told(events, request)[0].text == (
        "BULK_READ to all, for ids 1, 2, 3: id 1: 2 bytes from address 36, present_position; id 2: 2 bytes from "
        "address 68, present_current; id 3: 2 bytes from address 36"
    )


def test_goals_to_different_models_are_told_in_the_units_of_each() -> None:
    request = frame("FE 0A 83 1E 02 01 00 04 02 00 04")
    events, _ = listen("ax12a@1,mx28@2", who(1), who(2), request)
    assert told(events, request)[0].text == (  # 1024 of 4096 steps; beyond the 1023 of an AX-12A
        "SYNC_WRITE to all, for ids 1, 2: id 1: goal_position out of range (raw 0x0400); id 2: goal_position 90.0°"
    )


@pytest.mark.parametrize("hides", [False, True], ids=["between", "listening"])
def test_each_answer_is_told_with_the_registers_of_its_servo(hides: bool) -> None:
    request = bulk_read(POSITION.format(3), VOLTAGE.format(1), POSITION.format(2))
    events, tracker = listen("mx28@1-3", who(1), who(2), who(3), request, hides=hides)
    first, *answers = told(events, request)
    assert first.text == (
        "BULK_READ to all, for ids 3, 1, 2: id 3: 2 bytes from address 36, present_position; id 1: 1 byte from address "
        "42, present_voltage; id 2: 2 bytes from address 36, present_position"
    )
    assert [event.id for event in answers] == [3, 1, 2]
    assert [event.text.split(" ")[-2] for event in answers] == ["present_position", "12.0", "present_position"]
    assert not [event for event in events if event.trouble]
    assert [(servo.id, servo.answers, servo.missing) for servo in tracker.servos] == [
        (1, 2, 0), (2, 2, 0), (3, 2, 0), (254, 0, 0),
    ]  # fmt: skip


def test_a_servo_that_does_not_know_it_is_missing_and_so_are_those_behind_it() -> None:
    request = bulk_read(*(POSITION.format(id) for id in (1, 4, 2)))
    events, tracker = listen("mx28@1-3,ax12a@4", request)
    assert [(event.kind, event.id, event.trouble) for event in told(events, request)] == [
        (EventKind.REQUEST, 254, None),
        (EventKind.ANSWER, 1, None),
        (EventKind.SILENCE, 4, Trouble.SILENT),
        (EventKind.SILENCE, 2, Trouble.SILENT),
    ]
    silent = [event.text for event in events if event.trouble]
    assert [text.split(" to ")[0] for text in silent] == ["NO ANSWER of id 4", "NO ANSWER of id 2"]
    assert [(servo.id, servo.answers, servo.missing) for servo in tracker.servos] == [
        (1, 1, 0), (2, 0, 1), (4, 0, 1), (254, 0, 0),
    ]  # fmt: skip


def test_mixed_models_each_by_its_own_table() -> None:
    """4096 steps over 360° and 1024 over 300° (e-manual): the AX is asked alone."""
    request = bulk_read(POSITION.format(1), POSITION.format(2))
    alone = frame("04 04 02 24 02")
    events, _ = listen("mx28@1-2,ax12a@4", who(1), who(2), request, who(4), alone)
    units = [text for _, text in values(told(events, request)) if "present_position" in text]
    assert len(units) == 3
    assert all("°" in text for text in units)


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_a_lost_answer_is_told_of_its_servo(lost: int) -> None:
    request = bulk_read(*(POSITION.format(id) for id in (1, 2, 3)))
    events, _ = listen("mx28@1-3", request, faults=f"mute#{lost}")
    assert sorted(event.id or 0 for event in events if event.kind is EventKind.ANSWER) == [
        id for id in (1, 2, 3) if id != lost
    ]
    assert [(event.id, event.trouble) for event in events if event.trouble] == [(lost, Trouble.SILENT)]


@pytest.mark.parametrize("hit", [1, 2, 3])
@pytest.mark.parametrize("fault", ["flip@48", "drop@5"])
def test_a_damaged_answer_is_told_of_its_servo(fault: str, hit: int) -> None:
    request = bulk_read(*(POSITION.format(id) for id in (1, 2, 3)))
    kind, place = fault.split("@")
    events, tracker = listen("mx28@1-3", request, faults=f"{kind}@{place}#{hit}")
    assert [event.id for event in events if event.kind is EventKind.ANSWER] == [id for id in (1, 2, 3) if id != hit]
    assert [event.id for event in events if event.kind is EventKind.CORRUPT] == [hit]
    assert [servo.id for servo in tracker.servos if servo.corrupt] == [hit]


def test_of_two_lost_and_damaged_each_is_told_of_its_own() -> None:
    """Id 1 is silent on this wire, id 2 damaged: what is broken bears the id 2."""
    request = bulk_read(*(POSITION.format(id) for id in (1, 2, 3)))
    events, tracker = listen("mx28@1-3", request, faults="mute#1,flip@48#2")
    assert [(event.id, event.trouble) for event in events if event.trouble] == [
        (2, Trouble.CHECKSUM),
        (1, Trouble.SILENT),
    ]
    assert [(servo.id, servo.corrupt, servo.missing) for servo in tracker.servos if servo.id != 254] == [
        (1, 0, 1), (2, 1, 0), (3, 0, 0),
    ]  # fmt: skip


def test_an_id_that_is_listed_twice_counts_once() -> None:
    """ROBOTIS e-manual, Protocol 1.0, Bulk Read; the first one counts."""
    request = bulk_read(POSITION.format(1), VOLTAGE.format(2), VOLTAGE.format(1))
    events, _ = listen("mx28@1-2", who(1), who(2), request)
    answers = values(told(events, request))
    assert [id for id, _ in answers] == [1, 2]
    assert answers[0][1].startswith("present_position")
    assert answers[1][1].startswith("present_voltage")
    assert not [event for event in events if event.trouble]


def test_entries_hold_the_values_of_each_servo() -> None:
    request = bulk_read(POSITION.format(1), VOLTAGE.format(2))
    events, _ = listen("mx28@1-2", who(1), who(2), request)
    entries: list[dict[str, Any]] = [event_entry(event) for event in told(events, request)]
    assert [(entry["kind"], entry["id"]) for entry in entries] == [("request", 254), ("answer", 1), ("answer", 2)]
    assert "present_position" in entries[1]["text"]
    assert "present_voltage 12.0 V" in entries[2]["text"]
    assert json.loads(json.dumps(entries)) == entries


def test_pasted_bytes_are_told_in_the_same_way() -> None:
    request = bulk_read(POSITION.format(1), VOLTAGE.format(2))
    line = who(1) + frame("01 04 00 1D 00") + who(2) + frame("02 04 00 1D 00")
    data = line + request + frame("01 04 00 00 08") + frame("02 03 00 78")
    *_, asked, one, two = packet_entries(data)
    assert asked["text"].startswith("BULK_READ to all, for ids 1, 2")
    assert one["text"] == "status of id 1: ok, present_position 180.0°"  # 2048 of 4096
    assert two["text"] == "status of id 2: ok, present_voltage 12.0 V"
