"""Where a register of a toy lives."""

from typing import Any

from servobus.core.registers import Area, Location, Place
from servobus.core.values import frozen

CELLS = "cells"


@frozen
class Cell(Place):
    """The number of a value."""

    cell: int

    @property
    def locations(self) -> tuple[Location, ...]:
        return ((CELLS, 2 * self.cell),)

    def text(self, area: Area | None = None) -> str:  # noqa: ARG002 - the number tells all
        return f"cell {self.cell}"

    def json(self) -> dict[str, Any]:
        return {"cell": self.cell}
