"""Goals at a fixed rate: what servos need before, and what is given back after.

A Dynamixel servo goes to each goal at its goal speed, which a move before may have left small: it would lag far behind
a stream of goals. So while goals are streamed it has none, and gets back afterwards what it had.
"""

from collections.abc import Mapping, Sequence

from servobus.bus.servo import Servo
from servobus.core.exchange import Procedure, SetBaud
from servobus.core.units import deg
from servobus.errors import BusError, ServobusError, TorqueOff
from servobus.robots import jobs
from servobus.robots.joint import Joint, Part
from servobus.robots.steps import RobotJob, each, together

NEAR = 5 * deg
"""rad between goal and position up to which a joint holds, and hangs below its goal by its load alone."""
UNBOUND = 0
"""Goal speed, raw, of a Dynamixel servo that goes as fast as it can (moving speed 0, RX-28 manual 3-4-3)."""


def begin(joints: Sequence[Joint]) -> RobotJob[dict[Servo, int]]:
    """Let the servos of these joints follow goals as fast as they can. Gives servo -> the goal speed it had, raw.

    Raises TorqueOff, with the names of all joints whose torque is off.
    """
    states = yield from jobs.look(joints)
    for name in [joint.name for joint in joints]:
        states[name]  # raises what came instead of an answer
    limp = [name for name, state in states.items() if not state.torque]
    if limp:
        raise TorqueOff(f"{', '.join(limp)}: torque is off, so nothing would move; switch it on first")
    outcomes = yield from together(jobs.on_each_port(joints, _free))
    return {servo: speed for had in outcomes.values() for servo, speed in had.items()}


def _free(parts: Sequence[Part]) -> Procedure[dict[Servo, int]]:
    had: dict[Servo, int] = {}
    for part in parts:
        servo = part.servo
        row = servo.model.optional("goal_speed")
        if row is None:
            continue
        yield SetBaud(servo.baud)
        yield from servo.family.give_back(servo.target)
        (speed,) = yield from servo.family.read(servo.target, [row])
        if speed != UNBOUND:
            yield from servo.family.write(servo.target, {row: UNBOUND})
            had[servo] = speed
    return had


def end(joints: Sequence[Joint], had: Mapping[Servo, int]) -> RobotJob[None]:
    """Give servos their goal speeds back, each though others fail: one that is gone has lost its speed anyway."""
    parts = [joint for joint in joints if any(part.servo in had for part in joint.parts)]

    def give_back(there: Sequence[Part]) -> Procedure[None]:
        for part in there:
            servo = part.servo
            row = servo.model.optional("goal_speed")
            if servo not in had or row is None:
                continue
            yield SetBaud(servo.baud)
            try:
                yield from servo.family.write(servo.target, {row: had[servo]})
            except (BusError, ServobusError):
                continue

    yield from each(jobs.on_each_port(parts, give_back))


def where(joints: Sequence[Joint]) -> RobotJob[dict[str, float]]:
    """Give the angles from which a motion of these joints sets off.

    One that holds sets off from its goal: its load makes it hang below, and a motion from there would let it sink.
    """
    positions = yield from jobs.read(joints, "present_position")
    goals = yield from jobs.read(joints, "goal_position")
    start = {}
    for joint in joints:
        here, goal = positions[joint.name], goals[joint.name]
        low, high = joint.limits
        start[joint.name] = min(max(goal if abs(goal - here) <= NEAR else here, low), high)
    return start
