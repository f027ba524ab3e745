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
from concurrent.futures import Future
from contextlib import asynccontextmanager
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from servobus.bus.base import POSITION_SPEED_LOAD, BaseBus
from servobus.bus.beside_loop import Done, awaited, begin_in_thread, running_loop, to_its_end
from servobus.bus.loop_reader import LoopReader
from servobus.bus.reconnect import ReconnectReport, reunite
from servobus.bus.servo import Servo
from servobus.core.exchange import Exchange, Job
from servobus.core.operation import Awaiting, Priority
from servobus.core.registers import Register
from servobus.errors import PortError, UsageError
from servobus.families.base import KnownServo
from servobus.families.record import SafeAction
from servobus.jobs.move import PlannedMove
from servobus.link.base import NOT_FAST, BaseLink
from servobus.link.ownership import Turn, turn_for
from servobus.link.waits import Receive, Waits
from servobus.safety.safe_stop import crashed
from servobus.transports.base import Transport
from servobus.transports.shared_reader import SharedReader

if TYPE_CHECKING:
    from servobus.bus.cycle import AsyncBusCycle

T = TypeVar("T")


class AsyncMove:
    """A move: `await` it to start it, `await ....wait()` to start it and see it arrive."""

    def __init__(self, bus: "AsyncBus", start: Callable[[], Awaitable[PlannedMove]]) -> None:
        self._bus = bus
        self._start = start
        self.planned: PlannedMove | None = None
        """What was started; None before that."""

    def __await__(self) -> Generator[Any, None, "AsyncMove"]:
        return self._started().__await__()

    @property
    def duration(self) -> float:
        """Seconds from start to arrival. Raises UsageError before it has started."""
        if self.planned is None:
            raise UsageError("this move has not started: `await` it first")
        return self.planned.duration

    def __repr__(self) -> str:
        if self.planned is None:
            return "<AsyncMove: not started>"
        return f"<AsyncMove {self.planned}: {'ended' if self.planned.over or self.planned.given_up else 'under way'}>"

    @property
    def done(self) -> Awaitable[bool]:
        """Whether it has ended, to be awaited: `if await move.done`; see `Move.done`."""
        return self._has_ended()

    async def cancel(self) -> None:
        """Stop the servos where they are, unless the move has ended or has not started; see `Move.cancel`."""
        if self.planned is not None:
            await self._bus.cancel(self.planned)

    async def wait(self, timeout: float | None = None) -> None:  # noqa: ASYNC109 - the bus's clock, which may be virtual
        """Start if need be, and wait until the servos stand still near their goals; see `Move.wait`."""
        planned = self.planned or await self._start()
        self.planned = planned
        await self._bus.wait_arrival(planned, timeout)

    async def _has_ended(self) -> bool:
        return self.planned is not None and await self._bus.has_ended(self.planned)

    async def _started(self) -> "AsyncMove":
        if self.planned is None:
            self.planned = await self._start()
        return self


class AsyncBusServo(Awaiting, Servo):
    """A servo on an asynchronous bus."""

    def __init__(self, bus: "AsyncBus", target: KnownServo, firmware: str) -> None:
        super().__init__(target, firmware)
        self._bus = bus

    async def do(self, job: Job[T], *, priority: Priority = Priority.READ) -> T:
        """Carry out any job, an exchange or a procedure, at this servo's speed."""
        return await self._bus.do(job, self.target.baud, priority=priority)

    def move(self, angle: float, *, time: float | None = None, speed: float | None = None) -> AsyncMove:
        """Move to an angle in rad; nothing happens until the result is awaited.

        `time` in seconds or `speed` in rad/s (90°/s if neither is given). The torque must be on already.
        Raises BadValue, TorqueOff or UsageError before anything moves.
        """

        async def start() -> PlannedMove:
            return await self.start_move(angle, time=time, speed=speed)

        return AsyncMove(self._bus, start)

    def move_by(self, angle: float, *, time: float | None = None, speed: float | None = None) -> AsyncMove:
        """Move by an angle in rad from where the servo is then, plus or minus; see `move`."""

        async def start() -> PlannedMove:
            return await self.start_move_by(angle, time=time, speed=speed)

        return AsyncMove(self._bus, start)

    @asynccontextmanager
    async def torque(self) -> AsyncIterator["AsyncBusServo"]:
        """Torque on inside the `async with`, off again on the way out, unless it was on before; see `Bus.torque`."""
        async with self._bus.torque([self]):
            yield self


class AsyncBus(Awaiting, BaseBus[AsyncBusServo]):
    """Servos on one port, for asyncio. Opening it asks nothing and moves nothing."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._stopping: Future[Any] | None = None
        """The stop that was begun last, beside the loop: the port stays open until it is over."""
        super().__init__(*args, **kwargs)
        self._reader = self._new_reader()

    async def __aenter__(self) -> Self:
        self._check_open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is not None and crashed(error):
                ended = self._beside_the_loop(partial(self.safety.end, safe=True))
                for text in await to_its_end(ended):
                    error.add_note(text)
            if self._stopping is not None:
                # A second cancellation must not end it halfway.
                await to_its_end(awaited(self._stopping, asyncio.get_running_loop()))
        finally:
            self.close()

    def close(self) -> None:
        """Give the port back. Torque stays as it is. Waiting for a move in another task ends with PortError."""
        self.safety.end(safe=False)
        self._reader.close()
        self.transport.close()

    async def reopen(self) -> ReconnectReport[AsyncBusServo]:
        """Open the port again after it was lost, and see which servos are there; see `Bus.reopen`."""
        turn = turn_for(Priority.MOTION)
        try:
            await self.line.acquire_async(turn)
            self._reader.close()  # what is opened may get the same descriptor
            # A thread that opens a port cannot be stopped, and nothing may use the line meanwhile.
            await to_its_end(asyncio.ensure_future(self._reopen_port()))
        finally:
            self.line.end(turn)
        report = await self.do(reunite(self))
        await to_its_end(self._beside_the_loop(self.safety.after_reopen))
        return report

    async def _reopen_port(self) -> None:
        if self.transport.blocking():
            await asyncio.to_thread(self.transport.reopen)
        else:
            self.transport.reopen()
        self._port = self._shared(self.transport)
        self._reader = self._new_reader()
        self._reopened()

    def make_safe(self, action: SafeAction | None = None, *, interrupt: bool = False) -> Awaitable[None]:
        """Run the safe action, or this one, of each servo that this bus has switched on or set in motion.

        It begins at once, in a thread beside the event loop; await what is given to see its end, which no cancellation
        delays or prevents. See `Bus.make_safe`.
        """

        def work() -> None:
            self.safety.make_safe(action, interrupt=interrupt)

        return self._beside_the_loop(work)

    async def do(self, job: Job[T], baud: int | None = None, *, priority: Priority = Priority.READ) -> T:
        """Carry out any job, an exchange or a procedure, at this speed or at the one in use; see `Bus.do`."""
        line, turn = self.line, Turn() if priority is Priority.READ else turn_for(priority)
        try:
            if not line.try_acquire(turn):
                await line.acquire_async(turn)
            return await self.do_in_turn(turn, job, baud)
        finally:
            line.end(turn)

    async def do_in_turn(self, turn: Turn, job: Job[T], baud: int | None = None) -> T:
        """Carry out a job with a turn that has the line, and keeps it; see `do`."""
        link = self.link
        if baud is not None and baud != self.transport.baud:
            await self._wait(link, link.set_baud(baud), turn)
        if type(job) is not Exchange:
            return await self._wait(link, link.run(job), turn)
        if not (window := link.try_fast_send(job)):
            return await self._wait(link, link.transact(job), turn)
        try:
            heard = await self._reader.read(window)
        except BaseException:
            link.abandon()
            raise
        if link.superseded:
            link.check()
        result = link.try_fast_receive(job, heard)
        if result is NOT_FAST:
            return await self._wait(link, link.transact(job, heard), turn)
        return result  # type: ignore[return-value] # it is a T, as it is not NOT_FAST

    def move(self, goals: Mapping[Any, float], *, time: float | None = None, speed: float | None = None) -> AsyncMove:
        """Move several servos, servo or id -> angle in rad, that start together and arrive together; see `Bus.move`."""

        async def start() -> PlannedMove:
            return await self.start_move(goals, time=time, speed=speed)

        return AsyncMove(self, start)

    def cycle(
        self,
        read: Iterable[Register[Any] | str] | Register[Any] | str = POSITION_SPEED_LOAD,
        write: Iterable[Register[Any] | str] | Register[Any] | str = ("goal_position",),
        servos: Iterable[AsyncBusServo | int] | AsyncBusServo | int | None = None,
        *,
        time: float = 0.0,
    ) -> "AsyncBusCycle":
        """Prepare a control cycle; nothing is sent. See `Bus.cycle`."""
        from servobus.bus.cycle import AsyncBusCycle  # noqa: PLC0415 - only control loops need it

        return AsyncBusCycle(self, self.transport, self._chosen(servos), read, write, time)

    @asynccontextmanager
    async def torque(
        self, servos: Iterable[AsyncBusServo | int] | AsyncBusServo | int | None = None
    ) -> AsyncIterator["AsyncBus"]:
        """Torque on for these servos (all known ones by default), off again on the way out; see `Bus.torque`."""
        driven = self._chosen(servos)
        taken: list[AsyncBusServo] = []
        try:
            await self._take_hold(driven, taken)
            yield self
        except BaseException as error:
            with self.safety.letting_go(error):
                await to_its_end(asyncio.ensure_future(self._let_go(driven, taken, error)))
            raise
        await self.torque_off(taken)

    async def _let_go(self, servos: list[AsyncBusServo], taken: list[AsyncBusServo], error: BaseException) -> None:
        """Make those servos safe whose safe action was chosen, and let go of the others."""
        await self._leave(await self._beside_the_loop(partial(self.safety.secure, servos, error)), taken)

    def _bind(self, target: KnownServo, firmware: str) -> AsyncBusServo:
        return AsyncBusServo(self, target, firmware)

    # The line

    def _shared(self, transport: Transport) -> Transport:
        """Have a port that the loop cannot watch read in a thread."""
        watched = not transport.blocking() or transport.fileno() is not None
        return transport if watched else SharedReader(transport)

    def _firm(self) -> float:
        """Give how long a stop waits for what it has interrupted: not at all in the loop, which it would hold up."""
        return 0.0 if running_loop() is not None else super()._firm()

    async def _wait(self, link: BaseLink, waits: Waits[T], turn: Turn) -> T:
        """Wait as asked until the job is done; as `run_blocking`, without holding the event loop."""
        heard = b""
        try:
            wait = next(waits)
            while True:
                if isinstance(wait, Receive):
                    try:
                        heard = await self._reader.read(wait.seconds)
                    except PortError as error:
                        wait = waits.throw(error)
                        continue
                elif wait.shared:
                    self.line.give_way(turn)
                    await self._pause(wait.seconds)
                    await self.line.acquire_async(turn)
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

    async def _pause(self, seconds: float) -> None:
        if not self.transport.blocking():
            self.transport.sleep(seconds)
        else:
            await asyncio.sleep(max(seconds, 0.0))

    def _beside_the_loop(self, work: Callable[[], T]) -> Awaitable[T]:
        """Begin blocking work at once, in a thread beside the event loop; give an awaitable of its result.

        Without a loop in this thread, or on a virtual clock, which only its caller can let go on, it is done at once.
        """
        loop = running_loop()
        if loop is None or not self.transport.blocking():
            return Done(work())
        self._stopping = begin_in_thread(work)
        return awaited(self._stopping, loop)

    def _new_reader(self) -> LoopReader:
        def thread_has_line() -> bool:
            """Tell whether a thread beside the loop uses the line: a stop that makes the servos safe."""
            holder = self.line.holder
            return holder is not None and holder.thread != 0

        return LoopReader(self._port, thread_has_line)
