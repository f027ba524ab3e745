"""The verbs of the LewanSoul bus servos. Packets and their sources: servobus.families.lewansoul.protocol."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from servobus.core.effect import Effect
from servobus.core.exchange import Exchange, Pause, Procedure, ReplyPattern, ack_only
from servobus.core.framing import Packet
from servobus.core.ids import check_id
from servobus.core.registers import Area, Register
from servobus.core.units import Flags, deg
from servobus.core.values import replace
from servobus.errors import BadValue, BusError, UsageError
from servobus.families.base import Family, Identity
from servobus.families.change import set_registers
from servobus.families.lewansoul import listening
from servobus.families.lewansoul.places import Pair
from servobus.families.lewansoul.protocol import (
    FRAMING,
    Alarm,
    Command,
    Mode,
    angle_offset_write,
    length_of,
    mode_write,
    move_start,
    move_stop,
    move_time_wait_write,
    move_time_write,
    places_of,
    question,
    send,
    values_of,
)
from servobus.families.model import Model
from servobus.families.motion import AxisMove, MotionStatus, TorqueState, about_to_turn, inside_limits, raw_position
from servobus.families.reading import Reading
from servobus.families.refusal import cannot, check_output, not_taken, stays_off
from servobus.families.stopping import LIMP, TRIES, TURNS_NO_MORE, StopOutcome, let_go_outside, reachable
from servobus.families.target import Answers, KnownServo, ServoRef

WATCH = 0.05
"""s between the two looks that tell whether a servo moves."""

FAR = 4.9 * deg
"""Way from its goal from which on a servo that stands still is taken to be blocked; assumption."""


class Lewansoul(Family):
    name = "lewansoul"
    title = "LewanSoul bus servo protocol"
    framing = FRAMING
    torque_rows = (
        "torque_enable", "present_temperature", "max_temperature", "present_voltage", "min_voltage", "max_voltage"
    )  # fmt: skip
    mode_rows = ("mode",)
    holds_outside_limits = True  # L-70
    one_table = True  # the protocol document defines what its commands carry, and names no model
    torque_returns = True  # point 16
    needs = ("goal_time", "led", "mode", "motor_speed")

    def ping(self, id: int) -> Exchange[None]:
        return question(check_id(id), Command.SERVO_ID_READ, ack_only)

    def identify(self, id: int) -> Procedure[Identity]:
        """Only presence can be found out: the protocol has no question for model or firmware."""
        yield from self.ping(id)
        return Identity(None, "", Answers.READS)

    def fences(self, id: int) -> Sequence[Exchange[Any]]:
        """Any questions: an answer tells the command it answers."""
        codes = (Command.SERVO_ID_READ, Command.SERVO_LED_CTRL_READ, Command.SERVO_LED_ERROR_READ)
        return [_parameters(id, code) for code in codes]

    def reading(self, target: ServoRef, registers: Sequence[Register[Any]]) -> Reading:
        """Ask each read command once, however many of the registers stand in its answer."""
        codes = list(dict.fromkeys(_pair(register).read for register in registers))
        places = tuple((codes.index(_pair(row).read), _bytes(row), row.layout) for row in registers)
        return Reading(tuple(_parameters(target.id, code) for code in codes), places)

    def put(
        self, target: ServoRef, values: Mapping[Register[Any], int], *, keep: bool, same: Collection[Register[Any]] = ()
    ) -> Procedure[None]:
        """Send each command once; parameters that are not given are read first and sent back unchanged.

        The servo saves by itself, except the offset, which command 18 saves.
        """
        fresh = {register: raw for register, raw in values.items() if register not in same}
        yield from self._write(target, fresh, save=keep)

    def wears(self, register: Register[Any], *, keep: bool) -> bool:
        return register.area is Area.EEPROM and (keep or not _is_offset(register))

    def stored_is_told(self, register: Register[Any]) -> bool:
        """Command 19 tells the offset in use, which command 18 may not have saved yet."""
        return not _is_offset(register)

    def is_turning(self, values: Mapping[str, int]) -> bool:
        return values["mode"] == Mode.MOTOR

    def torque_state(self, values: Mapping[str, Any]) -> TorqueState:
        """Look at temperature and supply too: outside their limits it lets go by itself (points 14, 16)."""
        if alarms := _alarms(values):
            return TorqueState(False, Flags(Alarm).show(alarms))
        return TorqueState(bool(values["torque_enable"]))

    def start_moves(self, axes: Sequence[AxisMove]) -> Procedure[None]:
        """Several legs are kept first and start with one broadcast, which starts any older kept move too."""
        give = move_time_write if len(axes) == 1 else move_time_wait_write
        times = [axis.target.model.register("goal_time").encode(axis.duration) for axis in axes]
        for axis, time in zip(axes, times, strict=True):
            yield from give(axis.target.id, axis.goal, time)
        if len(axes) > 1:
            yield from move_start()

    def goals(self, goals: Mapping[ServoRef, int], time: float) -> list[Exchange[None]]:
        """Have each keep its move, and start them together; see `start_moves`."""
        give = move_time_write if len(goals) == 1 else move_time_wait_write
        moves = [give(target.id, raw, target.model.register("goal_time").encode(time)) for target, raw in goals.items()]
        return moves if len(moves) == 1 else [*moves, move_start()]

    def moving(self, target: ServoRef) -> Procedure[bool]:
        """Compare two positions: no flag tells. Slower than one unit in 50 ms (4.8°/s) counts as rest."""
        row = [target.model.register("present_position")]
        before = yield from self.read(target, row)
        yield Pause(WATCH)
        after = yield from self.read(target, row)
        return before != after

    def hold(self, target: KnownServo) -> Procedure[StopOutcome]:
        """Send command 12, which ends a move, then make sure: nothing answers it.

        What it does in motor mode is not said, so there the speed is set to 0. Else a move to where the servo is
        becomes its last one, and shows in command 2.
        """
        yield from move_stop(target.id)  # before the questions, which cost time
        for _ in range(TRIES):
            motion_status = yield from self.motion_status(target)
            if motion_status.turning:
                if (yield from self._ended_turn(target)):
                    return TURNS_NO_MORE if motion_status.torque else LIMP
            elif not motion_status.torque:
                return LIMP  # and a move may switch it on (L-69)
            elif (here := reachable(target, motion_status)) is None:
                return (yield from let_go_outside(target, motion_status))
            elif (yield from self._took_goal(target, here)):
                goal = target.model.register("goal_position")
                return StopOutcome(f"held at {goal.show(goal.decode(here))}")
        raise BusError(f"{target} did not take that it is to stop")

    def _ended_turn(self, target: ServoRef) -> Procedure[bool]:
        """Set the speed of motor mode to 0, and tell whether the servo has that then."""
        yield from mode_write(target.id, Mode.MOTOR, 0)
        return (yield from self.read(target, [target.model.register("motor_speed")])) == [0]

    def _took_goal(self, target: KnownServo, here: int) -> Procedure[bool]:
        """Give a move to where the servo is, raw, and tell whether that is its last one then."""
        target.record.goal = None
        yield from move_time_write(target.id, here, 0)
        return (yield from self.read(target, [target.model.register("goal_position")])) == [here]

    def give_back(self, target: KnownServo) -> Procedure[None]:
        """The time is a part of the last move, which is given again where it moves nothing: to a servo at its goal."""
        if not target.record.lent:
            return
        raw = yield from self.read_values(target, ("goal_position", "present_position", "torque_enable"))
        row, goal = target.model.register("goal_position"), _goal(target, raw["goal_position"])
        way = row.scale.decode(goal) - row.scale.decode(raw["present_position"])
        if raw["torque_enable"] and abs(way) < FAR:
            yield from set_registers(target, {row: goal, **target.record.lent})

    def settle(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """A servo that is loaded holds the angle at which it is (L-70, assumption).

        What became of a move that was given without torque is not said (L-69): one to where it is replaces it. Outside
        the limits that would run to the nearer one (L-31), so there it is only stopped.
        """
        here = raw_position(target, motion_status)
        if not inside_limits(target, motion_status):
            for _ in range(TRIES):  # no answer shows that this was heard
                yield from move_stop(target.id)
            return
        for _ in range(TRIES):
            if (yield from self._ended_turn(target) if motion_status.turning else self._took_goal(target, here)):
                return
        name, raw = ("motor_speed", 0) if motion_status.turning else ("goal_position", here)
        raise not_taken(target, target.model.register(name), raw)

    def push(self, target: KnownServo) -> Procedure[float]:
        """Nothing tells the output: one that holds and is not near its goal is taken to push with all it has."""
        names = ("torque_enable", "mode", "goal_position", "present_position")
        rows = [target.model.register(name) for name in names]
        torque, mode, told, here = yield from self.read(target, rows)
        way = abs(rows[2].decode(_goal(target, told)) - rows[3].decode(here))
        return float(torque and mode == Mode.POSITION and way > FAR)

    def read_alarms(self, target: ServoRef) -> Procedure[Alarm]:
        """Compare temperature and supply with their limits: no packet tells the alarms, and none a locked rotor."""
        return _alarms((yield from self.read_values(target, self.torque_rows)))

    def end_shutdown(self, target: KnownServo, motion_status: MotionStatus) -> Procedure[None]:
        """Unload: of itself it would go on with its last move when the alarm is over (16)."""
        standing = yield from self.read_alarms(target)
        if standing:
            raise stays_off(target, standing, Flags(Alarm).show(standing))
        if not motion_status.torque:
            yield from self.torque(target, on=False)

    def turn(self, target: KnownServo, *, speed: float | None, output: float | None) -> Procedure[None]:
        """Motor mode: the "speed" of the manual is a duty, nothing measures how fast it turns."""
        if output is None or speed is not None:
            raise cannot(target, "turn at a given speed", "motor mode has no speed control; give output=-1..1")
        duty = target.model.register("motor_speed").encode(check_output(output))
        yield from about_to_turn(target)
        yield from mode_write(target.id, Mode.MOTOR, duty)
        target.record.modes += 1

    def position_mode(self, target: KnownServo, limits: tuple[int, int] | None) -> Procedure[None]:
        """Motor mode leaves the angle limits alone, so `limits` are written only where they are given.

        It lets go of the shaft, which motor mode does not hold either, until the present position is the goal: that the
        servo holds it by itself is an assumption (L-63).
        """
        if limits is not None:
            rows = (target.model.register("min_position"), target.model.register("max_position"))
            yield from self.write(target, {row: row.check(raw) for row, raw in zip(rows, limits, strict=True)})
        motion_status = yield from self.motion_status(target)
        if not motion_status.turning:
            return
        if motion_status.torque:
            yield from mode_write(target.id, Mode.MOTOR, 0)
            yield from self.torque(target, on=False)
        for _ in range(TRIES):
            yield from mode_write(target.id, Mode.POSITION)
            target.record.modes += 1
            if (yield from self._mode(target)) == Mode.POSITION:
                break
        else:
            raise BusError(f"{target} did not take that it is to go to angles again; its torque is off")
        if motion_status.torque:
            yield from self.torque(target, on=True)

    def led(self, target: KnownServo, colour: str) -> Procedure[None]:
        if colour not in ("on", "off"):
            raise BadValue(f"{target} has one light: on or off, not {colour!r}")
        led = target.model.register("led")
        yield from set_registers(target, {led: led.encode(colour == "on")})

    def reboot(self, target: KnownServo) -> Procedure[None]:
        yield from ()  # a procedure without steps
        raise cannot(target, "be rebooted", "the protocol has no such command; switch its power off and on")

    def check_reset(self, target: ServoRef, keep: frozenset[str]) -> None:  # noqa: ARG002
        raise _no_reset(target)

    def reset(self, target: KnownServo, keep: frozenset[str]) -> Procedure[tuple[int, int]]:  # noqa: ARG002
        yield from ()  # a procedure without steps
        raise _no_reset(target)

    def set_baud(self, target: KnownServo, baud: int) -> Procedure[None]:
        yield from ()  # a procedure without steps
        raise cannot(target, f"talk at {baud} baud", f"its speed is fixed at {target.model.factory_baud} (manual 2)")

    def explain(
        self,
        packet: Packet,
        request: Packet | None = None,  # noqa: ARG002 - the length tells questions from answers
        model: type[Model] | None = None,
    ) -> str:
        return listening.explain(packet, model)

    def effect(self, packet: Packet, model_of: Callable[[int], type[Model] | None]) -> Effect:
        return listening.effect(packet, model_of)

    def replies_to(self, packet: Packet) -> tuple[ReplyPattern, ...] | None:
        return listening.replies_to(packet)

    def _mode(self, target: ServoRef) -> Procedure[int]:
        (mode,) = yield from self.read(target, [target.model.register("mode")])
        return mode

    def _write(self, target: ServoRef, values: Mapping[Register[Any], int], *, save: bool) -> Procedure[None]:
        for command, group in _by_command(values):
            data = yield from self._rest(target, command, group)
            for register, raw in group.items():
                data[_bytes(register)] = register.layout.pack(raw)
            parameters = values_of(command, command.params, bytes(data))
            yield from send(target.id, command, *parameters)
            if save and command is Command.SERVO_ANGLE_OFFSET_ADJUST:
                yield from angle_offset_write(target.id)
            if any(self.wears(register, keep=save) for register in group):
                id = group.get(target.model.register("id"), target.id)
                yield from self.await_eeprom(replace(target, id=id), len(data))

    def _rest(self, target: ServoRef, command: Command, group: Mapping[Register[Any], int]) -> Procedure[bytearray]:
        """Give the command's parameters as they are in the servo, or zeros where all of them are given."""
        given = {_pair(register).at for register in group}
        if given >= {at for name, _, at in places_of(command.params) if name != "null"}:
            return bytearray(length_of(command.params))
        old = yield from _parameters(target.id, _pair(next(iter(group))).read)
        return bytearray(old)


LEWANSOUL = Lewansoul()
"""The one instance, which all models share."""


def _no_reset(target: ServoRef) -> UsageError:
    why = "the protocol has no such command; restore a backup, or set the registers one by one"
    return cannot(target, "be reset", why)


def _goal(target: KnownServo, told: int) -> int:
    """Give the raw goal of the last move, for what command 2 tells: that is the last command 1 (point 2).

    Several servos are moved by commands 7 and 11, and by those it is not told.
    """
    return told if target.record.goal is None else target.record.goal


def _pair(register: Register[Any]) -> Pair:
    assert isinstance(register.place, Pair)
    return register.place


def _alarms(values: Mapping[str, Any]) -> Alarm:
    """Compare temperature and supply with their limits (points 14, 16)."""
    alarms = Alarm(0)
    if values["present_temperature"] > values["max_temperature"]:
        alarms |= Alarm.OVER_TEMPERATURE
    if not values["min_voltage"] <= values["present_voltage"] <= values["max_voltage"]:
        alarms |= Alarm.OVER_VOLTAGE
    return alarms


def _is_offset(register: Register[Any]) -> bool:
    return _pair(register).write == Command.SERVO_ANGLE_OFFSET_ADJUST


def _bytes(register: Register[Any]) -> slice:
    """Tell where the register stands among the parameters of its commands."""
    at = _pair(register).at
    return slice(at, at + register.layout.size)


def _parameters(id: int, code: int) -> Exchange[bytes]:
    return question(id, Command(code), lambda packet: packet.data)


def _by_command(values: Mapping[Register[Any], int]) -> list[tuple[Command, dict[Register[Any], int]]]:
    """Group registers by the command that writes them; the id comes last, it is another from there on."""
    groups: dict[Command, dict[Register[Any], int]] = {}
    for register, raw in values.items():
        code = _pair(register).write
        if code is None:
            raise BadValue(f"{register.model} {register.name} can only be read")
        groups.setdefault(Command(code), {})[register] = raw
    for command, group in groups.items():
        for register in group:
            if not _pair(register).alone and not any(_pair(other).at == 0 for other in group):
                what = f"{register.model} {register.name}"
                raise BadValue(f"{what} cannot be written alone: {command.name} would repeat the last move")
    return sorted(groups.items(), key=lambda item: item[0] is Command.SERVO_ID_WRITE)
