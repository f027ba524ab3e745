"""Motor data of the LewanSoul models: what is known, estimated and assumed about what is in the case.

All temperatures, frames and units are those of `servobus.virtual.physics.motor`. Why there can be more than one set,
and what none has, is said in `servobus.virtual.device.motors`.
"""

from typing import Final

from servobus.virtual.physics.motor import MotorParams

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
