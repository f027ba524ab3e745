"""DX-113, DX-116 and DX-117. Source: ROBOTIS e-manual, pages dx-113, dx-116 and dx-117 (docs/en/dxl/dx)."""

from servobus.core.units import deg, rpm
from servobus.families.dynamixel.models.compliance import ComplianceTable
from servobus.families.dynamixel.models.rx import METAL, RS485
from servobus.families.model import VOLTAGE_LIMITS, LimitPair, Performance, SpecSheet


class DXTable(ComplianceTable):
    """Rows of the DX series, which cannot turn without end: both limits at 0 leave one goal, 0."""

    series = "DX"
    turns = False
    limit_pairs = (LimitPair("min_position", "max_position"), VOLTAGE_LIMITS)

    highest_limit_temperature = ComplianceTable.highest_limit_temperature.with_(default=85)
    moving_speed = ComplianceTable.moving_speed.with_(
        meaning="speed to the goal, 0 is uncontrolled full speed", limits=(0, 1023), note=""
    )


class DX113(DXTable):
    """For 12 V."""

    title = "DX-113"
    number = 113
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(12.0, 1.0, 54 * rpm),),
        voltage=(9.0, 12.0),
        nominal_voltage=11.1,
        temperature=(-5.0, 85.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.058,
        size=(0.031, 0.046, 0.037),
        gear_ratio=192.6,
        gear=METAL,
        link=RS485,
    )

    cw_compliance_margin = DXTable.cw_compliance_margin.with_(default=0)
    ccw_compliance_margin = DXTable.ccw_compliance_margin.with_(default=0)


class DX116(DXTable):
    """Faster than the DX-117, and weaker."""

    title = "DX-116"
    number = 116
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(12.0, 2.1), Performance(16.0, 2.9)),
        voltage=(12.0, 16.0),
        nominal_voltage=14.8,
        temperature=(-5.0, 85.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.066,
        size=(0.031, 0.046, 0.037),
        gear_ratio=142.5,
        gear=METAL,
        link=RS485,
        remarks=("The maker gives no speed.",),
    )

    cw_compliance_margin = DXTable.cw_compliance_margin.with_(default=0)
    ccw_compliance_margin = DXTable.ccw_compliance_margin.with_(default=0)


class DX117(DXTable):
    """The strongest of the series."""

    title = "DX-117"
    number = 117
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(18.5, 3.7, 85 * rpm, 1.9),),
        voltage=(12.0, 18.5),
        nominal_voltage=14.8,
        temperature=(-5.0, 80.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.066,
        size=(0.031, 0.046, 0.037),
        gear_ratio=192.6,
        gear=METAL,
        link=RS485,
    )

    highest_limit_temperature = DXTable.highest_limit_temperature.with_(default=80)
