"""The firmware of virtual HerkuleX servos: what hears, what drives the motor, and one class for each series."""

from servobus.families.herkulex.firmware.series import MagneticServo, PotentiometerServo, SmallServo
from servobus.families.herkulex.firmware.servo import HerkulexServo

__all__ = ["HerkulexServo", "MagneticServo", "PotentiometerServo", "SmallServo"]
