"""Writing a robot file: changes that keep all comments, a dated copy of what was there before, and a way back.

file = read_file("arm.toml")
text = edited(file, {("pose", "home", "shoulder"): quantity(angle, "rad"), ("pose", "old"): None})
file = save(file, text)
file = undo("arm.toml")
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from datetime import UTC, datetime, timedelta
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple

from servobus.core.units import shown
from servobus.errors import RobotFileError
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.reading import read_bytes, read_file, read_text
from servobus.transports.file_lock import locked_beside, replace_text

KEPT = 20
"""Dated copies of a file that are kept beside it; older ones are removed."""
STAMP = "%Y-%m-%d_%H-%M-%S-%f"
"""How the moment of a copy, UTC, stands in its name."""

Key = tuple[str, ...]
_WORDS = {"°": "deg", "°/s": "deg/s", "°/s²": "deg/s2", "°/s³": "deg/s3", "°C": "degC"}


def quantity(value: float, unit: str) -> str:
    """Write a quantity as a robot file has it: π/2 rad is "90deg". Rounded to a ten-thousandth of what is written."""
    number, symbol = shown(value, unit)
    digits = f"{number + 0.0:.6f}".rstrip("0").rstrip(".")  # + 0.0: no "-0"
    return f"{digits}{_WORDS.get(symbol, symbol)}"


def edited(file: RobotFile, changes: Mapping[Key, Any]) -> str:
    """Give the text of a robot file with changes, and all comments and the order kept. Writes nothing.

    changes  path of a key -> its new value: a text, a number, a bool, a list, or a mapping for a table, which then has
             these keys and no others. None takes a key or a table away. Quantities are given as texts; see `quantity`.

    Where anything changes, `changed` in the table [robot] becomes the date of today.
    """
    before = tomllib.loads(file.text)
    if _changed(before, changes) == before:
        return file.text
    dated = {("robot", "changed"): datetime.now(UTC).astimezone().date().isoformat(), **changes}
    import tomlkit  # noqa: PLC0415 - only who writes files needs it

    marked = _marked(file.text)
    document = tomlkit.parse(marked.text)
    for path, value in dated.items():
        _set(document, path, value)
    text = _unmarked(tomlkit.dumps(document), marked)
    if _filled(tomllib.loads(text)) != _filled(_changed(before, dated)):
        where = ", ".join(f"[{'.'.join(path)}]" for path in changes)
        raise RobotFileError(
            f"{file.name}: {where} cannot be changed with all else kept as it is; write each table once, with its "
            "keys below its head"
        )
    return text


def create(path: str | PathLike[str], text: str) -> RobotFile:
    """Write a new robot file. Raises RobotFileError if there is a file already, or if the text is wrong."""
    where = Path(fspath(path))
    made = read_text(text, where)
    with _writing(where):
        if where.exists():
            raise RobotFileError(f"{where}: there is such a file already; give another name, or remove it")
        replace_text(where, text)
    return made


def save(file: RobotFile, text: str) -> RobotFile:
    """Put another text in the place of a robot file that was read. Gives what the new text says.

    The text is checked first, and what was there is kept as a dated copy beside the file. Raises RobotFileError, and
    then the file is as it was: where the text is wrong, or where the file is not the one any more that was read.
    """
    if file.path is None:
        raise RobotFileError(f"{file.name}: it was not read from a file, so there is none to write")
    made = read_text(text, file.path)
    if text == file.text:
        return file
    path = file.path.resolve()  # a link stays a link
    with _writing(path):
        _unchanged(file, path)
        _keep(path, file.text)
        replace_text(path, text)
    return made


def undo(path: str | PathLike[str]) -> RobotFile:
    """Bring back what stood in a robot file before the last `save`; another `undo` goes back further.

    The text that is undone is kept in a file whose name ends in `.undone`. Raises RobotFileError if there is no copy.
    """
    where = Path(fspath(path))
    real = where.resolve()
    with _writing(real):
        kept = copies(real)
        if not kept:
            raise RobotFileError(f"{where}: there is no dated copy beside it, so there is nothing to undo")
        if real.exists():
            replace_text(real.with_name(f"{real.name}.undone"), read_bytes(real))
        replace_text(real, read_bytes(kept[-1]))
        kept[-1].unlink()
    return read_file(where)


def copies(path: str | PathLike[str]) -> list[Path]:
    """Give the dated copies of a robot file, the oldest first."""
    where = Path(fspath(path)).resolve()
    return [copy for _, copy in sorted(_copies(where))]


def _copies(path: Path) -> Iterator[tuple[datetime, Path]]:
    for copy in path.parent.iterdir():
        if copy.name.startswith(f"{path.name}.") and copy.name.endswith(".bak"):
            try:
                moment = datetime.strptime(copy.name[len(path.name) + 1 : -len(".bak")], STAMP).replace(tzinfo=UTC)
            except ValueError:
                continue  # a copy that the user made
            yield moment, copy


def _keep(path: Path, text: str) -> None:
    """Keep a text as a dated copy, later by its name than all others, even after the clock was set back."""
    there = sorted(_copies(path))
    now = datetime.now(UTC)
    if there and now <= there[-1][0]:
        now = there[-1][0] + timedelta(microseconds=1)
    replace_text(path.with_name(f"{path.name}.{now.strftime(STAMP)}.bak"), text)
    for _, copy in there[: len(there) + 1 - KEPT]:
        copy.unlink(missing_ok=True)


def _unchanged(file: RobotFile, path: Path) -> None:
    try:
        there = read_bytes(path)
    except FileNotFoundError:
        there = None
    if there != file.text:
        what = "is gone" if there is None else "was changed by another program"
        raise RobotFileError(f"{file.path}: the file {what} since it was read; nothing was written, so do it again")


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Keep others from writing the file. What the system refuses is a RobotFileError."""
    try:
        with locked_beside(path):
            yield
    except BlockingIOError:
        raise RobotFileError(f"{path}: another program is writing it; wait until it has ended") from None
    except OSError as error:
        raise RobotFileError(f"{path}: cannot be written: {error.strerror or error}") from None


# Comments above the head of a table belong to it. The library that keeps comments has them at the end of the table
# before, where a new table would come between; so they are taken out meanwhile, and each head has a mark behind it.

_HEAD = r"[ \t]*\[[^\r\n]*"
_ABOVE = r"(?:[ \t]*(?:#[^\n]*)?\r?\n)*"


class _Marked(NamedTuple):
    """A text with marks behind its heads."""

    text: str
    mark: str
    comments: list[str]
    """What stood above each head, by the number of its mark."""
    end: str
    """The blank lines at the end of the text."""


def _marked(text: str) -> _Marked:
    mark = "#above"
    while mark in text:
        mark += "_"
    comments: list[str] = []

    def take(match: re.Match[str]) -> str:
        lines = match["above"].splitlines(keepends=True)
        # A comment right below the last key belongs to the table before, unless no blank line parts the two tables.
        blank = next((number for number, line in enumerate(lines) if not line.strip()), 0)
        first = next((number for number, line in enumerate(lines) if number >= blank and line.strip()), len(lines))
        comments.append("".join(lines[first:]))
        return f"{''.join(lines[:first])}{match['head']}{mark}{len(comments) - 1}#"

    end = text[len(text.rstrip()) :] or "\n"
    return _Marked(re.sub(rf"(?m)^(?P<above>{_ABOVE})(?P<head>{_HEAD})", take, text), mark, comments, end)


def _unmarked(text: str, marked: _Marked) -> str:
    """Put the comments back above the heads, and a blank line around new tables: their heads have no mark."""
    lines: list[str] = []
    new = False
    for line in re.split(r"\r?\n", text.rstrip()):
        if re.match(_HEAD, line):
            before, is_new = new, marked.mark not in line
            new = is_new
            if (before or is_new) and lines and lines[-1].strip():
                lines.append("")
        head = re.fullmatch(rf"(.*){marked.mark}(\d+)#", line)
        lines.append(marked.comments[int(head[2])] + head[1] if head else line)
    ending = "\r\n" if "\r\n" in marked.end else "\n"
    return ending.join(lines) + marked.end


# Changes in a tree of tables


def _changed(tables: Mapping[str, Any], changes: Mapping[Key, Any]) -> dict[str, Any]:
    """Give the same tables with changes made, as plain values. Raises RobotFileError for a path through a value."""
    made: dict[str, Any] = deepcopy(dict(tables))
    for path, value in changes.items():
        table = made
        for parent in path[:-1]:
            table = table.get(parent, {}) if value is None else table.setdefault(parent, {})
            if not isinstance(table, dict):
                raise RobotFileError(f"[{'.'.join(path)}] cannot be set: {parent} is a value, and no table")
        if value is None:
            table.pop(path[-1], None)
        else:
            table[path[-1]] = _plain(value)
    return made


def _filled(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Give tables without those in which nothing is left."""
    filled = {key: _filled(value) if isinstance(value, Mapping) else value for key, value in tables.items()}
    return {key: value for key, value in filled.items() if value != {}}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _set(document: Any, path: Key, value: Any) -> None:
    """Change one key of a document of tomlkit."""
    import tomlkit  # noqa: PLC0415 - only who writes files needs it

    *parents, key = path
    table = document
    for depth, parent in enumerate(parents):
        if parent not in table:
            if value is None:
                return
            # One with nothing but tables in it needs no head of its own: [pose.home] says all.
            table[parent] = tomlkit.table(is_super_table=depth < len(parents) - 1 or isinstance(value, Mapping))
        table = table[parent]
    _put(table, key, value)


def _put(table: Any, key: str, value: Any) -> None:
    """Set a key of a table. A table that is there is changed key by key, so that its comments stay."""
    import tomlkit  # noqa: PLC0415

    if value is None:
        if key in table:
            del table[key]
    elif isinstance(value, Mapping) and not isinstance(table, tomlkit.items.InlineTable):
        if not isinstance(table.get(key), Mapping):
            table[key] = tomlkit.table()
        there = table[key]
        for gone in [name for name in there if name not in value]:
            del there[gone]
        for name, one in value.items():
            _put(there, name, one)
    elif key not in table or table[key] != value:
        table[key] = _item(value)


def _item(value: Any) -> Any:
    """Make a value; each table of a list gets a line."""
    import tomlkit  # noqa: PLC0415

    if isinstance(value, Mapping):
        inline = tomlkit.inline_table()
        inline.update({name: _item(one) for name, one in value.items()})
        return inline
    if isinstance(value, list | tuple):
        array = tomlkit.array()
        array.extend(_item(one) for one in value)
        return array.multiline(any(isinstance(one, Mapping) for one in value))
    return tomlkit.item(value)
