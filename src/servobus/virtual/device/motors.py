"""The motor of a model: sets of data by name, of which the first is the default.

    manual    what the maker's figures say. Worked out from the data sheet by `servobus.virtual.device.derivation`,
              unless the motor data of the model have a set of that name
    others    sets that the motor data of the model have beside it, `measured` for example

A model names in `Model.motors` the motor data of its family, `MotorData` by key of model. What a parent knows of its
motor holds for a child too, unless the child has a data sheet of its own.

What a specification fixes is two ratios, stall torque to voltage and speed to voltage. Torque constant and resistance
follow from them once friction is known, and friction hides in them: so there can be more than one set. No set that is
derived has a viscous part, more friction at rest than in motion or hard stops: no figure says anything about them. It
has no backlash either, though the e-manual prints 0.33° for MX-28, MX-64 and MX-106: their sensor is at the horn.
"""

import math
from collections.abc import Iterator, Mapping

from servobus.core.values import frozen
from servobus.errors import UnknownName, UsageError
from servobus.families import registry
from servobus.families.model import Model, Performance
from servobus.virtual.device.derivation import TOLERANCE, Sibling, derive
from servobus.virtual.device.motor_set import MotorData, MotorSet
from servobus.virtual.device.references import resolve
from servobus.virtual.physics.motor import MotorParams, no_load_speed, stall_torque

DEFAULT = "manual"
"""Name of the set that every model has."""
MEASURED = "measured"
"""Name of a set that somebody identified on real servos."""
_NOTHING = MotorData()


def motor(model: type[Model], name: str | None = None) -> MotorParams:
    """Find the motor of a model: a set by name, or its default. Raises UnknownName."""
    sets = motor_sets(model)
    found = next(iter(sets.values())) if name is None else sets.get(name)
    if found is None:
        raise UnknownName(f"no motor data {name!r} for {model.title}; there are {', '.join(sets)}")
    return found.params


def motor_sets(model: type[Model]) -> Mapping[str, MotorSet]:
    """Give all sets of motor data of a model by name, the default first.

    Raises UsageError for a model of which neither torque nor speed is known, nor a sibling.
    """
    sets = motor_data(model).sets
    return sets if DEFAULT in sets else {DEFAULT: _derived(model), **sets}


def motor_data(model: type[Model]) -> MotorData:
    """Give what is known of the motor of a model beside its data sheet."""
    for kind in model.__mro__:
        if not (issubclass(kind, Model) and "title" in vars(kind)):
            continue
        if found := _known(kind).get(kind.key()):
            return found
        if "sheet" in vars(kind):
            break  # what a parent knows of its motor says nothing of one with another sheet
    return _NOTHING


def supply(model: type[Model]) -> tuple[float, str]:
    """Give the supply of a model in V, and the title of the sibling that it is taken over from, "" if it is its own."""
    if (volts := model.sheet.supply) is not None:
        return volts, ""
    other = _sibling_of(model)
    if other is None:
        raise UsageError(f"the supply of a {model.title} is not known; give a virtual one its voltage, in V")
    volts, title = supply(other)
    return volts, title or other.title


# Printed figures that the motor does not meet


@frozen
class Miss:
    """A printed figure that the motor of a model is further away from than TOLERANCE: others contradict it."""

    what: str
    """"stall torque", "speed" or "stall current"."""
    unit: str
    voltage: float
    """V"""
    printed: float
    motor: float
    """What the motor does at this voltage."""
    text: str
    """Where it is printed, "" for the data sheet itself."""


def misses(model: type[Model], name: str = DEFAULT) -> tuple[Miss, ...]:
    """List the figures of the data sheet, and of other texts, that a set does not meet."""
    params = motor(model, name)
    points = [("", point) for point in model.sheet.performance]
    points += [(text, point) for text, lines in motor_data(model).further.items() for point in lines]
    return tuple(miss for text, point in points for miss in _missed(params, text, point))


def _missed(params: MotorParams, text: str, point: Performance) -> Iterator[Miss]:
    volts = point.voltage
    for what, unit, figure, reached in (
        ("stall torque", "N·m", point.stall_torque, stall_torque(params, volts)),
        ("speed", "rad/s", point.speed, no_load_speed(params, volts)),
        ("stall current", "A", point.stall_current, volts / params.resistance),
    ):
        if figure is not None and abs(reached / figure - 1) > TOLERANCE:
            yield Miss(what, unit, volts, figure, reached, text)


# Siblings


def _derived(model: type[Model]) -> MotorSet:
    try:
        return derive(model.title, model.sheet, _sibling(model), motor_data(model).friction)
    except ValueError as error:
        raise UsageError(str(error)) from error


def _sibling(model: type[Model]) -> Sibling | None:
    """Give what is taken over from: the model itself, if it was measured, else the one that its data name or the rule.

    The rule: of the models of the family that have a set `manual` or `measured` of their own, the nearest in weight.
    """
    data = motor_data(model)
    own = data.sets.get(MEASURED)
    if own is not None:
        return Sibling(model.title, own, _top(model), model.sheet.weight, itself=True)
    other = _sibling_of(model)
    if other is None:
        return None
    sets = motor_sets(other)
    why = data.why if data.like else _nearness(model, other)
    return Sibling(other.title, next(iter(sets.values())), _top(other), other.sheet.weight, why=why)


def _sibling_of(model: type[Model]) -> type[Model] | None:
    if name := motor_data(model).like:
        return registry.model(name)
    known = [
        other
        for other in registry.models_of(model.family)
        if other is not model and {DEFAULT, MEASURED} & _known(other).get(other.key(), _NOTHING).sets.keys()
    ]
    weight = model.sheet.weight
    return min(known, key=lambda other: _distance(weight, other.sheet.weight), default=None)


def _distance(weight: float | None, other: float | None) -> float:
    """Give how many times heavier one is, as a logarithm; where a weight is not known, all are equally far."""
    return abs(math.log(weight / other)) if weight and other else 0.0


def _nearness(model: type[Model], other: type[Model]) -> str:
    weight, others = model.sheet.weight, other.sheet.weight
    if weight and others:
        return f"the nearest in weight of those known, {others * 1000:g} g to {weight * 1000:g} g"
    return f"the first of the family of {model.family.title} that is known"


def _top(model: type[Model]) -> float:
    """Give the highest voltage for which something is printed, or the supply."""
    figures = [at.voltage for at in model.sheet.performance]
    return max(figures, default=0.0) or supply(model)[0]


def _known(model: type[Model]) -> Mapping[str, MotorData]:
    if not model.motors:
        return {}
    known: Mapping[str, MotorData] = resolve(model.motors, f"the motor data of {model.title}")
    return known
