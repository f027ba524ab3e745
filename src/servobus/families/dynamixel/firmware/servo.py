"""What the firmware of all servos with Dynamixel protocol 1.0 does: packets, control table, alarms, life.

How the shaft gets to the goal is another matter from series to series, see `compliance` and `pid`.

Section numbers are those of the RX-28 user's manual, ED entries those of docs/decisions.md, D numbers
those of docs/behaviours.md.
"""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from servobus.families.base import blocks
from servobus.families.dynamixel.control import OVERLOAD_TIME, strained
from servobus.families.dynamixel.firmware.answering import OK, AnsweringServo, address_of
from servobus.families.dynamixel.places import TABLE
from servobus.families.dynamixel.protocol import (
    DriveMode,
    Error,
)
from servobus.virtual.device.options import Limit, OneOf, Option, Span
from servobus.virtual.device.servo import VirtualServo

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


class Dynamixel1Servo(AnsweringServo):
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

    goal_after_limp = Option(
        OneOf(("present", "kept")), practice="present", manual="present", decision="ED-35",
        text="what Goal Position becomes while the torque is off: where the shaft is, or it stays as it was",
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

    law_registers: ClassVar[tuple[str, ...]] = ()
    """Registers that the law of control asks, beside `SETTINGS`, where the model has them."""
    law_options: ClassVar[tuple[str, ...]] = ()
    """Options that the law of control asks."""

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
        self.begin_to_hear()
        names = (*SETTINGS, *(name for name in self.law_registers if name in self.model.registers))
        rows = [self.row(name) for name in names]
        spans = blocks(
            ((address_of(row), row.layout.size) for row in rows), gap=0, longest=len(self.memory.space(TABLE))
        )
        self._sources = [slice(start, start + size) for start, size in spans]
        """Bytes of the control table of which the settings are made."""
        self._fastest: int = self.row("moving_speed").limits[1]
        self._wheel = any(0 in pair.equal for pair in self.model.limit_pairs if pair.low == "min_position")
        self._followed = None
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

    def _written(self, names: set[str], *, turned: bool) -> None:
        if names & {"torque_enable", "torque_limit"}:
            self._overloaded, self._strained = False, 0
        if names & {"torque_enable", "torque_limit", "goal_position"} or turned != self.endless:
            self._moving, self._stood = True, 0
        self._follow_shaft(keep_goal="goal_position" in names)

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
