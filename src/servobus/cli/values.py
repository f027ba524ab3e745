"""Values as people type them on the command line: ids, speeds, registers, quantities with units."""

from collections.abc import Iterable, Sequence
from typing import Any, Literal, TypeAlias

import click

from servobus.core.arguments import check_baud
from servobus.core.ids import LAST_ID, check_id, parse_ids
from servobus.core.registers import Register
from servobus.core.units import parse
from servobus.errors import BadValue, UsageError
from servobus.families.model import Model

ALL: Literal["all"] = "all"


class IdType(click.ParamType[int]):
    """The id of one servo; the broadcast id is refused, since every servo would obey."""

    name = "id"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        try:
            id = int(value)
        except ValueError:
            self.fail(f"{value!r} is not an id: a number 0 .. {LAST_ID}", param, ctx)
        return check_id(id)


Ids: TypeAlias = tuple[int, ...] | Literal["all"]
"""Which servos are meant: some ids, each once, or all that there are."""


class IdsType(click.ParamType[Ids]):
    """Ids as one word: "7", "1-4,7", or the word `all`."""

    name = "ids"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Ids:
        if not isinstance(value, str):
            return tuple(value)
        if value == ALL:
            return ALL
        try:
            return tuple(dict.fromkeys(parse_ids(value)))
        except BadValue:
            raise
        except UsageError as error:
            self.fail(str(error), param, ctx)


def id_list(text: str) -> list[int]:
    """Read the ids of the option --ids: "1-4,7", or `all`."""
    try:
        ids = IDS.convert(text, None, None)
    except UsageError as error:
        raise click.BadParameter(str(error), param_hint="--ids") from None
    return list(range(LAST_ID + 1)) if isinstance(ids, str) else sorted(ids)


def are_several(ids: Ids) -> bool:
    """Tell whether results are lists: more than one servo is named, or all."""
    return ids == ALL or len(ids) > 1


def joined_ids(words: Iterable[Ids]) -> Ids:
    """Give the ids that several words name, each once. Raises UsageError for ids beside `all`."""
    named = list(words)
    if ALL in named and len(named) > 1:
        raise click.UsageError(f"say either ids or `{ALL}`")
    if ALL in named:
        return ALL
    return tuple(dict.fromkeys(id for ids in named if not isinstance(ids, str) for id in ids))


def split_ids(words: Sequence[str]) -> tuple[Ids, tuple[str, ...]]:
    """Cut words in two: the ids at their beginning, and the others. Raises UsageError without ids.

    What begins with a digit and has no = in it is ids.
    """
    count = 1
    while count < len(words) and (words[count] == ALL or (words[count][:1].isdecimal() and "=" not in words[count])):
        count += 1
    return joined_ids(IDS.convert(word, None, None) for word in words[:count]), tuple(words[count:])


class BaudType(click.ParamType[int | Literal["all"]]):
    """A speed in baud, or the word `all`."""

    name = "baud"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == ALL:
            return ALL
        try:
            baud = int(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number of baud nor `all`", param, ctx)
        return check_baud(baud)


class UnitType(click.ParamType[float]):
    """A quantity as people type it: "1.5", "1.5s", "60deg/s"."""

    def __init__(self, name: str, unit: str) -> None:
        self.name = name
        self._unit = unit

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:  # noqa: ARG002
        if isinstance(value, float):
            return value
        try:
            return parse(value, self._unit)
        except ValueError as error:
            raise BadValue(f"{param.opts[0] if param else self.name}: {error}") from None


ID = IdType()
IDS = IdsType()
BAUD = BaudType()
ANGLE = UnitType("angle", "rad")
SECONDS = UnitType("seconds", "s")
SPEED = UnitType("deg/s", "rad/s")
SHARE = UnitType("percent", "1")
CURRENT = UnitType("ampere", "A")


def split_assignment(text: str, kind: str) -> tuple[str, str]:
    """Cut NAME=VALUE in two."""
    name, equals, value = text.partition("=")
    if not (name.strip() and equals and value.strip()):
        raise click.UsageError(f"{text!r} is not {kind}")
    return name.strip(), value.strip()


def check_above_0(option: str, value: float | None) -> None:
    """Refuse a number that is not above 0. Raises BadParameter."""
    if value is not None and value <= 0:
        raise click.BadParameter(f"{value:g} is not above 0", param_hint=option)


def readable(model: type[Model], name: str) -> Register[Any]:
    """Find a register by name. Raises UnknownName, or UsageError for one that is reserved."""
    row = model.register(name)
    if not row.readable:
        raise UsageError(f"{row.model} {row.name} is reserved: it has no meaning")
    return row
