"""LewanSoul (later Hiwonder) bus servos: commands and answers, and what one can ask with them.

Source: the protocol document of the maker ("manual"); errata EL-01 to EL-21 and behaviours L-1 to L-78 of
this project's notes in docs/decisions.md.

    55 55  id  length  command  parameters ...  checksum
    length = parameters + 3                     checksum = ~(id + length + command + parameters) & FF

Only read commands are answered, in the same frame and with the same command; what tells the answer is that
it has parameters and the question has none. There is no error field: a servo that refuses says nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Any, Self, TypeAlias, TypeVar

from servobus.errors import BadValue, UsageError
from servobus.exchange import Exchange, Pause, Procedure, Reply, ask, sent
from servobus.framing import INCOMPLETE, NOT_A_FRAME, Framing, Packet
from servobus.protocols.base import (
    BROADCAST,
    Answers,
    Family,
    Identity,
    Leg,
    Stance,
    Target,
    cannot,
    check_id,
    check_output,
)
from servobus.registers import S8, S16, U8, U16, Area, Int, Pair, Register

T = TypeVar("T")

BAUD = 115_200
"""The only speed (manual 2)."""
TURNAROUND = 0.010
"""s; assumption: the manual gives no figure, drivers in the field wait 20 to 30 ms for a whole answer."""
FULL_OUTPUT = 1000
"""Motor speed that is full output (manual 4, point 21)."""


class Mode(IntEnum):
    """What turns the servo (manual 4, point 21)."""

    POSITION = 0
    MOTOR = 1


class Alarm(IntFlag):
    """Faults that can make the light flash (manual 4, point 27). They cannot be read, only chosen."""

    OVER_TEMPERATURE = 1
    OVER_VOLTAGE = 2
    LOCKED_ROTOR = 4


Fields: TypeAlias = tuple[tuple[str, Int], ...]
"""What the parameters of a command mean, in their order."""

_MOVE: Fields = (("angle", U16), ("time_ms", U16))
_ANGLES: Fields = (("min", U16), ("max", U16))
_VOLTS: Fields = (("min_mv", U16), ("max_mv", U16))
_MODE: Fields = (("mode", U8), ("null", U8), ("speed", S16))


class Command(IntEnum):
    """Commands under the manual's names: code, parameters, parameters of the answer (manual 4 and table 4).

    A command whose answer has no parameters is never answered.
    """

    params: Fields
    reply: Fields

    def __new__(cls, code: int, params: Fields = (), reply: Fields = ()) -> Self:
        command = int.__new__(cls, code)
        command._value_ = code
        command.params, command.reply = params, reply
        return command

    SERVO_MOVE_TIME_WRITE = 1, _MOVE
    SERVO_MOVE_TIME_READ = 2, (), _MOVE
    SERVO_MOVE_TIME_WAIT_WRITE = 7, _MOVE
    SERVO_MOVE_TIME_WAIT_READ = 8, (), _MOVE  # EL-04: some LX-16A are said to stay silent
    SERVO_MOVE_START = 11
    SERVO_MOVE_STOP = 12
    SERVO_ID_WRITE = 13, (("new_id", U8),)
    SERVO_ID_READ = 14, (), (("id", U8),)
    SERVO_ANGLE_OFFSET_ADJUST = 17, (("offset", S8),)
    SERVO_ANGLE_OFFSET_WRITE = 18  # EL-14: saves, and takes no parameter
    SERVO_ANGLE_OFFSET_READ = 19, (), (("offset", S8),)  # EL-05
    SERVO_ANGLE_LIMIT_WRITE = 20, _ANGLES
    SERVO_ANGLE_LIMIT_READ = 21, (), _ANGLES
    SERVO_VIN_LIMIT_WRITE = 22, _VOLTS
    SERVO_VIN_LIMIT_READ = 23, (), _VOLTS
    SERVO_TEMP_MAX_LIMIT_WRITE = 24, (("celsius", U8),)
    SERVO_TEMP_MAX_LIMIT_READ = 25, (), (("celsius", U8),)
    SERVO_TEMP_READ = 26, (), (("celsius", U8),)
    SERVO_VIN_READ = 27, (), (("mv", U16),)  # EL-18
    SERVO_POS_READ = 28, (), (("position", S16),)
    SERVO_OR_MOTOR_MODE_WRITE = 29, _MODE
    SERVO_OR_MOTOR_MODE_READ = 30, (), _MODE
    SERVO_LOAD_OR_UNLOAD_WRITE = 31, (("load", U8),)
    SERVO_LOAD_OR_UNLOAD_READ = 32, (), (("load", U8),)
    SERVO_LED_CTRL_WRITE = 33, (("led", U8),)  # EL-09: 0 is on
    SERVO_LED_CTRL_READ = 34, (), (("led", U8),)
    SERVO_LED_ERROR_WRITE = 35, (("mask", U8),)
    SERVO_LED_ERROR_READ = 36, (), (("mask", U8),)


class LewansoulFraming(Framing):
    header = b"\x55\x55"
    overhead = 6
    max_size = 10

    def size(self, buffer: bytes | bytearray, at: int) -> int:
        # 55 is a legal id too, so of three 55 the first two are tried first (L-11); where that was
        # wrong the checksum fails and the decoder goes on one byte later.
        if len(buffer) - at < 4:
            return INCOMPLETE
        length = buffer[at + 3]
        return length + 3 if 3 <= length <= 7 else NOT_A_FRAME

    def frame(self, packet: Packet) -> bytes:
        if len(packet.data) > self.max_size - self.overhead:
            raise BadValue(f"{len(packet.data)} parameter bytes are more than any command has")
        body = bytes((packet.id, len(packet.data) + 3, packet.code)) + packet.data
        return self.header + body + bytes((~sum(body) & 0xFF,))

    def unframe(self, raw: bytes) -> tuple[Packet, bool]:
        return Packet(raw[2], raw[4], raw[5:-1]), sum(raw[2:]) & 0xFF == 0xFF


FRAMING = LewansoulFraming()


# Packets as values, both ways


@dataclass(frozen=True, slots=True)
class Request:
    """What is sent to a servo; `values` in the order of `command.params`."""

    id: int
    command: Command
    values: tuple[int, ...] = ()

    def __str__(self) -> str:
        return _say(self.id, self.command, self.command.params, self.values)


@dataclass(frozen=True, slots=True)
class Answer:
    """What a servo sends back; `values` in the order of `command.reply`."""

    id: int
    command: Command
    values: tuple[int, ...]

    def __str__(self) -> str:
        return "answer to " + _say(self.id, self.command, self.command.reply, self.values)


def _say(id: int, command: Command, fields: Fields, values: Sequence[int]) -> str:
    named = (f"{name} {value}" for (name, _), value in zip(fields, values, strict=True))
    return ", ".join((f"{command.name} id {id}", *named))


def encode(message: Request | Answer) -> bytes:
    """Give the bytes of a request or an answer. Raises BadValue if a value does not fit its parameter."""
    command = message.command
    fields = command.params if isinstance(message, Request) else command.reply
    if len(fields) != len(message.values):
        names = ", ".join(name for name, _ in fields) or "none"
        raise BadValue(f"{command.name} has parameters: {names}; {len(message.values)} were given")
    data = b""
    for (name, layout), value in zip(fields, message.values, strict=True):
        low, high = layout.range
        if not low <= value <= high:
            raise BadValue(f"{command.name}: {name} {value} is not in {low} .. {high}")
        data += layout.pack(value)
    return FRAMING.frame(Packet(message.id, command, data))


def parse_request(packet: Packet) -> Request:
    """Read a request. Raises ValueError for an unknown command or a wrong length."""
    command = _command(packet)
    return Request(packet.id, command, _values(command, command.params, packet.data))


def parse_answer(packet: Packet) -> Answer:
    """Read an answer. Raises ValueError for a wrong length or a command that is never answered."""
    command = _command(packet)
    if not command.reply:
        raise ValueError(f"{command.name} is never answered")
    return Answer(packet.id, command, _values(command, command.reply, packet.data))


def _command(packet: Packet) -> Command:
    try:
        return Command(packet.code)
    except ValueError:
        raise ValueError(f"unknown command {packet.code}") from None


def _values(command: Command, fields: Fields, data: bytes) -> tuple[int, ...]:
    if len(data) != _length(fields):
        raise ValueError(f"{command.name} with {len(data)} parameter bytes")
    return tuple(layout.unpack(data[at : at + layout.size]) for _, layout, at in _places(fields))


def _length(fields: Fields) -> int:
    return sum(layout.size for _, layout in fields)


def _places(fields: Fields) -> list[tuple[str, Int, int]]:
    """Give each field with the byte at which it starts."""
    return [(name, layout, _length(fields[:n])) for n, (name, layout) in enumerate(fields)]


# Native operations


def send(id: int, command: Command, *values: int) -> Exchange[None]:
    """Send a command that is never answered. Nothing tells whether it arrived."""
    if command.reply:
        raise BadValue(f"{command.name} is a question; its answer must be waited for")
    request = Request(id, command, values)
    raw = encode(request)
    return Exchange(str(request), FRAMING, raw, sent)


def query(id: int, command: Command) -> Exchange[tuple[int, ...]]:
    """Send a read command; the result is the values of the answer, in the order of `command.reply`."""
    return _question(id, command, lambda packet: parse_answer(packet).values)


def _question(id: int, command: Command, interpret: Callable[[Packet], T]) -> Exchange[T]:
    if not command.reply:
        raise BadValue(f"{command.name} is never answered")
    if id == BROADCAST and command is not Command.SERVO_ID_READ:
        raise BadValue(f"{command.name} to id {BROADCAST} is never answered (manual 3)")
    request = Request(id, command)
    reply = Reply(None if id == BROADCAST else id, int(command), (_length(command.reply),))
    return Exchange(str(request), FRAMING, encode(request), interpret, reply, turnaround=TURNAROUND, repeatable=True)


def move_time_write(id: int, angle: int, time: int) -> Exchange[None]:
    """Move to `angle` (0 .. 1000) in `time` ms at even speed, at once (point 1)."""
    return send(id, Command.SERVO_MOVE_TIME_WRITE, angle, time)


def move_time_wait_write(id: int, angle: int, time: int) -> Exchange[None]:
    """Keep a move until `move_start` (point 3)."""
    return send(id, Command.SERVO_MOVE_TIME_WAIT_WRITE, angle, time)


def move_start(id: int = BROADCAST) -> Exchange[None]:
    """Start the kept moves, of all servos by default (point 5)."""
    return send(id, Command.SERVO_MOVE_START)


def move_stop(id: int = BROADCAST) -> Exchange[None]:
    """Stop and hold the present angle, all servos by default (point 6)."""
    return send(id, Command.SERVO_MOVE_STOP)


def id_write(id: int, new_id: int) -> Exchange[None]:
    """Change the id for good. To the broadcast id it gives every servo on the bus that id (L-38)."""
    return send(id, Command.SERVO_ID_WRITE, check_id(new_id))


def id_read(id: int = BROADCAST) -> Exchange[int]:
    """Ask for the id. All servos answer the broadcast id at once: for a servo alone on its bus (reply 3)."""
    return _question(id, Command.SERVO_ID_READ, lambda packet: parse_answer(packet).values[0])


def angle_offset_adjust(id: int, offset: int) -> Exchange[None]:
    """Shift the zero by -125 .. 125 units until power-off; the servo turns at once (point 9)."""
    return send(id, Command.SERVO_ANGLE_OFFSET_ADJUST, offset)


def angle_offset_write(id: int) -> Exchange[None]:
    """Save the offset in use (point 10)."""
    return send(id, Command.SERVO_ANGLE_OFFSET_WRITE)


def mode_write(id: int, mode: Mode, speed: int = 0) -> Exchange[None]:
    """Choose position or motor mode; `speed` -1000 .. 1000 counts in motor mode only (point 21)."""
    return send(id, Command.SERVO_OR_MOTOR_MODE_WRITE, mode, 0, speed)


# The shared verbs

WATCH = 0.05
"""s between the two looks that tell whether a servo moves."""

_LIMITS = (Command.SERVO_ANGLE_LIMIT_WRITE, Command.SERVO_VIN_LIMIT_WRITE)
"""The lower value must be below the upper (points 12, 14); else the servo ignores both in silence (L-47)."""


class Lewansoul(Family):
    name = "lewansoul"
    title = "LewanSoul bus servo protocol"
    framing = FRAMING
    default_baud = BAUD
    bauds = (BAUD,)
    max_move_time = 30.0

    def ping(self, id: int) -> Exchange[None]:
        return _question(check_id(id), Command.SERVO_ID_READ, sent)

    def identify(self, id: int) -> Procedure[Identity]:
        """Only presence can be found out: the protocol has no question for model or firmware."""
        yield from ask(self.ping(id))
        return Identity(None, "", Answers.READS)

    def read(self, target: Target, registers: Sequence[Register[Any]]) -> Procedure[list[int]]:
        """Ask each read command once, however many of the registers stand in its answer."""
        answers: dict[int, bytes] = {}
        for code in dict.fromkeys(_pair(register).read for register in registers):
            answers[code] = yield from ask(_parameters(target.id, code))
        return [register.layout.unpack(answers[_pair(register).read][_bytes(register)]) for register in registers]

    def write(self, target: Target, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Send each command once; parameters that are not given are read first and sent back unchanged."""
        yield from self._write(target, values, save=False)

    def store(self, target: Target, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write; the servo saves by itself, except the offset, which command 18 saves."""
        for register in values:
            if register.area is not Area.EEPROM:
                raise UsageError(f"{register.model} {register.name} is not saved by the servo")
        yield from self._write(target, values, save=True)

    def stance(self, target: Target) -> Procedure[Stance]:
        names = ("present_position", "torque_enable", "min_position", "max_position", "mode")
        rows = [target.model.register(name) for name in names]
        position, torque, low, high, mode = yield from self.read(target, rows)
        return Stance(rows[0].decode(position), bool(torque), low, high, turning=mode == Mode.MOTOR)

    def launch(self, legs: Sequence[Leg]) -> Procedure[None]:
        """Several legs are kept first and start with one broadcast, which starts any older kept move too."""
        give = move_time_write if len(legs) == 1 else move_time_wait_write
        times = [leg.target.model.register("goal_time").encode(leg.duration) for leg in legs]
        for leg, time in zip(legs, times, strict=True):
            yield from ask(give(leg.target.id, leg.goal, time))
        if len(legs) > 1:
            yield from ask(move_start())

    def moving(self, target: Target) -> Procedure[bool]:
        """Compare two positions: no flag tells. Slower than one unit in 50 ms (4.8°/s) counts as rest."""
        row = [target.model.register("present_position")]
        before = yield from self.read(target, row)
        yield Pause(WATCH)
        after = yield from self.read(target, row)
        return before != after

    def stop(self, target: Target) -> Procedure[None]:
        # First what ends a move, then the question that costs time. What command 12 does in motor mode
        # is not said, so there the speed is set to 0.
        yield from ask(move_stop(target.id))
        if (yield from self._mode(target)) == Mode.MOTOR:
            yield from ask(mode_write(target.id, Mode.MOTOR, 0))

    def torque(self, target: Target, on: bool) -> Procedure[None]:
        """Nothing jumps: a servo that is loaded holds the angle at which it is (L-70, assumption)."""
        yield from ask(send(target.id, Command.SERVO_LOAD_OR_UNLOAD_WRITE, int(on)))

    def turn(self, target: Target, *, speed: float | None, output: float | None) -> Procedure[None]:
        """Motor mode: the "speed" of the manual is a duty, nothing measures how fast it turns."""
        if output is None or speed is not None:
            raise cannot(target, "turn at a given speed", "motor mode has no speed control; give output=-1..1")
        duty = round(check_output(output) * FULL_OUTPUT)
        yield from ask(mode_write(target.id, Mode.MOTOR, duty))

    def position_mode(self, target: Target, limits: tuple[int, int] | None) -> Procedure[None]:
        """Motor mode leaves the angle limits alone, so `limits` are written only where they are given."""
        if limits is not None:
            rows = (target.model.register("min_position"), target.model.register("max_position"))
            yield from self.write(target, {row: row.check(raw) for row, raw in zip(rows, limits, strict=True)})
        if (yield from self._mode(target)) == Mode.MOTOR:
            yield from ask(mode_write(target.id, Mode.POSITION))

    def led(self, target: Target, colour: str) -> Procedure[None]:
        if colour not in ("on", "off"):
            raise BadValue(f"{target} has one light: on or off, not {colour!r}")
        led = target.model.register("led")
        yield from self.write(target, {led: led.encode(colour == "on")})

    def reboot(self, target: Target) -> Procedure[None]:
        yield from ()  # a procedure without steps
        raise cannot(target, "be rebooted", "the protocol has no such command; switch its power off and on")

    def reset(self, target: Target, keep: frozenset[str]) -> Procedure[tuple[int, int]]:  # noqa: ARG002
        yield from ()  # a procedure without steps
        why = "the protocol has no such command; restore a backup, or set the registers one by one"
        raise cannot(target, "be reset", why)

    def set_id(self, target: Target, id: int) -> Procedure[None]:
        yield from ask(id_write(target.id, id))

    def set_baud(self, target: Target, baud: int) -> Procedure[None]:
        yield from ()  # a procedure without steps
        raise cannot(target, f"talk at {baud} baud", f"its speed is fixed at {BAUD} (manual 2)")

    def explain(self, packet: Packet, request: Packet | None = None) -> str:  # noqa: ARG002 - the length tells
        try:
            return str(parse_request(packet))
        except ValueError as error:
            problem = f"{error}, id {packet.id}"
        try:
            return str(parse_answer(packet))
        except ValueError:
            return problem

    def _mode(self, target: Target) -> Procedure[int]:
        (mode,) = yield from self.read(target, [target.model.register("mode")])
        return mode

    def _write(self, target: Target, values: Mapping[Register[Any], int], *, save: bool) -> Procedure[None]:
        for command, group in _by_command(values):
            data = yield from self._rest(target, command, group)
            for register, raw in group.items():
                data[_bytes(register)] = register.layout.pack(raw)
            parameters = _values(command, command.params, bytes(data))
            if command in _LIMITS and parameters[0] >= parameters[1]:
                low, high = parameters
                raise BadValue(f"{target}: the lower limit {low} is not below the upper one, {high} (raw)")
            yield from ask(send(target.id, command, *parameters))
            if save and command is Command.SERVO_ANGLE_OFFSET_ADJUST:
                yield from ask(angle_offset_write(target.id))

    def _rest(self, target: Target, command: Command, group: Mapping[Register[Any], int]) -> Procedure[bytearray]:
        """Give the command's parameters as they are in the servo, or zeros where all of them are given."""
        given = {_pair(register).at for register in group}
        if given >= {at for name, _, at in _places(command.params) if name != "null"}:
            return bytearray(_length(command.params))
        old = yield from ask(_parameters(target.id, _pair(next(iter(group))).read))
        return bytearray(old)


def _pair(register: Register[Any]) -> Pair:
    assert isinstance(register.place, Pair)
    return register.place


def _bytes(register: Register[Any]) -> slice:
    """Tell where the register stands among the parameters of its commands."""
    at = _pair(register).at
    return slice(at, at + register.layout.size)


def _parameters(id: int, code: int) -> Exchange[bytes]:
    return _question(id, Command(code), lambda packet: packet.data)


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
