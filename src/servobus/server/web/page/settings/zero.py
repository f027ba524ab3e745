"""The zero of a servo that can shift the angles it reads: what to write so that the shaft reads a wanted angle."""

from typing import Any

from servobus.core.registers import Register
from servobus.core.values import frozen
from servobus.errors import BadValue, UsageError
from servobus.families.model import Model


@frozen
class Shift:
    """A new zero.

    row     the register that holds the shift
    raw     what it is to have
    reads   raw position that is read then
    """

    row: Register[Any]
    raw: int
    reads: int


def shift_row(model: type[Model]) -> Register[Any] | None:
    """Find the register that shifts the angles of a servo; None where the model has none that can be set."""
    row = model.optional("calibration")
    return row if row is not None and row.writable else None


def shifted(model: type[Model], present: int, shift: int, wanted: float) -> Shift:
    """Reckon the shift with which the shaft, where it stands, reads `wanted` rad.

    `present` and `shift` are raw, as the servo has them now. All families read the place of the shaft less the shift.
    Raises UsageError for a model without one, BadValue where the shift would be too large.
    """
    row = shift_row(model)
    if row is None:
        raise UsageError(f"{model.title} keeps no zero of its own; a robot file holds the zero of its joint")
    position = model.register("present_position")
    reads = position.scale.encode(wanted)
    raw = shift + present - reads
    if not row.accepts(raw):
        low, high = row.limits
        first, last = (position.scale.decode(present + shift - end) for end in (high, low))
        raise BadValue(
            f"{position.show(wanted)} is out of reach: where the shaft stands it can read "
            f"{position.show(first)} .. {position.show(last)}; mount the horn anew, or turn the shaft first"
        )
    return Shift(row, raw, reads)
