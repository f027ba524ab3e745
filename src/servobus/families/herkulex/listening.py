"""HerkuleX for those who listen: what a packet says, whom it concerns, which replies it asks for.

Packets and their sources: servobus.families.herkulex.protocol.
"""

from servobus.core.effect import NOTHING, Effect, Kind, Touch
from servobus.core.exchange import ReplyPattern
from servobus.core.framing import Packet
from servobus.core.ids import BROADCAST
from servobus.core.units import Quantity, show
from servobus.families.effects import ModelOf, bytes_written, doubtful, reads
from servobus.families.explain import addressed, servo, show_bytes, show_span, show_values
from servobus.families.herkulex.places import EEP, RAM
from servobus.families.herkulex.protocol import (
    ACK,
    TICK,
    Ack,
    Code,
    ControlMode,
    EepRead,
    EepWrite,
    IJog,
    Jog,
    RamRead,
    RamWrite,
    Reboot,
    Request,
    Rollback,
    SJog,
    Stat,
    parse_ack,
    parse_request,
    show_flags,
)
from servobus.families.model import Model


def explain(packet: Packet, model: type[Model] | None) -> str:
    try:
        if packet.code & ACK:
            return _say_ack(parse_ack(packet), model)
        return _say_request(parse_request(packet), packet, model)
    except ValueError as error:
        return f"{error}, {addressed(packet.id)}"


def concerns(packet: Packet) -> tuple[int, ...]:
    try:
        message = parse_request(packet)
    except ValueError:
        return (packet.id,)
    return tuple(jog.id for jog in message.jogs) if isinstance(message, IJog | SJog) else (packet.id,)


def told_number(packet: Packet) -> int | None:
    """The model number is at EEP 0 and 1 of all models, its upper two digits first (4-2 NO 1, 2)."""
    try:
        ack = parse_ack(packet)
    except ValueError:
        return None
    whole = ack.code is Code.EEP_READ and len(ack.data) >= 4 and len(ack.data) == ack.data[1] + 2
    return ack.data[2] << 8 | ack.data[3] if whole and not ack.data[0] else None


def replies_to(packet: Packet) -> tuple[ReplyPattern, ...] | None:
    """STAT is answered under every ACK Policy and by all, the rest never if it is for all (4-2 NO 8)."""
    if packet.code & ACK:
        return None
    try:
        message = parse_request(packet)
    except ValueError:
        message = None
    everybody, code = packet.id == BROADCAST, packet.code | ACK
    if isinstance(message, Stat):
        return (ReplyPattern(None if everybody else packet.id, code, (2,)),)
    if everybody:
        return ()
    if isinstance(message, EepRead | RamRead):
        return (ReplyPattern(packet.id, code, (message.length + 4, 2)),)
    return (ReplyPattern(packet.id, code, (2,), certain=False),)


def effect(packet: Packet, model_of: ModelOf) -> Effect:
    """Tell what a request does. What EEP is given acts only after a restart, which switches the torque off (4-2)."""
    try:
        message = parse_request(packet)
    except ValueError:
        return doubtful((packet.id,))
    id = packet.id
    match message:
        case RamWrite(_, address, data):
            return Effect((bytes_written(id, model_of(id), RAM, address, data),))
        case EepWrite(_, address, data):
            return Effect((Touch(id, Kind.STORES, bytes_written(id, model_of(id), EEP, address, data).written),))
        case IJog(_, jogs) | SJog(_, _, jogs):
            return Effect(tuple(_jogged(jog, model_of(jog.id)) for jog in jogs if not jog.invalid))
        case Rollback():
            return Effect((Touch(id, Kind.STORES),))
        case Reboot():
            return Effect((Touch(id, Kind.STORES | Kind.RELEASES),))
    return reads((id,))


def _jogged(jog: Jog, model: type[Model] | None) -> Touch:
    if jog.stop:
        return Touch(jog.id, Kind.STOPS)
    goes = jog.mode is ControlMode.POSITION and model is not None
    return Touch(jog.id, Kind.DRIVES, {model.register("goal_position"): jog.value} if goes and model else NOTHING)


def _say_request(message: Request, packet: Packet, model: type[Model] | None) -> str:
    code = Code(packet.code)
    head = f"{code.name} {addressed(message.id)}"
    match message:
        case EepRead(_, address, length) | RamRead(_, address, length):
            return f"{head}: {show_span(model, _map(code), address, length)}"
        case EepWrite(_, address, data) | RamWrite(_, address, data):
            return f"{head}: {show_values(model, _map(code), address, data)}"
        case IJog(_, jogs):
            each = (
                _say_jog(jog, f"playtime {show(jog.playtime * TICK, 's')}", *surplus, model=model)
                for jog, surplus in zip(jogs, _surplus(packet.data, 5), strict=True)
            )
            return f"{head}: {', '.join(each)}"
        case SJog(_, playtime, jogs):
            each = (
                _say_jog(jog, *surplus, model=model)
                for jog, surplus in zip(jogs, _surplus(packet.data[1:], 4), strict=True)
            )
            return f"{head}, playtime {show(playtime * TICK, 's')}: {', '.join(each)}"
        case Rollback(_, keep):
            return f"{head}, keeping {show_flags(keep).replace('+', ' and ') if keep else 'nothing'}"
    return head


def _surplus(data: bytes, size: int) -> list[list[str]]:
    """Name the reserved bits that are set in each entry: bit 15 of the value and bit 7 of SET."""
    entries = (data[at : at + size] for at in range(0, len(data), size))
    return [["a reserved bit set, which servos ignore"] if (one[1] | one[2]) & 0x80 else [] for one in entries]


def _say_jog(jog: Jog, *details: str, model: type[Model] | None) -> str:
    if jog.invalid:
        return f"{servo(jog.id)} left alone"
    if jog.stop:
        does = "stops"
    elif jog.mode is ControlMode.INFINITE_TURN:
        scale: Quantity | None = model.turn_scale if model else None
        does = f"turns at {scale.show(scale.decode(jog.value)) if scale else jog.value}"
    else:
        goal = model.register("goal_position") if model else None
        does = f"to {goal.show(goal.decode(jog.value)) if goal else jog.value}"
    notes = [show_flags(jog.led) if jog.led else "lights off", *details]
    if jog.no_override:
        notes.append("from speed 0")
    return f"{servo(jog.id)} {does} ({', '.join(notes)})"


def _say_ack(ack: Ack, model: type[Model] | None) -> str:
    said = []
    if ack.code in (Code.EEP_READ, Code.RAM_READ) and len(ack.data) > 2 and len(ack.data) == ack.data[1] + 2:
        said.append(show_values(model, _map(ack.code), ack.data[0], ack.data[2:]))
    elif ack.data:
        said.append(show_bytes(ack.data))
    if ack.status_error:
        said.append(f"ALARM {show_flags(ack.status_error)}")
    if ack.status_detail:
        said.append(show_flags(ack.status_detail))
    return f"ACK of {ack.code.name} from {servo(ack.id)}: {'; '.join(said) or 'ok'}"


def _map(code: Code) -> str:
    """Tell which of the two maps a command is about."""
    return EEP if code in (Code.EEP_READ, Code.EEP_WRITE) else RAM
