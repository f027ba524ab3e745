"""RX-28. Source: RX-28 user's manual, section 3-4 (control table) and 1-3 (specification)."""

from servobus.core.registers import U8, Access, Area, Int, Register
from servobus.core.units import Count, Quantity, deg, rpm
from servobus.families.dynamixel.models.table import U10, DynamixelTable
from servobus.families.dynamixel.places import Address
from servobus.families.model import Performance, SpecSheet

EEPROM, RESERVED, READ_WRITE = Area.EEPROM, Access.RESERVED, Access.READ_WRITE
KGF_CM = 0.0980665
"""One kgf·cm in N·m."""


class RX28(DynamixelTable):
    """Position 0 .. 1023 is 0° .. 300°, growing counter-clockwise; the 60° between the ends are not measured."""

    title = "RX-28"
    series = "RX"
    number = 28
    factory_baud = 57_600
    firmware = "servobus.families.dynamixel.firmware:ComplianceServo"
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
    share = DynamixelTable.share
    turn_scale = share
    steps = Count("position unit")

    return_delay_time = DynamixelTable.return_delay_time.with_(
        note="ED-08: 500 µs as in 3-4-1, not the 160 µs of the appendix"
    )
    cw_angle_limit = DynamixelTable.cw_angle_limit.with_(
        layout=U10, scale=angle, default=0, limits=(0, 1023), access=READ_WRITE
    )
    ccw_angle_limit = DynamixelTable.ccw_angle_limit.with_(
        layout=U10, scale=angle, default=1023, limits=(0, 1023), access=READ_WRITE
    )
    reserved_10 = Register(
        Address(10), U8, Count(), "not in the manual's table", access=RESERVED, area=EEPROM, note="ED-22: reads 0"
    )
    highest_limit_temperature = DynamixelTable.highest_limit_temperature.with_(
        default=80, note="ED-11: 10 is 0x0A, printed as 0x10"
    )
    lowest_limit_voltage = DynamixelTable.lowest_limit_voltage.with_(default=60, note="ED-10")
    highest_limit_voltage = DynamixelTable.highest_limit_voltage.with_(
        default=240, note="ED-10, ED-12: 24.0 V as in the manual at hand"
    )
    max_torque = DynamixelTable.max_torque.with_(default=1023)
    alarm_led = DynamixelTable.alarm_led.with_(default=36)
    alarm_shutdown = DynamixelTable.alarm_shutdown.with_(default=36)
    reserved_19 = Register(
        Address(19), U8, Count(), "only in the manual's range table, no effect", default=0, limits=(0, 1), area=EEPROM,
        note="ED-22: accepts 0 and 1",
    )  # fmt: skip
    reserved_20 = Register(
        Address(20), Int(4), Count(), "not in the manual's table", access=RESERVED, area=EEPROM, note="ED-22: reads 0"
    )
    led = DynamixelTable.led
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
    goal_position = DynamixelTable.goal_position.with_(layout=U10, scale=angle, limits=(0, 1023), access=READ_WRITE)
    moving_speed = DynamixelTable.moving_speed.with_(
        scale=speed,
        meaning="speed to the goal, 0 is uncontrolled full speed; in endless turn a share of full output with "
        "direction",
        default=0, access=READ_WRITE,
        note="ED-14: bit 10, the direction, is accepted in endless turn only",
    )  # fmt: skip
    torque_limit = DynamixelTable.torque_limit.with_(note="ED-29")
    present_position = DynamixelTable.present_position.with_(layout=U10, scale=angle)
    present_speed = DynamixelTable.present_speed.with_(
        scale=speed, note="ED-15: direction in bit 10, as in present_load"
    )
    registered_instruction = DynamixelTable.registered_instruction.with_(access=READ_WRITE, note="ED-16")
    reserved_45 = Register(
        Address(45), U8, Count(), "not in the manual's table", access=RESERVED, note="ED-22: reads 0"
    )
    lock = DynamixelTable.lock.with_(note="ED-21")
    punch = DynamixelTable.punch.with_(meaning="lowest torque inside the compliance slope")
