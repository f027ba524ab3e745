"""Moves of joints over several ports: planned, checked, started together, and waited for.

The servos run each move by themselves, so the program need not be there in between. All joints have the same time for
their way: the one that was asked for, or the least in which none exceeds the speed asked for or its own limit.
A joint with a limit of acceleration gets at least the time of its quickest move that keeps it, from rest to rest. How a
servo speeds up within that time is its own: HerkuleX for a quarter of it, an MX by its goal_acceleration, others as
fast as their motor can. `play` is for motions that keep the limits at every instant.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from servobus.core.arguments import check_above_0
from servobus.core.exchange import Now, Pause
from servobus.core.units import show
from servobus.errors import BadValue, Disagreement, MotionError, ServobusError, TorqueOff, UsageError
from servobus.families.base import KnownServo
from servobus.jobs.move import (
    DEFAULT_SPEED,
    GRACE,
    LOOK,
    SHORTEST,
    PlannedMove,
    Wording,
    cancel,
    has_ended,
    plan,
    start_move,
    wait_arrival,
)
from servobus.robots.joints import jobs
from servobus.robots.joints.joint import Joint, Part, check_meant
from servobus.robots.steps import RobotJob, each, together
from servobus.robots.trajectory.limits import RANGE, JointLimits
from servobus.robots.trajectory.profile import quickest


class JointWording(Wording):
    """In the errors of a move joints stand in place of their servos, with their angles."""

    def __init__(self, joints: Iterable[Joint]) -> None:
        self._parts: dict[KnownServo, tuple[Joint, Part]] = {
            part.servo.target: (joint, part) for joint in joints for part in joint.parts
        }

    def name(self, target: KnownServo) -> str:
        joint, part = self._parts[target]
        return joint.name if len(joint.parts) == 1 else f"{joint.name} ({part.servo.target} on {part.port})"

    def angle(self, target: KnownServo, angle: float) -> str:
        _, part = self._parts[target]
        return show(part.axis.to_joint(angle), "rad")

    def tell(self, target: KnownServo, error: ServobusError) -> None:
        error.tell_whose(self.name(target))


class JointMove:
    """A move of joints, and how far it has come.

    goals     joint -> angle, rad
    ports     port -> the move of its servos
    duration  s from start to arrival, the same for all
    """

    def __init__(self, goals: Mapping[Joint, float], ports: Mapping[str, PlannedMove], duration: float) -> None:
        self.goals, self.ports, self.duration = dict(goals), dict(ports), duration

    @property
    def over(self) -> bool:
        """Whether all have arrived, or something has ended the motion of one."""
        return all(planned.over or planned.given_up for planned in self.ports.values())

    def on_ports(self, job: Callable[[PlannedMove], Any]) -> dict[str, Any]:
        """Make a job for each port."""
        return {port: job(planned) for port, planned in self.ports.items()}

    def __str__(self) -> str:
        ways = ", ".join(f"{joint.name} to {show(angle, 'rad')}" for joint, angle in self.goals.items())
        return f"{ways} in {show(self.duration, 's')}"


def plan_joints(
    goals: Mapping[Joint, float], *, time: float | None = None, speed: float | None = None
) -> RobotJob[JointMove]:
    """Check a move of joints; nothing moves.

    goals   joint -> angle, rad
    time    s that the move takes, or
    speed   rad/s of the joint that has the longest way; DEFAULT_SPEED if neither is given

    Raises BadValue for a goal outside the limits of a joint, or a time in which it would exceed its speed.
    """
    if not goals:
        raise UsageError("a move of no joints: give at least one, as in move(elbow=90 * deg)")
    if time is not None and speed is not None:
        raise BadValue("a move takes either a time or a speed, not both")
    for name, value in (("time", time), ("speed", speed)):
        if value is not None:
            check_above_0(name, value)
    check_meant(goals)
    targets = {joint: joint.check(angle) for joint, angle in goals.items()}
    pairs = [joint for joint in targets if len(joint.parts) > 1]
    if pairs:
        yield from jobs.read(pairs, "present_position")
    wording = JointWording(targets)
    planned = yield from together(
        jobs.on_each_port(
            targets,
            lambda parts: plan(
                {
                    part.servo.target: part.axis.to_servo(targets[joint])
                    for joint in targets
                    for part in joint.parts
                    if part in parts
                },
                time=time,
                speed=speed,
                wording=wording,
            ),
        )
    )
    duration = _duration(targets, _ways(targets, planned), time, speed)
    return JointMove(targets, {port: move.within(duration) for port, move in planned.items()}, duration)


def _ways(goals: Mapping[Joint, float], planned: Mapping[str, PlannedMove]) -> dict[Joint, float]:
    """Give how far each joint has to go, rad."""
    far = {axis.target: axis.distance for move in planned.values() for axis in move.axes}
    return {
        joint: max(abs(part.axis.change_to_joint(far[part.servo.target])) for part in joint.parts) for joint in goals
    }


def _duration(
    goals: Mapping[Joint, float], ways: Mapping[Joint, float], time: float | None, speed: float | None
) -> float:
    """Give the time for a move. Raises BadValue for one in which a joint would exceed its speed."""
    shortest = {joint: _shortest(joint, way) for joint, way in ways.items()}
    if time is None:
        return max(max(ways.values()) / (speed or DEFAULT_SPEED), *shortest.values(), SHORTEST)
    slowest = max(goals, key=lambda joint: shortest[joint])
    if shortest[slowest] > time * (1 + 1e-9):
        entry, way = slowest.entry, ways[slowest]
        by_speed = entry.speed is not None and way > entry.speed * time * (1 + 1e-9)
        bound = show(entry.speed or 0.0, "rad/s") if by_speed else show(entry.acceleration or 0.0, "rad/s2")
        raise BadValue(
            f"{slowest.name}: {show(way, 'rad')} in {show(time, 's')} is faster than its {bound}; give it "
            f"{show(shortest[slowest], 's')} or more"
        )
    return time


def _shortest(joint: Joint, way: float) -> float:
    """Give the least time in s in which a joint makes its way, rad, within the limits that the file has for it."""
    entry = joint.entry
    if entry.acceleration is None:
        return way / entry.speed if entry.speed else 0.0
    limits = JointLimits(entry.speed or RANGE[1], entry.acceleration, entry.jerk)
    return quickest(0.0, way, limits).duration


def start_joints(move: JointMove) -> RobotJob[None]:
    """Start a move on all ports at the same time. Where one fails all are stopped, and its error is raised."""
    outcomes = yield from each(move.on_ports(start_move))
    yield from _all_or_none(move, outcomes)


def plan_and_start(
    goals: Mapping[Joint, float], *, time: float | None = None, speed: float | None = None
) -> RobotJob[JointMove]:
    """Plan a move, make sure that all its joints have torque, and start it. Raises TorqueOff."""
    move = yield from plan_joints(goals, time=time, speed=speed)
    limp = {target for planned in move.ports.values() for target in planned.without_torque}
    if names := [joint.name for joint in goals if any(part.servo.target in limp for part in joint.parts)]:
        raise TorqueOff(f"{', '.join(names)}: torque is off, so nothing would move; switch it on first")
    yield from start_joints(move)
    return move


def wait_joints(move: JointMove, timeout: float | None = None) -> RobotJob[None]:
    """Wait until all joints stand still near their goals.

    Raises MoveTimeout `timeout` s from now, or GRACE after they should have arrived; Stopped if one does not come any
    more, and Disagreement if two servos on one axis come too far apart. If one fails, all stop where they are.
    """
    if timeout is not None:
        timeout = max(0.0, float(timeout))
    began: float = yield Now()
    end = began + (move.duration + GRACE if timeout is None else timeout)
    pairs = [joint for joint in move.goals if len(joint.parts) > 1]
    while True:
        outcomes = yield from each(move.on_ports(_look))
        yield from _all_or_none(move, outcomes)
        try:
            yield from jobs.read(pairs, "present_position")  # those that do not answer are told at the end
        except Disagreement as error:
            yield from _all_or_none(move, {"": error})
        now: float = yield Now()
        if all(outcomes.values()) or now >= end:
            break
        yield Pause(min(LOOK, end - now))
    # What has not arrived says so in its own words, with where it is.
    outcomes = yield from each(move.on_ports(partial(wait_arrival, timeout=None if timeout is None else 0.0)))
    yield from _all_or_none(move, outcomes)


def _look(planned: PlannedMove) -> Any:
    """Look whether the servos of a port have arrived, and feed the watchdog."""
    planned.axes[0].target.permit.attend()
    return (yield from has_ended(planned))


def _all_or_none(move: JointMove, outcomes: Mapping[str, Any]) -> RobotJob[None]:
    """Stop all joints of a move if one of its ports failed, and raise that error."""
    error = next((outcome for outcome in outcomes.values() if isinstance(outcome, ServobusError)), None)
    if error is None:
        return
    if not isinstance(error, UsageError):
        try:
            yield from jobs.stop(list(move.goals))
        except MotionError as more:
            error.add_note(str(more))
    raise error


def joints_have_ended(move: JointMove) -> RobotJob[bool]:
    """Tell whether a move has ended, and send what is due of it."""
    outcomes = yield from each(move.on_ports(has_ended))
    yield from _all_or_none(move, outcomes)
    return all(outcomes.values())


def cancel_joints(move: JointMove) -> RobotJob[None]:
    """Stop all joints of a move where they are, unless it has ended."""
    yield from together(move.on_ports(cancel))


def goals_by_joint(joints: Mapping[str, Joint], angles: Mapping[str, float]) -> dict[Joint, float]:
    """Give goals by joint in place of its name."""
    return {joints[name]: angle for name, angle in angles.items()}
