"""Switching torque on: where the servo stands, or from outside its limits slowly to the nearest of them."""

import math

from servobus.core.exchange import Procedure
from servobus.core.units import deg
from servobus.errors import BadValue
from servobus.families.base import AxisMove, KnownServo, MotionStatus
from servobus.families.motion import inside_limits, nearest, no_torque, raw_position, way_to
from servobus.jobs.move import SHORTEST, PlannedMove, start_move, wait_arrival

TO_LIMIT_SPEED = 20 * deg
"""rad/s with which a servo outside its limits is brought to the nearest; assumption: slow enough to be stopped."""


def torque_on(target: KnownServo, *, to_limit: bool = False, speed: float | None = None) -> Procedure[None]:
    """Switch the torque on; see `Servo.torque_on`."""
    family = target.model.family
    pace = _pace(speed, to_limit=to_limit)
    if to_limit:
        motion_status = yield from family.motion_status(target)
        if not (motion_status.torque or inside_limits(target, motion_status)):
            yield from _come_in(target, motion_status, pace)
            return
    yield from family.torque(target, on=True)


def rearm(target: KnownServo, *, to_limit: bool = False, speed: float | None = None) -> Procedure[None]:
    """Switch the torque on again after the servo has switched it off; see `Servo.rearm`."""
    family = target.model.family
    _pace(speed, to_limit=to_limit)
    if not to_limit:
        yield from family.rearm(target)
        return
    motion_status = yield from family.motion_status(target)
    yield from family.end_shutdown(target, motion_status)
    if not motion_status.torque:
        yield from torque_on(target, to_limit=True, speed=speed)


def _pace(speed: float | None, *, to_limit: bool) -> float:
    if speed is None:
        return TO_LIMIT_SPEED
    if not to_limit:
        raise BadValue("speed goes with to_limit=True: torque that comes on moves nothing else")
    if not 0 < speed < math.inf:
        raise BadValue(f"speed {speed!r} is not a number above 0")
    return speed


def _come_in(target: KnownServo, motion_status: MotionStatus, pace: float) -> Procedure[None]:
    """Bring a servo from outside its limits to the nearest, and wait until it is there."""
    family = target.model.family
    if motion_status.shutdown:
        raise no_torque(target, motion_status.shutdown)
    goal = nearest(target, motion_status)
    distance = way_to(target, motion_status, goal)
    target.permit.check_step(str(target), distance)
    axis = AxisMove(target, goal, distance, max(distance / pace, SHORTEST))
    family.check_axis(axis)
    move = PlannedMove([axis], starts=[raw_position(target, motion_status)])
    if family.holds_outside_limits:
        yield from family.torque(target, on=True)
        yield from start_move(move)
    else:  # goal and speed stand there before the torque comes on
        yield from start_move(move)
        yield from family.switch_on(target, motion_status)
    yield from wait_arrival(move)
