"""Moves of one servo or several: planned, checked, started, and waited for."""

import math
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real

from servobus.core.exchange import Pause, Procedure
from servobus.core.units import deg, show
from servobus.core.values import frozen
from servobus.errors import BadValue, MoveTimeout, Stopped, TorqueOff, UsageError
from servobus.families.base import AxisMove, ServoRef

DEFAULT_SPEED = 90 * deg
"""Speed of a move that names neither time nor speed: brisk enough to see, gentle enough for a first try."""
SHORTEST = 0.02
"""Seconds that a move takes at least if its time follows from a speed: one to where it stands still is one too."""

LOOK = 0.02
"""s between two looks whether a servo has arrived."""
ATTENTION = 0.05
"""s between two words to the watch while it cannot have arrived yet: well within the time-out of most."""


@frozen
class PlannedMove:
    """A move of servos of one family: who goes where, and when all should be there."""

    axes: tuple[AxisMove, ...]
    without_torque: tuple[ServoRef, ...]
    """Servos whose torque was off when the move was planned."""

    @property
    def duration(self) -> float:
        """Seconds from start to arrival."""
        return max(axis.duration for axis in self.axes)


def plan(
    goals: Mapping[ServoRef, float], *, time: float | None = None, speed: float | None = None
) -> Procedure[PlannedMove]:
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
    distances: dict[ServoRef, float] = {}
    without_torque = []
    for target, goal in raw.items():
        motion_status = yield from family.motion_status(target)
        if motion_status.turning:
            raise UsageError(
                f"{target} turns without end; position_mode() or `servobus turn PORT {target.id} --end` ends that"
            )
        row = target.model.register("goal_position")
        if not motion_status.low <= goal <= motion_status.high:
            low, high = row.show(row.decode(motion_status.low)), row.show(row.decode(motion_status.high))
            raise BadValue(f"{target}: {row.show(row.decode(goal))} is outside the limits set in it, {low} .. {high}")
        notes = target.notes
        if not motion_status.torque or (notes is not None and notes.restarted):
            without_torque.append(target)
        distances[target] = abs(row.decode(goal) - motion_status.position)
        if notes is not None:
            notes.check_step(str(target), distances[target])
    if time is None:
        time = max(max(distances.values()) / (speed or DEFAULT_SPEED), SHORTEST)
    time /= min(target.notes.speed_factor if target.notes is not None else 1.0 for target in goals)
    longest = min((target.model.max_move_time for target in goals if target.model.max_move_time), default=None)
    if longest is not None and time > longest:
        raise BadValue(
            f"a {family.title} move takes {show(longest, 's')} at most, "
            f"this one would take {show(time, 's')}: go in steps, or faster"
        )
    axes = tuple(AxisMove(target, goal, distances[target], time) for target, goal in raw.items())
    for axis in axes:
        family.check_axis(axis)
    return PlannedMove(axes, tuple(without_torque))


def start_move(course: PlannedMove) -> Procedure[None]:
    """Start a move that was planned. Raises Stopped if one of its servos must not move now."""
    mark_moving(axis.target for axis in course.axes)
    yield from course.axes[0].target.model.family.start_moves(course.axes)


def mark_moving(targets: Iterable[ServoRef]) -> None:
    """Take note that these are set in motion or switched on now. Raises Stopped if one must not be."""
    for target in targets:
        if target.notes is not None:
            target.notes.mark_moving()


def keep_moving(targets: Iterable[ServoRef]) -> None:
    """Take note that these are given goals again and again. As `mark_moving`, but quick for those that move already.

    The targets are on one bus, so that one word to its watch is enough.
    """
    attended = False
    for target in targets:
        notes = target.notes
        if notes is None:
            continue
        if not notes.driven or notes.stopped or notes.inhibited:
            notes.mark_moving()
        elif not attended:
            keep_alive(target)
            attended = True


def require_torque(moves: Sequence[PlannedMove]) -> None:
    """Refuse a move that some servo would not follow. Raises TorqueOff."""
    without_torque = [str(target) for course in moves for target in course.without_torque]
    if without_torque:
        raise TorqueOff(f"{', '.join(without_torque)}: torque is off, so nothing would move; switch it on first")


def raw_goal(target: ServoRef, angle: float) -> int:
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


def wait_arrival(course: PlannedMove, *, timeout: float | None = None, tolerance: float = 3 * deg) -> Procedure[None]:
    """Wait until all servos of a move stand still near their goals.

    `timeout` is in seconds from now; the move's own duration and 2 s by default. Raises MoveTimeout, or Stopped as soon
    as one of them does not come any more: it was made safe, stopped, or its torque was switched off.
    """
    if timeout is not None and not timeout >= 0:
        raise BadValue(f"timeout {timeout} is not a number of seconds")
    left = course.duration + 2.0 if timeout is None else timeout
    begin = left - course.duration
    while left > max(begin, 0) and not any(_given_up(axis.target) for axis in course.axes):
        keep_alive(course.axes[0].target)
        pause = min(left - max(begin, 0), ATTENTION)
        yield Pause(pause, shared=True)
        left -= pause
    for axis in sorted(course.axes, key=lambda axis: not _given_up(axis.target)):
        row = axis.target.model.register("present_position")
        while True:
            keep_alive(axis.target)
            given_up = _given_up(axis.target)
            moving = yield from axis.target.model.family.moving(axis.target)
            (raw,) = yield from axis.target.model.family.read(axis.target, [row])
            if not moving and abs(row.decode(raw) - row.decode(axis.goal)) <= tolerance:
                break
            here, goal = row.show(row.decode(raw)), row.show(row.decode(axis.goal))
            if given_up:
                raise Stopped(
                    f"{axis.target} is at {here} and goes to {goal} no more: it was stopped or its torque switched off"
                )
            if left <= 0:
                raise MoveTimeout(f"{axis.target} is at {here} and did not reach {goal}")
            yield Pause(LOOK, shared=True)
            left -= LOOK


def keep_alive(target: ServoRef) -> None:
    """Say that somebody cares for a servo in motion, which feeds the watch. Raises Stopped if nothing is to move."""
    if target.notes is not None and target.notes.keep_alive is not None:
        target.notes.keep_alive()


def _given_up(target: ServoRef) -> bool:
    """Tell whether something has ended its motion since it was set going."""
    return target.notes is not None and (target.notes.stopped or not target.notes.driven)
