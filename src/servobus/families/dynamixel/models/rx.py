"""RX-10, RX-24F and RX-64. Source: ROBOTIS e-manual, pages rx-10, rx-24f and rx-64 (docs/en/dxl/rx).

The RX-28, whose printed manual is at hand and differs, stands in a file of its own.
"""

from servobus.core.units import deg, rpm
from servobus.families.dynamixel.models.compliance import ComplianceTable
from servobus.families.model import Performance, SpecSheet

RS485 = "RS-485, half duplex, 8N1, 4 pins, 7843 bit/s to 1 Mbit/s (ED-09)"
METAL = "full metal gear, engineering plastic body"


class RXTable(ComplianceTable):
    """Rows of the RX series."""

    series = "RX"

    highest_limit_temperature = ComplianceTable.highest_limit_temperature.with_(default=80)


class RX10(RXTable):
    """The smallest of the series."""

    title = "RX-10"
    number = 10
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(12.0, 1.3, 54 * rpm, 0.8),),
        voltage=(9.0, 12.0),
        nominal_voltage=11.1,
        temperature=(-5.0, 80.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.0645,
        size=(0.0356, 0.0506, 0.0355),
        gear_ratio=193,
        gear=METAL,
        standby_current=0.050,
        link=RS485,
    )


class RX24F(RXTable):
    """Fast, for 12 V."""

    title = "RX-24F"
    number = 24
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(12.0, 2.6, 126 * rpm, 2.4),),
        voltage=(9.0, 12.0),
        nominal_voltage=11.1,
        temperature=(-5.0, 80.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.067,
        size=(0.0356, 0.0506, 0.0355),
        gear_ratio=193,
        gear=METAL,
        standby_current=0.050,
        link=RS485,
    )


class RX64(RXTable):
    """The strongest of the series."""

    title = "RX-64"
    number = 64
    sheet = SpecSheet(
        maker="ROBOTIS",
        performance=(Performance(18.5, 5.3, 64 * rpm, 2.6),),
        voltage=(12.0, 18.5),
        nominal_voltage=14.8,
        temperature=(-5.0, 80.0),
        angle=300 * deg,
        resolution=300 * deg / 1023,
        weight=0.125,
        size=(0.0402, 0.0611, 0.041),
        gear_ratio=200,
        gear=METAL,
        standby_current=0.050,
        link=RS485,
        remarks=("ED-55: another source has 4.0 N·m, without a voltage.",),
    )
