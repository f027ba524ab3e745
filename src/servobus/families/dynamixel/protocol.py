"""Dynamixel protocol 1.0: instruction and status packets, and what one can ask with them.

Source: RX-28 user's manual, chapter 3; errata ED-01 to ED-30 of this project's notes in docs/decisions.md.

    FF FF  id  length  instruction  parameters ...  checksum     length = parameters + 2
    FF FF  id  length  error        parameters ...  checksum     checksum = ~(id + length + ... ) & FF

The two directions have the same frame; only context tells an instruction packet from a status packet.
"""

from collections.abc import Mapping, Sequence
from enum import IntEnum, IntFlag
from typing import TypeAlias, TypeVar

from servobus.core.exchange import Exchange, GroupExchange, ReplyPattern, ack_only
from servobus.core.framing import INCOMPLETE, NOT_A_FRAME, Framing, Packet
from servobus.core.ids import BROADCAST, check_id
from servobus.core.units import BaudDivisor
from servobus.core.values import frozen
from servobus.errors import BadValue, Refused, WrongReply

T = TypeVar("T")

RX_BUFFER = 143
"""Longest packet that fits the servo's receive buffer (manual 3-5-7)."""
CLOCK = 2_000_000
"""Baud = CLOCK / (code + 1) (manual 3-4-1, Baud Rate)."""
BAUD = BaudDivisor(CLOCK)
"""Scale of the Baud Rate register."""


class Code(IntEnum):
    """Instructions (manual 3-2). The RX-28 knows neither of the last two (ED-26), other servos on the line may.

    BULK_READ  MX series (ROBOTIS e-manual, Protocol 1.0)
    SYNC_READ  carried out by adapters such as the USB2AX (its source, AX.h), whose one status packet answers for all
    """

    PING = 0x01
    READ_DATA = 0x02
    WRITE_DATA = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    RESET = 0x06
    SYNC_WRITE = 0x83
    SYNC_READ = 0x84
    BULK_READ = 0x92


SYNC_READ_OF_OTHERS = 0x82
"""SYNC_READ of servos by other makers with the same packets, Feetech's; each servo answers for itself."""


class DriveMode(IntFlag):
    """Bits of Drive Mode, which EX-106+ and MX-106 have (ROBOTIS e-manual, Drive Mode)."""

    REVERSE = 0x01
    """Goals and positions count clockwise; endless turn does not change."""
    SLAVE = 0x02
    """Driven by the output of the other servo of a dual joint, on the sync cable; goals and speeds are ignored."""


class Error(IntFlag):
    """Bits of a status packet's error byte (manual 3-3)."""

    INPUT_VOLTAGE = 0x01
    ANGLE_LIMIT = 0x02
    OVERHEATING = 0x04
    RANGE = 0x08
    CHECKSUM = 0x10
    OVERLOAD = 0x20
    INSTRUCTION = 0x40


ALARMS = Error.INPUT_VOLTAGE | Error.OVERHEATING | Error.OVERLOAD
"""Bits that tell the state of the servo; the others refuse the instruction they answer (ED-25)."""


HEADER_2 = b"\xff\xff\xfd\x00"
"""How every packet of protocol 2.0 begins (ROBOTIS e-manual, Protocol 2.0); in 1.0 the length is never 0."""
PROTOCOL_2 = (
    "Dynamixel protocol 2.0, not understood here; the maker's Dynamixel Wizard can set an MX servo to protocol 1.0"
)


class Dynamixel1Framing(Framing):
    name = "dynamixel"
    header = b"\xff\xff"
    foreign = {HEADER_2: PROTOCOL_2}  # noqa: RUF012 - never changed
    overhead = 6
    max_size = RX_BUFFER
    forget_time = 0.105  # RX-28 manual, appendix, Byte to Byte Time: 100 ms; and a bit
    baud_tolerance = 0.03  # RX-28 manual 3-4-1

    def size(self, buffer: bytes | bytearray, at: int) -> int:
        have = len(buffer) - at
        # No id is FF, so of three FF the last two are the header.
        if have > 2 and buffer[at + 2] == 0xFF:
            return NOT_A_FRAME
        if have < 4:
            return INCOMPLETE
        length = buffer[at + 3]
        return length + 4 if 2 <= length <= RX_BUFFER - 4 else NOT_A_FRAME

    def whole(self, raw: bytes) -> Packet | None:
        """As in `Framing`, in one look: most of what a driver hears is one good status packet."""
        size = len(raw)
        if size < 6 or raw[:2] != b"\xff\xff" or raw[3] != size - 4 or raw[2] == 0xFF or sum(raw) & 0xFF != 0xFD:
            return None
        return Packet(raw[2], raw[4], raw[5:-1])

    def frame(self, packet: Packet) -> bytes:
        size = len(packet.data) + self.overhead
        if size > self.max_size:
            raise BadValue(f"a packet of {size} bytes does not fit the servo's buffer of {self.max_size} bytes")
        body = bytes((packet.id, len(packet.data) + 2, packet.code)) + packet.data
        return self.header + body + bytes((~sum(body) & 0xFF,))

    def unframe(self, raw: bytes) -> tuple[Packet, bool]:
        return Packet(raw[2], raw[4], raw[5:-1]), sum(raw[2:]) & 0xFF == 0xFF


FRAMING = Dynamixel1Framing()


# Instruction packets as values, both ways


@frozen
class Ping:
    id: int


@frozen
class ReadData:
    id: int
    address: int
    length: int


@frozen
class WriteData:
    id: int
    address: int
    data: bytes


@frozen
class RegWrite:
    id: int
    address: int
    data: bytes


@frozen
class Action:
    id: int


@frozen
class Reset:
    id: int


@frozen
class SyncWrite:
    """Each listed servo writes its own data at the common address; `data` keeps the order of the packet."""

    address: int
    length: int
    data: tuple[tuple[int, bytes], ...]
    id: int = BROADCAST


@frozen
class SyncRead:
    """Each listed servo is asked for the same bytes."""

    address: int
    length: int
    ids: tuple[int, ...]
    id: int = BROADCAST


@frozen
class BulkRead:
    """Each servo is asked for bytes of its own, and answers behind the one before it in the list."""

    reads: tuple[ReadData, ...]
    id: int = BROADCAST


@frozen
class Status:
    """A status packet."""

    id: int
    error: Error
    data: bytes = b""


Instruction: TypeAlias = Ping | ReadData | WriteData | RegWrite | Action | Reset | SyncWrite | SyncRead | BulkRead

_SIMPLE: dict[Code, type[Ping | Action | Reset]] = {Code.PING: Ping, Code.ACTION: Action, Code.RESET: Reset}
_WRITES: dict[Code, type[WriteData | RegWrite]] = {Code.WRITE_DATA: WriteData, Code.REG_WRITE: RegWrite}
_CODES: dict[type, Code] = {
    Ping: Code.PING,
    ReadData: Code.READ_DATA,
    WriteData: Code.WRITE_DATA,
    RegWrite: Code.REG_WRITE,
    Action: Code.ACTION,
    Reset: Code.RESET,
    SyncWrite: Code.SYNC_WRITE,
    SyncRead: Code.SYNC_READ,
    BulkRead: Code.BULK_READ,
}


def code_of(message: Instruction) -> Code:
    """Give the instruction code of a message."""
    return _CODES[type(message)]


def encode(message: Instruction | Status) -> bytes:
    """Give the bytes of an instruction or status packet. Raises BadValue if it does not fit a packet."""
    match message:
        case Status(id, error, data):
            return FRAMING.frame(Packet(id, int(error), data))
        case ReadData(_, address, length):
            data = bytes((address, length))
        case WriteData(_, address, written) | RegWrite(_, address, written):
            data = bytes((address,)) + written
        case SyncWrite(address, length, parts):
            if any(len(part) != length for _, part in parts):
                raise BadValue(f"SYNC_WRITE: every servo must be given {length} bytes")
            data = bytes((address, length)) + b"".join(bytes((id,)) + part for id, part in parts)
        case SyncRead(address, length, ids):
            data = bytes((address, length, *ids))
        case BulkRead(reads):
            data = b"\0" + b"".join(bytes((read.length, read.id, read.address)) for read in reads)
        case _:
            data = b""
    return FRAMING.frame(Packet(message.id, _CODES[type(message)], data))


def parse_instruction(packet: Packet) -> Instruction:
    """Read an instruction packet. Raises ValueError for an undefined instruction or a wrong length."""
    data = packet.data
    try:
        code = Code.SYNC_READ if packet.code == SYNC_READ_OF_OTHERS else Code(packet.code)
    except ValueError:
        raise ValueError(f"undefined instruction {packet.code:#04x}") from None
    if code in _SIMPLE and not data:
        return _SIMPLE[code](packet.id)
    if code is Code.READ_DATA and len(data) == 2:
        return ReadData(packet.id, data[0], data[1])
    if code in _WRITES and len(data) >= 2:
        return _WRITES[code](packet.id, data[0], data[1:])
    if code is Code.SYNC_WRITE and len(data) > 2 and data[1]:
        step = data[1] + 1
        if (len(data) - 2) % step == 0:
            parts = tuple((data[i], data[i + 1 : i + step]) for i in range(2, len(data), step))
            return SyncWrite(data[0], data[1], parts, packet.id)
    if code is Code.SYNC_READ and len(data) > 2 and data[1]:
        return SyncRead(data[0], data[1], tuple(data[2:]), packet.id)
    if code is Code.BULK_READ and len(data) > 1 and len(data) % 3 == 1:
        return BulkRead(tuple(ReadData(data[i + 1], data[i + 2], data[i]) for i in range(1, len(data), 3)), packet.id)
    raise ValueError(f"{code.name} with {len(data)} parameter bytes")


def parse_status(packet: Packet) -> Status:
    """Read a status packet."""
    return Status(packet.id, Error(packet.code), packet.data)


# Native operations


_ALARM_BITS = int(ALARMS)
_NONE = Error(0)


def alarms_of(packet: Packet) -> Error:
    """Give the alarm bits of a status packet."""
    bits = packet.code & _ALARM_BITS
    return Error(bits) if bits else _NONE  # making flags costs time, and mostly there are none


def _refusal(what: str, packet: Packet) -> None:
    error = Error(packet.code & ~_ALARM_BITS)
    if error:
        reasons = {
            Error.RANGE: "a value or address is out of range, or the table is locked",
            Error.ANGLE_LIMIT: "the goal is outside the servo's angle limits",
            Error.INSTRUCTION: "it does not know the instruction, or has no registered write",
            Error.CHECKSUM: "the packet reached it with a wrong checksum",
        }
        said = "; ".join(text for flag, text in reasons.items() if flag in error) or f"error {int(error):#04x}"
        raise Refused(f"{what}: refused, {said}", int(error))


def _exchange(what: str, message: Instruction, *, answered: bool, repeatable: bool = False) -> Exchange[None]:
    def interpret(packet: Packet) -> None:
        _refusal(what, packet)

    return Exchange(
        what,
        FRAMING,
        encode(message),
        interpret if answered else ack_only,
        ReplyPattern(message.id, None, (0,)) if answered else None,
        alarms_of,
        LONGEST_DELAY,
        repeatable=repeatable,
    )


LONGEST_DELAY = 254 * 2e-6
"""Return Delay Time at its highest, s (manual 3-4-1)."""


def ping(id: int) -> Exchange[None]:
    """PING: always answered, except to the broadcast id (3-5-5, ED-19). Any answer will do: a servo is there."""
    return _exchange(f"PING id {id}", Ping(id), answered=id != BROADCAST, repeatable=True).mapped(ack_only)


def read_data(id: int, address: int, length: int, *, bulk: bool = False) -> Exchange[bytes]:
    """READ_DATA (3-5-1). Raises Refused if the servo has no such bytes, WrongReply if it gives no reason.

    `bulk` is whether the servo knows BULK_READ, so that this can be asked of several in one request.
    """
    what = f"READ_DATA id {id}, address {address}, {length} bytes"

    def interpret(packet: Packet) -> bytes:
        if len(packet.data) != length:
            _refusal(what, packet)
            raise WrongReply(
                f"{what}: the status packet has {len(packet.data)} bytes of data and refuses nothing, so it answers "
                "something else"
            )
        return packet.data

    reply = ReplyPattern(id, None, (length, 0))
    return Exchange(
        what,
        FRAMING,
        encode(ReadData(id, address, length)),
        interpret,
        reply,
        alarms_of,
        LONGEST_DELAY,
        repeatable=True,
        joins=joined_reads if bulk else None,
    )


def bulk_read(reads: Mapping[int, tuple[int, int]]) -> GroupExchange[bytes]:
    """BULK_READ: of each servo, id -> (address, length), bytes of its own, in one request (e-manual, Bulk Read).

    Its result is a list of what READ_DATA would give of each, or of the BusError that came of it. Servos that do not
    know the instruction stay silent, and so do those listed behind them. Raises BadValue for more than 45 servos.
    """
    return _bulk_read([read_data(check_id(id), address, length) for id, (address, length) in reads.items()])


def _bulk_read(reads: Sequence[Exchange[bytes]]) -> GroupExchange[bytes]:
    asked = tuple(parse_instruction(FRAMING.unframe(read.request)[0]) for read in reads)
    message = BulkRead(tuple(one for one in asked if isinstance(one, ReadData)))
    what = f"BULK_READ ids {', '.join(str(read.id) for read in reads)}"
    return GroupExchange(what, FRAMING, encode(message), reads)


def joined_reads(reads: Sequence[Exchange[bytes]]) -> GroupExchange[bytes]:
    """Ask in one request what the first of these ask, as many as its packet holds."""
    return _bulk_read(reads[: (RX_BUFFER - FRAMING.overhead - 1) // 3])


def write_data(
    id: int, address: int, data: bytes, *, answered: bool = True, repeatable: bool = False
) -> Exchange[None]:
    """WRITE_DATA (3-5-2). `answered` is whether the servo's Status Return Level is 2."""
    what = f"WRITE_DATA id {id}, address {address}, {data.hex(' ').upper()}"
    return _exchange(what, WriteData(id, address, data), answered=answered and id != BROADCAST, repeatable=repeatable)


def reg_write(id: int, address: int, data: bytes, *, answered: bool = True) -> Exchange[None]:
    """REG_WRITE: keep a write until ACTION (3-5-3)."""
    what = f"REG_WRITE id {id}, address {address}, {data.hex(' ').upper()}"
    return _exchange(what, RegWrite(id, address, data), answered=answered and id != BROADCAST)


def action(id: int = BROADCAST, *, answered: bool = True) -> Exchange[None]:
    """ACTION: carry out the kept writes, of all servos by default (3-5-4)."""
    return _exchange(f"ACTION id {id}", Action(id), answered=answered and id != BROADCAST)


def reset(id: int, *, answered: bool = True) -> Exchange[None]:
    """RESET the control table to factory values; the id becomes 1 (3-5-6)."""
    return _exchange(f"RESET id {id}", Reset(id), answered=answered and id != BROADCAST)


def sync_write(address: int, data: Mapping[int, bytes]) -> Exchange[None]:
    """SYNC_WRITE: every servo its own bytes at one address, in one packet, unanswered (3-5-7).

    Raises BadValue for unequal lengths or more servos than fit 143 bytes.
    """
    lengths = {len(part) for part in data.values()}
    if len(lengths) != 1:
        raise BadValue("SYNC_WRITE needs at least one servo, and the same number of bytes for each")
    message = SyncWrite(address, lengths.pop(), tuple((check_id(id), part) for id, part in data.items()))
    return _exchange(f"SYNC_WRITE ids {', '.join(map(str, data))}", message, answered=False)
