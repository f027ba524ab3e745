"""Options of a virtual servo: what real ones do in different ways, or what no manual says, by name.

    class Dynamixel1Servo(VirtualServo):
        goal_torque = Option(ON_OFF, practice=True, manual=False, decision="ED-31", text="...")

    servo.goal_torque = False       # or virtual_servo(RX28, 1, options={"goal_torque": "off"})

Each option has a value in either reading: `manual` is what the manual says, with this project's assumption where the
manual is silent; `practice` is what real servos, recordings of them and other people's programs show. A model can have
values of its own under `practice`, see `Model.practice`.
"""

import math
from collections.abc import Iterable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, Generic, Literal, NamedTuple, Protocol, Self, TypeAlias, TypeVar, get_args, overload

from servobus.core.units import Switch, parse, show
from servobus.core.values import frozen, replace
from servobus.errors import BadValue, UsageError
from servobus.families.model import Model

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)

Reading: TypeAlias = Literal["practice", "manual"]
READINGS: tuple[Reading, ...] = get_args(Reading)
"""All readings, the usual one first."""


class Kind(Protocol[T_co]):
    """Which values an option takes."""

    @property
    def words(self) -> str:
        """The values, as people type them."""
        ...

    def read(self, value: Any) -> T_co:
        """Give a value that was typed, or given from Python. Raises ValueError."""
        ...

    def show(self, value: Any) -> str: ...


class OnOff:
    """Something that is so, or is not."""

    words = "on, off"

    def read(self, value: Any) -> bool:
        return Switch().parse(str(value))

    def show(self, value: bool) -> str:
        return Switch().show(value)


@frozen
class OneOf:
    """One of several words."""

    choices: tuple[str, ...]

    @property
    def words(self) -> str:
        return ", ".join(self.choices)

    def read(self, value: Any) -> str:
        if value not in self.choices:
            raise ValueError(f"{value!r} is not one of {self.words}")
        return str(value)

    def show(self, value: str) -> str:
        return value


class Span(NamedTuple):
    """A time that differs from one occasion to the next: the shortest and the longest, s."""

    low: float
    high: float


NO_TIME = Span(0.0, 0.0)
LONGEST = 60.0
"""s that an option may take."""


@frozen
class Times:
    """A time, or a span of times. `usual` is what "on" stands for."""

    usual: Span | None = None

    @property
    def words(self) -> str:
        return "a time such as 6ms or 0.5s, a span such as 5ms-7ms, off" + ", on" * (self.usual is not None)

    def read(self, value: Any) -> Span:
        if isinstance(value, str):
            return self._parse(value)
        low, high = (value, value) if isinstance(value, int | float) else value
        if not 0 <= low <= high <= LONGEST:
            raise ValueError(f"{value!r} is no time, nor two, from 0 to {LONGEST:g} s, the shorter one first")
        return Span(float(low), float(high))

    def _parse(self, text: str) -> Span:
        word = text.strip().lower()
        if word == "off":
            return NO_TIME
        if word == "on" and self.usual:
            return self.usual
        low, _, high = word.partition("-")
        return self.read((_seconds(low), _seconds(high or low)))

    def show(self, value: Span) -> str:
        if value == NO_TIME:
            return "off"
        low, high = (show(time, "s").replace(" ", "") for time in value)
        return low if low == high else f"{low}-{high}"


class Limit:
    """A time after which something happens, s; it may be never."""

    words = "a time such as 500ms, never"

    def read(self, value: Any) -> float:
        time = math.inf if value == "never" else _seconds(value) if isinstance(value, str) else float(value)
        if not time > 0:
            raise ValueError(f"{value!r} is no time above 0")
        return time

    def show(self, value: float) -> str:
        return "never" if value == math.inf else show(value, "s").replace(" ", "")


def _seconds(text: str) -> float:
    """Read a time that was typed. Raises ValueError for one without its unit: 5 could be seconds or milliseconds."""
    time = parse(text, "s")
    number = text.strip()
    if time and not number[-1].isalpha():
        raise ValueError(f"{number} has no unit; write {number}ms or {number}s")
    return time


class HasOptions(Protocol):
    """What has the values of its options by name, and wants to know of changes."""

    options: dict[str, Any]

    def options_changed(self) -> None: ...


@frozen
class Option(Generic[T]):
    """One option of a firmware. As an attribute of a servo it is the value that the servo has.

    kind      which values it takes
    practice  its value as real servos are known, the usual reading
    manual    its value as the manual has it
    decision  number of the entry in docs/decisions.md that says what is known
    text      what it is about, as a phrase
    """

    kind: Kind[T]
    practice: T
    manual: T
    text: str
    decision: str = ""
    name: str = ""

    def __set_name__(self, owner: type, name: str) -> None:
        object.__setattr__(self, "name", name)

    @overload
    def __get__(self, servo: None, owner: type) -> Self: ...
    @overload
    def __get__(self, servo: HasOptions, owner: type) -> T: ...
    def __get__(self, servo: HasOptions | None, owner: type) -> Self | T:
        if servo is None:
            return self
        value: T = servo.options[self.name]
        return value

    def __set__(self, servo: HasOptions, value: T | str) -> None:
        servo.options[self.name] = self.read(value)
        servo.options_changed()

    def but(self, **changes: Any) -> "Option[T]":
        """Give an option with these changes, for a firmware that differs from the one it is taken from."""
        return replace(self, **changes)

    def read(self, value: Any) -> T:
        """Give a value that was typed, or given from Python. Raises BadValue."""
        try:
            return self.kind.read(value)
        except (TypeError, ValueError) as error:
            raise BadValue(f"{self.name}={value}: {error}; {self.name} takes {self.kind.words}") from None


@cache
def options_of(firmware: type) -> Mapping[str, Option[Any]]:
    """Give all options of a firmware by name, its own first.

    A class that gives a plain value in the place of an option has no such option: it always does the same.
    """
    found: dict[str, Option[Any]] = {}
    told: set[str] = set()
    for kind in firmware.__mro__:
        for name, value in vars(kind).items():
            if isinstance(value, Option) and name not in told:
                found[name] = value
            told.add(name)
    return MappingProxyType(found)


def defaults(firmware: type, model: type[Model], reading: Reading = "practice") -> dict[str, Any]:
    """Give the values of all options of a model in a reading. Raises BadValue or UsageError."""
    known = options_of(firmware)
    if reading not in READINGS:
        raise BadValue(f"{reading!r} is no reading of the manuals; there are {' and '.join(READINGS)}")
    if reading == "manual":
        return {name: option.manual for name, option in known.items()}
    return {name: option.practice for name, option in known.items()} | read_options(
        firmware, model, _practice_of(model)
    )


def read_options(firmware: type, model: type[Model], given: Mapping[str, Any]) -> dict[str, Any]:
    """Read values of options, as they are typed or given from Python.

    Raises UsageError for a name that the firmware of the model does not have, BadValue for a value that it cannot take.
    """
    known = options_of(firmware)
    for name in given:
        if name not in known:
            raise UsageError(f"{model.title} has no option {name!r}; {suggestion(name, known)}")
    try:
        return {name: known[name].read(value) for name, value in given.items()}
    except BadValue as error:
        raise BadValue(f"{model.title}: {error}") from None


def suggestion(name: str, known: Iterable[str]) -> str:
    """Say which names there are, and which are near to one that is not there."""
    import difflib  # noqa: PLC0415 - only ever needed for this message

    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=2, cutoff=0.5)
    meant = f"did you mean {' or '.join(near)}? " if near else ""
    return f"{meant}there are {', '.join(names)}"


def _practice_of(model: type[Model]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for kind in reversed(model.__mro__):
        values |= vars(kind).get("practice", {})
    return values


ON_OFF = OnOff()
