"""What a tracker makes of traffic. The bytes are those of tests/golden unless they stand here; sums by hand."""

from collections.abc import Sequence

import pytest

from golden.golden import load
from servobus.families.registry import DRS0602, FAMILIES, LX16A, RX28
from servobus.traffic.events import EventKind, ServoTraffic, TrafficEvent, Trouble
from servobus.traffic.recording import Chunk, Direction, Entry, Speed
from servobus.traffic.tracker import PATIENCE, QUIET, Tracker

GOLDEN = {(family, case.name): case.packet for family in FAMILIES for case in load(family)}
PING, PONG = GOLDEN["dynamixel", "ex3_ping"], GOLDEN["dynamixel", "ex3_reply"]
READ, HEAT = GOLDEN["dynamixel", "ex1_read_temperature"], GOLDEN["dynamixel", "ex1_reply"]
WRITE = GOLDEN["dynamixel", "ex16_torque_led_on"]
SYNC = GOLDEN["dynamixel", "ex5_sync_write"]
OTHER_PONG = bytes.fromhex("FF FF 02 02 00 FB")
"""A status packet of id 2: ~(2 + 2) = FB."""
LOW_VOLTAGE = bytes.fromhex("FF FF 01 02 01 FB")
"""A status packet of id 1 with error bit 1, which is a PING to the letter."""
RAM_READ, RAM_ACK = GOLDEN["herkulex", "ram_read_request"], GOLDEN["herkulex", "ram_read_reply"]
STAT, STAT_ACK = GOLDEN["herkulex", "stat_request"], GOLDEN["herkulex", "stat_reply"]
POS_READ, POS = GOLDEN["lewansoul", "pos_read"], GOLDEN["lewansoul", "pos_read_answer"]
DIALOGUES = {"dynamixel": (READ, HEAT), "herkulex": (RAM_READ, RAM_ACK), "lewansoul": (POS_READ, POS)}

Script = Sequence[tuple[float, str, bytes]]


def entries(script: Script) -> list[Entry]:
    return [Chunk(time, Direction(mark), data) for time, mark, data in script]


def watch(script: Script, tracker: Tracker | None = None) -> list[TrafficEvent]:
    tracker = tracker or Tracker()
    return [event for entry in entries(script) for event in tracker.feed(entry)] + tracker.finish()


def said(events: Sequence[TrafficEvent]) -> list[tuple[str, int | None, str]]:
    return [(str(event.kind), event.id, event.text) for event in events]


def kinds(events: Sequence[TrafficEvent]) -> list[str]:
    return [str(event.kind) for event in events]


def troubles(events: Sequence[TrafficEvent]) -> list[Trouble]:
    return [event.trouble for event in events if event.trouble]


def only(tracker: Tracker) -> ServoTraffic:
    (tally,) = tracker.servos
    return tally


# What is said


@pytest.mark.parametrize("family", DIALOGUES)
@pytest.mark.parametrize("marks", ["><", "--"], ids=["between", "listening"])
def test_question_and_answer(family: str, marks: str) -> None:
    question, answer = DIALOGUES[family]
    tracker = Tracker(baud=57_600)
    events = watch([(1.0, marks[0], question), (1.01, marks[1], answer)], tracker)
    assert kinds(events) == ["request", "answer"]
    assert [event.raw for event in events] == [question, answer]
    assert [event.time for event in events] == [1.0, 1.01]
    assert {event.family for event in events} == {FAMILIES[family]}
    assert troubles(events) == []
    tally = only(tracker)
    assert (tally.requests, tally.answers, tally.missing, tally.error_rate) == (1, 1, 0, 0.0)


def test_words_need_the_question_and_the_model() -> None:
    events = watch([(0.0, ">", READ), (0.01, "<", HEAT)], Tracker(model=RX28))
    assert said(events) == [
        ("request", 1, "READ_DATA id 1: 1 byte from address 43, present_temperature"),
        ("answer", 1, "status of id 1: ok, present_temperature 32 °C"),
    ]


def test_the_model_and_the_family_can_be_named() -> None:
    assert watch([(0.0, ">", STAT)], Tracker(model=DRS0602))[0].text == "STAT id 253"
    assert kinds(watch([(0.0, ">", STAT)], Tracker(FAMILIES["lewansoul"]))) == ["other"]
    assert watch([(0.0, ">", POS_READ)], Tracker(model=LX16A))[0].family is LX16A.family


@pytest.mark.parametrize("size", [1, 2, 3, 5, 7])
@pytest.mark.parametrize("family", DIALOGUES)
def test_packets_in_pieces(family: str, size: int) -> None:
    question, answer = DIALOGUES[family]
    script = [(0.001 * at, ">", question[at : at + size]) for at in range(0, len(question), size)]
    script += [(0.05 + 0.001 * at, "<", answer[at : at + size]) for at in range(0, len(answer), size)]
    events = watch(script)
    assert [(str(event.kind), event.raw) for event in events] == [("request", question), ("answer", answer)]
    assert [event.time for event in events] == [0.0, 0.05]


def test_everything_in_one_piece() -> None:
    events = watch([(0.5, "-", READ + HEAT + READ + HEAT)])
    assert kinds(events) == ["request", "answer"] * 2
    assert [event.latency for event in events] == [None] * 4  # they came together: nobody knows


# Latency


def test_latency_counts_from_the_last_bit_of_the_request() -> None:
    tracker = Tracker(baud=57_600)
    _, answer = watch([(1.0, ">", READ), (1.003, "<", HEAT)], tracker)
    assert answer.latency == pytest.approx(0.003 - 8 * 10 / 57_600)  # 1.61 ms
    assert only(tracker).median == only(tracker).worst == pytest.approx(0.00161)


def test_requests_queue_before_they_are_on_the_wire() -> None:
    tracker = Tracker(baud=10_000)  # a byte takes 1 ms
    events = watch([(1.0, ">", SYNC), (1.001, ">", PING), (1.040, "<", PONG)], tracker)
    assert len(SYNC) == 28
    assert events[-1].latency == pytest.approx(0.040 - 0.028 - 0.006)


def test_latency_while_listening_is_between_the_pieces() -> None:
    _, answer = watch([(1.0, "-", PING), (1.004, "-", PONG)], Tracker(baud=57_600))
    assert answer.latency == pytest.approx(0.004)


def test_a_wire_without_bit_times_has_no_negative_latency() -> None:
    assert watch([(1.0, ">", PING), (1.0001, "<", PONG)], Tracker(baud=9600))[1].latency == 0.0


def test_speed_changes() -> None:
    tracker = Tracker(baud=57_600)
    change = tracker.feed(Speed(0.5, 10_000))
    assert (change[0].kind, change[0].text) == (EventKind.SPEED, "the line is at 10000 baud from here on")
    assert watch([(1.0, ">", PING), (1.010, "<", PONG)], tracker)[1].latency == pytest.approx(0.004)


def test_median_and_longest() -> None:
    tracker = Tracker()
    waits = [0.004, 0.002, 0.020, 0.001, 0.003]
    watch([one for n, wait in enumerate(waits) for one in ((n, ">", PING), (n + wait, "<", PONG))], tracker)
    assert only(tracker).median == pytest.approx(0.003)
    assert only(tracker).worst == pytest.approx(0.020)


# Silence


@pytest.mark.parametrize("family", DIALOGUES)
def test_no_answer_in_time(family: str) -> None:
    question, answer = DIALOGUES[family]
    tracker = Tracker(FAMILIES[family])
    assert kinds(tracker.feed(Chunk(1.0, Direction.OUT, question))) == ["request"]
    assert tracker.pass_time(1.0 + 0.9 * PATIENCE) == []
    (silence,) = tracker.pass_time(1.0 + 1.1 * PATIENCE)
    assert (silence.kind, silence.trouble) == (EventKind.SILENCE, Trouble.SILENT)
    assert silence.time == pytest.approx(1.0 + PATIENCE)
    assert silence.text.startswith("NO ANSWER to ")
    assert (only(tracker).missing, only(tracker).error_rate) == (1, 1.0)
    (late,) = tracker.feed(Chunk(1.5, Direction.IN, answer))
    assert late.trouble is Trouble.LATE
    assert late.text.startswith("LATE, 500 ms behind its question: ")
    assert only(tracker).error_rate == 1.0


def test_who_asks_on_has_given_up() -> None:
    events = watch([(1.0, ">", READ), (1.02, ">", PING), (1.021, "<", PONG)])
    assert kinds(events) == ["request", "silence", "request", "answer"]
    assert events[1].time == 1.02
    assert troubles(events) == [Trouble.SILENT]


def test_a_line_of_two_lanes_has_several_questions_open() -> None:
    first, second = GOLDEN["herkulex", "ram_read_request"], bytes.fromhex("FF FF 07 DB 07 DA 24")  # STAT id 219
    ack = bytes.fromhex("FF FF 09 DB 47 94 6A 00 00")  # 09 ^ DB ^ 47 = 95: 94 and ~95 & FE = 6A
    events = watch([(0.0, ">", first), (0.001, ">", second), (0.004, "<", RAM_ACK), (0.006, "<", ack)])
    assert kinds(events) == ["request", "request", "answer", "answer"]
    assert troubles(events) == []
    assert kinds(watch([(0.0, ">", first), (0.02, ">", first)])) == ["request", "silence", "request"]


def test_what_nobody_answers_is_not_missing() -> None:
    tracker = Tracker()
    quiet = [SYNC, GOLDEN["dynamixel", "ex20_action"], GOLDEN["dynamixel", "ex2_broadcast_id"]]
    assert troubles(watch([(n, ">", one) for n, one in enumerate(quiet)], tracker)) == []
    assert tracker.pass_time(10.0) == []
    assert only(tracker).broadcast
    assert (only(tracker).requests, only(tracker).error_rate) == (3, None)
    moves = [GOLDEN["lewansoul", "move_time_write"], GOLDEN["lewansoul", "move_start_broadcast"]]
    assert troubles(watch([(n, ">", one) for n, one in enumerate(moves)])) == []


def test_whether_commands_are_answered_is_learnt() -> None:
    silent = [(1.0, ">", WRITE), (2.0, ">", WRITE), (3.0, ">", PING), (3.001, "<", PONG)]
    assert troubles(watch(silent)) == []
    obeyed = [(0.0, ">", WRITE), (0.002, "<", PONG), *silent]
    events = watch(obeyed)
    (silence,) = (event for event in events if event.trouble)
    assert silence.trouble is Trouble.SILENT
    assert silence.time == pytest.approx(1.0 + PATIENCE)


def test_the_last_question_may_still_be_answered() -> None:
    tracker = Tracker()
    assert kinds(watch([(1.0, ">", PING)], tracker)) == ["request"]
    assert only(tracker).error_rate is None


def test_all_may_answer_a_stat_to_all() -> None:
    ask = GOLDEN["herkulex", "stat_broadcast"]
    tracker = Tracker()
    assert kinds(watch([(0.0, ">", ask), (0.003, "<", STAT_ACK)], tracker)) == ["request", "answer"]
    servo, everybody = tracker.servos
    assert (servo.id, servo.answers, everybody.id, everybody.error_rate) == (253, 1, 254, 0.0)


# Answers that are none


def test_a_stranger() -> None:
    tracker = Tracker()
    events = watch([(0.0, ">", PING), (0.002, "<", OTHER_PONG), (0.004, "<", PONG)], tracker)
    assert kinds(events) == ["request", "answer", "answer"]
    assert troubles(events) == [Trouble.STRANGER]
    assert events[1].text == "STRANGER, id 1 was asked: status of id 2: ok"
    assert [(tally.id, tally.answers, tally.other) for tally in tracker.servos] == [(1, 1, 0), (2, 0, 1)]


@pytest.mark.parametrize("mark", "<-")
def test_an_answer_that_nobody_asked_for(mark: str) -> None:
    events = watch([(0.0, mark, PONG), (0.5, mark, POS)], Tracker())
    assert troubles(events) == [Trouble.UNASKED] * 2
    assert events[0].text == "NOBODY ASKED for this: status of id 1: ok"


def test_an_answer_before_its_question() -> None:
    events = watch([(0.0, "<", PONG), (0.001, ">", PING), (0.5, ">", SYNC)])
    assert kinds(events) == ["answer", "request", "silence", "request"]
    assert troubles(events) == [Trouble.UNASKED, Trouble.SILENT]


def test_an_answer_that_reads_as_a_request_is_not_taken_for_one() -> None:
    (answer,) = watch([(0.0, "<", LOW_VOLTAGE)], Tracker(model=RX28))
    assert (answer.kind, answer.text) == (EventKind.ANSWER, "NOBODY ASKED for this: answer of id 1, 0x01")


def test_an_answer_of_the_wrong_length() -> None:
    tracker = Tracker()
    three = GOLDEN["dynamixel", "ex6_reply"]
    events = watch([(0.0, ">", READ), (0.002, "<", three)], tracker)
    assert troubles(events) == [Trouble.MISFIT]
    assert events[1].text == "DOES NOT FIT the question: status of id 1: ok, 1C 00 08"
    assert (only(tracker).other, only(tracker).missing, only(tracker).error_rate) == (1, 0, 1.0)


# Damage


@pytest.mark.parametrize("family", DIALOGUES)
def test_a_bad_checksum_is_counted_once(family: str) -> None:
    question, answer = DIALOGUES[family]
    bad = answer[:-1] + bytes([answer[-1] ^ 0x10])
    tracker = Tracker(FAMILIES[family])
    events = watch([(0.0, ">", question), (0.004, "<", bad), (0.5, ">", question), (0.504, "<", answer)], tracker)
    assert kinds(events) == ["request", "corrupt", "request", "answer"]
    assert events[1].text.startswith("CHECKSUM WRONG: would be ")
    assert events[1].raw == bad
    tally = only(tracker)
    assert (tally.requests, tally.answers, tally.corrupt, tally.missing) == (2, 1, 1, 0)
    assert tally.error_rate == 0.5
    assert tracker.corrupt == 1


def test_a_wrong_id_in_a_corrupt_packet_makes_no_servo() -> None:
    tracker = Tracker(RX28.family)
    watch([(0.0, "<", bytes.fromhex("FF FF 07 02 00 FC"))], tracker)
    assert (tracker.servos, tracker.corrupt) == ([], 1)


@pytest.mark.parametrize("marks", ["><", "--"], ids=["between", "listening"])
def test_a_probe_for_an_echo_is_no_junk(marks: str) -> None:
    tracker = Tracker()
    events = watch([(0.0, marks[0], b"\x00" + PING), (0.01, marks[1], PONG)], tracker)
    assert kinds(events) == ["probe", "request", "answer"]
    assert (tracker.junk, troubles(events)) == (0, [])


def test_a_probe_in_front_of_another_family() -> None:
    events = watch([(0.0, ">", POS_READ), (0.01, "<", POS), (0.2, ">", b"\x00" + PING), (0.21, "<", PONG)])
    assert kinds(events) == ["request", "answer", "probe", "request", "answer"]


def test_a_probe_that_comes_back() -> None:
    tracker = Tracker(baud=57_600)
    script = [(0.0, ">", b"\x00" + PING), (0.002, "<", b"\x00"), (0.003, "<", PING), (0.005, "<", PONG)]
    events = watch(script, tracker)
    assert events[2].text == "echo of the probe"
    assert (kinds(events)[:3], tracker.junk) == (["probe", "request", "echo"], 0)


@pytest.mark.parametrize("junk", [b"\x01", b"\x00\x01"])
def test_other_bytes_before_a_request_are_junk(junk: bytes) -> None:
    tracker = Tracker()
    assert kinds(watch([(0.0, ">", junk + PING), (0.01, "<", PONG)], tracker)) == ["noise", "request", "answer"]
    assert tracker.junk == len(junk)


@pytest.mark.parametrize("family", DIALOGUES)
@pytest.mark.parametrize("again", [0.02, 0.5], ids=["asked again at once", "asked again later"])
@pytest.mark.parametrize("lost", [-1, -2])
def test_an_answer_that_lost_a_byte_is_corrupt_and_not_missing(family: str, again: float, lost: int) -> None:
    question, answer = DIALOGUES[family]
    tracker = Tracker(FAMILIES[family], baud=57_600)
    begun = bytes(answer[:lost] + answer[len(answer) + lost + 1 :])
    assert len(begun) == len(answer) - 1
    script = [(0.0, ">", question), (0.01, "<", begun), (again, ">", question), (again + 0.01, "<", answer)]
    events = watch(script, tracker)
    assert kinds(events) == ["request", "corrupt", "request", "answer"]
    assert (events[1].raw, events[1].trouble) == (begun, Trouble.CUT)
    tally = only(tracker)
    assert (tally.requests, tally.answers, tally.corrupt, tally.missing, tally.failed) == (2, 1, 1, 0, 1)
    assert (tracker.cut_short, tracker.corrupt, tracker.junk) == (1, 0, 0)


def test_the_beginning_of_an_answer_that_was_not_asked_for_is_junk() -> None:
    tracker = Tracker(FAMILIES["dynamixel"])
    watch([(0.0, ">", READ), (0.01, "<", OTHER_PONG[:-1]), (1.0, ">", READ)], tracker)
    assert (tracker.cut_short, tracker.junk, tracker.servos[0].missing) == (0, 5, 1)


def test_junk_around_an_answer() -> None:
    tracker = Tracker()
    events = watch([(0.0, ">", PING), (0.002, "<", b"\x00\x80" + PONG + b"\x7f")], tracker)
    assert said(events) == [
        ("request", 1, "PING id 1"),
        ("noise", None, "JUNK: 2 bytes that are no packet"),
        ("answer", 1, "status of id 1: ok"),
        ("noise", None, "JUNK: a byte that is no packet"),
    ]
    assert b"".join(event.raw for event in events[1:]) == b"\x00\x80" + PONG + b"\x7f"
    assert tracker.junk == 3


def test_half_an_answer_ends_with_the_next_question() -> None:
    events = watch([(0.0, ">", READ), (0.002, "<", HEAT[:5]), (0.03, ">", READ), (0.032, "<", HEAT)])
    assert kinds(events) == ["request", "corrupt", "request", "answer"]
    assert events[1].raw == HEAT[:5]
    assert events[1].time == 0.002


def test_half_a_packet_ends_with_quiet() -> None:
    tracker = Tracker(RX28.family)
    assert tracker.feed(Chunk(0.0, Direction.IN, HEAT[:5])) == []
    assert tracker.pass_time(0.9 * QUIET) == []
    assert kinds(tracker.pass_time(1.1 * QUIET)) == ["noise"]
    assert kinds(tracker.feed(Chunk(1.0, Direction.IN, HEAT[5:] + PONG))) == ["noise", "answer"]


def test_a_packet_behind_a_false_header() -> None:
    events = watch([(0.0, ">", PING), (0.003, "<", bytes.fromhex("FF FF 01 20") + PONG), (0.5, ">", SYNC)])
    assert kinds(events) == ["request", "noise", "answer", "request"]


def test_a_false_header_on_a_line_of_two_lanes() -> None:
    lie = bytes.fromhex("FF FF DF 01")  # promises 223 bytes
    script = [(0.0, ">", RAM_READ), (0.003, "<", lie + RAM_ACK), (0.01, ">", RAM_READ), (0.013, "<", RAM_ACK)]
    tracker = Tracker()
    assert kinds(watch(script, tracker)) == ["request", "noise", "answer", "request", "answer"]
    assert tracker.junk == len(lie)


def test_a_request_that_is_none() -> None:
    unknown = bytes.fromhex("FF FF 01 03 09 55 9D")  # ~(1 + 3 + 9 + 55) = 9D
    refusal = bytes.fromhex("FF FF 01 02 40 BC")  # instruction error
    events = watch([(0.0, ">", unknown), (0.002, "<", refusal), (1.0, ">", unknown)], Tracker(RX28.family))
    assert said(events[:1]) == [("request", 1, "unknown request 0x09 id 1, data 55")]
    assert events[1].text.startswith("status of id 1: refused, ")
    assert kinds(events) == ["request", "answer", "request"]


# Echo


@pytest.mark.parametrize("family", DIALOGUES)
def test_an_adapter_that_gives_back_what_is_sent(family: str) -> None:
    question, answer = DIALOGUES[family]
    script = [(0.0, ">", question), (0.001, "<", question), (0.003, "<", answer)]
    tracker = Tracker(FAMILIES[family])
    assert kinds(watch(script, tracker)) == ["request", "echo", "answer"]
    assert (only(tracker).answers, only(tracker).other, only(tracker).error_rate) == (1, 0, 0.0)
    together = [(0.0, ">", question), (0.003, "<", question + answer)]
    assert kinds(watch(together)) == ["request", "echo", "answer"]


def test_the_echo_of_a_ping_looks_like_its_answer_until_the_answer_comes() -> None:
    script = [(0.0, ">", PING), (0.001, "<", PING), (0.003, "<", PONG), (1.0, ">", PING), (1.001, "<", PING)]
    tracker = Tracker()
    events = watch(script, tracker)
    assert kinds(events) == ["request", "answer", "answer", "request", "echo"]
    assert troubles(events) == []
    assert only(tracker).answers == 1


def test_an_alarm_that_looks_like_an_echo() -> None:
    script = [(0.0, ">", READ), (0.003, "<", HEAT), (1.0, ">", PING), (1.003, "<", LOW_VOLTAGE)]
    events = watch(script)
    assert events[-1].text == "status of id 1: ALARM input_voltage"
    assert troubles(events) == []


# Whose packets


def test_families_take_turns() -> None:
    """As in a scan of all three, at one speed."""
    script = [
        (time, mark, data)
        for start, (question, answer) in enumerate([*DIALOGUES.values(), *DIALOGUES.values()])
        for time, mark, data in ((start, ">", question), (start + 0.003, "<", answer))
    ]
    tracker = Tracker()
    events = watch(script, tracker)
    assert [event.family.name for event in events if event.family] == [
        name for name in [*DIALOGUES, *DIALOGUES] for _ in range(2)
    ]
    assert troubles(events) == []
    assert [(tally.family.name, tally.id) for tally in tracker.servos] == [
        ("dynamixel", 1),
        ("herkulex", 253),
        ("lewansoul", 1),
    ]


def test_a_silent_servo_of_another_family() -> None:
    script = [(0.0, ">", PING), (0.2, ">", POS_READ), (0.4, ">", STAT), (0.402, "<", STAT_ACK)]
    assert kinds(watch(script)) == ["request", "silence", "request", "silence", "request", "answer"]


def test_junk_before_anything_is_known() -> None:
    tracker = Tracker()
    (junk,) = tracker.feed(Chunk(0.0, Direction.IN, b"\x01\x02"))
    assert (junk.kind, junk.raw, junk.family, junk.time) == (EventKind.NOISE, b"\x01\x02", None, 0.0)
    assert tracker.family is None
    assert tracker.junk == 2


def test_damage_does_not_change_the_family() -> None:
    bad = RAM_ACK[:-1] + b"\x00"
    script = [(0.0, ">", RAM_READ), (0.003, "<", bad), (1.0, ">", RAM_READ), (1.003, "<", RAM_ACK)]
    assert kinds(watch(script)) == ["request", "corrupt", "request", "answer"]


# The same live and from a recording


def test_looking_at_the_clock_changes_nothing() -> None:
    script = [(0.0, ">", READ), (0.002, "<", HEAT[:4]), (0.3, ">", READ), (0.302, "<", HEAT), (0.4, "<", PONG)]
    script += [(0.5, ">", SYNC), (0.7, "<", b"\x00"), (0.9, ">", WRITE), (0.902, "<", PONG), (1.5, ">", WRITE)]
    plain = watch([*script, (9.0, ">", PING)])
    tracker, live = Tracker(), []
    for entry in entries([*script, (9.0, ">", PING)]):
        while tracker.time + 0.007 < entry.time:
            live += tracker.pass_time(tracker.time + 0.007)
        live += tracker.feed(entry)
    assert live + tracker.finish() == plain
    assert Trouble.SILENT in troubles(plain)
    assert Trouble.JUNK in troubles(plain)
