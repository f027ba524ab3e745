"""Moves of one servo or several: planned, checked, started, and waited for."""

import math
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import NoReturn

from servobus.core.arguments import check_above_0
from servobus.core.exchange import Now, Pause, Procedure, SetBaud
from servobus.core.units import deg, finite, said, show
from servobus.errors import BadValue, BusError, MoveTimeout, ServobusError, Stopped, TorqueOff, UsageError
from servobus.families.base import AxisMove, KnownServo, ServoRef, require_model
from servobus.families.motion import check_goal, inside_limits, no_torque, raw_position
from servobus.families.record import MotionPermit
from servobus.jobs.make_safe import give_back, stop, stop_all

DEFAULT_SPEED = 90 * deg
"""Speed of a move that names neither time nor speed: brisk enough to see, gentle enough for a first try. It is exceeded
where a servo cannot be told as long a time as that takes."""
GRACE = 2.0
"""s after which a servo that should have arrived and has not counts as one that does not arrive."""
SHORTEST = 0.02
"""Seconds that a move takes at least if its time follows from a speed: one to where it stands still is one too."""
QUICKEST = 1e-6
"""s that a move takes at least, whatever is asked: a servo goes as fast as it can then, and its speed is a number."""

LOOK = 0.02
"""s between two looks whether a servo has arrived."""
ATTENTION = 0.05
"""s between two words to the watchdog while it cannot have arrived yet: well within the time-out of most."""


class Wording:
    """What servos and their angles are called in the errors of a move; a robot speaks of its joints instead."""

    def name(self, target: KnownServo) -> str:
        """Call a servo by a name."""
        return str(target)

    def angle(self, target: KnownServo, angle: float) -> str:
        """Write an angle of a servo, rad."""
        return target.model.register("goal_position").show(angle)

    def tell(self, target: KnownServo, error: ServobusError) -> None:
        """Say in an error which servo it came of; packets name the id of theirs."""


class PlannedMove:
    """A move of several servos, and how far it has come once it has started.

    axes            the whole way of each servo
    without_torque  servos whose torque was off when the move was planned
    legs            what is sent one after the other: a way that takes longer than the servo can be told has several
    began           when it started, by the clock of the port; None before that
    over            whether it has ended: all have arrived, or it was cancelled, or it failed
    """

    def __init__(
        self,
        axes: Sequence[AxisMove],
        without_torque: Sequence[KnownServo] = (),
        *,
        starts: Sequence[int],
        wording: Wording | None = None,
    ) -> None:
        """Plan a way for each servo; `starts` are the raw positions of the servos now."""
        self.axes, self.without_torque = tuple(axes), tuple(without_torque)
        self._starts = tuple(starts)
        self.wording = wording or Wording()
        self.legs = _legs(self.axes, starts)
        self.began: float | None = None
        self.sent = 0
        """Legs that are under way or done."""
        self.due = self.arrival = math.inf
        """When the next leg starts, and when all should be there."""
        self.over = False

    @property
    def duration(self) -> float:
        """Seconds from start to arrival, the same for all."""
        return max(axis.duration for axis in self.axes)

    def within(self, time: float) -> "PlannedMove":
        """Plan the same ways for another time, s; servos that are slowed down take longer. Raises BadValue."""
        axes = [
            AxisMove(axis.target, axis.goal, axis.distance, time / axis.target.permit.speed_factor)
            for axis in self.axes
        ]
        for axis in axes:
            axis.target.model.family.check_axis(axis)
        return PlannedMove(axes, self.without_torque, starts=self._starts, wording=self.wording)

    @property
    def given_up(self) -> bool:
        """Whether the motion of one of the servos was ended by something else."""
        return any(axis.target.permit.given_up for axis in self.axes)

    def __str__(self) -> str:
        ways = []
        for axis in self.axes:
            row = axis.target.model.register("goal_position")
            ways.append(f"{axis.target} to {row.show(row.decode(axis.goal))}")
        return f"{', '.join(ways)} in {show(self.duration, 's')}"


def _legs(axes: Sequence[AxisMove], starts: Sequence[int]) -> list[tuple[AxisMove, ...]]:
    """Cut the ways that take longer than their servos can be told into legs of the same time."""
    longest = min(_longest(axis.target) for axis in axes)
    duration = max(axis.duration for axis in axes)
    count = max(1, math.ceil(duration / longest - 1e-9))
    legs: list[list[AxisMove]] = [[] for _ in range(count)]
    for axis, start in zip(axes, starts, strict=True):
        if axis.duration <= _longest(axis.target):
            legs[0].append(axis)
            continue
        for n, leg in enumerate(legs, 1):
            goal = start + round((axis.goal - start) * n / count)
            leg.append(AxisMove(axis.target, goal, axis.distance / count, axis.duration / count))
    return [tuple(leg) for leg in legs]


def _longest(target: KnownServo) -> float:
    longest = target.model.max_move_time
    return math.inf if longest is None else longest


def plan(
    goals: Mapping[KnownServo, float],
    *,
    time: float | None = None,
    speed: float | None = None,
    wording: Wording | None = None,
) -> Procedure[PlannedMove]:
    """Check a move of one servo or several that start together and arrive together; nothing moves yet.

    goals   servo -> angle in rad, servos of any families, at any speeds
    time    seconds the move takes, or
    speed   rad/s of the servo that has the longest way; DEFAULT_SPEED if neither is given
    wording what servos are called in errors

    A way that takes longer than a servo can be told at once is made in legs, which whoever waits sends.

    Raises BadValue for an angle, time or speed that cannot be, or for a step beyond `max_step`; UsageError for a servo
    in endless turn; TorqueOff for one that has shut down.
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
    starts: dict[KnownServo, int] = {}
    without_torque = []
    wording = wording or Wording()
    for target in _by_kind(raw):
        yield SetBaud(target.baud)
        try:
            motion_status = yield from target.model.family.motion_status(target)
            if motion_status.shutdown:
                raise no_torque(target, motion_status.shutdown)
            if not motion_status.torque or target.record.restarted:
                without_torque.append(target)
            distances[target] = check_goal(target, motion_status, raw[target])
            starts[target] = raw_position(target, motion_status)
        except ServobusError as error:
            wording.tell(target, error)
            raise
    slowed = min(target.permit.speed_factor for target in goals)
    if time is None:
        time = max(max(distances.values()) / (speed or DEFAULT_SPEED), SHORTEST)
        if speed is None:
            time = min(time, slowed * min(_longest(target) for target in goals))
    time = max(time, QUICKEST)
    axes = [AxisMove(target, goal, distances[target], time / slowed) for target, goal in raw.items()]
    for axis in axes:
        axis.target.model.family.check_axis(axis)
    return PlannedMove(
        axes,
        [target for target in raw if target in without_torque],
        starts=[starts[target] for target in raw],
        wording=wording,
    )


def _by_kind(targets: Iterable[KnownServo]) -> list[KnownServo]:
    """Bring servos into an order in which the speed of the port changes seldom: a change may cost 0.2 s."""
    kinds: dict[tuple[str, int], list[KnownServo]] = {}
    for target in targets:
        kinds.setdefault((target.model.family.name, target.baud), []).append(target)
    return [target for kind in kinds.values() for target in kind]


def start_move(move: PlannedMove) -> Procedure[None]:
    """Start a move that was planned, each family with as few packets as it allows, one family right after the other.

    Raises Stopped, before anything moves, if one of its servos must not move now. Where it fails on the way all servos
    that can be reached stay where they are, and the error says so.
    """
    for axis in move.axes:
        yield SetBaud(axis.target.baud)
        yield from axis.target.model.family.borrow(axis.target)
    _mark_moving([axis.target.permit for axis in move.axes])
    move.began = yield Now()
    try:
        yield from _send_leg(move, move.began)
    except BusError as error:
        yield from _fail(move, error)


def _send_leg(move: PlannedMove, now: float) -> Procedure[None]:
    """Send the next leg, which starts at this time."""
    axes, left = move.legs[move.sent], len(move.legs) - move.sent
    step = move.duration / len(move.legs)
    move.sent += 1
    move.due = now + step if left > 1 else math.inf
    move.arrival = now + left * step
    kinds: dict[tuple[str, int], list[AxisMove]] = {}
    for axis in axes:
        kinds.setdefault((axis.target.model.family.name, axis.target.baud), []).append(axis)
    for kind in kinds.values():
        yield SetBaud(kind[0].target.baud)
        for axis in kind:
            axis.target.record.goal = axis.goal
        yield from kind[0].target.model.family.start_moves(kind)


def keep_moving(targets: Iterable[KnownServo]) -> None:
    """Take note that these are given goals again and again, as `_mark_moving`, but quickly for those that move already.

    They are on one bus, so that one word to its watchdog is enough.
    """
    permits = [target.permit for target in targets]
    anew = [permit for permit in permits if permit.given_up or permit.inhibited]
    if anew:
        _mark_moving(anew)
    elif permits:
        permits[0].attend()


def _mark_moving(permits: Sequence[MotionPermit]) -> None:
    """Take note that servos are set in motion now. Raises Stopped, and notes none, if one of them must not be."""
    for permit in permits:
        permit.ask()
    for permit in permits:
        permit.mark_moving()


def plan_and_start(
    goals: Mapping[KnownServo, float], *, time: float | None = None, speed: float | None = None
) -> Procedure[PlannedMove]:
    """Plan a move, make sure that all its servos have torque, and start it; see `plan`. Raises TorqueOff."""
    planned = yield from plan(goals, time=time, speed=speed)
    if planned.without_torque:
        limp = ", ".join(map(str, planned.without_torque))
        raise TorqueOff(f"{limp}: torque is off, so nothing would move; switch it on first")
    yield from start_move(planned)
    return planned


def goal_from_here(target: KnownServo, way: float) -> Procedure[float]:
    """Give the angle, rad, that lies `way` rad from where the servo is. Raises BadValue for what is no number."""
    distance = finite(way)
    if distance is None:
        raise BadValue(f"{target}: {said(way)} is not a number; an angle is in radians, such as 5 * deg")
    row = target.model.register("present_position")
    (raw,) = yield from target.model.family.read(target, [row])
    here: float = row.decode(raw, target)
    return here + distance


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
    """Wait until all servos of a move stand still near their goals, and send its later legs meanwhile.

    `timeout` is in seconds from now, by the port's clock; without it the wait ends GRACE after the move should have
    arrived. Raises MoveTimeout when it is over, after one last look at most, or Stopped as soon as one of the servos
    does not come any more: it was made safe, stopped, or its torque was switched off.

    A move that fails is given up: all servos that can be reached stay where they are, and the error says so. It fails
    by an error of the line, and by a time-out once a servo should have arrived and stands still, or GRACE after that.
    """
    if timeout is not None and ((seconds := finite(timeout)) is None or seconds < 0):
        raise BadValue(f"timeout {said(timeout)} is not a number of seconds")
    if move.began is None:
        raise UsageError("this move has not started")
    now = yield Now()
    end = math.inf if timeout is None else now + timeout
    try:
        while not move.given_up and (now := (yield Now())) < min(move.arrival, end):
            move.axes[0].target.permit.attend()
            yield from _go_on(move, now)
            yield Pause(min(move.due - now, move.arrival - now, end - now, ATTENTION), shared=True)
        # One that does not come any more is looked at first, so that Stopped is raised at once.
        for axis in sorted(move.axes, key=lambda axis: not axis.target.permit.given_up):
            yield from _wait_axis(move, axis, min(end, max(now, move.arrival + GRACE)), timeout, tolerance)
    except BusError as error:
        yield from _fail(move, error)
    yield from _end(move)


def _go_on(move: PlannedMove, now: float) -> Procedure[None]:
    """Send the next leg if it is due."""
    if now >= move.due and not move.given_up:
        yield from _send_leg(move, now)


def _wait_axis(
    move: PlannedMove, axis: AxisMove, end: float, timeout: float | None, tolerance: float
) -> Procedure[None]:
    """Look at one servo again and again until it has arrived, or until this time."""
    target = axis.target
    while True:
        target.permit.attend()
        given_up = target.permit.given_up
        moving, angle, there = yield from _look(move, axis, tolerance)
        if there:
            return
        name, here = move.wording.name(target), move.wording.angle(target, angle)
        goal = move.wording.angle(target, target.model.register("goal_position").decode(axis.goal))
        if given_up:
            raise Stopped(f"{name} is at {here} and goes to {goal} no more: it was stopped or its torque switched off")
        now = yield Now()
        if now >= end:
            within = "" if timeout is None else f" within the timeout of {timeout:g} s"
            late = MoveTimeout(f"{name} is at {here} and did not reach {goal}{within}")
            if now < move.arrival + (GRACE if moving else 0.0):
                raise _told(late, "it is still on its way")
            yield from _fail(move, late)
        yield Pause(min(end - now, LOOK), shared=True)


def _look(move: PlannedMove, axis: AxisMove, tolerance: float) -> Procedure[tuple[bool, float, bool]]:
    """Look at one servo: whether it moves, where it is, rad, and whether it stands near its goal."""
    target = axis.target
    row = target.model.register("present_position")
    yield SetBaud(target.baud)
    try:
        moving = yield from target.model.family.moving(target)
        (raw,) = yield from target.model.family.read(target, [row])
    except BusError as error:
        move.wording.tell(target, error)
        raise
    here, goal = row.decode(raw), target.model.register("goal_position").decode(axis.goal)
    return moving, here, not moving and abs(here - goal) <= tolerance


def has_ended(move: PlannedMove, *, tolerance: float = 3 * deg) -> Procedure[bool]:
    """Tell whether a move has ended: all have arrived, or something has ended the motion of one of them.

    Sends the next leg if it is due. Asks nothing before the servos should be there, and nothing once it has ended.
    """
    if move.over or move.given_up:
        return True
    now = yield Now()
    yield from _go_on(move, now)
    if now < move.arrival:
        return False
    for axis in move.axes:
        *_, there = yield from _look(move, axis, tolerance)
        if not there:
            return False
    yield from _end(move)
    return True


def cancel(move: PlannedMove) -> Procedure[None]:
    """Stop all servos of a move where they are, unless it has ended: each, even if one fails.

    Then it raises the first failure.
    """
    if move.over:
        return
    outcomes = yield from stop_all([axis.target for axis in move.axes])
    yield from _end(move)
    for outcome in outcomes.values():
        if isinstance(outcome, BusError):
            raise outcome


def _end(move: PlannedMove) -> Procedure[None]:
    """Set the speeds of moves again that stood in the servos before; what does not succeed the next write does."""
    move.over = True
    for axis in move.axes:
        yield from give_back(axis.target)


def _fail(move: PlannedMove, why: ServobusError) -> Procedure[NoReturn]:
    """Give a move up: make the present position the goal of all its servos, and raise why, with what became of them."""
    said = []
    for axis in move.axes:
        yield SetBaud(axis.target.baud)
        try:
            state = yield from _stay(axis.target)
        except BusError as error:
            said.append(f"{move.wording.name(axis.target)} cannot be reached and may go on ({error})")
        else:
            said += [f"{move.wording.name(axis.target)} {state}"] if state else []
    yield from _end(move)
    held = "it stays where it is" if len(move.axes) == 1 else "all stay where they are"
    raise _told(why, "; ".join(said) or held)


def _stay(target: KnownServo) -> Procedure[str]:
    """Make the present position the goal, also for when the torque comes back. Tells what is wrong with the torque."""
    family = target.model.family
    motion_status = yield from family.motion_status(target)
    if motion_status.turning:
        return ""
    if motion_status.torque or motion_status.shutdown:
        if inside_limits(target, motion_status):
            yield from family.settle(target, motion_status)
        else:
            yield from stop(target)
        target.permit.stopped = True
    if motion_status.shutdown:
        return f"has shut down ({motion_status.shutdown}); rearm() or `servobus rearm PORT {target.id}` brings it back"
    return "" if motion_status.torque else "has no torque any more"


def _told(error: ServobusError, more: str) -> ServobusError:
    """Add to what an error says."""
    error.args = (f"{error}; {more}", *error.args[1:])
    return error
