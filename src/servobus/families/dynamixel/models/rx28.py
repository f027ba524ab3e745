"""RX-28. Source: RX-28 user's manual, section 3-4 (control table) and 1-3 (specification)."""

from servobus.core.registers import U8, U16, Access, Area, Int, Motion, Register
from servobus.core.units import Count, Flags, Quantity, Switch, deg, rpm
from servobus.families.dynamixel.places import Address
from servobus.families.dynamixel.protocol import BAUD, Error
from servobus.families.dynamixel.verbs import DYNAMIXEL1
from servobus.families.model import VOLTAGE_LIMITS, LimitPair, Model, Performance, SpecSheet

EEPROM, READ, RESERVED = Area.EEPROM, Access.READ, Access.RESERVED
U10 = Int(2, bits=10)
"""A value of 0 .. 1023: the upper six bits of its two bytes are 0 (manual 3-4)."""
KGF_CM = 0.0980665
"""One kgf·cm in N·m."""


class RX28(Model):
    """Position 0 .. 1023 is 0° .. 300°, growing counter-clockwise; the 60° between the ends are not measured."""

    title = "RX-28"
    family = DYNAMIXEL1
    number = 28
    factory_baud = 57_600
    # Table in manual 3-4-1, plus the codes in use elsewhere in the field; most likely first.
    bauds = (57_600, 1_000_000, 115_200, 500_000, 200_000, 250_000, 400_000, 19_200, 9_600)
    firmware = "servobus.families.dynamixel.firmware:Dynamixel1Servo"
    motors = "servobus.families.dynamixel.motors:RX28_SETS"
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(
            Performance(12.0, 28.3 * KGF_CM, 60 * deg / 0.167),
            Performance(16.0, 37.7 * KGF_CM, 60 * deg / 0.126),
        ),
        voltage=(12.0, 16.0),
        nominal_voltage=14.4,
        temperature=(-5.0, 85.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.072,
        size=(0.0356, 0.0506, 0.0355),
        gear_ratio=193,
        gear="full metal gear, engineering plastic body",
        motor="Maxon RE-MAX",
        standby_current=0.050,
        max_current=1.2,
        link="RS-485, half duplex, 8N1, 7843 bit/s to 1 Mbit/s (ED-09)",
    )

    angle = Quantity("rad", 300 * deg / 1023)
    speed = Quantity("rad/s", 0.111 * rpm)
    share = Quantity("1", 1 / 1023)
    turn_scale = share
    limit_pairs = (LimitPair("min_position", "max_position", both_zero=True), VOLTAGE_LIMITS)  # 3-4-3: endless turn
    volts = Quantity("V", 0.1)
    celsius = Quantity("degC", 1.0)
    errors = Flags(Error)
    steps = Count("position unit")

    model_number = Register(Address(0), U16, Count(), "model number", default=28, access=READ, area=EEPROM)
    firmware_version = Register(Address(2), U8, Count(), "firmware version", access=READ, area=EEPROM)
    id = Register(Address(3), U8, Count(), "bus id", default=1, limits=(0, 253), area=EEPROM)
    baud_rate = Register(
        Address(4), U8, BAUD, "bus speed, 2000000 / (code + 1)", default=34, limits=(0, 254), area=EEPROM
    )
    return_delay_time = Register(
        Address(5), U8, Quantity("s", 2e-6), "delay before a status packet", default=250, limits=(0, 254), area=EEPROM,
        note="ED-08: 500 µs as in 3-4-1, not the 160 µs of the appendix",
    )  # fmt: skip
    cw_angle_limit = Register(
        Address(6), U10, angle, "lowest goal position; 0 with the other limit 0 is endless turn",
        default=0, limits=(0, 1023), area=EEPROM, motion=Motion.LIMIT,
    )  # fmt: skip
    ccw_angle_limit = Register(
        Address(8), U10, angle, "highest goal position; 0 with the other limit 0 is endless turn",
        default=1023, limits=(0, 1023), area=EEPROM, motion=Motion.LIMIT,
    )  # fmt: skip
    reserved_10 = Register(
        Address(10),
        U8,
        Count(),
        "not in the manual's table",
        access=RESERVED,
        area=EEPROM,
        note="ED-22: reads 0",
    )
    highest_limit_temperature = Register(
        Address(11), U8, celsius, "temperature above which overheating is reported",
        default=80, limits=(10, 99), area=EEPROM, note="ED-11: 10 is 0x0A, printed as 0x10",
    )  # fmt: skip
    lowest_limit_voltage = Register(
        Address(12), U8, volts, "supply below which a voltage error is reported",
        default=60, limits=(50, 250), area=EEPROM, note="ED-10",
    )  # fmt: skip
    highest_limit_voltage = Register(
        Address(13), U8, volts, "supply above which a voltage error is reported",
        default=240, limits=(50, 250), area=EEPROM, note="ED-10, ED-12: 24.0 V as in the manual at hand",
    )  # fmt: skip
    max_torque = Register(
        Address(14),
        U10,
        share,
        "torque limit at power-on; 0 is free run",
        default=1023,
        limits=(0, 1023),
        area=EEPROM,
    )
    status_return_level = Register(
        Address(16), U8, Count(), "which instructions are answered: 0 PING, 1 reads, 2 all",
        default=2, limits=(0, 2), area=EEPROM,
    )  # fmt: skip
    alarm_led = Register(
        Address(17), U8, errors, "errors that make the LED flicker", default=36, limits=(0, 127), area=EEPROM
    )
    alarm_shutdown = Register(
        Address(18), U8, errors, "errors that switch the torque off", default=36, limits=(0, 127), area=EEPROM
    )
    reserved_19 = Register(
        Address(19), U8, Count(), "only in the manual's range table, no effect", default=0, limits=(0, 1), area=EEPROM,
        note="ED-22: accepts 0 and 1",
    )  # fmt: skip
    reserved_20 = Register(
        Address(20),
        Int(4),
        Count(),
        "not in the manual's table",
        access=RESERVED,
        area=EEPROM,
        note="ED-22: reads 0",
    )
    torque_enable = Register(Address(24), U8, Switch(), "torque on or off", default=0, limits=(0, 1))
    led = Register(Address(25), U8, Switch(), "light on or off", default=0, limits=(0, 1))
    cw_compliance_margin = Register(
        Address(26), U8, steps, "error without torque, clockwise side", default=0, limits=(0, 254)
    )
    ccw_compliance_margin = Register(
        Address(27), U8, steps, "error without torque, counter-clockwise side", default=0, limits=(0, 254)
    )
    cw_compliance_slope = Register(
        Address(28), U8, steps, "width over which torque falls, clockwise side; acts in seven levels",
        default=32, limits=(1, 254), note="ED-13, ED-17",
    )  # fmt: skip
    ccw_compliance_slope = Register(
        Address(29), U8, steps, "width over which torque falls, counter-clockwise side; acts in seven levels",
        default=32, limits=(1, 254), note="ED-13, ED-17",
    )  # fmt: skip
    goal_position = Register(
        Address(30), U10, angle, "target position", limits=(0, 1023), volatile=True, motion=Motion.GOAL
    )
    moving_speed = Register(
        Address(32), Int(2, sign_bit=10), speed,
        "speed to the goal, 0 is uncontrolled full speed; in endless turn a share of full output with direction",
        default=0, limits=(-1023, 1023), volatile=True, motion=Motion.SPEED,
        note="ED-14: bit 10, the direction, is accepted in endless turn only",
    )  # fmt: skip
    torque_limit = Register(
        Address(34), U10, share, "torque limit in use; starts as max_torque, 0 after a shutdown", limits=(0, 1023),
        volatile=True, motion=Motion.STRENGTH, note="ED-29",
    )  # fmt: skip
    present_position = Register(Address(36), U10, angle, "position", access=READ)
    present_speed = Register(
        Address(38), Int(2, sign_bit=10), speed, "speed; negative is clockwise", access=READ,
        note="ED-15: direction in bit 10, as in present_load",
    )  # fmt: skip
    present_load = Register(
        Address(40),
        Int(2, sign_bit=10),
        share,
        "load as a share of full torque; negative is clockwise",
        access=READ,
    )
    present_voltage = Register(Address(42), U8, volts, "supply voltage", access=READ)
    present_temperature = Register(Address(43), U8, celsius, "internal temperature", access=READ)
    registered_instruction = Register(
        Address(44),
        U8,
        Switch(),
        "on while a REG_WRITE waits for ACTION",
        default=0,
        limits=(0, 1),
        volatile=True,
        note="ED-16",
    )
    reserved_45 = Register(
        Address(45), U8, Count(), "not in the manual's table", access=RESERVED, note="ED-22: reads 0"
    )
    moving = Register(Address(46), U8, Switch(), "on while moving to a goal", default=0, access=READ)
    lock = Register(
        Address(47), U8, Switch(), "on: only addresses 24 to 35 can be written until power-off",
        default=0, limits=(0, 1), note="ED-21",
    )  # fmt: skip
    punch = Register(
        Address(48), U10, share, "lowest torque inside the compliance slope", default=32, limits=(0, 1023),
    )  # fmt: skip

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
