"""The injector by itself: what it does to bytes and supplies, without a line around it.

PING's answer is that of the RX-28 manual (3-5-5); at 57600 baud a byte lasts 10 bits, 173.6 µs.
"""

from collections.abc import Iterable

import pytest

from servobus.families.registry import RX28
from servobus.virtual.device.servo import VirtualServo, virtual_servo
from servobus.virtual.wire.adapter import WHOLE, Handover
from servobus.virtual.wire.faults import Faults
from servobus.virtual.wire.injector import Injector
from servobus.virtual.wire.uart import ReceivedBytes, Transmission

PING = bytes.fromhex("FF FF 01 02 01 FB")
PONG = bytes.fromhex("FF FF 01 02 00 FC")
BAUD = 57_600


class Supply:
    """Writes down when which servos get and lose their supply."""

    def __init__(self) -> None:
        self.log: list[tuple[str, list[int], float]] = []

    def plug(self, servos: Iterable[VirtualServo], now: float) -> None:
        self.log.append(("plug", [servo.id for servo in servos], now))

    def unplug(self, servos: Iterable[VirtualServo], now: float) -> None:
        self.log.append(("unplug", [servo.id for servo in servos], now))


def injector(faults: str, *ids: int, supply: Supply | None = None, now: float = 0.0, name: str = "one") -> Injector:
    supply = supply or Supply()
    servos = [virtual_servo(RX28, id) for id in ids or (1,)]
    framing = RX28.family.framing
    handover = Handover(WHOLE, [], now)
    return Injector(
        Faults.parse(faults), framing, name, servos, handover, plug=supply.plug, unplug=supply.unplug, now=now
    )


def delivered(injector: Injector, *waves: Transmission) -> bytes:
    """Give what the client gets of these transmissions, received without a mistake."""
    for wave in waves:
        injector._handover.take(ReceivedBytes(wave.data, wave.start, wave.end, wave.end, from_servo=True, wave=wave))
    return b"".join(run.data for run in injector._handover.due(10.0))


def reply(injector: Injector, start: float = 1.0) -> bytes:
    return delivered(injector, *injector.reply(Transmission(start, BAUD, PONG, sender=object())))


@pytest.mark.parametrize(
    ("faults", "heard"),
    [
        ("drop@2#1", "FF FF 02 00 FC"),
        ("flip@16#1", "FF FF 00 02 00 FC"),
        ("junk@before#1:0x0055", "00 55 FF FF 01 02 00 FC"),
        ("stranger@7#1", "FF FF 07 02 00 F6"),
        ("mute#1", ""),
        ("drop@2#2", "FF FF 01 02 00 FC"),
    ],
)
def test_the_first_reply(faults: str, heard: str) -> None:
    assert reply(injector(faults)) == bytes.fromhex(heard)


def test_what_happened_is_in_the_log_and_counted() -> None:
    one = injector("drop@2#1", name="arm")
    reply(one, 1.5)
    (entry,) = one.log
    assert (entry.kind, entry.number, entry.where, entry.time, entry.wire) == ("drop", 1, "byte 2", 1.5, "arm")
    assert one.counts == {"drop": 1}


def test_the_name_seeds_the_dice() -> None:
    def luck(name: str) -> list[bytes]:
        one = injector("seed=7,drop=0.5", name=name)
        return [reply(one, float(n)) for n in range(1, 9)]

    assert luck("one") == luck("one")
    assert luck("one") != luck("other")


def test_a_request_that_servos_do_not_hear() -> None:
    one = injector("deaf#2")
    for start, deaf in ((1.0, False), (2.0, True), (3.0, False)):
        wave = Transmission(start, BAUD, PING)
        heard, echoed = one.send(wave, echo=True)
        assert [part.data for part in heard] == ([] if deaf else [PING])
        assert [part.data for part in echoed] == [PING]


def test_supply_is_taken_and_given_back_by_what_was_handed_in() -> None:
    supply = Supply()
    one = injector("reboot@2-3#1s:250ms", 1, 2, 3, supply=supply)
    assert not one.change(0.999)
    assert one.change(1.0)
    assert supply.log == [("unplug", [2, 3], 1.0)]
    assert not one.change(1.2)
    assert one.change(1.25)
    assert supply.log[1:] == [("plug", [2, 3], 1.25)]
    assert not one.change(100.0)


def test_the_port_is_gone_for_a_while() -> None:
    one = injector("gone#2s:1s")
    assert [one.gone(time) for time in (1.9, 2.0, 2.9, 3.1)] == [False, True, True, False]
    assert one.next_event(0.0) == 2.0


def test_a_servo_whose_clock_is_fast() -> None:
    one = injector("skew@2=3", 1, 2)
    slow, fast = (virtual_servo(RX28, id) for id in (1, 2))
    assert (one.skew(slow), one.skew(fast)) == (1.0, 1.03)
