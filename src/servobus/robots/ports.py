"""The ports of a robot: steps of its jobs carried out on all of them side by side.

On real ports one thread waits for all of them at once, or the tasks of a loop are gathered. Ports of virtual
servos on a virtual clock are used one after the other, each from the same moment; then those that were done sooner wait
for the last. So a step takes as long as its longest job on both kinds.
"""

import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Generic, TypeVar

from servobus.bus.base import BaseBus
from servobus.bus.blocking import Bus
from servobus.bus.side_by_side import run_side_by_side
from servobus.core.exchange import Job, Pause
from servobus.core.operation import Awaiting, Blocking, Priority
from servobus.errors import PortError, ServobusError, UsageError
from servobus.robots.steps import RobotJob, Together

B = TypeVar("B", bound=BaseBus[Any])
T = TypeVar("T")


class Ports(Generic[B]):
    """The buses of a robot by the name of their port, and one clock for all of them."""

    def __init__(self, buses: Mapping[str, B]) -> None:
        self.buses = dict(buses)
        clocks = {bus.transport.blocking() for bus in self.buses.values()}
        if len(clocks) > 1:
            raise UsageError("ports on a virtual clock and on the real one cannot be of one robot")
        self.real = clocks.pop()
        """Whether time passes by itself."""
        self._began = time.monotonic()
        self._behind = {name: bus.transport.now() - self.now() for name, bus in self.buses.items()}
        self.closed = False
        """Whether the robot was closed: nothing is asked any more."""

    def check_open(self) -> None:
        """Raise PortError once the robot was closed; its joints would all count as lost."""
        if self.closed:
            raise PortError("this robot is closed; open it anew with servobus.robot(FILE)")

    def now(self) -> float:
        """Give the time on the robot's clock, s since it was opened."""
        if self.real:
            return time.monotonic() - self._began
        return max(bus.transport.now() for bus in self.buses.values())

    def at(self, port: str, moment: float) -> float:
        """Turn a moment of a port's clock into one of the robot's."""
        return moment - self._behind[port] if self.real else moment

    def align(self, moment: float) -> None:
        """Let all ports on a virtual clock stand at this moment, unless they are beyond; a real one goes by itself."""
        if self.real:
            return
        for bus in self.buses.values():
            if (behind := moment - bus.transport.now()) > 0:
                bus.transport.sleep(behind)


class BlockingPorts(Blocking, Ports[Bus]):
    """The ports of a blocking robot."""

    def __init__(self, buses: Mapping[str, Bus]) -> None:
        super().__init__(buses)
        self._threads: ThreadPoolExecutor | None = None

    def close(self) -> None:
        """End the threads. What they still do on a line ends by itself."""
        self.closed = True
        if self._threads is not None:
            self._threads.shutdown(wait=False)

    def do(self, job: RobotJob[T], *, priority: Priority = Priority.READ) -> T:
        """Carry out a job of the robot."""
        self.check_open()
        answer: Any = None
        try:
            while True:
                step = job.send(answer)
                if isinstance(step, Together):
                    answer = self._together(step.jobs, priority)
                elif isinstance(step, Pause):
                    answer = None
                    self._pause(step.seconds)
                else:
                    answer = self.now()
        except StopIteration as stop:
            done: T = stop.value
            return done
        finally:
            job.close()

    def _together(self, jobs: Mapping[str, Job[Any]], priority: Priority) -> dict[str, Any]:
        if len(jobs) > 1 and self.real:
            there = {port: (self.buses[port], job) for port, job in jobs.items()}
            return run_side_by_side(there, priority, self._begin)
        self.align(self.now())
        outcomes = {port: self._one(port, job, priority) for port, job in jobs.items()}
        self.align(self.now())
        return outcomes

    def _one(self, port: str, job: Job[Any], priority: Priority) -> Any:
        try:
            return self.buses[port].do(job, priority=priority)
        except ServobusError as error:
            return error

    def _pause(self, seconds: float) -> None:
        if self.real:
            time.sleep(max(seconds, 0.0))  # no line is held, so others use them meanwhile
        else:
            self.align(self.now() + seconds)

    def _begin(self, work: Callable[[], Any]) -> "Future[Any]":
        if self._threads is None:
            self._threads = ThreadPoolExecutor(len(self.buses), thread_name_prefix="servobus-port")
        return self._threads.submit(work)


class OnPorts(Blocking):
    """What has its jobs carried out on the ports of a blocking robot."""

    _ports: Any
    """`BlockingPorts`; what is written once for both drivers has ports of either kind."""

    def do(self, job: RobotJob[T], *, priority: Priority = Priority.READ) -> T:
        """Carry out a job of the robot."""
        done: T = self._ports.do(job, priority=priority)
        return done


class AsyncOnPorts(Awaiting):
    """What has its jobs carried out on the ports of an asynchronous robot."""

    _ports: Any
    """`AsyncPorts`, which stand elsewhere, since asyncio is slow to import."""

    async def do(self, job: RobotJob[T], *, priority: Priority = Priority.READ) -> T:
        """Carry out a job of the robot."""
        done: T = await self._ports.do(job, priority=priority)
        return done
