"""The verbs of LewanSoul servos, against a servo of a few lines."""

import math
from typing import Any

import pytest

from servobus.core.exchange import Exchange, Job, Now, Pause
from servobus.core.framing import Packet
from servobus.core.registers import Register
from servobus.core.replies import ReplyCollector
from servobus.errors import BadValue, NoReply, UsageError
from servobus.families.base import Answers, AxisMove, KnownServo, ServoRef
from servobus.families.lewansoul.models.lx import LX16A
from servobus.families.lewansoul.places import Pair
from servobus.families.lewansoul.protocol import (
    Answer,
    Command,
    Mode,
    encode,
    parse_request,
)
from servobus.families.lewansoul.verbs import Lewansoul

FAMILY = Lewansoul()
HEARS = "SERVO_ID_READ id 3"
"""What is asked after each write to the EEPROM."""
TARGET = KnownServo.of(ServoRef(3, LX16A, Answers.READS), 115200)


READS = {
    Command(row.place.write): Command(row.place.read)
    for row in LX16A.registers.values()
    if isinstance(row.place, Pair) and row.place.write is not None
}
"""write command -> the read command that gives the same values back"""


FINE = {
    "SERVO_POS_READ": (500,),
    "SERVO_LOAD_OR_UNLOAD_READ": (1,),
    "SERVO_ANGLE_LIMIT_READ": (0, 1000),
    "SERVO_OR_MOTOR_MODE_READ": (0, 0, 0),
    "SERVO_TEMP_READ": (25,),
    "SERVO_TEMP_MAX_LIMIT_READ": (85,),
    "SERVO_VIN_READ": (7400,),
    "SERVO_VIN_LIMIT_READ": (6500, 12000),
}
"""Answers of a servo at 120° that holds, with limits from the factory (replies 5 to 10, points 14, 16)."""


class Pretender:
    """Answers like a servo with id 3: what a write command leaves, its read command gives back."""

    def __init__(self, **answers: tuple[int, ...]) -> None:
        self.answers = {Command.SERVO_ID_READ: (3,)} | {Command[name]: values for name, values in answers.items()}
        self.steps: list[str] = []

    def run_blocking(self, job: Job[Any]) -> Any:
        steps = iter(job)
        result: Any = None
        while True:
            try:
                step = steps.send(result)
            except StopIteration as stop:
                return stop.value
            result = self._step(step)

    def _step(self, step: Any) -> Any:
        if isinstance(step, Pause):
            self.steps.append("pause")
            return None
        if isinstance(step, Now):
            return 0.0
        assert isinstance(step, Exchange)
        (packet,) = step.framing.decode(step.request)
        assert isinstance(packet, Packet)
        request = parse_request(packet)
        self.steps.append(str(request))
        command = request.command
        if command in READS:
            self.answers[READS[command]] = request.values
        assert (step.reply is None) == (not command.reply)
        if step.reply is None:
            return None
        collector = ReplyCollector([step])
        if command in self.answers:
            collector.feed(encode(Answer(request.id, command, self.answers[command])))
        return collector.result()


def test_a_servo_that_answers_is_known_by_its_presence_alone() -> None:
    identity = Pretender(SERVO_ID_READ=(3,)).run_blocking(FAMILY.identify(3))
    assert (identity.number, identity.firmware, identity.answers) == (None, "", Answers.READS)
    nobody = Pretender()
    nobody.answers.clear()
    with pytest.raises(NoReply):
        nobody.run_blocking(FAMILY.identify(3))


def test_registers_of_one_command_are_read_with_one_question() -> None:
    servo = Pretender(SERVO_OR_MOTOR_MODE_READ=(1, 0, -500), SERVO_POS_READ=(-12,))
    rows: list[Register[Any]] = [LX16A.motor_speed, LX16A.present_position, LX16A.mode]
    assert servo.run_blocking(FAMILY.read(TARGET, rows)) == [-500, -12, 1]
    assert servo.steps == ["SERVO_OR_MOTOR_MODE_READ id 3", "SERVO_POS_READ id 3"]


def test_parameters_that_are_not_given_are_sent_back_as_they_were() -> None:
    servo = Pretender(SERVO_ANGLE_LIMIT_READ=(100, 900))
    servo.run_blocking(FAMILY.put(TARGET, {LX16A.max_position: 800}, keep=False))
    assert servo.steps == ["SERVO_ANGLE_LIMIT_READ id 3", "SERVO_ANGLE_LIMIT_WRITE id 3, min 100, max 800", HEARS]


def test_nothing_is_read_first_where_all_parameters_are_given() -> None:
    servo = Pretender()
    servo.run_blocking(FAMILY.put(TARGET, {LX16A.motor_speed: -500, LX16A.mode: 1}, keep=False))
    servo.run_blocking(FAMILY.put(TARGET, {LX16A.goal_time: 20, LX16A.goal_position: 10}, keep=False))
    assert servo.steps == [
        "SERVO_OR_MOTOR_MODE_WRITE id 3, mode 1, null 0, speed -500",
        "SERVO_MOVE_TIME_WRITE id 3, angle 10, time_ms 20",
    ]


def test_a_goal_alone_keeps_the_time_of_the_last_move() -> None:
    servo = Pretender(SERVO_MOVE_TIME_READ=(500, 700))
    servo.run_blocking(FAMILY.put(TARGET, {LX16A.goal_position: 10}, keep=False))
    assert servo.steps[1:] == ["SERVO_MOVE_TIME_WRITE id 3, angle 10, time_ms 700"]


@pytest.mark.parametrize("register", [LX16A.goal_time, LX16A.wait_goal_time])
def test_a_time_alone_would_repeat_a_move_and_is_refused(register: Any) -> None:
    servo = Pretender()
    with pytest.raises(BadValue, match="cannot be written alone"):
        servo.run_blocking(FAMILY.put(TARGET, {LX16A.led: 1, register: 100}, keep=False))
    assert servo.steps == []


def test_a_reading_cannot_be_written() -> None:
    with pytest.raises(BadValue, match="can only be read"):
        Pretender().run_blocking(FAMILY.put(TARGET, {LX16A.present_voltage: 7400}, keep=False))


@pytest.mark.parametrize(
    ("low", "high"), [(LX16A.min_position, LX16A.max_position), (LX16A.min_voltage, LX16A.max_voltage)]
)
def test_limits_that_cross_are_refused_for_the_servo_would_ignore_them(low: Any, high: Any) -> None:
    servo = Pretender(**FINE | {"SERVO_LOAD_OR_UNLOAD_READ": (0,)})
    with pytest.raises(BadValue, match="is not below"):
        servo.run_blocking(FAMILY.write(TARGET, {low: 5000, high: 5000}))
    assert not any("WRITE" in step for step in servo.steps)


def test_the_id_is_written_last() -> None:
    servo = Pretender()
    servo.run_blocking(FAMILY.put(TARGET, {LX16A.id: 4, LX16A.angle_offset: -50, LX16A.led: 1}, keep=True))
    assert servo.steps == [
        "SERVO_ANGLE_OFFSET_ADJUST id 3, offset -50",
        "SERVO_ANGLE_OFFSET_WRITE id 3",
        HEARS,
        "SERVO_LED_CTRL_WRITE id 3, led 1",
        HEARS,
        "SERVO_ID_WRITE id 3, new_id 4",
        "SERVO_ID_READ id 4",
    ]


def test_an_offset_that_is_written_is_not_saved() -> None:
    servo = Pretender()
    servo.run_blocking(FAMILY.put(TARGET, {LX16A.angle_offset: -50}, keep=False))
    assert servo.steps == ["SERVO_ANGLE_OFFSET_ADJUST id 3, offset -50"]


def test_what_the_servo_forgets_cannot_be_stored() -> None:
    servo = Pretender()
    with pytest.raises(UsageError, match="not saved"):
        servo.run_blocking(FAMILY.store(TARGET, {LX16A.led: 1, LX16A.goal_position: 1}))
    assert servo.steps == []


def test_the_stance_is_read_with_one_question_per_command() -> None:
    servo = Pretender(
        **FINE | {"SERVO_ANGLE_LIMIT_READ": (100, 900)},
    )
    motion_status = servo.run_blocking(FAMILY.motion_status(TARGET))
    assert len(servo.steps) == len(FINE)
    assert math.degrees(motion_status.position) == pytest.approx(120)
    assert (motion_status.torque, motion_status.low, motion_status.high, motion_status.turning) == (
        True,
        100,
        900,
        False,
    )
    servo.answers[Command.SERVO_OR_MOTOR_MODE_READ] = (1, 0, 0)
    assert servo.run_blocking(FAMILY.motion_status(TARGET)).turning


def test_one_leg_starts_at_once_and_several_start_together() -> None:
    axes = [AxisMove(KnownServo.of(ServoRef(id, LX16A, Answers.READS), 115200), 100 * id, 1.0, 0.5) for id in (1, 2)]
    servo = Pretender()
    servo.run_blocking(FAMILY.start_moves(axes[:1]))
    assert servo.steps == ["SERVO_MOVE_TIME_WRITE id 1, angle 100, time_ms 500"]
    servo.steps.clear()
    servo.run_blocking(FAMILY.start_moves(axes))
    assert servo.steps == [
        "SERVO_MOVE_TIME_WAIT_WRITE id 1, angle 100, time_ms 500",
        "SERVO_MOVE_TIME_WAIT_WRITE id 2, angle 200, time_ms 500",
        "SERVO_MOVE_START id 254",
    ]


def test_a_move_longer_than_30_s_is_refused_before_anything_is_sent() -> None:
    assert LX16A.max_move_time == 30.0
    servo = Pretender()
    with pytest.raises(BadValue, match="30 s"):
        servo.run_blocking(FAMILY.start_moves([AxisMove(TARGET, 0, 1.0, 1.0), AxisMove(TARGET, 0, 1.0, 30.001)]))
    assert servo.steps == []


@pytest.mark.parametrize("after", [500, 499])
def test_a_servo_moves_if_its_position_changes(after: int) -> None:
    servo = Pretender(SERVO_POS_READ=(500,))
    steps = FAMILY.moving(TARGET)
    results: list[Any] = [None]
    with pytest.raises(StopIteration) as stop:
        while True:
            step = steps.send(results[-1])
            if isinstance(step, Pause):
                servo.answers[Command.SERVO_POS_READ] = (after,)
            results.append(servo._step(step))
    assert stop.value.value == (after != 500)
    assert servo.steps == ["SERVO_POS_READ id 3", "pause", "SERVO_POS_READ id 3"]


def test_stop_ends_a_move_first_and_then_an_endless_turn() -> None:
    servo = Pretender(**FINE | {"SERVO_MOVE_TIME_READ": (900, 0)})
    assert str(servo.run_blocking(FAMILY.stop(TARGET))) == "held at 120.0°"  # 500 * 0.24
    assert servo.steps[0] == "SERVO_MOVE_STOP id 3"
    assert servo.steps[-2:] == ["SERVO_MOVE_TIME_WRITE id 3, angle 500, time_ms 0", "SERVO_MOVE_TIME_READ id 3"]
    servo = Pretender(**FINE | {"SERVO_OR_MOTOR_MODE_READ": (1, 0, 800)})
    assert str(servo.run_blocking(FAMILY.stop(TARGET))) == "it turns no more"
    assert servo.steps[0] == "SERVO_MOVE_STOP id 3"
    assert servo.steps[-2:] == [
        "SERVO_OR_MOTOR_MODE_WRITE id 3, mode 1, null 0, speed 0",
        "SERVO_OR_MOTOR_MODE_READ id 3",
    ]


def test_torque_off_is_told_and_asked_for() -> None:
    servo = Pretender()
    servo.run_blocking(FAMILY.torque(TARGET, on=False))
    assert servo.steps == ["SERVO_LOAD_OR_UNLOAD_WRITE id 3, load 0", "SERVO_LOAD_OR_UNLOAD_READ id 3"]


@pytest.mark.parametrize(
    ("here", "first"),
    [(500, ["SERVO_MOVE_TIME_WRITE id 3, angle 500, time_ms 0"]), (-40, ["SERVO_MOVE_STOP id 3"] * 3)],
)
def test_before_torque_on_the_present_position_is_the_goal_where_it_can_be_one(here: int, first: list[str]) -> None:
    servo = Pretender(**FINE | {"SERVO_POS_READ": (here,), "SERVO_LOAD_OR_UNLOAD_READ": (0,)})
    servo.run_blocking(FAMILY.torque(TARGET, on=True))
    sent = [step for step in servo.steps if "READ" not in step]
    assert sent == [*first, "SERVO_LOAD_OR_UNLOAD_WRITE id 3, load 1"]


@pytest.mark.parametrize(("output", "duty"), [(1, 1000), (-1, -1000), (0.25, 250), (0, 0)])
def test_turning_is_a_share_of_full_output(output: float, duty: int) -> None:
    servo = Pretender(**FINE)
    servo.run_blocking(FAMILY.turn(TARGET, speed=None, output=output))
    assert servo.answers[Command.SERVO_OR_MOTOR_MODE_READ] == (Mode.MOTOR, 0, duty)


def test_turning_at_a_speed_or_beyond_full_output_is_refused() -> None:
    for speed, output in ((1.0, None), (1.0, 0.5), (None, None), (None, 1.01)):
        with pytest.raises(UsageError):
            Pretender().run_blocking(FAMILY.turn(TARGET, speed=speed, output=output))


def test_position_mode_sets_limits_only_where_given_and_changes_the_mode_only_where_needed() -> None:
    servo = Pretender(**FINE | {"SERVO_OR_MOTOR_MODE_READ": (1, 0, 800)})
    servo.run_blocking(FAMILY.position_mode(TARGET, None))
    assert servo.answers[Command.SERVO_OR_MOTOR_MODE_READ] == (0, 0, 0)
    servo.steps.clear()
    servo.run_blocking(FAMILY.position_mode(TARGET, (100, 900)))
    assert [step for step in servo.steps if "WRITE" in step] == ["SERVO_ANGLE_LIMIT_WRITE id 3, min 100, max 900"]
    with pytest.raises(BadValue):
        servo.run_blocking(FAMILY.position_mode(TARGET, (0, 1001)))


def test_the_light_is_on_at_0() -> None:
    servo = Pretender(SERVO_LED_CTRL_READ=(1,))
    servo.run_blocking(FAMILY.led(TARGET, "on"))
    servo.run_blocking(FAMILY.led(TARGET, "off"))
    read = "SERVO_LED_CTRL_READ id 3"
    on, off = "SERVO_LED_CTRL_WRITE id 3, led 0", "SERVO_LED_CTRL_WRITE id 3, led 1"
    assert servo.steps == [read, on, HEARS, read, off, HEARS]
    with pytest.raises(BadValue, match="'red'"):
        servo.run_blocking(FAMILY.led(TARGET, "red"))


def test_the_id_is_changed_with_one_command() -> None:
    servo = Pretender(SERVO_ID_READ=(3,))
    servo.run_blocking(FAMILY.set_id(TARGET, 4))
    assert servo.steps == ["SERVO_ID_READ id 3", "SERVO_ID_WRITE id 3, new_id 4", "SERVO_ID_READ id 4"]


@pytest.mark.parametrize(
    ("job", "hint"),
    [
        (lambda: FAMILY.reboot(TARGET), "power"),
        (lambda: FAMILY.reset(TARGET, frozenset()), "backup"),
        (lambda: FAMILY.set_baud(TARGET, 9600), "115200"),
    ],
)
def test_what_the_protocol_cannot_do_says_so_and_what_to_do_instead(job: Any, hint: str) -> None:
    servo = Pretender()
    with pytest.raises(UsageError, match=hint):
        servo.run_blocking(job())
    assert servo.steps == []
