"""AX-12A, AX-12W and AX-18A. Source: ROBOTIS e-manual, pages ax-12a, ax-12w and ax-18a (docs/en/dxl/ax)."""

from servobus.core.units import deg, rpm
from servobus.families.dynamixel.models.compliance import ComplianceTable
from servobus.families.model import Performance, SpecSheet

TTL = "TTL, half duplex, 8N1, 3 pins, 7843 bit/s to 1 Mbit/s"


class AXTable(ComplianceTable):
    """Rows of the AX series."""

    series = "AX"
    factory_baud = 1_000_000

    highest_limit_temperature = ComplianceTable.highest_limit_temperature.with_(default=70)
    highest_limit_voltage = ComplianceTable.highest_limit_voltage.with_(default=140, note="ED-40")


class AX12A(AXTable):
    """Taken for the AX-12 and the AX-12+ too, which report the same number."""

    title = "AX-12A"
    names = ("AX-12", "AX-12+")
    number = 12
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(12.0, 1.5, 59 * rpm, 1.5),),
        voltage=(9.0, 12.0),
        nominal_voltage=11.1,
        temperature=(-5.0, 70.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.0546,
        size=(0.032, 0.050, 0.040),
        gear_ratio=254,
        gear="engineering plastic",
        motor="cored",
        standby_current=0.050,
        link=TTL,
        remarks=("AX-12 and AX-12+ weigh 53.5 g; what else of them differs from the AX-12A is not known.",),
    )


class AX12W(AXTable):
    """Geared for wheels."""

    title = "AX-12W"
    number = 300
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(12.0, None, 470 * rpm),),
        voltage=(9.0, 12.0),
        nominal_voltage=11.1,
        temperature=(-5.0, 70.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.0529,
        size=(0.032, 0.050, 0.040),
        gear_ratio=32,
        gear="engineering plastic",
        link=TTL,
        remarks=(
            "The speed is that of endless turn; in position mode the maker gives 54 rpm.",
            "The unit of moving_speed in position mode is printed as that of the AX-12A, which has other gears.",
        ),
    )

    cw_compliance_margin = AXTable.cw_compliance_margin.with_(default=4)
    ccw_compliance_margin = AXTable.ccw_compliance_margin.with_(default=4)
    cw_compliance_slope = AXTable.cw_compliance_slope.with_(default=64)
    ccw_compliance_slope = AXTable.ccw_compliance_slope.with_(default=64)


class AX18A(AXTable):
    """Stronger and faster than the AX-12A."""

    title = "AX-18A"
    names = ("AX-18F",)
    number = 18
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(12.0, 1.8, 97 * rpm, 2.2),),
        voltage=(9.0, 12.0),
        nominal_voltage=11.1,
        temperature=(-5.0, 70.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.0559,
        size=(0.032, 0.050, 0.040),
        gear_ratio=254,
        gear="engineering plastic",
        link=TTL,
        remarks=("The AX-18F weighs 54.5 g.",),
    )

    highest_limit_temperature = AXTable.highest_limit_temperature.with_(default=75)
    max_torque = AXTable.max_torque.with_(default=983)
