"""What counts as motion, and the rules that all of it obeys.

A servo moves if it is told a goal, and also by many another write: limits that are both 0, a zero that is shifted, a
torque limit that comes back. `Register.motion` says of each register how writing it can move the servo; `movement`
tells whether it does so now. Moves, writes, torque and restored settings all ask here.
"""

from collections.abc import Mapping
from typing import Any

from servobus.core.exchange import Procedure
from servobus.core.registers import Motion, Register
from servobus.core.values import frozen, replace
from servobus.errors import BadValue, OutsideLimits, Restarted, TorqueOff, UsageError
from servobus.families.target import KnownServo, ServoRef


@frozen
class TorqueState:
    """Whether a servo is driven, by all that decides it."""

    on: bool
    shutdown: str = ""
    """What keeps its torque off until `rearm`, whatever torque_enable says; "" if nothing does."""

    def __str__(self) -> str:
        if self.shutdown:
            return f"shut down ({self.shutdown}): `rearm`"
        return f"torque {'on' if self.on else 'off'}"


@frozen
class MotionStatus:
    """What must be known before a move: where the servo is and what holds it back."""

    position: float
    """rad"""
    torque: bool
    low: int
    high: int
    """The lowest and the highest goal that its limits allow it, raw; see `Family.reach`."""
    turning: bool
    """In wheel, motor, infinite turn or torque control mode, where a goal does not move it."""
    shutdown: str = ""
    """As in `TorqueState`."""
    shaft: float = 1.0
    """rad by which the shaft turns for 1 rad of its angles: more than 1 where the servo divides its resolution."""


@frozen
class Reach:
    """What the two position limits of a servo mean."""

    low: int
    high: int
    """The lowest and the highest goal that it takes, raw."""
    turning: bool = False
    """Whether it turns without end, so that no goal moves it."""


@frozen
class AxisMove:
    """One servo's part in a move."""

    target: KnownServo
    goal: int
    """Raw goal position."""
    distance: float
    """rad of the shaft, never negative"""
    duration: float
    """s, more than 0"""


def raw_position(target: ServoRef, status: MotionStatus) -> int:
    """Give where a servo is, in raw goal units; it may lie beyond what can be a goal."""
    raw: int = target.model.register("goal_position").scale.encode(status.position)
    return raw


def inside_limits(target: ServoRef, status: MotionStatus) -> bool:
    """Tell whether a servo stands where its limits allow it a goal."""
    return status.turning or status.low <= raw_position(target, status) <= status.high


def nearest(target: ServoRef, status: MotionStatus) -> int:
    """Give the raw goal nearest to where the servo is: the very place, if it is within its limits."""
    return min(max(raw_position(target, status), status.low), status.high)


def way_to(target: ServoRef, status: MotionStatus, goal: int) -> float:
    """Give how far the shaft turns, rad, from where a servo is to a raw goal."""
    way: float = abs(target.model.register("goal_position").decode(goal) - status.position) * status.shaft
    return way


def counts_turns(target: ServoRef, status: MotionStatus) -> bool:
    """Tell whether a servo is in multi-turn mode: its goals lie further than its limits can say."""
    return status.high > target.model.register("max_position").limits[1]


def no_torque(target: ServoRef, shutdown: str) -> TorqueOff:
    """Make the error for motion that a servo without torque would not follow."""
    if not shutdown:
        return TorqueOff(f"{target}: torque is off, so nothing would move; switch it on first")
    return TorqueOff(
        f"{target} has shut down ({shutdown}), so nothing would move; rearm() or `servobus rearm PORT {target.id}` "
        "brings its torque back when that is over"
    )


def check_torque(target: ServoRef, status: MotionStatus) -> None:
    """Raise TorqueOff if the servo has no torque, so that it would not move."""
    if not status.torque:
        raise no_torque(target, status.shutdown)


def turns(target: ServoRef) -> UsageError:
    """Make the error for a goal that a servo in endless turn would not follow."""
    return UsageError(
        f"{target} turns without end; position_mode() or `servobus turn PORT {target.id} --end` ends that"
    )


def show_limits(target: ServoRef, status: MotionStatus) -> str:
    row = target.model.register("goal_position")
    return f"{row.show(row.decode(status.low))} .. {row.show(row.decode(status.high))}"


def check_goal(target: KnownServo, status: MotionStatus, goal: int, *, step: bool = True) -> float:
    """Give the way to a raw goal, rad of the shaft. Raises UsageError or BadValue if the servo must not go there.

    `step` is whether `max_step` is to be heeded: without it the position may be an old one.
    """
    row = target.model.register("goal_position")
    if status.turning:
        raise turns(target)
    if not status.low <= goal <= status.high:
        shown = row.show(row.decode(goal))
        raise BadValue(f"{target}: {shown} is outside the limits set in it, {show_limits(target, status)}")
    distance = way_to(target, status, goal)
    if step:
        target.permit.check_step(str(target), distance)
    return distance


def check_hold(target: ServoRef, status: MotionStatus) -> None:
    """Raise TorqueOff if the servo keeps its torque off, OutsideLimits if it would move when the torque comes on."""
    if status.shutdown:
        raise no_torque(target, status.shutdown)
    if not status.torque:
        check_inside(target, status)


def check_inside(target: ServoRef, status: MotionStatus, *, whose: str = "set in it") -> None:
    """Raise OutsideLimits if the servo, with torque, would run to the nearest of these limits."""
    if target.model.family.holds_outside_limits or inside_limits(target, status):
        return
    row = target.model.register("goal_position")
    here, there = row.show(status.position), row.show(row.decode(nearest(target, status)))
    raise OutsideLimits(
        f"{target} is at {here}, outside the limits {whose}, {show_limits(target, status)}, and with torque it would "
        f"run to {there} at once; from torque off, torque_on(to_limit=True) or `servobus torque PORT {target.id} on "
        "--to-limit` brings it there slowly"
    )


def begin_motion(target: KnownServo) -> None:
    """Take note that a servo is set in motion now, the last thing before it is. Raises Stopped or Restarted."""
    check_awake(target)
    target.permit.mark_moving()


def check_awake(target: KnownServo) -> None:
    """Raise Restarted if the servo has lost its RAM since it was set up."""
    if target.record.restarted:
        raise Restarted(f"{target} has restarted, and is not moved before torque_on() or rearm()")


def about_to_turn(target: KnownServo) -> Procedure[MotionStatus]:
    """Make sure that the servo would turn, and take note that it does. Raises TorqueOff, Stopped or Restarted."""
    target.permit.ask()
    check_awake(target)
    status = yield from target.model.family.motion_status(target)
    check_torque(target, status)
    begin_motion(target)
    return status


ASKED_FOR = {Motion.GOAL, Motion.SPEED, Motion.MODE}
"""Writes that are commands of motion; others may move the servo beside what they set."""


def movement(target: KnownServo, values: Mapping[Register[Any], int]) -> Procedure[float | None]:
    """Tell how far writing these raw values moves the servo, in rad; 0 if it is set going, None if nothing moves.

    It is told by the state of the servo, which is read if one of these registers can move any. Raises what a move
    raises: TorqueOff, or UsageError and BadValue, also for what would move it in another way than was asked.
    """
    rows = {row.motion: row for row in values if row.motion is not None}
    if not rows:
        return None
    if not rows.keys().isdisjoint(ASKED_FOR):
        target.permit.ask()
    status = yield from target.model.family.motion_status(target)
    after = _limits_after(target, status, values)
    if Motion.LIMIT in rows:
        yield from _check_new_limits(target, status, after)
    if Motion.MODE in rows:
        after = replace(after, turning=bool(values[rows[Motion.MODE]]))
        if status.turning and not after.turning and status.torque:
            raise turns(target)
    ways = []
    for row, raw in values.items():
        way = yield from _way(target, status, after, row, raw)
        if way is not None:
            ways.append(way)
    return max(ways) if ways else None


def _limits_after(target: ServoRef, status: MotionStatus, values: Mapping[Register[Any], int]) -> MotionStatus:
    """Give the state that the servo would be in with the limits among these values."""
    model = target.model
    low, high = model.register("min_position"), model.register("max_position")
    if low not in values and high not in values:
        return status
    old = status.low, status.high
    if counts_turns(target, status):
        old = model.family.multi_turn_limits(model) or old
    new = values.get(low, old[0]), values.get(high, old[1])
    if new == old:
        return status
    before, after = (model.family.reach(model, *limits) for limits in (old, new))
    # A mode of its own makes it turn whatever the limits are.
    turning = after.turning or (status.turning and not before.turning)
    return replace(status, low=after.low, high=after.high, turning=turning)


def _check_new_limits(target: ServoRef, status: MotionStatus, after: MotionStatus) -> Procedure[None]:
    """Refuse limits that would move a servo with torque. Raises UsageError."""
    if not status.torque or after is status:
        return
    if after.turning != status.turning:
        instead = (
            "turn() or `servobus turn` begins" if after.turning else "position_mode() or `servobus turn --end` ends"
        )
        raise UsageError(f"{target} has torque, and these limits would move it; {instead} endless turn")
    if counts_turns(target, after) != counts_turns(target, status):
        raise UsageError(
            f"{target} has torque, and may move as its angles are counted otherwise with these limits; position_mode() "
            f"or `servobus turn` changes between one turn and several, as does a write with the torque off"
        )
    if not inside_limits(target, after):
        row = target.model.register("goal_position")
        raise UsageError(
            f"{target} holds {row.show(status.position)}, outside the limits that it would get, "
            f"{show_limits(target, after)}, and may run there; move it inside first, or switch its torque off"
        )
    if not status.turning and (yield from target.model.family.moving(target)):
        raise UsageError(f"{target} is moving, perhaps beyond the limits that it would get; stop it or wait first")


def _way(
    target: KnownServo, status: MotionStatus, after: MotionStatus, row: Register[Any], raw: int
) -> Procedure[float | None]:
    """Tell how far writing one register moves the servo; see `movement`."""
    match row.motion:
        case Motion.GOAL:
            check_awake(target)
            check_torque(target, status)
            return check_goal(target, after, raw)
        case Motion.SPEED | Motion.MODE if raw and after.turning:
            check_awake(target)
            check_torque(target, status)
            return 0.0
        case Motion.ZERO if status.torque and not status.turning:
            (old,) = yield from target.model.family.read(target, [row])
            if raw == old:
                return None
            if row.unit != "rad":
                raise UsageError(f"{target} has torque, and may turn by a new {row.name}; switch its torque off first")
            way: float = abs(row.decode(raw) - row.decode(old))
            target.permit.check_step(str(target), way)
            return way
        case Motion.STRENGTH if raw and status.shutdown:
            raise no_torque(target, status.shutdown)
        case Motion.OUTPUT if raw and status.torque and not status.turning:
            return 0.0
    return None
