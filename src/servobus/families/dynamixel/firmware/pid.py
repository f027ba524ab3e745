"""The servos whose goal is held by PID gains: the MX series with the firmware that speaks protocol 1.0.

Sources: the pages of the series in the ROBOTIS e-manual; the laws are in servobus.families.dynamixel.control.
"""

import math
from dataclasses import dataclass

from servobus.core.framing import BITS_PER_BYTE, Corrupt, Packet
from servobus.core.ids import BROADCAST
from servobus.families.base import Answers
from servobus.families.dynamixel.control import STANDSTILL, CurrentControl, Pid
from servobus.families.dynamixel.firmware.servo import Dynamixel1Servo, Law, Settings
from servobus.families.dynamixel.protocol import (
    FRAMING,
    BulkRead,
    Code,
    DriveMode,
    ReadData,
    parse_instruction,
)
from servobus.virtual.device.servo import Replies

SLACK = 0.001
"""s; assumption: how much later than its settings ask for an answer may come before it counts as missing."""


@dataclass(frozen=True, slots=True)
class PidSettings(Settings):
    """What the registers ask, with what the PID needs."""

    speed: float  # in wheel mode, units per tick with direction
    gains: tuple[int, int, int]  # P, I, D
    punch: float
    acceleration: float  # units per tick²; infinite without limit
    counts: bool  # turns, in multi-turn mode
    current: float | None  # A, the goal in torque control; None without


class PidServo(Dynamixel1Servo):
    """A contactless sensor of 4096 steps, which covers the whole turn, and a set point that moves by a profile.

    Where the e-manual says nothing, these assumptions hold.

    - Turns are counted in multi-turn mode alone, from the turn in which the shaft is as that begins, or at power-on.
    - In wheel mode the set point of the position runs ahead with the speed.
    - In torque control the current is brought to Goal Torque, and the output is not above Torque Limit.
    - Reverse mode turns the position round, not the direction of wheel mode.
    - A slave has no other servo on its cable here, so it drives nothing.
    """

    # Not an option here: the MX-64 has a register of this name.
    goal_torque = True

    law_registers = (
        "p_gain", "i_gain", "d_gain", "punch", "goal_acceleration", "multi_turn_offset", "resolution_divider",
        "torque_control_mode_enable", "goal_torque", "drive_mode",
    )  # fmt: skip

    _asked: ReadData
    _behind = BROADCAST
    """Id of the servo behind whose answer this one comes."""
    _patience = -math.inf
    """Time at which it no longer waits for that."""
    _first = 0
    """Steps at which the turn begins from which turns are counted."""
    _frame = ""
    """In which the law in use counts positions."""
    _counts = False
    """Whether turns are counted."""

    def set_up(self) -> None:
        self._whole = self._last + 1
        self._counts = False

    # Packets

    def hear(self, event: Packet | Corrupt, now: float) -> Replies:
        self.awaits_turn = False
        if isinstance(event, Packet) and event.id == BROADCAST and event.code == Code.BULK_READ:
            return self._bulk_read(event, now)
        return super().hear(event, now)

    def _bulk_read(self, packet: Packet, now: float) -> Replies:
        """Answer a BULK_READ that lists this servo: at once if it is the first, else behind the one listed before.

        An id that is listed twice counts once (e-manual, Protocol 1.0, Bulk Read). Assumption: a servo before which one
        stays silent stays silent too, once that one's time is over.
        """
        try:
            request = parse_instruction(packet)
        except ValueError:
            return []
        assert isinstance(request, BulkRead)
        reads = {read.id: read for read in reversed(request.reads)}
        before = list(dict.fromkeys(read.id for read in request.reads))
        if self.id not in reads or self.get("status_return_level") < Answers.READS:
            return []
        self._asked, before = reads[self.id], before[: before.index(self.id)]
        if not before:
            return self._answer_bulk(now)
        self.awaits_turn, self._behind = True, before[-1]
        self._patience = now + sum(self._longest_answer(reads[id].length) for id in before)
        return []

    def _longest_answer(self, length: int) -> float:
        """Give the time within which another servo has answered with so many bytes; assumption: as slow as this one."""
        delay: float = self.row("return_delay_time").decode(254)
        return delay + self.answer_time.high + SLACK + (FRAMING.overhead + length) * BITS_PER_BYTE / self.baud

    def overhear(self, packet: Packet, now: float) -> Replies:
        if now > self._patience:
            self.awaits_turn = False
        elif packet.id == self._behind:
            self.awaits_turn = False
            return self._answer_bulk(now)
        return []

    def _answer_bulk(self, now: float) -> Replies:
        error, data = self._read(self._asked.address, self._asked.length)
        if error:
            self._alarm(error, now)
        return [(self.return_delay, FRAMING.frame(Packet(self.id, error | self.alarms, data)))]

    # Position

    def _count(self, position: float) -> int:
        """Give the steps of the sensor with all turns."""
        return math.floor(position * self._units + 0.5)

    def _measure(self, position: float) -> int:
        count = self._count(position)
        return count - self._first if self._counts else count % self._whole

    def _told(self, measured: int) -> int:
        told = self._turned(measured)
        if not self._counts:
            return told
        told = math.trunc(told / self.get("resolution_divider")) + self.get("multi_turn_offset")
        low, high = self.row("present_position").layout.range
        return min(max(told, low), high)

    def _meant(self, goal: int) -> int:
        if self._counts:
            goal = (goal - self.get("multi_turn_offset")) * self.get("resolution_divider")
        return self._turned(goal)

    def _turned(self, position: int) -> int:
        if self._counts and self._drive_mode & DriveMode.REVERSE:
            return -position
        return super()._turned(position)

    # Modes

    @property
    def _torque_control(self) -> bool:
        return "goal_torque" in self.model.registers and self.get("torque_control_mode_enable") == 1

    @property
    def _multi_turn(self) -> bool:
        """Whether both angle limits are at the last position (e-manual, MX-28, CW/CCW Angle Limit)."""
        return self.get("cw_angle_limit") == self.get("ccw_angle_limit") == self._whole - 1

    @property
    def endless(self) -> bool:
        """Torque control behaves as wheel mode (e-manual, MX-64, Torque Control Mode Enable)."""
        return self._torque_control or super().endless

    @property
    def goals(self) -> tuple[int, int]:
        limits: tuple[int, int] = self.row("goal_position").limits
        return limits if self._multi_turn else super().goals

    # The law

    def _read_settings(self) -> PidSettings:
        if self._multi_turn and not self._counts:
            self._first = self._count(self.shaft.position) // self._whole * self._whole
        self._counts = self._multi_turn
        acceleration = self.row("goal_acceleration").decode(self.get("goal_acceleration")) * self._units * self.tick**2
        return PidSettings(
            **self._common(),
            speed=self.row("moving_speed").decode(self.get("moving_speed")) * self._units * self.tick,
            gains=(self.get("p_gain"), self.get("i_gain"), self.get("d_gain")),
            punch=self._share("punch"),
            acceleration=acceleration or math.inf,
            counts=self._counts,
            current=self._goal_current() if self._torque_control else None,
        )

    def _goal_current(self) -> float:
        """Give the current in A that Goal Torque asks for; Torque Limit bounds it in the same units."""
        most, raw = self.get("torque_limit"), self.get("goal_torque")
        current: float = self.row("goal_torque").decode(min(max(raw, -most), most))
        return current

    def _law_of(self, now: Settings) -> Law:
        assert isinstance(now, PidSettings)
        if now.current is not None:
            law = self._law if isinstance(self._law, CurrentControl) else CurrentControl(self._current, self.output)
            law.aim(now.current, now.limit)
            return law
        pid, frame = self._law, "turning" if now.endless else "turns" if now.counts else "turn"
        if not isinstance(pid, Pid) or frame != self._frame:
            pid = Pid(self._count if now.endless else self._measure, self.shaft.position)
        self._frame = frame
        pid.tune(now.gains, 1 / self._units, self.tick, punch=now.punch, limit=now.limit)
        if not now.endless:
            pid.aim(now.goal, now.step, now.acceleration)
        elif now.speed:
            pid.aim(math.copysign(math.inf, now.speed), abs(now.speed), math.inf)
        else:
            pid.aim(pid.set_point, 0.0, math.inf)
        return pid

    def _current(self) -> float:
        return self.shaft.current

    def _arrived(self, now: Settings, *, standing: bool) -> bool:
        """Assumption: within a step of the sensor, or where friction or a load keeps it standing."""
        error = now.goal - self._measure(self.shaft.position)
        return standing or (abs(error) <= 1 and abs(self.shaft.velocity) <= STANDSTILL)

    def _sense(self) -> None:
        super()._sense()
        self.put("realtime_tick", int((self.time - self.started) * 1000 + 1e-6) % (1 << 15))
        if "present_current" in self.model.registers:
            self.put_within("present_current", self.shaft.current)
