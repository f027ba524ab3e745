"""Behaviours that are not tested yet, each with the reason; numbers as in docs/decisions.md.

MISSING has no test at all. PARTLY has a test of the same number that leaves out what is said here.
"""

MOTOR = "needs the motor and the control law"

MISSING: dict[str, str] = {
    "D-64": f"{MOTOR}: torque inside margins and slopes",
    "D-65": f"{MOTOR}: torque over position in the manual's example",
    "D-67": f"{MOTOR}: Punch as the lowest torque inside the slope",
    "D-70": f"{MOTOR}: load while blocked",
}

PARTLY: dict[str, str] = {
    "D-66": f"{MOTOR}: that a slope acts as its level's value; the read-back is tested",
    "D-68": f"{MOTOR}: a limit other than 0 as a share of torque; free run is tested",
    "D-75": f"{MOTOR}: the share of torque; the share of speed without load, and the direction, are tested",
    "D-79": f"{MOTOR}: the overload bit; voltage and temperature are tested",
    "D-83": f"{MOTOR}: shutdown by overload; overheating and voltage are tested",
    "D-85": f"{MOTOR}: 0x24, overload with overheating; 0x05, voltage with overheating, is tested",
}
