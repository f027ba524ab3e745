"""What the firmware of servos with Dynamixel protocol 1.0 does with packets: it reads, writes and answers.

Section numbers are those of the RX-28 user's manual, ED entries those of docs/decisions.md, D numbers those of
docs/behaviours.md.
"""

from abc import abstractmethod
from functools import lru_cache

from servobus.core.framing import BITS_PER_BYTE, Corrupt, Packet
from servobus.core.ids import BROADCAST
from servobus.core.registers import Register
from servobus.core.units import BaudDivisor
from servobus.families.base import Answers
from servobus.families.dynamixel.places import TABLE, Address
from servobus.families.dynamixel.protocol import (
    FRAMING,
    Action,
    BulkRead,
    Code,
    Error,
    Ping,
    ReadData,
    RegWrite,
    Reset,
    SyncRead,
    SyncWrite,
    WriteData,
    parse_instruction,
)
from servobus.families.dynamixel.verbs import open_while_locked
from servobus.virtual.device.options import ON_OFF, OneOf, Option
from servobus.virtual.device.servo import Replies, VirtualServo

OK = Error(0)

_parse = lru_cache(maxsize=16)(parse_instruction)
"""All servos of a line hear the same SYNC_WRITE."""


class AnsweringServo(VirtualServo):
    """The half of the firmware that hears. What the motor does about it is told by the class made from it."""

    goal_torque = Option(
        ON_OFF, practice=True, manual=False, decision="ED-31",
        text="whether a write of Goal Position switches the torque on",
    )  # fmt: skip
    broadcast_ping = Option(
        OneOf(("silent", "answered")), practice="silent", manual="silent", decision="ED-19",
        text="whether a PING to id 254 is answered: by each servo in its turn, the lowest id first",
    )  # fmt: skip
    goal_after_turn = Option(
        OneOf(("present", "kept")), practice="present", manual="present", decision="ED-36",
        text="what Goal Position becomes when endless turn ends: where the shaft is, or it stays as it was",
    )  # fmt: skip
    turn_goal = Option(
        OneOf(("kept", "refused")), practice="kept", manual="kept", decision="ED-34",
        text="what a goal is in endless turn: kept without motion, or refused with an angle limit error",
    )  # fmt: skip
    goal_outside = Option(
        OneOf(("refused", "limited")), practice="refused", manual="refused", decision="ED-23",
        text="what a goal outside the angle limits does, besides its error: nothing, or the nearest limit is the goal",
    )  # fmt: skip
    bad_checksum = Option(
        OneOf(("answered", "silent")), practice="answered", manual="answered", decision="ED-20",
        text="whether an instruction other than PING with a wrong checksum is answered with the checksum error",
    )  # fmt: skip

    garbage_timeout = 0.1
    """Longest pause between two bytes of a packet (appendix, Byte to Byte Time)."""

    _kept: tuple[int, bytes] | None = None
    """The write that waits for ACTION: address and bytes."""

    @property
    @abstractmethod
    def present(self) -> int:
        """Where the shaft is, as Present Position tells it."""

    @property
    @abstractmethod
    def endless(self) -> bool:
        """Whether it turns without end."""

    @property
    @abstractmethod
    def goals(self) -> tuple[int, int]:
        """The lowest and the highest goal that is allowed."""

    @property
    @abstractmethod
    def alarms(self) -> Error:
        """What is wrong now."""

    @abstractmethod
    def _sense(self) -> None:
        """Bring the registers that are measured up to date."""

    @abstractmethod
    def _alarm(self, errors: Error, time: float) -> None:
        """Take note of errors, at this time."""

    @abstractmethod
    def _written(self, names: set[str], *, turned: bool) -> None:
        """Do what follows from the new values of these registers; `turned`: whether it turned without end before."""

    def begin_to_hear(self) -> None:
        """Make ready what packets are compared with, after the supply came on."""
        self._rows_by_address = {
            row.place.address: row for row in self.model.registers.values() if isinstance(row.place, Address)
        }
        self._reserved = [
            row for row in self._rows_by_address.values() if row.name.startswith("reserved") and row.writable
        ]
        self._open = open_while_locked(self.model)
        self._kept = None

    def _listen(self) -> None:
        """Receive to what id and baud rate say."""
        self.id = self.get("id")
        scale = self.row("baud_rate").scale
        assert isinstance(scale, BaudDivisor)
        self.baud = scale.exact(self.get("baud_rate"))

    # Packets

    def hear(self, event: Packet | Corrupt, now: float) -> Replies:
        packet = event.packet if isinstance(event, Corrupt) else event
        if packet.code == Code.SYNC_WRITE and packet.id != BROADCAST:
            return []  # D-50
        # The reply obeys the settings that the instruction found: old id, old level, old delay (ED-04, D-25).
        id, answered, delay = self.id, self._answers(packet), self.return_delay
        if isinstance(event, Corrupt):
            answered = answered and packet.code != Code.PING and self.bad_checksum == "answered"  # 3-5-5, ED-20
            error, data = Error.CHECKSUM, b""
        else:
            error, data = self._obey(packet)
        if error:
            self._alarm(error, now)
        if packet.id == BROADCAST:
            delay += self._turn(id, delay)
        return [(delay, FRAMING.frame(Packet(id, error | self.alarms, data)))] if answered else []

    @property
    def return_delay(self) -> float:
        """S that an answer waits, as Return Delay Time says."""
        delay: float = self.row("return_delay_time").decode(self.get("return_delay_time"))
        return delay

    def _turn(self, id: int, delay: float) -> float:
        """Give the time that an answer to a broadcast PING waits for those of lower ids (ED-19)."""
        return id * (delay + self.answer_time.high + FRAMING.overhead * BITS_PER_BYTE / self.baud)

    def _answers(self, packet: Packet) -> bool:
        level = self.get("status_return_level")
        if packet.id == BROADCAST:
            return packet.code == Code.PING and self.broadcast_ping == "answered"  # ED-19
        if packet.code == Code.PING:
            return True
        return level >= (Answers.READS if packet.code == Code.READ_DATA else Answers.EVERYTHING)

    def _obey(self, packet: Packet) -> tuple[Error, bytes]:
        """Carry out an instruction; give what went wrong, and the data to answer."""
        try:
            instruction = _parse(packet)
        except ValueError:
            return Error.INSTRUCTION, b""
        match instruction:
            case ReadData(_, address, length):
                return self._read(address, length)
            case WriteData(_, address, data):
                return self._write(address, data), b""
            case RegWrite(_, address, data):
                return self._register(address, data), b""
            case SyncWrite(address, _, parts):
                return self._write_own(address, parts), b""
            case Action():
                return self._act(), b""
            case Reset():
                return self._reset(), b""
            case Ping():
                return OK, b""
            case SyncRead() | BulkRead():
                return Error.INSTRUCTION, b""  # ED-26

    def _read(self, address: int, length: int) -> tuple[Error, bytes]:
        self._sense()
        table = self.memory.space(TABLE)
        if address + length > len(table):
            return Error.RANGE, b""  # ED-30
        return OK, table[address : address + length]

    def _write(self, address: int, data: bytes) -> Error:
        error, allowed = self._checked(address, data)
        if allowed is not None:
            self._store(address, allowed)
        return error

    def _register(self, address: int, data: bytes) -> Error:
        error, allowed = self._checked(address, data)  # D-45: what is wrong is said now, not at ACTION
        if allowed is not None:
            self._kept = address, allowed
            self.put("registered_instruction", 1)
        return error

    def _act(self) -> Error:
        if self._kept is None:
            return Error.INSTRUCTION  # 3-3, bit 6
        kept, self._kept = self._kept, None
        self.put("registered_instruction", 0)
        self._store(*kept)
        return OK

    def _write_own(self, address: int, parts: tuple[tuple[int, bytes], ...]) -> Error:
        error = OK
        for id, data in parts:
            if id == self.id:
                error |= self._write(address, data)
        return error

    def _reset(self) -> Error:
        if self.get("lock"):
            return Error.RANGE  # D-90
        self.memory.factory_reset()
        self.memory.power_on()
        self.start()
        return OK

    # The control table

    def _checked(self, address: int, data: bytes) -> tuple[Error, bytes | None]:
        """Tell what is wrong with these bytes, and give those to be written; None if nothing is."""
        error = self._refusal(address, data)
        if error == Error.ANGLE_LIMIT and self.goal_outside == "limited":
            row, image = self.row("goal_position"), bytearray(data)
            at = address_of(row) - address
            low, high = self.goals
            goal = max(low, min(row.layout.unpack(data[at : at + row.layout.size]), high))
            image[at : at + row.layout.size] = row.layout.pack(goal)
            return error, bytes(image)
        return error, None if error else data

    def _refusal(self, address: int, data: bytes) -> Error:
        """Tell why these bytes may not be written; nothing of a packet is written if anything is wrong (D-32)."""
        if self.get("lock") and not (address in self._open and address + len(data) - 1 in self._open):
            return Error.RANGE  # ED-21
        error, at = OK, 0
        while at < len(data):
            row = self._rows_by_address.get(address + at)
            if row is None or not row.writable or at + row.layout.size > len(data):
                return Error.RANGE  # no register, read-only, or half of one (ED-22, ED-24, ED-30)
            error |= self._range_error(row, data[at : at + row.layout.size])
            at += row.layout.size
        return error

    def _range_error(self, row: Register[int], data: bytes) -> Error:
        raw = row.layout.unpack(data)
        if not row.accepts(raw):
            return Error.RANGE
        if row.name == "moving_speed" and data[1] >> 2 and not self.endless:
            return Error.RANGE  # a direction bit counts in endless turn only (ED-14)
        low, high = self.goals
        if row.name == "goal_position" and not low <= raw <= high:
            return OK if self.endless and self.turn_goal == "kept" else Error.ANGLE_LIMIT  # ED-23, ED-34
        return OK

    def _store(self, address: int, data: bytes) -> None:
        """Write bytes that were checked, and do what follows from the new values."""
        was_endless = self.endless
        self.memory.write(TABLE, address, data)
        for row in self._reserved:
            if self.memory[row]:
                self.memory[row] = 0  # ED-22: accepted, without effect
        self._listen()
        if not self.get("registered_instruction"):
            self._kept = None  # ED-16
        if was_endless and not self.endless and self.goal_after_turn == "present":
            self.put("goal_position", self.present)  # D-78
        rows = [self._rows_by_address.get(at) for at in range(address, address + len(data))]
        written = {row.name for row in rows if row}
        if "goal_position" in written and self.goal_torque:
            self.put("torque_enable", 1)
        self._written(written, turned=was_endless)


def address_of(row: Register[int]) -> int:
    """Give where in the control table a register stands."""
    assert isinstance(row.place, Address)
    return row.place.address
