"""Which registers of a model are meant: by themselves, by their names, or by their aliases."""

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from servobus.core.arguments import check_mapping, one_or_several
from servobus.core.registers import Register
from servobus.errors import UsageError
from servobus.families.base import Model, ServoRef

T = TypeVar("T")
V = TypeVar("V")


def own_row(model: type[Model], register: Register[T] | str) -> Register[T]:
    """Give the register of a model that is meant. Raises UnknownName, or UsageError for what is no register."""
    if isinstance(register, str):
        return model.register(register)
    given: object = register
    if not isinstance(given, Register):
        example = f"{model.__name__}.present_position"
        raise UsageError(f"{register!r} is no register: give one such as {example}, or its name")
    return model.own(register)


def own_rows(model: type[Model], registers: Iterable[Register[Any] | str] | Register[Any] | str) -> list[Register[Any]]:
    """Give the registers of a model where several are meant, or one; see `own_row`."""
    return [own_row(model, one) for one in one_or_several(registers, lambda one: isinstance(one, Register))]


def by_row(target: ServoRef, values: Mapping[Any, V]) -> dict[Register[Any], V]:
    """Give values by register. Raises UsageError for a register that is given twice, by its name and by an alias."""
    rows: dict[Register[Any], V] = {}
    for register, value in check_mapping("values", values, "{RX28.led: True}").items():
        row = own_row(target.model, register)
        if row in rows:
            raise UsageError(f"{target}: {row.name} is given twice")
        rows[row] = value
    return rows
