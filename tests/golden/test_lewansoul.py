"""Every LewanSoul packet, both ways: what it means gives its bytes, and its bytes give what it means."""

import pytest

from golden.golden import Case, load
from servobus.core.framing import Packet
from servobus.families.lewansoul.protocol import (
    FRAMING,
    Answer,
    Command,
    Request,
    encode,
    parse_answer,
    parse_request,
)

CASES = load("lewansoul")


def meant(case: Case) -> Request | Answer:
    command = Command[case.fields["command"]]
    named: dict[str, int] = case.fields["values"]
    kind: type[Request | Answer] = Request if case.kind == "Request" else Answer
    fields = command.params if kind is Request else command.reply
    assert tuple(named) == tuple(name for name, _ in fields)
    return kind(case.fields["id"], command, tuple(named.values()))


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_meant_message_has_these_bytes(case: Case) -> None:
    assert encode(meant(case)) == case.packet


@pytest.mark.parametrize("case", CASES, ids=str)
def test_these_bytes_say_what_is_meant(case: Case) -> None:
    (packet,) = FRAMING.decode(case.packet)
    assert isinstance(packet, Packet)
    parse, other = (parse_request, parse_answer) if case.kind == "Request" else (parse_answer, parse_request)
    assert parse(packet) == meant(case)
    with pytest.raises(ValueError):
        other(packet)


def test_every_command_and_every_answer_is_here() -> None:
    assert {case.fields["command"] for case in CASES if case.kind == "Request"} == set(Command.__members__)
    answered = {command.name for command in Command if command.reply}
    assert {case.fields["command"] for case in CASES if case.kind == "Answer"} == answered
    assert len(answered) == 14
