"""Teleoperation: a limp robot that is moved by hand leads another one, joint by joint, of any mix of families.

    with servobus.robot("leader.toml") as leader, servobus.robot("follower.toml") as follower, follower.torque():
        Teleop(leader, follower).wait()

The leader is only read. The follower is led joint by joint: those of the same name, or as `joints` says. What the
leader asks for is kept within the limits of the follower, and told (`clamped`); the way there keeps its limits of speed
and acceleration.

    WAITING     the robots are too far apart at the start: it begins when each joint is within the gate
    STARTING    the follower comes slowly to where the leader is
    FOLLOWING   the follower follows
    HOLDING     the follower stands: the leader does not answer, or the deadman is not held. From here it starts anew

Who waits for a person's hand needs little delay: `lag` tells how long a tick took from reading the leader to the goal.
"""

from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from typing import NamedTuple

from servobus.bus.rate import Rate
from servobus.bus.servo import Servo
from servobus.core.arguments import check_above_0
from servobus.core.operation import Priority
from servobus.core.units import deg, finite, said, show
from servobus.core.values import frozen
from servobus.errors import BadValue, MotionError, ServobusError, UnknownName, UsageError
from servobus.robots import jobs, stream
from servobus.robots.blocking import Robot
from servobus.robots.cycle import RobotCycle, RobotResult
from servobus.robots.motion import limits_of
from servobus.robots.supervision import Supervision
from servobus.robots.trajectory.follower import BrakingFollower
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import State

RATE = 50.0
"""Goals a second: more bring 2 to 3 ms less lag with the servos here."""
GATE = 45 * deg
"""rad between leader and follower beyond which the follower does not set off; 0.8 rad as in GELLO's run_env.py."""
START = 30 * deg
"""rad/s at most while the follower comes to the leader; *assumption*: slow enough that a person can let go."""
CLOSE = 3 * deg
"""rad between follower and leader from which on the start is over."""
STALE = 3
"""Turns without an answer of a joint of the leader after which the follower holds."""


class Phase(Enum):
    """What the follower does; see the head of this module."""

    WAITING = "waiting"
    STARTING = "starting"
    FOLLOWING = "following"
    HOLDING = "holding"


class Lead(NamedTuple):
    """How a joint of the follower is led: by which joint of the leader, and follower = scale * leader + offset."""

    leader: str
    scale: float = 1.0
    offset: float = 0.0


@frozen
class TeleopTick:
    """One turn.

    phase    what the follower does
    why      why it does not follow; "" while it does
    leader   joint of the follower -> where the leader asks it to be, rad, within its limits
    result   what was read of the follower, by joint
    clamped  joints whose leader asks for more than their limits allow
    lag      s from the reading of the leader to the end of this turn's goals and readings
    """

    phase: Phase
    why: str
    leader: Mapping[str, float]
    result: RobotResult
    clamped: tuple[str, ...]
    lag: float


class Leading:
    """What the follower is to do, from what is read of the leader; no port, no clock.

    limits  joint of the follower -> its limits of speed, acceleration and jerk
    ranges  joint -> its least and greatest angle, rad
    leads   joint -> how it is led
    """

    def __init__(
        self,
        limits: Mapping[str, JointLimits],
        ranges: Mapping[str, tuple[float, float]],
        leads: Mapping[str, Lead],
        tick: float,
        gate: float,
    ) -> None:
        self.limits, self.ranges, self.leads, self.tick, self.gate = limits, ranges, leads, tick, gate
        self.phase, self.why = Phase.WAITING, "not begun"
        self._slow = {
            name: JointLimits(min(one.speed, START), one.acceleration, one.jerk) for name, one in limits.items()
        }
        self._follower: BrakingFollower | None = None
        self._silent = 0

    def begin(self, here: Mapping[str, float]) -> None:
        """Stand where the follower is, joint -> angle, rad."""
        self._follower = BrakingFollower({name: State(angle) for name, angle in here.items()}, self._slow, self.tick)
        self.phase, self.why = Phase.WAITING, "not begun"

    def wanted(self, leader: Mapping[str, float]) -> tuple[dict[str, float], tuple[str, ...]]:
        """Give where the leader asks the follower to be, within its limits, and the joints that were clamped."""
        goals, clamped = {}, []
        for name, lead in self.leads.items():
            asked = lead.scale * leader[lead.leader] + lead.offset
            low, high = self.ranges[name]
            goals[name] = min(max(asked, low), high)
            if goals[name] != asked:
                clamped.append(name)
        return goals, tuple(clamped)

    def step(self, leader: Mapping[str, float], *, held: bool) -> tuple[dict[str, State], tuple[str, ...]]:
        """Take what was read of the leader, and give the next states of the follower, and the joints clamped.

        `leader` lacks joints that did not answer; `held` is whether the deadman is.
        """
        assert self._follower is not None
        missing = sorted({lead.leader for lead in self.leads.values()} - set(leader))
        self._silent = self._silent + 1 if missing else 0
        clamped: tuple[str, ...] = ()
        if not held:
            self._hold("the deadman is not held")
        elif self._silent >= STALE:
            self._hold(f"the leader does not answer: {', '.join(missing)}")
        elif not missing:
            goals, clamped = self.wanted(leader)
            self._lead(goals)
        return self._follower.step(), clamped

    def _hold(self, why: str) -> None:
        assert self._follower is not None
        if self.phase in (Phase.STARTING, Phase.FOLLOWING):
            self._follower.hold()
            self.phase = Phase.HOLDING
        self.why = why

    def _lead(self, goals: Mapping[str, float]) -> None:
        assert self._follower is not None
        apart = {name: abs(goal - self._follower.states[name].position) for name, goal in goals.items()}
        if self.phase in (Phase.WAITING, Phase.HOLDING):
            far = [f"{name} by {show(angle, 'rad')}" for name, angle in apart.items() if angle > self.gate]
            if far:
                self.why = f"too far apart to start: {', '.join(far)}; bring the leader within {show(self.gate, 'rad')}"
                return
            self.phase, self._follower.limits = Phase.STARTING, dict(self._slow)
        if self.phase is Phase.STARTING and max(apart.values()) < CLOSE:
            self.phase, self._follower.limits = Phase.FOLLOWING, dict(self.limits)
        self.why = "" if self.phase is Phase.FOLLOWING else "the follower comes to the leader"
        self._follower.aim(goals)


class Teleop:
    """A leader and a follower, and the loop between them; see the head of this module.

    joints   joint of the follower -> the joint of the leader that leads it, or a `Lead`; by default those of the same
             name
    rate     goals a second
    gate     rad between the robots beyond which the follower does not set off
    deadman  is asked each turn whether the person still wants it; None: as long as it runs

    Raises UnknownName for a joint that is not there, UsageError where no joint leads another.
    """

    def __init__(
        self,
        leader: Robot,
        follower: Robot,
        joints: Mapping[str, str | Lead] | None = None,
        *,
        rate: float = RATE,
        gate: float = GATE,
        deadman: Callable[[], bool] | None = None,
    ) -> None:
        self.leader, self.follower = leader, follower
        leads = _leads(leader, follower, joints)
        self.joints = [joint for joint in follower if joint.name in leads]
        self.period = 1 / check_above_0("rate", rate)
        self.deadman = deadman
        self._read = [leader[name] for name in dict.fromkeys(lead.leader for lead in leads.values())]
        self._cycle = RobotCycle(follower.ports, self.joints, "present_position", self.period)
        self._supervision = Supervision(self.joints)
        self.leading = Leading(
            {joint.name: limits_of(joint) for joint in self.joints},
            {joint.name: joint.limits for joint in self.joints},
            leads,
            self.period,
            check_above_0("gate", gate),
        )
        self.over = False

    def stop(self) -> None:
        """End it: the follower holds where it is, and `wait` returns."""
        self.over = True

    def __iter__(self) -> Iterator[TeleopTick]:
        had = self._begin()
        try:
            for _ in Rate(self.follower, self.follower.ports.now, self.period):
                if self.over:
                    break
                yield self._turn()
        except BaseException as error:
            try:
                self.follower.do(jobs.stop(self.joints), priority=Priority.STOP)
            except ServobusError as failure:
                error.add_note(str(failure))
            raise
        finally:
            self.over = True
            self.follower.do(stream.end(self.joints, had), priority=Priority.MOTION)
        self.follower.do(jobs.stop(self.joints), priority=Priority.STOP)

    def wait(self) -> None:
        """Teleoperate until `stop`. Raises what ended it before: all joints of the follower were stopped then."""
        for _ in self:
            pass

    def _begin(self) -> dict[Servo, int]:
        states = self.leader.do(jobs.look(self._read), priority=Priority.READ)
        stiff = [name for name, state in states.items() if state.torque]
        for joint in self._read:
            states[joint.name]  # raises what came instead of an answer
        if stiff:
            raise MotionError(
                f"{', '.join(stiff)}: the torque of the leader is on, so nobody could move it; hold the leader, and "
                "switch it off"
            )
        had = self.follower.do(stream.begin(self.joints), priority=Priority.MOTION)
        self.leading.begin(self.follower.do(stream.where(self.joints), priority=Priority.MOTION))
        self.follower.do(self._supervision.begin(), priority=Priority.MOTION)
        return had

    def _turn(self) -> TeleopTick:
        began = self.follower.ports.now()
        if not self.leader.ports.real:
            self.leader.ports.align(self.leader.ports.now() + self.period)
        seen = self.leader.do(jobs.read(self._read, "present_position"), priority=Priority.READ)
        held = self.deadman is None or self.deadman()
        states, clamped = self.leading.step(dict(seen), held=held)
        goals = {name: state.position for name, state in states.items()}
        result = self.follower.do(self._cycle.turn(goals), priority=Priority.MOTION)
        self.follower.do(self._supervision.watch(states, result), priority=Priority.MOTION)
        wanted = self.leading.wanted(seen)[0] if not seen.lost else goals
        lag = self.follower.ports.now() - began
        return TeleopTick(self.leading.phase, self.leading.why, wanted, result, clamped, lag)


def _leads(leader: Robot, follower: Robot, joints: Mapping[str, str | Lead] | None) -> dict[str, Lead]:
    """Give how each joint of the follower is led. Raises UnknownName, BadValue, UsageError."""
    if joints is None:
        joints = {name: name for name in follower.joints if name in leader.joints}
        if not joints:
            raise UsageError(
                f"{leader.file.name} and {follower.file.name} have no joint of the same name; say which leads which, "
                "as in joints={'shoulder': 'arm1'}"
            )
    leads = {}
    for name, given in joints.items():
        lead = Lead(given) if isinstance(given, str) else given
        for robot, joint in ((follower, name), (leader, lead.leader)):
            if joint not in robot.joints:
                raise UnknownName(f"{robot.file.name}: no joint {joint!r}; there are {', '.join(robot.joints)}")
        for word, value in (("scale", lead.scale), ("offset", lead.offset)):
            if finite(value) is None or (word == "scale" and value == 0):
                raise BadValue(f"{name}: {word} {said(value)} is not a number that leads anywhere")
        leads[name] = lead
    return leads
