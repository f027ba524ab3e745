"""The memory of a virtual servo: what its registers hold, and what of that survives power-off.

Every register has a working value, which the firmware obeys, and may have a stored value, which outlives
a power cycle. Where the two lie depends on the place of the row: at its first location the working value, at its last
one the stored value, if the row is in the EEPROM area. Where a place has one location, both are the same bytes.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from servobus.core.ids import check_id
from servobus.core.registers import Access, Area, Location, Register
from servobus.errors import BadValue
from servobus.families.model import Model


@dataclass(frozen=True, slots=True)
class Slots:
    """Where the two values of a register lie: the map, and the offset in it."""

    working: Location
    stored: Location | None


class Memory:
    """The bytes behind a model's registers; `memory[register]` is the working value, raw.

    `on_store` is called after each change of a stored value.
    """

    def __init__(self, model: type[Model]) -> None:
        self.model = model
        self.bytes_stored = 0
        """Bytes that were written to the EEPROM since this memory was made, changed or not."""
        self.on_store: Callable[[], None] = _nothing
        self.eeprom = Stored(self)
        if model not in _PLANS:
            _PLANS[model] = _plan(model)
        self._slots, self._persistent = _PLANS[model]
        self._spaces = {space: bytearray(len(there)) for space, there in self._persistent.items()}
        self.factory_reset()
        self.power_on()

    # By register

    def __getitem__(self, register: Register[Any]) -> int:
        register = self.own(register)
        return self._get(register, self._slots[register].working)

    def __setitem__(self, register: Register[Any], raw: int) -> None:
        register = self.own(register)
        self.write(*self._slots[register].working, register.layout.pack(raw))

    def own(self, register: Register[Any]) -> Register[Any]:
        """Give the model's own row for a register; see `Model.own`."""
        return register if register in self._slots else self.model.own(register)

    def store(self, register: Register[Any], raw: int) -> None:
        """Set the working and the stored value."""
        self.eeprom[register] = raw
        slots = self._slots[self.own(register)]
        if slots.working != slots.stored:
            self[register] = raw

    def hold(self, values: Mapping[str, int]) -> None:
        """Let registers of the EEPROM hold these raw values by name, as if they always had.

        Limits do not count: real servos hold values that no host could write. Raises UnknownName or BadValue, and then
        nothing has changed.
        """
        rows = {self.model.register(name): raw for name, raw in values.items()}
        for row, raw in rows.items():
            self._stored_slot(row)
            _check_fits(row, raw)
        for row, raw in rows.items():
            self.store(row, raw)

    # By address

    def space(self, name: str) -> bytes:
        """Give all bytes of a map, as `Place.locations` names it."""
        return bytes(self._spaces[name])

    def image(self) -> dict[str, bytes]:
        """Give all bytes of all maps, to tell whether anything has changed."""
        return {name: bytes(space) for name, space in self._spaces.items()}

    def write(self, space: str, address: int, data: bytes) -> None:
        """Put bytes into a space: the caller has checked that they may go there."""
        there = slice(address, address + len(data))
        before, persistent = self._spaces[space][there], self._persistent[space][there]
        self._spaces[space][there] = data
        if stored := sum(persistent):
            self.bytes_stored += stored
            if any(old != new and kept for old, new, kept in zip(before, data, persistent, strict=True)):
                self.on_store()

    # Life

    def power_on(self) -> None:
        """Give every register its stored value, or its default where nothing is stored."""
        for row, slots in self._slots.items():
            if slots.stored is None:
                self[row] = row.default or 0
            elif slots.stored != slots.working:
                self[row] = self.eeprom[row]

    def factory_reset(self, keep: Collection[Register[Any]] = ()) -> None:
        """Give every stored value its default, except those of `keep`. Working copies in RAM stay as they are."""
        before = self.on_store
        self.on_store = _nothing  # one change, not one for each register
        try:
            for row, slots in self._slots.items():
                if slots.stored is not None and row not in keep:
                    self.eeprom[row] = row.default or 0
        finally:
            self.on_store = before
        self.on_store()

    def stored(self) -> dict[str, int]:
        """Give what survives power-off and can be set, name -> raw value."""
        return {row.name: self.eeprom[row] for row in self._settable().values()}

    def restore(self, values: Mapping[str, int]) -> None:
        """Take stored values back, all or none. They act at the next power-on. Raises BadValue."""
        rows = self._settable()
        for name, raw in values.items():
            if name not in rows:
                raise BadValue(f"{self.model.title} stores no register {name!r}")
            _check_fits(rows[name], raw)
        for name, raw in values.items():
            self.eeprom[rows[name]] = raw

    def _settable(self) -> dict[str, Register[Any]]:
        return {
            row.name: row
            for row, slots in self._slots.items()
            if slots.stored is not None and row.access is Access.READ_WRITE
        }

    def _get(self, register: Register[Any], slot: Location) -> int:
        space, at = slot
        return register.layout.unpack(bytes(self._spaces[space][at : at + register.layout.size]))

    def _stored_slot(self, register: Register[Any]) -> Location:
        slot = self._slots[register].stored
        if slot is None:
            raise BadValue(f"{register.model} {register.name} is lost at power-off: nothing of it is stored")
        return slot


class Stored:
    """The stored values of a memory, by register."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory

    def __getitem__(self, register: Register[Any]) -> int:
        register = self._memory.own(register)
        return self._memory._get(register, self._memory._stored_slot(register))

    def __setitem__(self, register: Register[Any], raw: int) -> None:
        register = self._memory.own(register)
        self._memory.write(*self._memory._stored_slot(register), register.layout.pack(raw))


_Plan: TypeAlias = tuple[Mapping[Register[Any], Slots], Mapping[str, bytes]]
"""Where the values of a model lie, and for each map a 1 for each byte that outlives a power cycle, else a 0."""
_PLANS: dict[type[Model], _Plan] = {}
"""What all servos of a model share, as to work it out takes longer than to make the bytes."""


def _plan(model: type[Model]) -> _Plan:
    places = {row: _slots(row) for row in model.registers.values()}
    persistent: dict[str, bytearray] = {}
    for row, slots in places.items():
        for space, at in filter(None, (slots.working, slots.stored)):
            marks = persistent.setdefault(space, bytearray())
            marks.extend(bytes(max(at + row.layout.size - len(marks), 0)))
            if (space, at) == slots.stored:
                marks[at : at + row.layout.size] = b"\1" * row.layout.size
    return places, {space: bytes(marks) for space, marks in persistent.items()}


def _slots(row: Register[Any]) -> Slots:
    locations = row.place.locations
    return Slots(locations[0], locations[-1] if row.area is Area.EEPROM else None)


def _check_fits(row: Register[Any], raw: object) -> None:
    """Raise BadValue unless a register has room for a raw value."""
    if not isinstance(raw, int) or isinstance(raw, bool):
        raise BadValue(f"{row.model} {row.name}: {raw!r} is not a whole number")
    try:
        row.layout.pack(raw)
    except OverflowError:
        raise BadValue(f"{row.model} {row.name}: {raw} does not fit into its {8 * row.layout.size} bits") from None
    if row.name == "id":
        check_id(raw)


def _nothing() -> None:
    pass
