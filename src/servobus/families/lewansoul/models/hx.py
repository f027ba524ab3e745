"""The HX series: an L at the end of a name is for two lithium cells, an H for three.

HX-30HM and HX-35HM, with an M for their magnetic encoder, speak another protocol, whose packets begin with FF FF, and
are not here.

Sources: the user manual of Hiwonder-docs/ROSOrin-Pro, the maker's product page of the HX-35H, and the list of models of
S-LABc/HiWonder-Serial-Servo-Arduino-Library, which is all that names the HX-06L and HX-20L.
"""

from servobus.families.lewansoul.models.table import THREE_CELLS, HighVoltage, LxTable, at, lx_sheet
from servobus.families.model import Confidence


class HX12H(HighVoltage):
    """12 kgf·cm at 11.1 V."""

    title = "HX-12H"
    series = "HX"
    sheet = lx_sheet(
        at(11.1, 12.0, 0.20, stall_current=1.3), voltage=(9.0, 12.6),
        remarks=("Its torque is printed for 11.0 V, its speed for 11.1 V.",),
    )  # fmt: skip


class HX06L(LxTable):
    """A servo of small arms."""

    title = "HX-06L"
    series = "HX"
    sheet = lx_sheet(confidence=Confidence.LOW)


class HX20L(LxTable):
    """Known by its name."""

    title = "HX-20L"
    series = "HX"
    sheet = lx_sheet(confidence=Confidence.LOW)


class HX35H(HighVoltage):
    """35 kgf·cm at 11.1 V at rest, 25 while it turns."""

    title = "HX-35H"
    series = "HX"
    sheet = lx_sheet(
        at(11.1, 35.0, 0.18), voltage=(9.0, 12.6), weight=0.052, confidence=Confidence.MEDIUM,
        remarks=("25 kgf·cm are told for the turning shaft, 35 for the one at rest.", THREE_CELLS),
    )  # fmt: skip
