"""The motor of a model: a set of data that the model names, or one made up from its data sheet.

A model names its sets in `Model.motors`; the first is its default.

What a specification fixes is two ratios, stall torque to voltage and speed to voltage. Torque constant and resistance
follow from them once friction is known, and friction hides in them: so there can be more than one set. No set here has
a viscous part, stiction above Coulomb friction, hard stops or backlash: no public figure says anything about them.
"""

from collections.abc import Mapping

from servobus.errors import UnknownName
from servobus.families.model import Model
from servobus.virtual.device.references import resolve
from servobus.virtual.physics.motor import MotorParams, motor_like


def motor(model: type[Model], name: str | None = None) -> MotorParams:
    """Find the motor of a model: a set by name, or its default. Raises UnknownName."""
    sets = motor_sets(model)
    found = next(iter(sets.values())) if name is None else sets.get(name)
    if found is None:
        raise UnknownName(f"no motor data {name!r} for {model.title}; there are {', '.join(sets)}")
    return found


def motor_sets(model: type[Model]) -> Mapping[str, MotorParams]:
    """Give all sets of motor data of a model by name: those it names, or one made up from its sheet, "sheet"."""
    for kind in model.__mro__:
        if named := vars(kind).get("motors"):
            sets: Mapping[str, MotorParams] = resolve(named, f"the motor data of {model.title}")
            return sets
        if "sheet" in vars(kind):
            break  # what a parent knows of its motor says nothing of one with another sheet
    for point in reversed(model.sheet.performance):
        if point.stall_torque is not None and point.speed is not None:
            return {"sheet": motor_like(point.voltage, point.stall_torque, point.speed)}
    raise UnknownName(f"{model.title}: its sheet has no voltage with stall torque and speed to make a motor of")
