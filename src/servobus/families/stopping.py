"""How a servo is stopped: it is held where it is, or else its torque is switched off, until that is known.

Nothing here asks for the permit to move: a stop is always allowed.
"""

from servobus.core.exchange import Pause, Procedure, told
from servobus.core.units import deg
from servobus.core.values import frozen
from servobus.errors import BusError
from servobus.families.motion import MotionStatus, nearest, raw_position, show_limits
from servobus.families.target import Answers, KnownServo, ServoRef

TRIES = 3
"""Times that a servo is told to stop, or to let go, before something else is done about it."""
ANSWERED = 0.005
"""s in which a servo has answered what was only told; assumption, at 57600 baud and more."""
SLACK = 2 * deg
"""Way to the nearer limit that a stop may make a servo go; assumption: about what a loaded shaft gives way."""


@frozen
class StopOutcome:
    """What a stop did with a servo."""

    text: str
    """In words: "held at 201.5°", "let go: ..."."""
    let_go: bool = False
    """Whether its torque is off now, so that its shaft turns freely."""

    def __str__(self) -> str:
        return self.text


LIMP = StopOutcome("it drives nothing: its torque was off", let_go=True)
TURNS_NO_MORE = StopOutcome("it turns no more")


def stop(target: KnownServo) -> Procedure[StopOutcome]:
    """Hold a servo where it is; switch its torque off where that fails. See `Family.stop`."""
    family = target.model.family
    try:
        return (yield from family.hold(target))
    except (BusError, ValueError) as error:
        why = str(error)
    yield from family.let_go(target)
    return StopOutcome(f"let go, its torque is off: it could not be held ({why})", let_go=True)


def let_go(target: KnownServo) -> Procedure[None]:
    """Switch the torque off, again and again until it is known to be off. See `Family.let_go`."""
    family, torque = target.model.family, target.model.register("torque_enable")
    target.record.forget([torque])
    error: BusError | None = None
    for attempt in range(TRIES):
        try:
            if attempt == 0:
                yield from family.put(target, {torque: 0}, keep=False)
                if target.answers_writes:
                    break
            else:
                # What is answered waits for a quiet line, and for old answers; what is only told does not.
                yield from told(family.put(target, {torque: 0}, keep=False))
                yield Pause(ANSWERED)
            if target.answers is not Answers.NOTHING:
                (raw,) = yield from family.read(target, [torque])
                if not family.torque_on(raw):
                    break
                error = BusError(f"{target}: its torque is still on")
        except BusError as trouble:
            error = trouble
    else:
        if target.answers is Answers.NOTHING:
            yield from family.ping(target.id)
        elif error is not None:
            raise error
    target.record.set({torque: 0})


def reachable(target: ServoRef, status: MotionStatus) -> int | None:
    """Give the raw goal that holds a servo where it is.

    Outside its limits that is the nearer limit; None if that is farther off than SLACK, for it would move.
    """
    row = target.model.register("goal_position")
    goal = nearest(target, status)
    return goal if abs(row.decode(goal) - row.decode(raw_position(target, status))) <= SLACK else None


def let_go_outside(target: KnownServo, status: MotionStatus) -> Procedure[StopOutcome]:
    """Let go of a servo that cannot be held because it stands outside its limits; see `reachable`."""
    yield from target.model.family.let_go(target)
    where, limits = target.model.register("goal_position").show(status.position), show_limits(target, status)
    return StopOutcome(f"let go, its torque is off: it stood at {where}, outside its limits {limits}", let_go=True)
