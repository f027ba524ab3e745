"""Requests that several servos answer: each reply is judged by itself, and a lost one costs itself alone.

No servo here knows such a request yet; it is one of the RX-28's frames with the code that protocol 2.0 and Feetech
servos have for SYNC READ, 0x82. Frames are built by the framing, whose checksum rule the golden packets prove.
"""

from typing import Any

import pytest

from servobus import RX28, Bus, NoReply, dynamixel1
from servobus.core.exchange import Batch, Exchange, GroupExchange, Procedure, ReplyPattern, ack_only
from servobus.core.framing import Packet
from servobus.core.ids import BROADCAST
from servobus.errors import BadChecksum, BrokenEcho, BusError, DuplicateId, Garbled, LineBusy, Refused
from servobus.families.dynamixel.protocol import FRAMING
from unit.link.test_link import Timed
from unit.scripted import own_link

SYNC_READ = 0x82
OVERHEATING = 0x04
FENCE = {id: FRAMING.frame(Packet(id, 1)).hex(" ").upper() for id in range(10)}
"""PING: the first fence."""


def value(packet: Packet) -> int:
    if not packet.data:
        raise Refused(f"id {packet.id}: refused", packet.code)
    return int.from_bytes(packet.data, "little")


def sync_read(*ids: int) -> GroupExchange[int]:
    request = FRAMING.frame(Packet(BROADCAST, SYNC_READ, bytes((36, 2, *ids))))
    return GroupExchange(f"SYNC_READ ids {ids}", FRAMING, request, [read(id) for id in ids])


def read(id: int) -> Exchange[int]:
    """Ask one of them alone: READ_DATA."""
    return Exchange(
        f"READ id {id}", FRAMING, FRAMING.frame(Packet(id, 2, bytes((36, 2)))), value, ReplyPattern(id, None, (2, 0)),
        lambda packet: packet.code & OVERHEATING, 500e-6, repeatable=True,
    )  # fmt: skip


def said(id: int, raw: int | None, error: int = 0) -> str:
    """Give the status packet of a servo; None is a refusal."""
    return FRAMING.frame(Packet(id, error, b"" if raw is None else raw.to_bytes(2, "little"))).hex(" ").upper()


def group(*script: str | None, echo: bool | None = False) -> tuple[Bus, Timed]:
    port = Timed(*script)
    bus = Bus(port, echo=echo)
    for id in (1, 2, 3):
        bus.attach(RX28, id)
    return bus, port


def sent(exchange: Exchange[Any]) -> str:
    return exchange.request.hex(" ").upper()


def asked(port: Timed, exchange: Exchange[Any]) -> int:
    return port.requests.count(sent(exchange))


ONE, TWO, THREE = said(1, 111), said(2, 222), said(3, 333)
GROUP = sync_read(1, 2, 3)
ONCE = GROUP.no_retry()


def kinds(outcomes: list[Any]) -> list[Any]:
    return [type(outcome) if isinstance(outcome, BusError) else outcome for outcome in outcomes]


class TestOutcomes:
    def test_a_list_of_what_each_said(self) -> None:
        bus, port = group(ONE + TWO + THREE)
        assert bus.do(GROUP) == [111, 222, 333]
        assert len(port.requests) == 1
        assert [bus.stats[id].received for id in (1, 2, 3)] == [1, 1, 1]
        assert [bus.stats[id].sent for id in (1, 2, 3)] == [1, 1, 1]

    def test_in_pieces_and_in_any_order(self) -> None:
        bus, port = group(THREE[:11])
        port.say((0.003, THREE[11:] + ONE[:3]), (0.0035, ONE[3:] + TWO))
        assert bus.do(ONCE) == [111, 222, 333]

    def test_one_that_is_lost_costs_itself_alone(self) -> None:
        bus, _ = group(ONE + THREE)
        outcomes = bus.do(ONCE)
        assert kinds(outcomes) == [111, NoReply, 333]
        assert "SYNC_READ ids (1, 2, 3): id 2: no reply" in str(outcomes[1])
        assert [bus.stats[id].timeouts for id in (1, 2, 3)] == [0, 1, 0]

    def test_it_is_asked_for_once_more_alone_behind_a_fence(self) -> None:
        bus, port = group(ONE + THREE, said(2, None), TWO)
        assert bus.do(GROUP) == [111, 222, 333]
        assert port.requests == [sent(GROUP), FENCE[2], sent(read(2))]
        assert [bus.stats[id].retries for id in (1, 2, 3)] == [0, 1, 0]

    def test_those_that_had_no_turn_are_asked_alone_the_last_one_first(self) -> None:
        """Whoever still waits for the servo before it has heard something else by the time that one speaks."""
        bus, port = group(ONE, said(4, None), said(4, 444), said(3, None), THREE, said(2, None), TWO)
        assert bus.do(sync_read(1, 2, 3, 4)) == [111, 222, 333, 444]
        asked = [packet for id in (4, 3, 2) for packet in (FENCE[id], sent(read(id)))]
        assert port.requests[1:] == asked
        assert [bus.stats[id].retries for id in (1, 2, 3, 4)] == [0, 1, 0, 0]

    def test_where_none_answers_all_are_asked_alone(self) -> None:
        bus, port = group(None, said(3, None), THREE, said(2, None), TWO, said(1, None), ONE)
        assert bus.do(GROUP) == [111, 222, 333]
        assert port.requests[1:] == [packet for id in (3, 2, 1) for packet in (FENCE[id], sent(read(id)))]

    def test_what_is_asked_once_only_is_not_asked_on(self) -> None:
        bus, port = group(ONE)
        assert kinds(bus.do(ONCE)) == [111, NoReply, NoReply]
        assert len(port.requests) == 1

    def test_silence_is_silence_of_each(self) -> None:
        bus, _ = group()
        assert kinds(bus.do(ONCE)) == [NoReply] * 3

    def test_a_garbled_one_costs_itself_alone(self) -> None:
        bad = TWO[:-2] + "00"
        bus, _ = group(ONE + bad + THREE)
        assert kinds(bus.do(ONCE)) == [111, Garbled, 333]

    def test_a_second_answer_is_told_of_its_servo_alone(self) -> None:
        bus, _ = group(ONE + TWO + said(2, 223) + THREE)
        outcomes = bus.do(GROUP)
        assert kinds(outcomes) == [111, DuplicateId, 333]
        assert "two servos with id 2" in str(outcomes[1])
        assert bus.stats[2].doubled == 1

    def test_a_second_answer_that_comes_when_all_are_here_is_told_next_time(self) -> None:
        bus, port = group(ONE + TWO + THREE, ONE + THREE)
        port.say((0.02, said(2, 223)))
        assert bus.do(GROUP) == [111, 222, 333]
        port.sleep(0.03)
        assert kinds(bus.do(GROUP)) == [111, DuplicateId, 333]

    def test_a_stranger_is_counted_and_not_taken(self) -> None:
        bus, _ = group(ONE + said(9, 999) + TWO + THREE)
        assert bus.do(ONCE) == [111, 222, 333]
        assert bus.stats[9].strangers == 1

    def test_a_refusal_is_its_servos(self) -> None:
        bus, port = group(ONE + said(2, None, 8) + THREE)
        assert kinds(bus.do(GROUP)) == [111, Refused, 333]
        assert len(port.requests) == 1  # a refusal stands

    def test_alarms_of_each_are_kept(self) -> None:
        bus, port = group(ONE + said(2, 222, OVERHEATING) + THREE)
        assert bus.do(GROUP) == [111, 222, 333]
        assert [servo.alarms for servo in bus] == [0, OVERHEATING, 0]
        port.script = [ONE + TWO + THREE]
        bus.do(GROUP)
        assert [servo.alarms for servo in bus] == [0, 0, 0]

    def test_one_servo_is_a_list_of_one(self) -> None:
        bus, _ = group(TWO)
        assert bus.do(sync_read(2)) == [222]

    def test_one_servo_whose_answer_is_garbled_says_how(self) -> None:
        bus, _ = group(TWO[:-2] + "00")
        assert kinds(bus.do(sync_read(2).no_retry())) == [BadChecksum]


class TestLate:
    def test_a_late_one_is_no_answer_to_the_next(self) -> None:
        bus, port = group(ONE + THREE)
        assert kinds(bus.do(ONCE)) == [111, NoReply, 333]
        port.say((0.001, TWO))  # while the fence is asked
        port.script = [said(2, None), said(1, 112) + said(2, 223) + said(3, 334)]
        assert bus.do(ONCE) == [112, 223, 334]
        assert port.requests[1] == FENCE[2]
        assert bus.stats[2].late == 1

    def test_it_is_none_to_another_question_of_its_servo(self) -> None:
        bus, port = group(ONE + THREE)
        bus.do(ONCE)
        port.script = [TWO + said(2, None), said(2, 223)]
        assert bus.do(dynamixel1.read_data(2, 30, 2).no_retry()) == (223).to_bytes(2, "little")

    def test_a_servo_that_does_not_answer_the_fence_is_not_believed(self) -> None:
        bus, port = group(ONE + THREE)
        bus.do(ONCE)
        port.script = [None, said(1, 112) + TWO + said(3, 334)]
        outcomes = bus.do(ONCE)
        assert kinds(outcomes) == [112, NoReply, 334]
        assert bus.stats[2].late == 1

    def test_when_none_answers_the_fence_nothing_is_sent(self) -> None:
        bus, port = group()
        bus.do(ONCE)
        port.requests.clear()
        assert kinds(bus.do(ONCE)) == [NoReply] * 3
        assert asked(port, GROUP) == 0


class TestLine:
    def test_an_echo_is_taken_out(self) -> None:
        request = GROUP.request.hex(" ")
        bus, _ = group(request + ONE + TWO + THREE, request + ONE + TWO + THREE, echo=None)
        assert bus.do(ONCE) == [111, 222, 333]
        assert bus.echo is True
        assert bus.do(ONCE) == [111, 222, 333]

    def test_a_broken_echo_is_an_error_of_the_whole(self) -> None:
        request = GROUP.request.hex(" ")
        bus, _ = group(request[:-2] + "00" + ONE + TWO + THREE, echo=True)
        with pytest.raises(BrokenEcho):
            bus.do(ONCE)

    def test_so_is_a_line_that_is_never_quiet(self) -> None:
        bus, port = group(ONE + "12 34" + TWO + THREE)
        assert bus.do(ONCE) == [111, 222, 333]
        port.say(*((0.001 * n, "00") for n in range(1000)))
        with pytest.raises(LineBusy):
            bus.do(ONCE)

    @pytest.mark.parametrize("answers", ["", ONE, ONE + TWO])
    def test_it_waits_for_one_more_answer_and_for_no_more_behind_a_silent_servo(self, answers: str) -> None:
        bus, port = group(answers or None)
        start = port.now()
        bus.do(ONCE)
        begun = len(GROUP.request) * 10 / port.baud + (port.delay if answers else 0.0)
        one = 1.03 * (8 * 10 / port.baud + 500e-6)  # 3 % slow, RX-28 manual 3-4-1
        assert port.now() - start == pytest.approx(begun + one + own_link(bus).latency.reply_margin)

    def test_answers_that_take_their_time_are_waited_for(self) -> None:
        """Each comes when the longest delay is almost over since the one before."""
        bus, port = group()
        port.say(*((0.0025 + n * 0.0018, said(n, 100 * n)) for n in (1, 2, 3)))
        assert bus.do(ONCE) == [100, 200, 300]

    def test_delays_of_the_servos_before_do_not_count_as_lateness_of_the_port(self) -> None:
        bus, port = group()
        for _ in range(10):
            port.say(*((0.0025 + n * 0.0018, said(n, 100 * n)) for n in (1, 2, 3)))
            assert bus.do(ONCE) == [100, 200, 300]
            port.sleep(0.01)
        first = 0.0043 - (len(GROUP.request) + 8) * 10 / port.baud
        assert own_link(bus).latency.worst_delay == pytest.approx(first)

    def test_in_a_batch_it_goes_alone_and_has_its_place(self) -> None:
        def job() -> Procedure[list[Any]]:
            results: list[Any] = yield Batch([dynamixel1.ping(1), GROUP, dynamixel1.ping(2)])
            return results

        bus, _ = group(said(1, None), ONE + TWO + THREE, said(2, None))
        assert bus.do(job()) == [None, [111, 222, 333], None]


class TestValue:
    """An exchange is a value: what changes it makes another."""

    @pytest.mark.parametrize("exchange", [dynamixel1.read_data(1, 36, 2), GROUP])
    def test_no_retry_is_a_copy(self, exchange: Exchange[Any]) -> None:
        once = exchange.no_retry()
        assert (exchange.repeatable, once.repeatable) == (True, False)
        assert type(once) is type(exchange)
        assert all(
            getattr(once, name) == getattr(exchange, name) for name in Exchange.__slots__ if name != "repeatable"
        )

    def test_strict_is_a_copy_to_which_a_refusal_is_no_reply(self) -> None:
        read = dynamixel1.read_data(1, 36, 2)
        strict = read.strict()
        assert (read.replies[0].sizes, strict.replies[0].sizes) == ((2, 0), (2,))
        assert strict.interpret is ack_only
        assert read.interpret is not ack_only

    def test_mapped_reads_each_reply_another_way(self) -> None:
        bus, _ = group(ONE + TWO + THREE)
        assert bus.do(GROUP.mapped(lambda packet: packet.id)) == [1, 2, 3]
