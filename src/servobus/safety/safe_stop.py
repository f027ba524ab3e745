"""Making servos safe: on Ctrl-C, SIGTERM and a crash, and when a watch trips.

Only servos that this bus has switched on or set in motion are touched, each once. What is done is chosen for each;
see `Servo.safe_action`.
"""

import atexit
import contextlib
import os
import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from types import FrameType
from typing import Protocol, TypeVar

from servobus.core.exchange import Procedure, SetBaud
from servobus.errors import Stopped, UsageError
from servobus.families.base import ServoRef
from servobus.families.record import SafeAction, ServoRecord
from servobus.jobs.make_safe import make_safe
from servobus.link.blocking import run_blocking
from servobus.link.link import Link
from servobus.safety.watchdog import Watchdog
from servobus.transports.base import Transport

ACTIONS: tuple[SafeAction, ...] = ("hold", "free", "brake")
TERMINATED = 128 + 15
"""Exit status after SIGTERM, as shells tell it."""


class Joint(Protocol):
    """What is asked here of a servo."""

    target: ServoRef
    baud: int
    notes: ServoRecord

    @property
    def safe_action(self) -> SafeAction: ...


J = TypeVar("J", bound=Joint)


def check_safe_action(action: SafeAction, targets: Iterable[ServoRef]) -> SafeAction:
    """Give a safe action back. Raises UsageError if it is none, or if one of these servos cannot do it."""
    if action not in ACTIONS:
        raise UsageError(f"{action!r} is no safe action; choose {', '.join(ACTIONS)}")
    for target in targets:
        if action == "brake" and not target.model.family.brakes:
            raise UsageError(f"{target} cannot brake, only HerkuleX servos can; let its safe_action be hold or free")
    return action


class SafeStop(ABC):
    """What a driver does so that no servo is left alone in motion."""

    transport: Transport
    link: Link

    def __init__(self, safe_action: SafeAction | None) -> None:
        self._safe_action = None if safe_action is None else check_safe_action(safe_action, ())
        self._watch: Watchdog | None = None
        self._watch_action: SafeAction | None = None
        self._ending = False
        """Whether the servos are made safe for good: the port is about to be closed."""
        self._making_safe = threading.RLock()

    @property
    def safe_action(self) -> SafeAction:
        """Safe action of all servos on this bus; setting it sets that of the known ones and of all still to be found.

        Raises UsageError if a known servo cannot do it. One that is found later and cannot is not moved.
        """
        return self._safe_action or "hold"

    @safe_action.setter
    def safe_action(self, action: SafeAction) -> None:
        self._safe_action = check_safe_action(action, [joint.target for joint in self._joints()])
        for joint in self._joints():
            joint.notes.safe_action = action

    @property
    def watching(self) -> Watchdog | None:
        """The watch that `watch` has begun and nobody has ended; None if there is none."""
        return self._watch

    def watch(self, timeout: float = 0.25, action: SafeAction | None = None) -> Watchdog:
        """Guard streamed motion: make the servos safe if nothing is heard of this program for `timeout` s.

        Each command of motion on this bus feeds the watch, waiting for a move does, and `feed()`. If none comes in
        time, a thread of its own runs `action`, or each servo's safe action, once, even while the program is stuck or
        another thread has the line. Then commands of motion raise Stopped until `reset()` or `stop()` of what is given
        here, and so does waiting for a move. Servos that this bus has not switched on or set in motion are left alone,
        and as long as there is none nothing trips.

        Real time is what counts; on a port with a virtual clock a watch is a UsageError.
        """
        if not self.transport.blocking():
            raise UsageError(f"{self.transport.name}: its clock is virtual, and a watch guards against real delays")
        if self._watch is not None:
            raise UsageError(f"this bus has a watch already, {self._watch!r}; `watching.stop()` of the bus ends it")
        if action is not None:
            check_safe_action(action, [joint.target for joint in self._joints()])
        self._watch_action = action
        self._watch = Watchdog(timeout, self._watch_tripped, self._drives, ended=self._watch_ended)
        return self._watch

    def make_safe(self, action: SafeAction | None = None, *, interrupt: bool = False) -> None:
        """Run the safe action, or this one, of each servo that this bus has switched on or set in motion.

        Blocks until it is done. Each is tried even if another fails; what fails is told through `logging`.
        `interrupt` takes the line at once from whoever has it.
        """
        self._make_safe(self._joints(), action, interrupt=interrupt)

    # What a driver adds

    @abstractmethod
    def _joints(self) -> Sequence[Joint]:
        """Give the known servos."""

    @abstractmethod
    def _take_over(self, *, interrupt: bool) -> AbstractContextManager[Link]:
        """Have the line: wait for whoever uses it, then interrupt him, then go ahead all the same."""

    # What it does

    def _secure(self, joints: Sequence[J]) -> list[J]:
        """Make those servos safe for which somebody chose how; give the others."""
        self._make_safe([joint for joint in joints if joint.notes.safe_action], None, interrupt=True)
        return [joint for joint in joints if not joint.notes.safe_action]

    def _make_safe(self, joints: Sequence[Joint], action: SafeAction | None, *, interrupt: bool) -> None:
        failed: dict[str, Exception] = {}
        with self._making_safe, _undisturbed():
            if not any(joint.notes.driven for joint in joints):
                return
            with self._take_over(interrupt=interrupt) as link:
                for joint in (*joints, *joints):  # what interrupted us may have left the line in disorder
                    if not joint.notes.driven:
                        continue
                    try:
                        run_blocking(link, link.run(_safe(joint, action)))
                    except Exception as error:  # noqa: BLE001 - whatever it is, the next servo must have its turn
                        failed[str(joint.target)] = error
                    else:
                        failed.pop(str(joint.target), None)
        for who, why in failed.items():
            _tell(f"{self.transport.name}: {who} may still move: {why}")

    def _about_to_move(self, joint: Joint) -> None:
        """Hear of a command of motion before it goes out. Raises Stopped or UsageError if it must not."""
        if self._ending:
            raise Stopped(f"{joint.target}: the bus is being closed and its servos were made safe")
        check_safe_action(joint.safe_action, [joint.target])
        if self._watch is not None:
            if self._watch_action is not None:
                check_safe_action(self._watch_action, [joint.target])
            self._watch.feed()
        if self.transport.blocking():  # servos on a virtual clock end with this process
            _arm(self)

    def _kept_alive(self) -> None:
        """Hear that the program is alive and cares for what it moves. Raises Stopped if nothing is to move."""
        if self._ending:
            raise Stopped(f"{self.transport.name}: the bus is being closed and its servos were made safe")
        if self._watch is not None:
            self._watch.feed()

    def _crashed(self, error: BaseException | None) -> bool:
        """Tell whether a `with` block ended by accident: sys.exit(0) is none."""
        return error is not None and not (isinstance(error, SystemExit) and not error.code)

    def _end(self, *, safe: bool) -> None:
        """Leave the servos: as they are, or made safe."""
        if self._watch is not None and not safe:
            self._watch.stop()
        if safe:
            self._ending = True
            self.make_safe(interrupt=True)
            if self._watch is not None:
                self._watch.stop()
        _disarm(self)

    def _drives(self) -> bool:
        return any(joint.notes.driven for joint in self._joints())

    def _after_trip(self) -> None:
        """Do on a port that is open again what could not be done when the watch tripped."""
        if self._watch is not None and self._watch.tripped:
            self.make_safe(self._watch_action, interrupt=True)

    def _watch_tripped(self) -> None:
        self.make_safe(self._watch_action)

    def _watch_ended(self) -> None:
        self._watch = None


def _safe(joint: Joint, action: SafeAction | None) -> Procedure[None]:
    yield SetBaud(joint.baud)
    yield from make_safe(joint.target, action or joint.safe_action)


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
"""Buses that have set something in motion and are open."""
_owner = 0
"""Process that did so: a fork of it has no servos."""


def _arm(bus: SafeStop) -> None:
    """Have the servos of this bus made safe when the program ends, unless the bus is closed before."""
    global _owner  # noqa: PLW0603 - it belongs to the process
    if bus in _armed:
        return
    if not _owner:
        atexit.register(_make_all_safe)
    _owner = os.getpid()
    _armed.add(bus)
    # By default SIGTERM ends Python without any cleaning up.
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminate)


def _disarm(bus: SafeStop) -> None:
    _armed.discard(bus)
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
        for bus in list(_armed):
            bus._end(safe=True)
