"""HerkuleX: requests and ACKs of the DRS-0602, and what one can ask with them.

Source: DRS-0602 user's manual, chapters 4 to 6; errata EH-01 to EH-42 of this project's notes in
docs/decisions.md, behaviours H-1 to H-121 of its conformance tests.

    FF FF  size  id  command         check1  check2  data ...                         size counts every byte
    FF FF  size  id  command + 0x40  check1  check2  data ... status error, status detail

    x = size ^ id ^ command ^ data ...      check1 = x & FE      check2 = ~x & FE

Every servo has two register maps. EEP survives power-off and is copied to RAM when the servo starts; RAM is
what acts. A JOG, the command that moves, sets the lights as well: without colours in it they go out (6-5).
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Any, TypeAlias, TypeVar

from servobus.errors import BadValue, NoReply, Refused, UsageError, WrongReply
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
    blocks,
    cannot,
    check_id,
)
from servobus.registers import Area, Eep, EepRam, Int, Ram, Register
from servobus.units import Flags, Quantity, Table, deg, ms, show

T = TypeVar("T")

TICK = 11.2 * ms
"""Unit of playtimes and of most periods in the register map (4-2, 6-5)."""
LONGEST_PLAYTIME = 254
MOST_I_JOG, MOST_S_JOG = 43, 53
"""Servos that one packet can move (5-1)."""
MAX_DATA = 216
ACK = 0x40
"""Bit that makes a request's command the command of its ACK (5-2)."""
ACK_POLICY = 1
"""RAM address of ACK Policy (4-2 NO 8; EH-12)."""
TURNAROUND = 5 * ms
"""Assumption: the manual gives no figure; users of real servos report 2 to 3 ms per request."""
EEP_TIME = 50 * ms
"""Assumption: time that writing the EEPROM takes; a restart before its end might cut it short."""
BOOT_TIME = 0.5
"""Assumption: s for which a servo is deaf after REBOOT. Users report that it needs a delay, not how long."""
BAUD = Table({0x10: 115_200, 1: 1_000_000, 0x22: 57_600, 2: 666_666, 3: 500_000, 4: 400_000, 7: 250_000, 9: 200_000})
"""Codes of the Baud Rate register (4-2 NO 5), most likely first."""
JOG_SPEED = Quantity("rad/s", 0.62 * deg)
"""Speed in infinite turn (6-5)."""


class Code(IntEnum):
    """Commands (5-1)."""

    EEP_WRITE = 0x01
    EEP_READ = 0x02
    RAM_WRITE = 0x03
    RAM_READ = 0x04
    I_JOG = 0x05
    S_JOG = 0x06
    STAT = 0x07
    ROLLBACK = 0x08
    REBOOT = 0x09


class StatusError(IntFlag):
    """Bits of Status Error (4-2 NO 43). Every one stays until 0 is written there (6-3 Example 2)."""

    INPUT_VOLTAGE = 0x01
    POSITION_LIMIT = 0x02
    TEMPERATURE = 0x04
    INVALID_PACKET = 0x08
    OVERLOAD = 0x10
    DRIVER_FAULT = 0x20  # never set on the DRS-0602 (EH-22)
    EEP_DISTORTED = 0x40


class StatusDetail(IntFlag):
    """Bits of Status Detail (4-2 NO 44): the servo's state, and what was wrong with an invalid packet."""

    MOVING = 0x01
    INPOSITION = 0x02
    CHECKSUM_ERROR = 0x04
    UNKNOWN_COMMAND = 0x08
    EXCEED_REG_RANGE = 0x10
    GARBAGE = 0x20
    TORQUE_ON = 0x40


class TorqueControl(IntEnum):
    """States of the motor (4-2 NO 47)."""

    FREE = 0x00
    BRAKE = 0x40
    ON = 0x60


class Led(IntFlag):
    """Lights (4-2 NO 48; EH-04: 0x04 is red)."""

    OFF = 0x00
    GREEN = 0x01
    BLUE = 0x02
    RED = 0x04


class ControlMode(IntEnum):
    """What the servo controls (4-2 NO 51); only a JOG changes it."""

    POSITION = 0
    INFINITE_TURN = 1


class Aux(IntEnum):
    """What Absolute Position is set to through Aux 1 (4-2 NO 45)."""

    NOTHING = 0
    POTENTIOMETER = 1
    RAW_0 = 2
    MINUS_180 = 3
    CENTRE = 4
    PLUS_180 = 5
    RAW_32767 = 6


class Keep(IntFlag):
    """What ROLLBACK leaves alone: Skip Option 1 in the low byte, Skip Option 2 in the high one (6-8)."""

    NOTHING = 0x0000
    ID = 0x0001
    CALIBRATION = 0x0010
    BAUD = 0x0100


class HerkulexFraming(Framing):
    header = b"\xff\xff"
    overhead = 7
    max_size = overhead + MAX_DATA  # EH-01

    def size(self, buffer: bytes | bytearray, at: int) -> int:
        if len(buffer) - at < 3:
            return INCOMPLETE
        # A third FF is no size either: of many FF the last two before a size are the header (H-10).
        size = buffer[at + 2]
        return size if self.overhead <= size <= self.max_size else NOT_A_FRAME

    def frame(self, packet: Packet) -> bytes:
        size = len(packet.data) + self.overhead
        if size > self.max_size:
            raise BadValue(f"a packet of {size} bytes is too long: at most {self.max_size}")
        head, check = bytes((size, packet.id, packet.code)), self._checksums(size, packet)
        return self.header + head + check + packet.data

    def unframe(self, raw: bytes) -> tuple[Packet, bool]:
        packet = Packet(raw[3], raw[4], raw[7:])
        return packet, raw[5:7] == self._checksums(raw[2], packet)

    @staticmethod
    def _checksums(size: int, packet: Packet) -> bytes:
        xor = size ^ packet.id ^ packet.code
        for byte in packet.data:
            xor ^= byte
        return bytes((xor & 0xFE, ~xor & 0xFE))


FRAMING = HerkulexFraming()


# Requests and ACKs as values, both ways


@dataclass(frozen=True, slots=True)
class EepWrite:
    id: int
    address: int
    data: bytes


@dataclass(frozen=True, slots=True)
class EepRead:
    id: int
    address: int
    length: int


@dataclass(frozen=True, slots=True)
class RamWrite:
    id: int
    address: int
    data: bytes


@dataclass(frozen=True, slots=True)
class RamRead:
    id: int
    address: int
    length: int


@dataclass(frozen=True, slots=True)
class Jog:
    """One servo's part of a JOG.

    id           the servo that obeys; 254 means all (6-6)
    value        goal position 0 .. 32767, or in infinite turn the speed -16383 .. 16383 in 0.62°/s (EH-25)
    playtime     duration in units of 11.2 ms; only in I_JOG, S_JOG has one for all
    stop         end the motion
    invalid      do nothing
    no_override  start from speed 0 even if a motion is under way
    """

    id: int
    value: int
    mode: ControlMode = ControlMode.POSITION
    led: Led = Led.OFF
    playtime: int = 0
    stop: bool = False
    invalid: bool = False
    no_override: bool = False


@dataclass(frozen=True, slots=True)
class IJog:
    """Every servo listed has its own playtime. Servos obey if `id` is theirs or 254."""

    id: int
    jogs: tuple[Jog, ...]


@dataclass(frozen=True, slots=True)
class SJog:
    """All servos listed have one playtime and arrive together."""

    id: int
    playtime: int
    jogs: tuple[Jog, ...]


@dataclass(frozen=True, slots=True)
class Stat:
    id: int


@dataclass(frozen=True, slots=True)
class Rollback:
    id: int
    keep: Keep = Keep.NOTHING


@dataclass(frozen=True, slots=True)
class Reboot:
    id: int


@dataclass(frozen=True, slots=True)
class Ack:
    """An answer; `code` is the command of its request, `data` what stands before the two status bytes."""

    id: int
    code: Code
    data: bytes
    status_error: StatusError
    status_detail: StatusDetail


Request: TypeAlias = EepWrite | EepRead | RamWrite | RamRead | IJog | SJog | Stat | Rollback | Reboot

_CODES: dict[type, Code] = {
    EepWrite: Code.EEP_WRITE,
    EepRead: Code.EEP_READ,
    RamWrite: Code.RAM_WRITE,
    RamRead: Code.RAM_READ,
    IJog: Code.I_JOG,
    SJog: Code.S_JOG,
    Stat: Code.STAT,
    Rollback: Code.ROLLBACK,
    Reboot: Code.REBOOT,
}
_POSITION, _SPEED = Int(2), Int(2, sign_bit=14)
_STOP, _TURN, _INVALID, _NO_OVERRIDE, _LED_SHIFT = 0x01, 0x02, 0x20, 0x40, 2
"""Bits of SET (6-6)."""


class UnknownCommandError(ValueError):
    """A request whose command this family does not have."""


class WrongLengthError(ValueError):
    """A request whose data does not have the length its command needs."""


def encode(message: Request | Ack) -> bytes:
    """Give the bytes of a request or ACK. Raises BadValue for what does not fit a packet."""
    match message:
        case Ack(id, code, data, error, detail):
            return FRAMING.frame(Packet(id, code | ACK, data + bytes((error, detail))))
        case EepRead(_, address, length) | RamRead(_, address, length):
            data = bytes((_within("address", address, 0, 255), _within("length", length, 0, 255)))
        case EepWrite(_, address, written) | RamWrite(_, address, written):
            length = _within("length", len(written), 0, MAX_DATA - 2)
            data = bytes((_within("address", address, 0, 255), length)) + written
        case IJog(_, jogs):
            _within("number of servos in one I_JOG", len(jogs), 1, MOST_I_JOG)
            data = b"".join(_pack_jog(jog) + _pack_playtime(jog.playtime) for jog in jogs)
        case SJog(_, playtime, jogs):
            _within("number of servos in one S_JOG", len(jogs), 1, MOST_S_JOG)
            if any(jog.playtime for jog in jogs):
                raise BadValue("S_JOG has one playtime for all servos; I_JOG has one for each")
            data = _pack_playtime(playtime) + b"".join(_pack_jog(jog) for jog in jogs)
        case Rollback(_, keep):
            data = int(keep).to_bytes(2, "little")
        case _:
            data = b""
    return FRAMING.frame(Packet(_within("id", message.id, 0, BROADCAST), _CODES[type(message)], data))


def parse_request(packet: Packet) -> Request:
    """Read a request. Raises UnknownCommandError or WrongLengthError, both ValueError."""
    id, code, data = packet.id, _code(packet.code), packet.data
    match code:
        case Code.EEP_WRITE | Code.RAM_WRITE if len(data) >= 2 and len(data) == data[1] + 2:
            return (EepWrite if code is Code.EEP_WRITE else RamWrite)(id, data[0], data[2:])
        case Code.EEP_READ | Code.RAM_READ if len(data) == 2:
            return (EepRead if code is Code.EEP_READ else RamRead)(id, data[0], data[1])
        case Code.I_JOG if data and len(data) % 5 == 0:
            return IJog(id, tuple(_unpack_jog(data[i : i + 4], data[i + 4]) for i in range(0, len(data), 5)))
        case Code.S_JOG if len(data) > 1 and len(data) % 4 == 1:
            return SJog(id, data[0], tuple(_unpack_jog(data[i : i + 4]) for i in range(1, len(data), 4)))
        case Code.ROLLBACK if len(data) == 2:
            return Rollback(id, Keep(int.from_bytes(data, "little")))
        case Code.STAT | Code.REBOOT if not data:
            return (Stat if code is Code.STAT else Reboot)(id)
    raise WrongLengthError(f"{code.name} with {len(data)} data bytes")


def parse_ack(packet: Packet) -> Ack:
    """Read an ACK. Raises ValueError if the packet is none."""
    if not packet.code & ACK or len(packet.data) < 2:
        raise ValueError(f"command {packet.code:#04x} with {len(packet.data)} data bytes is no ACK")
    error, detail = packet.data[-2:]
    return Ack(packet.id, _code(packet.code & ~ACK), packet.data[:-2], StatusError(error), StatusDetail(detail))


def _code(value: int) -> Code:
    try:
        return Code(value)
    except ValueError:
        raise UnknownCommandError(f"unknown command {value:#04x}") from None


def _pack_jog(jog: Jog) -> bytes:
    if jog.mode is ControlMode.POSITION:
        value = _POSITION.pack(_within("position", jog.value, 0, 0x7FFF))
    else:
        value = _SPEED.pack(_within("speed", jog.value, *_SPEED.range))
    flags = jog.mode * _TURN | jog.stop * _STOP | jog.invalid * _INVALID | jog.no_override * _NO_OVERRIDE
    return value + bytes((flags | jog.led << _LED_SHIFT, _within("id", jog.id, 0, BROADCAST)))


def _unpack_jog(data: bytes, playtime: int = 0) -> Jog:
    """Read an entry; the two reserved bits are not looked at (H-78)."""
    flags = data[2]
    mode = ControlMode.INFINITE_TURN if flags & _TURN else ControlMode.POSITION
    return Jog(
        id=data[3],
        value=_SPEED.unpack(data[:2]) if mode else _POSITION.unpack(data[:2]) & 0x7FFF,
        mode=mode,
        led=Led(flags >> _LED_SHIFT & 7),
        playtime=playtime,
        stop=bool(flags & _STOP),
        invalid=bool(flags & _INVALID),
        no_override=bool(flags & _NO_OVERRIDE),
    )


def _pack_playtime(value: int) -> bytes:
    return bytes((_within("playtime", value, 0, LONGEST_PLAYTIME),))


def _within(name: str, value: int, low: int, high: int) -> int:
    if not low <= value <= high:
        raise BadValue(f"{name} {value} is not in {low} .. {high}")
    return value


# Native operations
#
# `answered` is whether the servo's ACK Policy is 2. It is 1 in a new servo: only reads and STAT are answered.
# Errors in an ACK are alarms, not refusals: INVALID_PACKET stays long after the packet that caused it (H-19).


def eep_write(id: int, address: int, data: bytes, *, answered: bool = False) -> Exchange[None]:
    """EEP_WRITE: keeps, and acts from the next start on (6-2)."""
    what = f"EEP_WRITE id {id}, address {address}, {data.hex(' ').upper()}"
    return _command(what, EepWrite(id, address, data), answered)


def eep_read(id: int, address: int, length: int) -> Exchange[bytes]:
    """EEP_READ (6-1). Raises Refused if the ACK brings no data."""
    return _reading(EepRead(check_id(id), address, _within("length", length, 1, MAX_DATA - 4)))


def ram_write(id: int, address: int, data: bytes, *, answered: bool = False) -> Exchange[None]:
    """RAM_WRITE: acts at once, until the servo restarts (6-3)."""
    what = f"RAM_WRITE id {id}, address {address}, {data.hex(' ').upper()}"
    return _command(what, RamWrite(id, address, data), answered)


def ram_read(id: int, address: int, length: int) -> Exchange[bytes]:
    """RAM_READ (6-4). Raises Refused if the ACK brings no data."""
    return _reading(RamRead(check_id(id), address, _within("length", length, 1, MAX_DATA - 4)))


def i_jog(id: int, jogs: Iterable[Jog], *, answered: bool = False) -> Exchange[None]:
    """I_JOG: move up to 43 servos, each in its own time (6-5). `id` is 254 if they are several."""
    message = IJog(id, tuple(jogs))
    return _command(f"I_JOG ids {', '.join(str(jog.id) for jog in message.jogs)}", message, answered)


def s_jog(id: int, playtime: int, jogs: Iterable[Jog], *, answered: bool = False) -> Exchange[None]:
    """S_JOG: move up to 53 servos in one time (6-6). `id` is 254 if they are several."""
    message = SJog(id, playtime, tuple(jogs))
    return _command(f"S_JOG ids {', '.join(str(jog.id) for jog in message.jogs)}", message, answered)


def stat(id: int) -> Exchange[Ack]:
    """STAT: the two status bytes, answered under every ACK Policy and to id 254 too (6-7, 4-2 NO 8)."""
    reply = Reply(None if id == BROADCAST else id, Code.STAT | ACK, (2,))
    return _exchange(f"STAT id {id}", Stat(id), parse_ack, reply)


def rollback(id: int, keep: Keep = Keep.NOTHING, *, answered: bool = False) -> Exchange[None]:
    """ROLLBACK: factory values into EEP; the next start takes them over (6-8)."""
    return _command(f"ROLLBACK id {id}", Rollback(id, keep), answered, repeatable=False)


def reboot(id: int, *, answered: bool = False) -> Exchange[None]:
    """REBOOT (6-9). The servo hears nothing for BOOT_TIME afterwards."""
    return _command(f"REBOOT id {id}", Reboot(id), answered, repeatable=False)


def _exchange(
    what: str, message: Request, interpret: Callable[[Packet], T], reply: Reply | None, *, repeatable: bool = True
) -> Exchange[T]:
    return Exchange(
        what, FRAMING, encode(message), interpret, reply, _alarms, TURNAROUND if reply else 0.0, repeatable=repeatable
    )


def _command(what: str, message: Request, answered: bool, *, repeatable: bool = True) -> Exchange[None]:
    # A JOG is answered by the servo in its header, not by those in its list (H-89).
    reply = Reply(message.id, _CODES[type(message)] | ACK, (2,)) if answered and message.id != BROADCAST else None
    return _exchange(what, message, sent, reply, repeatable=repeatable)


def _reading(message: EepRead | RamRead) -> Exchange[bytes]:
    code, address, length = _CODES[type(message)], message.address, message.length
    what = f"{code.name} id {message.id}, address {address}, {length} bytes"

    def interpret(packet: Packet) -> bytes:
        ack = parse_ack(packet)
        if not ack.data:
            said = f"{_show(ack.status_error)}; {_show(ack.status_detail)}"
            raise Refused(f"{what}: refused, {said}", ack.status_error)
        if ack.data[:2] != bytes((address, length)):
            raise WrongReply(f"{what}: {ack.data[1]} bytes from address {ack.data[0]} came back", packet.data)
        return ack.data[2:]

    # Address and length come back before the data. A refusal brings the status alone (assumption, EH-33).
    return _exchange(what, message, interpret, Reply(message.id, code | ACK, (length + 4, 2)))


def _alarms(packet: Packet) -> StatusError:
    return StatusError(packet.data[-2])


def _show(flags: IntFlag) -> str:
    return Flags(type(flags)).show(flags)


# The shared verbs

_COLOURS = {
    "off": Led.OFF, "on": Led.GREEN | Led.BLUE | Led.RED, "white": Led.GREEN | Led.BLUE | Led.RED,
    "green": Led.GREEN, "blue": Led.BLUE, "red": Led.RED,
    "cyan": Led.GREEN | Led.BLUE, "magenta": Led.BLUE | Led.RED, "yellow": Led.GREEN | Led.RED,
}  # fmt: skip
_KEEPS = {"id": Keep.ID, "baud": Keep.BAUD, "calibration": Keep.CALIBRATION}
_TURN_PLAYTIME = 60
"""Playtime in the manual's example of infinite turn (6-5); what it does there is not said (EH-40)."""


class Herkulex(Family):
    name = "herkulex"
    title = "HerkuleX"
    framing = FRAMING
    default_baud = 115_200
    bauds = tuple(BAUD.codes.values())
    full_duplex = True
    max_move_time = LONGEST_PLAYTIME * TICK

    def ping(self, id: int) -> Exchange[None]:
        """STAT: the one request that is always answered."""
        return _exchange(f"STAT id {id}", Stat(check_id(id)), sent, Reply(id, Code.STAT | ACK, (2,)))

    def identify(self, id: int) -> Procedure[Identity]:
        """Read model, version and ACK Policy; a servo with policy 0 answers STAT alone (H-25)."""
        try:
            model = yield from ask(eep_read(id, 0, 4))
            policy = yield from ask(ram_read(id, ACK_POLICY, 1))
        except NoReply:
            yield from ask(stat(id))
            return Identity(None, "", Answers.NOTHING)
        # Version bytes 00 90 read as "0.90": an assumption, the manual does not say how they are written.
        return Identity(model[0] << 8 | model[1], f"{model[2]:x}.{model[3]:02x}", Answers(min(policy[0], 2)))

    def read(self, target: Target, registers: Sequence[Register[Any]]) -> Procedure[list[int]]:
        """Read from RAM what RAM has, the rest from EEP."""
        return (yield from _fetch(target, registers, [_acting(row) for row in registers]))

    def read_stored(self, target: Target, registers: Sequence[Register[Any]]) -> Procedure[list[int]]:
        """Read from EEP what EEP has, the rest from RAM."""
        return (yield from _fetch(target, registers, [_kept(row) or _acting(row) for row in registers]))

    def write(self, target: Target, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write to RAM what RAM has, the rest to EEP, where it acts after the next start."""
        yield from _send(target, [(_acting(row), row.layout.pack(raw)) for row, raw in values.items()])

    def store(self, target: Target, values: Mapping[Register[Any], int]) -> Procedure[None]:
        """Write to EEP, and to RAM what RAM has too: it acts now and survives power-off.

        What RAM does not have (Baud Rate) acts after the next start.
        """
        parts = []
        for row, raw in values.items():
            kept = _kept(row)
            if kept is None:
                raise UsageError(f"{row.model} {row.name} lives in RAM and is lost at power-off")
            parts += [(spot, row.layout.pack(raw)) for spot in (kept, _acting(row))]
        yield from _send(target, parts)

    def stance(self, target: Target) -> Procedure[Stance]:
        names = ("calibrated_position", "torque_control", "min_position", "max_position", "current_control_mode")
        rows = [target.model.register(name) for name in names]
        position, torque, low, high, mode = yield from self.read(target, rows)
        on = torque == TorqueControl.ON
        return Stance(rows[0].decode(position), on, low, high, turning=mode == ControlMode.INFINITE_TURN)

    def launch(self, legs: Sequence[Leg]) -> Procedure[None]:
        """I_JOG for one servo; for several S_JOG if they take equally long, else I_JOG. The lights go out."""
        playtimes = [_playtime(leg) for leg in legs]
        if len(legs) == 1:
            yield from _jog(legs[0].target, Jog(legs[0].target.id, legs[0].goal, playtime=playtimes[0]))
        elif len(set(playtimes)) == 1:
            jogs = [Jog(leg.target.id, leg.goal) for leg in legs]
            for i in range(0, len(jogs), MOST_S_JOG):
                yield from ask(s_jog(BROADCAST, playtimes[0], jogs[i : i + MOST_S_JOG]))
        else:
            jogs = [Jog(leg.target.id, leg.goal, playtime=time) for leg, time in zip(legs, playtimes, strict=True)]
            for i in range(0, len(jogs), MOST_I_JOG):
                yield from ask(i_jog(BROADCAST, jogs[i : i + MOST_I_JOG]))

    def moving(self, target: Target) -> Procedure[bool]:
        ack = yield from ask(stat(target.id))
        return StatusDetail.MOVING in ack.status_detail

    def stop(self, target: Target) -> Procedure[None]:
        """Send a JOG with the stop flag; beside it speed 0 or the present position, in case they count (H-82)."""
        stance = yield from self.stance(target)
        if stance.turning:
            yield from _jog(target, Jog(target.id, 0, ControlMode.INFINITE_TURN, stop=True))
        else:
            yield from _jog(target, Jog(target.id, _nearest(target, stance), stop=True))

    def torque(self, target: Target, on: bool) -> Procedure[None]:
        """Switch torque. The servo itself takes the present position as its goal (H-51).

        Raises Refused if the torque stays off: while an error of its Torque Policy stands the servo does not
        switch it on (H-53), and does not say so.
        """
        state = TorqueControl.ON if on else TorqueControl.FREE
        yield from self.write(target, {target.model.register("torque_control"): state})
        if on:
            ack = yield from ask(stat(target.id))
            if ack.status_error and StatusDetail.TORQUE_ON not in ack.status_detail:
                why = f"because of {_show(ack.status_error)}; write 0 to status_error first"
                raise Refused(f"{target}: torque stays off {why}", ack.status_error)

    def turn(self, target: Target, *, speed: float | None, output: float | None) -> Procedure[None]:
        """Infinite turn, with controlled speed. Asked for more than it reaches, it obeys late (6-5)."""
        if speed is None or output is not None:
            raise cannot(target, "turn at a share of full output", "it controls its speed; give speed in rad/s")
        fastest = JOG_SPEED.decode(_SPEED.range[1])
        if not abs(speed) <= fastest:  # so that NaN is refused too
            raise BadValue(f"{target}: speed {show(speed, 'rad/s')} is beyond {show(fastest, 'rad/s')}")
        raw = JOG_SPEED.encode(speed)
        yield from _jog(target, Jog(target.id, raw, ControlMode.INFINITE_TURN, playtime=_TURN_PLAYTIME))

    def position_mode(self, target: Target, limits: tuple[int, int] | None) -> Procedure[None]:
        if limits is not None:
            low, high = (target.model.register(name) for name in ("min_position", "max_position"))
            yield from self.write(target, {low: limits[0], high: limits[1]})
        stance = yield from self.stance(target)
        if not stance.turning:
            return
        goal = _nearest(target, stance)
        # Outside its limits the servo would run to the nearest one (H-66). But without torque a JOG changes
        # nothing except the mode (EH-16), and torque on holds whatever position it finds (H-51).
        free = stance.torque and goal != _raw_position(target, stance)
        if free:
            yield from self.torque(target, on=False)
        yield from _jog(target, Jog(target.id, goal))
        if free:
            yield from self.torque(target, on=True)

    def led(self, target: Target, colour: str) -> Procedure[None]:
        if colour not in _COLOURS:
            raise BadValue(f"{target} has no light {colour!r}, only {', '.join(_COLOURS)}")
        yield from self.write(target, {target.model.register("led_control"): _COLOURS[colour]})

    def reboot(self, target: Target) -> Procedure[None]:
        yield from ask(reboot(target.id, answered=_answers(target)))
        yield Pause(BOOT_TIME)

    def reset(self, target: Target, keep: frozenset[str]) -> Procedure[tuple[int, int]]:
        if unknown := keep - _KEEPS.keys():
            raise cannot(target, f"keep {', '.join(sorted(unknown))}", f"ROLLBACK can keep {', '.join(_KEEPS)}")
        id, baud = (target.model.register(name) for name in ("id", "baud_rate"))
        new_id, code = id.default, baud.default
        if "id" in keep:
            (new_id,) = yield from self.read_stored(target, [id])
        if "baud" in keep:
            (code,) = yield from self.read_stored(target, [baud])
        assert new_id is not None
        assert code is not None
        kept = Keep(sum(_KEEPS[name] for name in keep))
        yield from ask(rollback(target.id, kept, answered=_answers(target)))
        yield Pause(EEP_TIME)
        yield from self.reboot(target)
        return new_id, baud.decode(code)

    def set_id(self, target: Target, id: int) -> Procedure[None]:
        """Write EEP, then RAM, both under the old id: it changes with the second write (H-36).

        If that one is lost the servo goes on under its old id until it restarts, and all can be done again.
        """
        yield from self.store(target, {target.model.register("id"): check_id(id)})

    def set_baud(self, target: Target, baud: int) -> Procedure[None]:
        """Write EEP and restart: Baud Rate acts only then (H-37)."""
        register = target.model.register("baud_rate")
        yield from self.store(target, {register: register.encode(baud)})
        yield Pause(EEP_TIME)
        yield from self.reboot(target)

    def explain(self, packet: Packet, request: Packet | None = None) -> str:  # noqa: ARG002 - the code tells ACKs
        try:
            return str(parse_ack(packet) if packet.code & ACK else parse_request(packet))
        except ValueError as error:
            return str(error)


_Spot: TypeAlias = tuple[Area, int]
"""An address in one of the two maps."""


def _acting(register: Register[Any]) -> _Spot:
    """Tell where a register acts: in RAM if RAM has it, else in EEP."""
    match register.place:
        case Ram(address) | EepRam(ram=address):
            return Area.RAM, address
        case Eep(address):
            return Area.EEPROM, address
    raise TypeError(f"{register} has no HerkuleX place")


def _kept(register: Register[Any]) -> _Spot | None:
    """Tell where a register survives power-off, if it does."""
    place = register.place
    return (Area.EEPROM, place.eep) if isinstance(place, Eep | EepRam) else None


def _fetch(target: Target, registers: Sequence[Register[Any]], spots: Sequence[_Spot]) -> Procedure[list[int]]:
    """Read registers from the spots given, in few exchanges."""
    if target.answers is Answers.NOTHING:
        raise cannot(target, "be read", "its ACK Policy is 0; write ack_policy first")
    wanted = list(zip(registers, spots, strict=True))
    image: dict[_Spot, int] = {}
    for area, reading in ((Area.RAM, ram_read), (Area.EEPROM, eep_read)):
        spans = [(address, row.layout.size) for row, (home, address) in wanted if home is area]
        # A second exchange costs 20 bytes, request and frame of the ACK: rather bridge a gap of that size.
        for start, size in blocks(spans, gap=20, longest=MAX_DATA - 4):
            data = yield from ask(reading(target.id, start, size))
            image.update(((area, address), byte) for address, byte in enumerate(data, start))
    return [
        row.layout.unpack(bytes(image[area, address + i] for i in range(row.layout.size)))
        for row, (area, address) in wanted
    ]


def _send(target: Target, parts: Iterable[tuple[_Spot, bytes]]) -> Procedure[None]:
    """Write to EEP, then to RAM from the top down.

    So ID and ACK Policy, RAM 0 and 1, come last: what followed them would have to go by the new ones.
    """
    maps: dict[Area, dict[int, bytes]] = {Area.EEPROM: {}, Area.RAM: {}}
    for (area, address), data in parts:
        maps[area][address] = data
    for address, data in _runs(maps[Area.EEPROM]):
        yield from ask(eep_write(target.id, address, data, answered=_answers(target)))
    for address, data in reversed(_runs(maps[Area.RAM])):
        new_policy = address <= ACK_POLICY < address + len(data)
        yield from ask(ram_write(target.id, address, data, answered=_answers(target) and not new_policy))
        if new_policy:
            # Whether the old or the new policy rules the ACK is an assumption (H-30): let one pass unheard.
            yield Pause(2 * TURNAROUND)


def _runs(parts: Mapping[int, bytes]) -> list[tuple[int, bytes]]:
    """Join what touches into one write each."""
    runs: list[tuple[int, bytes]] = []
    for address, data in sorted(parts.items()):
        if runs and runs[-1][0] + len(runs[-1][1]) == address:
            runs[-1] = (runs[-1][0], runs[-1][1] + data)
        else:
            runs.append((address, data))
    return runs


def _answers(target: Target) -> bool:
    return target.answers is Answers.EVERYTHING


def _jog(target: Target, jog: Jog) -> Procedure[None]:
    yield from ask(i_jog(target.id, [jog], answered=_answers(target)))


def _playtime(leg: Leg) -> int:
    """Give a leg's playtime, rounded up: a little slower rather than faster than asked."""
    playtime = math.ceil(leg.duration / TICK - 1e-6)  # less what the division may have added
    if playtime > LONGEST_PLAYTIME:
        longest = show(LONGEST_PLAYTIME * TICK, "s")
        raise BadValue(f"{leg.target}: a move of {show(leg.duration, 's')} is longer than {longest}")
    return max(playtime, 1)  # 0 would mean as fast as it can (H-85)


def _raw_position(target: Target, stance: Stance) -> int:
    return target.model.register("calibrated_position").scale.encode(stance.position)


def _nearest(target: Target, stance: Stance) -> int:
    """Give the goal nearest to where the servo is: the very place, if it is within its limits."""
    return min(max(_raw_position(target, stance), stance.low), stance.high)
