"""The servos whose goal is held by compliance: AX, RX, EX and DX series.

Section numbers are those of the RX-28 user's manual; the laws are in servobus.families.dynamixel.control.
"""

import math
from dataclasses import dataclass

from servobus.families.dynamixel.control import EMANUAL_LEVELS, LEVELS, Approach, Steady, arrived, endless, width
from servobus.families.dynamixel.firmware.servo import Dynamixel1Servo, Law, Settings
from servobus.virtual.device.options import OneOf, Option


@dataclass(frozen=True, slots=True)
class ComplianceSettings(Settings):
    """What the registers ask, with what compliance needs."""

    share: float  # Moving Speed in endless turn, as output
    punch: float
    cw: tuple[int, int]  # margin and slope on the clockwise side of the goal
    ccw: tuple[int, int]


class ComplianceServo(Dynamixel1Servo):
    """Output over the distance to the goal by margin, slope and punch; endless turn by output, without speed control.

    The potentiometer does not cover a whole turn: what lies between its ends reads as the nearer one.
    """

    slope_levels = Option(
        OneOf(("manual", "online")), practice="manual", manual="manual", decision="ED-13",
        text="what Compliance Slope acts as: by the table of the manual, or by that of the online manual",
    )  # fmt: skip
    compliance_sides = Option(
        OneOf(("named", "swapped")), practice="named", manual="named", decision="ED-17",
        text="on which side of the goal the clockwise margin and slope act: as they are named, or on the other one",
    )  # fmt: skip

    law_registers = (
        "cw_compliance_margin", "ccw_compliance_margin", "cw_compliance_slope", "ccw_compliance_slope", "punch",
        "drive_mode",
    )  # fmt: skip
    law_options = ("slope_levels", "compliance_sides")

    def set_up(self) -> None:
        self._whole = 2 * math.pi * self._units
        self._approach = Approach(self._measure)

    def _measure(self, position: float) -> int:
        """Give the position; a goal at an end of the sensor counts as reached beyond (D-63)."""
        units = position * self._units
        if not 0 <= units < self._last:
            units %= self._whole
            if units > self._last:
                return self._last if units < (self._last + self._whole) / 2 else 0
        return int(units + 0.5)

    def _told(self, measured: int) -> int:
        """Give the position; an EX-106+ counts on in endless turn (e-manual, Present Position)."""
        highest = self.row("present_position").layout.range[1]
        if self.endless and highest > self._last:
            return math.floor(self.shaft.position * self._units + 0.5) % (highest + 1)
        return super()._told(measured)

    def _sense(self) -> None:
        super()._sense()
        if "sensed_current" in self.model.registers:
            self.put_within("sensed_current", -self.shaft.current)  # ED-42: below the middle is counter-clockwise

    def _read_settings(self) -> ComplianceSettings:
        levels = LEVELS if self.slope_levels == "manual" else EMANUAL_LEVELS
        cw, ccw = [
            (self.get(f"{side}_compliance_margin"), width(self.get(f"{side}_compliance_slope"), levels))
            for side in (("ccw", "cw") if self.compliance_sides == "swapped" else ("cw", "ccw"))
        ]
        return ComplianceSettings(
            **self._common(),
            share=max(-1.0, min(self.model.turn_scale.decode(self.get("moving_speed")), 1.0)),
            punch=self._share("punch"),
            cw=cw,
            ccw=ccw,
        )

    def _law_of(self, now: Settings) -> Law:
        assert isinstance(now, ComplianceSettings)
        if now.endless:
            return Steady(endless(now.share, now.limit))
        self._approach.tune(now.goal, now.step, now.cw, now.ccw, now.punch, now.limit)
        if self._law is not self._approach:
            self._approach.set_point = self._measure(self.shaft.position)
        return self._approach

    def _arrived(self, now: Settings, *, standing: bool) -> bool:
        assert isinstance(now, ComplianceSettings)
        error = now.goal - self._measure(self.shaft.position)
        return arrived(error, *(now.cw if error > 0 else now.ccw), self.shaft.velocity, standing)
