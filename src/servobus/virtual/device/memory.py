"""The memory of a virtual servo: what its registers hold, and what of that survives power-off.

Every register has a working value, which the firmware obeys, and may have a stored value, which outlives
a power cycle. Where the two lie depends on the place of the row, and on nothing else:

    place      working value        stored value
    Address    table                the same bytes, if the row is in the EEPROM area
    EepRam     ram                  eep
    Eep        eep                  the same bytes
    Ram        ram                  none
    Pair       ram, in row order    eep, if the row is in the EEPROM area

Pair rows have no addresses of their own (LewanSoul): each simply gets the next free ones.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from servobus.core.registers import Access, Address, Area, Eep, EepRam, Ram, Register
from servobus.errors import BadValue
from servobus.families.base import Model

TABLE, EEP, RAM = "table", "eep", "ram"


@dataclass(frozen=True, slots=True)
class Slot:
    """Where one value lies: a space and the offset in it."""

    space: str
    at: int


@dataclass(frozen=True, slots=True)
class Places:
    """Where the two values of a register lie."""

    working: Slot
    stored: Slot | None


class Memory:
    """The bytes behind a model's registers; `memory[register]` is the working value, raw.

    `on_store` is called after each change of a stored value.
    """

    def __init__(self, model: type[Model]) -> None:
        self.model = model
        self.on_store: Callable[[], None] = _nothing
        self.eeprom = Stored(self)
        self._places = _places(model)
        ends = [
            (slot.space, slot.at + row.layout.size)
            for row in model.registers.values()
            for slot in (self._places[row].working, self._places[row].stored)
            if slot is not None
        ]
        self._spaces = {
            space: bytearray(max((end for name, end in ends if name == space), default=0))
            for space in (TABLE, EEP, RAM)
        }
        self._persistent = {
            (slot.space, slot.at + i)
            for row, places in self._places.items()
            if (slot := places.stored) is not None
            for i in range(row.layout.size)
        }
        self.factory_reset()
        self.power_on()

    # By register

    def __getitem__(self, register: Register[Any]) -> int:
        return self._get(register, self._places[register].working)

    def __setitem__(self, register: Register[Any], raw: int) -> None:
        slot = self._places[register].working
        self.write(slot.space, slot.at, register.layout.pack(raw))

    def store(self, register: Register[Any], raw: int) -> None:
        """Set the working and the stored value."""
        self.eeprom[register] = raw
        self[register] = raw

    # By address

    @property
    def table(self) -> bytes:
        """The one address space of a Dynamixel."""
        return bytes(self._spaces[TABLE])

    @property
    def eep(self) -> bytes:
        """The non-volatile map of a HerkuleX."""
        return bytes(self._spaces[EEP])

    @property
    def ram(self) -> bytes:
        """The volatile map of a HerkuleX."""
        return bytes(self._spaces[RAM])

    def write(self, space: str, address: int, data: bytes) -> None:
        """Put bytes into a space: the caller has checked that they may go there."""
        bytes_there = self._spaces[space]
        changed = [i for i, byte in enumerate(data, address) if bytes_there[i] != byte]
        bytes_there[address : address + len(data)] = data
        if any((space, i) in self._persistent for i in changed):
            self.on_store()

    # Life

    def power_on(self) -> None:
        """Give every register its stored value, or its default where nothing is stored."""
        for row, places in self._places.items():
            if places.stored is None:
                self[row] = row.default or 0
            elif places.stored != places.working:
                self[row] = self.eeprom[row]

    def factory_reset(self, keep: Collection[Register[Any]] = ()) -> None:
        """Give every stored value its default, except those of `keep`. Working copies in RAM stay as they are."""
        before = self.on_store
        self.on_store = _nothing  # one change, not one for each register
        try:
            for row, places in self._places.items():
                if places.stored is not None and row not in keep:
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
            if not isinstance(raw, int):
                raise BadValue(f"{self.model.title} {name}: {raw!r} is not a whole number")
            rows[name].check(raw)
        for name, raw in values.items():
            self.eeprom[rows[name]] = raw

    def _settable(self) -> dict[str, Register[Any]]:
        return {
            row.name: row
            for row, places in self._places.items()
            if places.stored is not None and row.access is Access.READ_WRITE
        }

    def _get(self, register: Register[Any], slot: Slot) -> int:
        space, end = self._spaces[slot.space], slot.at + register.layout.size
        return register.layout.unpack(bytes(space[slot.at : end]))

    def _stored_slot(self, register: Register[Any]) -> Slot:
        slot = self._places[register].stored
        if slot is None:
            raise BadValue(f"{register.model} {register.name} is lost at power-off: nothing of it is stored")
        return slot


class Stored:
    """The stored values of a memory, by register."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory

    def __getitem__(self, register: Register[Any]) -> int:
        return self._memory._get(register, self._memory._stored_slot(register))

    def __setitem__(self, register: Register[Any], raw: int) -> None:
        slot = self._memory._stored_slot(register)
        self._memory.write(slot.space, slot.at, register.layout.pack(raw))


def _places(model: type[Model]) -> dict[Register[Any], Places]:
    """Find the places of all registers of a model."""
    places: dict[Register[Any], Places] = {}
    free = 0
    for row in model.registers.values():
        match row.place:
            case Address(address):
                slot = Slot(TABLE, address)
                places[row] = Places(slot, slot if row.area is Area.EEPROM else None)
            case EepRam(eep, ram):
                places[row] = Places(Slot(RAM, ram), Slot(EEP, eep))
            case Eep(eep):
                places[row] = Places(Slot(EEP, eep), Slot(EEP, eep))
            case Ram(ram):
                places[row] = Places(Slot(RAM, ram), None)
            case _:
                places[row] = Places(Slot(RAM, free), Slot(EEP, free) if row.area is Area.EEPROM else None)
                free += row.layout.size
    return places


def _nothing() -> None:
    pass
