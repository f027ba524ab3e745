"""Several questions under way at once, on virtual lines that count bit times.

Figures are counted from the packets of the manuals. HerkuleX (6-4): RAM_READ has 9 bytes, its ACK 11 + n. STAT has 7,
its ACK 9. RX-28 (3-5-1): READ_DATA has 8 bytes, its status packet 6 + n.
"""

from collections.abc import Callable
from typing import Any

import pytest

import extent
import servobus
from servobus import DRS0602, RX28, Bus, BusError, Garbled, NoReply, dynamixel1, herkulex
from servobus.core.exchange import Batch, Exchange, Procedure
from servobus.errors import DuplicateId
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort
from unit.scripted import Scripted

POSITION = 58
"""RAM address of Calibrated Position (4-2 NO 53)."""
BYTE = 10e-6
"""s of one byte at 1 Mbit/s: 8N1."""
BUSY = 0.5e-3
"""s until a virtual HerkuleX begins to answer, on top of what a test asks for."""


def volley(exchanges: list[Exchange[Any]], *, again: bool = True) -> Procedure[list[Any]]:
    results: list[Any] = yield Batch(exchanges, again)
    return results


def opened(spec: str, model: Any, ids: range, baud: int = 1_000_000) -> tuple[Bus, VirtualPort]:
    bus = servobus.open(f"virtual:{spec}?clock=virtual&as=manual&baud={baud}", bauds=baud)
    for id in ids:
        bus.attach(model, id, baud=baud)
    bus[ids[0]].ping()  # so that it is known that there is no echo
    port = bus.transport
    assert isinstance(port, VirtualPort)
    return bus, port


def herkulexes(count: int, *, baud: int = 1_000_000) -> tuple[Bus, VirtualPort, list[Exchange[Any]]]:
    ids = range(1, count + 1)
    bus, port = opened(f"drs0602@1-{count}", DRS0602, ids, baud)
    return bus, port, [herkulex.ram_read(id, POSITION, 8) for id in ids]


def slow(servo: VirtualServo, monkeypatch: pytest.MonkeyPatch, late: Callable[[], float]) -> None:
    """Let a virtual servo begin its answers later."""
    hear = servo.hear
    monkeypatch.setattr(
        servo, "hear", lambda event, now: [(delay + late(), data) for delay, data in hear(event, now)], raising=False
    )


def good(results: list[Any]) -> int:
    return sum(isinstance(result, bytes) for result in results)


class TestTwoWires:
    def test_answers_follow_each_other_on_the_wire(self) -> None:
        bus, port, questions = herkulexes(20)
        for _ in range(40):  # the gaps shrink to what the line needs
            assert good(bus.do(volley(questions))) == 20
        start = port.now()
        assert good(bus.do(volley(questions))) == 20
        taken = port.now() - start
        answers = 20 * 19 * BYTE
        assert taken < 9 * BYTE + BUSY + answers + 19 * 3 * BYTE  # 2 bytes between them, and 3 % of an answer
        assert taken > 9 * BYTE + BUSY + answers

    def test_answers_are_those_of_the_servos_asked(self) -> None:
        bus, port, _ = herkulexes(20)
        for servo in port.servos:
            servo.put("led_control", servo.id % 8)
        seen = bus.do(volley([herkulex.ram_read(id, 53, 1) for id in range(1, 21)]))
        assert seen == [bytes((id % 8,)) for id in range(1, 21)]

    def test_the_bytes_in_between_are_no_error_to_a_servo(self) -> None:
        bus, port, questions = herkulexes(20)
        port.inject("unplug@1#1-")  # so that something is noted of the servos that hear on
        for _ in range(5):
            bus.do(volley(questions, again=False))
        port.sleep(1.0)  # Packet Garbage Check Period is 0.2016 s (4-2 NO 35)
        for servo in port.servos[1:]:
            assert servo.get("status_error") == 0
            assert servo.get("status_detail") & 0x3C == 0

    def test_servos_that_are_unequally_slow_get_a_gap(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Each second servo begins 0.4 ms later than its neighbours: their answers meet, until the gap is there."""
        bus, port, questions = herkulexes(10)
        for servo in port.servos:
            if servo.id % 2:
                slow(servo, monkeypatch, lambda: 0.4e-3)
        first = bus.do(volley(questions, again=False))
        assert good(first) < 10
        assert all(isinstance(one, bytes | Garbled | NoReply) for one in first)
        settled = [good(bus.do(volley(questions, again=False))) for _ in range(12)]
        assert settled[-6:] == [10] * 6
        start = port.now()
        bus.do(volley(questions))
        one_by_one = 10 * (28 * BYTE + BUSY) + 5 * 0.4e-3
        assert port.now() - start < one_by_one / 1.3

    def test_servos_that_are_slow_by_chance_are_asked_one_by_one_in_the_end(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A delay that changes by 4 ms leaves no gap worth having: hardly an answer is lost any more."""
        bus, port, questions = herkulexes(8)
        delays = iter([0.0, 4e-3, 1e-3, 3.5e-3, 0.5e-3, 2e-3, 4e-3, 0.2e-3, 3e-3] * 10_000)
        for servo in port.servos:
            slow(servo, monkeypatch, lambda: next(delays))
        seen = [good(bus.do(volley(questions, again=False))) for _ in range(600)]
        assert min(seen[:20]) < 8
        assert sum(seen[300:]) > 0.98 * 8 * 300

    def test_what_did_not_come_is_asked_again(self) -> None:
        bus, port, questions = herkulexes(10)
        port.inject("flip@20#4,mute#7")
        assert good(bus.do(volley(questions))) == 10
        assert bus.stats[4].retries == 1
        assert bus.stats[7].retries == 1

    def test_without_another_try_the_others_come_all_the_same(self) -> None:
        bus, port, questions = herkulexes(10)
        port.inject("mute#7")
        results = bus.do(volley(questions, again=False))
        assert [n for n, one in enumerate(results, 1) if isinstance(one, NoReply)] == [7]
        assert good(results) == 9
        assert bus.do(volley(questions, again=False)).count(results[0]) == 10  # all stand still at the same place

    def test_a_second_servo_of_one_id_is_told(self) -> None:
        bus, port, questions = herkulexes(6)
        port.inject("twin#1:0.3ms")  # the second one begins behind the first, which takes 0.19 ms
        results = bus.do(volley([questions[2], herkulex.ram_read(200, POSITION, 8)], again=False))
        assert isinstance(results[0], DuplicateId)
        assert "two servos with id 3" in str(results[0])

    def test_one_servo_is_never_asked_twice_at_once(self) -> None:
        bus, port, _ = herkulexes(2)
        port.servos[0].put("led_control", 5)
        port.inject("mute#1")
        led, position = herkulex.ram_read(1, 53, 1), herkulex.ram_read(1, POSITION, 2)
        results = bus.do(volley([led, position, led], again=False))
        assert isinstance(results[0], NoReply)
        assert len(results[1]) == 2
        assert results[2] == b"\x05"

    def test_noise_all_the_time_is_met_with_single_questions_and_forgotten_afterwards(self) -> None:
        bus, port, questions = herkulexes(8)
        port.inject("seed=3,flip=0.4")
        for _ in range(40):
            bus.do(volley(questions, again=False))
        start = port.now()
        port.inject(None)
        bus.do(volley(questions))
        assert port.now() - start >= 8 * (28 * BYTE + BUSY)  # one by one
        for _ in range(500):
            bus.do(volley(questions))
        start = port.now()
        assert good(bus.do(volley(questions))) == 8
        assert port.now() - start < 8 * (28 * BYTE + BUSY) / 1.6

    def test_more_than_fit_one_salvo(self) -> None:
        bus, _, questions = herkulexes(50)
        assert good(bus.do(volley(questions))) == 50

    def test_an_echo_is_taken_out(self) -> None:
        bus = servobus.open("virtual:drs0602@1-4?clock=virtual&echo=on")
        bus.attach(DRS0602, 1).ping()
        assert bus.echo is True
        assert good(bus.do(volley([herkulex.ram_read(id, POSITION, 8) for id in range(1, 5)]), 115_200)) == 4

    @pytest.mark.parametrize("seed", extent.some(range(8), 3))
    def test_no_wrong_value_whatever_happens(self, seed: int) -> None:
        """Each servo's light has its own value; what is read is that, or an error. No fault here fits a checksum."""
        bus, port, _ = herkulexes(12)
        for servo in port.servos:
            servo.put("led_control", servo.id % 8)
        questions: list[Exchange[Any]] = [herkulex.ram_read(id, 53, 1) for id in range(1, 13)]
        port.inject(
            f"seed={seed},drop=0.05,junk=0.05:1-20,mute=0.03,late=0.03:20ms,stall=0.01:60ms,deaf=0.02,split=0.03"
        )
        right = 0
        for n in range(60):
            for id, seen in enumerate(bus.do(volley(questions, again=n % 2 == 0)), 1):
                assert isinstance(seen, BusError) or seen == bytes((id % 8,))
                right += not isinstance(seen, BusError)
        assert right > 60 * 12 * 0.6


def rx28s(count: int) -> tuple[Bus, VirtualPort, list[Exchange[Any]]]:
    ids = range(1, count + 1)
    bus, port = opened(f"rx28@1-{count}", RX28, ids)
    for servo in bus:
        servo.write(RX28.return_delay_time, 0.0)
    return bus, port, [dynamixel1.read_data(id, 36, 6) for id in ids]


class TestOneWire:
    def test_a_question_follows_the_last_answer_at_once(self) -> None:
        bus, port, questions = rx28s(20)
        start = port.now()
        assert good(bus.do(volley(questions))) == 20
        assert port.now() - start == pytest.approx(20 * (8 + 12) * BYTE, rel=0.001)

    def test_who_is_not_there_costs_no_more_than_the_longest_delay(self) -> None:
        bus, port = opened("rx28@1-2", RX28, range(1, 3))
        start = port.now()
        results = bus.do(volley([dynamixel1.ping(id).no_retry() for id in range(100, 120)]))
        assert all(isinstance(one, NoReply) for one in results)
        # 6 bytes each way, 508 µs at most (3-4-1), 2 ms for adapters; then once what the adapter may take, 1 ms here
        assert port.now() - start < 20 * (12 * BYTE + 0.508e-3 + 2e-3 + 0.05e-3) + 0.006

    def test_a_slow_adapter_costs_once_and_not_with_each_servo(self) -> None:
        bus, port, questions = rx28s(20)
        port.inject("latency=16ms")
        start = port.now()
        assert good(bus.do(volley(questions))) == 20
        assert port.now() - start < 20 * 16e-3 / 3

    def test_a_servo_that_answers_later_than_its_settings_say_is_waited_for(self) -> None:
        bus, _ = opened("rx28@1-3,answer_time=20us-3ms", RX28, range(1, 4))
        questions: list[Exchange[Any]] = [dynamixel1.read_data(id, 36, 2) for id in range(1, 4)]
        lost = sum(3 - good(bus.do(volley(questions, again=False))) for _ in range(200))
        assert lost <= 2 * 3  # two at a time, until the gap behind each servo is once twice as wide

    @pytest.mark.parametrize("seed", extent.some(range(8), 3))
    def test_no_wrong_value_whatever_happens(self, seed: int) -> None:
        bus, port, _ = rx28s(10)
        for servo in port.servos:
            servo.put("punch", 100 + servo.id)
        questions: list[Exchange[Any]] = [dynamixel1.read_data(id, 48, 2) for id in range(1, 11)]
        port.inject(
            f"seed={seed},drop=0.05,junk=0.05:1-20,mute=0.03,late=0.03:20ms,stall=0.01:60ms,deaf=0.02,split=0.03"
        )
        right = 0
        for n in range(60):
            for id, seen in enumerate(bus.do(volley(questions, again=n % 2 == 0)), 1):
                assert isinstance(seen, BusError) or seen == (100 + id).to_bytes(2, "little")
                right += not isinstance(seen, BusError)
        assert right > 60 * 10 * 0.6


def test_two_answers_that_met_are_not_taken_even_where_the_checksum_fits() -> None:
    """The header of the second, 20 bits into the first, pulls bit 7 of the last three bytes down: FF 01 F9 to 7F 01 79.

    Both are packets: 2 + 4 + 0x1FF and 2 + 4 + 0x17F, each with its checksum (RX-28 manual, 3-2). What is left of the
    second answer stands right behind.
    """
    port = Scripted("FF FF 02 04 00 7F 01 79 03 04 00 FF 01 F8", None, baud=1_000_000)
    questions: list[Exchange[Any]] = [dynamixel1.read_data(id, 36, 2) for id in (2, 3)]
    outcomes = Bus(port, echo=False).do(volley(questions, again=False))
    assert [type(outcome) for outcome in outcomes] == [Garbled, Garbled]


def test_after_a_lost_answer_a_single_question_takes_care() -> None:
    """The late answer of a volley must not answer the next question to that servo."""
    bus, port, questions = rx28s(3)
    bus[2].read(RX28.present_position)
    port.inject("late#2:30ms")
    results = bus.do(volley(questions, again=False))
    assert isinstance(results[1], NoReply)
    port.servos[1].put("punch", 77)
    assert bus.do(dynamixel1.read_data(2, 44, 6)).endswith(b"\x4d\x00")  # Punch, 48


def test_only_the_first_question_of_a_batch_finds_out_about_the_echo() -> None:
    """It is known after one question, so that the others need not go alone."""
    with servobus.open("virtual:drs0602@253?clock=virtual") as bus:
        sent: list[int] = []
        write = bus.transport.write

        def count(data: bytes) -> None:
            sent.append(len(data))
            write(data)

        bus.transport.write = count  # type: ignore[method-assign]
        bus.do(volley([herkulex.stat(id).no_retry() for id in range(16)]), baud=115_200)
        assert bus.echo is False
        assert sent[0] == 7  # a STAT
        assert len(sent) == 2
