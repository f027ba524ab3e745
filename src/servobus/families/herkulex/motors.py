"""Motor data of the HerkuleX models: what is known, estimated and assumed about what is in the case.

All temperatures, frames and units are those of `servobus.virtual.physics.motor`. Why there can be more than one set,
and what none has, is said in `servobus.virtual.device.motors`.
"""

from typing import Final

from servobus.core.units import deg
from servobus.virtual.physics.motor import MotorParams, motor_like

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

DRS0602_SETS: Final = {"manual": DRS0602, "lossy": DRS0602_LOSSY}
"""Name of a set -> the set; the first is the default."""

# Assumptions: the speeds of the sheets are open (EH-61). Those of the small models are as sellers print them, those of
# the large ones are as that of the DRS-0602, which has the same gear ratio.
DRS0101_SETS: Final = {"sheet": motor_like(7.4, 1.2, 60 * deg / 0.166)}
DRS0201_SETS: Final = {"sheet": motor_like(7.4, 2.4, 60 * deg / 0.147)}
DRS0401_SETS: Final = {"sheet": motor_like(14.8, 5.1, 60 * deg / 0.164)}
DRS0402_SETS: Final = DRS0401_SETS
DRS0601_SETS: Final = {"sheet": motor_like(14.8, 7.6, 60 * deg / 0.164)}
