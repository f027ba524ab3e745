"""MX-12W, MX-28, MX-64 and MX-106 with the firmware that speaks protocol 1.0.

Source: ROBOTIS e-manual, pages mx-12w, mx-28, mx-64 and mx-106 (docs/en/dxl/mx). Models whose names end in T and R (TTL
and RS-485), and in AT and AR (with a metal front), have one table and report one number.
"""

from servobus.core.registers import S16, U8, Access, Area, Int, Motion, Register
from servobus.core.units import BaudDivisor, Count, Quantity, Switch, deg, ms, rpm
from servobus.families.dynamixel.models.table import DRIVE_MODE, SIGNED, U12, DynamixelTable
from servobus.families.dynamixel.places import Address
from servobus.families.dynamixel.protocol import CLOCK
from servobus.families.model import VOLTAGE_LIMITS, LimitPair, Performance, SpecSheet

EEPROM, READ, READ_WRITE = Area.EEPROM, Access.READ, Access.READ_WRITE
FAST = ((250, 2_250_000), (251, 2_500_000), (252, 3_000_000))
"""Codes of Baud Rate that do not follow the rule of the others."""
LINK = "TTL (3 pins) or RS-485 (4 pins), half duplex, 8N1, 8000 bit/s to 3 Mbit/s"


class MXTable(DynamixelTable):
    """Position 0 .. 4095 is one turn, growing counter-clockwise; further turns count on in multi-turn mode.

    Both angle limits 0 is wheel mode, in which the speed is controlled; both 4095 is multi-turn mode, with goals of
    seven turns either way (ED-48).
    """

    series = "MX"
    answers_together = True  # BULK_READ
    factory_baud = 57_600
    bauds = (*DynamixelTable.bauds, *dict(FAST).values())

    angle = Quantity("rad", 360 * deg / 4096)
    speed = Quantity("rad/s", 0.114 * rpm)
    share = DynamixelTable.share
    turn_scale = speed
    firmware = "servobus.families.dynamixel.firmware:PidServo"
    limit_pairs = (LimitPair("min_position", "max_position", equal=(0, 4095)), VOLTAGE_LIMITS)

    baud_rate = DynamixelTable.baud_rate.with_(
        scale=BaudDivisor(CLOCK, FAST), meaning="bus speed, 2000000 / (code + 1); 250 to 252 are 2.25, 2.5 and 3 Mbit/s"
    )
    cw_angle_limit = DynamixelTable.cw_angle_limit.with_(
        layout=U12, scale=angle, default=0, limits=(0, 4095), access=READ_WRITE,
        meaning="lowest goal position; wheel mode if both limits are 0, multi-turn mode if both are 4095",
        note="ED-48, ED-54",
    )  # fmt: skip
    ccw_angle_limit = DynamixelTable.ccw_angle_limit.with_(
        layout=U12, scale=angle, default=4095, limits=(0, 4095), access=READ_WRITE,
        meaning="highest goal position; wheel mode if both limits are 0, multi-turn mode if both are 4095",
        note="ED-48, ED-54",
    )  # fmt: skip
    highest_limit_temperature = DynamixelTable.highest_limit_temperature.with_(default=80)
    lowest_limit_voltage = DynamixelTable.lowest_limit_voltage.with_(default=60)
    highest_limit_voltage = DynamixelTable.highest_limit_voltage.with_(default=160, note="ED-40")
    max_torque = DynamixelTable.max_torque.with_(default=1023)
    alarm_led = DynamixelTable.alarm_led.with_(default=36)
    alarm_shutdown = DynamixelTable.alarm_shutdown.with_(default=36)
    multi_turn_offset = Register(
        Address(20), S16, Count("position unit"), "added to present_position in multi-turn mode",
        default=0, limits=(-24576, 24576), area=EEPROM, motion=Motion.ZERO,
    )  # fmt: skip
    resolution_divider = Register(
        Address(22), U8, Count(), "a unit of position is that many steps of the sensor, in multi-turn mode",
        default=1, limits=(1, 4), area=EEPROM, motion=Motion.ZERO, note="ED-48",
    )  # fmt: skip
    led = DynamixelTable.led
    d_gain = Register(Address(26), U8, Count(), "derivative gain, 4/1000 each", default=0, limits=(0, 254))
    i_gain = Register(Address(27), U8, Count(), "integral gain, 1000/2048 each", default=0, limits=(0, 254))
    p_gain = Register(Address(28), U8, Count(), "proportional gain, 1/8 each", default=32, limits=(0, 254))
    goal_position = DynamixelTable.goal_position.with_(
        layout=S16, scale=angle, limits=(-28672, 28672), access=READ_WRITE,
        meaning="target position; beyond one turn in multi-turn mode only", note="ED-54",
    )  # fmt: skip
    moving_speed = DynamixelTable.moving_speed.with_(
        scale=speed, default=0, access=READ_WRITE,
        meaning="speed to the goal, 0 is uncontrolled full speed; in wheel mode the speed with direction",
        note="ED-14: bit 10, the direction, is accepted in wheel mode only; ED-49",
    )  # fmt: skip
    torque_limit = DynamixelTable.torque_limit.with_(note="ED-29")
    present_position = DynamixelTable.present_position.with_(
        layout=S16, scale=angle, note="ED-54",
        meaning="position; in multi-turn mode that of the sensor / resolution_divider + multi_turn_offset",
    )  # fmt: skip
    present_speed = DynamixelTable.present_speed.with_(scale=speed, note="ED-49")
    lock = DynamixelTable.lock.with_(note="ED-21")
    punch = DynamixelTable.punch.with_(default=0, note="ED-44")
    realtime_tick = Register(
        Address(50), Int(2, bits=15), Quantity("s", ms), "time; wraps behind 32.767 s", default=0, access=READ
    )
    goal_acceleration = Register(
        Address(73), U8, Quantity("rad/s2", 8.583 * deg), "acceleration of moves to a goal; 0 is without limit",
        default=0, limits=(0, 254), note="ED-50",
    )  # fmt: skip


class MX12W(MXTable):
    """Geared for wheels, with another unit of speed."""

    title = "MX-12W"
    number = 360
    factory_baud = 1_000_000
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(12.0, None, 470 * rpm),),
        voltage=(10.0, 14.8),
        nominal_voltage=12.0,
        temperature=(-5.0, 70.0),
        angle=360 * deg,
        resolution=360 * deg / 4096,
        weight=0.0546,
        size=(0.032, 0.050, 0.040),
        gear_ratio=32,
        gear="engineering plastic",
        standby_current=0.060,
        link="TTL, half duplex, 8N1, 3 pins, 8000 bit/s to 3 Mbit/s",
        remarks=("The maker gives no stall torque.", "ED-51: its page prints the model number 104."),
    )

    speed = Quantity("rad/s", 0.916 * rpm)
    turn_scale = speed

    model_number = MXTable.model_number.with_(default=360, note="ED-51")
    d_gain = MXTable.d_gain.with_(default=8)
    p_gain = MXTable.p_gain.with_(default=8)
    moving_speed = MXTable.moving_speed.with_(scale=speed)
    present_speed = MXTable.present_speed.with_(scale=speed)
    punch = MXTable.punch.with_(default=32)


class MX28(MXTable):
    """The successor of the RX-28 in its case."""

    title = "MX-28"
    names = ("MX-28T", "MX-28R", "MX-28AT", "MX-28AR")
    number = 29
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(
            Performance(11.1, 2.3, 50 * rpm, 1.3),
            Performance(12.0, 2.5, 55 * rpm, 1.4),
            Performance(14.8, 3.1, 67 * rpm, 1.7),
        ),
        voltage=(10.0, 14.8),
        nominal_voltage=12.0,
        temperature=(-5.0, 80.0),
        angle=360 * deg,
        resolution=360 * deg / 4096,
        weight=0.077,
        size=(0.0356, 0.0506, 0.0355),
        gear_ratio=193,
        gear="full metal gear, metal front on AT and AR",
        motor="Maxon, coreless",
        standby_current=0.100,
        link=LINK,
        remarks=("The weight is that of AT and AR; T and R weigh 72 g.",),
    )


class CurrentTable(MXTable):
    """The rows of the MX-64 and the MX-106 for current, and for control of the torque."""

    current = Quantity("A", 0.0045, zero=2048)
    drive = Quantity("A", 0.0045)

    present_current = Register(
        Address(68), U12, current, "current; negative is clockwise", default=0, access=READ, note="ED-41"
    )
    torque_control_mode_enable = Register(
        Address(70), U8, Switch(), "torque control: goal_torque drives it, goals and speeds do not",
        default=0, limits=(0, 1), motion=Motion.MODE,
    )  # fmt: skip
    goal_torque = Register(
        Address(71), SIGNED, drive, "current in torque control, up to torque_limit; negative is clockwise",
        default=0, volatile=True, motion=Motion.SPEED,
    )  # fmt: skip


class MX64(CurrentTable):
    """With current sensor and torque control."""

    title = "MX-64"
    names = ("MX-64T", "MX-64R", "MX-64AT", "MX-64AR")
    number = 310
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(
            Performance(11.1, 5.5, 58 * rpm, 3.9),
            Performance(12.0, 6.0, 63 * rpm, 4.1),
            Performance(14.8, 7.3, 78 * rpm, 5.2),
        ),
        voltage=(10.0, 14.8),
        nominal_voltage=12.0,
        temperature=(-5.0, 80.0),
        angle=360 * deg,
        resolution=360 * deg / 4096,
        weight=0.135,
        size=(0.0402, 0.0611, 0.041),
        gear_ratio=200,
        gear="full metal gear, metal front on AT and AR",
        motor="Maxon, coreless",
        standby_current=0.100,
        link=LINK,
        remarks=("The weight is that of AT and AR; T and R weigh 126 g.",),
    )

    highest_limit_voltage = CurrentTable.highest_limit_voltage.with_(default=240)


class MX106(CurrentTable):
    """The strongest of the series; two can share a joint."""

    title = "MX-106"
    names = ("MX-106T", "MX-106R")
    number = 320
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(
            Performance(11.1, 8.0, 41 * rpm, 4.8),
            Performance(12.0, 8.4, 45 * rpm, 5.2),
            Performance(14.8, 10.0, 55 * rpm, 6.3),
        ),
        voltage=(10.0, 14.8),
        nominal_voltage=12.0,
        temperature=(-5.0, 80.0),
        angle=360 * deg,
        resolution=360 * deg / 4096,
        weight=0.153,
        size=(0.0402, 0.0651, 0.046),
        gear_ratio=225,
        gear="full metal gear, metal front",
        motor="Maxon, coreless",
        standby_current=0.100,
        link=LINK,
    )

    drive_mode = DRIVE_MODE.with_()
