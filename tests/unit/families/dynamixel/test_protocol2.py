"""A servo whose firmware speaks protocol 2.0 is found out and named, and nothing on the line takes harm.

Packets are those that the ROBOTIS e-manual prints on its page Protocol 2.0: a PING to all, and the answer of id 1 of
model 1030 (06 04) with firmware 38.
"""

import pytest

import servobus
from servobus import FAMILIES, OtherProtocol
from servobus.core.framing import Corrupt, Decoder, Noise, Packet
from servobus.core.ids import LAST_ID
from servobus.families.dynamixel.protocol2 import FRAMING_2, crc, ping_all
from servobus.jobs.scan import scan
from servobus.traffic.recording import Chunk, Direction
from servobus.traffic.tracker import Tracker
from unit.scripted import Scripted

PING = "FF FF FD 00 FE 03 00 01 31 42"
ANSWER = "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D"


class Answering(Scripted):
    """Answers the PING of protocol 2.0 at one speed, and nothing else."""

    def write(self, data: bytes) -> None:
        asked = data.hex(" ").upper()
        self.script = [ANSWER if asked == PING and self.baud == 57_600 else None]
        super().write(data)


def test_the_packets_of_the_manual() -> None:
    assert ping_all().request.hex(" ").upper() == PING
    answer = bytes.fromhex(ANSWER)
    assert FRAMING_2.unframe(answer) == (Packet(1, 0x55, bytes([0, 6, 4, 38])), True)
    assert crc(answer[:-2]) == 0x5D65
    assert FRAMING_2.decode(b"\x00" + answer + answer[:5]) == [
        Noise(b"\x00"), Packet(1, 0x55, bytes([0, 6, 4, 38])), Noise(answer[:5]),
    ]  # fmt: skip
    (broken,) = FRAMING_2.decode(answer[:-1] + b"\x00")
    assert isinstance(broken, Corrupt | Noise)


@pytest.mark.parametrize("family", ["dynamixel", "herkulex", "lewansoul"])
def test_no_servo_of_another_kind_waits_for_more_of_it(family: str) -> None:
    """What a family's servos make of the question: no packet, and none begun."""
    decoder = Decoder(FAMILIES[family].framing)
    events = decoder.feed(bytes.fromhex(PING))
    assert not any(isinstance(event, Packet | Corrupt) for event in events)
    assert not decoder.pending


def test_a_scan_of_all_ids_asks_once_a_speed_and_says_what_answers() -> None:
    port = Answering(*[None] * 2000, baud=57_600)
    bus = servobus.Bus(port, echo=False)
    result = bus.do(scan([FAMILIES["dynamixel"]], [57_600, 1_000_000]))
    assert not result.found
    (trouble,) = result.troubles
    assert (trouble.id, trouble.baud) == (1, 57_600)
    assert isinstance(trouble.error, OtherProtocol)
    assert str(trouble).startswith("id 1, model 1030 with firmware 38: Dynamixel protocol 2.0, not understood here; ")
    assert "something answers, but not clearly" not in str(trouble)
    assert port.requests.count(PING) == 2
    assert port.requests.index(PING) == LAST_ID + 1  # after all others


def test_a_scan_of_some_ids_leaves_that_out() -> None:
    port = Answering(*[None] * 50, baud=57_600)
    bus = servobus.Bus(port, echo=False)
    bus.do(scan([FAMILIES["dynamixel"]], [57_600], ids=range(10)))
    assert PING not in port.requests


def test_no_other_family_asks() -> None:
    port = Answering(*[None] * 1000, baud=115_200)
    servobus.Bus(port, echo=False).do(scan([FAMILIES["lewansoul"]]))
    assert PING not in port.requests


def test_an_answer_with_that_header_is_told_in_the_error() -> None:
    bus = servobus.Bus(Scripted(ANSWER, ANSWER), echo=False)
    with pytest.raises(
        OtherProtocol, match=r"PING id 1: the answer is one of Dynamixel protocol 2\.0, not understood"
    ) as told:
        bus.do(FAMILIES["dynamixel"].ping(1))
    assert told.value.heard == bytes.fromhex(ANSWER)


def test_traffic_of_that_protocol_is_told_as_such() -> None:
    tracker = Tracker()
    events = tracker.feed(Chunk(0.0, Direction.UNKNOWN, bytes.fromhex(ANSWER))) + tracker.finish()
    (event,) = events
    assert event.text.startswith("14 bytes of Dynamixel protocol 2.0, not understood here; ")
    assert (event.trouble, tracker.junk) == (None, 0)


def test_junk_with_that_header_within_is_junk() -> None:
    tracker = Tracker()
    (event,) = tracker.feed(Chunk(0.0, Direction.UNKNOWN, b"\x12\x34" + bytes.fromhex(ANSWER)))
    assert event.text == "JUNK: 16 bytes that are no packet"
