"""The firmware of virtual servos with Dynamixel protocol 1.0: one base, and one class for each law of control."""

from servobus.families.dynamixel.firmware.compliance import ComplianceServo
from servobus.families.dynamixel.firmware.pid import PidServo
from servobus.families.dynamixel.firmware.servo import Dynamixel1Servo

__all__ = ["ComplianceServo", "Dynamixel1Servo", "PidServo"]
