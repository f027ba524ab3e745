"""As much of Dynamixel protocol 2.0 as tells that a servo speaks it: such a servo hears nothing of protocol 1.0.

MX servos can be given a firmware that speaks it; X and P servos speak nothing else. Source: ROBOTIS e-manual, Protocol
2.0.

    FF FF FD 00  id  length  instruction  parameters ...  CRC     length = parameters + 3, CRC-16; low byte first
"""

from servobus.core.exchange import Exchange, ReplyPattern
from servobus.core.framing import INCOMPLETE, NOT_A_FRAME, Framing, Packet
from servobus.core.ids import BROADCAST
from servobus.families.base import Stranger
from servobus.families.dynamixel.protocol import HEADER_2, PROTOCOL_2

PING, STATUS = 0x01, 0x55
"""Instruction of a PING, and the one that every status packet carries."""
PATIENCE = 0.1
"""s for the first answer to a PING to all: servos answer in the order of their ids, for each of which the maker's
DynamixelSDK allows 3 ms and the time of its answer. So it is that of a servo whose id is not far above 20."""
LONGEST = 255
"""Bytes of the longest packet that is looked for; assumption: nothing longer answers a PING."""


class Dynamixel2Framing(Framing):
    name = "dynamixel 2.0"
    header = b"\xff\xff"
    overhead = 10
    max_size = LONGEST

    def size(self, buffer: bytes | bytearray, at: int) -> int:
        have = bytes(buffer[at : at + 7])
        if not HEADER_2.startswith(have[:4]):
            return NOT_A_FRAME
        if len(have) < 7:
            return INCOMPLETE
        size = 7 + int.from_bytes(have[5:7], "little")
        return size if self.overhead <= size <= self.max_size else NOT_A_FRAME

    def frame(self, packet: Packet) -> bytes:
        body = HEADER_2 + bytes([packet.id]) + (len(packet.data) + 3).to_bytes(2, "little")
        body += bytes([packet.code]) + packet.data
        return body + crc(body).to_bytes(2, "little")

    def unframe(self, raw: bytes) -> tuple[Packet, bool]:
        return Packet(raw[4], raw[7], raw[8:-2]), crc(raw[:-2]) == int.from_bytes(raw[-2:], "little")


FRAMING_2 = Dynamixel2Framing()


def ping_all() -> Exchange[Stranger]:
    """PING to all, which no servo of protocol 1.0 takes for a packet: the length there would be 0."""

    def interpret(packet: Packet) -> Stranger:
        model = int.from_bytes(packet.data[1:3], "little")
        return Stranger(packet.id, f"id {packet.id}, model {model} with firmware {packet.data[3]}: {PROTOCOL_2}")

    request = FRAMING_2.frame(Packet(BROADCAST, PING))
    reply = ReplyPattern(None, STATUS, (4,))
    return Exchange("PING of protocol 2.0 to all", FRAMING_2, request, interpret, reply, max_delay=PATIENCE)


def crc(data: bytes) -> int:
    """Give the checksum of a packet: CRC-16 with the polynomial 0x8005, from 0 on (e-manual, CRC Calculation)."""
    total = 0
    for byte in data:
        total ^= byte << 8
        for _ in range(8):
            total = (total << 1 ^ 0x8005 if total & 0x8000 else total << 1) & 0xFFFF
    return total
