"""A reply that a question on its way asks for, and that has not come yet."""

from dataclasses import dataclass

from servobus.core.exchange import ReplyPattern
from servobus.core.framing import Packet
from servobus.core.ids import BROADCAST
from servobus.families.base import Family

HEAD = 4
"""Bytes of a packet that tell whose it is and how long, in all families."""


@dataclass(slots=True, eq=False)
class OpenReply:
    """A reply that a question on its way asks for, until it has come or is overdue."""

    family: Family
    packet: Packet
    reply: ReplyPattern
    text: str
    end: float
    """s: when its last byte was on the wire."""
    mark: float
    """s: when the piece came that its last byte was in."""
    expected: bool
    deadline: float
    spoiled: bool = False
    """Whether something corrupt came that may have been the answer."""
    answered: bool = False
    """Whether one of several servos that may answer did."""

    @property
    def id(self) -> int:
        """The servo that must answer; the broadcast id where any may."""
        return self.packet.id if self.reply.id is None else self.reply.id

    @property
    def to_several(self) -> bool:
        """Whether any number of servos may answer."""
        return self.reply.id is None

    def fits(self, family: Family, packet: Packet) -> bool:
        return family is self.family and packet.id != BROADCAST and self.reply.fits(packet)

    def begins(self, raw: bytes) -> bool:
        """Tell whether these bytes are the beginning of the answer, and not all of it."""
        reply, framing = self.reply, self.family.framing
        if reply.id is None or len(raw) < HEAD - 1:
            return False
        whole = [framing.frame(Packet(reply.id, reply.code or 0, bytes(size))) for size in reply.sizes]
        return any(len(raw) < len(one) and one[:HEAD].startswith(raw[:HEAD]) for one in whole)
