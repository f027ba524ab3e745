"""Where a register of a LewanSoul servo lives: the servo has no table, commands write and read what it keeps."""

from typing import Any

from servobus.core.registers import Area, Location, Place
from servobus.core.values import frozen


@frozen
class Pair(Place):
    """A pair of commands, with the byte of their parameters at which the value stands.

    `write` is None for what can only be read. `alone` tells whether the value may be written without
    its neighbours in the same command; they are then read first and sent back unchanged.
    """

    write: int | None
    read: int
    at: int = 0
    alone: bool = True

    @property
    def locations(self) -> tuple[Location, ...]:
        # What acts and what is saved can differ (command 18), so each has a map of its own.
        return (f"command {self.read:d}", self.at), (f"saved {self.read:d}", self.at)

    def text(self, area: Area | None = None) -> str:  # noqa: ARG002 - the commands say nothing of it
        commands = f"command {self.read:d}" if self.write is None else f"commands {self.write:d}/{self.read:d}"
        return f"{commands} byte {self.at}"

    def json(self) -> dict[str, Any]:
        write = None if self.write is None else int(self.write)
        return {"command": {"write": write, "read": int(self.read), "byte": self.at}}
