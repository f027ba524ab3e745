"""The firmware of servos with Dynamixel protocol 1.0, as the RX-28 manual describes it.

Section numbers are those of the RX-28 user's manual, ED entries and D numbers those of this project's
notes in docs/decisions.md.
"""

import math

from servobus.families.base import Answers
from servobus.families.dynamixel1 import Dynamixel1
from servobus.framing import Corrupt, Packet
from servobus.protocols.dynamixel1 import (
    CLOCK,
    FRAMING,
    Action,
    Code,
    Error,
    Ping,
    ReadData,
    RegWrite,
    Reset,
    SyncWrite,
    WriteData,
    parse_instruction,
)
from servobus.protocols.ids import BROADCAST
from servobus.registers import Address, Register
from servobus.virtual.memory import TABLE
from servobus.virtual.servo import Replies, VirtualServo

TURN = 2 * math.pi
FULL = 1023
"""Full output, and the largest position (3-4-1 Max Torque, 3-4-2 Goal Position)."""
OPEN = range(24, 36)
"""Addresses that can be written while Lock is on (3-4-2 Lock)."""
OK = Error(0)

FLICKER = 0.5
"""s; assumption: one on and off of a light that flickers."""
HOLD = 2.0
"""s that the alarm light flickers on after recovery (3-4-1 Alarm LED)."""
BLINK = 0.25
"""s; assumption: how long the light is on at power-on (2-4 only says that it flickers once)."""


class Dynamixel1Servo(VirtualServo, family=Dynamixel1):
    """Goal Position and the shaft while the torque is off: the manual does not say what becomes of the goal.

    ROBOTIS says that it follows the shaft that is turned by hand, so that nothing jumps when the torque is
    switched on; D-58 has it that a goal written with the torque off is kept and used. Both hold here: the
    goal becomes the present position when the torque goes off and whenever the shaft is turned; a goal
    that is written stays until then.
    """

    tick = 0.001
    """s; assumption: the manual gives no figure for the control loop."""
    firmware_version = 8
    """As in the answer that 3-5-8 Example 6 prints."""

    garbage_timeout = 0.1
    """Longest pause between two bytes of a packet (appendix, Byte to Byte Time)."""

    _kept: tuple[int, bytes] | None = None
    """The write that waits for ACTION: address and bytes."""
    _followed: int | None = None
    """Position that the goal followed last; None while the torque is on."""
    _flicker_until = -math.inf

    # Life

    def start(self) -> None:
        self._rows_by_address = {
            row.place.address: row for row in self.model.registers.values() if isinstance(row.place, Address)
        }
        self._reserved = [
            row for row in self._rows_by_address.values() if row.name.startswith("reserved") and row.writable
        ]
        self._kept = self._followed = None
        self._flicker_until = -math.inf
        self.put("firmware_version", self.firmware_version)
        self.put("torque_limit", self.get("max_torque"))  # 3-4-1 Max Torque
        self._listen()
        self._follow_shaft()

    def advance(self, now: float) -> None:
        super().advance(now)
        if self.powered:
            self._follow_shaft()

    @property
    def led(self) -> str:
        if not self.powered:
            return "off"
        on = self.get("led") == 1
        if self.time < self._flicker_until:
            on = self.time % FLICKER < FLICKER / 2
        elif self.time < self.started + BLINK:
            on = True
        return "red" if on else "off"

    def _listen(self) -> None:
        """Listen to what id and baud rate say."""
        self.id = self.get("id")
        self.baud = CLOCK / (self.get("baud_rate") + 1)

    # Packets

    def hear(self, event: Packet | Corrupt, now: float) -> Replies:  # noqa: ARG002 - no instruction asks for the time
        packet = event.packet if isinstance(event, Corrupt) else event
        if packet.code == Code.SYNC_WRITE and packet.id != BROADCAST:
            return []  # D-50
        # The reply obeys the settings that the instruction found: old id, old level, old delay (ED-04, D-25).
        id, answered = self.id, self._answers(packet)
        delay: float = self.row("return_delay_time").decode(self.get("return_delay_time"))
        if isinstance(event, Corrupt):
            answered = answered and packet.code != Code.PING  # 3-5-5
            error, data = Error.CHECKSUM, b""
        else:
            error, data = self._obey(packet)
        self._alarm(error)
        return [(delay, FRAMING.frame(Packet(id, error | self.alarms, data)))] if answered else []

    def _answers(self, packet: Packet) -> bool:
        level = self.get("status_return_level")
        if packet.id == BROADCAST:
            return False  # ED-19
        if packet.code == Code.PING:
            return True
        return level >= (Answers.READS if packet.code == Code.READ_DATA else Answers.EVERYTHING)

    def _obey(self, packet: Packet) -> tuple[Error, bytes]:
        """Carry out an instruction; give what went wrong, and the data to answer."""
        try:
            instruction = parse_instruction(packet)
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

    def _read(self, address: int, length: int) -> tuple[Error, bytes]:
        self._sense()
        table = self.memory.table
        if address + length > len(table):
            return Error.RANGE, b""  # ED-30
        return OK, table[address : address + length]

    def _write(self, address: int, data: bytes) -> Error:
        error = self._refusal(address, data)
        if not error:
            self._store(address, data)
        return error

    def _register(self, address: int, data: bytes) -> Error:
        error = self._refusal(address, data)  # D-45: what is wrong is said now, not at ACTION
        if not error:
            self._kept = address, data
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

    def _refusal(self, address: int, data: bytes) -> Error:
        """Tell why these bytes may not be written; nothing of a packet is written if anything is wrong (D-32)."""
        if self.get("lock") and not (address in OPEN and address + len(data) - 1 in OPEN):
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
        raw = int.from_bytes(data, "little")
        if row.layout.sign_bit is not None:
            # Moving Speed has a direction bit in endless turn only (ED-14).
            top = 2 * FULL + 1 if self.endless else FULL
            return Error.RANGE if raw > top else OK
        if not row.accepts(raw):
            return Error.RANGE
        low, high = self.get("cw_angle_limit"), self.get("ccw_angle_limit")
        if row.name == "goal_position" and not self.endless and not low <= raw <= high:
            return Error.ANGLE_LIMIT  # ED-23
        return OK

    def _store(self, address: int, data: bytes) -> None:
        """Write bytes that were checked, and do what follows from the new values."""
        was_endless = self.endless
        self.memory.write(TABLE, address, data)
        for row in self._reserved:
            self.memory[row] = 0  # ED-22: accepted, without effect
        self._listen()
        if not self.get("registered_instruction"):
            self._kept = None  # ED-16
        if was_endless and not self.endless:
            self.put("goal_position", self.present)  # D-78
        goal = self.row("goal_position").place
        assert isinstance(goal, Address)
        self._follow_shaft(keep_goal=address <= goal.address < address + len(data))

    def _sense(self) -> None:
        """Bring the registers that are measured up to date."""
        speed = self.row("present_speed").scale.encode(self.shaft.velocity)
        self.put("present_position", self.present)
        self.put("present_speed", max(-FULL, min(speed, FULL)))
        # The load is inferred from the output (e-manual); an ideal shaft loads the motor in endless turn only.
        self.put("present_load", round(self.output * FULL))
        self.put("present_voltage", self._volts)
        self.put("present_temperature", self._celsius)
        self.put("moving", int(self.torque and not self.endless and abs(self._target - self.shaft.position) > 1e-9))

    # Alarms

    @property
    def alarms(self) -> Error:
        """What is wrong with the servo now; stands in every reply while it lasts (ED-25)."""
        alarms = OK
        if not self.get("lowest_limit_voltage") <= self._volts <= self.get("highest_limit_voltage"):
            alarms |= Error.INPUT_VOLTAGE
        if self._celsius > self.get("highest_limit_temperature"):
            alarms |= Error.OVERHEATING
        return alarms

    def _alarm(self, errors: Error) -> None:
        """Flicker and shut down as the masks say (3-4-1); a mask may name errors of a packet too (D-86)."""
        if errors & self.get("alarm_led"):
            self._flicker_until = self.time + HOLD
        if errors & self.get("alarm_shutdown"):
            # Whoever writes Torque Limit ends the shutdown (3-4-1, ED-29); Torque Enable is not touched.
            self.put("torque_limit", 0)
            self._follow_shaft()

    @property
    def _volts(self) -> int:
        return max(0, min(self.row("present_voltage").scale.encode(self.voltage), 255))

    @property
    def _celsius(self) -> int:
        return max(0, min(self.row("present_temperature").scale.encode(self.temperature), 255))

    # Motion: what the firmware commands

    def control(self, ticks: int) -> None:
        self._alarm(self.alarms)
        if not self.torque:
            self.shaft.rest()
        elif self.endless:
            speed = self.output * self.top_speed
            for _ in range(ticks):
                self.shaft.turn(speed, self.tick)
        else:
            target, speed = self._target, self._speed
            for _ in range(ticks):
                self.shaft.move_towards(target, speed, self.tick)
                if not self.shaft.velocity:
                    break

    @property
    def torque(self) -> bool:
        # Torque Limit 0 is free run, whether written or left by a shutdown (3-4-1 Max Torque).
        return self.get("torque_enable") == 1 and self.get("torque_limit") > 0

    @property
    def endless(self) -> bool:
        """Whether both angle limits are 0 (3-4-3)."""
        return self.get("cw_angle_limit") == 0 and self.get("ccw_angle_limit") == 0

    @property
    def output(self) -> float:
        """Share of full output in endless turn, with direction; at most Torque Limit."""
        if not (self.torque and self.endless):
            return 0.0
        limit = self.get("torque_limit")
        return max(-limit, min(self.get("moving_speed"), limit)) / FULL

    @property
    def present(self) -> int:
        """Position as measured: the 60° that the sensor does not cover read as the nearer end (D-63)."""
        return max(0, min(self.row("present_position").scale.encode(self._angle), FULL))

    @property
    def _angle(self) -> float:
        """Shaft angle within one turn, from the middle of the uncovered part on."""
        covered: float = self.row("present_position").decode(FULL)
        angle = self.shaft.position % TURN
        return angle if angle <= (covered + TURN) / 2 else angle - TURN

    @property
    def _target(self) -> float:
        """Where on the shaft the goal is; a shaft beyond the sensor's end counts as there (D-63)."""
        goal, covered = self.get("goal_position"), self.row("goal_position").decode(FULL)
        if not 0 <= self._angle <= covered and goal == self.present:
            return self.shaft.position
        wanted: float = self.row("goal_position").decode(goal)
        return self.shaft.position + wanted - self._angle

    @property
    def _speed(self) -> float:
        """Speed to the goal; Moving Speed 0 means as fast as it goes (3-4-2)."""
        speed: float = self.row("moving_speed").decode(abs(self.get("moving_speed")))
        return min(speed, self.top_speed) if speed else self.top_speed

    def _follow_shaft(self, *, keep_goal: bool = False) -> None:
        if self.torque:
            self._followed = None
        elif self._followed != self.present:
            self._followed = self.present
            if not keep_goal:
                self.put("goal_position", self.present)
