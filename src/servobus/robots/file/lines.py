"""Where in a TOML text a key stands: the library that reads TOML tells no lines, and an error should name one."""

import re
from collections.abc import Iterable, Sequence

_KEY = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_PATH = rf"{_KEY}(?:\s*\.\s*{_KEY})*"
_TABLE = re.compile(rf"\s*\[\[?\s*({_PATH})\s*\]\]?")
_SET = re.compile(rf"\s*({_PATH})\s*=")


def line_of(text: str, path: Sequence[str]) -> int | None:
    """Give the line, from 1, at which the key with this path is set, or its nearest parent; None if none is.

    A key of an inline table stands where that table does.
    """
    lines = _lines(text)
    for length in range(len(path), 0, -1):
        if (line := lines.get(tuple(path[:length]))) is not None:
            return line
    return None


def _lines(text: str) -> dict[tuple[str, ...], int]:
    found: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    for number, line in enumerate(text.splitlines(), 1):
        if match := _TABLE.match(line):
            table = _split(match[1])
            for length in range(1, len(table) + 1):  # the first of several tables stands for what they are in
                found.setdefault(table[:length], number)
        elif match := _SET.match(line):
            found.setdefault(table + _split(match[1]), number)
    return found


def _split(path: str) -> tuple[str, ...]:
    return tuple(_bare(re.findall(_KEY, path)))


def _bare(keys: Iterable[str]) -> Iterable[str]:
    return (key[1:-1] if key[0] in "\"'" else key for key in keys)
