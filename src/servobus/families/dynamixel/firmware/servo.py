"""What the firmware of all servos with Dynamixel protocol 1.0 does: packets, control table, alarms, life.

How the shaft gets to the goal is another matter from series to series, see `compliance` and `pid`.

Section numbers are those of the RX-28 user's manual, ED entries those of docs/decisions.md, D numbers
those of docs/behaviours.md.
"""

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Protocol

from servobus.core.framing import BITS_PER_BYTE, Corrupt, Packet
from servobus.core.ids import BROADCAST
from servobus.core.registers import Register
from servobus.core.units import BaudDivisor
from servobus.families.base import Answers, blocks
from servobus.families.dynamixel.control import OVERLOAD_TIME, strained
from servobus.families.dynamixel.places import TABLE, Address
from servobus.families.dynamixel.protocol import (
    FRAMING,
    Action,
    BulkRead,
    Code,
    DriveMode,
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
from servobus.virtual.device.options import ON_OFF, Limit, OneOf, Option, Span
from servobus.virtual.device.servo import Replies, VirtualServo

OK = Error(0)

_parse = lru_cache(maxsize=16)(parse_instruction)
"""All servos of a line hear the same SYNC_WRITE."""

FLICKER = 0.5
"""s; assumption: one on and off of a light that flickers."""
HOLD = 2.0
"""s that the alarm light flickers on after recovery (3-4-1 Alarm LED)."""
BLINK = 0.25
"""s; assumption: how long the light is on at power-on (2-4 only says that it flickers once)."""
LOOK = 0.010
"""s between two looks at supply and temperature; assumption."""
STILL = 0.050
"""s after which a shaft that does not turn counts as standing; assumption."""


@dataclass(frozen=True, slots=True)
class Settings:
    """What the registers ask of the control loop, whatever its law; units are those of the registers."""

    torque: bool
    endless: bool
    goal: int
    step: float  # of the set point, position units per tick; infinite without speed control
    limit: float  # of the output, 0 .. 1
    voltages: tuple[int, int]
    hottest: int


SETTINGS = (
    "cw_angle_limit", "ccw_angle_limit", "highest_limit_temperature", "lowest_limit_voltage", "highest_limit_voltage",
    "torque_enable", "goal_position", "moving_speed", "torque_limit",
)  # fmt: skip
"""Registers of which `Settings` are made."""


class Law(Protocol):
    """What drives the shaft while the torque is on: a position in, an output out, once a tick."""

    def output(self, position: float) -> float:
        """Give the share of the supply voltage, -1 .. 1, for a shaft at a position in rad."""

    @property
    def settled(self) -> bool:
        """Whether the output stays if the shaft does."""


class Dynamixel1Servo(VirtualServo):
    """Goal Position and the shaft while the torque is off: the manual does not say what becomes of the goal.

    ROBOTIS says that it follows the shaft that is turned by hand, so that nothing jumps when the torque is
    switched on; D-58 has it that a goal written with the torque off is kept and used. Both hold here, unless an option
    says otherwise: the goal becomes the present position when the torque goes off and whenever the shaft is turned; a
    goal that is written stays until then.

    An overload can be seen only while the motor pushes. So after a shutdown its error stays until Torque Limit or
    Torque Enable is written; without a shutdown it ends when the load gives way (assumption).
    """

    tick = 0.002
    """s; assumption: the manual gives no figure for the control loop."""

    goal_torque = Option(
        ON_OFF, practice=True, manual=False, decision="ED-31",
        text="whether a write of Goal Position switches the torque on",
    )  # fmt: skip
    broadcast_ping = Option(
        OneOf(("silent", "answered")), practice="silent", manual="silent", decision="ED-19",
        text="whether a PING to id 254 is answered: by each servo in its turn, the lowest id first",
    )  # fmt: skip
    goal_after_limp = Option(
        OneOf(("present", "kept")), practice="present", manual="present", decision="ED-35",
        text="what Goal Position becomes while the torque is off: where the shaft is, or it stays as it was",
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
    overload_time = Option(
        Limit(), practice=OVERLOAD_TIME, manual=OVERLOAD_TIME, decision="ED-37",
        text="how long a load is too much before it is an overload",
    )  # fmt: skip
    answer_time = VirtualServo.answer_time.but(practice=Span(20e-6, 200e-6), decision="ED-33")
    eeprom_pause = VirtualServo.eeprom_pause.but(decision="ED-32")
    boot_time = VirtualServo.boot_time.but(decision="ED-38")

    firmware_version = 8
    """As in the answer that 3-5-8 Example 6 prints."""

    garbage_timeout = 0.1
    """Longest pause between two bytes of a packet (appendix, Byte to Byte Time)."""

    law_registers: ClassVar[tuple[str, ...]] = ()
    """Registers that the law of control asks, beside `SETTINGS`, where the model has them."""
    law_options: ClassVar[tuple[str, ...]] = ()
    """Options that the law of control asks."""

    _kept: tuple[int, bytes] | None = None
    """The write that waits for ACTION: address and bytes."""
    _followed: int | None = None
    """Position that the goal followed last; None while the torque is on."""
    _flicker_until = -math.inf
    _now: Settings
    _law: Law | None = None
    """What drives the shaft; None without torque."""
    _made_of: tuple[object, ...] = ()
    """The registers, and options, of which `_now` was made."""

    # Life

    def start(self) -> None:
        self._rows_by_address = {
            row.place.address: row for row in self.model.registers.values() if isinstance(row.place, Address)
        }
        self._reserved = [
            row for row in self._rows_by_address.values() if row.name.startswith("reserved") and row.writable
        ]
        self._open = open_while_locked(self.model)
        names = (*SETTINGS, *(name for name in self.law_registers if name in self.model.registers))
        rows = [self.row(name) for name in names]
        spans = blocks(((_address(row), row.layout.size) for row in rows), gap=0, longest=len(self.memory.space(TABLE)))
        self._sources = [slice(start, start + size) for start, size in spans]
        """Bytes of the control table of which the settings are made."""
        self._fastest: int = self.row("moving_speed").limits[1]
        self._wheel = any(0 in pair.equal for pair in self.model.limit_pairs if pair.low == "min_position")
        self._kept = self._followed = None
        self._flicker_until = -math.inf
        self._units: float = 1 / self.row("present_position").decode(1)
        """Position units per rad."""
        self._per_volt: float = 1 / self.row("present_voltage").decode(1)
        self._last: int = self.row("max_position").limits[1]
        """The largest position within a turn."""
        self._law = None
        self._moving = self._overloaded = False
        self._strained = self._stood = 0
        """Looks for which the load was too much; for which the shaft stood."""
        self._stands_at = math.nan
        self._until_look = self._period = max(1, round(LOOK / self.tick))
        self._made_of = ()
        self.set_up()
        self.put("firmware_version", self.firmware_version)
        self.put("torque_limit", self.get("max_torque"))  # 3-4-1 Max Torque
        self._listen()
        self.put("goal_position", self.present)  # D-6
        self._follow_shaft()
        self._settings()

    def advance(self, now: float) -> None:
        super().advance(now)
        if self.powered and not self._now.torque:
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
            at = _address(row) - address
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
        if written & {"torque_enable", "torque_limit"}:
            self._overloaded, self._strained = False, 0
        if written & {"torque_enable", "torque_limit", "goal_position"} or was_endless != self.endless:
            self._moving, self._stood = True, 0
        self._follow_shaft(keep_goal="goal_position" in written)

    def _sense(self) -> None:
        """Bring the registers that are measured up to date."""
        speed = self.row("present_speed").scale.encode(self.shaft.velocity)
        self._judge(self._settings())
        self.put("present_position", self.present)
        self.put("present_speed", max(-self._fastest, min(speed, self._fastest)))
        # Inferred from the output, as ROBOTIS says; the sign is the direction in which the motor pushes.
        self.put("present_load", self.row("present_load").scale.encode(self.output))
        self.put("present_voltage", self._volts)
        self.put("present_temperature", self._celsius)
        self.put("moving", int(self._moving))

    def put_within(self, name: str, value: float) -> None:
        """Set a register that is measured, at the end of its range where the value lies beyond."""
        row = self.row(name)
        low, high = row.layout.range
        self.put(name, min(max(row.scale.encode(value), low), high))

    # Alarms

    @property
    def alarms(self) -> Error:
        """What is wrong with the servo now; stands in every reply while it lasts (ED-25)."""
        return self._alarms(self._settings())

    def _alarms(self, now: Settings) -> Error:
        alarms, (lowest, highest) = OK, now.voltages
        if not lowest <= self._volts <= highest:
            alarms |= Error.INPUT_VOLTAGE
        if self._celsius > now.hottest:
            alarms |= Error.OVERHEATING
        if self._overloaded:
            alarms |= Error.OVERLOAD
        return alarms

    def _alarm(self, errors: Error, time: float) -> None:
        """Flicker and shut down as the masks say (3-4-1); a mask may name errors of a packet too (D-86)."""
        if errors & self.get("alarm_led"):
            self._flicker_until = time + HOLD
        if errors & self.get("alarm_shutdown"):
            # A write of Torque Limit ends the shutdown (3-4-1, ED-29); Torque Enable is not touched.
            self.put("torque_limit", 0)
            self._follow_shaft()

    @property
    def _volts(self) -> int:
        return min(int(self.shaft.rail.voltage * self._per_volt + 0.5), 255)

    @property
    def _celsius(self) -> int:
        return min(max(0, int(self.shaft.case + 0.5)), 255)

    # Motion: what the firmware commands

    def control(self, ticks: int) -> None:
        shaft, now = self.shaft, self._settings()
        while ticks > 0:
            count = min(ticks, self._until_look)
            if self._law is not None and not shaft.at_rest:
                count = shaft.run(count, self._law.output)
            elif not (self._hold_on() and shaft.at_rest):
                shaft.tick()
                count = 1
            else:
                # A shaft that stands, and an output that stays: then nothing happens until the next look.
                if self._idle(now):
                    count = ticks
                shaft.tick(count)
            ticks -= count
            self._until_look -= count
            if self._until_look <= 0:
                self._until_look = self._period - -self._until_look % self._period
                now = self._look(now, self.started + (self._ticks - ticks) * self.tick)

    def _hold_on(self) -> bool:
        """Drive for the next tick; tell whether the output stays if the shaft does."""
        if self._law is None:
            self.shaft.release()
            return True
        self.shaft.drive(self._law.output(self.shaft.position))
        return self._law.settled

    def _look(self, now: Settings, time: float) -> Settings:
        """Look after the slow things at a time; give the settings after that."""
        shaft = self.shaft
        if now.torque:
            self._strained = self._strained + 1 if strained(shaft.duty, now.limit, shaft.velocity) else 0
            self._overloaded = self._strained * LOOK >= self.overload_time
        self._stood = self._stood + 1 if shaft.velocity == 0 and shaft.position == self._stands_at else 0
        self._stands_at = shaft.position
        self._judge(now)
        alarms = self._alarms(now)
        if alarms is OK:
            return now
        self._alarm(alarms, time)
        return self._settings()

    def _judge(self, now: Settings) -> None:
        """Find out whether the goal has been reached."""
        if self._law is None or now.endless:
            self._moving = False
        elif self._moving and self._law.settled:
            self._moving = not self._arrived(now, standing=self._stood * LOOK >= STILL)

    def _idle(self, now: Settings) -> bool:
        """Tell whether no alarm can come up as long as nothing touches the servo."""
        shaft = self.shaft
        temperatures = shaft.case, shaft.state.winding, shaft.ambient
        cool, even = max(temperatures) < now.hottest, max(temperatures) - min(temperatures) < 0.1
        return shaft.current == 0 and (cool or even)

    def _settings(self) -> Settings:
        """Give what the registers say now."""
        table = self.memory.space(TABLE)
        made_of = *(table[part] for part in self._sources), *(getattr(self, name) for name in self.law_options)
        if made_of != self._made_of:
            self._made_of, self._now = made_of, self._read_settings()
            self._law = self._law_of(self._now) if self._now.torque else None
        return self._now

    def _common(self) -> dict[str, Any]:
        """Give the part of the settings that every law needs."""
        speed = self.get("moving_speed")
        moved: float = self.row("moving_speed").decode(abs(speed)) * self._units * self.tick
        return {
            "torque": self.torque and not self._drive_mode & DriveMode.SLAVE,
            "endless": self.endless,
            "goal": self._meant(self.get("goal_position")),
            "step": moved if speed else math.inf,  # 3-4-2: 0 is no speed control
            "limit": self._share("torque_limit"),
            "voltages": (self.get("lowest_limit_voltage"), self.get("highest_limit_voltage")),
            "hottest": self.get("highest_limit_temperature"),
        }

    def _share(self, name: str) -> float:
        """Give what a register says of the full output, 0 .. 1: its highest value is all of it, without rounding."""
        return self.get(name) / self.row(name).limits[1]

    @property
    def torque(self) -> bool:
        # Torque Limit 0 is free run, whether written or left by a shutdown (3-4-1 Max Torque).
        return self.get("torque_enable") == 1 and self.get("torque_limit") > 0

    @property
    def endless(self) -> bool:
        """Whether both angle limits are 0 (3-4-3)."""
        return self._wheel and self.get("cw_angle_limit") == 0 and self.get("ccw_angle_limit") == 0

    @property
    def goals(self) -> tuple[int, int]:
        """The lowest and the highest goal."""
        return self.get("cw_angle_limit"), self.get("ccw_angle_limit")

    @property
    def _drive_mode(self) -> int:
        return self.get("drive_mode") if "drive_mode" in self.model.registers else 0

    @property
    def output(self) -> float:
        """Share of the supply voltage at the motor, with direction."""
        return self.shaft.duty

    @property
    def present(self) -> int:
        """Position as the control table tells it."""
        return self._told(self._measure(self.shaft.position))

    # What differs from series to series

    @abstractmethod
    def set_up(self) -> None:
        """Make what the law of control needs, at power-on, before any register is asked."""

    @abstractmethod
    def _measure(self, position: float) -> int:
        """Give what the sensor tells of a shaft at a position in rad: all that the law of control knows of it."""

    def _told(self, measured: int) -> int:
        """Give the position in the control table for what the sensor tells."""
        return self._turned(measured)

    def _meant(self, goal: int) -> int:
        """Give what the sensor tells at a goal of the control table."""
        return self._turned(goal)

    def _turned(self, position: int) -> int:
        """Turn a position round where the drive mode says so; endless turn knows no such direction."""
        return self._last - position if self._drive_mode & DriveMode.REVERSE and not self.endless else position

    @abstractmethod
    def _read_settings(self) -> Settings:
        """Read from the registers what the law needs."""

    @abstractmethod
    def _law_of(self, now: Settings) -> Law:
        """Give the law that these settings ask for, tuned by them. The torque is on; the old law is in `_law`."""

    @abstractmethod
    def _arrived(self, now: Settings, *, standing: bool) -> bool:
        """Tell whether a shaft, whose set point is at the goal, has reached it, or stands as near as it gets."""

    def _follow_shaft(self, *, keep_goal: bool = False) -> None:
        if self.torque:
            self._followed = None
        elif self._followed != self.present:
            self._followed = self.present
            if not keep_goal and self.goal_after_limp == "present":
                self.put("goal_position", self.present)


def _address(row: Register[int]) -> int:
    assert isinstance(row.place, Address)
    return row.place.address
