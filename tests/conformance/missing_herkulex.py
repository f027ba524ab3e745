"""Behaviours of HerkuleX that are not tested yet, each with the reason; see missing.py.

MISSING has no test at all. PARTLY has a test of the same number that leaves out what is said here.
"""

MISSING: dict[str, str] = {}

PARTLY: dict[str, str] = {}
