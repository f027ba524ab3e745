"""All ids at all speeds, with all families on one line: who is found (N1), and how what was sent reads (N18).

A HerkuleX takes FF FF and the id of a Dynamixel packet for the header and the size of one of its own (DRS-0602 manual
4-1, RX-28 manual 3-2), and the other way round; what is sent at another speed is garbage to both. No RX-28 has id 7 or
9, the sizes of the requests to a HerkuleX: the two protocols cannot tell those apart.
"""

from typing import NamedTuple

import pytest

import servobus
from servobus.families import registry
from servobus.families.registry import FAMILIES
from servobus.jobs.scan import scan
from servobus.traffic.recording import Direction, Entry
from servobus.traffic.tracker import Tracker
from servobus.transports.tap import TapTransport
from servobus.virtual.serve.inprocess import connect

SPEC = "virtual:rx28@0,20,85,100,219,253,drs0602@2,7,20,100,219,253,lx16a@5,7,20,100,219,253?clock=virtual"
BAUDS = {
    "dynamixel": [57_600, 115_200, 9_600, 200_000, 1_000_000, 115_200],
    "herkulex": [57_600, 666_666, 115_200, 1_000_000, 115_200, 200_000],
    "lewansoul": [115_200] * 6,
}
"""Speeds of the servos of each family, in the order of the ids: at 57600, 115200, 200000 and 1000000 two share one."""

Place = tuple[str, int, int]


class Scan(NamedTuple):
    """What a scan found, and all that went over the line meanwhile."""

    places: set[Place]
    found: list[Place]
    troubles: list[str]
    carried: list[Entry]


@pytest.fixture(scope="module")
def everything() -> Scan:
    """Ask all ids of each family at all of the family's speeds, as `servobus scan --baud all` does."""
    carried: list[Entry] = []
    port = connect(SPEC)
    left = {name: list(bauds) for name, bauds in BAUDS.items()}
    places: set[Place] = set()
    for servo in port.servos:
        name = servo.model.family.name
        baud = left[name].pop(0)
        if name != "lewansoul":  # an LX has one speed
            servo.store_baud(baud)
        places.add((name, servo.id, baud))
    bus = servobus.Bus(TapTransport(port, carried.append, heard=Direction.IN))
    survey = bus.do(
        scan(list(FAMILIES.values()), {family.name: registry.bauds(family) for family in FAMILIES.values()})
    )
    found = [(one.family.name, one.id, one.baud) for one in survey.found]
    return Scan(places, found, list(map(str, survey.troubles)), carried)


def test_N1_each_servo_is_found_where_it_is_and_nothing_else(everything: Scan) -> None:
    assert sorted(everything.found) == sorted(everything.places)
    assert everything.troubles == []


@pytest.mark.parametrize("name", [None, *FAMILIES])
def test_N18_no_byte_of_it_is_junk_damage_or_a_stranger(everything: Scan, name: str | None) -> None:
    tracker = Tracker(None if name is None else FAMILIES[name], baud=115_200)
    events = [event for entry in everything.carried for event in tracker.feed(entry)] + tracker.finish()
    assert (tracker.junk, tracker.corrupt, tracker.cut_short) == (0, 0, 0)
    assert {event.trouble.name for event in events if event.trouble} <= {"SILENT"}  # who is not there says nothing
