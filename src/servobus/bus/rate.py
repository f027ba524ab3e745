"""A fixed rate on the port's own clock, for control loops: `for tick in cycle.every(0.01)`.

What comes too late is left out and counted. So a loop that stood still for a while goes on with the present: it never
sends in a burst what it should have sent before.
"""

import math
from collections.abc import AsyncIterator, Callable, Iterator

from servobus.core.arguments import check_above_0
from servobus.core.exchange import Pause, Procedure
from servobus.core.operation import Awaiting, Blocking
from servobus.core.values import frozen
from servobus.errors import UsageError

EXACT = 1e-9
"""s by which a tick may be late and still be in time: what rounding does."""


@frozen
class Tick:
    """One turn of a loop."""

    number: int
    """Periods since the loop began, those that were missed included."""
    time: float
    """s since the loop began at which this turn was due: what goals should be worked out for."""
    missed: int
    """Turns left out just before this one, because it was too late for them."""


class Rate:
    """Turns at a fixed rate: iterate over it, with `for` on a `Bus`, with `async for` on an `AsyncBus`.

    A turn that is late by more than half a period is left out, so two of them are never closer than that.

    period    s from turn to turn
    ticks     turns that were given
    missed    turns that were left out
    overruns  turns that took longer than there was time until the next
    worst     longest time by which one did, s
    """

    def __init__(self, owner: Blocking | Awaiting, clock: Callable[[], float], period: float) -> None:
        """Give turns every `period` s of a clock; between them the owner, a bus or a robot, carries out a pause."""
        self.period = check_above_0("period", period)
        self.ticks = self.missed = self.overruns = 0
        self.worst = 0.0
        self._owner, self._clock = owner, clock

    def __iter__(self) -> Iterator[Tick]:
        owner = self._owner
        if not isinstance(owner, Blocking):
            raise UsageError("on an AsyncBus a loop is written `async for tick in ...`")
        for tick, due in self._turns():
            if (early := due - self._clock()) > 0:
                owner.do(_rest(early))
            yield tick

    async def __aiter__(self) -> AsyncIterator[Tick]:
        owner = self._owner
        if not isinstance(owner, Awaiting):
            raise UsageError("on a Bus a loop is written `for tick in ...`, without async")
        for tick, due in self._turns():
            if (early := due - self._clock()) > 0:
                await owner.do(_rest(early))
            yield tick

    def _turns(self) -> Iterator[tuple[Tick, float]]:
        """Give the turns, each with the time at which it is due."""
        began, number, missed = self._clock(), 0, 0
        while True:
            self.ticks += 1
            yield Tick(number, number * self.period, missed), began + number * self.period
            number += 1
            late = self._clock() - began - number * self.period
            self.overruns += late > EXACT
            self.worst = max(self.worst, late)
            missed = max(0, math.ceil((late - EXACT) / self.period - 0.5))
            self.missed += missed
            number += missed


def _rest(seconds: float) -> Procedure[None]:
    """Wait, and let others use the line meanwhile."""
    yield Pause(seconds, shared=True)
