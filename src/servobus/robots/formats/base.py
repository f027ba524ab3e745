"""What all formats share: what an export gives, what an import gives, and what is said to it.

A format is pure: bytes of the other program's file and a robot file in, text or values out. It opens no file and asks
nothing: what the other file lacks is given as `Given`, or stays open in the new file, as the path `OPEN_PORT` does.
"""

import json
import re
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from servobus.core.values import frozen
from servobus.errors import FormatError
from servobus.families import registry
from servobus.families.model import Model
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.kinds import NAME, shown
from servobus.robots.file.writing import Key

NOTHING: Mapping[str, str] = MappingProxyType({})
ALL = ""
"""Under this name stands what was given for all that have no value of their own."""


class Given:
    """What the user says about a file of another program. It notes what was asked for, so that slips are found.

    source   what the file is called, for messages and comments
    ports    name of a port there -> its path; under `ALL` for all others
    models   name of a joint -> the model of its servo; under `ALL` for all others
    joints   what a joint is called there -> its name in the robot file
    kind     what positions without a unit mean
    motion   what a motion is to be called
    """

    def __init__(
        self,
        source: str,
        ports: Mapping[str, str] = NOTHING,
        models: Mapping[str, str] = NOTHING,
        joints: Mapping[str, str] = NOTHING,
        kind: str | None = None,
        motion: str | None = None,
    ) -> None:
        self.source = source
        self._said = {"port": ports, "model": models, "joint": joints, "kind": _alone(kind), "name": _alone(motion)}
        self._used: set[tuple[str, str]] = set()

    def port(self, name: str) -> str | None:
        """Give the path that was said for a port."""
        return self._take("port", name) or self._take("port", ALL)

    def model(self, joint: str) -> type[Model] | None:
        """Give the model that was said for a joint. Raises UnknownName."""
        said = self._take("model", joint) or self._take("model", ALL)
        return None if said is None else registry.model(said)

    def called(self, name: str) -> str | None:
        """Give the name in the robot file that was said for what is called so in the other one."""
        return self._take("joint", name)

    def joint(self, name: str) -> str:
        """Give the name in the robot file of what is called so in the other one. Raises FormatError."""
        ours = self.called(name) or name
        if not re.fullmatch(NAME, ours):
            raise FormatError(
                f"{self.source}: {shown(name)} is no name of a joint in a robot file; give it one of letters, digits, "
                f"_ and -, as in --joint {shown(name)}=NAME"
            )
        return ours

    @property
    def kind(self) -> str | None:
        """What positions without a unit mean."""
        return self._take("kind", ALL)

    @property
    def motion(self) -> str | None:
        """What a motion is to be called."""
        return self._take("name", ALL)

    def unused(self) -> list[str]:
        """Give what was said and never asked for, as options."""
        return [
            f"--{what} {f'{name}={value}' if name else value}"
            for what, pairs in self._said.items()
            for name, value in pairs.items()
            if (what, name) not in self._used
        ]

    def _take(self, what: str, name: str) -> str | None:
        self._used.add((what, name))
        return self._said[what].get(name)


def _alone(value: str | None) -> Mapping[str, str]:
    return NOTHING if value is None else {ALL: value}


class Written(NamedTuple):
    """What an export gives: the text of the file, and what of this robot the text does not carry."""

    text: str
    notes: tuple[str, ...]


class Changes(NamedTuple):
    """What an import changes in a robot file.

    changes  as `edited` takes them
    files    name -> text of files that are to be written beside the robot file
    notes    what was left out, or taken otherwise than it stood there
    done     what was taken, in words
    """

    changes: Mapping[Key, Any]
    files: Mapping[str, str]
    notes: tuple[str, ...]
    done: str


class Noted:
    """A value of a new robot file, with a remark behind it."""

    def __init__(self, value: Any, remark: str) -> None:
        self.value, self.remark = value, remark


class Draft(NamedTuple):
    """A robot file that an import makes.

    title    what it was made from
    ports    name -> keys of the table [port.NAME]
    joints   name -> keys of the table [joint.NAME]
    groups   name -> joints
    lost     what the other format cannot say, a sentence each: comments at the head of the file
    notes    what of this file was not taken: comments too, and told to the user

    A value may be `Noted`.
    """

    title: str
    ports: Mapping[str, Mapping[str, Any]]
    joints: Mapping[str, Mapping[str, Any]]
    groups: Mapping[str, tuple[str, ...]]
    lost: tuple[str, ...]
    notes: tuple[str, ...]


@frozen
class Format:
    """One format of another program.

    name    as it is said on the command line
    title   what such a file is called
    ends    how names of such files end
    holds   what is carried over, as a part of a sentence
    lacks   what such a file cannot say, as a part of a sentence
    known   tells from the bytes of a file whether they are of this format
    write   makes such a file
    new     makes a robot file
    onto    takes what is in such a file into a robot file that is there
    """

    name: str
    title: str
    ends: tuple[str, ...]
    holds: str
    lacks: str
    known: Callable[[bytes], bool]
    write: Callable[[RobotFile], Written] | None = None
    new: Callable[[bytes, Given], Draft] | None = None
    onto: Callable[[bytes, RobotFile, Given], Changes] | None = None

    @property
    def a_title(self) -> str:
        """The title for a sentence: "an action group of Hiwonder"."""
        return f"{'an' if self.title[0] in 'aeio' else 'a'} {self.title}"


def text_of(data: bytes, source: str) -> str:
    """Give the text of a file. Raises FormatError if it is none."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FormatError(f"{source}: this is no text in UTF-8") from None


def json_of(data: bytes, source: str) -> Any:
    """Give what a JSON file says. Raises FormatError if it is none."""
    try:
        return json.loads(text_of(data, source))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{source}: this is no JSON: {error}") from None


def json_or_none(data: bytes) -> Any:
    """Give what a JSON file says; None for one that is none."""
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        return None


def plain_name(text: str) -> str:
    """Make a name for a robot file out of any text: "ttyUSB0" of "/dev/ttyUSB0"."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", text.rstrip("/").rsplit("/", 1)[-1]).strip("_-")
    return name if re.fullmatch(NAME, name) else f"_{name}"


def added(table: dict[str, Any], name: str, values: Mapping[str, Any], source: str) -> None:
    """Add an entry of a new robot file. Raises FormatError where there is one of this name."""
    if name in table:
        raise FormatError(f"{source}: two of its entries would be called {name} in a robot file; rename one of them")
    table[name] = dict(values)


def listed(names: Iterable[str]) -> str:
    """List names for a sentence."""
    return ", ".join(names)
