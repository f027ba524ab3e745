"""The firmware of HerkuleX servos by series: the sensor of the position, and what endless turn controls.

Section and register (NO) numbers are those of the DRS-0602 user's manual, EH entries those of docs/decisions.md, H
numbers those of docs/behaviours.md.
"""

import math

from servobus.core.units import deg
from servobus.families.herkulex.control import MagneticEncoder, Potentiometer
from servobus.families.herkulex.firmware.servo import HerkulexServo
from servobus.families.herkulex.protocol import TICK, Aux
from servobus.virtual.device.options import OneOf, Option

WINDOW = 160 * deg
"""How far from the middle the second sensor reaches: 320 degrees in all (2-2; which, is assumption EH-37)."""
SET_TO = {Aux.MINUS_180: -180 * deg, Aux.CENTRE: 0.0, Aux.PLUS_180: 180 * deg}
"""What angle the choices of Aux 1 set Absolute Position to (NO 45); RAW_0 and RAW_32767 are its ends."""


class MagneticServo(HerkulexServo):
    """DRS-0402 and 0602: a magnetic encoder that counts turns, and a potentiometer that finds it at power-on (H-4)."""

    overload_step = Option(
        OneOf(("4ms", "11.2ms")), practice="4ms", manual="4ms", decision="EH-08",
        text="what one step of Overload Detection Period is",
    )  # fmt: skip

    sensor = MagneticEncoder

    def _find(self) -> None:
        self._place(Aux.POTENTIOMETER)  # H-4

    @property
    def _potentiometer(self) -> float:
        """Angle within one turn. The 40 degrees it does not cover read as the nearer end (assumption)."""
        angle = math.remainder(self.shaft.position, math.tau)
        return max(-WINDOW, min(angle, WINDOW))

    def _overload_period(self) -> float:
        if self.overload_step == "11.2ms":
            return self.get("overload_detection_period") * TICK
        return super()._overload_period()

    def _speed_gains(self) -> tuple[int, int]:
        return self.get("velocity_kp"), self.get("velocity_ki")

    def _settle(self) -> None:
        choice = Aux(self.get("aux_1"))
        if choice is not Aux.NOTHING:
            self.put("aux_1", Aux.NOTHING)  # H-104
            self._place(choice)
        super()._settle()

    def _sense(self) -> None:
        super()._sense()
        self._measured("absolute_2nd_position", self._potentiometer)

    def _place(self, choice: Aux) -> None:
        """Set Absolute Position anew (NO 45)."""
        if choice in (Aux.RAW_0, Aux.RAW_32767):
            steps: float = 0 if choice is Aux.RAW_0 else self._counter.size - 1
        elif choice in SET_TO:
            steps = self.row("absolute_position").scale.encode(SET_TO[choice])
        else:
            steps = self._potentiometer / self._counter.step + self._counter.zero
        self._counter.place(self.shaft.position, steps)


class PotentiometerServo(HerkulexServo):
    """DRS-0401 and 0601: a potentiometer alone, which cannot tell one turn from the next."""

    sensor = Potentiometer


class SmallServo(PotentiometerServo):
    """DRS-0101 and 0201: endless turn by a share of the full output, without control of the speed (EH-57)."""

    position_marks = 0x6000  # EH-44

    def _turn_output(self) -> float:
        return self._trajectory.speed * self._full  # the plan is one of output

    def _in_turn(self, speed: float) -> float:
        return speed / self.top_speed if self.top_speed else 0.0

    @property
    def _planned_speed(self) -> float:
        """While it turns without end, the speed that it has at that output without load (assumption)."""
        if self._trajectory.position is None:
            return self._trajectory.speed * self.top_speed
        return super()._planned_speed
