"""What users said once and for all about servos that cannot say their model: a file in their configuration folder.

    ["0403:6001 serial number A50285BI"]
    adapter = "FTDI FT232R USB UART"
    3 = "hts35h"
    7 = "lx16a"

A table for each adapter, or for each port that is no adapter, such as "socket://pi.local:3333"; in it the model by id,
or that of `all` its servos. Opening a bus reads the file and never writes it. What cannot be used is told by its line
and left out; a file that is no TOML is never written over.
"""

import contextlib
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from servobus.core.ids import check_id
from servobus.errors import BadValue, UnknownName, UsageError
from servobus.families import registry
from servobus.families.base import Family, Model
from servobus.transports.file_lock import locked_beside, replace_text

ALL = "all"
"""In place of an id: all servos of an adapter of which nothing else is said."""
ADAPTER = "adapter"
"""Key of the words about the adapter, for people."""
HEAD = "# Which servos are of which model, where they cannot say so themselves. Written by `servobus remember`."

Tables = dict[str, dict[str, str]]
"""Adapter -> id -> key of a model, as they stand in the file."""


def place() -> Path:
    """Give the file, whether it exists or not. Raises UsageError for a user without a home."""
    said = os.environ.get("XDG_CONFIG_HOME", "")
    try:
        if Path(said).is_absolute():
            folder = Path(said)
        elif sys.platform == "win32":
            folder = Path(os.environ.get("APPDATA") or Path.home() / "AppData/Roaming")
        elif sys.platform == "darwin":
            folder = Path.home() / "Library/Application Support"
        else:
            folder = Path.home() / ".config"
    except RuntimeError as error:
        raise UsageError(f"no home folder is known ({error}); XDG_CONFIG_HOME can name another one") from None
    return folder / "servobus" / "models.toml"


def check_model(model: type[Model]) -> None:
    """Refuse a model that needs not be remembered. Raises UsageError."""
    if model.generic:
        raise UsageError(f"{model.key()} is no model but stands for an unknown one; `servobus models` lists the models")
    if model.number is not None:
        raise UsageError(f"{model.title} servos say themselves what they are: there is nothing to remember")


class Remembered:
    """What is remembered of the servos on one adapter, as the file has it now.

    tell   is given each problem with the file once, a sentence
    """

    def __init__(self, adapter: str, tell: Callable[[str], None] | None = None) -> None:
        self._adapter = adapter
        self.tell = tell or _log
        self._told: set[str] = set()
        self._seen: tuple[int, int] | None = None
        self._models: dict[str, type[Model]] = {}

    def model(self, family: Family, id: int, number: int | None) -> type[Model] | None:
        """Give the model that a servo was said to be of; None if nothing is known, or the servo knows better."""
        self._look()
        model = self._models.get(str(id), self._models.get(ALL))
        if model is None or model.family is not family:
            return None
        if number is not None or model.number is not None:
            if number is not None and number != model.number:
                self._tell(f"id {id} is remembered as {model.title}, and says itself what it is: that is believed")
            return None
        return model

    def move(self, family: Family, old: int, new: int) -> None:
        """Take what is remembered of a servo along to another id, if anything is; what cannot be done is told."""
        self._look()
        model = self._models.get(str(old))
        if model is None or model.family is not family:
            return
        try:
            with _changed() as tables:
                if (name := tables.get(self._adapter, {}).pop(str(old), None)) is not None:
                    tables[self._adapter][str(new)] = name
        except UsageError as error:
            self._tell(f"the servo with id {new} is still remembered under id {old}: {error}")

    def _look(self) -> None:
        """Read the file if it has changed since."""
        try:
            about = place().stat()
            seen = about.st_mtime_ns, about.st_size
        except (OSError, UsageError):
            self._seen, self._models = None, {}
            return
        if seen == self._seen:
            return
        self._seen, self._models = seen, {}
        try:
            text = read(place())
            named = parsed(text)
        except UsageError as error:
            self._tell(f"{error}; it is left out")
            return
        for id, name in named.get(self._adapter, {}).items():
            if id != ADAPTER:
                try:
                    self._models[id] = registry.model(name)
                except UnknownName as error:
                    self._tell(f"{place()}{line_of(text, self._adapter, id)}: {error}; it is left out")

    def _tell(self, problem: str) -> None:
        if problem not in self._told:
            self._told.add(problem)
            self.tell(problem)


def remember(adapter: str, words: str, ids: Sequence[int] | None, model: type[Model]) -> None:
    """Keep that servos on an adapter are of a model: those with these ids, or all of which nothing else is kept.

    words   what people call the adapter

    Raises UsageError if the file cannot be written, or is damaged.
    """
    check_model(model)
    with _changed() as tables:
        table = tables.setdefault(adapter, {})
        if words and words != adapter:
            table[ADAPTER] = words
        for id in [ALL] if ids is None else map(str, ids):
            table[id] = model.key()


def forget(adapter: str, ids: Sequence[int] | None) -> list[str]:
    """Keep nothing any more of servos on an adapter: of these ids, or of all. Gives what was kept of them: ids.

    Raises UsageError if the file cannot be written, or is damaged.
    """
    if not place().exists():
        return []
    with _changed() as tables:
        table = tables.get(adapter, {})
        gone = [id for id in table if id != ADAPTER and (ids is None or id in map(str, ids))]
        for id in gone:
            del table[id]
        return gone


def everything() -> Tables:
    """Give all that is remembered. Raises UsageError if the file cannot be read, or is damaged."""
    path = place()
    return parsed(read(path)) if path.exists() else {}


# The file


def read(path: Path) -> str:
    """Give the text of the file. Raises UsageError if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise UsageError(f"{path}, line {line}: it is no text in UTF-8") from None


def parsed(text: str) -> Tables:
    """Give what a file says. Raises UsageError, which names the line, for one that is damaged."""
    import tomllib  # noqa: PLC0415 - most users have no such file

    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        what, _, where = str(error).rpartition(" (at ")
        line = where.removesuffix(")").partition(",")[0] if what else ""
        line = line if line.startswith("line") else f"line {max(1, len(text.splitlines()))}"
        raise UsageError(f"{place()}, {line}: {what or error}") from None
    for adapter, table in data.items():
        if not isinstance(table, dict):
            raise UsageError(f"{place()}{line_of(text, '', adapter)}: {adapter} belongs into the table of an adapter")
        for id, name in table.items():
            if not isinstance(name, str):
                raise UsageError(f'{place()}{line_of(text, adapter, id)}: {id} is no name of a model, such as "lx16a"')
            if id not in (ADAPTER, ALL):
                try:
                    check_id(int(id))
                except (ValueError, BadValue):
                    raise UsageError(f"{place()}{line_of(text, adapter, id)}: {id} is no id") from None
    return data


def line_of(text: str, adapter: str, key: str) -> str:
    """Say in which line of a file something stands; "" if that cannot be told."""
    inside = ""
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("["):
            inside = line.strip().strip("[]").strip("\"'")
        elif inside == adapter and line.partition("=")[0].strip(" \"'") == key:
            return f", line {number}"
    return ""


def written(tables: Mapping[str, Mapping[str, str]]) -> str:
    """Give the text of a file: ids in their order, adapters without any left out."""
    parts = [HEAD]
    for adapter, table in tables.items():
        ids = sorted((id for id in table if id.isdecimal()), key=int)
        named = [ALL] * (ALL in table) + ids
        if named:
            words = [f"{ADAPTER} = {_quoted(table[ADAPTER])}"] if ADAPTER in table else []
            parts.append(
                "\n".join([f"[{_quoted(adapter)}]", *words, *(f"{id} = {_quoted(table[id])}" for id in named)])
            )
    return "\n\n".join(parts) + "\n"


def _quoted(text: str) -> str:
    """Write a TOML string."""
    plain = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in plain) + '"'


@contextlib.contextmanager
def _changed() -> Iterator[Tables]:
    """Read the file, and put it back changed, while no other program does. Raises UsageError; then it is as it was."""
    path = place()
    path = path.resolve()  # a link stays a link
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with locked_beside(path):
            old = read(path) if path.exists() else ""
            tables = parsed(old)
            yield tables
            text = written(tables)
            if text != old and (tables or old):
                replace_text(path, text)
    except OSError as error:
        raise UsageError(
            f"{path} cannot be written: {error.strerror or error}; XDG_CONFIG_HOME can name another folder"
        ) from error


def _log(problem: str) -> None:
    import logging  # noqa: PLC0415 - slow to import, and seldom wanted

    logging.getLogger("servobus").warning(problem)
