"""EX-106+. Source: ROBOTIS e-manual, page ex-106+ (docs/en/dxl/ex)."""

from servobus.core.registers import U16, Access, Register
from servobus.core.units import Quantity, deg, rpm
from servobus.families.dynamixel.models.compliance import ComplianceTable
from servobus.families.dynamixel.models.rx import RS485
from servobus.families.dynamixel.models.table import DRIVE_MODE, U10, U12
from servobus.families.dynamixel.places import Address
from servobus.families.model import Performance, SpecSheet


class EX106P(ComplianceTable):
    """Position 0 .. 4095 is 0° .. 251°, growing counter-clockwise."""

    title = "EX-106+"
    series = "EX"
    number = 107
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(18.5, 10.9, 91 * rpm, 7.0),),
        voltage=(12.0, 18.5),
        nominal_voltage=14.8,
        temperature=(-5.0, 80.0),
        angle=251 * deg,
        resolution=251 * deg / 4095,
        weight=0.154,
        size=(0.0402, 0.0651, 0.046),
        gear_ratio=184,
        gear="full metal gear, aluminium front case",
        motor="Maxon RE-MAX",
        standby_current=0.055,
        link=RS485,
        remarks=(
            "ED-55: another source adds 8 N·m and 69 rpm at 14.8 V, and has 6.1 A as the largest current.",
            "The EX-106 without a plus is another servo: 164:1, 280°, 6.9 N·m and 69.9 rpm at 18.5 V.",
            "The make of the motor is told by one program alone, SmartServoFramework.",
        ),
    )

    angle = Quantity("rad", 251 * deg / 4095)

    cw_angle_limit = ComplianceTable.cw_angle_limit.with_(layout=U12, scale=angle, limits=(0, 4095), note="ED-43")
    ccw_angle_limit = ComplianceTable.ccw_angle_limit.with_(
        layout=U12, scale=angle, default=4095, limits=(0, 4095), note="ED-43"
    )
    drive_mode = DRIVE_MODE.with_()
    highest_limit_temperature = ComplianceTable.highest_limit_temperature.with_(default=80)
    highest_limit_voltage = ComplianceTable.highest_limit_voltage.with_(default=240)
    goal_position = ComplianceTable.goal_position.with_(layout=U12, scale=angle, limits=(0, 4095), note="ED-43")
    present_position = ComplianceTable.present_position.with_(
        layout=U16, scale=angle, meaning="position; counts on and wraps at 65535 in endless turn", note="ED-43"
    )
    punch = ComplianceTable.punch.with_(default=0)
    sensed_current = Register(
        Address(56), U10, Quantity("A", 0.01, zero=512), "current; negative is counter-clockwise",
        access=Access.READ, note="ED-42",
    )  # fmt: skip
