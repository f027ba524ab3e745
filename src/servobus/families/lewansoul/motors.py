"""Motor data of the LewanSoul models: what is known, estimated and assumed about what is in the case.

All temperatures, frames and units are those of `servobus.virtual.physics.motor`. Why there can be more than one set,
and what none has, is said in `servobus.virtual.device.motors`.
"""

import math
from typing import Final

from servobus.virtual.physics.motor import MotorParams, motor_like

LX16A: Final = MotorParams(
    gear_ratio=264,  # assumption; only its product with the torque constant can be seen from outside
    torque_constant=4.11e-3,  # product pages, from 0.16 s/60° at 7.4 V
    resistance=2.90,  # product pages, from 19.5 kgf·cm at 7.4 V, with the losses below
    gear_loss=0.28,  # assumption: as measured by others on servos of this class, 0.2 to 0.3
    coulomb=(1 - 0.28) * 264 * 4.11e-3 * 0.10,  # assumption: 0.10 A without load
    inertia=0.014,  # assumption: half of what others measured on the next larger class
    # Assumption: 5 and 25 K/W with time constants of 15 and 300 s; a guess at an iron-cored motor in plastic.
    winding_to_case=5.0,
    case_to_ambient=25.0,
    winding_capacity=15 / 5,
    case_capacity=300 / 25,
)
"""The product pages at 7.4 V, and their speed at 6 V. Their torque at 6 V is 8 % more than any such motor would have:
a line through both points would push without a voltage."""

LX16A_SETS: Final = {"manual": LX16A}
"""Name of a set -> the set; the first is the default."""


def _taken_over(voltage: float, kgf_cm: float, per_60_degrees: float) -> dict[str, MotorParams]:
    """Make up a motor of which one or both figures are those of a sibling: V, kgf·cm, s for 60°."""
    return {"sibling": motor_like(voltage, kgf_cm * 0.0980665, math.radians(60) / per_60_degrees)}


# Assumptions, where a model has no speed of its own: that of the LX-224, HTS-20H and HX-35H.
LX225_SETS: Final = _taken_over(7.4, 25.0, 0.20)
HTS20H_SETS: Final = _taken_over(11.1, 20.0, 0.18)
HX35H_SETS: Final = _taken_over(11.1, 35.0, 0.18)
HTD45H_SETS: Final = _taken_over(12.0, 45.0, 0.18 * 11.1 / 12.0)
