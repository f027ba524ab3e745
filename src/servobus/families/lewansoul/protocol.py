"""LewanSoul (later Hiwonder) bus servos: commands and answers, and what one can ask with them.

Source: the protocol document of the maker ("manual"); errata EL-01 to EL-21 of this project's notes in
docs/decisions.md, behaviours L-1 to L-78 of docs/behaviours.md.

    55 55  id  length  command  parameters ...  checksum
    length = parameters + 3                     checksum = ~(id + length + command + parameters) & FF

Only read commands are answered, in the same frame and with the same command; what tells the answer is that
it has parameters and the question has none. There is no error field: a servo that refuses says nothing.
"""

from collections.abc import Callable, Sequence
from enum import IntEnum, IntFlag
from typing import Self, TypeAlias, TypeVar

from servobus.core.exchange import Exchange, ReplyPattern, ack_only
from servobus.core.framing import INCOMPLETE, NOT_A_FRAME, Framing, Packet
from servobus.core.ids import BROADCAST, check_id
from servobus.core.registers import S8, S16, U8, U16, Int
from servobus.core.values import frozen
from servobus.errors import BadValue

T = TypeVar("T")

BAUD = 115_200
"""The only speed (manual 2)."""
TURNAROUND = 0.010
"""s; assumption: the manual gives no figure, drivers in the field wait 20 to 30 ms for a whole answer."""
USUAL = 0.005
"""s; assumption: most answers begin within this time. What is later still counts, but may meet the next question."""
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
    name = "lewansoul"
    header = b"\x55\x55"
    overhead = 6
    max_size = 10
    forget_time = 0.105  # assumption: 100 ms, as Dynamixel servos; and a bit (L-12)

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


@frozen
class Request:
    """What is sent to a servo; `values` in the order of `command.params`."""

    id: int
    command: Command
    values: tuple[int, ...] = ()

    def __str__(self) -> str:
        return _say(self.id, self.command, self.command.params, self.values)


@frozen
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
    return Request(packet.id, command, values_of(command, command.params, packet.data))


def parse_answer(packet: Packet) -> Answer:
    """Read an answer. Raises ValueError for a wrong length or a command that is never answered."""
    command = _command(packet)
    if not command.reply:
        raise ValueError(f"{command.name} is never answered")
    return Answer(packet.id, command, values_of(command, command.reply, packet.data))


def _command(packet: Packet) -> Command:
    try:
        return Command(packet.code)
    except ValueError:
        raise ValueError(f"unknown command {packet.code}") from None


def values_of(command: Command, fields: Fields, data: bytes) -> tuple[int, ...]:
    if len(data) != length_of(fields):
        raise ValueError(f"{command.name} with {len(data)} parameter bytes")
    return tuple(layout.unpack(data[at : at + layout.size]) for _, layout, at in places_of(fields))


def without_surplus(packet: Packet) -> Packet:
    """Give a packet without the parameter bytes that its command does not have (EL-23)."""
    try:
        size = length_of(Command(packet.code).params)
    except ValueError:
        return packet
    return packet if len(packet.data) <= size else Packet(packet.id, packet.code, packet.data[:size], packet.end)


def length_of(fields: Fields) -> int:
    return sum(layout.size for _, layout in fields)


def places_of(fields: Fields) -> list[tuple[str, Int, int]]:
    """Give each field with the byte at which it starts."""
    return [(name, layout, length_of(fields[:n])) for n, (name, layout) in enumerate(fields)]


# Native operations


def send(id: int, command: Command, *values: int) -> Exchange[None]:
    """Send a command that is never answered. Nothing tells whether it arrived."""
    if command.reply:
        raise BadValue(f"{command.name} is a question; its answer must be waited for")
    request = Request(id, command, values)
    raw = encode(request)
    return Exchange(str(request), FRAMING, raw, ack_only)


def query(id: int, command: Command) -> Exchange[tuple[int, ...]]:
    """Send a read command; the result is the values of the answer, in the order of `command.reply`."""
    return question(id, command, lambda packet: parse_answer(packet).values)


def question(id: int, command: Command, interpret: Callable[[Packet], T]) -> Exchange[T]:
    if not command.reply:
        raise BadValue(f"{command.name} is never answered")
    if id == BROADCAST and command is not Command.SERVO_ID_READ:
        raise BadValue(f"{command.name} to id {BROADCAST} is never answered (manual 3)")
    request = Request(id, command)
    reply = ReplyPattern(None if id == BROADCAST else id, int(command), (length_of(command.reply),))
    return Exchange(
        str(request), FRAMING, encode(request), interpret, reply,
        max_delay=TURNAROUND, typical_delay=USUAL, repeatable=True,
    )  # fmt: skip


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
    return question(id, Command.SERVO_ID_READ, lambda packet: parse_answer(packet).values[0])


def angle_offset_adjust(id: int, offset: int) -> Exchange[None]:
    """Shift the zero by -125 .. 125 units until power-off; the servo turns at once (point 9)."""
    return send(id, Command.SERVO_ANGLE_OFFSET_ADJUST, offset)


def angle_offset_write(id: int) -> Exchange[None]:
    """Save the offset in use (point 10)."""
    return send(id, Command.SERVO_ANGLE_OFFSET_WRITE)


def mode_write(id: int, mode: Mode, speed: int = 0) -> Exchange[None]:
    """Choose position or motor mode; `speed` -1000 .. 1000 counts in motor mode only (point 21)."""
    return send(id, Command.SERVO_OR_MOTOR_MODE_WRITE, mode, 0, speed)
