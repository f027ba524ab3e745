"""The HTD series: servos with two shafts, for three lithium cells.

Sources: the robot arm course of Hiwonder-docs/JetRover, the list of models of
S-LABc/HiWonder-Serial-Servo-Arduino-Library, and WildRobot 2's system identification of three HTD-45H.
"""

from servobus.families.lewansoul.models.table import THREE_CELLS, HighVoltage, at, lx_sheet
from servobus.families.model import Confidence


class HTD35H(HighVoltage):
    """35 kgf·cm at 11.1 V."""

    title = "HTD-35H"
    series = "HTD"
    sheet = lx_sheet(
        at(11.1, 35.0), voltage=(9.0, 12.6), confidence=Confidence.MEDIUM,
        remarks=("One text has 12 to 14.8 V for an HTD-35H3.", THREE_CELLS),
    )  # fmt: skip


class HTD45H(HighVoltage):
    """45 kgf·cm at 12 V."""

    title = "HTD-45H"
    names = ("HTD-455H",)
    series = "HTD"
    sheet = lx_sheet(
        at(12.0, 45.0), voltage=(9.0, 12.6), weight=0.064, size=(0.0511, 0.02014, 0.040), remarks=(THREE_CELLS,)
    )
