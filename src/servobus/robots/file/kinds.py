"""Kinds of values in a robot file: each reads what TOML gives, and says in a JSON Schema what it takes."""

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Generic, TypeVar

from servobus.core.arguments import check_baud
from servobus.core.units import finite, parse, said
from servobus.core.values import frozen
from servobus.errors import UsageError
from servobus.families import registry
from servobus.families.model import Model

T = TypeVar("T")

NAME = r"[A-Za-z_][A-Za-z0-9_-]*"
"""What names of joints, groups, poses, motions and ports look like."""
WIDEST = 4
"""Items of a list of numbers that a message repeats."""


class Kind(ABC, Generic[T]):
    """Reads a value of a robot file. Raises ValueError, with a sentence that names value and remedy."""

    @abstractmethod
    def read(self, value: Any) -> T: ...

    @abstractmethod
    def schema(self) -> dict[str, Any]:
        """Give what a JSON Schema says of such a value."""


@frozen
class Text(Kind[str]):
    """A text that is not empty; `example` is one."""

    example: str

    def read(self, value: Any) -> str:
        if not isinstance(value, str) or not value.strip():
            raise ValueError(f'{shown(value)} is no text; write one such as "{self.example}"')
        return value

    def schema(self) -> dict[str, Any]:
        return {"type": "string", "minLength": 1, "examples": [self.example]}


@frozen
class Name(Kind[str]):
    """The name of something in the same file: `of` says what."""

    of: str

    def read(self, value: Any) -> str:
        if not isinstance(value, str) or not re.fullmatch(NAME, value):
            raise ValueError(f"{shown(value)} is no name of a {self.of}: letters, digits, _ and -, no digit first")
        return value

    def schema(self) -> dict[str, Any]:
        return {"type": "string", "pattern": f"^{NAME}$"}


@frozen
class Whole(Kind[int]):
    """A whole number from `low` to `high`."""

    low: int
    high: int

    def read(self, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not self.low <= value <= self.high:
            raise ValueError(f"{shown(value)} is no whole number from {self.low} to {self.high}")
        return value

    def schema(self) -> dict[str, Any]:
        return {"type": "integer", "minimum": self.low, "maximum": self.high}


@frozen
class Direction(Kind[int]):
    """1, or -1."""

    one: int = 1

    def read(self, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or abs(value) != self.one:
            raise ValueError(
                f"{shown(value)} is no direction: write 1, or -1 where the servo turns the other way round"
            )
        return value

    def schema(self) -> dict[str, Any]:
        return {"enum": [self.one, -self.one]}


@frozen
class Number(Kind[float]):
    """A number above 0, without a unit."""

    example: str

    def read(self, value: Any) -> float:
        number = finite(value)
        if number is None or not number > 0:
            raise ValueError(f"{shown(value)} is no number above 0; write one such as {self.example}")
        return float(number)

    def schema(self) -> dict[str, Any]:
        return {"type": "number", "exclusiveMinimum": 0, "examples": [float(self.example)]}


@frozen
class Measured(Kind[float]):
    """A quantity: a text of a number and its unit, "-90deg" or "1.5rad".

    unit      the SI unit of what is given, as in `servobus.core.units`
    example   how one writes such a quantity
    above_0   whether it must be above 0
    least     the least value that is allowed; None if any is
    """

    unit: str
    example: str
    above_0: bool = False
    least: float | None = None

    def read(self, value: Any) -> float:
        if not isinstance(value, str):
            raise ValueError(
                f'{shown(value)} has no unit; write a number and its unit as a text, such as "{self.example}"'
            )
        if not re.search(r"[^\d.\s+-]", value):
            raise ValueError(f'"{value}" has no unit; write one behind the number, such as "{self.example}"')
        try:
            number = parse(value, self.unit)
        except ValueError as error:
            raise ValueError(f'{error}; write it as in "{self.example}"') from None
        if self.above_0 and not number > 0:
            raise ValueError(f'"{value}" is not above 0; write it as in "{self.example}"')
        if self.least is not None and number < self.least:
            raise ValueError(f'"{value}" is too little; write it as in "{self.example}"')
        return number

    def schema(self) -> dict[str, Any]:
        return {"type": "string", "pattern": r"^\s*[-+]?[0-9.]+\s*[^0-9.\s].*$", "examples": [self.example]}


@frozen
class Between(Kind[tuple[float, float]]):
    """Two quantities, the lower first."""

    each: Measured

    def read(self, value: Any) -> tuple[float, float]:
        example = f'["-{self.each.example}", "{self.each.example}"]'
        if not isinstance(value, list) or len(value) != 2:
            raise ValueError(f"{shown(value)} are no limits; write the lower and the upper, such as {example}")
        low, high = (self.each.read(one) for one in value)
        if not low < high:
            raise ValueError(f"{shown(value)}: the lower limit comes first, and both differ, such as {example}")
        return low, high

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": self.each.schema(), "minItems": 2, "maxItems": 2}


@frozen
class OneOf(Kind[str]):
    """One of several words."""

    words: tuple[str, ...]

    def read(self, value: Any) -> str:
        if value not in self.words:
            raise ValueError(f"{shown(value)} is not one of {', '.join(self.words)}")
        return str(value)

    def schema(self) -> dict[str, Any]:
        return {"enum": list(self.words)}


@frozen
class Switch(Kind[bool]):
    """True or false."""

    example: bool

    def read(self, value: Any) -> bool:
        if not isinstance(value, bool):
            raise ValueError(f"{shown(value)} is neither true nor false")
        return value

    def schema(self) -> dict[str, Any]:
        return {"type": "boolean"}


@frozen
class Names(Kind[tuple[str, ...]]):
    """A list of different names."""

    each: Name

    def read(self, value: Any) -> tuple[str, ...]:
        if not isinstance(value, list) or not value:
            raise ValueError(f"{shown(value)} is no list of names of {self.each.of}s")
        names = tuple(self.each.read(one) for one in value)
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise ValueError(f'"{twice}" stands there twice; leave one out')
        return names

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": self.each.schema(), "minItems": 1, "uniqueItems": True}


@frozen
class Speeds(Kind[tuple[int, ...]]):
    """Speeds of a port, bit/s."""

    example: int

    def read(self, value: Any) -> tuple[int, ...]:
        if not isinstance(value, list) or not value:
            raise ValueError(f"{shown(value)} is no list of speeds in bit/s; write it as in [{self.example}]")
        return tuple(Speed(self.example).read(one) for one in value)

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": Speed(self.example).schema(), "minItems": 1}


@frozen
class Speed(Kind[int]):
    """A speed of a port, bit/s."""

    example: int

    def read(self, value: Any) -> int:
        try:
            return check_baud(value)
        except UsageError as error:
            raise ValueError(str(error)) from None

    def schema(self) -> dict[str, Any]:
        return {"type": "integer", "minimum": 1, "examples": [self.example]}


@frozen
class ServoModel(Kind[type[Model]]):
    """A model of servos, by its name: "rx28"."""

    example: str

    def read(self, value: Any) -> type[Model]:
        if not isinstance(value, str):
            raise ValueError(f'{shown(value)} is no name of a model; write one such as "{self.example}"')
        try:
            return registry.model(value)
        except UsageError as error:
            raise ValueError(str(error)) from None

    def schema(self) -> dict[str, Any]:
        return {"type": "string", "examples": sorted(registry.MODELS)}


@frozen
class Table(Kind[Mapping[str, Any]]):
    """A table whose keys are names of `of`; what is in it is read later, for it needs what else is in the file."""

    of: str
    values: dict[str, Any]

    def read(self, value: Any) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            raise ValueError(f"{shown(value)} is no table of {self.of}s")
        return value

    def schema(self) -> dict[str, Any]:
        return {"type": "object", "additionalProperties": self.values}


def shown(value: Any) -> str:
    """Write a value as TOML has it, shortened."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{said(value)[1:-1]}"'
    if isinstance(value, list):
        more = ", ..." if len(value) > WIDEST else ""
        return f"[{', '.join(shown(one) for one in value[:WIDEST])}{more}]"
    return said(value)
