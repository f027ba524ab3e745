"""Making servos safe: on Ctrl-C, SIGTERM and a crash, and when a watch trips.

Only servos that this bus has switched on or set in motion are touched, each once. What is done is chosen for each;
see `Servo.safe_action`.
"""

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Protocol, TypeVar

from servobus.core.exchange import Procedure, SetBaud
from servobus.errors import PortError, Stopped, UsageError
from servobus.families.base import LIMP, KnownServo, ServoRef, StopOutcome
from servobus.families.record import MotionPermit, SafeAction
from servobus.jobs.make_safe import give_back, make_safe, make_safe_anyhow
from servobus.link.base import BaseLink
from servobus.link.blocking import run_blocking
from servobus.link.ownership import LineOwnership, Turn
from servobus.safety import signals
from servobus.safety.watchdog import Watchdog
from servobus.transports.base import Transport

ACTIONS: tuple[SafeAction, ...] = ("hold", "free", "brake")


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
        take_over: Callable[[bool], AbstractContextManager[tuple[BaseLink, LineOwnership, Turn]]],
        safe_action: SafeAction | None,
    ) -> None:
        self._transport, self._servos, self._take_over = transport, servos, take_over
        self._action = None if safe_action is None else check_safe_action(safe_action, ())
        self._watchdog: Watchdog | None = None
        self._watchdog_action: SafeAction | None = None
        self._ending = False
        """Whether the servos are made safe for good: the port is about to be closed."""
        self._closed = False
        self._making_safe = threading.RLock()
        self._open()

    def _open(self) -> None:
        self._closed = False
        if self._transport.blocking():  # servos on a virtual clock end with this process
            signals.opened(self)

    @property
    def closed(self) -> bool:
        """Whether the port was given back, and not opened again since."""
        return self._closed

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
        if self._closed:
            raise PortError(f"{self._transport.name} is closed")
        check_safe_action(servo.safe_action, [servo.target])
        if self._watchdog is not None:
            if self._watchdog_action is not None:
                check_safe_action(self._watchdog_action, [servo.target])
            self._watchdog.feed()
        if self._transport.blocking():
            signals.about_to_move(self)

    def keep_alive(self) -> None:
        """Take note that the program is alive and watches what it moves. Raises Stopped if nothing is to move.

        On a port that was closed nobody can watch: PortError.
        """
        if self._ending:
            raise Stopped(f"{self._transport.name}: the bus is being closed and its servos were made safe")
        if self._closed:
            raise PortError(f"{self._transport.name} is closed")
        if self._watchdog is not None:
            self._watchdog.feed()

    # The stop

    def make_safe(
        self, action: SafeAction | None = None, servos: Sequence[Joint] | None = None, *, interrupt: bool = False
    ) -> list[str]:
        """Run the safe action, or this one, of each of these servos (all by default) that this bus drives.

        Blocks until it is done. Each is tried even if another fails; gives what failed in words, and tells it through
        `logging`. `interrupt` takes the line at once from whatever has it.
        """
        with signals.undisturbed(ending=False):
            return self._make_safe(action, list(self._servos() if servos is None else servos), interrupt=interrupt)

    def _make_safe(self, action: SafeAction | None, servos: Sequence[Joint], *, interrupt: bool) -> list[str]:
        """Make servos safe; tell what could not be done, or was not what was asked for, and give that."""
        said: dict[str, str] = {}
        held: list[KnownServo] = []
        with self._making_safe:
            if not any(servo.permit.driven for servo in servos):
                return []
            with self._take_over(interrupt) as (link, line, turn):
                # Those with which the careful way fails come once more, after all the others: it may have failed only
                # because what was interrupted has left the line in disorder.
                for work in (make_safe, make_safe_anyhow):
                    for servo in servos:
                        if not servo.permit.driven:
                            continue
                        who, wanted = str(servo.target), action or servo.safe_action
                        try:
                            waits = link.run(_at_its_speed(servo, work(servo.target, wanted)))
                            outcome = run_blocking(link, waits, line, turn)
                        except Exception as error:  # noqa: BLE001 - whatever it is, the next servo must have its turn
                            said[who] = f"{who} may still move: {error}"
                        else:
                            said.pop(who, None)
                            if outcome.let_go and outcome is not LIMP and wanted == "hold":
                                said[who] = f"{who}: {outcome}"
                            if not outcome.let_go:
                                held.append(servo.target)
                for target in held:  # when all have stopped, for it delays none then
                    with contextlib.suppress(Exception):
                        run_blocking(link, link.run(give_back(target)), line, turn)
        told = [f"{self._transport.name}: {text}" for text in said.values()]
        for text in told:
            _tell(text)
        return told

    @contextlib.contextmanager
    def letting_go(self, error: BaseException) -> Iterator[None]:
        """Have what lets go of servos after an error not broken off by signals, nor its own failures raised.

        The error under way is the one that comes out: what fails here is told through `logging`, and noted with it.
        """
        with signals.undisturbed(ending=True):
            try:
                yield
            except Exception as failure:  # noqa: BLE001 - whatever it is, the error under way is more important
                text = f"{self._transport.name}: the torque may still be on: {failure}"
                _tell(text)
                error.add_note(text)

    def secure(self, servos: Sequence[J], error: BaseException) -> list[J]:
        """Make those servos safe after an error whose safe action was chosen; give the others."""
        chosen = [servo for servo in servos if servo.permit.safe_action]
        with signals.undisturbed(ending=True):
            for text in self._make_safe(None, chosen, interrupt=True):
                error.add_note(text)
        return [servo for servo in servos if not servo.permit.safe_action]

    # The end

    def end(self, *, safe: bool) -> list[str]:
        """Leave the servos: as they are, or made safe. Gives what could not be done."""
        told: list[str] = []
        if self._watchdog is not None and not safe:
            self._watchdog.stop()
        if safe:
            self._ending = True
            with signals.undisturbed(ending=True):
                told = self._make_safe(None, list(self._servos()), interrupt=True)
            if self._watchdog is not None:
                self._watchdog.stop()
        else:
            self._closed = True
        signals.closed(self)
        return told

    def after_reopen(self) -> None:
        """Do on a port that is open again what could not be done when the watchdog tripped."""
        self._open()
        if self._watchdog is not None and self._watchdog.tripped:
            self.make_safe(self._watchdog_action, interrupt=True)

    def _watchdog_tripped(self) -> None:
        self.make_safe(self._watchdog_action)

    def _watchdog_ended(self) -> None:
        self._watchdog = None


def crashed(error: BaseException | None) -> bool:
    """Tell whether a `with` block ended by accident: sys.exit(0) is none."""
    return error is not None and not (isinstance(error, SystemExit) and not error.code)


def _at_its_speed(servo: Joint, work: Procedure[StopOutcome]) -> Procedure[StopOutcome]:
    yield SetBaud(servo.target.baud)
    return (yield from work)


def _tell(text: str) -> None:
    import logging  # noqa: PLC0415 - slow to import, and seldom wanted

    logging.getLogger("servobus").error(text)
