"""The text of a robot file that an import makes: commented, so that it says where each value comes from."""

import textwrap
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import tomlkit

from servobus.robots.file.entries import FORMAT
from servobus.robots.formats.base import Draft, Noted

WIDTH = 110
"""Columns of a comment."""


def draft_text(draft: Draft, name: str) -> str:
    """Give the text of a new robot file. `name` is what the robot is called."""
    return "\n".join(_lines(draft, name)) + "\n"


def _lines(draft: Draft, name: str) -> Iterator[str]:
    yield from _comment([f"Made from {draft.title}.", *draft.lost, *draft.notes])
    yield from _table(("robot",), {"format": FORMAT, "name": name})
    for port, values in draft.ports.items():
        yield from _table(("port", port), values)
    for joint, values in draft.joints.items():
        yield from _table(("joint", joint), values)
    if draft.groups:
        yield from _table(("group",), {group: list(joints) for group, joints in draft.groups.items()})


def _comment(sentences: Iterable[str]) -> Iterator[str]:
    for sentence in sentences:
        yield from textwrap.wrap(_plain(sentence), WIDTH, initial_indent="# ", subsequent_indent="#   ")


def _table(path: tuple[str, ...], values: Mapping[str, Any]) -> Iterator[str]:
    yield ""
    yield f"[{'.'.join(path)}]"
    for key, value in values.items():
        shown, remark = (value.value, f"  # {_plain(value.remark)}") if isinstance(value, Noted) else (value, "")
        if shown is not None:
            yield f"{key} = {tomlkit.item(shown).as_string()}{remark}"
        else:
            yield f"# {key}:{remark[3:]}"


def _plain(text: str) -> str:
    """Give a text for a comment: no line breaks, and no characters that TOML does not allow there."""
    return "".join(sign if sign.isprintable() else "?" for sign in text)
