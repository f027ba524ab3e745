"""Registers: one row says where a value lives, how it is laid out and what it means.

    class RX28(Model):
        angle = Quantity("rad", 300 * deg / 1023)
        goal_position = Register(Address(30), U16, angle, "target position", limits=(0, 1023))

Driver, virtual servo, command line and reference pages all read the same row. A register is a key
(`servo.read(RX28.goal_position)`, `memory[RX28.goal_position]`); it does no I/O of its own.
The table that holds the rows is a `Model`, see servobus.families.model.
"""

import enum
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import partial
from numbers import Integral
from typing import Any, ClassVar, Generic, Literal, TypeAlias, TypeVar

from servobus.core.units import Measure, Raw, Scale, Switch
from servobus.core.values import frozen, replace
from servobus.errors import BadReading, BadValue, UsageError

T = TypeVar("T")


class Access(enum.Enum):
    """What the bus may do with a register."""

    READ = "r"
    READ_WRITE = "rw"
    RESERVED = "-"


class Area(enum.Enum):
    """Where a register is kept: EEPROM survives power-off, RAM does not."""

    EEPROM = "eeprom"
    RAM = "ram"


class Motion(enum.Enum):
    """How writing a register can move the servo."""

    GOAL = "goal"
    """Where it is to be."""
    SPEED = "speed"
    """How fast, or with which output, it turns without end."""
    MODE = "mode"
    """Endless turn (not 0) or angles (0)."""
    LIMIT = "limit"
    """How far its goals may lie: one that holds outside of new limits may run to them."""
    ZERO = "zero"
    """Where its angles are counted from: one that holds an angle may turn by the change."""
    STRENGTH = "strength"
    """The output that it is allowed: one that has none, and gets some, runs to its old goal."""
    OUTPUT = "output"
    """What it puts out even at its goal."""


@frozen
class Int:
    """An integer in `size` bytes, low byte first unless `order` is "big".

    signed    two's complement
    sign_bit  sign and magnitude instead: that bit set means negative, the bits below it are the magnitude
    bits      width of the value, where it does not fill its bytes
    flags     bits that a servo sets beside the value, documented as no part of it: they are left out of the raw value

    Other bits beyond the value must be 0. No bit is dropped where they are not: such a raw value is the whole word,
    which lies outside `range`.
    """

    size: int
    signed: bool = False
    sign_bit: int | None = None
    order: Literal["little", "big"] = "little"
    bits: int | None = None
    flags: int = 0

    @property
    def range(self) -> tuple[int, int]:
        """Smallest and largest raw value."""
        if self.sign_bit is not None:
            top = (1 << self.sign_bit) - 1
            return -top, top
        bits = self.bits or 8 * self.size - self.flags.bit_count()
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if self.signed else (0, (1 << bits) - 1)

    @property
    def fills_its_bytes(self) -> bool:
        """Whether every combination of bits is a raw value."""
        return self.sign_bit is None and self.bits is None and not self.flags

    def pack(self, raw: int) -> bytes:
        if self.sign_bit is not None:
            raw = raw if raw >= 0 else -raw | 1 << self.sign_bit
        return raw.to_bytes(self.size, self.order, signed=self.signed)

    def unpack(self, data: bytes) -> int:
        raw = int.from_bytes(data, self.order, signed=self.signed) & ~self.flags
        if self.sign_bit is None or raw >> self.sign_bit + 1:
            return raw
        magnitude = raw & (1 << self.sign_bit) - 1
        return -magnitude if raw >> self.sign_bit else magnitude

    def flags_in(self, data: bytes) -> int:
        """Give the flag bits that are set beside the value."""
        return int.from_bytes(data, self.order) & self.flags

    def unpacker(self) -> Callable[[bytes], int]:
        """Give `unpack` as the quickest function that does it."""
        if self.fills_its_bytes:
            return partial(int.from_bytes, byteorder=self.order, signed=self.signed)
        return self.unpack


U8 = Int(1)
U16 = Int(2)
S8 = Int(1, signed=True)
S16 = Int(2, signed=True)


Location: TypeAlias = tuple[str, int]
"""A byte of a servo: the map it is in, and its offset there."""


class Place(ABC):
    """Where a register lives. Each family has its own kinds of place, in its folder."""

    area: ClassVar[Area] = Area.RAM
    """Where rows with such a place are kept if the row says nothing else."""

    @property
    @abstractmethod
    def locations(self) -> tuple[Location, ...]:
        """First byte of each copy of the value: the one that acts comes first, the one that survives power-off last."""

    @abstractmethod
    def text(self, area: Area | None = None) -> str:
        """Say where it is for people, with the area if that is given and the place alone does not tell it."""

    @abstractmethod
    def json(self) -> dict[str, Any]:
        """Say where it is for programs."""

    @property
    def has_working_copy(self) -> bool:
        """Whether what acts is a copy in RAM of what is stored, so that the two can differ."""
        return False

    def within(self, space: str) -> int | None:
        """Give the offset at which the value stands in a map; None if it is not in that map."""
        return next((at for name, at in self.locations if name == space), None)


class Register(Generic[T]):
    """One row of a register table. `name`, `model` and `aliases` are filled in by the table that holds it.

    place     where: an address or a pair of commands
    layout    how it is laid out in bytes
    scale     raw integer <-> value
    meaning   one line for people
    default   factory value, raw; None where none is known or it is measured
    limits    smallest and largest raw value that may be written
    allowed   the only raw values that may be written, where they are no range
    volatile  the servo changes it by itself, or by other commands: a changed value does not tell a restart
    motion    how writing it can move the servo; None if it cannot
    latched   what went wrong stays in it until 0 is written there
    live      bits that the servo sets and clears by itself, whatever is written there
    note      where the sources disagree: the erratum or manual section and the reading taken
    """

    __slots__ = (
        "access", "aliases", "allowed", "area", "default", "latched", "layout", "limits", "live", "meaning", "model",
        "motion", "name", "note", "owner", "place", "scale", "volatile",
    )  # fmt: skip

    def __init__(
        self,
        place: Place,
        layout: Int,
        scale: Scale[T],
        meaning: str,
        *,
        default: int | None = None,
        limits: tuple[int, int] | None = None,
        allowed: tuple[int, ...] | None = None,
        access: Access = Access.READ_WRITE,
        area: Area | None = None,
        volatile: bool = False,
        motion: Motion | None = None,
        latched: bool = False,
        live: int = 0,
        note: str = "",
    ) -> None:
        self.place, self.layout, self.scale, self.meaning = place, layout, scale, meaning
        self.default, self.limits, self.allowed = default, limits or layout.range, allowed
        self.access, self.area, self.note = access, area or place.area, note
        self.volatile, self.motion, self.latched, self.live = volatile, motion, latched, live
        self.name = self.model = ""
        self.aliases: tuple[str, ...] = ()
        """Second names of the row."""
        self.owner: type | None = None
        """The table that holds the row."""

    def __set_name__(self, owner: type, name: str) -> None:
        if not self.name:  # a second name for the same row is an alias
            self.name, self.model, self.owner = name, getattr(owner, "title", owner.__name__), owner

    def __repr__(self) -> str:
        return f"<{self.model} {self.name}>"

    def with_(self, **changes: Any) -> "Register[T]":
        """Make a row like this one but for some attributes, to stand in another table.

        `highest_limit_temperature = RX28.highest_limit_temperature.with_(default=70)` in the class body of a model.
        The names are those of the arguments of `Register`. With a new layout or place the limits and the area are
        those of the new one, unless they were set by hand. A new scale or new limits may count further than the old
        ones: then the value fills its bytes, unless a layout is given.
        """
        names = (
            "place", "layout", "scale", "meaning", "default", "limits", "allowed", "access", "area", "volatile",
            "motion", "latched", "live", "note",
        )  # fmt: skip
        if unknown := changes.keys() - set(names):
            raise TypeError(f"{self}: a register has no {', '.join(sorted(unknown))}; it has {', '.join(names)}")
        old = {name: getattr(self, name) for name in names}
        if "layout" in changes and self.limits == self.layout.range:
            old["limits"] = None
        if self.layout.bits and ("scale" in changes or "limits" in changes):
            old["layout"] = replace(self.layout, bits=None)
        if self.area is self.place.area:
            old["area"] = None
        return Register(**old | changes)

    def same_value(self, other: "Register[Any]") -> bool:
        """Tell whether a value of the other row means the same here: rad is rad, whatever one unit of it is."""
        mine, others = self.scale, other.scale
        if isinstance(mine, Measure) and isinstance(others, Measure):
            return mine.unit == others.unit
        return mine == others

    @property
    def unit(self) -> str:
        """SI unit of the value, empty for counts and choices."""
        return self.scale.unit

    @property
    def readable(self) -> bool:
        return self.access is not Access.RESERVED

    @property
    def writable(self) -> bool:
        return self.access is Access.READ_WRITE

    @property
    def acts_in_ram(self) -> bool:
        """Whether the value that acts is lost at power-off."""
        return self.area is Area.RAM or self.place.has_working_copy

    def accepts(self, raw: int) -> bool:
        """Tell whether the raw value may be written, limits and choices considered."""
        low, high = self.limits
        return low <= raw <= high and (self.allowed is None or raw in self.allowed)

    def took(self, raw: int, now: int) -> bool:
        """Tell from what is there now whether the servo took a raw value that was written."""
        return (raw ^ now) & ~self.live == 0

    def check(self, raw: int) -> int:
        """Give the raw value back, or raise BadValue if this register must not be given it."""
        if not self.writable:
            if isinstance(self.scale, Raw):
                raise BadValue(
                    f"{self.model}: {self.name} can only be read as long as the model is not known, for its unit "
                    "differs from model to model; --model, models= or attach() tells the model"
                )
            raise BadValue(f"{self.model} {self.name} can only be read")
        given: object = raw
        if type(given) is not int:
            if isinstance(given, bool) or not isinstance(given, Integral):
                raise BadValue(f"{self.model} {self.name}: {given!r:.40} is not a whole number, as a raw value must be")
            raw = int(given)
        if not self.accepts(raw):
            raise BadValue(f"{self.model} {self.name}: {self._say(raw)} is not {self.range_text()}")
        return raw

    def encode(self, value: T) -> int:
        """Turn a value into the raw integer to write. Raises BadValue."""
        try:
            raw = self.scale.encode(value)
        except (ValueError, TypeError) as error:
            raise BadValue(f"{self.model} {self.name}: {error}") from None
        return self.check(raw)

    def holds(self, raw: int) -> bool:
        """Tell whether the raw value has no bits beyond those of the register."""
        low, high = self.layout.range
        return self.layout.fills_its_bytes or low <= raw <= high

    def decode(self, raw: int, servo: object = None) -> T:
        """Turn a raw integer that was read into its value; `servo` is named in the message if there is none.

        Raises BadReading for bits beyond those of the register, and for a code without meaning.
        """
        if self.holds(raw):
            try:
                return self.scale.decode(raw)
            except ValueError:
                pass
        raise BadReading(f"{servo or self.model}: {self.name} is {self.said(raw)}")

    def decoder(self, servo: object = None) -> Callable[[int], T]:
        """Give `decode` as the quickest function that does it."""
        return (
            self.scale.decode if self.layout.fills_its_bytes and self.scale.total else partial(self.decode, servo=servo)
        )

    def said(self, raw: int) -> str:
        """Write a raw integer as a person reads it: its value, or that it has none. Never fails."""
        if raw.bit_length() > 64:  # Python writes no int of more than 4300 digits
            return f"an int of {raw.bit_length()} bits"
        if not self.holds(raw):
            return f"out of range (raw {raw:#0{2 + 2 * self.layout.size}x})"
        try:
            value = self.scale.decode(raw)
        except ValueError:
            return f"raw {raw} (no known meaning)"
        shown = self.scale.show(value)
        return f"{shown} (raw {raw})" if isinstance(self.scale, Switch) and raw not in (0, 1) else shown

    def parse(self, text: str) -> T:
        """Read a value as a person types it. Raises BadValue."""
        try:
            return self.scale.parse(text)
        except ValueError as error:
            raise BadValue(f"{self.model} {self.name}: {error}") from None

    def show(self, value: T) -> str:
        """Write a value as a person reads it."""
        return self.scale.show(value)

    def range_text(self) -> str:
        """Say what may be written, in the unit people use."""
        if self.allowed is not None:
            return "one of " + ", ".join(self._say(raw) for raw in self.allowed)
        low, high = self.limits
        return f"in {self._say(low)} .. {self._say(high)}"

    def _say(self, raw: int) -> str:
        if raw.bit_length() > 64:
            return self.said(raw)
        try:
            shown = self.scale.show(self.scale.decode(raw))
        except ValueError:
            return f"raw {raw}"
        return shown if shown == str(raw) else f"{shown} (raw {raw})"


def register_name(register: "Register[Any] | str") -> str:
    """Give the name that stands for a register on every model. Raises UsageError for what is neither."""
    given: object = register
    if isinstance(given, Register):
        return given.name
    if not isinstance(given, str):
        raise UsageError(f"{given!r:.60} is no register: give one such as RX28.present_position, or its name")
    return given


def check_row(row: Register[Any]) -> None:
    """Refuse a row that contradicts itself, with a TypeError."""
    low, high = row.layout.range
    if not low <= row.limits[0] <= row.limits[1] <= high:
        raise TypeError(f"{row}: limits {row.limits} do not fit {row.layout}")
    if row.default is not None and row.access is not Access.RESERVED and not row.accepts(row.default):
        raise TypeError(f"{row}: default {row.default} is outside its limits")
    if row.allowed and not all(row.limits[0] <= raw <= row.limits[1] for raw in row.allowed):
        raise TypeError(f"{row}: an allowed value is outside the limits")
    layout = row.layout
    if layout.flags and (layout.signed or layout.flags != (1 << 8 * layout.size) - (1 << layout.range[1].bit_length())):
        raise TypeError(f"{row}: the flags {layout.flags:#x} are not all the bits above those of the value")
    if not row.meaning:
        raise TypeError(f"{row}: a row needs a meaning")


def check_overlap(rows: Iterable[Register[Any]]) -> None:
    """Refuse rows that claim the same byte, with a TypeError."""
    taken: dict[Location, Register[Any]] = {}
    for row in rows:
        for space, start in row.place.locations:
            for at in range(start, start + row.layout.size):
                if (space, at) in taken:
                    raise TypeError(f"{row} and {taken[space, at]} both claim {space} byte {at}")
                taken[space, at] = row
