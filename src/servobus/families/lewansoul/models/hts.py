"""The HTS series: an L at the end of a name is for two lithium cells, an H for three.

Sources: the robot arm courses of Hiwonder-docs/JetRover and Hiwonder-docs/ROSOrin-Pro, texts of users, and the list of
models of S-LABc/HiWonder-Serial-Servo-Arduino-Library, which is all that names the HTS-16L, HTS-20L and HTS-30HS.
"""

from servobus.families.lewansoul.models.table import THREE_CELLS, HighVoltage, LxTable, at, lx_sheet
from servobus.families.model import Confidence


class HTS20H(HighVoltage):
    """20 kgf·cm at 11.1 V."""

    title = "HTS-20H"
    series = "HTS"
    sheet = lx_sheet(
        at(11.1, 20.0, 0.18), voltage=(9.0, 12.6), weight=0.058, confidence=Confidence.MEDIUM,
        remarks=("A text of a user has 9.6 V as its lowest supply.",),
    )  # fmt: skip


class HTS16L(LxTable):
    """A servo of small arms."""

    title = "HTS-16L"
    series = "HTS"
    sheet = lx_sheet(confidence=Confidence.LOW)


class HTS20L(LxTable):
    """Known by its name."""

    title = "HTS-20L"
    series = "HTS"
    sheet = lx_sheet(confidence=Confidence.LOW)


class HTS21H(HighVoltage):
    """The servo of a gripper."""

    title = "HTS-21H"
    series = "HTS"
    sheet = lx_sheet(
        at(11.1, 20.0), voltage=(9.0, 12.6), confidence=Confidence.LOW,
        remarks=("Its torque is that of the arm it is part of, which lists it beside the HTS-20H.", THREE_CELLS),
    )  # fmt: skip


class HTS30HS(HighVoltage):
    """Known by its name."""

    title = "HTS-30HS"
    series = "HTS"
    sheet = lx_sheet(
        confidence=Confidence.LOW,
        remarks=(
            "30 kgf·cm stand in the name of the product, with no voltage.",
            "That it speaks this protocol is said by the list of one library alone.",
        ),
    )  # fmt: skip


class HTS35H(HighVoltage):
    """35 kgf·cm at 11.1 V."""

    title = "HTS-35H"
    series = "HTS"
    sheet = lx_sheet(
        at(11.1, 35.0), voltage=(9.0, 12.6), weight=0.064, confidence=Confidence.MEDIUM,
        remarks=("EL-34: one text has 6 to 8.4 V and 0.16 s for 60°.", THREE_CELLS),
    )  # fmt: skip
