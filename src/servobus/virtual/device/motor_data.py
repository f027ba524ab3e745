"""Named motors: what is known, estimated and assumed about what is in the case of each model.

The first set of a model is its default. All temperatures, frames and units are those of
`servobus.virtual.physics.motor`.

What a specification fixes is two ratios, stall torque to voltage and speed to voltage. Torque constant and resistance
follow from them once friction is known, and friction hides in them: so there can be more than one set. None has
a viscous part, stiction above Coulomb friction, hard stops or backlash: no public figure says anything about them.
"""

from typing import Final

from servobus.errors import UnknownName
from servobus.families.base import Model
from servobus.virtual.physics.motor import MotorParams

_RX28_HEAT = {
    # Assumption, the same for all sets: what the catalogues of coreless motors of this size give, 10 and 30 K/W with
    # time constants of 5 and 270 s. A stall at 16 V then heats the winding at 60 K/s and the case at 3 K/s.
    "winding_to_case": 10.0,
    "case_to_ambient": 30.0,
    "winding_capacity": 5 / 10,
    "case_capacity": 270 / 30,
}

RX28: Final = MotorParams(
    gear_ratio=193,  # manual 1-3
    # Manual 1-3, from 0.167 s/60° at 12 V and 0.126 s/60° at 16 V, taken as a motor without losses.
    torque_constant=9.92e-3,
    resistance=8.30,  # manual 1-3, from 28.3 kgf·cm at 12 V and 37.7 kgf·cm at 16 V, without losses
    # Assumption: the rotor of a 17 mm RE-max, 0.868 g·cm² as remembered from its catalogue, times 193².
    inertia=0.0032,
    **_RX28_HEAT,
)
"""The manual's specification, without any loss: what it turns by hand, or throws, never stops by itself."""

RX28_FRICTION: Final = MotorParams(
    gear_ratio=193,  # manual 1-3
    torque_constant=9.79e-3,  # manual 1-3, both speeds within 0.6 %, with the friction below
    resistance=8.05,  # manual 1-3, both torques within 0.4 %, with the friction below
    coulomb=0.05,  # assumption: half of what would still leave all four figures within 1 %
    inertia=0.0032,  # as above
    **_RX28_HEAT,
)
"""The manual's specification with as much friction as it leaves room for: it rests when nothing drives it."""

RX28_MEASURED: Final = MotorParams(
    gear_ratio=193,  # manual 1-3
    torque_constant=9.92e-3,  # as RX28
    # ROBOTIS e-manual, 18.5 V: 3.7 N·m and 85 rpm, from this and the current without load.
    resistance=8.86,
    coulomb=193 * 9.92e-3 * 0.15,  # assumption: 0.15 A without load, which fits the 18.5 V point
    inertia=0.0032,  # as above
    **_RX28_HEAT,
)
"""The one published point of the e-manual that differs: less torque and speed at 12 and 16 V than the manual says."""

_DRS0602_HEAT = {
    # Assumption, the same for both sets: 4 and 13 K/W with time constants of 7 and 465 s, as a catalogue motor of
    # 22 x 32 mm in a case of 145 g.
    "winding_to_case": 4.0,
    "case_to_ambient": 13.0,
    "winding_capacity": 7 / 4,
    "case_capacity": 465 / 13,
}

DRS0602: Final = MotorParams(
    gear_ratio=202,  # manual 2-3
    torque_constant=11.40e-3,  # manual 2-3, from 0.164 s/60° at 14.8 V
    resistance=4.25,  # manual 2-3, from 7.6 N·m at 14.8 V, if the bridge limits a stall to 3.5 A (assumption)
    gear_loss=0.04,  # assumption
    coulomb=(1 - 0.04) * 202 * 11.40e-3 * 0.03,  # assumption: 0.03 A without load
    # Assumption: the rotor of a 22 x 32 mm Faulhaber SR, 3.8 g·cm² as remembered from its catalogue, times 202².
    inertia=0.0155,
    **_DRS0602_HEAT,
)
"""The manual's specification with a good gear, so that something else limits the current of a stall."""

DRS0602_LOSSY: Final = MotorParams(
    gear_ratio=202,  # manual 2-3
    torque_constant=11.15e-3,  # manual 2-3, from 0.164 s/60° at 14.8 V
    resistance=2.70,  # assumption: winding of the catalogue, bridge and wires, hence 5.5 A at a stall
    gear_loss=0.365,  # manual 2-3, what leaves 7.6 N·m at 14.8 V
    coulomb=(1 - 0.365) * 202 * 11.15e-3 * 0.15,  # assumption: 0.15 A without load
    inertia=0.0155,  # as above
    **_DRS0602_HEAT,
)
"""The manual's specification with the catalogue's motor, so that the gear must lose more than a third."""

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

MOTORS: Final = {
    "rx28": {"manual": RX28_FRICTION, "measured": RX28_MEASURED, "lossless": RX28},
    "drs0602": {"manual": DRS0602, "lossy": DRS0602_LOSSY},
    "lx16a": {"manual": LX16A},
}
"""Model key -> name of a set -> the set; the first is the default."""


def motor(model: type[Model], name: str | None = None) -> MotorParams:
    """Find the motor of a model: a set by name, or its default. Raises UnknownName."""
    sets = MOTORS.get(model.key())
    if sets is None:
        point = model.sheet.performance[-1]
        return motor_like(point.voltage, point.stall_torque, point.speed)
    found = next(iter(sets.values())) if name is None else sets.get(name)
    if found is None:
        raise UnknownName(f"no motor data {name!r} for {model.title}; there are {', '.join(sets)}")
    return found


def motor_like(voltage: float, stall_torque: float, speed: float) -> MotorParams:
    """Make up a motor for a model without a set of its own, from one line of its data sheet (V, N·m, rad/s).

    Assumptions: 2 % of the stall torque is friction, the bare shaft runs up in 10 ms, and the gear is part of the
    torque constant.
    """
    friction = 0.02
    constant = voltage / ((1 + friction) * speed)
    resistance = constant * voltage / ((1 + friction) * stall_torque)
    return MotorParams(
        gear_ratio=1,
        torque_constant=constant,
        resistance=resistance,
        coulomb=friction * stall_torque,
        inertia=0.010 * constant**2 / resistance,
    )
