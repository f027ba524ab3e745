"""A packet that somebody writes by hand: header, length and checksum are filled in, and what it would do is said."""

import re
from dataclasses import dataclass
from typing import Any

from servobus.bus.asyncio import AsyncBusServo
from servobus.core.effect import Effect, Kind
from servobus.core.exchange import Exchange, ReplyPattern
from servobus.core.framing import Packet
from servobus.core.ids import BROADCAST, check_id
from servobus.errors import BadValue, NoReply, UsageError
from servobus.families import registry
from servobus.families.base import Family, Model
from servobus.families.explain import addressed
from servobus.server.web.served_bus import Actor, ServedBus

LONGEST_WAIT = 0.1
"""s until a servo must have begun to answer; assumption: none needs so long, see `servobus.traffic.tracker`."""
WORDS = {
    Kind.READS: "only asks",
    Kind.WRITES: "writes to the RAM",
    Kind.STORES: "changes something for good",
    Kind.DRIVES: "may move a servo",
    Kind.STOPS: "stops",
    Kind.RELEASES: "lets go",
}
"""What a packet does, in words."""


@dataclass(frozen=True, slots=True)
class Composed:
    """A packet with its frame.

    text    what it says
    effect  what it does
    """

    family: Family
    packet: Packet
    raw: bytes
    text: str
    effect: Effect

    @property
    def does(self) -> list[str]:
        """Say what it does, in a few words each."""
        return [text for kind, text in WORDS.items() if self.effect.kinds & kind]


def read_bytes(text: str) -> bytes:
    """Read bytes as they are typed: "1E 00 02", "1E0002", "0x1e, 0, 2". Raises BadValue."""
    words = [word.lower().removeprefix("0x") for word in re.split(r"[\s,]+", text.strip()) if word]
    digits = "".join(word.zfill(len(word) + len(word) % 2) for word in words)
    try:
        return bytes.fromhex(digits)
    except ValueError:
        raise BadValue(f"{text[:40]!r} are no bytes: write them in hexadecimal, such as 1E 00 02") from None


def compose(bus: ServedBus, family: str, id: int, code: str, data: str) -> Composed:
    """Make a packet of what was typed: its code and its data in hexadecimal. Raises BadValue, UnknownName."""
    spoken = registry.family(family)
    codes = read_bytes(code)
    if len(codes) != 1:
        raise BadValue(f"the command is one byte in hexadecimal, such as 01, not {code[:20]!r}")
    packet = Packet(id if id == BROADCAST else check_id(id), codes[0], read_bytes(data))
    try:
        raw = spoken.framing.frame(packet)
    except ValueError as error:
        raise BadValue(f"this is no packet of {spoken.title}: {error}") from None
    models: dict[int, type[Model]] = {one.id: one.model for one in bus.bus if one.family is spoken}
    known = spoken.replies_to(packet) is not None
    text = spoken.explain(packet, None, models.get(id)) if known else f"unknown command {codes[0]:#04x}"
    return Composed(spoken, packet, raw, text, spoken.effect(packet, models.get))


def template(bus: ServedBus, key: str, register: str = "") -> tuple[str, str]:
    """Give code and data, in hexadecimal, of a ping, or of the question for a register. Raises UnknownName."""
    servo = bus.servo(key)
    exchange: Exchange[Any]
    if register:
        exchange = servo.family.question(servo.target, servo.model.register(register))
    else:
        exchange = servo.family.ping(servo.id)
    packet, _ = exchange.framing.unframe(exchange.request)
    return f"{packet.code:02X}", packet.data.hex(" ").upper()


async def send(bus: ServedBus, actor: Actor, composed: Composed, baud: int) -> str:
    """Send a packet, and say in words what was answered. Raises Stopped, UsageError, BusError."""
    family, packet, effect = composed.family, composed.packet, composed.effect
    driven = _servos(bus, composed, effect.ids_of(Kind.DRIVES))
    if effect.kinds & Kind.DRIVES:
        if actor.holder is None:
            raise UsageError("a packet that may move a servo needs a page whose heartbeat is heard: wait a moment")
        bus.begin(actor, driven)
        for servo in driven:  # so that the safe stop finds them
            servo.permit.driven, servo.permit.stopped = True, False
    replies = family.replies_to(packet)
    if replies is None:
        replies = (ReplyPattern(packet.id, None, (0,), certain=False),)
    reply = replies[0] if len(replies) == 1 and packet.id != BROADCAST else None
    exchange: Exchange[Packet] = Exchange(
        f"{family.title} {addressed(packet.id)}: {composed.text}"[:120],
        family.framing,
        composed.raw,
        lambda answer: answer,
        reply,
        max_delay=LONGEST_WAIT if reply is not None else 0.0,
    )
    said = composed.raw.hex(" ").upper()
    if not effect.only_reads:
        bus.audit.note(actor.name, "packet", bus.name, f"{family.name}:{packet.id}@{baud}", {"hex": said})
    try:
        answer = await bus.bus.do(exchange, baud)
    except NoReply:
        if reply is not None and reply.certain:
            raise
        return "no answer; the servo may be set not to answer commands"
    if reply is None:
        return "sent; the packets below show who answers"
    model = next((one.model for one in bus.bus if one.family is family and one.id == packet.id), None)
    return family.explain(answer, packet, model)


def _servos(bus: ServedBus, composed: Composed, ids: tuple[int, ...]) -> list[AsyncBusServo]:
    return [one for one in bus.bus if one.family is composed.family and (one.id in ids or BROADCAST in ids)]
