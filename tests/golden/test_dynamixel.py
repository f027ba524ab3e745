"""The packets of the RX-28 manual, both ways."""

from functools import reduce
from operator import or_

import pytest

from golden.golden import Case, load
from servobus.core.framing import Packet
from servobus.core.values import replace
from servobus.families.dynamixel import protocol as dynamixel1
from servobus.families.dynamixel.models.rx28 import RX28
from servobus.families.dynamixel.places import Address
from servobus.families.dynamixel.protocol import (
    FRAMING,
    Error,
    Instruction,
    Status,
    SyncWrite,
    encode,
    parse_instruction,
    parse_status,
)

CASES = load("dynamixel")
MISPRINTS = [case for case in CASES if not case.valid]
EARLIER = [case for case in CASES if case.earlier is not None]
WITH_REGISTERS = [case for case in CASES if case.registers]


def message(case: Case) -> Instruction | Status:
    """Say in our values what the case means."""
    fields = dict(case.fields)
    match case.kind:
        case "Status":
            error = reduce(or_, (Error[name] for name in fields["error"]), Error(0))
            return Status(fields["id"], error, fields["data"])
        case "SyncWrite":
            parts = tuple((id, bytes.fromhex(data)) for id, data in fields["parts"])
            return SyncWrite(fields["address"], fields["length"], parts, fields["id"])
        case _:
            made: Instruction = getattr(dynamixel1, case.kind)(**fields)
            return made


def read(stream: bytes, kind: str) -> Instruction | Status:
    (event,) = FRAMING.decode(stream)
    assert isinstance(event, Packet)
    return parse_status(event) if kind == "Status" else parse_instruction(event)


def test_all_examples_are_here() -> None:
    assert len(CASES) == 49
    assert len(MISPRINTS) == 26


@pytest.mark.parametrize("case", CASES, ids=str)
def test_encode(case: Case) -> None:
    assert encode(message(case)) == case.packet


@pytest.mark.parametrize("case", CASES, ids=str)
def test_decode(case: Case) -> None:
    assert read(case.packet, case.kind) == message(case)


@pytest.mark.parametrize("case", MISPRINTS, ids=str)
def test_a_misprint_is_no_packet(case: Case) -> None:
    assert case.printed is not None
    assert case.fault
    assert not [event for event in FRAMING.decode(case.printed) if isinstance(event, Packet)]


@pytest.mark.parametrize("case", EARLIER, ids=str)
def test_the_earlier_edition_says_the_same_to_id_0(case: Case) -> None:
    assert case.earlier is not None
    meant = replace(message(case), id=0)
    assert encode(meant) == case.earlier
    assert read(case.earlier, case.kind) == meant


@pytest.mark.parametrize("case", WITH_REGISTERS, ids=str)
def test_registers(case: Case) -> None:
    """The register table finds in the data the values that the manual says are there."""
    rows = {name: RX28.register(name) for name in case.registers}
    addresses = {name: row.place.address for name, row in rows.items() if isinstance(row.place, Address)}
    start = case.fields.get("address", min(addresses.values()))  # a status packet does not say where its data is from
    data = case.fields["data"]
    for name, row in rows.items():
        at = addresses[name] - start
        assert row.layout.unpack(data[at : at + row.layout.size]) == case.registers[name]
