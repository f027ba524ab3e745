"""Goals at a fixed rate: what servos need before, and what is given back after.

A Dynamixel servo goes to each goal at its goal speed, which a move before may have left small: it would lag far behind
a stream of goals. So while goals are streamed it has none, and gets back afterwards what it had.
"""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from servobus.bus.servo import Servo
from servobus.core.exchange import Procedure, SetBaud
from servobus.core.units import deg, show
from servobus.errors import BadValue, ServobusError, TorqueOff
from servobus.robots.joints import jobs
from servobus.robots.joints.cycle import RobotCycle, RobotResult
from servobus.robots.joints.joint import Joint, Part
from servobus.robots.motions.motion import limits_of
from servobus.robots.motions.supervision import Supervision
from servobus.robots.motions.turns import Turns
from servobus.robots.ports import Ports
from servobus.robots.steps import RobotJob, each, together
from servobus.robots.trajectory.path import State

K = TypeVar("K")

NEAR = 5 * deg
"""rad between goal and position up to which a joint holds, and hangs below its goal by its load alone."""
ROUNDING = 1e-6
"""Share by which a step from goal to goal may seem to exceed a speed for rounding alone."""
UNBOUND = 0
"""Goal speed, raw, of a Dynamixel servo that goes as fast as it can (moving speed 0, RX-28 manual 3-4-3)."""


def check_torque(joints: Sequence[Joint]) -> RobotJob[None]:
    """Raise TorqueOff, with the names of all joints whose torque is off; and what came instead of an answer."""
    states = (yield from jobs.look(joints)).complete()
    limp = [name for name, state in states.items() if not state.torque]
    if limp:
        raise TorqueOff(f"{', '.join(limp)}: torque is off, so nothing would move; switch it on first")


def begin(joints: Sequence[Joint], had: dict[Servo, int]) -> RobotJob[None]:
    """Let the servos of these joints follow goals as fast as they can.

    `had` is filled with servo -> the goal speed it had, raw, so that `end` can give it back although this fails.
    """
    yield from together(jobs.on_each_port(joints, lambda parts: _free(parts, had)))


def _free(parts: Sequence[Part], had: dict[Servo, int]) -> Procedure[None]:
    for part in parts:
        servo = part.servo
        row = servo.model.optional("goal_speed")
        if row is None:
            continue
        yield SetBaud(servo.baud)
        yield from servo.family.give_back(servo.target)
        (speed,) = yield from servo.family.read(servo.target, [row])
        if speed != UNBOUND:
            had[servo] = speed
            yield from servo.family.write(servo.target, {row: UNBOUND})


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
            except ServobusError:
                continue

    yield from each(jobs.on_each_port(parts, give_back))


def where(joints: Sequence[Joint]) -> RobotJob[dict[str, float]]:
    """Give the angles from which a motion of these joints sets off.

    One that holds sets off from its goal: its load makes it hang below, and a motion from there would let it sink.
    Raises BadValue for one that stands so far outside its limits that the way inside would be a jump.
    """
    positions = yield from jobs.read(joints, "present_position")
    goals = yield from jobs.read(joints, "goal_position")
    start = {}
    for joint in joints:
        here, goal = positions[joint.name], goals[joint.name]
        low, high = joint.limits
        if not low - NEAR <= here <= high + NEAR:
            raise BadValue(
                f"{joint.name} stands at {show(here, 'rad')}, outside its limits, {show(low, 'rad')} .. "
                f"{show(high, 'rad')}: move it inside first, which goes slowly; nothing has moved"
            )
        start[joint.name] = min(max(goal if abs(goal - here) <= NEAR else here, low), high)
    return start


class Streamed(Turns[K]):
    """Turns in which joints are given goals: what motions that are played, followed or led have in common.

    joints  those that are given goals, and watched; see servobus.robots.motions.supervision
    limits  joint -> its greatest speed, acceleration and jerk
    sent    joint -> the goal that it was given last, rad
    """

    def __init__(self, ports: Ports[Any], joints: Sequence[Joint], rate: float) -> None:
        super().__init__(ports, rate)
        self.joints = list(joints)
        self.limits = {joint.name: limits_of(joint) for joint in joints}
        self.cycle = RobotCycle(ports, self.joints, "present_position", self.period)
        self.sent: dict[str, float] = {}
        self._supervision = Supervision(self.joints, self.period)
        self._had: dict[Servo, int] | None = None
        """Servo -> the goal speed it had; None before they follow goals."""

    def set_off(self) -> RobotJob[dict[str, float]]:
        """Make sure that all joints have torque; give joint -> the angle from which it sets off, rad."""
        yield from check_torque(self.joints)
        self._had = {}
        yield from begin(self.joints, self._had)
        self.sent = yield from where(self.joints)
        yield from self._supervision.begin()
        return dict(self.sent)

    def send(self, states: Mapping[str, State]) -> RobotJob[RobotResult]:
        """Send the goals of a turn, but not to silent joints, and read all. Raises what ends the motion.

        A joint that was silent has fallen behind: it catches up at its greatest speed, and no faster.
        """
        yield from self._supervision.look()
        goals = {}
        for name, state in states.items():
            if name not in self._supervision.silent:
                before, reach = self.sent[name], self.limits[name].speed * self.period * (1 + ROUNDING)
                goals[name] = min(max(state.position, before - reach), before + reach)
        result = yield from self.cycle.turn(goals)
        self.sent |= goals
        yield from self._supervision.watch(states, result)
        return result

    def arrived(self, states: Mapping[str, State]) -> bool:
        """Tell whether all joints were given these goals as their last, and are near them as far as can be seen."""
        late = [name for name, state in states.items() if self.sent[name] != state.position]
        return not late and not self._supervision.silent and not self._supervision.behind

    def finish(self, error: BaseException | None, *, stop: bool) -> RobotJob[None]:
        """Give the servos their speeds back. Stop all joints before, where that is asked for, or after an error."""
        self.over = True
        if self._had is None:
            return  # nothing has been sent
        try:
            if stop or error is not None:
                yield from jobs.stop(self.joints)
        except ServobusError as failure:
            if error is None:
                raise
            error.add_note(str(failure))
        finally:
            yield from end(self.joints, self._had)
