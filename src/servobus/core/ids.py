"""Ids: the same in all three families."""

from servobus.errors import BadValue

BROADCAST = 254
"""The id that every servo listens to."""
LAST_ID = 253


def check_id(id: int) -> int:
    """Give the id back, or raise BadValue if no single servo can have it."""
    if not 0 <= id <= LAST_ID:
        why = " (254 is the broadcast id: every servo would obey)" if id == BROADCAST else ""
        raise BadValue(f"id {id} is not in 0 .. {LAST_ID}{why}")
    return id
