"""Jobs on several servos of one bus: each servo has its turn, though others fail."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from servobus.bus.by_servo import ByServo, Readings
from servobus.bus.servo import Servo
from servobus.core.exchange import Batch, Exchange, Procedure, SetBaud
from servobus.errors import BusError, MotionError, ServobusError, StopFailed, Stopped, UnknownName, UsageError
from servobus.families.base import StopOutcome
from servobus.jobs.make_safe import let_go, stop_all
from servobus.jobs.make_safe import stop as stop_one

S = TypeVar("S", bound=Servo)


def each(servos: Iterable[S], job: Callable[[S], Procedure[None]]) -> Procedure[None]:
    """Do the same with each servo, though it fails with others; then raise the first failure.

    Stopped is raised at once.
    """
    first: BusError | MotionError | None = None
    for servo in servos:
        yield SetBaud(servo.baud)
        try:
            yield from job(servo)
        except Stopped:
            raise
        except (BusError, MotionError) as error:
            first = first or error
    if first is not None:
        raise first


def by_kind(servos: Iterable[S]) -> list[list[S]]:
    """Sort servos by family and speed: one packet reaches servos of one kind."""
    groups: dict[tuple[str, int], list[S]] = {}
    for servo in servos:
        groups.setdefault((servo.family.name, servo.baud), []).append(servo)
    return list(groups.values())


def read(servos: Iterable[S], name: str) -> Procedure[Readings[S, Any]]:
    """Read the register of this name of each servo; see `BaseBus.read_all`."""
    rows = {servo: servo.model.register(name) for servo in servos}
    seen: dict[S, Any] = {}
    for group in by_kind(rows):
        questions: dict[S, Exchange[Any]] = {}
        for servo in group:
            try:
                questions[servo] = servo.family.question(servo.target, rows[servo])
            except UsageError as error:
                seen[servo] = error
        yield SetBaud(group[0].baud)
        seen.update(zip(questions, (yield Batch(list(questions.values()))), strict=True))
    values = {servo: seen[servo] for servo in rows if not isinstance(seen[servo], ServobusError)}
    lost = {servo: seen[servo] for servo in rows if servo not in values}
    if lost and not values:
        raise next(iter(lost.values()))
    return Readings(values, lost)


def take_hold(servos: Iterable[S], taken: list[S]) -> Procedure[None]:
    """Switch the torque of servos on; those that had it off, and may have it on now, are put into `taken`.

    A servo that is refused before anything is told to it is not among those. The first failure ends it.
    """
    for servo in servos:
        yield SetBaud(servo.baud)
        had_torque = (yield from servo.family.read_torque(servo.target)).on
        try:
            yield from servo.family.torque(servo.target, on=True)
        finally:
            if servo.permit.driven and not had_torque:
                taken.append(servo)


def leave(servos: Iterable[S], taken: Sequence[S]) -> Procedure[None]:
    """Let go of the servos that were taken, and stop the others that are driven. Raises StopFailed."""
    failures: dict[S, Exception] = {}
    for servo in servos:
        yield SetBaud(servo.baud)
        try:
            if servo in taken:
                yield from let_go(servo.target)
            elif servo.permit.driven:
                yield from stop_one(servo.target)
        except BusError as error:
            failures[servo] = error
    if failures:
        raise _stop_failed(failures, {})


def stop(known: Collection[S], servos: Iterable[S | int] | S | int) -> Procedure[ByServo[S, StopOutcome]]:
    """Stop those of the known servos that are meant; see `BaseBus.stop`. Raises StopFailed."""
    wanted: dict[S, None] = {}
    failures: dict[Any, Exception] = {}
    for key in servos if isinstance(servos, Iterable) else (servos,):
        meant = [servo for servo in known if servo is key or servo.id == key]
        wanted |= dict.fromkeys(meant)
        if not meant:
            failures[key] = UnknownName("no servo with this id is known here, so none was stopped")
    outcomes = yield from stop_all([servo.target for servo in wanted])
    done: dict[S, StopOutcome] = {}
    for servo, outcome in zip(wanted, outcomes.values(), strict=True):
        if isinstance(outcome, StopOutcome):
            done[servo] = outcome
        else:
            failures[servo] = outcome
    if failures:
        raise _stop_failed(failures, ByServo(done))
    return ByServo(done)


def _stop_failed(failures: Mapping[Any, Exception], stopped: Mapping[Any, StopOutcome]) -> StopFailed:
    """Give the error for servos, or ids that no known servo has, that may still move."""
    names = {key: str(key.target) if isinstance(key, Servo) else f"id {key}" for key in failures}
    said = "; ".join(f"{names[key]} may still move: {why}" for key, why in failures.items())
    return StopFailed(said, failures, stopped)
