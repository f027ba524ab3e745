"""Motor data of the LewanSoul models: what is known, estimated and assumed about what is in the case.

All temperatures, frames and units are those of `servobus.virtual.physics.motor`. What is not here is derived from the
data sheets, see `servobus.virtual.device.derivation`; why there can be more than one set is said in
`servobus.virtual.device.motors`.
"""

from typing import Final

from servobus.core.units import deg
from servobus.families.model import Performance
from servobus.virtual.device.motor_set import MotorData, assumed, derived, measured, motor_set, taken_over
from servobus.virtual.physics.motor import MotorParams

KGF_CM = 0.0980665
"""One kgf·cm in N·m."""

LX16A: Final = motor_set(
    MotorParams(
        gear_ratio=264,
        torque_constant=4.11e-3,
        resistance=2.90,
        gear_loss=0.28,
        coulomb=(1 - 0.28) * 264 * 4.11e-3 * 0.10,
        inertia=0.014,
        winding_to_case=5.0,
        case_to_ambient=25.0,
        winding_capacity=15 / 5,
        case_capacity=300 / 25,
    ),
    "the product pages at 7.4 V, and their speed at 6 V; their torque at 6 V is more than any such motor would have",
    gear_ratio=assumed("only its product with the torque constant can be seen from outside"),
    torque_constant=derived("from 0.16 s/60° at 7.4 V"),
    resistance=derived("from 19.5 kgf·cm at 7.4 V, with the losses below"),
    gear_loss=assumed("as measured by others on servos of this class, 0.2 to 0.3"),
    coulomb=assumed("0.10 A without load"),
    inertia=assumed("half of what others measured on the next larger class"),
    heat=assumed("a guess at an iron-cored motor in plastic, time constants of 15 and 300 s"),
)

_WILDROBOT = (
    "WildRobot2 (github.com/leeygang/WildRobot2), docs/hardware/evidence/htd45h_unit_c_review.md, fits of three units"
)
"""Swings at low load. The fits have no electrical measurement, and the damping includes the servo's own controller."""

HTD45H_MEASURED: Final = motor_set(
    MotorParams(
        gear_ratio=1,
        torque_constant=0.7876 * 12.0 / (4.413 + 0.4548),
        resistance=0.7876 * (12.0 / (4.413 + 0.4548)) ** 2,
        coulomb=0.4548,
        inertia=0.03351,
        winding_to_case=5.0,
        case_to_ambient=25.0,
        winding_capacity=15 / 5,
        case_capacity=300 / 25,
    ),
    "the means of what was identified on three real ones at low load, with the printed torque",
    gear_ratio=assumed("not known; the gear is part of the torque constant"),
    torque_constant=derived("from 45 kgf·cm at 12 V, if all the damping that was measured, 0.7876 N·m·s/rad, is K²/R"),
    resistance=derived("as the torque constant"),
    gear_loss=assumed("none: it hides in the friction that was measured"),
    coulomb=measured(_WILDROBOT),
    inertia=measured(_WILDROBOT),
    heat=taken_over("the LX-16A", "how it warms"),
)

_NAME_BEFORE = "an earlier name for it in the list of models of a library"
_HV = "the same torque class and supply"

MOTORS: Final = {
    "lx16a": MotorData(
        {"manual": LX16A},
        further={
            "the early product page": (
                Performance(6.0, None, 60 * deg / 0.18),
                Performance(6.6, 15 * KGF_CM),
                Performance(7.4, 17 * KGF_CM, 60 * deg / 0.16),
            )
        },
    ),
    "lx225": MotorData(like="lx224", why="the next in the list of models"),
    "lx824": MotorData(like="lx224", why=_NAME_BEFORE),
    "lx824hv": MotorData(like="lx224hv", why=_NAME_BEFORE),
    "lx1501": MotorData(like="lx15d", why="assumption: from the name"),
    "hts16l": MotorData(like="lx16a", why="assumption: from the name, low voltage and 16 kgf·cm"),
    "hts20l": MotorData(like="lx224", why="assumption: from the name, low voltage and 20 kgf·cm"),
    "hx20l": MotorData(like="lx224", why="assumption: from the name, low voltage and 20 kgf·cm"),
    "hx06l": MotorData(like="lx16a", why="assumption: the only one known that is as small"),
    "hts21h": MotorData(like="hts20h", why=_HV),
    "hts30hs": MotorData(like="hx35h", why=_HV),
    "hts35h": MotorData(like="hx35h", why=_HV),
    "htd35h": MotorData(like="hx35h", why=_HV),
    "htd45h": MotorData({"measured": HTD45H_MEASURED}),
}
"""Key of a model -> what is known of its motor."""
