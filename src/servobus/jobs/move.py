"""Moves of one servo or several: planned, checked, started, and waited for."""

import math
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real

from servobus.core.exchange import Pause, Procedure, ask
from servobus.core.units import deg, show
from servobus.core.values import frozen
from servobus.errors import BadValue, MoveTimeout, Stopped, TorqueOff, UsageError
from servobus.families.base import Leg, Target

DEFAULT_SPEED = 90 * deg
"""Speed of a move that names neither time nor speed: brisk enough to see, gentle enough for a first try."""
SHORTEST = 0.02
"""Seconds that a move takes at least if its time follows from a speed: one to where it stands still is one too."""

LOOK = 0.02
"""s between two looks whether a servo has arrived."""
ATTENTION = 0.05
"""s between two words to the watch while it cannot have arrived yet: well within the time-out of most."""


@frozen
class Course:
    """A move of servos of one family: who goes where, and when all should be there."""

    legs: tuple[Leg, ...]
    loose: tuple[Target, ...]
    """Servos whose torque was off when the move was planned."""

    @property
    def duration(self) -> float:
        """Seconds from start to arrival."""
        return max(leg.duration for leg in self.legs)


def plan(goals: Mapping[Target, float], *, time: float | None = None, speed: float | None = None) -> Procedure[Course]:
    """Check a move of one servo or several that start together and arrive together; nothing moves yet.

    goals   target -> angle in rad, targets of one family
    time    seconds the move takes, or
    speed   rad/s of the servo that has the longest way; DEFAULT_SPEED if neither is given

    Raises BadValue for an angle, time or speed that cannot be, or for a step beyond `max_step`; UsageError for a servo
    in endless turn.
    """
    if time is not None and speed is not None:
        raise BadValue("a move takes either a time or a speed, not both")
    for name, value in (("time", time), ("speed", speed)):
        if value is not None and not (_is_number(value) and 0 < value < math.inf):
            raise BadValue(f"{name} {value!r} is not a number above 0")
    families = {target.model.family.name for target in goals}
    if len(families) != 1:
        raise UsageError(f"one move drives servos of one family, not {' and '.join(sorted(families)) or 'none'}")

    raw = {target: raw_goal(target, angle) for target, angle in goals.items()}
    family = next(iter(goals)).model.family
    distances: dict[Target, float] = {}
    loose = []
    for target, goal in raw.items():
        stance = yield from family.stance(target)
        if stance.turning:
            raise UsageError(
                f"{target} turns without end; position_mode() or `servobus turn PORT {target.id} --end` ends that"
            )
        row = target.model.register("goal_position")
        if not stance.low <= goal <= stance.high:
            low, high = row.show(row.decode(stance.low)), row.show(row.decode(stance.high))
            raise BadValue(f"{target}: {row.show(row.decode(goal))} is outside the limits set in it, {low} .. {high}")
        notes = target.notes
        if not stance.torque or (notes is not None and notes.restarted):
            loose.append(target)
        distances[target] = abs(row.decode(goal) - stance.position)
        if notes is not None:
            notes.check_step(str(target), distances[target])
    if time is None:
        time = max(max(distances.values()) / (speed or DEFAULT_SPEED), SHORTEST)
    time /= min(target.notes.slow if target.notes is not None else 1.0 for target in goals)
    if family.max_move_time is not None and time > family.max_move_time:
        raise BadValue(
            f"a {family.title} move takes {show(family.max_move_time, 's')} at most, "
            f"this one would take {show(time, 's')}: go in steps, or faster"
        )
    legs = tuple(Leg(target, goal, distances[target], time) for target, goal in raw.items())
    for leg in legs:
        family.check_leg(leg)
    return Course(legs, tuple(loose))


def launch(course: Course) -> Procedure[None]:
    """Start a move that was planned. Raises Stopped if one of its servos must not move now."""
    set_going(leg.target for leg in course.legs)
    yield from course.legs[0].target.model.family.launch(course.legs)


def set_going(targets: Iterable[Target]) -> None:
    """Take note that these are set in motion or switched on now. Raises Stopped if one must not be."""
    for target in targets:
        if target.notes is not None:
            target.notes.go()


def keep_going(targets: Iterable[Target]) -> None:
    """Take note that these are given goals again and again. As `set_going`, but quick for those that move already.

    The targets are on one bus, so that one word to its watch is enough.
    """
    attended = False
    for target in targets:
        notes = target.notes
        if notes is None:
            continue
        if not notes.driven or notes.held or notes.halted:
            notes.go()
        elif not attended:
            attend(target)
            attended = True


def require_torque(courses: Sequence[Course]) -> None:
    """Refuse a move that some servo would not follow. Raises TorqueOff."""
    loose = [str(target) for course in courses for target in course.loose]
    if loose:
        raise TorqueOff(f"{', '.join(loose)}: torque is off, so nothing would move; switch it on first")


def raw_goal(target: Target, angle: float) -> int:
    """Turn an angle into a raw goal the model can take. Raises BadValue."""
    if not _is_number(angle):
        raise BadValue(f"{target}: {angle!r} is not a number; an angle is in radians, such as 90 * deg")
    row = target.model.register("goal_position")
    try:
        raw = row.scale.encode(angle)
    except ValueError as error:
        raise BadValue(f"{target}: {error}") from None
    if not row.accepts(raw):
        # People give degrees as whole numbers. What was degrees once, as on the command line, is none in radians.
        forgotten = (
            abs(angle) > 2 * math.pi and float(angle).is_integer() and row.accepts(row.scale.encode(angle * deg))
        )
        hint = f" (angles are in radians: did you mean {angle:g} * deg?)" if forgotten else ""
        low, high = (row.show(row.decode(limit)) for limit in row.limits)
        raise BadValue(f"{target}: {row.show(angle)} is outside {low} .. {high}{hint}")
    return raw


def _is_number(value: object) -> bool:
    """Tell whether a value, of a caller without type checks, can be reckoned with."""
    return isinstance(value, Real)


def arrive(course: Course, *, timeout: float | None = None, tolerance: float = 3 * deg) -> Procedure[None]:
    """Wait until all servos of a move stand still near their goals.

    `timeout` is in seconds from now; the move's own duration and 2 s by default. Raises MoveTimeout, or Stopped as soon
    as one of them does not come any more: it was made safe, stopped, or its torque was switched off.
    """
    if timeout is not None and not timeout >= 0:
        raise BadValue(f"timeout {timeout} is not a number of seconds")
    left = course.duration + 2.0 if timeout is None else timeout
    begin = left - course.duration
    while left > max(begin, 0) and not any(_given_up(leg.target) for leg in course.legs):
        attend(course.legs[0].target)
        pause = min(left - max(begin, 0), ATTENTION)
        yield Pause(pause, shared=True)
        left -= pause
    for leg in sorted(course.legs, key=lambda leg: not _given_up(leg.target)):
        row = leg.target.model.register("present_position")
        while True:
            attend(leg.target)
            given_up = _given_up(leg.target)
            moving = yield from leg.target.model.family.moving(leg.target)
            (raw,) = yield from ask(leg.target.model.family.read(leg.target, [row]))
            if not moving and abs(row.decode(raw) - row.decode(leg.goal)) <= tolerance:
                break
            here, goal = row.show(row.decode(raw)), row.show(row.decode(leg.goal))
            if given_up:
                raise Stopped(
                    f"{leg.target} is at {here} and goes to {goal} no more: it was stopped or its torque switched off"
                )
            if left <= 0:
                raise MoveTimeout(f"{leg.target} is at {here} and did not reach {goal}")
            yield Pause(LOOK, shared=True)
            left -= LOOK


def attend(target: Target) -> None:
    """Say that somebody cares for a servo in motion, which feeds the watch. Raises Stopped if nothing is to move."""
    if target.notes is not None and target.notes.attend is not None:
        target.notes.attend()


def _given_up(target: Target) -> bool:
    """Tell whether something has ended its motion since it was set going."""
    return target.notes is not None and (target.notes.held or not target.notes.driven)
