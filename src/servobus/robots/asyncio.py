"""The asynchronous robot: the same jobs, awaited.

async with servobus.robot_async("arm.toml") as arm:
    async with arm.torque():
        await arm.move(shoulder=20 * deg, elbow=-45 * deg, time=1.5).wait()
        print(await arm.positions())
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Generator, Iterable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from os import PathLike, fspath
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from servobus.bus.asyncio import AsyncBus
from servobus.core.exchange import Job, Pause
from servobus.core.operation import Awaiting, Priority
from servobus.core.registers import Register
from servobus.errors import ServobusError, UsageError
from servobus.families.record import SafeAction
from servobus.robots.base import BaseRobot, JointSet, JointVerbs
from servobus.robots.file.entries import JointEntry, RobotFile
from servobus.robots.joints.attendance import refuse
from servobus.robots.joints.joint import Part
from servobus.robots.joints.move import JointMove
from servobus.robots.ports import AsyncOnPorts, Ports
from servobus.robots.steps import RobotJob, Together

if TYPE_CHECKING:
    from servobus.robots.joints.cycle import AsyncRobotCycle
    from servobus.robots.motions.follow import AsyncFollow
    from servobus.robots.motions.motion import Motion
    from servobus.robots.motions.play import AsyncPlay
    from servobus.robots.motions.teach import AsyncTeach
    from servobus.robots.trajectory.path import Trajectory

T = TypeVar("T")


class AsyncPorts(Awaiting, Ports[AsyncBus]):
    """The ports of an asynchronous robot."""

    async def do(self, job: RobotJob[T], *, priority: Priority = Priority.READ) -> T:
        """Carry out a job of the robot; see `BlockingPorts.do`."""
        self.check_open()
        answer: Any = None
        try:
            while True:
                step = job.send(answer)
                if isinstance(step, Together):
                    answer = await self._together(step.jobs, priority)
                elif isinstance(step, Pause):
                    answer = None
                    await self._pause(step.seconds)
                else:
                    answer = self.now()
        except StopIteration as stop:
            done: T = stop.value
            return done
        finally:
            job.close()

    async def _together(self, jobs: Mapping[str, Job[Any]], priority: Priority) -> dict[str, Any]:
        async def one(port: str, job: Job[Any]) -> Any:
            try:
                return await self.buses[port].do(job, priority=priority)
            except ServobusError as error:
                return error

        if not self.real:
            self.align(self.now())
            outcomes = {port: await one(port, job) for port, job in jobs.items()}
            self.align(self.now())
            return outcomes
        came = await asyncio.gather(*(one(port, job) for port, job in jobs.items()))
        return dict(zip(jobs, came, strict=True))

    async def _pause(self, seconds: float) -> None:
        if self.real:
            await asyncio.sleep(max(seconds, 0.0))
        else:
            self.align(self.now() + seconds)


class AsyncRobotMove:
    """A move of joints: `await` it to start it, `await ....wait()` to start it and see it arrive."""

    def __init__(self, joints: "AsyncRobotJoints", start: Callable[[], Awaitable[JointMove]]) -> None:
        self._joints, self._start = joints, start
        self.planned: JointMove | None = None
        """What was started; None before that."""

    def __await__(self) -> Generator[Any, None, "AsyncRobotMove"]:
        return self._started().__await__()

    @property
    def duration(self) -> float:
        """Seconds from start to arrival. Raises UsageError before it has started."""
        if self.planned is None:
            raise UsageError("this move has not started: `await` it first")
        return self.planned.duration

    @property
    def done(self) -> Awaitable[bool]:
        """Whether it has ended, to be awaited: `if await move.done`; see `RobotMove.done`."""
        return self._has_ended()

    async def wait(self, timeout: float | None = None) -> None:  # noqa: ASYNC109 - the robot's clock, which may be virtual
        """Start if need be, and wait until the joints stand still near their goals; see `RobotMove.wait`."""
        planned = self.planned or await self._start()
        self.planned = planned
        await self._joints.wait_arrival(planned, timeout)

    async def cancel(self) -> None:
        """Stop the joints where they are, unless the move has ended or has not started."""
        if self.planned is not None:
            await self._joints.cancel(self.planned)

    def __repr__(self) -> str:
        if self.planned is None:
            return "<AsyncRobotMove: not started>"
        return f"<AsyncRobotMove {self.planned}: {'ended' if self.planned.over else 'under way'}>"

    async def _has_ended(self) -> bool:
        return self.planned is not None and await self._joints.has_ended(self.planned)

    async def _started(self) -> "AsyncRobotMove":
        if self.planned is None:
            self.planned = await self._start()
        return self


class AsyncRobotJoint(AsyncOnPorts, JointVerbs):
    """A joint of an asynchronous robot."""

    def __init__(self, ports: AsyncPorts, entry: JointEntry, parts: tuple[Part, ...]) -> None:
        self._ports = ports
        super().__init__(entry, parts)

    def move(self, angle: float, *, time: float | None = None, speed: float | None = None) -> AsyncRobotMove:
        """Move to an angle in rad; nothing happens until the result is awaited. See `Robot.move`."""
        joints = AsyncRobotJoints(self._ports, {self.name: self})
        return joints.move({self.name: angle}, time=time, speed=speed)


class AsyncRobotJoints(AsyncOnPorts, JointSet[AsyncRobotJoint]):
    """Joints of an asynchronous robot that are asked and moved together."""

    def __init__(self, ports: AsyncPorts, joints: Mapping[str, AsyncRobotJoint]) -> None:
        self._ports: AsyncPorts = ports
        super().__init__(joints)
        self._close()

    def move(
        self, goals: Any = None, /, *, time: float | None = None, speed: float | None = None, **angles: float
    ) -> AsyncRobotMove:
        """Move joints that start together and arrive together; nothing happens until the result is awaited.

        See `Robot.move`.
        """

        async def start() -> JointMove:
            return await self.start_move(goals, time=time, speed=speed, **angles)

        return AsyncRobotMove(self, start)

    def cycle(
        self,
        read: Iterable[Register[Any] | str] | Register[Any] | str = "present_position",
        *,
        time: float = 0.0,
    ) -> "AsyncRobotCycle":
        """Prepare a control cycle; nothing is sent. See `Robot.cycle`."""
        from servobus.robots.joints.cycle import AsyncRobotCycle  # noqa: PLC0415 - only control loops need it

        return AsyncRobotCycle(self._ports, list(self), read, time)

    @asynccontextmanager
    async def torque(self) -> AsyncIterator[Self]:
        """Torque on for these joints inside the `async with`, off again on the way out; see `Bus.torque`."""
        if self._has_pairs:
            await self.positions()  # raises Disagreement where two servos on one axis would fight each other
        async with AsyncExitStack() as stack:
            for port, servos in self._servos().items():
                await stack.enter_async_context(self._ports.buses[port].torque(servos))
            yield self


class AsyncRobot(AsyncRobotJoints, BaseRobot[AsyncRobotJoint, AsyncBus]):
    """A robot on its ports, for asyncio; see `servobus.robot_async`."""

    def __init__(self, file: RobotFile, buses: Mapping[str, AsyncBus], *, incomplete: bool) -> None:
        ports = self._ports = AsyncPorts(buses)
        self._incomplete = incomplete
        self._stack = AsyncExitStack()
        BaseRobot.__init__(self, file, ports, AsyncRobotJoint, AsyncRobotJoints)

    async def __aenter__(self) -> Self:
        async with AsyncExitStack() as stack:
            for bus in self.buses.values():
                await stack.enter_async_context(bus)
            refuse(await self.check(strangers="near"), incomplete=self._incomplete)
            self._stack = stack.pop_all()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._stack.__aexit__(kind, error, trace)
        self.close()

    def close(self) -> None:
        """Give the ports back. Torque stays as it is."""
        for bus in self.buses.values():
            bus.close()
        self._ports.closed = True

    def play(
        self, motion: "str | Motion | Trajectory", *, rate: float = 100.0, loop: bool | None = None
    ) -> "AsyncPlay":
        """Prepare a motion; nothing is sent yet. See `Robot.play`."""
        from servobus.robots.motions.play import AsyncPlay  # noqa: PLC0415 - not every program plays motions

        return AsyncPlay(self._ports, list(self), self.motion(motion), rate, loop=loop)

    def follow(self, *joints: str, rate: float = 100.0, jerk: float | None = None) -> "AsyncFollow":
        """Prepare joints to be given new goals while they move; nothing is sent yet. See `Robot.follow`."""
        from servobus.robots.motions.follow import AsyncFollow  # noqa: PLC0415 - not every program gives goals in flight

        return AsyncFollow(self._ports, self.named(*joints), rate, jerk)

    def teach(self, *joints: str, rate: float = 50.0, keep: str | PathLike[str] | None = None) -> "AsyncTeach":
        """Prepare a recording of joints that are moved by hand; nothing is sent yet. See `Robot.teach`."""
        from servobus.robots.motions.teach import AsyncTeach  # noqa: PLC0415 - not every program teaches

        path = None if keep is None else Path(fspath(keep))
        return AsyncTeach(self._ports, self.named(*joints), rate, path, named=bool(joints))

    async def make_safe(self, action: SafeAction | None = None, *, interrupt: bool = False) -> None:
        """Run the safe action, or this one, of each joint that this robot has switched on or set in motion."""
        await asyncio.gather(*(bus.make_safe(action, interrupt=interrupt) for bus in self.buses.values()))
