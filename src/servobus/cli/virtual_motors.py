"""The motors of virtual servos as the command line and the pages show them: sets, origins, figures that contradict."""

from typing import Any

from servobus.core.units import shown
from servobus.families.base import Model
from servobus.virtual.device.motor_set import MotorSet
from servobus.virtual.device.motors import Miss, misses, motor_sets, supply


def motor_entries(model: type[Model]) -> dict[str, Any]:
    """Give the motor data of a model for JSON; nothing for a model that cannot be simulated."""
    if not model.firmware:
        return {}
    volts, sibling = supply(model)
    return {
        "supply": {"value": volts, "unit": "V", "taken_over_from": sibling or None},
        "sets": [
            {
                "name": name,
                "text": one.text,
                "parameters": {
                    field: {"value": getattr(one.params, field), "source": str(origin.source), "text": origin.text}
                    for field, origin in one.origins.items()
                },
            }
            for name, one in motor_sets(model).items()
        ],
        "not_met": [miss_text(miss) for miss in misses(model)],
    }


def motor_lines(model: type[Model]) -> list[str]:
    """Say in a few lines what the motor of a virtual servo stands on."""
    if not model.firmware:
        return []
    sets = motor_sets(model)
    first, *others = sets
    lines = ["virtual servo:", *(f"  {names}: {text}" for names, text in origin_rows(sets[first]))]
    lines += [f"  not met: {miss_text(miss)}" for miss in misses(model)]
    volts, sibling = supply(model)
    lines += [f"  supply: {volts:g} V, taken over: that of the {sibling}"] if sibling else []
    lines += [f"  motor={name}: {sets[name].text}" for name in others]
    return lines


def origin_rows(one: MotorSet) -> list[tuple[str, str]]:
    """List the numbers of a set with their origins, those with the same origin together."""
    together: dict[str, list[str]] = {}
    for name, origin in one.origins.items():
        together.setdefault(str(origin), []).append(name.replace("_", " "))
    return [(", ".join(names), text) for text, names in together.items()]


def miss_text(miss: Miss) -> str:
    """Say which printed figure the motor does not meet."""
    figure, symbol = shown(miss.printed, miss.unit)
    reached, _ = shown(miss.motor, miss.unit)
    where = f" ({miss.text})" if miss.text else ""
    return (
        f"{miss.what} {figure:.3g} {symbol} at {miss.voltage:g} V{where}, the motor has {reached:.3g} {symbol}: no DC "
        "motor meets this figure together with the others"
    ).replace(" °", "°")
