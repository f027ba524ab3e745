"""What goes on turn by turn at a fixed rate, written once for both drivers.

A `begin`, then a `step` each period, which gives what is told of that turn, or None once it is over, then an `end`,
whatever happened. One iterates over it, or waits:

    for tick in play: ...            play.wait()
    async for tick in play: ...      await play.wait()
"""

from collections.abc import AsyncGenerator, Generator
from contextlib import suppress
from typing import Any, Generic, TypeVar

from servobus.bus.rate import Rate
from servobus.core.arguments import check_above_0
from servobus.core.operation import Awaiting, Blocking, bus_method
from servobus.errors import BadValue, PortError
from servobus.robots.joints.cycle import RobotResult
from servobus.robots.ports import AsyncOnPorts, OnPorts, Ports
from servobus.robots.steps import RobotJob
from servobus.robots.values import ByJoint

K = TypeVar("K")
"""What is told of a turn."""
FASTEST = 1000.0
"""Turns a second at most."""


class Seen:
    """A turn in which joints were read: `result` has what was read, by joint."""

    __slots__ = ()
    result: RobotResult

    @property
    def positions(self) -> ByJoint[float]:
        """Joint -> angle, rad; `lost` has the joints that did not answer."""
        return self.result.positions


class Turns(Generic[K]):
    """See the head of this module.

    period    s from turn to turn
    over      whether it has ended, or is to end with the next turn
    schedule  the turns since it began, which counts those that were left out; None before
    """

    def __init__(self, ports: Ports[Any], rate: float) -> None:
        if not 1 <= check_above_0("rate", rate) <= FASTEST:
            raise BadValue(f"{rate!r} turns a second: give 1 to {FASTEST:g}")
        self._ports = ports
        self.period = 1 / rate
        self.over = False
        self.schedule: Rate | None = None

    @bus_method
    def begin(self) -> RobotJob[None]:
        """Prepare the first turn."""
        raise NotImplementedError

    @bus_method
    def step(self) -> RobotJob[K | None]:
        """Do what a turn does; None once it is over."""
        raise NotImplementedError

    @bus_method
    def end(self, error: BaseException | None = None) -> RobotJob[None]:
        """Leave all as it has to be after the last turn, or after an error that ended it."""
        raise NotImplementedError

    def turns(self) -> Rate:
        """Give the turns, from now on."""
        assert isinstance(self, Blocking | Awaiting)
        self.schedule = Rate(self, self._ports.now, self.period)
        return self.schedule


class BlockingTurns(OnPorts, Turns[K]):
    """Turns of a blocking robot: iterate over them, or `wait`."""

    def __iter__(self) -> Generator[K, None, None]:
        try:
            self.begin()
            for _ in self.turns():
                if (tick := self.step()) is None:
                    break
                yield tick
        except GeneratorExit as thrown_away:
            with suppress(PortError):  # nothing can be done where the robot was closed before
                self.end(thrown_away)
            raise
        except BaseException as error:
            self.end(error)
            raise
        self.end()

    def wait(self) -> None:
        """Go on to the end, or until `stop`. Raises what ended it before; it left all as `end` does."""
        for _ in self:
            pass


class AsyncTurns(AsyncOnPorts, Turns[K]):
    """Turns of an asynchronous robot: iterate over them with `async for`, or await `wait()`."""

    async def __aiter__(self) -> AsyncGenerator[K, None]:
        try:
            await self.begin()
            async for _ in self.turns():
                if (tick := await self.step()) is None:
                    break
                yield tick
        except GeneratorExit as thrown_away:
            with suppress(PortError):  # nothing can be done where the robot was closed before
                await self.end(thrown_away)
            raise
        except BaseException as error:
            await self.end(error)
            raise
        await self.end()

    async def wait(self) -> None:
        """Go on to the end, or until `stop`; see `BlockingTurns.wait`."""
        async for _ in self:
            pass
