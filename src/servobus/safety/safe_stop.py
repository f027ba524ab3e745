"""Making servos safe: on Ctrl-C, SIGTERM and a crash, and when a watch trips.

Only servos that this bus has switched on or set in motion are touched, each once. What is done is chosen for each;
see `Servo.safe_action`.
"""

import atexit
import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from types import FrameType
from typing import Protocol, TypeVar

from servobus.core.exchange import Procedure, SetBaud
from servobus.errors import ServobusError, Stopped, UsageError
from servobus.families.base import KnownServo, ServoRef
from servobus.families.record import MotionPermit, SafeAction
from servobus.jobs.make_safe import make_safe
from servobus.link.blocking import run_blocking
from servobus.link.link import Link
from servobus.link.ownership import LineOwnership, Turn
from servobus.safety.watchdog import Watchdog
from servobus.transports.base import Transport

ACTIONS: tuple[SafeAction, ...] = ("hold", "free", "brake")
TERMINATED = 128 + 15
"""Exit status after SIGTERM, as shells tell it."""


class Joint(Protocol):
    """What is asked here of a servo."""

    target: KnownServo

    @property
    def permit(self) -> MotionPermit: ...
    @property
    def safe_action(self) -> SafeAction: ...


J = TypeVar("J", bound=Joint)


def check_safe_action(action: SafeAction, targets: Iterable[ServoRef]) -> SafeAction:
    """Give a safe action back. Raises UsageError if it is none, or if one of these servos cannot do it."""
    if action not in ACTIONS:
        raise UsageError(f"{action!r} is no safe action; choose {', '.join(ACTIONS)}")
    for target in targets:
        if action == "brake" and not target.model.brakes:
            raise UsageError(f"{target} cannot brake; let its safe_action be hold or free")
    return action


class SafeStop:
    """What a bus does so that no servo is left alone in motion: `bus.safety`.

    servos     gives the known servos
    take_over  has the line for a stop, whatever uses it: a context that gives the link and the turn
    """

    def __init__(
        self,
        transport: Transport,
        servos: Callable[[], Sequence[Joint]],
        take_over: Callable[[bool], AbstractContextManager[tuple[Link, LineOwnership, Turn]]],
        safe_action: SafeAction | None,
    ) -> None:
        self._transport, self._servos, self._take_over = transport, servos, take_over
        self._action = None if safe_action is None else check_safe_action(safe_action, ())
        self._watchdog: Watchdog | None = None
        self._watchdog_action: SafeAction | None = None
        self._ending = False
        """Whether the servos are made safe for good: the port is about to be closed."""
        self._making_safe = threading.RLock()

    @property
    def action(self) -> SafeAction:
        """Safe action of all servos; setting it sets that of the known ones and of all still to be found.

        Raises UsageError if a known servo cannot do it. One that is found later and cannot is not moved.
        """
        return self._action or "hold"

    @action.setter
    def action(self, action: SafeAction) -> None:
        self._action = check_safe_action(action, [servo.target for servo in self._servos()])
        for servo in self._servos():
            servo.permit.safe_action = action

    @property
    def chosen(self) -> SafeAction | None:
        """Safe action that was chosen for all servos; None if none was."""
        return self._action

    # The watchdog

    @property
    def watchdog(self) -> Watchdog | None:
        """The watchdog that `watch` has begun and nothing has ended; None if there is none."""
        return self._watchdog

    def watch(self, timeout: float, action: SafeAction | None) -> Watchdog:
        """Begin to guard streamed motion; see `Bus.watch`. Raises UsageError."""
        if not self._transport.blocking():
            raise UsageError(f"{self._transport.name}: its clock is virtual, and a watch guards against real delays")
        if self._watchdog is not None:
            raise UsageError(f"this bus has a watch already, {self._watchdog!r}; `watching.stop()` of the bus ends it")
        if action is not None:
            check_safe_action(action, [servo.target for servo in self._servos()])
        self._watchdog_action = action
        self._watchdog = Watchdog(timeout, self._watchdog_tripped, self.drives, ended=self._watchdog_ended)
        return self._watchdog

    def drives(self) -> bool:
        """Tell whether this bus has switched a servo on or set it in motion, and nothing has ended that since."""
        return any(servo.permit.driven for servo in self._servos())

    def about_to_move(self, servo: Joint) -> None:
        """Take note of a command of motion before it goes out. Raises Stopped or UsageError if it must not."""
        if self._ending:
            raise Stopped(f"{servo.target}: the bus is being closed and its servos were made safe")
        check_safe_action(servo.safe_action, [servo.target])
        if self._watchdog is not None:
            if self._watchdog_action is not None:
                check_safe_action(self._watchdog_action, [servo.target])
            self._watchdog.feed()
        if self._transport.blocking():  # servos on a virtual clock end with this process
            _arm(self)

    def keep_alive(self) -> None:
        """Take note that the program is alive and watches what it moves. Raises Stopped if nothing is to move."""
        if self._ending:
            raise Stopped(f"{self._transport.name}: the bus is being closed and its servos were made safe")
        if self._watchdog is not None:
            self._watchdog.feed()

    # The stop

    def make_safe(
        self, action: SafeAction | None = None, servos: Sequence[Joint] | None = None, *, interrupt: bool = False
    ) -> None:
        """Run the safe action, or this one, of each of these servos (all by default) that this bus drives.

        Blocks until it is done. Each is tried even if another fails; what fails is told through `logging`.
        `interrupt` takes the line at once from whatever has it.
        """
        wanted = list(self._servos() if servos is None else servos)
        failed: dict[str, Exception] = {}
        with self._making_safe, _undisturbed():
            if not any(servo.permit.driven for servo in wanted):
                return
            with self._take_over(interrupt) as (link, line, turn):
                for servo in (*wanted, *wanted):  # what was interrupted may have left the line in disorder
                    if not servo.permit.driven:
                        continue
                    try:
                        run_blocking(link, link.run(_safe(servo, action)), line, turn)
                    except Exception as error:  # noqa: BLE001 - whatever it is, the next servo must have its turn
                        failed[str(servo.target)] = error
                    else:
                        failed.pop(str(servo.target), None)
        for who, why in failed.items():
            _tell(f"{self._transport.name}: {who} may still move: {why}")

    def secure(self, servos: Sequence[J]) -> list[J]:
        """Make those servos safe whose safe action was chosen; give the others."""
        self.make_safe(servos=[servo for servo in servos if servo.permit.safe_action], interrupt=True)
        return [servo for servo in servos if not servo.permit.safe_action]

    @contextlib.contextmanager
    def failures_told(self, what: str) -> Iterator[None]:
        """Tell through `logging` what fails inside, instead of raising it: a more important error is under way."""
        try:
            yield
        except ServobusError as error:
            _tell(f"{self._transport.name}: {what}: {error}")

    # The end

    def end(self, *, safe: bool) -> None:
        """Leave the servos: as they are, or made safe."""
        if self._watchdog is not None and not safe:
            self._watchdog.stop()
        if safe:
            self._ending = True
            self.make_safe(interrupt=True)
            if self._watchdog is not None:
                self._watchdog.stop()
        _disarm(self)

    def after_reopen(self) -> None:
        """Do on a port that is open again what could not be done when the watchdog tripped."""
        if self._watchdog is not None and self._watchdog.tripped:
            self.make_safe(self._watchdog_action, interrupt=True)

    def _watchdog_tripped(self) -> None:
        self.make_safe(self._watchdog_action)

    def _watchdog_ended(self) -> None:
        self._watchdog = None


def crashed(error: BaseException | None) -> bool:
    """Tell whether a `with` block ended by accident: sys.exit(0) is none."""
    return error is not None and not (isinstance(error, SystemExit) and not error.code)


def _safe(servo: Joint, action: SafeAction | None) -> Procedure[None]:
    yield SetBaud(servo.target.baud)
    yield from make_safe(servo.target, action or servo.safe_action)


def _tell(text: str) -> None:
    import logging  # noqa: PLC0415 - slow to import, and seldom wanted

    logging.getLogger("servobus").error(text)


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Hear no second Ctrl-C while the first is being obeyed."""
    old = {}
    if threading.current_thread() is threading.main_thread():  # no other hears any
        for number in (signal.SIGINT, signal.SIGTERM):
            if (handler := signal.getsignal(number)) is not None:  # None could not be set again
                old[number] = handler
    try:
        for number in old:
            signal.signal(number, signal.SIG_IGN)
        yield
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)


# The end of the program

_armed: set[SafeStop] = set()
"""Those of the buses that have set something in motion and are open."""
_owner = 0
"""Process that did so: a fork of it has no servos."""


def _arm(stop: SafeStop) -> None:
    """Have the servos of this bus made safe when the program ends, unless the bus is closed before."""
    global _owner  # noqa: PLW0603 - it belongs to the process
    if stop in _armed:
        return
    if not _owner:
        atexit.register(_make_all_safe)
    _owner = os.getpid()
    _armed.add(stop)
    # By default SIGTERM ends Python without any cleaning up.
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminate)


def _disarm(stop: SafeStop) -> None:
    _armed.discard(stop)
    if (
        not _armed
        and threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGTERM) is _terminate
    ):
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _terminate(_signal: int, _frame: FrameType | None) -> None:
    raise SystemExit(TERMINATED)


def _make_all_safe() -> None:
    """Do what was left undone, at the very end."""
    if os.getpid() == _owner:
        for stop in list(_armed):
            stop.end(safe=True)
