"""The blocking driver.

with servobus.open("/dev/ttyUSB0") as bus:
    for servo in bus.scan():
        print(servo)
    elbow = bus[1]
    with elbow.torque():
        elbow.move(90 * deg, speed=60 * deg).wait()
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from servobus.bus.base import POSITION_SPEED_LOAD, BaseBus
from servobus.bus.reconnect import ReconnectReport, reunite
from servobus.bus.servo import Servo
from servobus.core.exchange import Exchange, Job
from servobus.core.operation import Blocking, Priority
from servobus.core.registers import Register
from servobus.families.base import KnownServo
from servobus.families.record import SafeAction
from servobus.jobs.move import PlannedMove
from servobus.link.base import NOT_FAST
from servobus.link.blocking import run_blocking
from servobus.link.ownership import Turn, turn_for
from servobus.safety.safe_stop import crashed

if TYPE_CHECKING:
    from servobus.bus.cycle import BusCycle

T = TypeVar("T")


class Move:
    """A move under way. A way that takes longer than a servo can be told at once goes on only while `wait` waits."""

    def __init__(self, bus: "Bus", planned: PlannedMove) -> None:
        self._bus = bus
        self.planned = planned

    def __repr__(self) -> str:
        return f"<Move {self.planned}: {'ended' if self.planned.over or self.planned.given_up else 'under way'}>"

    @property
    def duration(self) -> float:
        """Seconds from start to arrival."""
        return self.planned.duration

    @property
    def done(self) -> bool:
        """Whether it has ended: the servos stand still near their goals, or something has ended their motion.

        It asks the servos, but only from when they should be there until they are. Raises BusError.
        """
        return self._bus.has_ended(self.planned)

    def wait(self, timeout: float | None = None) -> None:
        """Wait until the servos stand still near their goals.

        It feeds the watch. Raises MoveTimeout, `timeout` s from now or 2 s after they should have arrived, and Stopped
        at once if a servo was made safe, stopped or switched off. A time-out that is over while they may still come
        leaves them on their way; else a move that fails ends where they are, as the error says.
        """
        self._bus.wait_arrival(self.planned, timeout)

    def cancel(self) -> None:
        """Stop the servos where they are, unless the move has ended; `wait` raises Stopped then."""
        self._bus.cancel(self.planned)


class BusServo(Blocking, Servo):
    """A servo on a blocking bus."""

    def __init__(self, bus: "Bus", target: KnownServo, firmware: str) -> None:
        super().__init__(target, firmware)
        self._bus = bus

    def do(self, job: Job[T], *, priority: Priority = Priority.READ) -> T:
        """Carry out any job, an exchange or a procedure, at this servo's speed."""
        return self._bus.do(job, self.target.baud, priority=priority)

    def move(self, angle: float, *, time: float | None = None, speed: float | None = None) -> Move:
        """Start a move to an angle in rad and give a handle to wait for its end.

        `time` in seconds or `speed` in rad/s (90°/s if neither is given). The torque must be on already.
        Raises BadValue, TorqueOff or UsageError before anything moves.
        """
        return Move(self._bus, self.start_move(angle, time=time, speed=speed))

    def move_by(self, angle: float, *, time: float | None = None, speed: float | None = None) -> Move:
        """Start a move by an angle in rad from where the servo is, plus or minus; see `move`."""
        return Move(self._bus, self.start_move_by(angle, time=time, speed=speed))

    @contextmanager
    def torque(self) -> Iterator["BusServo"]:
        """Torque on inside the `with`, off again on the way out, unless it was on before.

        After an error the safe action instead, if one was chosen; see `Bus.torque`.
        """
        with self._bus.torque([self]):
            yield self


class Bus(Blocking, BaseBus[BusServo]):
    """Servos on one port. Opening it asks nothing and moves nothing. May be shared between threads."""

    def __enter__(self) -> Self:
        self._check_open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is not None and crashed(error):
                for text in self.safety.end(safe=True):
                    error.add_note(text)
        finally:
            self.close()

    def close(self) -> None:
        """Give the port back. Torque stays as it is. Waiting for a move in another thread ends with PortError."""
        self.safety.end(safe=False)
        self.transport.close()

    def reopen(self) -> ReconnectReport[BusServo]:
        """Open the port again after it was lost, and see which servos are there; see `ReconnectReport`.

        A USB adapter is found by its serial number, whatever the port is called now. Servos that lost their RAM, so
        their supply too, are not moved until `torque_on` or `rearm`. Raises PortError if the port is not there.
        """
        turn = turn_for(Priority.MOTION)
        try:
            self.line.acquire(turn)
            self.transport.reopen()
            self._reopened()
            report = self.do(reunite(self))
        finally:
            self.line.end(turn)
        self.safety.after_reopen()
        return report

    def make_safe(self, action: SafeAction | None = None, *, interrupt: bool = False) -> None:
        """Run the safe action, or this one, of each servo that this bus has switched on or set in motion.

        Blocks until it is done. Each is tried even if another fails; what fails is told through `logging`.
        `interrupt` takes the line at once from whatever has it.
        """
        self.safety.make_safe(action, interrupt=interrupt)

    def do(self, job: Job[T], baud: int | None = None, *, priority: Priority = Priority.READ) -> T:
        """Carry out any job, an exchange or a procedure, at this speed or at the one in use.

        Jobs of other threads come first if their `priority` is more urgent, but none is broken off by another.
        """
        line, turn = self.line, Turn() if priority is Priority.READ else turn_for(priority)
        try:
            line.acquire(turn)
            link = self.link
            if baud is not None and baud != self.transport.baud:
                run_blocking(link, link.set_baud(baud), line, turn)
            if type(job) is not Exchange:
                return run_blocking(link, link.run(job), line, turn)
            if not (window := link.try_fast_send(job)):
                return run_blocking(link, link.transact(job), line, turn)
            try:
                heard = self.transport.read(window)
            except BaseException:
                link.abandon()
                raise
            if link.superseded:
                link.check()
            result = link.try_fast_receive(job, heard)
            if result is NOT_FAST:
                return run_blocking(link, link.transact(job, heard), line, turn)
            return result  # type: ignore[return-value] # it is a T, as it is not NOT_FAST
        finally:
            line.end(turn)

    def move(self, goals: Mapping[Any, float], *, time: float | None = None, speed: float | None = None) -> Move:
        """Move several servos, servo or id -> angle in rad, that start together and arrive together.

        They may be of several families: all have `time` s for their way, or the time that the longest way takes at
        `speed` in rad/s (90°/s if neither is given). Everything is checked before anything moves. Raises BadValue,
        TorqueOff or UsageError.
        """
        return Move(self, self.start_move(goals, time=time, speed=speed))

    def cycle(
        self,
        read: Iterable[Register[Any] | str] | Register[Any] | str = POSITION_SPEED_LOAD,
        write: Iterable[Register[Any] | str] | Register[Any] | str = ("goal_position",),
        servos: Iterable[BusServo | int] | BusServo | int | None = None,
        *,
        time: float = 0.0,
    ) -> "BusCycle":
        """Prepare a control cycle that sends goals to servos and reads registers of them; nothing is sent.

        `read` and `write` are registers, or names that their models share, `servos` some of the servos or their ids in
        the order of the cable, all known ones by default, `time` the s a goal is given where the family has such a time
        (0: as fast as possible).
        Raises UnknownName, UsageError or BadValue.
        """
        from servobus.bus.cycle import BusCycle  # noqa: PLC0415 - only control loops need it

        return BusCycle(self, self.transport, self._chosen(servos), read, write, time)

    @contextmanager
    def torque(self, servos: Iterable[BusServo | int] | BusServo | int | None = None) -> Iterator["Bus"]:
        """Torque on for these servos (all known ones by default) inside the `with`, off again on the way out.

        One whose torque was on before keeps it, so that such blocks can stand inside each other. After an error those
        for which a safe action was chosen are made safe instead; one that keeps its torque is stopped.
        """
        driven = self._chosen(servos)
        taken: list[BusServo] = []
        try:
            self._take_hold(driven, taken)
            yield self
        except BaseException as error:
            with self.safety.letting_go(error):
                self._leave(self.safety.secure(driven, error), taken)
            raise
        self.torque_off(taken)

    def _bind(self, target: KnownServo, firmware: str) -> BusServo:
        return BusServo(self, target, firmware)
