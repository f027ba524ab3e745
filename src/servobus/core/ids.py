"""Ids: the same in all three families."""

import re
from collections.abc import Iterable
from numbers import Integral

from servobus.core.units import said
from servobus.errors import BadValue, UsageError

BROADCAST = 254
"""The id that every servo listens to."""
LAST_ID = 253


def check_id(id: int) -> int:
    """Give the id back, or raise BadValue if no single servo can have it."""
    given: object = id
    if isinstance(given, bool) or not isinstance(given, Integral):
        raise BadValue(f"{said(given)} is no id: an id is a whole number 0 .. {LAST_ID}")
    if not 0 <= id <= LAST_ID:
        why = " (254 is the broadcast id: every servo would obey)" if id == BROADCAST else ""
        raise BadValue(f"id {said(id)} is not in 0 .. {LAST_ID}{why}")
    return int(id)


def check_ids(ids: int | Iterable[int]) -> list[int]:
    """Give one id or several as a list. Raises BadValue."""
    several: object = ids
    if isinstance(several, str | bytes) or not isinstance(several, Iterable):
        return [check_id(ids)]  # type: ignore[arg-type] # refused there if it is no number
    return [check_id(id) for id in several]


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


def shown_ids(ids: Iterable[int]) -> str:
    """Write ids as they are typed: "id 7", "ids 1-4,7"."""
    parts: list[list[int]] = []
    for id in sorted(ids):
        if parts and id == parts[-1][-1] + 1:
            parts[-1] = [parts[-1][0], id]
        else:
            parts.append([id])
    text = ",".join("-".join(map(str, part)) for part in parts)
    return f"id {text}" if text.isdecimal() else f"ids {text}"
