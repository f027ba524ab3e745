"""LX-16A. The protocol document names no model; figures from product pages."""

from servobus.core.units import deg
from servobus.families.lewansoul.models.table import LxTable
from servobus.families.model import Performance, SpecSheet

KGF_CM = 0.0980665
"""One kgf·cm in N·m."""
INCH = 0.0254


class LX16A(LxTable):
    """Position 0 .. 1000 is 0° .. 240°; positions that are read may lie outside, and below 0."""

    title = "LX-16A"
    series = "LX"
    firmware = "servobus.families.lewansoul.firmware:LewansoulServo"
    # The protocol document has no specification. Figures of the maker's and resellers' product pages; some
    # of these give 15 and 17 kgf·cm instead. The two torque points cannot both be right for a DC motor.
    sheet = SpecSheet(
        maker="LewanSoul (Hiwonder)",
        performance=(
            Performance(6.0, 17.0 * KGF_CM, 60 * deg / 0.20),
            Performance(7.4, 19.5 * KGF_CM, 60 * deg / 0.16),
        ),
        # Assumption: from the lowest voltage of the product pages to two full lithium cells.
        voltage=(6.0, 8.4),
        nominal_voltage=7.4,
        angle=240 * deg,
        resolution=0.24 * deg,
        weight=0.052,
        size=(1.78 * INCH, 0.97 * INCH, 1.38 * INCH),
        link="one data wire, half duplex, 8N1, 115200 bit/s",
    )
