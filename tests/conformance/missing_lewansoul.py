"""Behaviours of the LewanSoul servos that no test covers, and why: L number -> reason."""

MISSING: dict[int, str] = {}
