"""Where a register of a HerkuleX lives: in the non-volatile map EEP, in the volatile map RAM, or in both."""

from typing import Any

from servobus.core.registers import Area, Location, Place
from servobus.core.values import frozen

EEP, RAM = "eep", "ram"


@frozen
class Eep(Place):
    """An address in the non-volatile map only."""

    eep: int

    area = Area.EEPROM

    @property
    def locations(self) -> tuple[Location, ...]:
        return ((EEP, self.eep),)

    def text(self, area: Area | None = None) -> str:  # noqa: ARG002 - the map tells it
        return f"EEP {self.eep}"

    def json(self) -> dict[str, Any]:
        return {"address": {"eep": self.eep}}


@frozen
class Ram(Place):
    """An address in the volatile map only."""

    ram: int

    @property
    def locations(self) -> tuple[Location, ...]:
        return ((RAM, self.ram),)

    def text(self, area: Area | None = None) -> str:  # noqa: ARG002 - the map tells it
        return f"RAM {self.ram}"

    def json(self) -> dict[str, Any]:
        return {"address": {"ram": self.ram}}


@frozen
class EepRam(Place):
    """An address in each map: start value in `eep`, working value in `ram`."""

    eep: int
    ram: int

    area = Area.EEPROM
    has_working_copy = True

    @property
    def locations(self) -> tuple[Location, ...]:
        return (RAM, self.ram), (EEP, self.eep)

    def text(self, area: Area | None = None) -> str:  # noqa: ARG002 - the map tells it
        return f"EEP {self.eep}, RAM {self.ram}"

    def json(self) -> dict[str, Any]:
        return {"address": {"eep": self.eep, "ram": self.ram}}
