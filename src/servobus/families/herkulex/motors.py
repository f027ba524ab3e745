"""Motor data of the HerkuleX models: what is known, estimated and assumed about what is in the case.

All temperatures, frames and units are those of `servobus.virtual.physics.motor`. What is not here is derived from the
data sheets, see `servobus.virtual.device.derivation`; why there can be more than one set is said in
`servobus.virtual.device.motors`.
"""

from typing import Final

from servobus.virtual.device.motor_set import MotorData, assumed, derived, motor_set, printed
from servobus.virtual.physics.motor import MotorParams

_HEAT = {
    "winding_to_case": 4.0,
    "case_to_ambient": 13.0,
    "winding_capacity": 7 / 4,
    "case_capacity": 465 / 13,
}
_HEAT_FROM = assumed("a catalogue motor of 22 x 32 mm in a case of 145 g, time constants of 7 and 465 s")
_ROTOR = assumed("the rotor of a 22 x 32 mm Faulhaber SR, 3.8 g·cm² as remembered from its catalogue, times 202²")
_GEAR = printed("manual 2-3")

DRS0602: Final = motor_set(
    MotorParams(
        gear_ratio=202,
        torque_constant=11.40e-3,
        resistance=4.25,
        gear_loss=0.04,
        coulomb=(1 - 0.04) * 202 * 11.40e-3 * 0.03,
        inertia=0.0155,
        **_HEAT,
    ),
    "the manual's specification with a good gear, so that something else limits the current of a stall",
    gear_ratio=_GEAR,
    torque_constant=derived("from 0.164 s/60° at 14.8 V"),
    resistance=derived("from 7.6 N·m at 14.8 V, if the bridge limits a stall to 3.5 A (assumption)"),
    gear_loss=assumed("a good gear"),
    coulomb=assumed("0.03 A without load"),
    inertia=_ROTOR,
    heat=_HEAT_FROM,
)
DRS0602_LOSSY: Final = motor_set(
    MotorParams(
        gear_ratio=202,
        torque_constant=11.15e-3,
        resistance=2.70,
        gear_loss=0.365,
        coulomb=(1 - 0.365) * 202 * 11.15e-3 * 0.15,
        inertia=0.0155,
        **_HEAT,
    ),
    "the manual's specification with the catalogue's motor, so that the gear must lose more than a third",
    gear_ratio=_GEAR,
    torque_constant=derived("from 0.164 s/60° at 14.8 V"),
    resistance=assumed("winding of the catalogue, bridge and wires, hence 5.5 A at a stall"),
    gear_loss=derived("what leaves 7.6 N·m at 14.8 V"),
    coulomb=assumed("0.15 A without load"),
    inertia=_ROTOR,
    heat=_HEAT_FROM,
)

MOTORS: Final = {
    "drs0602": MotorData({"manual": DRS0602, "lossy": DRS0602_LOSSY}),
    "drs0601": MotorData(like="drs0602", why="the same case, gear and torque; another sensor"),
    "drs0401": MotorData(like="drs0602", why="the same gear and supply; a shorter motor"),
    "drs0402": MotorData(like="drs0602", why="the same gear and supply; a shorter motor"),
}
"""Key of a model -> what is known of its motor."""
