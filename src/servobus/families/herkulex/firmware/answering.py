"""What the firmware of HerkuleX servos does with packets: it reads and writes registers, and answers.

Section and register (NO) numbers are those of the DRS-0602 user's manual, EH entries those of docs/decisions.md, H
numbers those of docs/behaviours.md.
"""

import functools
from abc import abstractmethod
from collections.abc import Iterable

from servobus.core.framing import Corrupt, Packet
from servobus.core.ids import BROADCAST
from servobus.core.registers import Access
from servobus.families.herkulex.places import EEP, RAM
from servobus.families.herkulex.protocol import (
    Ack,
    Code,
    EepRead,
    EepWrite,
    IJog,
    Jog,
    Keep,
    RamRead,
    RamWrite,
    Reboot,
    Request,
    Rollback,
    SJog,
    Stat,
    StatusDetail,
    StatusError,
    TorqueControl,
    UnknownCommandError,
    encode,
    parse_request,
)
from servobus.virtual.device.servo import Replies, VirtualServo

_parse = functools.lru_cache(maxsize=16)(parse_request)
"""All servos of a line read the same packet: one with 53 JOGs is taken apart once, not once by each."""


class AnsweringServo(VirtualServo):
    """The half of the firmware that hears. What the motor does about it is told by the class made from it."""

    @abstractmethod
    def _sense(self) -> None:
        """Bring the registers that are measured up to date."""

    @abstractmethod
    def _settle(self) -> None:
        """Do what follows from the values of RAM."""

    @abstractmethod
    def _fault(self, error: StatusError, cause: int = 0) -> None:
        """Note an error; it stays until a host clears it (H-19)."""

    @abstractmethod
    def _jog(self, entries: Iterable[tuple[Jog, int]]) -> None:
        """Obey a JOG: its entries, and the playtime of each."""

    def start(self) -> None:
        rows = self.model.registers.values()
        self._rows = {
            space: [(at, row) for row in rows if (at := row.place.within(space)) is not None] for space in (EEP, RAM)
        }

    def garbage(self, now: float) -> None:  # noqa: ARG002 - the timer of the line is the servo's
        self._fault(StatusError.INVALID_PACKET, StatusDetail.GARBAGE)

    def hear(self, event: Packet | Corrupt, now: float) -> Replies:
        # What cannot be understood is noted and not answered, not even with the STAT bits (H-13, H-14).
        if isinstance(event, Corrupt):
            self._fault(StatusError.INVALID_PACKET, StatusDetail.CHECKSUM_ERROR)
            return []
        try:
            request = _parse(event)
        except UnknownCommandError:
            self._fault(StatusError.INVALID_PACKET, StatusDetail.UNKNOWN_COMMAND)
            return []
        except ValueError:
            self._fault(StatusError.INVALID_PACKET)  # wrong length: the cause without a bit (EH-31)
            return []
        id = self.id  # that of the request, even if it changes the id (H-36)
        data = self._obey(request)
        replies: Replies = []
        if self._answers(request):
            self._sense()
            status = StatusError(self.get("status_error")), StatusDetail(self.get("status_detail"))
            replies = [(0.0, encode(Ack(id, Code(event.code), data, *status)))]
        if isinstance(request, Reboot):
            self.restart(now)
        return replies

    def _answers(self, request: Request) -> bool:
        if isinstance(request, Stat):
            return True
        policy = self.get("ack_policy")  # a changed one holds for the ACK of its own write (H-30)
        return request.id != BROADCAST and policy >= (1 if isinstance(request, EepRead | RamRead) else 2)

    def _obey(self, request: Request) -> bytes:
        """Carry out a request; give what its ACK says before the two status bytes."""
        match request:
            case EepRead(_, address, length):
                return self._read(EEP, address, length)
            case RamRead(_, address, length):
                return self._read(RAM, address, length)
            case EepWrite(_, address, data):
                self._write(EEP, address, data)
            case RamWrite(_, address, data):
                self._write(RAM, address, data)
            case IJog(_, jogs):
                self._jog((jog, jog.playtime) for jog in jogs)
            case SJog(_, playtime, jogs):
                self._jog((jog, playtime) for jog in jogs)
            case Rollback(_, keep):
                names = {Keep.ID: "id", Keep.CALIBRATION: "calibration_difference", Keep.BAUD: "baud_rate"}
                self.memory.factory_reset([self.row(name) for bit, name in names.items() if bit & keep])
        return b""

    def _read(self, space: str, address: int, length: int) -> bytes:
        self._sense()
        there = self.memory.space(space)
        if address + length > len(there):
            self._fault(StatusError.INVALID_PACKET, StatusDetail.EXCEED_REG_RANGE)  # H-15
            return b""
        return bytes((address, length)) + there[address : address + length]

    def _write(self, space: str, address: int, data: bytes) -> None:
        accepted = self._accepted(space, address, data)
        if accepted is None:
            self._fault(StatusError.INVALID_PACKET, StatusDetail.EXCEED_REG_RANGE)
            return
        self.memory.write(space, address, accepted)
        if space == RAM:
            self._settle()

    def _accepted(self, space: str, address: int, data: bytes) -> bytes | None:
        """Give the bytes to store; None if any may not be written, for then none is (H-15, H-38, H-40).

        A single byte of two may be written (assumption): what both then make must be in range.
        """
        image = bytearray(self.memory.space(space))
        end = address + len(data)
        if end > len(image):
            return None
        image[address:end] = data
        for at, row in self._rows[space]:
            if not (at < end and address < at + row.layout.size):
                continue
            if row.access is Access.READ:
                return None
            if row.access is Access.RESERVED:
                image[at] = 0  # H-39
            elif row.name == "torque_control":
                image[at] &= TorqueControl.ON  # the mask of NO 47
                if not row.accepts(image[at]):
                    image[at] = TorqueControl.FREE  # H-46: 0x20 alone means nothing
            elif not row.accepts(row.layout.unpack(bytes(image[at : at + row.layout.size]))):
                return None
        return bytes(image[address:end])
