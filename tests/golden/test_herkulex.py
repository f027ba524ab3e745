"""The packets of the DRS-0602 manual, both ways."""

from enum import IntFlag
from functools import reduce
from operator import or_
from typing import Any, TypeVar

import pytest

from golden.golden import Case, load
from servobus.core.framing import Packet
from servobus.families.herkulex import protocol as herkulex
from servobus.families.herkulex.models.magnetic import DRS0602
from servobus.families.herkulex.places import Eep, EepRam, Ram
from servobus.families.herkulex.protocol import (
    ACK,
    FRAMING,
    Ack,
    Code,
    ControlMode,
    IJog,
    Jog,
    Keep,
    Led,
    Request,
    Rollback,
    SJog,
    StatusDetail,
    StatusError,
    encode,
    parse_ack,
    parse_request,
)

FlagT = TypeVar("FlagT", bound=IntFlag)

CASES = load("herkulex")
MISPRINTS = [case for case in CASES if not case.valid]
WITH_REGISTERS = [case for case in CASES if case.registers]


def flags(kind: type[FlagT], names: list[str]) -> FlagT:
    return reduce(or_, (kind[name] for name in names), kind(0))


def jog(fields: dict[str, Any]) -> Jog:
    return Jog(**fields | {"mode": ControlMode[fields["mode"]], "led": Led[fields["led"]]})


def message(case: Case) -> Request | Ack:
    """Say in our values what the case means."""
    fields = dict(case.fields)
    match case.kind:
        case "Ack":
            return Ack(
                fields["id"],
                Code[fields["code"]],
                fields["data"],
                flags(StatusError, fields["status_error"]),
                flags(StatusDetail, fields["status_detail"]),
            )
        case "IJog":
            return IJog(fields["id"], tuple(jog(entry) for entry in fields["jogs"]))
        case "SJog":
            return SJog(fields["id"], fields["playtime"], tuple(jog(entry) for entry in fields["jogs"]))
        case "Rollback":
            return Rollback(fields["id"], flags(Keep, fields["keep"]))
        case _:
            made: Request = getattr(herkulex, case.kind)(**fields)
            return made


def only_packet(stream: bytes) -> Packet:
    (event,) = FRAMING.decode(stream)
    assert isinstance(event, Packet)
    return event


def read(stream: bytes) -> Request | Ack:
    packet = only_packet(stream)
    return parse_ack(packet) if packet.code & ACK else parse_request(packet)


def test_all_examples_are_here() -> None:
    assert len(CASES) == 27
    assert [case.name for case in MISPRINTS] == ["ijog_velocity", "sjog_velocity"]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_encode(case: Case) -> None:
    assert encode(message(case)) == case.packet


@pytest.mark.parametrize("case", CASES, ids=str)
def test_decode(case: Case) -> None:
    assert read(case.packet) == message(case)


@pytest.mark.parametrize("case", MISPRINTS, ids=str)
def test_a_misprint_is_no_packet(case: Case) -> None:
    assert case.printed is not None
    assert case.fault
    assert not [event for event in FRAMING.decode(case.printed) if isinstance(event, Packet)]


@pytest.mark.parametrize("case", WITH_REGISTERS, ids=str)
def test_registers(case: Case) -> None:
    """The register table finds in the data the values that the manual says are there."""
    meant = read(case.packet)
    in_eep = "EEP" in (meant.code.name if isinstance(meant, Ack) else case.kind.upper())
    data = meant.data[2:] if isinstance(meant, Ack) else getattr(meant, "data", b"")
    start = meant.data[0] if isinstance(meant, Ack) else case.fields["address"]
    for name, raw in case.registers.items():
        row = DRS0602.register(name)
        assert isinstance(row.place, Eep | Ram | EepRam)
        at = getattr(row.place, "eep" if in_eep else "ram") - start
        assert row.layout.unpack(data[at : at + row.layout.size]) == raw
