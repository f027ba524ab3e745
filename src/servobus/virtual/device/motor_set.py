"""What is known of a motor, and from where: the values that a family's `motors.py` writes down.

A `MotorSet` says of every number in it where the number comes from. A `MotorData` is what is known of the motor of one
model beside its data sheet; all else is derived from the sheet, see `servobus.virtual.device.derivation`.
"""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from enum import StrEnum
from types import MappingProxyType

from servobus.core.values import frozen
from servobus.families.model import Performance
from servobus.virtual.physics.motor import MotorParams


class Source(StrEnum):
    """Where a number comes from."""

    PRINTED = "printed"
    """It stands in the maker's text."""
    DERIVED = "derived"
    """Worked out from figures that stand there."""
    MEASURED = "measured"
    """Somebody identified it on a real servo."""
    TAKEN_OVER = "taken over"
    """From another model that resembles this one."""
    ASSUMED = "assumed"


@frozen
class Origin:
    """Where a number comes from, and how."""

    source: Source
    text: str
    sibling: str = ""
    """The model that it is taken over from, and what makes the two alike."""

    @property
    def head(self) -> str:
        """Where it comes from, without how."""
        return f"{self.source} from {self.sibling}" if self.sibling else str(self.source)

    def __str__(self) -> str:
        return f"{self.head}: {self.text}"


def assumed(text: str) -> Origin:
    return Origin(Source.ASSUMED, text)


def derived(text: str) -> Origin:
    return Origin(Source.DERIVED, text)


def measured(text: str) -> Origin:
    return Origin(Source.MEASURED, text)


def printed(text: str) -> Origin:
    return Origin(Source.PRINTED, text)


def taken_over(sibling: str, text: str) -> Origin:
    return Origin(Source.TAKEN_OVER, text, sibling)


HEAT = ("winding_to_case", "case_to_ambient", "winding_capacity", "case_capacity")
"""The fields of `MotorParams` that say how it warms."""
ALWAYS = ("gear_ratio", "torque_constant", "resistance", "coulomb", "gear_loss", "inertia", *HEAT)
"""Fields whose origin every set tells. Of the others it tells those that are not what they are by default: viscous
friction, more friction at rest, backlash and stops are 0, or far, where no figure is known."""


@frozen
class MotorSet:
    """The numbers of a motor, with the origin of each."""

    params: MotorParams
    origins: Mapping[str, Origin]
    """Name of a field of `params` -> where its number comes from."""
    text: str
    """What the set stands for, in one sentence."""


def motor_set(params: MotorParams, text: str, **origins: Origin) -> MotorSet:
    """Make a set; `heat` is the origin of all fields in HEAT. Raises TypeError for a number without an origin."""
    if heat := origins.pop("heat", None):
        origins |= dict.fromkeys(HEAT, heat)
    usual = {field.name: field.default for field in fields(MotorParams) if field.default is not MISSING}
    needed = [*ALWAYS, *(name for name, value in usual.items() if getattr(params, name) != value)]
    if missing := [name for name in dict.fromkeys(needed) if name not in origins]:
        raise TypeError(f"the origin of {', '.join(missing)} is not told")
    return MotorSet(params, MappingProxyType(origins), text)


@frozen
class MotorData:
    """What is known of the motor of one model beside its data sheet."""

    sets: Mapping[str, MotorSet] = MappingProxyType({})
    """Name -> set. One called `manual` is the default instead of that derived from the sheet."""
    like: str = ""
    """The key of the model from which what the sheet does not say is taken over; "" leaves it to the rule."""
    why: str = ""
    """What makes the two alike."""
    friction: tuple[float, str] | None = None
    """Share of the stall torque, and why it is assumed; else it is as there."""
    further: Mapping[str, tuple[Performance, ...]] = MappingProxyType({})
    """What other texts print than the one that the sheet follows: name of the text -> its lines."""
