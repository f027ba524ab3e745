"""The blocking driver.

with servobus.open("/dev/ttyUSB0") as bus:
    for servo in bus.scan():
        print(servo)
    elbow = bus[1]
    with elbow.torque():
        elbow.move(90 * deg, speed=60 * deg).wait()
"""

import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from servobus.bus.base import POSITION_SPEED_LOAD, Driver, ReconnectReport
from servobus.bus.servo import Servo
from servobus.core.exchange import Exchange, Job
from servobus.core.operation import Blocking
from servobus.families.base import ServoRef
from servobus.jobs.move import PlannedMove
from servobus.link.blocking import run_blocking
from servobus.link.link import NOT_FAST, Link, Waits

if TYPE_CHECKING:
    from servobus.bus.cycle import BusCycle

T = TypeVar("T")

LOCK_TIMEOUT = 0.1
"""s that one who must make the servos safe waits for the line before he interrupts who has it."""
TAKEOVER_TIMEOUT = 0.4
"""s after which he does without the other's leave."""


class Move:
    """A move under way."""

    def __init__(self, bus: "Bus", moves: list[PlannedMove]) -> None:
        self._bus = bus
        self.moves = moves

    @property
    def duration(self) -> float:
        """Seconds from start to arrival."""
        return max(course.duration for course in self.moves)

    def wait(self, timeout: float | None = None) -> None:
        """Wait until the servos stand still near their goals.

        It feeds the watch. Raises MoveTimeout, and Stopped at once if a servo was made safe, stopped or switched off.
        """
        self._bus.wait_arrival(self.moves, timeout)


class BusServo(Blocking, Servo):
    """A servo on a blocking bus."""

    def __init__(self, bus: "Bus", target: ServoRef, baud: int, firmware: str) -> None:
        super().__init__(target, baud, firmware)
        self._bus = bus

    def do(self, job: Job[T]) -> T:
        """Carry out any job, an exchange or a procedure, at this servo's speed."""
        return self._bus.do(job, self.baud)

    def move(self, angle: float, *, time: float | None = None, speed: float | None = None) -> Move:
        """Start a move to an angle in rad and give a handle to wait for its end.

        `time` in seconds or `speed` in rad/s (90°/s if neither is given). The torque must be on already.
        Raises BadValue, TorqueOff or UsageError before anything moves.
        """
        return Move(self._bus, [self.start_move(angle, time=time, speed=speed)])

    @contextmanager
    def torque(self) -> Iterator["BusServo"]:
        """Torque on inside the `with`, off again on the way out.

        After an error the safe action instead, if one was chosen.
        """
        rest = [self]
        try:
            self.torque_on()
            yield self
        except BaseException:
            rest = self._bus._secure(rest)
            raise
        finally:
            if rest:
                self.torque_off()


class Bus(Blocking, Driver[BusServo]):
    """Servos on one port. Opening it asks nothing and moves nothing. May be shared between threads."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._lock = threading.RLock()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self._crashed(error):
                self._end(safe=True)
        finally:
            self.close()

    def close(self) -> None:
        """Give the port back. Torque stays as it is."""
        self._end(safe=False)
        self.transport.close()

    def reopen(self) -> ReconnectReport:
        """Open the port again after it was lost, and see who is there; see `ReconnectReport`.

        A USB adapter is found by its serial number, whatever the port is called now. Servos that lost their RAM, so
        their supply too, are not moved until `torque_on` or `rearm`. Raises PortError if the port is not there.
        """
        with self._lock:
            self.transport.reopen()
            self._reopened()
            reunion = self.do(self._reunited())
        self._after_trip()
        return reunion

    def do(self, job: Job[T], baud: int | None = None) -> T:
        """Carry out any job, an exchange or a procedure, at this speed or at the one in use."""
        with self._lock:
            link = self.link
            if baud is not None and baud != self.transport.baud:
                self._wait(link, link.set_baud(baud))
            if type(job) is not Exchange:
                return self._wait(link, link.run(job))
            if not (window := link.try_fast_send(job)):
                return self._wait(link, link.transact(job))
            try:
                heard = self.transport.read(window)
            except BaseException:
                link.abandon(job)
                raise
            if link.superseded:
                link.check()
            result = link.try_fast_receive(job, heard)
            if result is NOT_FAST:
                return self._wait(link, link.transact(job, heard))
            return result  # type: ignore[return-value] # it is a T, as it is not NOT_FAST

    def move(self, goals: Mapping[int, float], *, time: float | None = None, speed: float | None = None) -> Move:
        """Move several servos, id -> angle in rad, that start together and arrive together.

        Everything is checked before anything moves. Raises BadValue, TorqueOff or UsageError.
        """
        return Move(self, self.start_move(goals, time=time, speed=speed))

    def cycle(
        self,
        read: Iterable[str] = POSITION_SPEED_LOAD,
        write: Iterable[str] = ("goal_position",),
        servos: Iterable[int] | None = None,
        *,
        time: float = 0.0,
    ) -> "BusCycle":
        """Prepare a control cycle that sends goals to servos and reads registers of them; nothing is sent.

        `read` and `write` are names that their models share, `servos` the ids of some in the order of the cable, all
        known ones by default, `time` the s a goal is given where the family has such a time (0: as fast as possible).
        Raises UnknownName, UsageError or BadValue.
        """
        from servobus.bus.cycle import BusCycle  # noqa: PLC0415 - only control loops need it

        return BusCycle(self, self.transport, self._chosen(servos), read, write, time)

    @contextmanager
    def torque(self, ids: Iterable[int] | None = None) -> Iterator["Bus"]:
        """Torque on for these servos (all known ones by default) inside the `with`, off again on the way out.

        After an error those for which a safe action was chosen are made safe instead.
        """
        servos = self._chosen(ids)
        try:
            self.torque_on(servos)
            yield self
        except BaseException:
            servos = self._secure(servos)
            raise
        finally:
            self.torque_off(servos)

    def _bind(self, target: ServoRef, baud: int, firmware: str) -> BusServo:
        return BusServo(self, target, baud, firmware)

    # Carrying out

    def _wait(self, link: Link, waits: Waits[T]) -> T:
        return run_blocking(link, waits, self._lock)

    @contextmanager
    def _take_over(self, *, interrupt: bool) -> Iterator[Link]:
        link, held = self.link, self._lock.acquire(timeout=0 if interrupt else LOCK_TIMEOUT)
        if interrupt or not held:
            link = link.supersede()
        held = held or self._lock.acquire(timeout=TAKEOVER_TIMEOUT)
        try:
            yield link
        finally:
            self.link = link
            if held:
                self._lock.release()
