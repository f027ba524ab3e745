"""Motor data of the Dynamixel models: what is known, estimated and assumed about what is in the case.

All temperatures, frames and units are those of `servobus.virtual.physics.motor`. What is not here is derived from the
data sheets, see `servobus.virtual.device.derivation`; why there can be more than one set is said in
`servobus.virtual.device.motors`.
"""

from typing import Final

from servobus.core.units import rpm
from servobus.families.model import Performance
from servobus.virtual.device.motor_set import MotorData, assumed, derived, measured, motor_set, printed, taken_over
from servobus.virtual.physics.motor import MotorParams

_RX28_HEAT = {
    "winding_to_case": 10.0,
    "case_to_ambient": 30.0,
    "winding_capacity": 5 / 10,
    "case_capacity": 270 / 30,
}
# A stall at 16 V then heats the winding at 60 K/s and the case at 3 K/s.
_RX28_HEAT_FROM = assumed("what catalogues of coreless motors of 17 mm give, time constants of 5 and 270 s")
_RX28_ROTOR = assumed("the rotor of a 17 mm RE-max, 0.868 g·cm² as remembered from its catalogue, times 193²")
_GEAR = printed("manual 1-3")

RX28_LOSSLESS: Final = motor_set(
    MotorParams(gear_ratio=193, torque_constant=9.92e-3, resistance=8.30, inertia=0.0032, **_RX28_HEAT),
    "the manual's specification, without any loss: what it turns by hand, or throws, never stops by itself",
    gear_ratio=_GEAR,
    torque_constant=derived("from 0.167 s/60° at 12 V and 0.126 s/60° at 16 V, as a motor without losses"),
    resistance=derived("from 28.3 kgf·cm at 12 V and 37.7 kgf·cm at 16 V, as a motor without losses"),
    coulomb=assumed("none"),
    gear_loss=assumed("none"),
    inertia=_RX28_ROTOR,
    heat=_RX28_HEAT_FROM,
)
RX28_MANUAL: Final = motor_set(
    MotorParams(gear_ratio=193, torque_constant=9.79e-3, resistance=8.05, coulomb=0.05, inertia=0.0032, **_RX28_HEAT),
    "the manual's specification with as much friction as it leaves room for: it rests when nothing drives it",
    gear_ratio=_GEAR,
    torque_constant=derived("from the speeds at 12 and 16 V, both within 0.6 %, with the friction below"),
    resistance=derived("from the torques at 12 and 16 V, both within 0.4 %, with the friction below"),
    coulomb=assumed("half of what would still leave all four figures within 1 %"),
    gear_loss=assumed("none"),
    inertia=_RX28_ROTOR,
    heat=_RX28_HEAT_FROM,
)
RX28_MEASURED: Final = motor_set(
    MotorParams(
        gear_ratio=193,
        torque_constant=9.92e-3,
        resistance=8.86,
        coulomb=193 * 9.92e-3 * 0.15,
        inertia=0.0032,
        **_RX28_HEAT,
    ),
    "the one point of the e-manual, 18.5 V, which differs: less torque and speed at 12 and 16 V than the manual says",
    gear_ratio=_GEAR,
    torque_constant=derived("as in the lossless set; with the friction below it turns at 85 rpm at 18.5 V"),
    resistance=derived("from 3.7 N·m at 18.5 V (ROBOTIS e-manual) and the friction below"),
    coulomb=assumed("0.15 A without load, which fits the point at 18.5 V"),
    gear_loss=assumed("none"),
    inertia=_RX28_ROTOR,
    heat=_RX28_HEAT_FROM,
)

_BAM = "Rhoban BAM (github.com/Rhoban/bam, Apache-2.0), bam/params/{}/m1.json"
"""Fits of recorded swings of a pendulum at 15 V. Model M1 of them has Coulomb and viscous friction, which is what
`MotorParams` has without more friction at rest and without a gear loss. Everything is seen at the output."""


def _larger(kg: float) -> dict[str, float]:
    """Give how a servo of this weight warms, as the RX-28 of 72 g does: with the weight, and with its surface."""
    size = kg / 0.072
    return {name: value * size ** (1 if "capacity" in name else -2 / 3) for name, value in _RX28_HEAT.items()}


_LARGER_FROM = taken_over("the RX-28", "how it warms, by the weight")

MX64_MEASURED: Final = motor_set(
    MotorParams(
        gear_ratio=200,
        torque_constant=1.6225 / 200,
        resistance=3.9494,
        coulomb=0.090387,
        viscous=0.011692,
        inertia=0.011951,
        **_larger(0.135),
    ),
    "what Rhoban identified on a real MX-64",
    gear_ratio=printed("e-manual"),
    torque_constant=measured(_BAM.format("mx64")),
    resistance=measured(_BAM.format("mx64")),
    coulomb=measured(_BAM.format("mx64")),
    viscous=measured(_BAM.format("mx64")),
    gear_loss=measured("none in the model M1 of Rhoban BAM: it hides in the resistance"),
    inertia=measured(_BAM.format("mx64")),
    heat=_LARGER_FROM,
)
MX106_MEASURED: Final = motor_set(
    MotorParams(
        gear_ratio=225,
        torque_constant=2.1914 / 225,
        resistance=2.9650,
        coulomb=0.10352,
        viscous=0.035202,
        inertia=0.026609,
        **_larger(0.153),
    ),
    "what Rhoban identified on a real MX-106",
    gear_ratio=printed("e-manual"),
    torque_constant=measured(_BAM.format("mx106")),
    resistance=measured(_BAM.format("mx106")),
    coulomb=measured(_BAM.format("mx106")),
    viscous=measured(_BAM.format("mx106")),
    gear_loss=measured("none in the model M1 of Rhoban BAM: it hides in the resistance"),
    inertia=measured(_BAM.format("mx106")),
    heat=_LARGER_FROM,
)

MOTORS: Final = {
    "rx28": MotorData(
        {"manual": RX28_MANUAL, "measured": RX28_MEASURED, "lossless": RX28_LOSSLESS},
        further={"ROBOTIS e-manual": (Performance(18.5, 3.7, 85 * rpm, 1.9),)},
    ),
    "mx64": MotorData({"measured": MX64_MEASURED}),
    "mx106": MotorData({"measured": MX106_MEASURED}),
    "ax12w": MotorData(like="ax12a", why="the same case and supply; 254:32 is how much faster it is"),
    "mx12w": MotorData(
        like="ax12w",
        why="the same case, gear and speed",
        friction=(0.035, "its Punch from the factory, 3.1 % of full output, is to leave a shaft at rest where it is"),
    ),
    "dx116": MotorData(like="dx117", why="the same case and weight"),
    "rx64": MotorData(like="mx64", why="the same case and gear"),
    "ex106p": MotorData(
        like="mx106",
        why="the same case",
        further={"SmartServoFramework": (Performance(14.8, 8.0, 69 * rpm, 6.1),)},
    ),
}
"""Key of a model -> what is known of its motor."""
