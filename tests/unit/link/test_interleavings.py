"""Every job, broken off at every one of its waits, in every way; afterwards the link gives right answers only.

A driver may drop a job wherever the job waits: a task is cancelled, Ctrl-C comes, a stop takes the line over. Then a
reply may still be on its way, in the adapter, in the buffer of the port, or half heard. Here each request gets a reply
that no other request gets, so that an old one that is taken for the new one shows at once.
"""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest

import extent
import servobus
from servobus import Bus, BusError, dynamixel1, herkulex
from servobus.core.exchange import Batch, Exchange, Pause, Procedure, SetBaud, joined
from servobus.core.framing import Packet
from servobus.errors import Stopped
from servobus.families.dynamixel import protocol as dynamixel_packets
from servobus.families.herkulex import protocol as herkulex_packets
from servobus.families.registry import FAMILIES
from servobus.jobs.scan import scan
from servobus.link.link import Link, LinkState
from servobus.link.waits import Receive, Waits
from servobus.virtual.serve.inprocess import VirtualPort
from unit.link.test_group import SYNC_READ, sync_read
from unit.link.test_link import Timed

IDS = (1, 2, 3)
BULK_READ = 0x92
LOOKS = 2
"""Questions that are asked after a job was broken off."""


class Numbered(Timed):
    """Answers every read of these servos with the number of the request, in order, so many seconds late."""

    def __init__(self, family: str, late: float) -> None:
        super().__init__()
        self.family, self.late = family, late
        self.asked: list[tuple[int, bytes]] = []
        """The servo and the request of each reply, by number."""
        self._last = 0.0

    def write(self, data: bytes) -> None:
        framing = FAMILIES[self.family].framing
        self.requests.append(data.hex(" "))
        at = 0
        for event in framing.decode(data):
            if isinstance(event, Packet):
                for id in self._asked(event):
                    at += 1
                    self._reply(id, framing.frame(event), event, 10 * len(data) / self.baud + at * 0.0005)

    def _asked(self, packet: Packet) -> Sequence[int]:
        if self.family == "dynamixel" and packet.code == SYNC_READ:
            return tuple(packet.data[2:])
        if self.family == "dynamixel" and packet.code == BULK_READ:
            return tuple(packet.data[2::3])
        return (packet.id,) if packet.id in IDS else ()

    def _reply(self, id: int, request: bytes, packet: Packet, after: float) -> None:
        number = len(self.asked)
        reply = (_dynamixel if self.family == "dynamixel" else _herkulex)(id, packet, number)
        if reply is not None:
            self.asked.append((id, request))
            self._last = max(self._last + 1e-6, self._now + after + self.late)  # adapters keep the order
            self._due.append((self._last, reply))
            self._due.sort()

    def newest(self, exchange: Exchange[Any], id: int) -> int:
        """Give the number of the last reply of this servo to these bytes."""
        return max(n for n, asked in enumerate(self.asked) if asked == (id, exchange.request))


def _number(number: int, size: int) -> bytes:
    return (number.to_bytes(2, "little") * size)[:size]


def _dynamixel(id: int, packet: Packet, number: int) -> bytes | None:
    framing = dynamixel_packets.FRAMING
    if packet.code in (SYNC_READ, BULK_READ):
        return framing.frame(Packet(id, 0, _number(number, 2)))
    message = dynamixel_packets.parse_instruction(packet)
    size = message.length if isinstance(message, dynamixel_packets.ReadData) else 0
    return framing.frame(Packet(id, 0, _number(number, size)))


def _herkulex(id: int, packet: Packet, number: int) -> bytes | None:
    message = herkulex_packets.parse_request(packet)
    code = packet.code | herkulex_packets.ACK
    if isinstance(message, herkulex_packets.RamRead | herkulex_packets.EepRead):
        data = bytes((message.address, message.length)) + _number(number, message.length) + bytes(2)
        return herkulex_packets.FRAMING.frame(Packet(id, code, data))
    if isinstance(message, herkulex_packets.Stat):
        return herkulex_packets.FRAMING.frame(Packet(id, code, bytes(2)))
    return None


def read(family: str, id: int) -> Exchange[bytes]:
    return dynamixel1.read_data(id, 36, 2) if family == "dynamixel" else herkulex.ram_read(id, 58, 2)


# The jobs


def single(family: str) -> Procedure[Any]:
    return (yield read(family, 1))


def batch(family: str) -> Procedure[Any]:
    return (yield Batch([read(family, id) for id in IDS]))


def group(_: str) -> Procedure[Any]:
    return (yield sync_read(*IDS))


def together(_: str) -> Procedure[Any]:
    """What one request can ask of all."""
    return (yield Batch([dynamixel1.read_data(id, 36, 2, bulk=True) for id in IDS]))


def command(family: str) -> Procedure[Any]:
    """What nothing answers, and a question behind it."""
    unanswered = (
        dynamixel1.sync_write(25, {1: b"\x01"}) if family == "dynamixel" else herkulex.ram_write(1, 53, b"\x01")
    )
    yield unanswered
    return (yield read(family, 1))


def speeds(family: str) -> Procedure[Any]:
    """Questions at several speeds, with pauses."""
    seen = []
    for baud in (1_000_000, 57_600, 115_200):
        yield SetBaud(baud)
        seen.append((yield read(family, 1)))
        yield Pause(0.01, shared=baud == 57_600)
    return seen


def search(family: str) -> Procedure[Any]:
    return (yield from scan([FAMILIES[family]], [1_000_000], range(3)))


JOBS = [
    *((family, job) for family in ("dynamixel", "herkulex") for job in (single, batch, command, speeds, search)),
    ("dynamixel", group),
    ("dynamixel", together),
]
EVERY_JOB = pytest.mark.parametrize(("family", "job"), JOBS, ids=[f"{family}-{job.__name__}" for family, job in JOBS])


# The ways to break a job off


def close(link: Link, waits: Waits[Any]) -> Link:
    waits.close()
    return link


def interrupt(link: Link, waits: Waits[Any]) -> Link:
    with pytest.raises(KeyboardInterrupt):
        waits.throw(KeyboardInterrupt())
    return link


def take_over(link: Link, waits: Waits[Any]) -> Link:
    """Take the line over while the job waits, as a stop does; the job finds out when it goes on."""
    new = link.supersede()
    with pytest.raises(Stopped):
        link.check()
    waits.close()
    return new


WAYS = pytest.mark.parametrize("way", [close, take_over])
HEARD = pytest.mark.parametrize("heard", [True, False], ids=["bytes were lost", "bytes are there"])
"""Whether what the wait was for was taken from the port before the job was broken off."""


def carry_out(link: Link, waits: Waits[Any]) -> Any:
    """Carry a job out, as a driver does."""
    chunk = b""
    try:
        wait = next(waits)
        while True:
            chunk = passed(link, wait)
            wait = waits.send(chunk)
    except StopIteration as stop:
        return stop.value


def passed(link: Link, wait: Any) -> bytes:
    if isinstance(wait, Receive):
        return link.transport.read(wait.seconds)
    link.transport.sleep(wait.seconds)
    return b""


def broken_off(link: Link, waits: Waits[Any], at: int, way: Callable[[Link, Waits[Any]], Link], *, heard: bool) -> Any:
    """Carry a job out up to one of its waits; give the link to go on with, or None if the job has ended before."""
    chunk = b""
    try:
        wait = next(waits)
        for _ in range(at):
            chunk = passed(link, wait)
            wait = waits.send(chunk)
    except (StopIteration, BusError):
        return None
    if heard:
        passed(link, wait)
    return way(link, waits)


def every_wait(break_off: Callable[[int], bool], step: int = 1) -> int:
    """Break off at the first wait, the second and so on, as long as there is one; give how many there were.

    With a step, and without `--all`, it goes on by so many waits.
    """
    return next(n for n in itertools.count(0, 1 if extent.everything else step) if not break_off(n))


# What must be so afterwards


def look_numbered(link: Link, port: Numbered, family: str) -> int:
    """Ask on, alone, in a batch and as a group; give how many answers came. Each must be the newest."""
    came = 0
    for _ in range(LOOKS):
        for question in (read(family, 1), read(family, 2)):
            came += right(port, question, question.id, outcome(link, question))
        questions = [read(family, id) for id in IDS]
        for question, found in zip(questions, outcome(link, one_batch(questions)), strict=True):
            came += right(port, question, question.id, found)
        if family == "dynamixel":
            parts = [dynamixel1.read_data(id, 36, 2, bulk=True) for id in IDS]
            (bulk_read,) = joined(parts)
            for group, job in ((sync_read(*IDS), None), (bulk_read, one_batch(parts))):
                began = len(port.asked)
                numbers = outcome(link, job or group)
                for id, number in zip(IDS, numbers if isinstance(numbers, list) else [], strict=False):
                    # It may be asked twice, and who answered the first time keeps what it said then.
                    came += right(port, group, id, number, since=began, alone=group.parts[IDS.index(id)])
        port.sleep(0.5)
    assert link.state in (LinkState.IDLE, LinkState.CAREFUL, LinkState.UNSURE)
    return came


def right(
    port: Numbered,
    exchange: Exchange[Any],
    id: int,
    found: Any,
    since: int | None = None,
    alone: Exchange[Any] | None = None,
) -> bool:
    """Tell whether an answer came, and make sure that it is one to this, or to what asks the same of one alone."""
    if isinstance(found, BusError):
        return False
    number = found if isinstance(found, int) else int.from_bytes(found, "little")
    asked, request = port.asked[number]
    assert asked == id
    fewer = exchange.request[4] == request[4] == BULK_READ  # one of them had to be asked alone
    assert fewer or request in [one.request for one in (exchange, alone) if one is not None]
    assert number >= (port.newest(exchange, id) if since is None else since)
    return True


def one_batch(exchanges: Sequence[Exchange[Any]]) -> Procedure[list[Any]]:
    results: list[Any] = yield Batch(exchanges)
    return results


def outcome(link: Link, job: Any) -> Any:
    try:
        return carry_out(link, link.run(job))
    except BusError as error:
        return error


@EVERY_JOB
@pytest.mark.parametrize(
    ("way", "heard", "late"),
    [*itertools.product([close, take_over], [True, False], [0.0, 0.02]), (interrupt, True, 0.02), (close, True, 0.12)],
)
def test_numbered_replies(family: str, job: Any, way: Any, heard: bool, late: float) -> None:
    """Scripted line: every reply comes so many seconds late, and none is ever taken for another."""

    def checked(at: int) -> bool:
        port = Numbered(family, late)
        first = Bus(port, echo=False).link
        link = broken_off(first, first.run(job(family)), at, way, heard=heard)
        if link is None:
            return False
        came = look_numbered(link, port, family)
        port.late = 0.0
        port.sleep(2.5)  # no servo answers so late
        for question in (read(family, 1), read(family, 2)):
            outcome(link, question)
            assert right(port, question, question.id, outcome(link, question)), "it must come to itself again"
        assert late > 0.05 or came > 0
        return True

    assert every_wait(checked, step=2) > 0


# On virtual lines


def virtual(family: str) -> tuple[Bus, VirtualPort]:
    model = {"dynamixel": "rx28", "herkulex": "drs0602"}[family]
    bus = servobus.open(f"virtual:{model}@1-3?clock=virtual&baud=115200", bauds=115_200)
    port = bus.transport
    assert isinstance(port, VirtualPort)
    return bus, port


def punch(family: str, id: int) -> Exchange[bytes]:
    """Ask for a register that nothing changes but the test."""
    return dynamixel1.read_data(id, 48, 2) if family == "dynamixel" else herkulex.ram_read(id, 53, 1)


def put(port: VirtualPort, family: str, number: int) -> None:
    for servo in port.servos:
        if family == "dynamixel":
            servo.put("punch", 100 + number)
        else:
            servo.put("led_control", number % 8)


def virtual_jobs(family: str) -> Iterator[Callable[[], Procedure[Any]]]:
    def one() -> Procedure[Any]:
        return (yield punch(family, 1))

    def several() -> Procedure[Any]:
        return (yield Batch([punch(family, id) for id in IDS]))

    def fast_and_slow() -> Procedure[Any]:
        for baud in (1_000_000, 115_200):
            yield SetBaud(baud)
            yield Batch([punch(family, 1).no_retry()])

    yield from (one, several, fast_and_slow, lambda: scan([FAMILIES[family]], [115_200], range(3)))


@pytest.mark.parametrize("family", ["dynamixel", "herkulex"])
@WAYS
@HEARD
def test_virtual_servos(family: str, way: Any, heard: bool) -> None:
    """A register is given a new value after the job was broken off: it is read so, or there is an error."""

    def checked(job: Callable[[], Procedure[Any]], at: int) -> bool:
        bus, port = virtual(family)
        bus.link.echo = False
        put(port, family, 1)
        port.inject("stall=0.2:40ms,mute=0.1,drop=0.02,junk=0.05:1-9,seed=5")
        link = broken_off(bus.link, bus.link.run(job()), at, way, heard=heard)
        if link is None:
            return False
        for number in range(2, 2 + LOOKS):
            put(port, family, number)
            expected = (100 + number).to_bytes(2, "little") if family == "dynamixel" else bytes((number % 8,))
            seen = outcome(link, one_batch([punch(family, id) for id in IDS]))
            seen.append(outcome(link, punch(family, 1)))
            assert all(isinstance(one, BusError) or one == expected for one in seen)
        port.inject(None)
        port.sleep(2.5)
        carry_out(link, link.set_baud(115_200))
        outcome(link, punch(family, 1))
        assert outcome(link, punch(family, 1)) == expected
        return True

    for job in virtual_jobs(family):
        waits = every_wait(lambda at, job=job: checked(job, at), step=3)  # type: ignore[misc]
        assert waits > 0


class Telling(Numbered):
    """A port that can say that nothing is there, which opens the fast path; on a clock that waiting advances."""

    def pending(self) -> bool:
        return bool(self._due) and self._due[0][0] <= self._now


@pytest.mark.parametrize("job", [single, batch, command], ids=lambda job: job.__name__)
@pytest.mark.parametrize(
    ("way", "heard", "late"),
    [*itertools.product([close, take_over], [True, False], [0.0, 0.003, 0.02]), (interrupt, True, 0.02)],
)
def test_numbered_replies_on_the_fast_path(
    monkeypatch: pytest.MonkeyPatch, job: Any, way: Any, heard: bool, late: float
) -> None:
    """As above, on a port that may take the fast path; it goes by the clock of the computer, here the port's own."""

    def checked(at: int) -> bool:
        port = Telling("dynamixel", late)
        monkeypatch.setattr("servobus.link.link.monotonic", port.now)
        first = Bus(port, echo=False).link
        link = broken_off(first, first.run(job("dynamixel")), at, way, heard=heard)
        if link is None:
            return False
        came = look_numbered(link, port, "dynamixel")
        port.late = 0.0
        came += look_numbered(link, port, "dynamixel")
        assert came > 0
        return True

    assert every_wait(checked) > 0


class Real(Numbered):
    """A port that can say that nothing is there, as one with a descriptor has, on a clock that runs."""

    def pending(self) -> bool:
        return bool(self._due) and self._due[0][0] <= self.now()

    def read(self, timeout: float) -> bytes:
        end = self.now() + timeout
        while not self.pending() and self.now() < end:
            time.sleep(0.0002)
        return self._due.pop(0)[1] if self.pending() else b""

    def now(self) -> float:
        self._now = time.monotonic()
        return self._now

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


def asked_until_answered(link: Link, port: Numbered, question: Exchange[Any]) -> bool:
    """Ask some times; tell whether an answer came. Each must be the newest."""
    came = [right(port, question, question.id, outcome(link, question)) for _ in range(5)]
    return any(came)


@pytest.mark.parametrize("told", [True, False])
def test_the_fast_path_dropped_behind_its_write_is_remembered(told: bool) -> None:
    """Ctrl-C may come before the driver can say that the wait has ended: the reply is a late one all the same."""
    port = Real("dynamixel", 0.0)
    bus = Bus(port, echo=False)
    question = read("dynamixel", 1)
    bus.do(question)
    port.late = 0.02
    assert bus.link.try_fast_send(question) > 0
    if told:
        bus.link.abandon()
    port.late = 0.0
    assert asked_until_answered(bus.link, port, question)
    assert bus.stats[1].late >= 1


def test_what_is_under_way_when_a_stop_takes_over_is_remembered() -> None:
    port = Real("dynamixel", 0.0)
    bus = Bus(port, echo=False)
    question = read("dynamixel", 1)
    bus.do(question)
    port.late = 0.02
    assert bus.link.try_fast_send(question) > 0
    link = bus.link.supersede()
    port.late = 0.0
    assert bus.link.try_fast_send(question) == 0.0  # the old one sends nothing any more
    with pytest.raises(Stopped):
        carry_out(bus.link, bus.link.transact(question))
    assert asked_until_answered(link, port, question)
