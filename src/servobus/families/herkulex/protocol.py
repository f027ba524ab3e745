"""HerkuleX: requests and ACKs, the same for all models, and what one can ask with them.

Source: DRS-0602 user's manual, chapters 4 to 6; errata EH-01 to EH-42 of this project's notes in
docs/decisions.md, behaviours H-1 to H-121 of docs/behaviours.md.

    FF FF  size  id  command         check1  check2  data ...                         size counts every byte
    FF FF  size  id  command + 0x40  check1  check2  data ... status error, status detail

    x = size ^ id ^ command ^ data ...      check1 = x & FE      check2 = ~x & FE

Every servo has two register maps. EEP survives power-off and is copied to RAM when the servo starts; RAM is
what acts. A JOG, the command that moves, sets the lights as well: without colours in it they go out (6-5).
"""

from collections.abc import Callable, Iterable
from enum import IntEnum, IntFlag
from typing import TypeAlias, TypeVar

from servobus.core.exchange import Exchange, ReplyPattern, ack_only
from servobus.core.framing import INCOMPLETE, NOT_A_FRAME, Framing, Packet
from servobus.core.ids import BROADCAST, check_id
from servobus.core.registers import Int
from servobus.core.units import Flags, Lookup, ms
from servobus.core.values import frozen
from servobus.errors import BadValue, Refused

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
LONGEST_BOOT = 4.0
"""Assumption: s after REBOOT within which a servo answers again. The manual gives no figure; programs by other people
wait 0.5, 1 or 2 s."""
BAUD = Lookup({0x10: 115_200, 1: 1_000_000, 0x22: 57_600, 2: 666_666, 3: 500_000, 4: 400_000, 7: 250_000, 9: 200_000})
"""Codes of the Baud Rate register (4-2 NO 5), most likely first."""


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


OTHER_COMMANDS = {0x0A: "MI_JOG", 0x0B: "MS_JOG", 0x0C: "CALSET"}
"""Commands that the maker's PC tool has for the DRS-03xx, which move over several turns and set a zero (EH-39). All
models here answer as to an unknown command."""


class StatusError(IntFlag):
    """Bits of Status Error (4-2 NO 43). Every one stays until 0 is written there (6-3 Example 2)."""

    INPUT_VOLTAGE = 0x01
    POSITION_LIMIT = 0x02
    TEMPERATURE = 0x04
    INVALID_PACKET = 0x08
    OVERLOAD = 0x10
    DRIVER_FAULT = 0x20  # DRS-0101 and 0201 alone set it (EH-22)
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
    name = "herkulex"
    header = b"\xff\xff"
    overhead = 7
    max_size = overhead + MAX_DATA  # EH-01
    forget_time = 0.21  # Packet Garbage Check Period, factory setting 201.6 ms (4-2 NO 35); and a bit
    filler = b"\x00"  # the line is full duplex (2-3), and a packet begins with FF

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


@frozen
class EepWrite:
    id: int
    address: int
    data: bytes


@frozen
class EepRead:
    id: int
    address: int
    length: int


@frozen
class RamWrite:
    id: int
    address: int
    data: bytes


@frozen
class RamRead:
    id: int
    address: int
    length: int


@frozen
class Jog:
    """One servo's part of a JOG.

    id           the servo that obeys; 254 means all (6-6)
    value        goal position, or in infinite turn the speed -16383 .. 16383 in the unit of the model (EH-25)
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


@frozen
class IJog:
    """Every servo listed has its own playtime. Servos obey if `id` is theirs or 254."""

    id: int
    jogs: tuple[Jog, ...]


@frozen
class SJog:
    """All servos listed have one playtime and arrive together."""

    id: int
    playtime: int
    jogs: tuple[Jog, ...]


@frozen
class Stat:
    id: int


@frozen
class Rollback:
    id: int
    keep: Keep = Keep.NOTHING


@frozen
class Reboot:
    id: int


@frozen
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
POSITION_LAYOUT, SPEED_LAYOUT = Int(2, flags=0x8000), Int(2, sign_bit=14, flags=0x8000)
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
            data = bytes((within("address", address, 0, 255), within("length", length, 0, 255)))
        case EepWrite(_, address, written) | RamWrite(_, address, written):
            length = within("length", len(written), 0, MAX_DATA - 2)
            data = bytes((within("address", address, 0, 255), length)) + written
        case IJog(_, jogs):
            within("number of servos in one I_JOG", len(jogs), 1, MOST_I_JOG)
            data = b"".join(_pack_jog(jog) + _pack_playtime(jog.playtime) for jog in jogs)
        case SJog(_, playtime, jogs):
            within("number of servos in one S_JOG", len(jogs), 1, MOST_S_JOG)
            if any(jog.playtime for jog in jogs):
                raise BadValue("S_JOG has one playtime for all servos; I_JOG has one for each")
            data = _pack_playtime(playtime) + b"".join(_pack_jog(jog) for jog in jogs)
        case Rollback(_, keep):
            data = int(keep).to_bytes(2, "little")
        case _:
            data = b""
    return FRAMING.frame(Packet(within("id", message.id, 0, BROADCAST), _CODES[type(message)], data))


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
    return Ack(
        packet.id, _code(packet.code & ~ACK, "ACK of "), packet.data[:-2], StatusError(error), StatusDetail(detail)
    )


def _code(value: int, head: str = "") -> Code:
    try:
        return Code(value)
    except ValueError:
        name = OTHER_COMMANDS.get(value)
        what = f"{head}{name} (command {value:#04x} of the DRS-03xx)" if name else f"unknown command {value:#04x}"
        raise UnknownCommandError(what) from None


def _pack_jog(jog: Jog) -> bytes:
    if jog.mode is ControlMode.POSITION:
        value = POSITION_LAYOUT.pack(within("position", jog.value, 0, 0x7FFF))
    else:
        value = SPEED_LAYOUT.pack(within("speed", jog.value, *SPEED_LAYOUT.range))
    flags = jog.mode * _TURN | jog.stop * _STOP | jog.invalid * _INVALID | jog.no_override * _NO_OVERRIDE
    return value + bytes((flags | jog.led << _LED_SHIFT, within("id", jog.id, 0, BROADCAST)))


def _unpack_jog(data: bytes, playtime: int = 0) -> Jog:
    """Read an entry; the two reserved bits are not looked at (H-78)."""
    flags = data[2]
    mode = ControlMode.INFINITE_TURN if flags & _TURN else ControlMode.POSITION
    return Jog(
        id=data[3],
        value=(SPEED_LAYOUT if mode else POSITION_LAYOUT).unpack(data[:2]),
        mode=mode,
        led=Led(flags >> _LED_SHIFT & 7),
        playtime=playtime,
        stop=bool(flags & _STOP),
        invalid=bool(flags & _INVALID),
        no_override=bool(flags & _NO_OVERRIDE),
    )


def _pack_playtime(value: int) -> bytes:
    return bytes((within("playtime", value, 0, LONGEST_PLAYTIME),))


def within(name: str, value: int, low: int, high: int) -> int:
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
    return _reading(EepRead(check_id(id), address, within("length", length, 1, MAX_DATA - 4)))


def ram_write(id: int, address: int, data: bytes, *, answered: bool = False) -> Exchange[None]:
    """RAM_WRITE: acts at once, until the servo restarts (6-3)."""
    what = f"RAM_WRITE id {id}, address {address}, {data.hex(' ').upper()}"
    return _command(what, RamWrite(id, address, data), answered)


def ram_read(id: int, address: int, length: int) -> Exchange[bytes]:
    """RAM_READ (6-4). Raises Refused if the ACK brings no data."""
    return _reading(RamRead(check_id(id), address, within("length", length, 1, MAX_DATA - 4)))


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
    reply = ReplyPattern(None if id == BROADCAST else id, Code.STAT | ACK, (2,))
    return exchange(f"STAT id {id}", Stat(id), parse_ack, reply)


def rollback(id: int, keep: Keep = Keep.NOTHING, *, answered: bool = False) -> Exchange[None]:
    """ROLLBACK: factory values into EEP; the next start takes them over (6-8)."""
    return _command(f"ROLLBACK id {id}", Rollback(id, keep), answered)


def reboot(id: int, *, answered: bool = False) -> Exchange[None]:
    """REBOOT (6-9). The servo hears nothing for a while afterwards, see LONGEST_BOOT."""
    return _command(f"REBOOT id {id}", Reboot(id), answered)


def exchange(
    what: str,
    message: Request,
    interpret: Callable[[Packet], T],
    reply: ReplyPattern | None,
    *,
    repeatable: bool = True,
) -> Exchange[T]:
    return Exchange(
        what, FRAMING, encode(message), interpret, reply, alarms_of, TURNAROUND if reply else 0.0, repeatable=repeatable
    )


def _command(what: str, message: Request, answered: bool) -> Exchange[None]:
    # A JOG is answered by the servo in its header, not by those in its list (H-89).
    reply = (
        ReplyPattern(message.id, _CODES[type(message)] | ACK, (2,)) if answered and message.id != BROADCAST else None
    )
    return exchange(what, message, ack_only, reply, repeatable=False)


def _reading(message: EepRead | RamRead) -> Exchange[bytes]:
    code, address, length = _CODES[type(message)], message.address, message.length
    what = f"{code.name} id {message.id}, address {address}, {length} bytes"

    def interpret(packet: Packet) -> bytes:
        if len(packet.data) <= 2:
            ack = parse_ack(packet)
            said = f"{show_flags(ack.status_error)}; {show_flags(ack.status_detail)}"
            raise Refused(f"{what}: refused, {said}", ack.status_error)
        return packet.data[2:-2]

    # Address and length come back before the data. A refusal brings the status alone (assumption, EH-33).
    return exchange(
        what, message, interpret, ReplyPattern(message.id, code | ACK, (length + 4, 2), prefix=bytes((address, length)))
    )


_NONE = StatusError(0)


def alarms_of(packet: Packet) -> StatusError:
    """Give the error bits of an ACK."""
    bits = packet.data[-2]
    return StatusError(bits) if bits else _NONE  # making flags costs time, and mostly there are none


def show_flags(flags: IntFlag) -> str:
    return Flags(type(flags)).show(flags)
