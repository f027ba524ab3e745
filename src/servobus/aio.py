"""The asynchronous driver: the same jobs, awaited.

async with servobus.open_async("/dev/ttyUSB0") as bus:
    for servo in await bus.scan():
        print(servo)
    elbow = bus[1]
    async with elbow.torque():
        await elbow.move(90 * deg, speed=60 * deg).wait()
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Generator, Iterable, Mapping
from contextlib import asynccontextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

from servobus.driver import POSITION_SPEED_LOAD, Driver
from servobus.exchange import Exchange, Job
from servobus.families.base import Target
from servobus.link import MISSED, Listen, Waits
from servobus.operation import Awaiting
from servobus.procedures import Course
from servobus.servo import Servo

if TYPE_CHECKING:
    from servobus.cycle import AsyncBusCycle

T = TypeVar("T")


class AsyncMove:
    """A move: `await` it to start it, `await ....wait()` to start it and see it arrive."""

    def __init__(self, bus: "AsyncBus", start: Callable[[], Awaitable[list[Course]]]) -> None:
        self._bus = bus
        self._start = start
        self.courses: list[Course] = []

    def __await__(self) -> Generator[Any, None, "AsyncMove"]:
        return self._started().__await__()

    @property
    def duration(self) -> float:
        """Seconds from start to arrival; known once it has started."""
        return max(course.duration for course in self.courses)

    async def wait(self, timeout: float | None = None) -> None:  # noqa: ASYNC109 - the bus's clock, which may be virtual
        """Start if need be, and wait until the servos stand still near their goals. Raises MoveTimeout."""
        await self._started()
        await self._bus.arrive(self.courses, timeout)

    async def _started(self) -> "AsyncMove":
        if not self.courses:
            self.courses = await self._start()
        return self


class AsyncBusServo(Awaiting, Servo):
    """A servo on an asynchronous bus."""

    def __init__(self, bus: "AsyncBus", target: Target, baud: int, firmware: str) -> None:
        super().__init__(target, baud, firmware)
        self._bus = bus

    async def do(self, job: Job[T]) -> T:
        """Carry out any job, an exchange or a procedure, at this servo's speed."""
        return await self._bus.do(job, self.baud)

    def move(self, angle: float, *, time: float | None = None, speed: float | None = None) -> AsyncMove:
        """Move to an angle in rad; nothing happens until the result is awaited.

        `time` in seconds or `speed` in rad/s (90°/s if neither is given). The torque must be on already.
        Raises BadValue, TorqueOff or UsageError before anything moves.
        """

        async def start() -> list[Course]:
            return [await self.start_move(angle, time=time, speed=speed)]

        return AsyncMove(self._bus, start)

    @asynccontextmanager
    async def torque(self) -> AsyncIterator["AsyncBusServo"]:
        """Torque on inside the `async with`, off again on the way out."""
        try:
            await self.torque_on()
            yield self
        finally:
            await self.torque_off()


class AsyncBus(Awaiting, Driver[AsyncBusServo]):
    """Servos on one port, for asyncio. Opening it asks nothing and moves nothing."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._lock = asyncio.Lock()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the port back. Torque stays as it is."""
        self.transport.close()

    async def do(self, job: Job[T], baud: int | None = None) -> T:
        """Carry out any job, an exchange or a procedure, at this speed or at the one in use."""
        async with self._lock:
            if baud is not None and baud != self.transport.baud:
                await self._wait(self.link.set_baud(baud))
            if type(job) is not Exchange:
                return await self._wait(self.link.run(job))
            if not (window := self.link.begin(job)):
                return await self._wait(self.link.carry(job))
            try:
                heard = await self._read(window)
            except asyncio.CancelledError:
                self.link.give_up(job)
                raise
            result = self.link.quick(job, heard)
            return cast("T", result) if result is not MISSED else await self._wait(self.link.carry(job, heard))

    def move(self, goals: Mapping[int, float], *, time: float | None = None, speed: float | None = None) -> AsyncMove:
        """Move several servos, id -> angle in rad, that start together and arrive together; see `Bus.move`."""

        async def start() -> list[Course]:
            return await self.start_move(goals, time=time, speed=speed)

        return AsyncMove(self, start)

    def cycle(
        self,
        read: Iterable[str] = POSITION_SPEED_LOAD,
        write: Iterable[str] = ("goal_position",),
        servos: Iterable[int] | None = None,
        *,
        time: float = 0.0,
    ) -> "AsyncBusCycle":
        """Prepare a control cycle; nothing is sent. See `Bus.cycle`."""
        from servobus.cycle import AsyncBusCycle  # noqa: PLC0415 - only control loops need it

        return AsyncBusCycle(self, self.transport, self._chosen(servos), read, write, time)

    @asynccontextmanager
    async def torque(self, ids: Iterable[int] | None = None) -> AsyncIterator["AsyncBus"]:
        """Torque on for these servos (all known ones by default), off again on the way out."""
        servos = self._chosen(ids)
        try:
            await self.torque_on(servos)
            yield self
        finally:
            await self.torque_off(servos)

    def _bind(self, target: Target, baud: int, firmware: str) -> AsyncBusServo:
        return AsyncBusServo(self, target, baud, firmware)

    # Carrying out

    async def _wait(self, waits: Waits[T]) -> T:
        heard = b""
        try:
            wait = next(waits)
            while True:
                if isinstance(wait, Listen):
                    heard = await self._read(wait.seconds)
                elif wait.shared:
                    self._lock.release()
                    try:
                        await self._pause(wait.seconds)
                    finally:
                        await self._lock.acquire()
                else:
                    await self._pause(wait.seconds)
                wait = waits.send(heard)
        except StopIteration as stop:
            done: T = stop.value
            return done
        finally:
            waits.close()

    # Waiting, the asynchronous way

    async def _read(self, timeout: float) -> bytes:  # noqa: ASYNC109 - the transport's clock
        transport = self.transport
        if not transport.blocking():
            return transport.read(timeout)
        fd = transport.fileno()
        if fd is None:
            return await asyncio.to_thread(transport.read, timeout)
        readable = asyncio.Event()
        loop = asyncio.get_running_loop()
        loop.add_reader(fd, readable.set)
        try:
            await asyncio.wait_for(readable.wait(), timeout)
        except TimeoutError:
            return b""
        finally:
            loop.remove_reader(fd)
        return transport.read(0)

    async def _pause(self, seconds: float) -> None:
        if seconds > 0:
            if self.transport.blocking():
                await asyncio.sleep(seconds)
            else:
                self.transport.sleep(seconds)
