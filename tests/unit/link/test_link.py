"""The rules of the link, against scripted answers: what is sent when, and what is never taken for an answer.

Bytes are the RX-28 manual's (3-5-1, 3-5-5), or built by its checksum rule. A PING is a marker: its answer has no
data, so that it cannot be mistaken for that of a read; where a PING itself is in doubt, a read of one byte is.
"""

import asyncio
import time
from collections.abc import Callable
from typing import Any

import pytest

import servobus
from servobus import DRS0602, RX28, BadChecksum, Bus, NoReply, dynamixel1
from servobus.bus.asyncio import AsyncBus
from servobus.core.exchange import Batch, Now, Pause, Procedure, ReplyPattern
from servobus.core.framing import Packet
from servobus.errors import BrokenEcho, DuplicateId, Garbled, LineBusy
from servobus.link.latency import Latency
from servobus.virtual.serve.inprocess import VirtualPort
from unit.bus.test_blocking import ANSWER, MODEL_BYTE, OK, PING, TEMPERATURE
from unit.scripted import Scripted

OTHER = "FF FF 01 04 02 29 01 CE"  # read 1 byte at 41, the other of two questions that are answered alike
COLD = "FF FF 01 03 00 05 F6"  # ~(01+03+00+05) = F6
MODEL = "FF FF 01 04 02 00 01 F7"
FIRST_BYTES = "FF FF 01 04 02 00 03 F5"  # the next marker: three bytes from 0
THREE = "FF FF 01 05 00 1C 00 18 C5"  # ~(01+05+1C+18) = C5
SEVEN_BYTES = "FF FF 01 04 02 00 07 F1"  # and the last one: seven
SEVEN = "FF FF 01 09 00 1C 00 18 01 22 FA 00 A4"  # ~(01+09+1C+18+01+22+FA) = A4
MILLISECOND = 0.001


class Timed(Scripted):
    """A scripted port where bytes also come when nobody asks."""

    def write(self, data: bytes) -> None:
        super().write(data)
        self._due.sort()

    def say(self, *answers: tuple[float, str]) -> None:
        """Let bytes come so many seconds from now."""
        self._due += [(self._now + after, bytes.fromhex(answer)) for after, answer in answers]
        self._due.sort()


def linked(*script: str | None, echo: bool | None = False) -> tuple[Bus, Timed]:
    port = Timed(*script)
    bus = Bus(port, echo=echo)
    bus.attach(RX28, 1)
    return bus, port


def temperature(bus: Bus) -> float:
    return bus[1].read(RX28.present_temperature)


class TestLateAnswers:
    def test_a_marker_goes_before_the_same_kind_of_question(self) -> None:
        bus, port = linked(None, OK, ANSWER)
        assert temperature(bus) == 32.0
        assert port.requests == [TEMPERATURE, PING, TEMPERATURE]
        assert bus.stats[1].timeouts == bus.stats[1].retries == 1

    def test_what_comes_before_the_markers_answer_is_late_and_no_answer(self) -> None:
        bus, port = linked(None, COLD + OK, ANSWER)
        assert temperature(bus) == 32.0
        assert port.requests == [TEMPERATURE, PING, TEMPERATURE]
        assert bus.stats[1].late == 1

    def test_no_marker_goes_before_a_question_of_another_kind(self) -> None:
        bus, port = linked(None)
        with pytest.raises(NoReply):
            bus.do(dynamixel1.read_data(1, 43, 1).no_retry())
        port.requests.clear()
        port.script = [THREE]
        assert bus.do(dynamixel1.read_data(1, 0, 3)) == b"\x1c\x00\x18"
        assert port.requests == [FIRST_BYTES]

    def test_a_read_after_a_lost_ping_is_no_refusal(self) -> None:
        # The late answer to the PING has no data, as a refusal of the read would have none.
        bus, port = linked(None, None)
        with pytest.raises(NoReply):
            bus[1].ping()
        port.requests.clear()
        port.script = [OK + MODEL_BYTE, ANSWER]
        assert temperature(bus) == 32.0
        assert port.requests == [MODEL, TEMPERATURE]

    def test_a_marker_is_not_answered_by_an_older_ping(self) -> None:
        bus, port = linked(None, None)
        with pytest.raises(NoReply):
            temperature(bus)  # and the PING behind it was lost too
        port.requests.clear()
        port.script = [COLD + OK + THREE, ANSWER]
        assert temperature(bus) == 32.0
        assert port.requests == [FIRST_BYTES, TEMPERATURE]

    def test_when_no_new_marker_is_left_the_last_one_is_asked_again(self) -> None:
        bus, port = linked(*[None] * 12)
        for _ in range(6):
            with pytest.raises(NoReply):
                temperature(bus)
        asked = port.requests[1:]
        assert TEMPERATURE not in asked
        assert asked[-2:] == [SEVEN_BYTES] * 2
        port.script = [COLD + SEVEN, ANSWER]
        assert temperature(bus) == 32.0
        assert port.requests[-2:] == [SEVEN_BYTES, TEMPERATURE]

    def test_two_answers_to_a_marker_that_was_asked_twice_are_no_second_servo(self) -> None:
        bus, port = linked(*[None] * 12)
        for _ in range(6):
            with pytest.raises(NoReply):
                temperature(bus)
        port.script = [COLD + SEVEN + SEVEN, ANSWER]
        assert temperature(bus) == 32.0
        assert bus.stats[1].doubled == 0

    def test_a_silent_servo_does_not_keep_another_from_being_asked_again(self) -> None:
        port = Timed()
        bus = Bus(port, echo=False)
        one, two = (bus.attach(DRS0602, id) for id in (1, 2))
        rows = [row for row in DRS0602.registers.values() if row.readable][20:36]
        for row in rows:  # so many kinds of questions in vain that no marker is left behind the last
            with pytest.raises(NoReply):
                one.read(row)
        with pytest.raises(NoReply, match="not asked: an older answer could still come"):
            one.read(rows[-1])
        for _ in range(30):
            port.sleep(0.1)
            with pytest.raises(NoReply):
                two.ping()
        port.requests.clear()
        with pytest.raises(NoReply):
            one.read(rows[-1])
        assert port.requests

    @pytest.mark.parametrize(
        ("mine", "other", "mistaken"),
        [
            (ReplyPattern(1, None, (2, 0)), ReplyPattern(1, None, (2, 0)), True),
            (ReplyPattern(1, None, (2, 0)), ReplyPattern(1, None, (1, 0)), False),
            (ReplyPattern(1, None, (2, 0)), ReplyPattern(1, None, (0,)), True),  # as a refusal
            (ReplyPattern(1, None, (0,)), ReplyPattern(1, None, (2, 0)), False),
            (ReplyPattern(1, None, (2,)), ReplyPattern(1, None, (0,)), False),
            (ReplyPattern(1, None, (2, 0)), ReplyPattern(2, None, (2, 0)), False),
            (ReplyPattern(None, 14, (1,)), ReplyPattern(2, 14, (1,)), True),
            (ReplyPattern(1, 0x44, (6, 2), b"\x3a\x02"), ReplyPattern(1, 0x44, (6, 2), b"\x36\x02"), False),
            (ReplyPattern(1, 0x44, (6, 2), b"\x3a\x02"), ReplyPattern(1, 0x43, (2,)), False),
        ],
    )
    def test_which_answers_can_be_mistaken(self, mine: ReplyPattern, other: ReplyPattern, mistaken: bool) -> None:
        assert mine.could_be(other) is mistaken


class TestWindow:
    """An answer that comes sooner than its bits allow is an older one; where bits take their time at all."""

    WIRE = (8 + 7) * 10 / 57_600
    """s that request and answer take."""

    def calm(self, *, timed: bool) -> tuple[Bus, Timed]:
        bus, port = linked(*[ANSWER] * Latency.ENOUGH)
        port.timed = timed
        port.delay = 7 * 10 / 57_600 + 0.0005
        for _ in range(Latency.ENOUGH):
            assert temperature(bus) == 32.0
        return bus, port

    def test_too_soon_is_a_second_answer(self) -> None:
        bus, port = self.calm(timed=True)
        port.script = [ANSWER]
        port.say((0.5 * self.WIRE, COLD))
        with pytest.raises(DuplicateId):
            temperature(bus)

    def test_too_soon_alone_is_asked_again(self) -> None:
        bus, port = self.calm(timed=True)
        port.script = [None, OK, ANSWER]
        port.say((0.5 * self.WIRE, COLD))
        assert temperature(bus) == 32.0

    def test_a_line_without_speed_has_no_too_soon(self) -> None:
        bus, port = self.calm(timed=False)
        port.script = [None]
        port.say((0.5 * self.WIRE, COLD))
        assert temperature(bus) == 5.0

    def test_it_is_so_from_the_first_question_on(self) -> None:
        bus, port = linked(None, OK, ANSWER)
        port.timed, port.delay = True, 7 * 10 / 57_600 + 0.0005
        port.say((0.5 * self.WIRE, COLD))
        assert temperature(bus) == 32.0


class TestQuiet:
    def test_after_garbage_nothing_is_sent_until_the_line_is_quiet(self) -> None:
        bus, port = linked("12 34", OK, ANSWER)
        port.say((0.009, "56"), (0.012, "78"))  # the answer was given up some 7 ms after the request
        assert temperature(bus) == 32.0
        assert port.now() > 0.012 + 0.004 + 0.001
        assert bus.stats[1].retries == 1

    def test_a_line_that_is_never_quiet_is_said_to_be(self) -> None:
        bus, port = linked("12 34")
        port.say(*((0.001 * n, "00") for n in range(1000)))
        with pytest.raises(LineBusy, match="although nothing was asked") as caught:
            temperature(bus)
        assert len(caught.value.heard) > 200
        assert port.requests == []

    def test_bytes_that_came_meanwhile_are_no_answer(self) -> None:
        bus, port = linked(None, OK, ANSWER)
        port.say((0.0, COLD))
        port.sleep(0.01)
        with pytest.raises(NoReply):
            bus.do(dynamixel1.read_data(1, 43, 1).no_retry())


class TestEcho:
    def test_a_broken_echo_is_an_error(self) -> None:
        bad = TEMPERATURE.replace("2B", "2A")
        bus, _ = linked(bad + ANSWER, echo=True)
        with pytest.raises(BrokenEcho, match=r"FF FF 01 04 02 2A 01 CC came back"):
            bus.do(dynamixel1.read_data(1, 43, 1).no_retry())
        assert bus.stats[1].echo == 1

    def test_and_a_read_is_asked_again(self) -> None:
        bad = TEMPERATURE.replace("2B", "2A")
        bus, _ = linked(bad + COLD, PING + OK, TEMPERATURE + ANSWER, echo=True)
        assert temperature(bus) == 32.0

    def test_an_echo_that_appears_later_is_no_answer(self) -> None:
        read = "FF FF 01 04 02 24 02 D2"  # two bytes at 36: as a status packet it would say 0x0224
        bus, port = linked("FF FF 01 04 00 00 02 F8")
        assert bus.do(dynamixel1.read_data(1, 36, 2)) == b"\x00\x02"
        port.script = [f"{read} FF FF 01 04 00 2C 01 CD", f"00 {PING} {OK}", f"{read} FF FF 01 04 00 2C 01 CD"]
        assert bus.do(dynamixel1.read_data(1, 36, 2)) == b"\x2c\x01"
        assert bus.echo is True
        assert bus.stats[1].doubled == 0

    def test_a_servo_whose_answer_is_the_request_is_no_echo(self) -> None:
        bus, port = linked(PING, MODEL_BYTE, PING)  # a voltage error: FF FF 01 02 01 FB both ways
        alarms = bus[1].read_alarms()
        assert alarms == dynamixel1.Error.INPUT_VOLTAGE
        assert bus.echo is False
        assert port.requests[-1] == f"00 {PING}"


class TestTwoServos:
    def test_two_answers_at_once(self) -> None:
        bus, _ = linked(ANSWER + COLD)
        with pytest.raises(DuplicateId, match="two servos with id 1, or one that came twice or late, or an echo; if"):
            temperature(bus)

    def test_a_second_answer_that_is_found_later(self) -> None:
        bus, port = linked(ANSWER, OK)
        port.say((0.006, COLD))
        assert temperature(bus) == 32.0
        port.sleep(0.01)
        with pytest.raises(DuplicateId):
            bus[1].ping()
        assert port.requests == [TEMPERATURE]
        bus[1].ping()  # it is told once
        assert bus.stats[1].doubled == 1


class TestPatience:
    """How long to wait is learned from what comes; figures are those of `Latency`."""

    def test_it_begins_with_what_the_adapter_is_thought_to_need(self) -> None:
        port = Scripted()
        port.latency = 0.025
        assert Latency(port).reply_margin == 0.025

    def test_it_comes_down_when_answers_come_soon(self) -> None:
        port = Scripted()
        port.latency = 0.025
        latency = Latency(port)
        for _ in range(2 * Latency.ENOUGH):
            latency.note(MILLISECOND)
        assert latency.reply_margin == Latency.FLOOR

    def test_it_goes_up_at_once_and_fades_slowly(self) -> None:
        latency = Latency(Scripted())
        latency.note(0.030)
        assert latency.reply_margin == pytest.approx(0.064)  # twice that, and 4 ms
        for _ in range(300):
            latency.note(MILLISECOND)
        assert 0.04 < latency.reply_margin < 0.064

    def test_it_has_a_limit(self) -> None:
        latency = Latency(Scripted())
        latency.note(0.001)
        latency.note(3600.0)
        assert latency.reply_margin == Latency.LONGEST

    def test_T8_what_is_late_each_time_is_waited_for(self) -> None:
        latency = Latency(Scripted())
        for _ in range(1000):
            latency.note(0.2)
            assert 0.25 < latency.reply_margin <= Latency.HABIT
        assert latency.usual_delay == 0.2
        latency.note(0.001)
        latency.review()
        assert latency.reply_margin == Latency.LONGEST
        only = Latency(Scripted())
        only.note(3600.0)
        assert only.reply_margin == Latency.HABIT

    def test_a_late_answer_teaches_it(self) -> None:
        bus, _ = linked(None, ANSWER + OK, ANSWER)
        before = bus.link.latency.reply_margin
        temperature(bus)
        assert bus.link.latency.reply_margin > before


class TestSeveralAtOnce:
    """A volley: the next question goes out before the last answer is in."""

    IDS = (1, 2, 3)

    def answers(self, framing: Any, code: int, data: bytes) -> list[str]:
        from servobus.core.framing import Packet  # noqa: PLC0415

        return [framing.frame(Packet(id, code, data)).hex(" ") for id in self.IDS]

    def test_on_a_full_duplex_line_all_go_out_in_one_piece(self) -> None:
        family = DRS0602.family
        script = self.answers(family.framing, 0x47, b"\x00\x00")
        port = Timed("".join(script))
        bus = Bus(port, echo=False)

        def job() -> Any:
            return (yield Batch([family.ping(id) for id in self.IDS]))

        assert bus.do(job()) == [None, None, None]
        (request,) = port.requests
        # STAT is 7 bytes, its answer 9 or, if the servo is 3 % slow, 9.3; 2 keep answers apart: 12, filled with 00.
        assert len(bytes.fromhex(request)) == 12 * 2 + 7
        assert [bus.stats[id].received for id in self.IDS] == [1, 1, 1]

    def test_on_one_wire_each_waits_for_the_answer_before_it(self) -> None:
        port = Timed(*self.answers(RX28.family.framing, 0, b""))
        bus = Bus(port, echo=False)

        def job() -> Any:
            return (yield Batch([RX28.family.ping(id) for id in self.IDS]))

        assert bus.do(job()) == [None, None, None]
        assert len(port.requests) == 3

    def test_what_is_lost_is_asked_again_alone_and_strangers_are_told(self) -> None:
        first, _, third = self.answers(RX28.family.framing, 0, b"")
        port = Timed(first, "FF FF 09 02 00 F4", third, "FF FF 02 02 00 FB")
        bus = Bus(port, echo=False)

        def job() -> Any:
            return (yield Batch([RX28.family.ping(id) for id in self.IDS]))

        assert bus.do(job()) == [None, None, None]
        assert bus.stats[2].retries == 1
        assert bus.stats[9].strangers == 1

    def test_an_answer_that_comes_before_its_question_is_none(self) -> None:
        first, second, third = self.answers(RX28.family.framing, 0, b"")
        port = Timed(first, second, third)
        port.say((0.0, second))
        bus = Bus(port, echo=False)
        port.discard = lambda: b""  # type: ignore[method-assign] # it comes just behind the look at what is there

        def job() -> Any:
            return (yield Batch([RX28.family.ping(id) for id in self.IDS]))

        one, two, three = bus.do(job())
        assert (one, three) == (None, None)
        assert isinstance(two, DuplicateId)
        assert bus.stats[2].strangers >= 1

    def test_silence_is_an_error_in_its_place(self) -> None:
        first, _, third = self.answers(RX28.family.framing, 0, b"")
        port = Timed(first, None, third, None)
        bus = Bus(port, echo=False)

        def job() -> Any:
            return (yield Batch([RX28.family.ping(id) for id in self.IDS]))

        one, two, three = bus.do(job())
        assert (one, three) == (None, None)
        assert isinstance(two, NoReply)


class Instant(Scripted):
    """Real time, and a port that tells whether bytes are there: what the shortest way needs."""

    def pending(self) -> bool:
        return bool(self._due)

    def read(self, timeout: float) -> bytes:
        if self._due:
            return self._due.pop(0)[1]
        time.sleep(timeout)
        return b""

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


def outcome(job: Callable[[], Any]) -> Any:
    try:
        return job()
    except Exception as error:  # noqa: BLE001 - which one it is, is what is compared
        return type(error)


SCRIPTS = {
    "answer": (ANSWER,),
    "junk before": (f"12 34 {ANSWER}",),
    "silence, then right": (None, OK, ANSWER),
    "silence": (None, None),
    "bad checksum, then right": ("FF FF 01 03 00 21 DB", OK, ANSWER),
    "bad checksum": ("FF FF 01 03 00 21 DB", OK, "FF FF 01 03 00 21 DB"),
    "stranger": ("FF FF 02 03 00 20 DA", OK, "FF FF 02 03 00 20 DA"),
    "two answers": (ANSWER + COLD,),
    "wrong length": ("FF FF 01 04 00 20 03 D7", OK, "FF FF 01 04 00 20 03 D7"),
    "its own request": (TEMPERATURE, OK, ANSWER),
    "alarm": ("FF FF 01 03 24 20 B7",),
    "refusal": ("FF FF 01 02 08 F4",),
}


@pytest.mark.parametrize("name", SCRIPTS)
def test_the_short_way_and_the_long_way_come_to_the_same(name: str) -> None:
    def run(*, short: bool) -> Any:
        port = Instant(ANSWER, *SCRIPTS[name])
        bus = Bus(port, echo=False)
        servo = bus.attach(RX28, 1)
        servo.read(RX28.present_temperature)
        if not short:
            port.pending = lambda: True  # type: ignore[method-assign]
        result = outcome(lambda: servo.read(RX28.present_temperature))
        counts = bus.stats.total
        told = {kind: getattr(counts, kind) for kind in ("sent", "received", "timeouts", "checksum", "strangers")}
        return result, port.requests, servo.alarms, told

    assert run(short=True) == run(short=False)


TEMPERATURES = {id: dynamixel1.FRAMING.frame(Packet(id, 0, bytes((30 + id,)))).hex(" ") for id in (1, 2, 3)}
BATCHES = {
    "answers": tuple(TEMPERATURES.values()),
    "the first is silent": (None, TEMPERATURES[2], TEMPERATURES[3]),
    "the second is silent": (TEMPERATURES[1], None, TEMPERATURES[3]),
    "the last is silent": (TEMPERATURES[1], TEMPERATURES[2], None),
    "all are silent": (None, None, None),
    "a refusal": (TEMPERATURES[1], "FF FF 02 02 08 F3", TEMPERATURES[3]),
    "bad checksum": ("FF FF 01 03 00 20 DC", TEMPERATURES[2], TEMPERATURES[3]),
    "a stranger": (TEMPERATURES[1], "FF FF 07 03 00 20 D5", TEMPERATURES[3]),
}


@pytest.mark.parametrize("name", BATCHES)
def test_a_batch_comes_to_the_same_on_the_short_way(name: str) -> None:
    def job() -> Any:
        return (yield Batch([dynamixel1.read_data(id, 43, 1) for id in (1, 2, 3)], again=False))

    def run(*, short: bool) -> Any:
        port = Instant(ANSWER, *BATCHES[name])
        bus = Bus(port, echo=False)
        bus.do(dynamixel1.read_data(1, 43, 1))
        if not short:
            port.pending = lambda: True  # type: ignore[method-assign]
        found = [one if isinstance(one, bytes) else type(one) for one in bus.do(job())]
        counts = bus.stats.total
        told = {kind: getattr(counts, kind) for kind in ("sent", "received", "timeouts", "checksum", "strangers")}
        return found, port.requests, told, bus.link.state

    assert run(short=True) == run(short=False)


def test_noise_in_a_batch_is_not_held_against_what_was_heard_before_the_next_question() -> None:
    """Two replies that meet can look like one that is right; one that came before the next question met none."""

    def job() -> Any:
        return (yield Batch([dynamixel1.read_data(id, 43, 1) for id in (1, 2, 3)], again=False))

    port = Instant(ANSWER, TEMPERATURES[1], "FF FF 02 03 00 20 DB", TEMPERATURES[3])
    bus = Bus(port, echo=False)
    bus.do(dynamixel1.read_data(1, 43, 1))
    first, *others = bus.do(job())
    assert first == bytes((31,))
    assert [type(other) for other in others] == [Garbled, Garbled]


@pytest.mark.parametrize("goals", [True, False], ids=["behind goals", "alone"])
def test_a_batch_on_a_calm_line_takes_the_short_way(goals: bool) -> None:
    port = Instant(ANSWER, *[None] * goals, *TEMPERATURES.values())
    bus = Bus(port, echo=False)
    bus.do(dynamixel1.read_data(1, 43, 1))

    def job() -> Any:
        if goals:
            yield dynamixel1.sync_write(30, {1: b"\x00\x02"})
        bus.link._ready = never  # type: ignore[method-assign]
        return (yield Batch([dynamixel1.read_data(id, 43, 1) for id in (1, 2, 3)]))

    def never(*_: object, **__: object) -> Any:
        raise AssertionError

    assert bus.do(job()) == [bytes((30 + id,)) for id in (1, 2, 3)]


def test_the_short_way_is_what_a_calm_line_takes() -> None:
    port = Instant(ANSWER, ANSWER)
    bus = Bus(port, echo=False)
    servo = bus.attach(RX28, 1)
    servo.read(RX28.present_temperature)

    def never(*_: object) -> Any:
        raise AssertionError

    bus.link.transact = never  # type: ignore[assignment,method-assign]
    assert servo.read(RX28.present_temperature) == 32.0


class Waiting(Instant):
    """Says nothing until it is told to; an event loop asks it in a thread."""

    def blocking(self) -> bool:
        return True

    def read(self, timeout: float) -> bytes:
        end = time.monotonic() + timeout
        while not self._due and time.monotonic() < end:
            time.sleep(0.0005)
        return self._due.pop(0)[1] if self._due else b""


@pytest.mark.parametrize("calm", [False, True], ids=["long way", "short way"])
def test_who_gives_up_leaves_a_doubt(calm: bool) -> None:
    """A cancelled question may still be answered: the next of its kind comes behind a marker."""

    async def main() -> None:
        port = Waiting(*[ANSWER] * 2 if calm else [])
        port.latency = 0.3
        bus = AsyncBus(port, echo=False)
        servo = bus.attach(RX28, 1)
        if calm:
            await servo.read(RX28.present_temperature)
            await servo.read(RX28.present_temperature)
        port.requests.clear()
        port.script = [None]
        question = asyncio.ensure_future(servo.read(RX28.present_temperature))
        await asyncio.sleep(0.01)
        assert port.requests == [TEMPERATURE]
        question.cancel()
        with pytest.raises(asyncio.CancelledError):
            await question
        await asyncio.sleep(0.35)  # until the thread that waited for it has ended
        port.script = [COLD + OK, ANSWER]
        assert await servo.read(RX28.present_temperature) == 32.0
        assert port.requests == [TEMPERATURE, PING, TEMPERATURE]
        assert bus.stats[1].late == 1

    asyncio.run(main())


def test_of_two_errors_silence_says_less() -> None:
    bus, _ = linked("FF FF 01 03 00 21 DB", None)
    with pytest.raises(BadChecksum):
        temperature(bus)


def test_a_procedure_can_ask_for_the_time() -> None:
    def job() -> Procedure[tuple[float, float]]:
        before: float = yield Now()
        yield Pause(0.25)
        after: float = yield Now()
        return before, after

    bus, port = linked()
    port.sleep(1.5)
    assert bus.do(job()) == (1.5, 1.75)


def test_P7_answers_to_a_broadcast_ping_make_no_second_servo() -> None:
    for pause in (0.0, 0.001, 0.1):
        bus = servobus.open("virtual:rx28@1-3,broadcast_ping=answered?clock=virtual")
        for id in (1, 2, 3):
            bus.attach(RX28, id).ping()
        bus.do(dynamixel1.ping(254), baud=57_600)
        bus.transport.sleep(pause)
        for id in (3, 1, 2, 1):
            bus[id].ping()
            assert bus[id].read(RX28.id) == id
        assert bus.stats.total.doubled == 0


def test_P7_two_servos_are_told_all_the_same_later_on() -> None:
    bus = servobus.open("virtual:rx28@1,broadcast_ping=answered?clock=virtual")
    servo = bus.attach(RX28, 1)
    bus.do(dynamixel1.ping(254), baud=57_600)
    bus.transport.sleep(2.1)
    servo.ping()
    assert isinstance(bus.transport, VirtualPort)
    bus.transport.inject("twin#1")
    servo.ping()
    bus.transport.sleep(0.1)
    with pytest.raises(DuplicateId):
        servo.ping()
