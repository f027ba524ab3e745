"""What is asked before a request of anybody goes out, and told of those that ask."""

from typing import Any, Protocol

from servobus.core.exchange import Exchange
from servobus.core.operation import Priority
from servobus.server.ports.leases import Holder


class Gate(Protocol):
    """Decides which requests go out. Its methods are called in the event loop and must not wait."""

    def admit(
        self,
        who: Holder,
        bus: str,
        exchange: Exchange[Any],
        baud: int,
        asked: float,
        priority: Priority = Priority.READ,
    ) -> None:
        """Raise the ServobusError with which a request is refused; it goes out at once if nothing is raised.

        asked     when it was asked for, by the clock of the event loop, s, as far as the one that asked knows that
        priority  what it is for; STOP where it ends a motion
        """

    def carried_out(self, who: Holder, bus: str, exchange: Exchange[Any], baud: int, outcome: Any) -> None:
        """Take note of what came of a request: its packet, or the error; of a group a list of these."""

    def silent(self, who: Holder) -> None:
        """Take note that nothing was heard of a session for longer than its deadman allows."""

    def left(self, who: Holder) -> None:
        """Take note that a session has ended."""


class PermitAll:
    """The gate of a server that everybody may use for everything."""

    def admit(
        self,
        who: Holder,
        bus: str,
        exchange: Exchange[Any],
        baud: int,
        asked: float,
        priority: Priority = Priority.READ,
    ) -> None:
        """Refuse nothing."""

    def carried_out(self, who: Holder, bus: str, exchange: Exchange[Any], baud: int, outcome: Any) -> None:
        """Note nothing."""

    def silent(self, who: Holder) -> None:
        """Do nothing."""

    def left(self, who: Holder) -> None:
        """Do nothing."""
