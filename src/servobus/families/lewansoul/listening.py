"""LewanSoul bus servos for those who listen: what a packet says, which replies it asks for.

Packets and their sources: servobus.families.lewansoul.protocol.
"""

from servobus.core.effect import NO_KIND, Effect, Kind, Touch
from servobus.core.exchange import ReplyPattern
from servobus.core.framing import Packet
from servobus.core.ids import BROADCAST
from servobus.families.effects import ModelOf, doubtful, reads, values_written
from servobus.families.explain import addressed, show_bytes, show_value
from servobus.families.lewansoul.places import Pair
from servobus.families.lewansoul.protocol import (
    Answer,
    Command,
    Request,
    length_of,
    parse_answer,
    parse_request,
    places_of,
    without_surplus,
)
from servobus.families.model import Model


def explain(packet: Packet, model: type[Model] | None) -> str:
    try:
        return _say(parse_request(packet), model)
    except ValueError as error:
        problem = f"{error}, {addressed(packet.id)}"
    try:
        return f"answer to {_say(parse_answer(packet), model)}"
    except ValueError:
        pass
    obeyed = without_surplus(packet)
    if obeyed is packet:
        return problem
    surplus = show_bytes(packet.data[len(obeyed.data) :])
    return f"{_say(parse_request(obeyed), model)}, and {surplus} more than it has, which servos ignore"


def replies_to(packet: Packet) -> tuple[ReplyPattern, ...] | None:
    """Only reads are answered; of those to all, SERVO_ID_READ alone (manual 3)."""
    try:
        command = parse_request(packet if _is_answer(packet) else without_surplus(packet)).command
    except ValueError:
        return None
    everybody = packet.id == BROADCAST
    if not command.reply or (everybody and command is not Command.SERVO_ID_READ):
        return ()
    return (ReplyPattern(None if everybody else packet.id, int(command), (length_of(command.reply),)),)


_DONE = {
    Command.SERVO_MOVE_START: Kind.WRITES | Kind.DRIVES,
    Command.SERVO_MOVE_STOP: Kind.STOPS,
    Command.SERVO_ANGLE_OFFSET_WRITE: Kind.STORES,
}
"""What commands do that give no value."""


def effect(packet: Packet, model_of: ModelOf) -> Effect:
    """Tell what a command does. Servos ignore bytes beyond those that a command has (EL-23)."""
    try:
        message = parse_request(without_surplus(packet))
    except ValueError:
        return doubtful((packet.id,))
    id, command = message.id, message.command
    if command.reply:
        return reads((id,))
    if command in _DONE:
        return Effect((Touch(id, _DONE[command]),))
    model = model_of(id)
    rows = {
        row.place.at: row
        for row in (model.registers.values() if model else ())
        if isinstance(row.place, Pair) and row.place.write == command
    }
    given = zip(places_of(command.params), message.values, strict=True)
    values = {rows[at]: value for (_, _, at), value in given if at in rows}
    return Effect((values_written(id, model, values, NO_KIND if values else Kind.DRIVES),))


def _is_answer(packet: Packet) -> bool:
    try:
        parse_answer(packet)
    except ValueError:
        return False
    return True


def _say(message: Request | Answer, model: type[Model] | None) -> str:
    """Name the command and its values: as registers of the model, or as the protocol names its parameters."""
    command = message.command
    fields = command.params if isinstance(message, Request) else command.reply
    rows = {
        row.place.at: row
        for row in (model.registers.values() if model else ())
        if isinstance(row.place, Pair) and command in (row.place.write, row.place.read)
    }
    said = [
        show_value(rows[at], value) if at in rows else f"{name} {value}"
        for (name, _, at), value in zip(places_of(fields), message.values, strict=True)
        if name != "null"
    ]
    head = f"{command.name} {addressed(message.id)}"
    return f"{head}: {', '.join(said)}" if rows and said else ", ".join([head, *said])
