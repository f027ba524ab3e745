"""Values of registers as they come in JSON, and the names by which servos go there."""

from collections.abc import Mapping
from typing import Any

from servobus.bus.asyncio import AsyncBus, AsyncBusServo
from servobus.core.registers import Register
from servobus.core.units import Flags, Switch
from servobus.core.values import frozen
from servobus.errors import BadReading, BadValue, UnknownName, UsageError
from servobus.families.present import servo_key

MOST_TEXT = 200
"""Characters of a value that is given as a text."""


@frozen
class Content:
    """What a servo has in one register, raw.

    now     what acts; None if this servo lacks the register
    stored  what survives power-off, where that is a copy of its own; else None
    """

    now: int | None
    stored: int | None = None

    @property
    def differs(self) -> bool:
        """Whether the servo would have another value after power-off."""
        return self.stored is not None and self.stored != self.now


def key_of(servo: AsyncBusServo) -> str:
    """Give the key of a servo: its family, id and speed tell it from all others on its bus."""
    return servo_key(servo.family, servo.id, servo.baud)


def servo_of(bus: AsyncBus, key: str) -> AsyncBusServo:
    """Give the known servo with this key; an id alone does where it is unique. Raises UnknownName."""
    found = [servo for servo in bus if key in (key_of(servo), str(servo.id))]
    if len(found) == 1:
        return found[0]
    known = ", ".join(map(key_of, bus)) or "none"
    if found:
        raise UnknownName(f"id {key} is not unique here: {', '.join(map(key_of, found))}; give one of these keys")
    raise UnknownName(f"no servo {key[:40]!r} is known here (known: {known}); scan, or attach it")


def raw_value(row: Register[Any], value: Any) -> int:
    """Turn a value of JSON into the raw integer to write. Raises BadValue.

    A number is in the SI unit of the register; a text is read as people type it: "90deg", "on", "overload". A list is
    a set of flags, {"raw": 512} the raw integer itself.
    """
    if isinstance(value, Mapping):
        if set(value) != {"raw"}:
            raise BadValue(f'{row.model} {row.name}: a value is a number, a text, a list of flags, or {{"raw": 512}}')
        return row.check(value["raw"])
    if isinstance(value, list):
        if not isinstance(row.scale, Flags) or not all(isinstance(one, str) for one in value):
            raise BadValue(f"{row.model} {row.name}: a list of names is a value of sets of flags alone")
        value = "+".join(value) or "none"
    if isinstance(value, str):
        if len(value) > MOST_TEXT:
            raise BadValue(f"{row.model} {row.name}: a text of {len(value)} characters is no value")
        return row.encode(row.parse(value))
    if isinstance(value, bool) and not isinstance(row.scale, Switch):
        raise BadValue(f"{row.model} {row.name}: true and false are values of switches alone")
    return row.encode(value)


def raws_of(
    servo: AsyncBusServo, values: Mapping[str, Any]
) -> tuple[dict[Register[Any], int], dict[Register[Any], str]]:
    """Give what is to be written, raw, and by which names it was asked for. Raises BadValue, UnknownName.

    What would lose the servo, its id and its speed, is a UsageError.
    """
    if not values:
        raise BadValue("a write of no registers: name at least one")
    names = {servo.model.register(name): name for name in values}
    if len(names) != len(values):
        raise BadValue("a register is named twice, once by an alias")
    servo._no_identity(names)
    return {row: raw_value(row, values[name]) for row, name in names.items()}, names


def decoded(row: Register[Any], raw: int) -> Any:
    """Give the value of a raw integer that is to be written. Raises BadValue for a code without a meaning."""
    try:
        return row.decode(raw)
    except BadReading as error:
        raise BadValue(str(error)) from None


def optional_row(servo: AsyncBusServo, name: str) -> Register[Any] | None:
    """Give a register by its name or alias; None where the model has none of it."""
    return servo.model.registers.get(servo.model.aliases.get(name, name))


def readable_row(servo: AsyncBusServo, name: str) -> Register[Any]:
    """Give a register by its name or alias. Raises UnknownName, and UsageError for one that cannot be read."""
    row = servo.model.register(name)
    if not row.readable:
        raise UsageError(f"{row.model} {row.name} is reserved: it cannot be read")
    return row
