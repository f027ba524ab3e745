"""The asynchronous driver: the same jobs, awaited.

async with servobus.open_async("/dev/ttyUSB0") as bus:
    for servo in await bus.scan():
        print(servo)
    elbow = bus[1]
    async with elbow.torque():
        await elbow.move(90 * deg, speed=60 * deg).wait()
"""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Generator, Iterable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from servobus.bus.base import POSITION_SPEED_LOAD, Driver, ReconnectReport
from servobus.bus.servo import Servo
from servobus.core.exchange import Exchange, Job
from servobus.core.operation import Awaiting
from servobus.errors import PortError
from servobus.families.base import ServoRef
from servobus.jobs.move import PlannedMove
from servobus.link.link import NOT_FAST, Link, Receive, Waits

if TYPE_CHECKING:
    from servobus.bus.cycle import AsyncBusCycle

T = TypeVar("T")

LOCK_TIMEOUT = 0.1
"""s that one who must make the servos safe waits for the line before he interrupts who has it."""
TAKEOVER_TIMEOUT = 0.4
"""s after which he does without the other's leave: the loop may be stuck."""
LOOK = 0.002
"""s between two looks whether the line is free; no thread can wait for a lock of a loop."""


class AsyncMove:
    """A move: `await` it to start it, `await ....wait()` to start it and see it arrive."""

    def __init__(self, bus: "AsyncBus", start: Callable[[], Awaitable[list[PlannedMove]]]) -> None:
        self._bus = bus
        self._start = start
        self.moves: list[PlannedMove] = []

    def __await__(self) -> Generator[Any, None, "AsyncMove"]:
        return self._started().__await__()

    @property
    def duration(self) -> float:
        """Seconds from start to arrival; known once it has started."""
        return max(course.duration for course in self.moves)

    async def wait(self, timeout: float | None = None) -> None:  # noqa: ASYNC109 - the bus's clock, which may be virtual
        """Start if need be, and wait until the servos stand still near their goals; see `Move.wait`."""
        await self._started()
        await self._bus.wait_arrival(self.moves, timeout)

    async def _started(self) -> "AsyncMove":
        if not self.moves:
            self.moves = await self._start()
        return self


class AsyncBusServo(Awaiting, Servo):
    """A servo on an asynchronous bus."""

    def __init__(self, bus: "AsyncBus", target: ServoRef, baud: int, firmware: str) -> None:
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

        async def start() -> list[PlannedMove]:
            return [await self.start_move(angle, time=time, speed=speed)]

        return AsyncMove(self._bus, start)

    @asynccontextmanager
    async def torque(self) -> AsyncIterator["AsyncBusServo"]:
        """Torque on inside the `async with`, off again on the way out.

        After an error the safe action instead, if one was chosen.
        """
        rest = [self]
        try:
            await self.torque_on()
            yield self
        except BaseException:
            rest = self._bus._secure(rest)
            raise
        finally:
            if rest:
                await self.torque_off()


class AsyncBus(Awaiting, Driver[AsyncBusServo]):
    """Servos on one port, for asyncio. Opening it asks nothing and moves nothing."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._lock = asyncio.Lock()
        self._reading = threading.Lock()
        """Held while a thread reads, where the loop cannot wait by itself."""
        self._waiter: asyncio.Future[bytes] | None = None
        """Who waits for bytes."""
        self._listening: tuple[asyncio.AbstractEventLoop, int] | None = None
        """The loop that tells when the port's descriptor is readable."""

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self._crashed(error):
                self._end(safe=True)  # blocking: a second cancellation must not end it halfway
        finally:
            self.close()

    def close(self) -> None:
        """Give the port back. Torque stays as it is."""
        self._end(safe=False)
        self._stop_listening()
        self.transport.close()

    async def reopen(self) -> ReconnectReport:
        """Open the port again after it was lost, and see who is there; see `Bus.reopen`."""
        async with self._lock:
            self._stop_listening()  # what is opened may get the same descriptor
            if self.transport.blocking():
                await asyncio.to_thread(self.transport.reopen)
            else:
                self.transport.reopen()
            self._reopened()
        reunion = await self.do(self._reunited())
        self._after_trip()
        return reunion

    async def do(self, job: Job[T], baud: int | None = None) -> T:
        """Carry out any job, an exchange or a procedure, at this speed or at the one in use."""
        async with self._lock:
            link = self.link
            if baud is not None and baud != self.transport.baud:
                await self._wait(link, link.set_baud(baud))
            if type(job) is not Exchange:
                return await self._wait(link, link.run(job))
            if not (window := link.try_fast_send(job)):
                return await self._wait(link, link.transact(job))
            try:
                heard = await self._read(window)
            except BaseException:
                link.abandon(job)
                raise
            if link.superseded:
                link.check()
            result = link.try_fast_receive(job, heard)
            if result is NOT_FAST:
                return await self._wait(link, link.transact(job, heard))
            return result  # type: ignore[return-value] # it is a T, as it is not NOT_FAST

    def move(self, goals: Mapping[int, float], *, time: float | None = None, speed: float | None = None) -> AsyncMove:
        """Move several servos, id -> angle in rad, that start together and arrive together; see `Bus.move`."""

        async def start() -> list[PlannedMove]:
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
        from servobus.bus.cycle import AsyncBusCycle  # noqa: PLC0415 - only control loops need it

        return AsyncBusCycle(self, self.transport, self._chosen(servos), read, write, time)

    @asynccontextmanager
    async def torque(self, ids: Iterable[int] | None = None) -> AsyncIterator["AsyncBus"]:
        """Torque on for these servos (all known ones by default), off again on the way out.

        After an error those for which a safe action was chosen are made safe instead.
        """
        servos = self._chosen(ids)
        try:
            await self.torque_on(servos)
            yield self
        except BaseException:
            servos = self._secure(servos)
            raise
        finally:
            await self.torque_off(servos)

    def _bind(self, target: ServoRef, baud: int, firmware: str) -> AsyncBusServo:
        return AsyncBusServo(self, target, baud, firmware)

    # Carrying out

    async def _wait(self, link: Link, waits: Waits[T]) -> T:
        heard = b""
        try:
            wait = next(waits)
            while True:
                if isinstance(wait, Receive):
                    heard = await self._read(wait.seconds)
                elif wait.shared:
                    self._lock.release()
                    try:
                        await self._pause(wait.seconds)
                    finally:
                        await self._lock.acquire()
                else:
                    await self._pause(wait.seconds)
                if link.superseded:
                    link.check()
                wait = waits.send(heard)
        except StopIteration as stop:
            done: T = stop.value
            return done
        finally:
            waits.close()

    @contextmanager
    def _take_over(self, *, interrupt: bool) -> Iterator[Link]:
        """See `SafeStop._take_over`. Tasks that want the line meanwhile get Stopped: no lock holds them off."""
        old = self.link
        if not interrupt:
            self._await_free(LOCK_TIMEOUT)
        link = old.supersede()
        if not interrupt:
            self._await_free(TAKEOVER_TIMEOUT)
        held = self._reading.acquire(timeout=TAKEOVER_TIMEOUT)
        try:
            yield link
        finally:
            self.link = link
            if held:
                self._reading.release()

    def _await_free(self, reply_margin: float) -> None:
        end = time.monotonic() + reply_margin
        while self._lock.locked() and time.monotonic() < end:
            time.sleep(LOOK)

    def _read_alone(self, timeout: float) -> bytes:
        with self._reading:
            return self.transport.read(timeout)

    # Waiting, the asynchronous way

    async def _read(self, timeout: float) -> bytes:  # noqa: ASYNC109 - the transport's clock
        transport = self.transport
        if not transport.blocking():
            return transport.read(timeout)
        fd = transport.fileno()
        if fd is None:
            return await asyncio.to_thread(self._read_alone, timeout)
        loop = asyncio.get_running_loop()
        if self._listening != (loop, fd):
            loop.add_reader(fd, self._readable, loop, fd)
            self._listening = loop, fd
        waiter: asyncio.Future[bytes] = loop.create_future()
        self._waiter = waiter
        timer = loop.call_later(timeout, _end, waiter)
        try:
            return await waiter
        finally:
            timer.cancel()
            self._waiter = None

    def _stop_listening(self) -> None:
        if self._listening is not None:
            loop, fd = self._listening
            self._listening = None
            if not loop.is_closed():
                loop.remove_reader(fd)

    def _readable(self, loop: asyncio.AbstractEventLoop, fd: int) -> None:
        """Give bytes to who waits for them. If nobody does, stop listening: the loop would turn and turn."""
        waiter = self._waiter
        if waiter is None or waiter.done():
            loop.remove_reader(fd)
            self._listening = None
            return
        try:
            waiter.set_result(self.transport.read(0))
        except PortError as error:
            waiter.set_exception(error)

    async def _pause(self, seconds: float) -> None:
        if seconds > 0:
            if self.transport.blocking():
                await asyncio.sleep(seconds)
            else:
                self.transport.sleep(seconds)


def _end(waiter: asyncio.Future[bytes]) -> None:
    if not waiter.done():
        waiter.set_result(b"")
