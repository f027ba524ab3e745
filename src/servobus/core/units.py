"""How a raw register integer and a value a person can use are one and the same thing.

A `Scale` turns one into the other and back. Values are SI (rad, rad/s, s, V) with two exceptions that
the whole field makes: temperature is in degrees Celsius (`degC`), shares of full output are plain ratios (`1`).

    >>> angle = Quantity("rad", 300 * deg / 1023)
    >>> angle.encode(90 * deg)
    307
    >>> show(angle.decode(307), "rad")
    '90.0°'
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from enum import IntEnum, IntFlag
from numbers import Integral, Real
from typing import Any, ClassVar, Generic, TypeVar

from servobus.core.values import frozen

deg = math.pi / 180
"""One degree in radians: `90 * deg`."""
rpm = 2 * math.pi / 60
"""One revolution per minute in rad/s."""
ms = 1e-3
"""One millisecond in seconds."""

T = TypeVar("T")
EnumT = TypeVar("EnumT", bound=IntEnum)
FlagT = TypeVar("FlagT", bound=IntFlag)


class Scale(ABC, Generic[T]):
    """A two-way street between raw integers and values of type `T`.

    `encode` raises ValueError, with a sentence that names the value, for what has no raw form at all
    (NaN, an unknown choice). Whether a register accepts the raw integer is the register's business.
    """

    unit: str = ""
    """SI unit of the value; empty for plain counts, choices, flags and switches."""
    total: ClassVar[bool] = True
    """Whether every raw integer has a value."""

    @abstractmethod
    def decode(self, raw: int) -> T: ...

    @abstractmethod
    def encode(self, value: T) -> int: ...

    def parse(self, text: str) -> T:
        """Read a value as a person types it ("90", "90deg", "on", "0x20"); raises ValueError."""
        return self.decode(int(text, 0))

    def show(self, value: T) -> str:
        """Write a value as a person reads it, unit included."""
        return str(value)


class Measure(Scale[float]):
    """A scale of values with a unit that people read and write: 1.5 V is 1.5 V whatever the raw integer is."""

    def parse(self, text: str) -> float:
        return parse(text, self.unit)

    def show(self, value: float) -> str:
        return show(value, self.unit)


@frozen
class Quantity(Measure):
    """value = (raw - zero) * step, in `unit`."""

    unit: str
    step: float
    zero: int = 0

    def decode(self, raw: int) -> float:
        return (raw - self.zero) * self.step

    def encode(self, value: float) -> int:
        steps = _number(value) / self.step
        if not math.isfinite(steps):
            raise ValueError(f"{said(value)} is not a number to send")
        return round(steps) + self.zero


@frozen
class Thermistor(Measure):
    """A temperature as a converter reads it from a thermistor in series with a resistor; hotter is higher.

    The raw integer is the share of `full` that lies on the resistor, so `full` / 2 is 25 °C, where both have the same
    resistance. `beta`, in kelvin, says how fast the resistance of the thermistor falls.

        raw / (full - raw) = exp(beta * (1 / 298.15 K - 1 / T))
    """

    beta: float
    full: int
    unit: str = "degC"

    def decode(self, raw: int) -> float:
        # At either end the share says no more than that it is less than half a step away.
        share = min(max(raw, _END), self.full - _END)
        return 1 / (1 / _ROOM - math.log(share / (self.full - share)) / self.beta) - _ZERO_CELSIUS

    def encode(self, value: float) -> int:
        kelvin = _number(value) + _ZERO_CELSIUS
        if not kelvin > 0:
            raise ValueError(f"{said(value)} °C is below absolute zero")
        exponent = self.beta * (1 / kelvin - 1 / _ROOM)
        return round(self.full / (1 + math.exp(exponent))) if exponent < _COLD else 0


_END = 0.499
"""Share in steps that stands for the raw integers at the ends of a `Thermistor`: it is rounded to them again."""
_ROOM = 298.15
"""K at which the resistance of a thermistor is told: 25 °C."""
_ZERO_CELSIUS = 273.15
"""K that are 0 °C."""
_COLD = 700.0
"""Exponent from which on exp is close to the end of the range of float."""


@frozen
class Count(Scale[int]):
    """The raw integer is the value; `unit` says what is counted, if anything ("position unit", "pwm")."""

    unit: str = ""

    def decode(self, raw: int) -> int:
        return raw

    def encode(self, value: int) -> int:
        if int(_number(value)) != value:
            raise ValueError(f"{said(value)} is not a whole number")
        return int(value)

    def parse(self, text: str) -> int:
        try:
            return int(text, 0)
        except ValueError:
            raise ValueError(f"{text!r} is not a whole number") from None


class Raw(Scale[float]):
    """A raw integer that is a quantity of a unit not known here, for that differs from model to model."""

    def decode(self, raw: int) -> float:
        return raw

    def encode(self, value: float) -> int:
        if int(_number(value)) != value:
            raise ValueError(f"{said(value)} is not a whole number, as a raw value is")
        return int(value)

    def show(self, value: float) -> str:
        return f"{value} (raw)"


RAW = Raw()


@frozen
class Switch(Scale[bool]):
    """Off and on. `on` is the raw value that means on: 0 for the inverted LED of the LX servos."""

    on: int = 1

    def decode(self, raw: int) -> bool:
        return (raw == self.on) if self.on == 0 else raw != 0

    def encode(self, value: bool) -> int:
        if value not in (0, 1):
            raise ValueError(f"{said(value)} is no switch: give True or False")
        return self.on if value else 1 - self.on

    def parse(self, text: str) -> bool:
        word = text.strip().lower()
        if word in ("on", "1", "true", "yes"):
            return True
        if word in ("off", "0", "false", "no"):
            return False
        raise ValueError(f"{text!r} is neither on nor off")

    def show(self, value: bool) -> str:
        return "on" if value else "off"


@frozen
class Choice(Scale[EnumT]):
    """One of the members of an IntEnum."""

    total = False

    options: type[EnumT]

    def decode(self, raw: int) -> EnumT:
        return self.options(raw)

    def encode(self, value: EnumT) -> int:
        given: Any = value
        option: EnumT | None = None
        if not isinstance(given, bool):  # True would be the option with number 1
            with suppress(ValueError, TypeError):
                option = self.options(given)
        if option is None:
            raise ValueError(f"{said(value)} is not one of {self._names()}")
        return int(option)

    def parse(self, text: str) -> EnumT:
        try:
            return self.options[text.strip().upper()]
        except KeyError:
            try:
                return self.options(int(text, 0))
            except ValueError:
                raise ValueError(f"{text!r} is not one of {self._names()}") from None

    def show(self, value: EnumT) -> str:
        return value.name.lower()

    def _names(self) -> str:
        return ", ".join(f"{option.name.lower()} ({option:d})" for option in self.options)


@frozen
class Flags(Scale[FlagT]):
    """A set of bits with names. Bits without a name are kept as they are.

    unused  those of the options that mean nothing on the model at hand
    """

    options: type[FlagT]
    unused: int = 0

    @property
    def used(self) -> tuple[FlagT, ...]:
        """The options that mean something."""
        return tuple(option for option in self.options if not option & self.unused)

    def decode(self, raw: int) -> FlagT:
        return self.options(raw)

    def encode(self, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, Integral):
            text = f"{said(value)} is no set of flags: give {self.options.__name__}, or a whole number"
            raise ValueError(text)  # noqa: TRY004 - a scale raises ValueError, whatever is wrong
        return int(_number(value))

    def parse(self, text: str) -> FlagT:
        """Read "overload+overheating", "none" or a number."""
        try:
            return self.options(int(text, 0))
        except ValueError:
            flags = self.options(0)
        for word in re.split(r"[+|,\s]+", text.strip()):
            if word.lower() in ("", "none"):
                continue
            named = {option.name: option for option in self.used}
            if word.upper() not in named:
                known = ", ".join(name.lower() for name in named if name)
                raise ValueError(f"{word!r} is not one of {known}")
            flags |= named[word.upper()]
        return flags

    def show(self, value: FlagT) -> str:
        names = [option.name.lower() for option in self.used if option in value and option.name]
        rest = int(value) & ~sum(int(option) for option in self.used)
        return "+".join(names + ([f"{rest:#04x}"] if rest else [])) or "none"


@frozen
class BaudDivisor(Scale[int]):
    """value = clock / (raw + 1), rounded: how Dynamixel protocol 1.0 codes its speeds.

    `others` are codes that mean a speed of their own instead, each with that speed.
    """

    clock: int
    others: tuple[tuple[int, int], ...] = ()
    unit: str = "baud"

    def exact(self, raw: int) -> float:
        """Give the speed without rounding."""
        return dict(self.others).get(raw) or self.clock / (raw + 1)

    def decode(self, raw: int) -> int:
        return round(self.exact(raw))

    def encode(self, value: int) -> int:
        if not _number(value) > 0:
            raise ValueError(f"{said(value)} is not a speed")
        for code, speed in self.others:
            if speed == value:
                return code
        raw = round(min(self.clock / value, self.clock)) - 1  # the quotient by a tiny number is infinite
        # A code that misses the wanted speed by 3 % or more would leave the servo unreachable.
        if raw < 0 or raw in dict(self.others) or abs(self.clock / (raw + 1) / value - 1) >= 0.03:
            raise ValueError(f"no code comes within 3 % of {said(value)} baud")
        return raw

    def parse(self, text: str) -> int:
        return Count().parse(text)

    def show(self, value: int) -> str:
        return f"{value} baud"


@frozen
class Lookup(Scale[int]):
    """value = codes[raw]: how HerkuleX codes its speeds."""

    total = False

    codes: Mapping[int, int]
    unit: str = "baud"

    def decode(self, raw: int) -> int:
        try:
            return self.codes[raw]
        except KeyError:
            raise ValueError(f"code {raw} is not one of {', '.join(map(str, self.codes))}") from None

    def encode(self, value: int) -> int:
        for code, meant in self.codes.items():
            if meant == value:
                return code
        raise ValueError(f"{said(value)} {self.unit} is not one of {', '.join(map(str, self.codes.values()))}")

    def parse(self, text: str) -> int:
        return Count().parse(text)

    def show(self, value: int) -> str:
        return f"{value} {self.unit}"


LONGEST = 40
"""Characters of a value that a message repeats; a caller may pass a text of any length for a number."""


def finite(value: Any) -> float | None:
    """Give a number back that one can reckon with; None for a text, None, True, NaN, infinity, or what is as large."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    number: Any = value
    try:
        usable = math.isfinite(number)
    except OverflowError:  # an int beyond the range of float
        usable = False
    return number if usable else None


def _number(value: Any) -> float:
    """Give a finite number back. Raises ValueError for what is none: a text, None, True, NaN, infinity."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"{said(value)} is not a number")  # noqa: TRY004 - as all scales do
    number = finite(value)
    if number is None:
        raise ValueError(f"{said(value)} is not a number to send")
    return number


def said(value: object) -> str:
    """Write a value that was refused: shortened, since it may be anything."""
    try:
        text = f"{value}" if isinstance(value, Real) else repr(value)
    except ValueError:  # Python writes no int of more than 4300 digits
        return "an int of thousands of digits"
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


# How people read and write a quantity: unit -> (symbol, size of one symbol in the unit, decimals).
_SHOWN: dict[str, tuple[str, float, int]] = {
    "rad": ("°", deg, 1),
    "rad/s": ("°/s", deg, 1),
    "rad/s2": ("°/s²", deg, 1),
    "rad/s3": ("°/s³", deg, 1),
    "s": (" s", 1.0, 4),
    "V": (" V", 1.0, 1),
    "degC": (" °C", 1.0, 0),
    "1": (" %", 0.01, 1),
}
_WORDS: dict[str, dict[str, float]] = {
    "rad": {"": deg, "°": deg, "deg": deg, "rad": 1.0, "turn": 2 * math.pi},
    "rad/s": {"": deg, "°/s": deg, "deg/s": deg, "rad/s": 1.0, "rpm": rpm},
    "rad/s2": {"": deg, "°/s²": deg, "deg/s2": deg, "rad/s2": 1.0},
    "rad/s3": {"": deg, "°/s³": deg, "deg/s3": deg, "rad/s3": 1.0},
    "s": {"": 1.0, "s": 1.0, "ms": ms, "us": 1e-6, "µs": 1e-6},
    "V": {"": 1.0, "v": 1.0, "mv": 1e-3},
    "degC": {"": 1.0, "°c": 1.0, "c": 1.0, "degc": 1.0},
    "1": {"": 0.01, "%": 0.01},
}


def show(value: float, unit: str) -> str:
    """Write a quantity as a person reads it: angles in degrees, shares in percent."""
    if unit not in _SHOWN:
        return f"{value:g} {unit}".rstrip()
    symbol, size, decimals = _SHOWN[unit]
    if unit == "s":
        return _show_time(value)
    return f"{round(value / size, decimals) + 0.0:.{decimals}f}{symbol}"  # + 0.0: no "-0.0"


def _show_time(value: float) -> str:
    for size, symbol in ((1.0, "s"), (ms, "ms"), (1e-6, "µs")):
        if abs(value) >= size:
            return f"{round(value / size, 4):.8g} {symbol}"
    return "0 s"


def shown(value: float, unit: str) -> tuple[float, str]:
    """Give the number and the symbol `show` would write, for tables and JSON."""
    symbol, size, decimals = _SHOWN.get(unit, (f" {unit}", 1.0, 6))
    return round(value / size, max(decimals, 4)), symbol.strip()


def parse(text: str, unit: str) -> float:
    """Read a quantity as a person writes it: "90", "90deg" and "1.5708rad" are the same angle.

    Without a unit the number is in the unit that `show` writes. Raises ValueError.
    """
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*([^\s\d].*?)?\s*", text, re.IGNORECASE)
    words: Mapping[str, Any] = _WORDS.get(unit, {"": 1.0, unit.lower(): 1.0})
    if not match:
        raise ValueError(f"{text!r} is not a number")
    word = (match[2] or "").lower()
    if word not in words:
        known = ", ".join(name for name in words if name)
        raise ValueError(f"{match[2]!r} is not a unit known here: use {known}")
    return float(match[1]) * float(words[word])
