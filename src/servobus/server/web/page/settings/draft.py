"""Edits of one servo's registers that are not written yet: what they change and wear, and how they are undone."""

from collections.abc import Mapping
from typing import Any

from servobus.core.registers import Area, Motion, Register
from servobus.core.values import frozen
from servobus.errors import BadValue
from servobus.families.change import check_pairs, pairs_touched
from servobus.families.model import Model
from servobus.server.web.values import Content

MOVING = {
    Motion.GOAL: "moves the servo if its torque is on",
    Motion.SPEED: "changes how fast it moves now",
    Motion.STRENGTH: "lets it run to its goal with this strength",
}


@frozen
class Edit:
    """One register that is to get another value, raw."""

    row: Register[Any]
    held: Content
    raw: int

    @property
    def old(self) -> str:
        return "?" if self.held.now is None else self.row.said(self.held.now)

    @property
    def new(self) -> str:
        return self.row.said(self.raw)

    @property
    def warning(self) -> str:
        """What this does beside the value; "" if nothing."""
        row = self.row
        if row.name in ("torque_enable", "torque_control"):
            return "switches the torque"
        return "" if row.motion is None else MOVING.get(row.motion, "can move the servo if its torque is on")


Writes = tuple[tuple[bool, dict[str, dict[str, int]]], ...]
"""Writes one after the other: whether for good, and name -> {"raw": value}, as the service takes it."""


class Draft:
    """What somebody wants to change of one servo.

    model  its table
    held   what it has, by the names of the registers
    """

    def __init__(self, model: type[Model], held: Mapping[str, Content]) -> None:
        self.model, self.held = model, dict(held)
        self._raws: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self.edits())

    def __contains__(self, name: str) -> bool:
        return name in self._raws

    def raw(self, name: str) -> int | None:
        """Give what the register is to have: the edited value, else what it has."""
        held = self.held.get(name)
        return self._raws.get(name, None if held is None else held.now)

    def edits(self) -> list[Edit]:
        """List the edits in the order of the table."""
        rows = self.model.registers
        return [Edit(row, self.held[name], self._raws[name]) for name, row in rows.items() if name in self._raws]

    def type(self, name: str, text: str) -> None:
        """Take what somebody has typed: a value with its unit, or "raw 512". Raises BadValue, and keeps what was."""
        row = self.model.register(name)
        words = text.strip().lower()
        if words.startswith("raw"):
            try:
                raw = int(words[3:].strip(" :="), 0)
            except ValueError:
                raise BadValue(f"{text.strip()!r:.40} is no raw value: write it as raw 512") from None
        else:
            raw = row.encode(row.parse(text.strip()))
        self.set(name, raw)

    def set(self, name: str, raw: int) -> None:
        """Take a raw value. What the register has already is no edit. Raises BadValue."""
        row = self.model.register(name)
        row.check(raw)
        held = self.held[row.name]
        if raw == held.now and not held.differs:
            self._raws.pop(row.name, None)
        else:
            self._raws[row.name] = raw

    def undo(self, name: str) -> None:
        """Drop one edit."""
        self._raws.pop(name, None)

    def clear(self) -> None:
        self._raws.clear()

    def learn(self, held: Mapping[str, Content]) -> None:
        """Take what was read anew. Edits stay, but for those that the servo has already."""
        self.held.update(held)
        for name, raw in list(self._raws.items()):
            one = self.held[name]
            if raw == one.now and not one.differs:
                del self._raws[name]

    # What writing it does

    @property
    def choosable(self) -> bool:
        """Whether some edit can act until power-off alone, without a write to the EEPROM."""
        wears = self.model.family.wears
        return any(wears(one.row, keep=True) and not wears(one.row, keep=False) for one in self.edits())

    def eeprom(self, *, keep: bool) -> list[str]:
        """Name the registers of which a value goes to the EEPROM."""
        wears, named = self.model.family.wears, []
        for one in self.edits():
            stored = one.held.now if one.held.stored is None else one.held.stored
            if wears(one.row, keep=keep) and stored != one.raw:
                named.append(one.row.name)
        return named

    def problem(self) -> str:
        """Say what is wrong with the edits taken together, such as limits that cross; "" if nothing."""
        edited = {one.row: one.raw for one in self.edits()}
        both = {row for pair in pairs_touched(self.model, edited) for row in pair.rows(self.model)}
        raws = {row: raw for row in both if (raw := self.raw(row.name)) is not None}
        try:
            check_pairs(self.model, raws, self.model.title)
        except BadValue as error:
            return str(error).removesuffix(", and nothing was written")
        return ""

    def writes(self, *, keep: bool) -> Writes:
        """Give the writes that carry the edits out: first what goes to the EEPROM for good, then the rest."""
        wears = self.model.family.wears
        good = {one.row.name: {"raw": one.raw} for one in self.edits() if keep and wears(one.row, keep=True)}
        rest = {one.row.name: {"raw": one.raw} for one in self.edits() if one.row.name not in good}
        return tuple((save, some) for save, some in ((True, good), (False, rest)) if some)

    def undoing(self, *, keep: bool) -> Writes:
        """Give the writes that bring back what the servo has now, if these edits are carried out."""
        good: dict[str, dict[str, int]] = {}
        rest: dict[str, dict[str, int]] = {}
        for save, values in self.writes(keep=keep):
            for name in values:
                held = self.held[name]
                if held.now is None or self.model.registers[name].motion is Motion.GOAL:
                    continue  # where it was going is no setting
                stored = held.now if held.stored is None else held.stored
                if save:
                    good[name] = {"raw": stored}
                if not save or held.differs:
                    rest[name] = {"raw": held.now}
        return tuple((save, some) for save, some in ((True, good), (False, rest)) if some)


def place(row: Register[Any]) -> str:
    """Say where a register is kept, in the words of the page."""
    if row.area is Area.RAM:
        return "RAM"
    return "EEPROM + RAM" if row.place.has_working_copy else "EEPROM"


def is_default(row: Register[Any], held: Content) -> bool | None:
    """Tell whether a setting has its factory value; None where none is known, or it is no setting."""
    if row.default is None or held.now is None or not row.writable or row.volatile:
        return None
    return row.default == (held.now if held.stored is None else held.stored)
