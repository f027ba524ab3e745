"""Limits and the live value on one scale: where the value stands, and whether it is inside."""

from collections.abc import Mapping
from typing import Any

from servobus.core.registers import Register
from servobus.core.units import Raw, show
from servobus.core.values import frozen
from servobus.families.model import Model

_GAUGES = (
    ("Position", "present_position", "min_position", "max_position"),
    ("Supply", "present_voltage", "min_voltage", "max_voltage"),
    ("Temperature", "present_temperature", "", "max_temperature"),
)
COLDEST = 0.0
"""°C at which the scale of temperatures begins. Assumption: colder rooms are seldom."""


@frozen
class Gauge:
    """One measured value with its limits.

    live, low, high  the registers; low is None where nothing bounds the value from below
    span             both ends of the scale, in the SI unit
    """

    title: str
    live: Register[Any]
    low: Register[Any] | None
    high: Register[Any]
    span: tuple[float, float]

    def share(self, value: float) -> float:
        """Tell where a value stands on the scale: 0 at its beginning, 1 at its end."""
        start, end = self.span
        return min(max((value - start) / (end - start), 0.0), 1.0)

    def inside(self, value: float, limits: Mapping[str, float]) -> bool:
        """Tell whether a value is inside the limits: name of the register -> value."""
        low = None if self.low is None else limits.get(self.low.name)
        high = limits.get(self.high.name)
        return (low is None or value >= low) and (high is None or value <= high)

    def text(self, value: float) -> str:
        return show(value, self.live.unit)


def gauges(model: type[Model]) -> list[Gauge]:
    """List what a model measures and bounds, as far as the units are known."""
    found = []
    for title, live_name, low_name, high_name in _GAUGES:
        live, high = model.register(live_name), model.register(high_name)
        low = model.register(low_name) if low_name else None
        if any(row is not None and isinstance(row.scale, Raw) for row in (live, low, high)):
            continue
        start = COLDEST if low is None else low.scale.decode(low.limits[0])
        end = high.scale.decode(high.limits[1])
        if title == "Supply" and not model.generic and model.sheet.voltage is not None:
            start, end = min(start, model.sheet.voltage[0]), min(end, 1.5 * model.sheet.voltage[1])
        if end > start:
            found.append(Gauge(title, live, low, high, (start, end)))
    return found
