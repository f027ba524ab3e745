"""Behaviours of the LewanSoul servos that are not tested yet, each with the reason; see missing.py.

MISSING has no test at all. PARTLY has a test of the same number that leaves out what is said here.
"""

LOAD = "needs a motor that a load can stop"

MISSING: dict[str, str] = {}

PARTLY: dict[str, str] = {
    "L-73": f"{LOAD}: the locked rotor, mask value 4; heat and voltage are tested with all eight masks",
    "L-74": f"{LOAD}: that a locked rotor flashes; heat and voltage are tested",
}
