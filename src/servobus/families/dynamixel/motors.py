"""Motor data of the Dynamixel models: what is known, estimated and assumed about what is in the case.

All temperatures, frames and units are those of `servobus.virtual.physics.motor`. Why there can be more than one set,
and what none has, is said in `servobus.virtual.device.motors`.
"""

from typing import Final

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

RX28_SETS: Final = {"manual": RX28_FRICTION, "measured": RX28_MEASURED, "lossless": RX28}
"""Name of a set -> the set; the first is the default."""
