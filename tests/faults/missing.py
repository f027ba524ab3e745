"""Faults that are not tested yet, each with the reason.

MISSING has no test at all. PARTLY has a test of the same number that leaves out what is said here.
"""

MISSING: dict[int, str] = {}

PARTLY: dict[int, str] = {
    16: "a port that comes back under another name, followed by serial number: see tests/unit/test_serial_port.py",
}
