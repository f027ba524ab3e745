"""Protection of the servos of a bus against heat and stalls: each is looked at by a monitor of its own."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Generic, TypeVar

from servobus.bus.by_servo import ByServo
from servobus.bus.servo import Servo
from servobus.core.exchange import Procedure, SetBaud
from servobus.errors import BusError, UsageError

if TYPE_CHECKING:
    from servobus.safety.overload import Level, OverloadMonitor, Thresholds

S = TypeVar("S", bound=Servo)


class Protection(Generic[S]):
    """The monitors of the servos that were looked at, and the bounds that were given last."""

    def __init__(self) -> None:
        self._monitors: dict[S, OverloadMonitor] = {}
        self._thresholds: Thresholds | None = None

    def look(self, servos: Iterable[S], thresholds: "Thresholds | None") -> "Procedure[ByServo[S, Level]]":
        """Look at each servo, judge it, and act; see `Bus.protect`."""
        from servobus.safety.overload import OverloadMonitor, Thresholds  # noqa: PLC0415 - only some programs need it

        given: object = thresholds
        if given is not None:
            if not isinstance(given, Thresholds):
                raise UsageError(f"protect() takes Thresholds(warn=...), or nothing, not {given!r:.60}")
            self._thresholds = given.check()
        bounds = self._thresholds or Thresholds()
        levels: dict[S, Level] = {}
        first: BusError | UsageError | None = None
        for servo in servos:
            yield SetBaud(servo.baud)
            try:
                if servo not in self._monitors:
                    self._monitors[servo] = yield from OverloadMonitor.of(servo.target, bounds)
                self._monitors[servo].thresholds = bounds
                levels[servo] = yield from self._monitors[servo].look(servo.target)
            except (BusError, UsageError) as error:
                first = first or error
        if first is not None:
            raise first
        return ByServo(levels)

    def forget(self, servo: S) -> None:
        """Forget the monitor of a servo that is not known any more."""
        self._monitors.pop(servo, None)
