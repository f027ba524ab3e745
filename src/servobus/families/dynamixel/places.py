"""Where a register of a Dynamixel lives."""

from typing import Any

from servobus.core.registers import Area, Location, Place
from servobus.core.values import frozen

TABLE = "table"
"""The one control table."""


@frozen
class Address(Place):
    """One address in the control table."""

    address: int

    @property
    def locations(self) -> tuple[Location, ...]:
        return ((TABLE, self.address),)

    def text(self, area: Area | None = None) -> str:
        return str(self.address) if area is None else f"{area.name} {self.address}"

    def json(self) -> dict[str, Any]:
        return {"address": self.address}
