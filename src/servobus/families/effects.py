"""What requests do, for the parts that all families share: registers that are written.

The rows of a model's table decide: whether a register switches the torque, how it can move the servo, where it is kept.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any, TypeAlias

from servobus.core.effect import NO_KIND, Effect, Kind, Touch
from servobus.core.registers import Motion, Register
from servobus.families.explain import pieces
from servobus.families.model import Model

ModelOf: TypeAlias = Callable[[int], type[Model] | None]
"""Gives the model of the servo with an id: its generic one if no more is known, and that of the family for all. None
says that no table tells what its registers are."""


def reads(ids: Iterable[int]) -> Effect:
    """Say that these servos are asked."""
    return Effect(tuple(Touch(id, Kind.READS) for id in ids))


def doubtful(ids: Iterable[int]) -> Effect:
    """Say of a request that is not understood, or not wholly: it may set these servos in motion."""
    return Effect(tuple(Touch(id, Kind.DRIVES) for id in ids))


def bytes_written(id: int, model: type[Model] | None, space: str, address: int, data: bytes) -> Touch:
    """Tell what writing these bytes does, from an address of a map on. `space` is as in `Place.locations`."""
    values: dict[Register[Any], int] = {}
    kinds = NO_KIND
    for start, size, row in pieces(model, space, address, len(data)):
        if row is None:  # no table tells what these are
            kinds |= Kind.WRITES | Kind.DRIVES
        else:
            values[row] = row.layout.unpack(data[start - address : start - address + size])
    return values_written(id, model, values, kinds)


def values_written(
    id: int, model: type[Model] | None, values: Mapping[Register[Any], int], kinds: Kind = NO_KIND
) -> Touch:
    """Tell what writing these raw values does, where they act at once; `kinds` is what is known to be done beside."""
    if model is not None:
        for row, raw in values.items():
            kinds |= _kinds(model, row, raw)
    return Touch(id, kinds, values)


def kept(touch: Touch) -> Touch:
    """Tell the same of a write that is kept until another request starts it."""
    return Touch(touch.id, touch.kinds & ~Kind.RELEASES | Kind.WRITES | Kind.DRIVES, touch.written)


def _kinds(model: type[Model], row: Register[Any], raw: int) -> Kind:
    """Tell what writing one raw value does."""
    where, torque, moves, strength = _traits(model, row)  # type: ignore[arg-type] # a class has a hash
    if torque and row.accepts(raw):
        return where | (Kind.DRIVES if model.family.torque_on(raw) else Kind.RELEASES)
    if row.motion is Motion.STRENGTH and not raw:
        return where | Kind.RELEASES
    return where | Kind.DRIVES if moves or (strength and raw) else where


@lru_cache(maxsize=4096)
def _traits(model: type[Model], row: Register[Any]) -> tuple[Kind, bool, bool, bool]:
    """Tell of a register where it is kept, and whether it switches the torque, can set in motion, bounds the output."""
    family = model.family
    torque = row is model.register("torque_enable")
    named = row in (model.register("id"), model.optional("baud"))
    where = Kind.STORES if named or family.wears(row, keep=False) else Kind.WRITES
    # A torque that an alarm has switched off may come back with what decides on the alarm.
    alarms = map(model.register, family.torque_rows) if family.torque_returns else ()
    # What can only be read is written for a reason that no table knows.
    moves = torque or row.motion is not None or row in alarms or not row.writable
    return where, torque, moves, row is model.optional("output_limit")
