"""Ids: the same in all three families."""

import re

from servobus.errors import BadValue, UsageError

BROADCAST = 254
"""The id that every servo listens to."""
LAST_ID = 253


def check_id(id: int) -> int:
    """Give the id back, or raise BadValue if no single servo can have it."""
    if not 0 <= id <= LAST_ID:
        why = " (254 is the broadcast id: every servo would obey)" if id == BROADCAST else ""
        raise BadValue(f"id {id} is not in 0 .. {LAST_ID}{why}")
    return id


def parse_ids(text: str) -> list[int]:
    """Read "1-4,7". Raises UsageError."""
    return [id for part in text.replace(" ", "").split(",") for id in parse_range(part, text)]


def parse_range(text: str, whole: str) -> range:
    """Read "7" or "1-4"; `whole` is what it is a part of. Raises UsageError."""
    match = re.fullmatch(r"([0-9]{1,9})(?:-([0-9]{1,9}))?", text)
    if not match:
        said = f"{whole!r}: {text!r}" if text != whole else repr(text)
        raise UsageError(f"{said} is no id; ids are numbers 0 .. {LAST_ID} and ranges, such as 1-4,7")
    first, last = check_id(int(match[1])), check_id(int(match[2] or match[1]))
    if last < first:
        raise UsageError(f"{whole!r}: {text} runs backwards")
    return range(first, last + 1)
