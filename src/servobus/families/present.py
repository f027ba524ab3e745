"""Models and servos as JSON and as sentences, for the command line, web pages and recordings alike.

What concerns single registers is in servobus.core.present, packets in servobus.families.explain, traffic in
servobus.traffic.present. This part needs to know what a model is, which the core does not. Nothing is printed here.
"""

from typing import Any

from servobus.core.present import aspects, place_text
from servobus.core.units import show, shown
from servobus.families.base import Family
from servobus.families.model import Model, Performance


def servo_entry(family: Family, model: type[Model] | None, id: int, baud: int, firmware: str) -> dict[str, Any]:
    """Say which servo is meant, and what it is; `model` is None if its model number is not known here."""
    return {
        "family": family.name,
        "model": model_name(model),
        "model_number": model.number if model else None,
        "id": id,
        "baud": baud,
        "firmware": firmware,
    }


def model_name(model: type[Model] | None) -> str | None:
    """Name the model of a servo for programs; None if it is not known."""
    return None if model is None or model.generic else model.key()


def figure(value: float | None, unit: str) -> str:
    """Write a figure of a data sheet for people, "-" where none is known."""
    return "-" if value is None else show(value, unit)


def model_entry(model: type[Model]) -> dict[str, Any]:
    """Give the maker's specification, in the units people use."""
    if model.generic:
        return {"name": model.key(), "model": model.title, "family": model.family.name, "number": model.number}
    spec = model.sheet
    return {
        "name": model.key(),
        "model": model.title,
        "names": list(model.names),
        "series": model.series,
        "maker": spec.maker,
        "family": model.family.name,
        "number": model.number,
        "bauds": sorted(model.bauds),
        "default_baud": model.factory_baud,
        "angle": {"value": shown(spec.angle, "rad")[0], "unit": "°"},
        "resolution": {"value": shown(spec.resolution, "rad")[0], "unit": "°"},
        "voltage": {"value": list(spec.voltage), "unit": "V"} if spec.voltage else None,
        "temperature": {"value": list(spec.temperature), "unit": "°C"} if spec.temperature else None,
        "weight": {"value": round(spec.weight * 1000, 3), "unit": "g"} if spec.weight else None,
        "size": {"value": [round(side * 1000, 3) for side in spec.size], "unit": "mm"} if spec.size else None,
        "gear_ratio": spec.gear_ratio,
        "performance": [
            {
                "voltage": {"value": point.voltage, "unit": "V"},
                "stall_torque": _entry(point.stall_torque, "N·m"),
                "speed": _entry(point.speed, "rad/s"),
                "stall_current": _entry(point.stall_current, "A"),
            }
            for point in spec.performance
        ],
        "link": spec.link,
        "confidence": str(spec.confidence),
        "remarks": list(spec.remarks),
    }


def _entry(value: float | None, unit: str) -> dict[str, Any] | None:
    if value is None:
        return None
    number, symbol = shown(value, unit)
    return {"value": number, "unit": symbol}


def model_lines(model: type[Model]) -> list[str]:
    """Write the maker's specification in a few lines."""
    if model.generic:
        how = "--model MODEL or `servobus remember` tells" if model.family.one_table else "--model MODEL tells"
        return [f"{model.title}: {model.family.title}; {how} which it is"]
    spec = model.sheet
    also = f" (also {', '.join(model.names)})" if model.names else ""
    lines = [
        f"{spec.maker} {model.title}{also}, {model.family.title}"
        + (f", series {model.series}" if model.series else ""),
        f"{show(spec.angle, 'rad')} in steps of {spec.resolution * 57.29577951:.3f}°, supply {supply_text(model)}",
        *(f"at {point.voltage:g} V: {point_text(point)}" for point in spec.performance),
    ]
    body = [
        f"{spec.weight * 1000:g} g" if spec.weight else "",
        " x ".join(f"{side * 1000:.1f}" for side in spec.size) + " mm" if spec.size else "",
        f"gear 1:{spec.gear_ratio:g} {spec.gear}".strip(", ") if spec.gear_ratio else "",
        spec.motor,
    ]
    sure = [f"confidence {spec.confidence}", *spec.remarks]
    return [*lines, ", ".join(filter(None, body)), spec.link, *sure]


def supply_text(model: type[Model]) -> str:
    """Write the range of the supply, "-" where it is not known."""
    return "-" if model.sheet.voltage is None else "-".join(f"{volts:g}" for volts in model.sheet.voltage) + " V"


def point_text(point: Performance) -> str:
    """Write one line of a data sheet."""
    torque = "" if point.stall_torque is None else f"{point.stall_torque:.2f} N·m"
    current = "" if point.stall_current is None else f"{point.stall_current:g} A at stall"
    speed = "" if point.speed is None else show(point.speed, "rad/s")
    return ", ".join(filter(None, (torque, speed, current)))


def differences(one: type[Model], other: type[Model]) -> list[tuple[str, str, str, str]]:
    """List what differs between the tables of two models: register, aspect, what it is in one and in the other.

    A register that one of them lacks is told by the aspect "where" alone, with "-" on that side.
    """
    found = []
    for name in dict.fromkeys((*one.registers, *other.registers)):
        here, there = one.registers.get(name), other.registers.get(name)
        if here is None or there is None:
            found.append((name, "where", place_text(here) if here else "-", place_text(there) if there else "-"))
            continue
        mine, others = aspects(here), aspects(there)
        found += [(name, what, mine[what] or "-", others[what] or "-") for what in mine if mine[what] != others[what]]
    return found


def servo_key(family: Family, id: int, baud: int) -> str:
    """Give what a servo is called where several share its bus: "dynamixel:1@57600" tells it from all others there."""
    return f"{family.name}:{id}@{baud}"
