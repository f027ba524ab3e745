"""Moves of one servo or several: planned, checked, started, and waited for."""

import math
from collections.abc import Iterable, Mapping
from numbers import Real

from servobus.core.arguments import check_above_0
from servobus.core.exchange import Now, Pause, Procedure, SetBaud
from servobus.core.units import deg, finite, said, show
from servobus.core.values import frozen
from servobus.errors import BadValue, MoveTimeout, Stopped, TorqueOff, UsageError
from servobus.families.base import AxisMove, KnownServo, MotionStatus, ServoRef, require_model

DEFAULT_SPEED = 90 * deg
"""Speed of a move that names neither time nor speed: brisk enough to see, gentle enough for a first try."""
SHORTEST = 0.02
"""Seconds that a move takes at least if its time follows from a speed: one to where it stands still is one too."""

LOOK = 0.02
"""s between two looks whether a servo has arrived."""
ATTENTION = 0.05
"""s between two words to the watchdog while it cannot have arrived yet: well within the time-out of most."""


@frozen
class PlannedMove:
    """A move of several servos: the goal of each, and when all should be there."""

    axes: tuple[AxisMove, ...]
    without_torque: tuple[KnownServo, ...]
    """Servos whose torque was off when the move was planned."""

    @property
    def duration(self) -> float:
        """Seconds from start to arrival, the same for all."""
        return max(axis.duration for axis in self.axes)


def plan(
    goals: Mapping[KnownServo, float], *, time: float | None = None, speed: float | None = None
) -> Procedure[PlannedMove]:
    """Check a move of one servo or several that start together and arrive together; nothing moves yet.

    goals   servo -> angle in rad, servos of any families, at any speeds
    time    seconds the move takes, or
    speed   rad/s of the servo that has the longest way; DEFAULT_SPEED if neither is given

    Raises BadValue for an angle, time or speed that cannot be, or for a step beyond `max_step`; UsageError for a servo
    in endless turn.
    """
    if not goals:
        raise UsageError("a move of no servos: give at least one goal")
    if time is not None and speed is not None:
        raise BadValue("a move takes either a time or a speed, not both")
    for name, value in (("time", time), ("speed", speed)):
        if value is not None:
            check_above_0(name, value)

    raw = {target: raw_goal(target, angle) for target, angle in goals.items()}
    distances: dict[KnownServo, float] = {}
    without_torque = []
    for target in _by_kind(raw):
        motion_status = yield from _checked(target, raw[target])
        if not motion_status.torque or target.record.restarted:
            without_torque.append(target)
        row = target.model.register("goal_position")
        distances[target] = abs(row.decode(raw[target]) - motion_status.position)
        target.permit.check_step(str(target), distances[target])
    if time is None:
        time = max(max(distances.values()) / (speed or DEFAULT_SPEED), SHORTEST)
    time /= min(target.permit.speed_factor for target in goals)
    for target in goals:
        longest = target.model.max_move_time
        if longest is not None and time > longest:
            raise BadValue(
                f"a {target.model.family.title} move takes {show(longest, 's')} at most, "
                f"this one would take {show(time, 's')}: go in steps, or faster"
            )
    axes = tuple(AxisMove(target, goal, distances[target], time) for target, goal in raw.items())
    for axis in axes:
        axis.target.model.family.check_axis(axis)
    return PlannedMove(axes, tuple(target for target in raw if target in without_torque))


def _by_kind(targets: Iterable[KnownServo]) -> list[KnownServo]:
    """Bring servos into an order in which the speed of the port changes seldom: a change may cost 0.2 s."""
    kinds: dict[tuple[str, int], list[KnownServo]] = {}
    for target in targets:
        kinds.setdefault((target.model.family.name, target.baud), []).append(target)
    return [target for kind in kinds.values() for target in kind]


def _checked(target: KnownServo, goal: int) -> Procedure[MotionStatus]:
    """Read where a servo is. Raises UsageError or BadValue if it would not follow this raw goal."""
    yield SetBaud(target.baud)
    motion_status = yield from target.model.family.motion_status(target)
    if motion_status.turning:
        raise UsageError(
            f"{target} turns without end; position_mode() or `servobus turn PORT {target.id} --end` ends that"
        )
    row = target.model.register("goal_position")
    if not motion_status.low <= goal <= motion_status.high:
        low, high = row.said(motion_status.low), row.said(motion_status.high)
        raise BadValue(f"{target}: {row.said(goal)} is outside the limits set in it, {low} .. {high}")
    return motion_status


def start_move(move: PlannedMove) -> Procedure[None]:
    """Start a move that was planned, each family with as few packets as it allows, one family right after the other.

    Raises Stopped, before anything moves, if one of its servos must not move now.
    """
    for axis in move.axes:
        axis.target.permit.mark_moving()
    kinds: dict[tuple[str, int], list[AxisMove]] = {}
    for axis in move.axes:
        kinds.setdefault((axis.target.model.family.name, axis.target.baud), []).append(axis)
    for axes in kinds.values():
        yield SetBaud(axes[0].target.baud)
        yield from axes[0].target.model.family.start_moves(axes)


def keep_moving(targets: Iterable[KnownServo]) -> None:
    """Take note that these are given goals again and again. As `mark_moving`, but quick for those that move already.

    They are on one bus, so that one word to its watchdog is enough.
    """
    attended = False
    for target in targets:
        permit = target.permit
        if permit.given_up or permit.inhibited:
            permit.mark_moving()
        elif not attended:
            permit.attend()
            attended = True


def require_torque(move: PlannedMove) -> None:
    """Refuse a move that some servo would not follow. Raises TorqueOff."""
    if move.without_torque:
        limp = ", ".join(map(str, move.without_torque))
        raise TorqueOff(f"{limp}: torque is off, so nothing would move; switch it on first")


def raw_goal(target: ServoRef, angle: float) -> int:
    """Turn an angle into a raw goal the model can take. Raises BadValue, UsageError if the model is not known."""
    require_model(target, "be moved to an angle")
    given: object = angle
    if not isinstance(given, Real):
        raise BadValue(f"{target}: {said(angle)} is not a number; an angle is in radians, such as 90 * deg")
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


def wait_arrival(move: PlannedMove, *, timeout: float | None = None, tolerance: float = 3 * deg) -> Procedure[None]:
    """Wait until all servos of a move stand still near their goals.

    `timeout` is in seconds from now, by the port's clock; the move's own duration and 2 s by default. Raises
    MoveTimeout when it is over, after one last look at most, or Stopped as soon as one of them does not come any more:
    it was made safe, stopped, or its torque was switched off.
    """
    if timeout is not None and ((seconds := finite(timeout)) is None or seconds < 0):
        raise BadValue(f"timeout {said(timeout)} is not a number of seconds")
    began = yield Now()
    end = began + (move.duration + 2.0 if timeout is None else timeout)
    arrival = min(began + move.duration, end)
    while not any(axis.target.permit.given_up for axis in move.axes) and (left := arrival - (yield Now())) > 0:
        move.axes[0].target.permit.attend()
        yield Pause(min(left, ATTENTION), shared=True)
    # One that does not come any more is looked at first, so that Stopped is raised at once.
    for axis in sorted(move.axes, key=lambda axis: not axis.target.permit.given_up):
        yield from _wait_axis(axis, end, tolerance)


def _wait_axis(axis: AxisMove, end: float, tolerance: float) -> Procedure[None]:
    """Look at one servo again and again until it has arrived, or until this time."""
    target = axis.target
    row = target.model.register("present_position")
    while True:
        target.permit.attend()
        given_up = target.permit.given_up
        yield SetBaud(target.baud)
        moving = yield from target.model.family.moving(target)
        (raw,) = yield from target.model.family.read(target, [row])
        if not moving and abs(row.decode(raw) - row.decode(axis.goal)) <= tolerance:
            return
        here, goal = row.said(raw), row.said(axis.goal)
        if given_up:
            raise Stopped(
                f"{target} is at {here} and goes to {goal} no more: it was stopped or its torque switched off"
            )
        if (left := end - (yield Now())) <= 0:
            raise MoveTimeout(f"{target} is at {here} and did not reach {goal}")
        yield Pause(min(left, LOOK), shared=True)
