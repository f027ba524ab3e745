"""Behaviours of the RX-28 that are not tested yet, each with the reason; numbers as in docs/behaviours.md.

MISSING has no test at all. PARTLY has a test of the same number that leaves out what is said here. Both are empty.
"""

MISSING: dict[str, str] = {}

PARTLY: dict[str, str] = {}
