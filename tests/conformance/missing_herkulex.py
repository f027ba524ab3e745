"""Behaviours of HerkuleX that are not tested yet, each with the reason; see missing.py.

MISSING has no test at all. PARTLY has a test of the same number that leaves out what is said here.
"""

MOTOR = "needs the motor and the control law"

MISSING: dict[str, str] = {
    "H-63": f"{MOTOR}: overload detection and its period",
    "H-64": f"{MOTOR}: Overload Detection Period 0",
    "H-65": f"{MOTOR}: Overload PWM Threshold 1023",
    "H-88": f"{MOTOR}: what the speed controller adds up while it cannot reach its speed",
    "H-108": f"{MOTOR}: scales of the position and velocity gains",
    "H-109": f"{MOTOR}: feedforward gains",
    "H-110": f"{MOTOR}: Dead Zone",
    "H-111": f"{MOTOR}: PWM Offset",
    "H-112": f"{MOTOR}: Min. PWM",
    "H-113": f"{MOTOR}: Max. PWM",
    "H-114": f"{MOTOR}: saturator",
    "H-115": f"{MOTOR}: order of the output stages",
}

PARTLY: dict[str, str] = {
    "H-48": f"{MOTOR}: how hard a braked shaft resists; that it does, and that no JOG moves it, is tested",
    "H-55": f"{MOTOR}: overload as it happens; its bit is tested as a host can set it",
}
