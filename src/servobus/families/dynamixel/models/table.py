"""What all models of Dynamixel protocol 1.0 share, and the servo of which nothing more is known.

Sources: RX-28 user's manual, section 3-4; the control tables of AX-12A, AX-18A, RX-10 to RX-64, EX-106+, MX-12W to
MX-106 and DX-113 to DX-117 in the ROBOTIS e-manual have these rows at the same addresses, with the same sizes.
"""

from typing import ClassVar

from servobus.core.registers import U8, U16, Access, Area, Int, Motion, Register
from servobus.core.units import RAW, Count, Flags, Quantity, Switch
from servobus.families.dynamixel.places import Address
from servobus.families.dynamixel.protocol import BAUD, DriveMode, Error
from servobus.families.dynamixel.verbs import DYNAMIXEL1
from servobus.families.model import VOLTAGE_LIMITS, LimitPair, Model

EEPROM, READ = Area.EEPROM, Access.READ
U10 = Int(2, bits=10)
"""A value of 0 .. 1023: the upper six bits of its two bytes are 0 (RX-28 manual 3-4)."""
U12 = Int(2, bits=12)
"""A value of 0 .. 4095."""
SIGNED = Int(2, sign_bit=10)
"""Magnitude in bits 0 to 9, direction in bit 10."""


DRIVE_MODE = Register(
    Address(10), U8, Flags(DriveMode), "direction of goals and positions; part in a dual joint",
    default=0, limits=(0, 3), area=EEPROM, motion=Motion.ZERO, note="ED-47",
)  # fmt: skip
"""The row of EX-106+ and MX-106."""


class DynamixelTable(Model):
    """Rows of all models. Angles and speeds have another unit from model to model: 300/1023°, 360/4096°, 251/4095°."""

    family = DYNAMIXEL1
    motors = "servobus.families.dynamixel.motors:MOTORS"
    # Table in RX-28 manual 3-4-1, plus the codes in use elsewhere in the field; most likely first.
    bauds: ClassVar[tuple[int, ...]] = (57_600, 1_000_000, 115_200, 500_000, 200_000, 250_000, 400_000, 19_200, 9_600)

    share = Quantity("1", 1 / 1023)
    limit_pairs = (LimitPair("min_position", "max_position", equal=(0,)), VOLTAGE_LIMITS)  # 3-4-3: endless turn
    volts = Quantity("V", 0.1)
    celsius = Quantity("degC", 1.0)
    errors = Flags(Error)

    model_number = Register(Address(0), U16, Count(), "model number", access=READ, area=EEPROM)
    firmware_version = Register(Address(2), U8, Count(), "firmware version", access=READ, area=EEPROM)
    id = Register(Address(3), U8, Count(), "bus id", default=1, limits=(0, 253), area=EEPROM, note="ED-39")
    baud_rate = Register(Address(4), U8, BAUD, "bus speed, 2000000 / (code + 1)", limits=(0, 254), area=EEPROM)
    return_delay_time = Register(
        Address(5), U8, Quantity("s", 2e-6), "delay before a status packet", default=250, limits=(0, 254), area=EEPROM
    )
    cw_angle_limit = Register(
        Address(6), U16, RAW, "lowest goal position; 0 with the other limit 0 is endless turn",
        access=READ, area=EEPROM, motion=Motion.LIMIT,
    )  # fmt: skip
    ccw_angle_limit = Register(
        Address(8), U16, RAW, "highest goal position; 0 with the other limit 0 is endless turn",
        access=READ, area=EEPROM, motion=Motion.LIMIT,
    )  # fmt: skip
    highest_limit_temperature = Register(
        Address(11), U8, celsius, "temperature above which overheating is reported", limits=(0, 100), area=EEPROM,
        note="ED-46",
    )  # fmt: skip
    lowest_limit_voltage = Register(
        Address(12), U8, volts, "supply below which a voltage error is reported", limits=(50, 250), area=EEPROM
    )
    highest_limit_voltage = Register(
        Address(13), U8, volts, "supply above which a voltage error is reported", limits=(50, 250), area=EEPROM
    )
    max_torque = Register(
        Address(14), U10, share, "torque limit at power-on; 0 is free run", limits=(0, 1023), area=EEPROM
    )
    status_return_level = Register(
        Address(16), U8, Count(), "which instructions are answered: 0 PING, 1 reads, 2 all",
        default=2, limits=(0, 2), area=EEPROM,
    )  # fmt: skip
    alarm_led = Register(Address(17), U8, errors, "errors that make the LED flicker", limits=(0, 127), area=EEPROM)
    alarm_shutdown = Register(
        Address(18), U8, errors, "errors that switch the torque off", limits=(0, 127), area=EEPROM
    )
    torque_enable = Register(Address(24), U8, Switch(), "torque on or off", default=0, limits=(0, 1))
    led = Register(Address(25), U8, Switch(), "light on or off", default=0, limits=(0, 1))
    goal_position = Register(
        Address(30), U16, RAW, "target position", access=READ, volatile=True,
        motion=Motion.GOAL,
    )  # fmt: skip
    moving_speed = Register(
        Address(32), SIGNED, RAW,
        "speed to the goal, 0 is uncontrolled full speed; in endless turn a speed or a share of full output",
        access=READ, volatile=True, motion=Motion.SPEED,
    )  # fmt: skip
    torque_limit = Register(
        Address(34), U10, share, "torque limit in use; starts as max_torque, 0 after a shutdown", limits=(0, 1023),
        volatile=True, motion=Motion.STRENGTH,
    )  # fmt: skip
    present_position = Register(Address(36), U16, RAW, "position", access=READ)
    present_speed = Register(Address(38), SIGNED, RAW, "speed; negative is clockwise", access=READ)
    present_load = Register(
        Address(40), SIGNED, share, "load as a share of full torque; negative is clockwise", access=READ
    )
    present_voltage = Register(Address(42), U8, volts, "supply voltage", access=READ)
    present_temperature = Register(Address(43), U8, celsius, "internal temperature", access=READ)
    registered_instruction = Register(
        Address(44), U8, Switch(), "on while a REG_WRITE waits for ACTION", default=0, limits=(0, 1), access=READ,
        volatile=True,
    )  # fmt: skip
    moving = Register(Address(46), U8, Switch(), "on while moving to a goal", default=0, access=READ)
    lock = Register(
        Address(47), U8, Switch(), "on: only addresses 24 to 35 can be written until power-off",
        default=0, limits=(0, 1),
    )  # fmt: skip
    punch = Register(Address(48), U10, share, "lowest torque of the control", default=32, limits=(0, 1023))

    # The names that all families share, see servobus.families.model.
    baud = baud_rate
    answer_level = status_return_level
    min_position = cw_angle_limit
    max_position = ccw_angle_limit
    min_voltage = lowest_limit_voltage
    max_voltage = highest_limit_voltage
    max_temperature = highest_limit_temperature
    goal_speed = moving_speed
    output_limit = torque_limit


class UnknownDynamixel(DynamixelTable):
    """A servo that speaks protocol 1.0, of a model that is not known: what it has is what all models have."""

    title = "Dynamixel servo, model unknown"
    generic = True
    number = None
    factory_baud = 57_600

    @classmethod
    def key(cls) -> str:
        return "dynamixel"
