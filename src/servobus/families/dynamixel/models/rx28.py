"""RX-28. Source: RX-28 user's manual, section 3-4 (control table) and 1-3 (specification)."""

from servobus.core.registers import U8, Access, Area, Int, Register
from servobus.core.units import Count, deg
from servobus.families.dynamixel.models.rx import RXTable
from servobus.families.dynamixel.places import Address
from servobus.families.model import Performance, SpecSheet

EEPROM, RESERVED = Area.EEPROM, Access.RESERVED
KGF_CM = 0.0980665
"""One kgf·cm in N·m."""


class RX28(RXTable):
    """As its printed manual has it, which differs from the online manual in some rows and figures (ED-12)."""

    title = "RX-28"
    number = 28
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
        remarks=("ED-12: the online manual has 12 to 18.5 V, at most 80 °C, and at 18.5 V 3.7 N·m, 1.9 A and 85 rpm.",),
    )

    return_delay_time = RXTable.return_delay_time.with_(
        note="ED-08: 500 µs as in 3-4-1, not the 160 µs of the appendix"
    )
    reserved_10 = Register(
        Address(10), U8, Count(), "not in the manual's table", access=RESERVED, area=EEPROM, note="ED-22: reads 0"
    )
    highest_limit_temperature = RXTable.highest_limit_temperature.with_(
        limits=(10, 99), note="ED-11: 10 is 0x0A, printed as 0x10"
    )
    lowest_limit_voltage = RXTable.lowest_limit_voltage.with_(note="ED-10")
    highest_limit_voltage = RXTable.highest_limit_voltage.with_(
        default=240, note="ED-10, ED-12: 24.0 V as in the manual at hand"
    )
    reserved_19 = Register(
        Address(19), U8, Count(), "only in the manual's range table, no effect", default=0, limits=(0, 1), area=EEPROM,
        note="ED-22: accepts 0 and 1",
    )  # fmt: skip
    reserved_20 = Register(
        Address(20), Int(4), Count(), "not in the manual's table", access=RESERVED, area=EEPROM, note="ED-22: reads 0"
    )
    cw_compliance_margin = RXTable.cw_compliance_margin.with_(default=0)
    ccw_compliance_margin = RXTable.ccw_compliance_margin.with_(default=0)
    cw_compliance_slope = RXTable.cw_compliance_slope.with_(limits=(1, 254), note="ED-13, ED-17")
    ccw_compliance_slope = RXTable.ccw_compliance_slope.with_(limits=(1, 254), note="ED-13, ED-17")
    registered_instruction = RXTable.registered_instruction.with_(access=Access.READ_WRITE, note="ED-16")
    reserved_45 = Register(
        Address(45), U8, Count(), "not in the manual's table", access=RESERVED, note="ED-22: reads 0"
    )
