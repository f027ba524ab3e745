"""The motors of virtual servos as the command line and the pages show them: sets, origins, figures that contradict."""

from typing import Any

from servobus.core.units import shown
from servobus.families.base import Model
from servobus.virtual.device.motor_set import HEAT, MotorSet
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
                    field: {
                        "value": getattr(one.params, field),
                        "source": str(origin.source),
                        "sibling": origin.sibling or None,
                        "text": origin.text,
                    }
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
    lines = ["motor of the virtual servo:", *(f"  {line}" for line in origin_lines(sets[first]))]
    lines += [f"  not met: {miss_text(miss)}" for miss in misses(model)]
    volts, sibling = supply(model)
    lines += [f"  supply: {volts:g} V, taken over: that of the {sibling}"] if sibling else []
    lines += [f"  motor={name}: {sets[name].text}" for name in others]
    return lines


def origin_lines(one: MotorSet) -> list[str]:
    """List the numbers of a set with their origins, those from the same source in one line."""
    together: dict[str, dict[str, list[str]]] = {}
    for name, origin in one.origins.items():
        names = together.setdefault(origin.head, {}).setdefault(origin.text, [])
        if (word := field_word(name)) not in names:
            names.append(word)
    return [
        f"{head}: " + ", ".join(f"{_listed(names)} ({text})" for text, names in texts.items())
        for head, texts in together.items()
    ]


def _listed(names: list[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last


def field_word(name: str) -> str:
    """Give what people call a field of a motor; the four that say how it warms are one."""
    if name in HEAT:
        return "heat"
    return {"coulomb": "friction", "viscous": "viscous friction"}.get(name, name.replace("_", " "))


def miss_text(miss: Miss) -> str:
    """Say which printed figure the motor does not meet."""
    figure, symbol = shown(miss.printed, miss.unit)
    reached, _ = shown(miss.motor, miss.unit)
    where = f" ({miss.text})" if miss.text else ""
    return (
        f"{miss.what} {figure:.3g} {symbol} at {miss.voltage:g} V{where}, which contradicts the others; the motor has "
        f"{reached:.3g} {symbol}"
    ).replace(" °", "°")
