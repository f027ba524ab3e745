"""Packets of the toy family."""

from enum import IntEnum, IntFlag

from servobus.core.exchange import Exchange, ReplyPattern
from servobus.core.framing import INCOMPLETE, NOT_A_FRAME, Framing, Packet
from servobus.errors import Refused

ANSWER = 0x80
DELAY = 0.002
"""s until an answer comes, at most."""


class Code(IntEnum):
    PING = 1
    READ = 2
    WRITE = 3
    RESET = 4


class Trouble(IntFlag):
    HOT = 1


class ToyFraming(Framing):
    name = "toy"
    header = b"\xaa\xaa"
    overhead = 6
    max_size = 40

    def size(self, buffer: bytes | bytearray, at: int) -> int:
        if len(buffer) - at < 4:
            return INCOMPLETE
        count = buffer[at + 3]
        return count + 6 if count <= self.max_size - 6 else NOT_A_FRAME

    def frame(self, packet: Packet) -> bytes:
        body = bytes((packet.id, len(packet.data), packet.code)) + packet.data
        return self.header + body + bytes((sum(body) & 0xFF,))

    def unframe(self, raw: bytes) -> tuple[Packet, bool]:
        return Packet(raw[2], raw[4], raw[5:-1]), sum(raw[2:-1]) & 0xFF == raw[-1]


FRAMING = ToyFraming()


def trouble(packet: Packet) -> Trouble:
    """Read what is wrong with the servo: it stands in the first byte of every answer."""
    return Trouble(packet.data[0] & Trouble.HOT)


def _done(packet: Packet) -> None:
    _data(packet)


def _data(packet: Packet) -> bytes:
    if packet.data[0] & 0x80:
        raise Refused(f"id {packet.id} refuses", 0)
    return packet.data[1:]


def ask(id: int, code: Code, data: bytes, answered: int, *, repeatable: bool = True) -> Exchange[bytes]:
    reply = ReplyPattern(id, code | ANSWER, (answered + 1, 1))
    raw = FRAMING.frame(Packet(id, code, data))
    what = f"{code.name} id {id}"
    return Exchange(what, FRAMING, raw, _data, reply, trouble, DELAY, repeatable=repeatable)


def ping(id: int) -> Exchange[None]:
    return ask(id, Code.PING, b"", 0).mapped(_done)


def read(id: int, cell: int, count: int) -> Exchange[bytes]:
    return ask(id, Code.READ, bytes((cell, count)), 2 * count)


def write(id: int, cell: int, raw: bytes) -> Exchange[None]:
    return ask(id, Code.WRITE, bytes((cell,)) + raw, 0).mapped(_done)
