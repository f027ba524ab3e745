"""What AX, RX, DX and EX servos share beside what all have: compliance, and a potentiometer that covers part of a turn.

Sources: the control tables of AX-12A, AX-12W, AX-18A, RX-10, RX-24F, RX-28, RX-64, EX-106+, DX-113, DX-116 and DX-117
in the ROBOTIS e-manual; RX-28 user's manual, section 3-4.
"""

from servobus.core.registers import U8, Access, Register
from servobus.core.units import Count, Quantity, deg, rpm
from servobus.families.dynamixel.models.table import U10, DynamixelTable
from servobus.families.dynamixel.places import Address

READ_WRITE = Access.READ_WRITE


class ComplianceTable(DynamixelTable):
    """Position 0 .. 1023 is 0° .. 300°, growing counter-clockwise; the 60° between the ends are not measured."""

    factory_baud = 57_600
    firmware = "servobus.families.dynamixel.firmware:ComplianceServo"

    angle = Quantity("rad", 300 * deg / 1023)
    speed = Quantity("rad/s", 0.111 * rpm)
    share = DynamixelTable.share
    turn_scale = share
    steps = Count("position unit")

    cw_angle_limit = DynamixelTable.cw_angle_limit.with_(
        layout=U10, scale=angle, default=0, limits=(0, 1023), access=READ_WRITE
    )
    ccw_angle_limit = DynamixelTable.ccw_angle_limit.with_(
        layout=U10, scale=angle, default=1023, limits=(0, 1023), access=READ_WRITE
    )
    lowest_limit_voltage = DynamixelTable.lowest_limit_voltage.with_(default=60)
    highest_limit_voltage = DynamixelTable.highest_limit_voltage.with_(default=190)
    max_torque = DynamixelTable.max_torque.with_(default=1023)
    alarm_led = DynamixelTable.alarm_led.with_(default=36)
    alarm_shutdown = DynamixelTable.alarm_shutdown.with_(default=36)
    led = DynamixelTable.led
    cw_compliance_margin = Register(
        Address(26), U8, steps, "error without torque, clockwise side", default=1, limits=(0, 254), note="ED-45"
    )
    ccw_compliance_margin = Register(
        Address(27), U8, steps, "error without torque, counter-clockwise side", default=1, limits=(0, 254),
        note="ED-45",
    )  # fmt: skip
    cw_compliance_slope = Register(
        Address(28), U8, steps, "width over which torque falls, clockwise side; acts in seven levels",
        default=32, limits=(0, 254), note="ED-13, ED-17, ED-45",
    )  # fmt: skip
    ccw_compliance_slope = Register(
        Address(29), U8, steps, "width over which torque falls, counter-clockwise side; acts in seven levels",
        default=32, limits=(0, 254), note="ED-13, ED-17, ED-45",
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
    lock = DynamixelTable.lock.with_(note="ED-21")
    punch = DynamixelTable.punch.with_(meaning="lowest torque inside the compliance slope", note="ED-44")
