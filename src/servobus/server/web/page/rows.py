"""What the overview shows of each servo, as texts and figures that the browser draws; only what has changed is sent."""

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

from servobus.bus.asyncio import AsyncBusServo
from servobus.core.units import show
from servobus.server.web.page.parts.alarms import alarms_said
from servobus.server.web.values import key_of, optional_row

Row: TypeAlias = dict[str, Any]
WARM = 10.0
"""°C below what its maker allows from which on a servo is shown as warm."""
LIGHTS = ("red", "green", "blue")


def first_row(servo: AsyncBusServo, name: str) -> Row:
    """Give what is known of a servo before it was asked.

    name   that of its joint, "" where it has none
    """
    low, high = angles(servo)
    state = servo.state
    return {
        "key": key_of(servo),
        "id": servo.id,
        "name": name or f"Servo {servo.id}",
        "model": servo.model.title,
        "line": f"{servo.baud:,} baud".replace(",", "\u202f"),
        "low": low,
        "high": high,
        "state": "waits",
        "angle": None if state is None else _degrees(state.position),
        "goal": None,
        "speed": "",
        "load": None,
        "volts": "",
        "volts_bad": False,
        "temp": "",
        "temp_bad": False,
        "torque": "" if state is None or state.torque is None else "on" if state.torque else "off",
        "led": None,
        "alarms": [],
    }


def angles(servo: AsyncBusServo) -> tuple[float | None, float | None]:
    """Give the angles in ° between which goals can be; None and None for more than a turn."""
    row = optional_row(servo, "goal_position")
    if row is None or row.unit != "rad":
        return None, None
    low, high = (math.degrees(row.decode(raw)) for raw in row.limits)
    return (None, None) if high - low > FULL else (round(low, 1), round(high, 1))


FULL = 360.5
"""° from which on a scale is a full circle; a step more than a turn is one, too."""


def live_row(servo: AsyncBusServo, sample: Mapping[str, Any]) -> Row:
    """Give what one sample of telemetry says of a servo."""
    values = sample["values"]
    alarms = [[one.words, one.mend] for one in alarms_said(sample["alarms"])]
    if values is None:
        return {"state": "lost", "alarms": alarms}  # the caller waits until it is so for some time

    def found(name: str) -> Any:
        row = optional_row(servo, name)
        return None if row is None else values.get(row.name)

    volts, degrees, load = found("present_voltage"), found("present_temperature"), found("present_load")
    return {
        "state": "ok",
        "angle": _degrees(found("present_position")),
        "goal": _degrees(found("goal_position")),
        "speed": _text(servo, "present_speed", found("present_speed")),
        "load": None if load is None or _unit(servo, "present_load") != "1" else round(load, 3),
        "volts": _text(servo, "present_voltage", volts),
        "volts_bad": _volts_bad(servo, volts),
        "temp": _text(servo, "present_temperature", degrees),
        "temp_bad": _temp_bad(servo, degrees),
        "torque": _torque(found("torque_enable")),
        "led": _light(found("led_control") if optional_row(servo, "led_control") else found("led")),
        "alarms": alarms,
    }


def changed(old: Row, new: Mapping[str, Any]) -> Row:
    """Give of the new values those that differ, and put them into the old ones."""
    found = {name: value for name, value in new.items() if old.get(name) != value}
    old.update(found)
    return found


# Helpers


def _unit(servo: AsyncBusServo, name: str) -> str:
    row = optional_row(servo, name)
    return "" if row is None else str(row.unit)


def _degrees(radians: Any) -> float | None:
    known = isinstance(radians, int | float) and not isinstance(radians, bool) and math.isfinite(radians)
    return round(math.degrees(radians), 1) if known else None


def _text(servo: AsyncBusServo, name: str, value: Any) -> str:
    if not isinstance(value, int | float):
        return ""
    unit = _unit(servo, name)
    return show(value, unit) if unit else f"{value:g} raw"


def _volts_bad(servo: AsyncBusServo, volts: Any) -> bool:
    sheet = None if servo.model.generic else servo.model.sheet.voltage
    known = sheet is not None and isinstance(volts, int | float) and _unit(servo, "present_voltage") == "V"
    return known and sheet is not None and not sheet[0] <= volts <= sheet[1]


def _temp_bad(servo: AsyncBusServo, degrees: Any) -> bool:
    sheet = None if servo.model.generic else servo.model.sheet.temperature
    known = sheet is not None and isinstance(degrees, int | float) and _unit(servo, "present_temperature") == "degC"
    return known and sheet is not None and degrees > sheet[1] - WARM


def _torque(value: Any) -> str:
    """Say "on", "off", or what the servo does instead; "" where it does not tell."""
    if isinstance(value, bool):
        return "on" if value else "off"
    return {"free": "off"}.get(value, value) if isinstance(value, str) else ""


def _light(value: Any) -> str | None:
    """Give the colour of the light: "" for off, None where that is not known. Several at once mix."""
    if isinstance(value, bool):
        return "red" if value else ""
    if isinstance(value, list):
        lit = [255 if colour in value else 0 for colour in LIGHTS]
        return f"rgb({lit[0]} {lit[1]} {lit[2]})" if any(lit) else ""
    return None
