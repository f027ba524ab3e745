"""Whatever stands in a robot file: it is read, or refused with RobotFileError; and changes keep all else."""

import re
import tomllib
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import jsonschema
import tomlkit
from hypothesis import given
from hypothesis import strategies as st

from servobus import RobotFileError
from servobus.robots.file.reading import read_text
from servobus.robots.file.schema import schema
from servobus.robots.file.writing import edited, quantity
from unit.robots.arms import SIX
from unit.robots.file.test_schema import FULL

VALIDATOR: Any = jsonschema.Draft7Validator(schema())
FILES = [SIX, FULL]

scalars = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(),
    st.text(),
    st.dates(),
    st.sampled_from(
        ["90deg", "-1e400deg", "nandeg", "1e9rad", "rx28", "base", "hip", "home", "", "0s", "99999999999999s"]
    ),
)
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3)
)
"""What TOML can hold."""


def paths(table: Any, before: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Give the path of every value in a tree of tables and lists."""
    if isinstance(table, dict | list):
        inner = table.items() if isinstance(table, dict) else enumerate(table)
        return [path for key, value in inner for path in ((*before, key), *paths(value, (*before, key)))]
    return []


def at(table: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        table = table[key]
    return table


def read(text: str) -> bool:
    """Read a text; tell whether it could be. Nothing but RobotFileError may come of it."""
    refusals = refused(lambda: read_text(text))
    assert all(refusal.startswith("the robot file") and len(refusal) < 1000 for refusal in refusals)
    return not refusals


def refused(do: Callable[[], Any]) -> list[str]:
    """Do something; give what was said if it was refused."""
    try:
        do()
    except RobotFileError as error:
        return [str(error)]
    return []


@given(st.sampled_from(FILES), st.integers(0, 2000), st.integers(0, 30), st.text(max_size=10))
def test_text_with_characters_replaced(text: str, start: int, length: int, other: str) -> None:
    read(text[:start] + other + text[start + length :])


@given(st.text())
def test_any_text(text: str) -> None:
    read(text)


@given(st.data())
def test_values_replaced(data: st.DataObject) -> None:
    """What is read is taken by the schema too; the other way round not: the schema sees one value at a time."""
    tables = tomllib.loads(data.draw(st.sampled_from(FILES)))
    *parents, key = data.draw(st.sampled_from(paths(tables)))
    at(tables, tuple(parents))[key] = data.draw(values)
    with suppress(ValueError, TypeError):  # not all that Python has can be written, such as surrogates
        if read(tomlkit.dumps(tables)):
            assert [error.message for error in VALIDATOR.iter_errors(tables)] == []


@given(st.data())
def test_keys_taken_away_or_added(data: st.DataObject) -> None:
    tables = tomllib.loads(data.draw(st.sampled_from(FILES)))
    *parents, key = data.draw(st.sampled_from([path for path in paths(tables) if isinstance(path[-1], str)]))
    table = at(tables, tuple(parents))
    value = table.pop(key)
    if data.draw(st.booleans()):
        table[data.draw(st.sampled_from(["base", "hip", "id", "port", "mirror"]) | st.text())] = value
    with suppress(ValueError, TypeError):
        if read(tomlkit.dumps(tables)):
            assert [error.message for error in VALIDATOR.iter_errors(tables)] == []


names = st.sampled_from(["a", "home", "open", "base", "lift", "wrist", "x-y", "hip"])
angles = st.floats(-20, 20).map(lambda angle: quantity(angle, "rad"))
changes = st.dictionaries(
    st.one_of(
        st.tuples(st.just("pose"), names),
        st.tuples(st.just("pose"), names, names),
        st.tuples(st.just("joint"), names, st.sampled_from(["zero", "limits", "speed"])),
        st.tuples(st.just("joint"), names, st.just("mirror"), st.sampled_from(["zero", "disagreement"])),
        st.tuples(st.just("joint"), names, st.just("registers"), names),
        st.tuples(st.just("group"), names),
        st.tuples(st.just("motion"), names, st.just("steps")),
    ),
    st.one_of(st.none(), angles, st.lists(angles, max_size=3), st.integers(-9, 9), st.dictionaries(names, angles)),
    max_size=4,
)


@given(st.sampled_from([SIX, SIX.replace("\n", "\r\n"), FULL]), changes)
def test_changes_keep_all_else(text: str, wanted: dict[tuple[str, ...], Any]) -> None:
    """Only comments of what is taken away, of a value that becomes a table, or of a table that becomes one, may go."""
    if refusals := refused(lambda: edited(read_text(text), wanted)):
        assert "cannot be set" in refusals[0]  # a path that leads through a value
        return
    new = edited(read_text(text), wanted)
    after = tomllib.loads(new)
    for path, value in wanted.items():
        if any(other != path and other[: len(path)] == path[: len(other)] for other in wanted):
            continue  # another change concerns the same
        try:
            there = at(after, path)
        except KeyError:
            there = None
        assert there == value or (value == {} and there is None)
    tables = any(isinstance(value, dict) for value in wanted.values()) or any(
        path[0] == "pose" and len(path) == 2 for path in wanted
    )
    if None not in wanted.values() and not tables:
        kept = [comment for comment in re.findall(r"(?m)#.*$", text.replace("\r", "")) if comment in new]
        assert kept == re.findall(r"(?m)#.*$", text.replace("\r", ""))
    assert ("\r\n" in new) == ("\r\n" in text)
