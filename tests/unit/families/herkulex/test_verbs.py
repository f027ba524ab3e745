"""The verbs of HerkuleX servos: what they send, in which order, and what they make of the answers."""

from collections.abc import Sequence
from typing import Any

import pytest

from servobus.core.exchange import Exchange, Now, Pause, Procedure
from servobus.core.framing import Packet
from servobus.core.registers import Register
from servobus.core.units import deg
from servobus.errors import BadValue, BusError, NoReply, TorqueOff, UsageError
from servobus.families.base import Answers, AxisMove, Identity, KnownServo, ServoRef
from servobus.families.herkulex import protocol as herkulex
from servobus.families.herkulex.models.magnetic import DRS0602
from servobus.families.herkulex.protocol import (
    EEP_TIME,
    FRAMING,
    ControlMode,
    EepRead,
    EepWrite,
    IJog,
    Jog,
    Keep,
    RamRead,
    RamWrite,
    Reboot,
    Request,
    Rollback,
    SJog,
    Stat,
    parse_request,
)

SERVO = KnownServo.of(ServoRef(219, DRS0602, Answers.READS), 115200)
TALKER = KnownServo.of(ServoRef(219, DRS0602, Answers.EVERYTHING), 115200)
MUTE = KnownServo.of(ServoRef(219, DRS0602, Answers.NOTHING), 115200)
FAMILY = DRS0602.family
OK = b"\x00\x00"


def said(exchange: Exchange[Any]) -> Request:
    (packet,) = FRAMING.decode(exchange.request)
    assert isinstance(packet, Packet)
    return parse_request(packet)


def play(procedure: Procedure[Any], *answers: bytes | Exception) -> tuple[Any, list[Request | Pause]]:
    """Carry a procedure out: each exchange that waits for a reply gets the data of the next answer."""
    left, steps = list(answers), list[Request | Pause]()
    reply: Any = None
    step = next(procedure)
    while True:
        if isinstance(step, Now):
            step = procedure.send(0.0)
            continue
        if isinstance(step, Exchange):
            steps.append(said(step))
            answer = left.pop(0) if step.reply else b""
        else:
            assert isinstance(step, Pause)
            steps.append(step)
            answer = b""
        try:
            if isinstance(answer, Exception):
                step = procedure.throw(answer)
                continue
            if isinstance(step, Exchange) and step.reply:
                packet = Packet(steps[-1].id, step.reply.code or 0, answer)  # type: ignore[union-attr]
                assert step.reply.fits(packet)
                reply = step.interpret(packet)
            else:
                reply = None
            step = procedure.send(reply)
        except StopIteration as stop:
            assert not left, "an answer was not asked for"
            return stop.value, steps


def image(start: int, size: int, **registers: int) -> bytes:
    """Give the data of a RAM_READ ACK in which these registers stand."""
    data = bytearray(size)
    for name, raw in registers.items():
        row = DRS0602.register(name)
        at = getattr(row.place, "ram", 0) - start
        data[at : at + row.layout.size] = row.layout.pack(raw)
    return bytes((start, size)) + bytes(data) + OK


def motion_status(
    position: int = 16384, torque: int = 0x60, mode: int = 0, low: int = 10627, high: int = 22129, error: int = 0
) -> tuple[bytes, bytes]:
    return (
        image(3, 21, torque_policy=0x15, min_position=low, max_position=high),
        image(
            48, 12, status_error=error, torque_control=torque, current_control_mode=mode, calibrated_position=position
        ),
    )


def torque_state(torque: int = 0x60, error: int = 0) -> tuple[bytes, bytes]:
    return image(3, 1, torque_policy=0x15), image(48, 5, status_error=error, torque_control=torque)


LIGHT = image(53, 1)
STOPS = [IJog(219, (Jog(219, 16384, stop=True),))] * 3
"""What goes out right behind the torque, so that a servo which kept its goal does not run there (EH-43)."""


# Identity


def test_identify() -> None:
    identity, steps = play(FAMILY.identify(219), b"\x00\x04\x06\x02\x00\x90" + OK, b"\x01\x01\x02" + OK)
    assert identity == Identity(0x0602, "0.90", Answers.EVERYTHING)
    assert steps == [EepRead(219, 0, 4), RamRead(219, 1, 1)]


def test_identify_a_servo_that_answers_stat_alone() -> None:
    identity, steps = play(FAMILY.identify(219), NoReply("silence"), OK)
    assert identity == Identity(None, "", Answers.NOTHING)
    assert steps == [EepRead(219, 0, 4), Stat(219)]


def test_identify_nobody() -> None:
    with pytest.raises(NoReply):
        play(FAMILY.identify(219), NoReply("silence"), NoReply("silence"))


# Registers


def rows(*names: str) -> list[Register[Any]]:
    return [DRS0602.register(name) for name in names]


def test_read_goes_to_ram_and_bridges_small_gaps() -> None:
    data = image(48, 12, status_error=8, voltage=120, calibrated_position=20000)
    values, steps = play(FAMILY.read(SERVO, rows("calibrated_position", "status_error", "voltage")), data)
    assert values == [20000, 8, 120]
    assert steps == [RamRead(219, 48, 12)]


def test_read_in_both_maps() -> None:
    wanted = rows("baud", "id", "desired_velocity")
    values, steps = play(
        FAMILY.read(SERVO, wanted), b"\x00\x01\xdb" + OK, b"\x48\x02\xff\xff" + OK, b"\x04\x01\x10" + OK
    )
    assert values == [16, 219, -1]
    assert steps == [RamRead(219, 0, 1), RamRead(219, 72, 2), EepRead(219, 4, 1)]


def test_read_stored() -> None:
    values, steps = play(
        FAMILY.read_stored(SERVO, rows("id", "led_control")), b"\x35\x01\x02" + OK, b"\x06\x01\x07" + OK
    )
    assert values == [7, 2]
    assert steps == [RamRead(219, 53, 1), EepRead(219, 6, 1)]


def test_a_mute_servo_cannot_be_read() -> None:
    with pytest.raises(UsageError, match="ACK Policy is 0"):
        play(FAMILY.read(MUTE, rows("id")))


def test_write_joins_neighbours() -> None:
    values = dict(zip(rows("max_position", "baud", "min_position"), [20000, 1, 12000], strict=True))
    _, steps = play(FAMILY.put(TALKER, values, keep=False), OK, OK, OK)
    assert steps == [EepWrite(219, 4, b"\x01"), Stat(219), RamWrite(219, 20, b"\xe0\x2e\x20\x4e")]


def test_store_writes_both_maps() -> None:
    _, steps = play(FAMILY.put(SERVO, dict(zip(rows("position_kp", "baud"), [80, 1], strict=True)), keep=True), OK, OK)
    heard = Stat(219)
    kp = b"\x50\x00"
    assert steps == [EepWrite(219, 4, b"\x01"), heard, EepWrite(219, 30, kp), heard, RamWrite(219, 24, kp)]


def test_store_refuses_what_is_lost() -> None:
    with pytest.raises(UsageError, match="led_control lives in RAM"):
        play(FAMILY.store(SERVO, {DRS0602.led_control: 1}))


def test_the_policy_is_written_last_and_its_answer_not_waited_for() -> None:
    _, steps = play(FAMILY.write(TALKER, dict(zip(rows("ack_policy", "led_control"), [1, 1], strict=True))), OK)
    assert steps == [RamWrite(219, 53, b"\x01"), RamWrite(219, 1, b"\x01"), Pause(2 * herkulex.TURNAROUND)]


# Motion


def axis(id: int, goal: int, duration: float = 1.0) -> AxisMove:
    return AxisMove(KnownServo.of(ServoRef(id, DRS0602, Answers.READS), 115200), goal, 1.0, duration)


def launched(axes: Sequence[AxisMove]) -> list[Any]:
    return play(FAMILY.start_moves(axes))[1]


def test_stance() -> None:
    found, steps = play(FAMILY.motion_status(SERVO), *motion_status(position=22865, mode=1))
    assert found.position == pytest.approx(180 * deg)
    assert (found.torque, found.turning, found.low, found.high) == (True, True, 10627, 22129)
    assert steps == [RamRead(219, 3, 21), RamRead(219, 48, 12)]


@pytest.mark.parametrize("torque", [0x00, 0x40])
def test_neither_free_nor_braked_is_torque(torque: int) -> None:
    found, _ = play(FAMILY.motion_status(SERVO), *motion_status(torque=torque))
    assert not found.torque


@pytest.mark.parametrize(
    ("duration", "playtime"), [(0.0001, 1), (0.0112, 1), (0.0113, 2), (0.672, 60), (1.0, 90), (2.8448, 254)]
)
def test_playtime_is_rounded_up(duration: float, playtime: int) -> None:
    assert launched([axis(7, 16384, duration)]) == [IJog(7, (Jog(7, 16384, playtime=playtime),))]


def test_a_move_can_take_too_long() -> None:
    assert DRS0602.max_move_time == pytest.approx(2.8448)
    with pytest.raises(BadValue, match=r"2.845 s is longer than 2.8448 s"):
        launched([axis(7, 16384, 2.845)])


def test_a_single_move_waits_for_its_ack() -> None:
    _, steps = play(FAMILY.start_moves([AxisMove(TALKER, 16384, 1.0, 0.672)]), OK)
    assert steps == [IJog(219, (Jog(219, 16384, playtime=60),))]


def test_equal_durations_go_in_s_jog() -> None:
    assert launched([axis(1, 16384), axis(2, 20000)]) == [SJog(254, 90, (Jog(1, 16384), Jog(2, 20000)))]


def test_different_durations_go_in_i_jog() -> None:
    assert launched([axis(1, 16384, 0.672), axis(2, 20000)]) == [
        IJog(254, (Jog(1, 16384, playtime=60), Jog(2, 20000, playtime=90)))
    ]


def test_many_servos_are_split() -> None:
    assert [len(step.jogs) for step in launched([axis(id, 16384) for id in range(110)])] == [53, 53, 4]
    mixed = [axis(id, 16384, 1 + id % 2) for id in range(90)]
    assert [len(step.jogs) for step in launched(mixed)] == [43, 43, 4]


@pytest.mark.parametrize(("detail", "moving"), [(0x41, True), (0x42, False)])
def test_moving(detail: int, moving: bool) -> None:
    assert play(FAMILY.moving(MUTE), bytes((0, detail))) == (moving, [Stat(219)])


def test_stop_holds_the_present_position() -> None:
    # The goal at RAM 68 shows that the JOG has arrived: it is another then.
    goals = [image(68, 2, absolute_goal_position=raw) for raw in (20480, 17000)]
    outcome, steps = play(FAMILY.stop(SERVO), *motion_status(position=17000), *goals)
    assert steps[-2:] == [IJog(219, (Jog(219, 17000, stop=True),)), RamRead(219, 68, 2)]
    assert str(outcome) == "held at 17.1°"  # (17000 - 16384) * 0.02778


def test_stop_a_turning_servo() -> None:
    stands = [image(58, 2, calibrated_position=20000)] * 2
    outcome, steps = play(FAMILY.stop(SERVO), *motion_status(mode=1), *stands)
    jog = next(step for step in steps if isinstance(step, IJog))
    assert jog == IJog(219, (Jog(219, 0, ControlMode.INFINITE_TURN, stop=True),))
    assert str(outcome) == "it turns no more"


def test_torque() -> None:
    _, steps = play(FAMILY.torque(SERVO, on=False), image(52, 1))
    assert steps == [RamWrite(219, 52, b"\x00"), RamRead(219, 52, 1)]
    _, steps = play(FAMILY.torque(SERVO, on=True), *motion_status(torque=0), LIGHT, *torque_state())
    expected = [RamRead(219, 53, 1), RamWrite(219, 52, b"\x60"), *STOPS, RamRead(219, 3, 1), RamRead(219, 48, 5)]
    assert steps[2:] == expected


def test_torque_that_stays_off_is_told() -> None:
    """Torque Policy is 0x15 from the factory: overload, 0x10, keeps the torque off (4-2 NO 10)."""
    with pytest.raises(TorqueOff, match=r"has shut down \(overload\).*rearm"):
        play(FAMILY.torque(SERVO, on=True), *motion_status(torque=0, error=0x10))
    with pytest.raises(TorqueOff, match="overload"):  # it came meanwhile
        again = torque_state(torque=0, error=0x10)
        play(FAMILY.torque(SERVO, on=True), *motion_status(torque=0), LIGHT, *again, LIGHT, *again)


def test_a_write_that_was_lost_is_sent_again() -> None:
    off, on = (LIGHT, *torque_state(torque=0)), (LIGHT, *torque_state())
    _, steps = play(FAMILY.torque(SERVO, on=True), *motion_status(torque=0), *off, *on)
    assert steps.count(RamWrite(219, 52, b"\x60")) == 2
    with pytest.raises(BusError, match="did not come on"):
        play(FAMILY.torque(SERVO, on=True), *motion_status(torque=0), *off, *off)


@pytest.mark.parametrize(("speed", "raw"), [(198.4 * deg, 320), (-198.4 * deg, -320), (0.0, 0)])
def test_turn(speed: float, raw: int) -> None:
    _, steps = play(FAMILY.turn(SERVO, speed=speed, output=None), *motion_status())
    assert steps[2:] == [IJog(219, (Jog(219, raw, ControlMode.INFINITE_TURN, playtime=60),))]


def test_turn_takes_a_speed_it_can_say() -> None:
    with pytest.raises(UsageError, match="give speed"):
        play(FAMILY.turn(SERVO, speed=None, output=0.5))
    for speed in (10_158 * deg, float("nan"), float("inf")):
        with pytest.raises(BadValue, match="is beyond"):
            play(FAMILY.turn(SERVO, speed=speed, output=None))


def test_position_mode() -> None:
    _, steps = play(FAMILY.position_mode(SERVO, None), *motion_status(position=17000, mode=1))
    assert steps[2:] == [IJog(219, (Jog(219, 17000),))]


def test_position_mode_sets_limits() -> None:
    free = motion_status(torque=0, low=12000, high=20000)
    _, steps = play(FAMILY.position_mode(SERVO, (12000, 20000)), *motion_status(torque=0), *free)
    assert steps[2] == RamWrite(219, 20, b"\xe0\x2e\x20\x4e")
    assert len(steps) == 5


def test_position_mode_outside_the_limits_does_not_run_back() -> None:
    _, steps = play(
        FAMILY.position_mode(SERVO, None),
        *motion_status(position=30000, mode=1),
        image(52, 1),
        *motion_status(position=30000, torque=0),
        LIGHT,
        *torque_state(),
    )
    assert [step for step in steps if not isinstance(step, RamRead)] == [
        RamWrite(219, 52, b"\x00"),
        IJog(219, (Jog(219, 22129),)),
        RamWrite(219, 52, b"\x60"),
        *[IJog(219, (Jog(219, 22129, stop=True),))] * 3,
    ]


# Light, life and identity


@pytest.mark.parametrize(
    ("colour", "bits"),
    [
        ("off", 0),
        ("on", 7),
        ("white", 7),
        ("green", 1),
        ("blue", 2),
        ("red", 4),
        ("cyan", 3),
        ("magenta", 6),
        ("yellow", 5),
    ],
)
def test_led(colour: str, bits: int) -> None:
    assert play(FAMILY.led(SERVO, colour))[1] == [RamWrite(219, 53, bytes((bits,)))]


def test_no_such_colour() -> None:
    with pytest.raises(BadValue, match="no light 'pink'"):
        play(FAMILY.led(SERVO, "pink"))


def test_reboot() -> None:
    assert play(FAMILY.reboot(SERVO))[1] == [Reboot(219)]


def test_reset() -> None:
    found, steps = play(
        FAMILY.reset(KnownServo.of(ServoRef(3, DRS0602, Answers.EVERYTHING), 115200), frozenset()), OK, OK, OK
    )
    assert found == (219, 115_200)
    assert steps == [Rollback(3), Pause(EEP_TIME), Stat(3), Reboot(3)]


def test_reset_keeps() -> None:
    keep = frozenset({"id", "baud", "calibration"})
    target = KnownServo.of(ServoRef(3, DRS0602, Answers.READS), 115200)
    found, steps = play(FAMILY.reset(target, keep), b"\x06\x01\x03" + OK, b"\x04\x01\x01" + OK, OK)
    assert found == (3, 1_000_000)
    assert steps[2] == Rollback(3, Keep.ID | Keep.BAUD | Keep.CALIBRATION)


def test_reset_keeps_nothing_else() -> None:
    with pytest.raises(UsageError, match="cannot keep gains"):
        play(FAMILY.reset(SERVO, frozenset({"gains"})))


def test_set_id_ends_with_the_write_that_acts() -> None:
    before, after = b"\x06\x01\xdb" + OK, b"\x06\x01\x04" + OK
    _, steps = play(FAMILY.set_id(TALKER, 4), before, OK, OK, after, OK)
    look = EepRead(219, 6, 1)
    assert steps == [look, EepWrite(219, 6, b"\x04"), Stat(219), look, RamWrite(219, 0, b"\x04")]
    with pytest.raises(BadValue, match="broadcast"):
        play(FAMILY.set_id(SERVO, 254))


def test_set_baud_restarts() -> None:
    _, steps = play(FAMILY.set_baud(SERVO, 1_000_000), b"\x04\x01\x10" + OK, OK, b"\x04\x01\x01" + OK)
    look = EepRead(219, 4, 1)
    assert steps == [look, EepWrite(219, 4, b"\x01"), Stat(219), look, Pause(EEP_TIME), Reboot(219)]
    with pytest.raises(BadValue, match="9600"):
        play(FAMILY.set_baud(SERVO, 9600))


@pytest.mark.parametrize(
    ("packet", "words"),
    [
        (Packet(1, 4, b"\x3a\x02"), "RAM_READ id 1: 2 bytes from address 58"),
        (Packet(1, 0x47, b"\x10\x00"), "ACK of STAT from id 1: ALARM overload"),
        (Packet(1, 0x0D), "unknown command 0x0d"),
        (Packet(1, 0x5F, OK), "unknown command 0x1f"),
        (Packet(1, 7, b"\x00"), "STAT with 1 data bytes"),
    ],
)
def test_explain(packet: Packet, words: str) -> None:
    assert words in FAMILY.explain(packet)


def test_speeds() -> None:
    assert DRS0602.bauds[0] == DRS0602.factory_baud == 115_200
    assert len(DRS0602.bauds) == 8
    assert FAMILY.full_duplex
