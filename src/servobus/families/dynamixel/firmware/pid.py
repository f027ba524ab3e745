"""The servos whose goal is held by PID gains: the MX series with the firmware that speaks protocol 1.0.

Sources: the pages of the series in the ROBOTIS e-manual; the laws are in servobus.families.dynamixel.control.
"""

import math
from dataclasses import dataclass

from servobus.families.dynamixel.control import STANDSTILL, CurrentControl, Pid
from servobus.families.dynamixel.firmware.servo import Dynamixel1Servo, Law, Settings

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

    law_registers = (
        "p_gain", "i_gain", "d_gain", "punch", "goal_acceleration", "multi_turn_offset", "resolution_divider",
        "torque_control_mode_enable", "goal_torque", "drive_mode",
    )  # fmt: skip

    _turn = 0
    """Steps at which the turn begins from which turns are counted."""
    _frame = ""
    """In which the law in use counts positions."""
    _counts = False
    """Whether turns are counted."""

    def set_up(self) -> None:
        self._whole = self._last + 1
        self._counts = False

    # Position

    def _count(self, position: float) -> int:
        """Give the steps of the sensor with all turns."""
        return math.floor(position * self._units + 0.5)

    def _measure(self, position: float) -> int:
        count = self._count(position)
        return count - self._turn if self._counts else count % self._whole

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
            self._turn = self._count(self.shaft.position) // self._whole * self._whole
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
        return standing or abs(self.shaft.velocity) <= STANDSTILL

    def _sense(self) -> None:
        super()._sense()
        self.put("realtime_tick", int((self.time - self.started) * 1000 + 1e-6) % (1 << 15))
        if "present_current" in self.model.registers:
            self.put_within("present_current", self.shaft.current)
