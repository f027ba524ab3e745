"""Faults that are not tested yet, each with the reason.

MISSING has no test at all. PARTLY has a test of the same number that leaves out what is said here.
"""

MISSING: dict[int, str] = {
    22: "a count of overruns and no burst of old goals: bus.cycle() is not there yet",
}

PARTLY: dict[int, str] = {
    15: "the diagnosis that all behind one servo are lost",
    16: "a port that comes back under another name is followed by the adapter's serial number",
}
