"""The LX series. The protocol document names no model; figures from product pages and from texts of users.

LX-824 and LX-824HV are earlier names in the list of models of S-LABc/HiWonder-Serial-Servo-Arduino-Library, and the
LX-1501 stands there alone.
"""

from servobus.core.units import deg
from servobus.families.lewansoul.models.table import KGF_CM, HighVoltage, LxTable, at, lx_sheet
from servobus.families.model import Confidence, Performance, SpecSheet

INCH = 0.0254


class LX16A(LxTable):
    """Position 0 .. 1000 is 0° .. 240°; positions that are read may lie outside, and below 0."""

    title = "LX-16A"
    series = "LX"
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
        confidence=Confidence.MEDIUM,
        remarks=("EL-27: other pages have 17 kgf·cm at 7.4 V; no DC motor has both torques that stand here.",),
    )


class LX15D(LxTable):
    """A servo with two shafts."""

    title = "LX-15D"
    series = "LX"
    sheet = lx_sheet(
        at(6.0, 17.3), at(7.4, 20.4, 0.188),
        voltage=(6.0, 8.4), weight=0.054, confidence=Confidence.MEDIUM,
        remarks=("EL-28: another list has 15 kgf·cm.",),
    )  # fmt: skip


class LX224(LxTable):
    """A servo with three sockets for the bus."""

    title = "LX-224"
    series = "LX"
    sheet = lx_sheet(
        at(7.4, 20.0, 0.20), voltage=(6.0, 8.4), weight=0.063, confidence=Confidence.MEDIUM,
        remarks=("17 kgf·cm in one list, 20 in five texts.",),
    )  # fmt: skip


class LX224HV(HighVoltage):
    """The LX-224 for three lithium cells."""

    title = "LX-224HV"
    series = "LX"
    sheet = lx_sheet(
        at(11.1, 20.0, 0.20), voltage=(9.0, 12.6), confidence=Confidence.MEDIUM,
        remarks=(
            "0.18 s for 60° in another text, and 24 kgf·cm at 7.4 V in a third, which does not go with its name.",
            "Its range of supply is that of three lithium cells, 11.1 V nominal: assumption.",
        ),
    )  # fmt: skip


class LX225(LxTable):
    """Known from one table that compares servos."""

    title = "LX-225"
    series = "LX"
    sheet = lx_sheet(
        at(7.4, 25.0), voltage=(6.0, 8.4), confidence=Confidence.LOW, remarks=("Its torque is from a single table.",)
    )


class LX824(LxTable):
    """An earlier name of the LX-224, by the list of one library."""

    title = "LX-824"
    series = "LX"
    sheet = lx_sheet(confidence=Confidence.LOW)


class LX824HV(HighVoltage):
    """An earlier name of the LX-224HV, by the list of one library."""

    title = "LX-824HV"
    series = "LX"
    sheet = lx_sheet(confidence=Confidence.LOW)


class LX1501(LxTable):
    """Known by its name from the list of one library."""

    title = "LX-1501"
    series = "LX"
    sheet = lx_sheet(confidence=Confidence.LOW)
