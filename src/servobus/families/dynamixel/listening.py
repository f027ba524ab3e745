"""Dynamixel protocol 1.0 for those who listen: what a packet says, whom it concerns, which replies it asks for.

Packets and their sources: servobus.families.dynamixel.protocol.
"""

from collections.abc import Sequence

from servobus.core.effect import Effect, Kind, Touch
from servobus.core.exchange import ReplyPattern
from servobus.core.framing import Packet
from servobus.core.ids import BROADCAST
from servobus.core.units import Flags
from servobus.families.dynamixel.places import TABLE
from servobus.families.dynamixel.protocol import (
    ALARMS,
    Action,
    BulkRead,
    Error,
    Instruction,
    Ping,
    ReadData,
    RegWrite,
    Reset,
    SyncRead,
    SyncWrite,
    WriteData,
    code_of,
    parse_instruction,
    parse_status,
)
from servobus.families.effects import ModelOf, bytes_written, doubtful, kept, reads
from servobus.families.explain import addressed, id_list, servo, show_bytes, show_span, show_values
from servobus.families.model import Model


def explain(packet: Packet, request: Packet | None, model: type[Model] | None) -> str:
    """Say what a packet means: nothing in it tells an instruction from a status packet, only what came before."""
    asked = _asked(packet, request)
    if asked is None:
        try:
            message = parse_instruction(packet)
            return _say_instruction(message, [model] * len(concerns(packet)))
        except ValueError as error:
            if _only_instruction(packet):
                data = f", data {show_bytes(packet.data)}" if packet.data else ""
                return f"{error}, {addressed(packet.id)}{data}"
    return _say_status(packet, asked, model)


def explain_to_several(packet: Packet, models: Sequence[type[Model] | None]) -> str:
    """Say what an instruction asks of servos of these models, in the order of `concerns`."""
    return _say_instruction(parse_instruction(packet), models)


def concerns(packet: Packet) -> tuple[int, ...]:
    try:
        message = parse_instruction(packet)
    except ValueError:
        return (packet.id,)
    match message:
        case SyncWrite(_, _, parts):
            return tuple(id for id, _ in parts)
        case SyncRead(_, _, ids):
            return ids
        case BulkRead(reads):
            return tuple(read.id for read in reads)
    return (packet.id,)


def told_number(packet: Packet, request: Packet) -> int | None:
    """In all models of protocol 1.0 the model number is at 0 and 1."""
    match _asked(packet, request):
        case ReadData(_, 0, length) if length == len(packet.data) >= 2:
            return int.from_bytes(packet.data[:2], "little")
    return None


def replies_to(packet: Packet) -> tuple[ReplyPattern, ...] | None:
    """Tell what replies an instruction asks for.

    Servos may answer a PING to all, though the RX-28 manual says that none does: AX-12A do, one behind the other.
    """
    try:
        message = parse_instruction(packet)
    except ValueError:
        if not _only_instruction(packet):
            return None
        message = None
    match message:
        case BulkRead(reads):
            # An id listed twice counts once (ROBOTIS e-manual, Protocol 1.0, Bulk Read).
            once = {read.id: read.length for read in reversed(reads)}
            return tuple(ReplyPattern(id, None, (once[id], 0)) for id in dict.fromkeys(read.id for read in reads))
        case SyncRead(_, length, ids):
            # Each servo for itself, or an adapter for all of them.
            each = (ReplyPattern(id, None, (length, 0), certain=False) for id in dict.fromkeys(ids))
            return (*each, ReplyPattern(None, None, (length * len(ids),), certain=False))
        case Ping() if packet.id == BROADCAST:
            return (ReplyPattern(None, None, (0,), certain=False),)
        case _ if packet.id == BROADCAST:
            return ()
        case ReadData(_, _, length):
            return (ReplyPattern(packet.id, None, (length, 0)),)
    return (ReplyPattern(packet.id, None, (0,), certain=isinstance(message, Ping)),)


def effect(packet: Packet, model_of: ModelOf) -> Effect:
    """Tell what an instruction does. Which write an ACTION carries out nothing in the packet tells."""
    try:
        message = parse_instruction(packet)
    except ValueError:
        return doubtful((packet.id,))
    match message:
        case WriteData(id, address, data):
            return Effect((bytes_written(id, model_of(id), TABLE, address, data),))
        case RegWrite(id, address, data):
            return Effect((kept(bytes_written(id, model_of(id), TABLE, address, data)),))
        case SyncWrite(address, _, parts):
            return Effect(tuple(bytes_written(id, model_of(id), TABLE, address, data) for id, data in parts))
        case Action(id):
            return Effect((Touch(id, Kind.WRITES | Kind.DRIVES),))
        case Reset(id):
            return Effect((Touch(id, Kind.STORES),))
    return reads(concerns(packet))


def _only_instruction(packet: Packet) -> bool:
    """Tell whether this can be no status packet: nobody answers as all, and bit 7 of the error byte is 0 (3-3)."""
    return packet.id == BROADCAST or (packet.code & 0x80 != 0 and packet.data != b"")


def _asked(packet: Packet, request: Packet | None) -> Instruction | None:
    """Give the instruction that a packet answers: the one before it, if its id and length fit.

    Of a read of several servos that is the part of the one that answers; all of it for an adapter that answers for all.
    """
    if request is None or packet.id == BROADCAST:
        return None
    if request.data and request == packet:
        return None  # asked again: to be an answer, this would have to repeat address and length by chance
    try:
        asked = parse_instruction(request)
    except ValueError:
        return None
    size = len(packet.data)
    match asked:
        case BulkRead(reads):
            return next((read for read in reads if read.id == packet.id and size in (read.length, 0)), None)
        case SyncRead(address, length, ids) if packet.id in ids and size in (length, 0):
            return ReadData(packet.id, address, length)
        case SyncRead(_, length, ids):
            return asked if size == length * len(ids) else None
        case Ping() if request.id == BROADCAST:
            return None if size or _is_instruction(packet) else asked
        case ReadData(_, _, length) if request.id == packet.id:
            return asked if size in (length, 0) else None
    return asked if request.id == packet.id and not size else None


def _is_instruction(packet: Packet) -> bool:
    try:
        parse_instruction(packet)
    except ValueError:
        return False
    return True


def _say_instruction(message: Instruction, models: Sequence[type[Model] | None]) -> str:
    """Say what an instruction asks of servos of these models: of each that it lists, else of the only one."""
    head = f"{code_of(message).name} {addressed(message.id)}"
    model = models[0] if len(set(models)) == 1 else None
    match message:
        case ReadData(_, address, length):
            return f"{head}: {show_span(model, TABLE, address, length)}"
        case WriteData(_, address, data) | RegWrite(_, address, data):
            return f"{head}: {show_values(model, TABLE, address, data)}"
        case SyncWrite(address, _, parts):
            each = "; ".join(
                f"{servo(id)}: {show_values(one, TABLE, address, data)}"
                for (id, data), one in zip(parts, models, strict=True)
            )
            return f"{head}, for {id_list(id for id, _ in parts)}: {each}"
        case SyncRead(address, length, ids):
            return f"{head}, for {id_list(ids)}: {show_span(model, TABLE, address, length)}"
        case BulkRead(reads):
            each = "; ".join(
                f"{servo(read.id)}: {show_span(one, TABLE, read.address, read.length)}"
                for read, one in zip(reads, models, strict=True)
            )
            return f"{head}, for {id_list(read.id for read in reads)}: {each}"
    return head


def _say_status(packet: Packet, asked: Instruction | None, model: type[Model] | None) -> str:
    status, errors = parse_status(packet), Flags(Error)
    # By numbers: bit 7 has no name, and ~ of named flags would drop it.
    refusals, alarms = Error(int(status.error) & ~int(ALARMS)), status.error & ALARMS
    said = [f"refused, {errors.show(refusals)}"] if refusals else []
    if alarms:
        said.append(f"ALARM {errors.show(alarms)}")
    text = f"status of {servo(status.id)}: {'; '.join(said) or 'ok'}"
    if not status.data:
        return text
    if isinstance(asked, ReadData):
        return f"{text}, {show_values(model, TABLE, asked.address, status.data)}"
    if isinstance(asked, SyncRead):
        parts = (status.data[at : at + asked.length] for at in range(0, len(status.data), asked.length))
        each = (
            f"{servo(id)}: {show_values(model, TABLE, asked.address, part)}"
            for id, part in zip(asked.ids, parts, strict=True)
        )
        return f"{text}, for all that were asked; {'; '.join(each)}"
    return f"{text}, {show_bytes(status.data)}"
