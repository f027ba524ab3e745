"""Registers: one row says where a value lives, how it is laid out and what it means.

    class RX28(Model):
        angle = Quantity("rad", 300 * deg / 1023)
        goal_position = Register(Address(30), U16, angle, "target position", limits=(0, 1023))

Driver, virtual servo, command line and reference pages all read the same row. A register is a key
(`servo.read(RX28.goal_position)`, `memory[RX28.goal_position]`); it does no I/O of its own.
A `RegisterMap` is checked when its class is made: a wrong table cannot be imported.
"""

import enum
from collections.abc import Callable, Iterator
from functools import partial
from numbers import Integral
from typing import Any, ClassVar, Generic, TypeAlias, TypeVar

from servobus.core.units import Scale
from servobus.core.values import frozen
from servobus.errors import BadValue, UnknownName

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


@frozen
class Int:
    """An integer in `size` bytes, low byte first.

    `signed` is two's complement. `sign_bit` makes it sign and magnitude instead: that bit set means
    negative, the bits below it are the magnitude, bits above it are not part of the value.
    """

    size: int
    signed: bool = False
    sign_bit: int | None = None

    @property
    def range(self) -> tuple[int, int]:
        """Smallest and largest raw value."""
        if self.sign_bit is not None:
            top = (1 << self.sign_bit) - 1
            return -top, top
        bits = 8 * self.size
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if self.signed else (0, (1 << bits) - 1)

    def pack(self, raw: int) -> bytes:
        if self.sign_bit is not None:
            raw = raw if raw >= 0 else -raw | 1 << self.sign_bit
        return raw.to_bytes(self.size, "little", signed=self.signed)

    def unpack(self, data: bytes) -> int:
        raw = int.from_bytes(data, "little", signed=self.signed)
        if self.sign_bit is None:
            return raw
        magnitude = raw & (1 << self.sign_bit) - 1
        return -magnitude if raw >> self.sign_bit & 1 else magnitude

    def unpacker(self) -> Callable[[bytes], int]:
        """Give `unpack` as the quickest function that does it."""
        if self.sign_bit is None:
            return partial(int.from_bytes, byteorder="little", signed=self.signed)
        return self.unpack


U8 = Int(1)
U16 = Int(2)
S8 = Int(1, signed=True)
S16 = Int(2, signed=True)


# Where a register lives. Each family has its own kinds of place.


@frozen
class Address:
    """One address in the control table (Dynamixel)."""

    address: int


@frozen
class Eep:
    """An address in the non-volatile map only (HerkuleX)."""

    eep: int


@frozen
class Ram:
    """An address in the volatile map only (HerkuleX)."""

    ram: int


@frozen
class EepRam:
    """An address in each map: start value in `eep`, working value in `ram` (HerkuleX)."""

    eep: int
    ram: int


@frozen
class Pair:
    """A pair of commands, with the byte of their parameters at which the value stands (LewanSoul).

    `write` is None for what can only be read. `alone` tells whether the value may be written without
    its neighbours in the same command; they are then read first and sent back unchanged.
    """

    write: int | None
    read: int
    at: int = 0
    alone: bool = True


Place: TypeAlias = Address | Eep | Ram | EepRam | Pair


class Register(Generic[T]):
    """One row of a register table. `name` and `model` are filled in by the class that holds it.

    place     where: an address or a pair of commands
    layout    how it is laid out in bytes
    scale     raw integer <-> value
    meaning   one line for people
    default   factory value, raw; None where none is known or it is measured
    limits    smallest and largest raw value that may be written
    allowed   the only raw values that may be written, where they are no range
    note      where the sources disagree: the erratum or manual section and the reading taken
    """

    __slots__ = (
        "access", "allowed", "area", "default", "layout", "limits",
        "meaning", "model", "name", "note", "place", "scale",
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
        note: str = "",
    ) -> None:
        if area is None:
            area = Area.EEPROM if isinstance(place, Eep | EepRam) else Area.RAM
        self.place, self.layout, self.scale, self.meaning = place, layout, scale, meaning
        self.default, self.limits, self.allowed = default, limits or layout.range, allowed
        self.access, self.area, self.note = access, area, note
        self.name = self.model = ""

    def __set_name__(self, owner: type, name: str) -> None:
        if not self.name:  # a second name for the same row is an alias
            self.name, self.model = name, getattr(owner, "title", owner.__name__)

    def __repr__(self) -> str:
        return f"<{self.model} {self.name}>"

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

    def accepts(self, raw: int) -> bool:
        """Tell whether the raw value may be written, limits and choices considered."""
        low, high = self.limits
        return low <= raw <= high and (self.allowed is None or raw in self.allowed)

    def check(self, raw: int) -> int:
        """Give the raw value back, or raise BadValue if this register must not be given it."""
        if not self.writable:
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

    def decode(self, raw: int) -> T:
        """Turn a raw integer that was read into its value. Raises ValueError for a code without meaning."""
        return self.scale.decode(raw)

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
        if raw.bit_length() > 64:  # Python writes no int of more than 4300 digits
            return f"an int of {raw.bit_length()} bits"
        try:
            shown = self.scale.show(self.scale.decode(raw))
        except ValueError:
            return f"raw {raw}"
        return shown if shown == str(raw) else f"{shown} (raw {raw})"


class RegisterMap:
    """A table of registers, in the order they are written. Subclass it; do not instantiate it."""

    title: ClassVar[str]
    registers: ClassVar[dict[str, Register[Any]]] = {}
    """Every row once, by its own name."""
    aliases: ClassVar[dict[str, str]] = {}
    """Second names: alias -> name of the row."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        rows = {name: row for name, row in vars(cls).items() if isinstance(row, Register)}
        cls.registers = {name: row for name, row in rows.items() if row.name == name}
        cls.aliases = {name: row.name for name, row in rows.items() if row.name != name}
        for row in cls.registers.values():
            _check_row(row)
        _check_overlap(cls)

    @classmethod
    def register(cls, name: str) -> Register[Any]:
        """Find a row by its name or alias. Raises UnknownName, with the nearest names."""
        row = cls.registers.get(cls.aliases.get(name, name))
        if row is None:
            import difflib  # noqa: PLC0415 - only ever needed for this message

            near = difflib.get_close_matches(name, [*cls.registers, *cls.aliases], n=3, cutoff=0.5)
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            raise UnknownName(f"{cls.title} has no register {name!r}{hint}")
        return row


def _check_row(row: Register[Any]) -> None:
    low, high = row.layout.range
    if not low <= row.limits[0] <= row.limits[1] <= high:
        raise TypeError(f"{row}: limits {row.limits} do not fit {row.layout}")
    if row.default is not None and row.access is not Access.RESERVED and not row.accepts(row.default):
        raise TypeError(f"{row}: default {row.default} is outside its limits")
    if row.allowed and not all(row.limits[0] <= raw <= row.limits[1] for raw in row.allowed):
        raise TypeError(f"{row}: an allowed value is outside the limits")
    if not row.meaning:
        raise TypeError(f"{row}: a row needs a meaning")


def _spans(row: Register[Any]) -> Iterator[tuple[str, int]]:
    """Name each byte that a row occupies: which map, and where in it."""
    place = row.place
    for offset in range(row.layout.size):
        if isinstance(place, Address):
            yield "table", place.address + offset
        if isinstance(place, Eep | EepRam):
            yield "eep", place.eep + offset
        if isinstance(place, Ram | EepRam):
            yield "ram", place.ram + offset
        if isinstance(place, Pair):
            yield f"command {place.read}", place.at + offset


def _check_overlap(table: type[RegisterMap]) -> None:
    taken: dict[tuple[str, int], Register[Any]] = {}
    for row in table.registers.values():
        for byte in _spans(row):
            if byte in taken:
                raise TypeError(f"{row} and {taken[byte]} both claim {byte[0]} byte {byte[1]}")
            taken[byte] = row
