"""The process that owns the ports, spoken to in lines: who is let in, what is refused, and who has the line."""

import asyncio
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Self

import pytest

from servobus.core.exchange import Exchange
from servobus.core.operation import Priority
from servobus.errors import Held
from servobus.families.registry import FAMILIES
from servobus.remote.messages import LONGEST, VERSION, decode, encode
from servobus.remote.protocol import (
    Answer,
    Beat,
    Beaten,
    Failed,
    Hello,
    Refused,
    Release,
    SentRequest,
    Supersede,
    Welcome,
)
from servobus.remote.steps import SentPacket, SentPause, SentStep, sent
from servobus.server.ports import service, steps
from servobus.server.ports.gate import PermitAll
from servobus.server.ports.leases import Holder
from unit.remote.hosted import PATIENCE, TOKEN, Hosted
from unit.served import wait_for

SPEC = "virtual:rx28@1-3?baud=57600"
PING = FAMILIES["dynamixel"].ping(1)


class Client:
    """A client that says what it is told to say."""

    def __init__(self, hosted: Hosted, **hello: Any) -> None:
        self._socket = socket.create_connection(("127.0.0.1", hosted.port), PATIENCE)
        self._file = self._socket.makefile("rb")
        self.n = 0
        if hello.pop("greets", True):
            given: dict[str, Any] = {"token": TOKEN, "name": "test", "client": "program", "deadman": 0.0} | hello
            self.say(Hello(**given))
            self.welcome = self.hear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._file.close()
        self._socket.close()

    def send(self, data: bytes) -> None:
        with suppress(ConnectionError):
            self._socket.sendall(data)

    def say(self, message: Any) -> None:
        self.send(encode(message))

    def hear(self) -> Any:
        """Give the next message; None at the end."""
        with suppress(ConnectionError):
            if line := self._file.readline():
                return decode(line)
        return None

    def ask(self, step: SentStep | Exchange[Any] = PING, *, hold: int = 0, baud: int = 57_600, **other: Any) -> int:
        """Ask for a step, and give its number."""
        self.n += 1
        step = sent(step) if isinstance(step, Exchange) else step
        given: dict[str, Any] = {"bus": "arm", "priority": int(Priority.READ), "time": 0.0} | other
        self.say(SentRequest(n=self.n, baud=baud, hold=hold, step=step, **given))
        return self.n

    def outcome(self, *step: Any, **how: Any) -> Any:
        """Ask for a step and give what came of it: the outcomes, or the name of the error."""
        n = self.ask(*step, **how)
        answer = self.hear()
        assert answer.n == n
        return answer.outcomes if isinstance(answer, Answer) else answer.fault.type


@pytest.fixture
def hosted() -> Iterator[Hosted]:
    with Hosted({"arm": SPEC}) as running:
        yield running


PONG = (SentPacket(1, 0, b""),)


# The first words


def test_who_says_hello_is_told_of_the_buses(hosted: Hosted) -> None:
    with Client(hosted) as client:
        assert isinstance(client.welcome, Welcome)
        assert (client.welcome.role, client.welcome.version) == ("operator", VERSION)
        assert [(bus.name, bus.port, bus.open) for bus in client.welcome.buses] == [("arm", SPEC, True)]


@pytest.mark.parametrize(
    ("hello", "why"),
    [
        ({"token": "open sesam"}, "token"),
        ({"token": ""}, "token"),
        ({"token": "öffne dich"}, "token"),
        ({"version": VERSION + 1}, "version"),
        ({"client": "cat"}, "is one of"),
        ({"name": "x" * 1000}, "name"),
        ({"deadman": -1.0}, "deadman"),
        ({"session": "1234"}, "no such session"),
    ],
)
def test_who_says_something_else_is_refused(hosted: Hosted, hello: dict[str, Any], why: str) -> None:
    with Client(hosted, **hello) as client:
        assert isinstance(client.welcome, Refused)
        assert why in client.welcome.why
        assert TOKEN not in client.welcome.why
        assert client.hear() is None


@pytest.mark.parametrize("words", [b"GET / HTTP/1.1\r\n", b'{"k":"beat","time":1}\n', b"x" * 10_000, b"\n"])
def test_nothing_goes_before_hello(hosted: Hosted, words: bytes) -> None:
    with Client(hosted, greets=False) as client:
        client.send(words)
        assert isinstance(client.hear(), Refused)
        assert client.hear() is None


def test_who_says_nothing_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "GREETING", 0.01)
    with Hosted({"arm": SPEC}) as hosted, Client(hosted, greets=False) as client:
        assert isinstance(client.hear(), Refused)


# What is refused later on


@pytest.mark.parametrize(
    "line", [b"\n", b"{}\n", b'{"k":"nothing"}\n', b"\xff\xfe\n", b'{"k":"beat"}\n', b'{"k":"welcome"}\n']
)
def test_a_line_that_is_no_message_is_refused_and_the_next_one_is_not(hosted: Hosted, line: bytes) -> None:
    with Client(hosted) as client:
        client.send(line)
        answer = client.hear()
        assert isinstance(answer, Failed)
        assert (answer.n, answer.fault.type) == (0, "UsageError")
        assert client.outcome() == PONG


def test_a_message_that_only_servers_say_is_refused(hosted: Hosted) -> None:
    with Client(hosted) as client:
        client.say(Beaten(0.0, 0.0))
        assert client.hear().fault.type == "UsageError"


def test_a_line_that_is_too_long_ends_the_connection(hosted: Hosted) -> None:
    with Client(hosted) as client:
        client.send(b"x" * (LONGEST + 2))
        assert client.hear() == Refused("the line is too long")
        assert client.hear() is None


def test_numbers_grow(hosted: Hosted) -> None:
    with Client(hosted) as client:
        assert client.outcome() == PONG
        client.n = 0
        client.ask()
        assert isinstance(client.hear(), Refused)


@pytest.mark.parametrize(
    ("how", "error"),
    [
        ({"bus": "leg"}, "UnknownName"),
        ({"baud": 0}, "UsageError"),
        ({"baud": -(10**30)}, "UsageError"),
        ({"priority": 9}, "UsageError"),
        ({"hold": -1}, "Stopped"),
    ],
)
def test_a_step_that_makes_no_sense_is_refused(hosted: Hosted, how: dict[str, Any], error: str) -> None:
    with Client(hosted) as client:
        assert client.outcome(**how) == error
        assert client.outcome() == PONG


def test_who_asks_without_waiting_is_closed_some_time(hosted: Hosted) -> None:
    with Client(hosted) as client:
        for _ in range(4 * steps.MOST_WAITING):
            client.ask(SentPause(1.0))
        assert client.hear() == Refused("too many requests wait for bus arm")


def test_who_sends_too_much_is_closed(hosted: Hosted, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "MOST_RATE", 50)
    with Client(hosted) as client:
        client.send(encode(Beat(0.0)) * 200)
        while isinstance(said := client.hear(), Beaten):
            pass
        assert said == Refused("more than 50 messages a second")


def test_too_many_connections_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "MOST_CONNECTIONS", 1)
    with Hosted({"arm": SPEC}) as hosted, Client(hosted) as first:
        with Client(hosted, greets=False) as second:
            assert isinstance(second.hear(), Refused)
        assert first.outcome() == PONG


class Full(asyncio.Transport):
    """A connection whose other end reads nothing."""

    aborted = False

    def get_write_buffer_size(self) -> int:
        return service.MOST_UNREAD + 1

    def abort(self) -> None:
        self.aborted = True


def test_a_client_that_reads_nothing_is_closed() -> None:
    async def main() -> None:
        connection, full = service.Connection(service.Service({}, {})), Full()
        connection.connection_made(full)
        assert connection.crowded
        connection.tell(Beaten(0.0, 0.0))
        assert full.aborted

    asyncio.run(main())


# Signs of life


def test_a_beat_is_answered_with_the_time(hosted: Hosted) -> None:
    with Client(hosted) as client:
        before = hosted.told(time.monotonic)
        client.say(Beat(12.5))
        answer = client.hear()
        assert answer.time == 12.5
        assert before <= answer.server <= time.monotonic()


class Watching(PermitAll):
    """A gate that writes down what it is told, and refuses requests of servo 3."""

    def __init__(self) -> None:
        self.seen: list[tuple[str, str]] = []

    def admit(self, who: Holder, bus: str, exchange: Exchange[Any], *more: Any) -> None:  # noqa: ARG002 - not looked at
        if exchange.id == 3:
            raise Held("id 3 is held by Ann", "Ann")

    def carried_out(self, who: Holder, bus: str, exchange: Exchange[Any], baud: int, outcome: Any) -> None:  # noqa: ARG002
        self.seen.append((exchange.what, type(outcome).__name__))

    def silent(self, who: Holder) -> None:
        self.seen.append(("silent", who.name))

    def left(self, who: Holder) -> None:
        self.seen.append(("left", who.name))


def test_the_gate_hears_of_a_session_that_is_silent_and_of_its_end() -> None:
    gate = Watching()
    with Hosted({"arm": SPEC}, gate) as hosted:
        with Client(hosted, name="hung", deadman=0.02), Client(hosted, name="patient"):
            wait_for(lambda: ("silent", "hung") in gate.seen)
        wait_for(lambda: {("left", "hung"), ("left", "patient")} <= set(gate.seen))
        assert [seen for seen in gate.seen if seen[0] == "silent"] == [("silent", "hung")]
        assert not hosted.service.sessions


def test_the_gate_decides_what_goes_out() -> None:
    gate = Watching()
    with Hosted({"arm": SPEC}, gate) as hosted, Client(hosted) as client:
        family = FAMILIES["dynamixel"]
        assert client.outcome() == PONG
        client.ask(family.ping(3))
        fault = client.hear().fault
        assert (fault.type, fault.by) == ("Held", "Ann")
        assert client.outcome(family.ping(9)) == "NoReply"
        assert gate.seen == [("PING id 1", "Packet"), ("PING id 3", "Held"), ("PING id 9", "NoReply")]


# Several connections of one session


def test_a_connection_can_belong_to_the_session_of_another(hosted: Hosted) -> None:
    with Client(hosted) as first:
        with Client(hosted, session=first.welcome.session) as second:
            assert second.welcome.session == first.welcome.session
            assert len(hosted.service.sessions) == 1
        assert first.outcome() == PONG  # it ends by its first connection, not by another
        with Client(hosted, session=first.welcome.session) as third:
            first.close()
            assert third.hear() == Refused("its session has ended")


# Who has the line


def holder_is(hosted: Hosted, held: bool) -> None:
    line = hosted.service.buses["arm"].line
    wait_for(lambda: (line.holder is not None) == held)


def test_a_procedure_keeps_the_line_between_its_steps(hosted: Hosted) -> None:
    with Client(hosted) as one, Client(hosted) as other:
        assert one.outcome(hold=1) == PONG
        holder_is(hosted, held=True)
        waits = other.ask()
        assert one.outcome(hold=1) == PONG
        assert one.outcome(hold=1) == PONG
        one.say(Release("arm"))
        assert other.hear().n == waits
        holder_is(hosted, held=False)
        assert one.outcome(hold=1) == "Stopped"  # it has ended
        assert one.outcome(hold=2) == PONG


def test_a_procedure_that_says_nothing_more_loses_the_line(hosted: Hosted, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steps, "LAPSE", 0.02)
    with Client(hosted) as one, Client(hosted) as other:
        assert one.outcome(hold=1) == PONG
        assert other.outcome() == PONG
        assert one.outcome(hold=1) == "Stopped"
        assert one.outcome(hold=2) == PONG


def test_a_client_that_goes_in_the_middle_leaves_the_line(hosted: Hosted) -> None:
    with Client(hosted) as one, Client(hosted) as other:
        assert one.outcome(hold=1) == PONG
        waits = other.ask()
        one.ask(SentPause(2.0), hold=1)
        one.close()
        answer = other.hear()
        assert (answer.n, answer.outcomes) == (waits, PONG)


def test_what_is_superseded_ends_at_once(hosted: Hosted) -> None:
    with Client(hosted) as client:
        numbers = [client.ask(SentPause(2.0), hold=1), client.ask(hold=1)]
        holder_is(hosted, held=True)
        client.say(Supersede("arm"))
        failed = [client.hear(), client.hear()]
        assert {one.n for one in failed} == set(numbers)
        assert {one.fault.type for one in failed} == {"Stopped"}
        assert client.outcome() == PONG


def test_a_release_while_a_step_is_under_way_waits_for_its_end(hosted: Hosted) -> None:
    with Client(hosted) as one, Client(hosted) as other:
        pause = one.ask(SentPause(0.1), hold=1)
        holder_is(hosted, held=True)
        one.say(Release("arm"))
        began = time.monotonic()
        assert other.outcome() == PONG
        assert time.monotonic() - began > 0.05
        assert one.hear().n == pause
        holder_is(hosted, held=False)


def test_the_most_urgent_comes_first(hosted: Hosted) -> None:
    with Client(hosted) as one, Client(hosted) as scan, Client(hosted) as stop:
        assert one.outcome(hold=1) == PONG
        line = hosted.service.buses["arm"].line
        scan.ask(SentPause(0.2), priority=int(Priority.SCAN))
        wait_for(lambda: len(line._waiting) == 1)
        stop.ask(priority=int(Priority.STOP))
        wait_for(lambda: len(line._waiting) == 2)
        one.say(Release("arm"))
        assert isinstance(stop.hear(), Answer)
        assert isinstance(scan.hear(), Answer)
