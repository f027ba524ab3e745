"""Models and servos as JSON and as sentences, for the command line, web pages and recordings alike.

What concerns single registers is in servobus.core.present, packets in servobus.families.explain, traffic in
servobus.traffic.present. This part needs to know what a model is, which the core does not. Nothing is printed here.
"""

from typing import Any

from servobus.core.units import show, shown
from servobus.families.base import Family
from servobus.families.model import Model


def servo_entry(family: Family, model: type[Model] | None, id: int, baud: int, firmware: str) -> dict[str, Any]:
    """Say which servo is meant, and what it is; `model` is None if its model number is not known here."""
    return {
        "family": family.name,
        "model": model.key() if model and not model.generic else None,
        "model_number": model.number if model else None,
        "id": id,
        "baud": baud,
        "firmware": firmware,
    }


def model_entry(model: type[Model]) -> dict[str, Any]:
    """Give the maker's specification, in the units people use."""
    if model.generic:
        return {"name": model.key(), "model": model.title, "family": model.family.name, "number": model.number}
    spec = model.sheet
    return {
        "name": model.key(),
        "model": model.title,
        "maker": spec.maker,
        "family": model.family.name,
        "number": model.number,
        "bauds": sorted(model.bauds),
        "default_baud": model.factory_baud,
        "angle": {"value": shown(spec.angle, "rad")[0], "unit": "°"},
        "resolution": {"value": shown(spec.resolution, "rad")[0], "unit": "°"},
        "voltage": {"value": list(spec.voltage), "unit": "V"},
        "temperature": {"value": list(spec.temperature), "unit": "°C"} if spec.temperature else None,
        "weight": {"value": round(spec.weight * 1000, 3), "unit": "g"} if spec.weight else None,
        "size": {"value": [round(side * 1000, 3) for side in spec.size], "unit": "mm"} if spec.size else None,
        "gear_ratio": spec.gear_ratio,
        "performance": [
            {
                "voltage": {"value": point.voltage, "unit": "V"},
                "stall_torque": {"value": round(point.stall_torque, 3), "unit": "N·m"},
                "speed": {"value": shown(point.speed, "rad/s")[0], "unit": "°/s"},
            }
            for point in spec.performance
        ],
        "link": spec.link,
    }


def model_lines(model: type[Model]) -> list[str]:
    """Write the maker's specification in a few lines."""
    if model.generic:
        return [f"{model.title}: {model.family.title}; --model MODEL tells which it is"]
    spec = model.sheet
    low, high = spec.voltage
    lines = [
        f"{spec.maker} {model.title}, {model.family.title}",
        f"{show(spec.angle, 'rad')} in steps of {spec.resolution * 57.29577951:.3f}°, supply {low:g} to {high:g} V",
    ]
    lines += [
        f"at {point.voltage:g} V: {point.stall_torque:.2f} N·m, {show(point.speed, 'rad/s')}"
        for point in spec.performance
    ]
    body = [
        f"{spec.weight * 1000:g} g" if spec.weight else "",
        " x ".join(f"{side * 1000:.1f}" for side in spec.size) + " mm" if spec.size else "",
        f"gear 1:{spec.gear_ratio:g} {spec.gear}".strip(", ") if spec.gear_ratio else "",
        spec.motor,
    ]
    return [*lines, ", ".join(filter(None, body)), spec.link]
