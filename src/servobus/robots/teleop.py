"""Teleoperation: a limp robot that is moved by hand leads another one, joint by joint, of any mix of families.

    with servobus.robot("leader.toml") as leader, servobus.robot("follower.toml") as follower, follower.torque():
        Teleop(leader, follower).wait()      # or: for tick in teleop: print(tick.phase, tick.why)

With asynchronous robots it is `AsyncTeleop(leader, follower)`.

The leader is only read. The follower is led joint by joint: those of the same name, or as `joints` says. What the
leader asks for is kept within the limits of the follower, and told (`clamped`); the way there keeps its limits of speed
and acceleration.

    WAITING     the robots are too far apart at the start: it begins when each joint is within the gate
    STARTING    the follower comes slowly to where the leader is
    FOLLOWING   the follower follows
    HOLDING     the follower stands: the leader does not answer, a joint of it jumped as no hand can turn it, or the
                deadman is not held. From here it starts anew

Who waits for a person's hand needs little delay: `lag` tells how long a tick took from reading the leader to the goal.
"""

from collections.abc import Callable, Mapping
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar

from servobus.core.arguments import check_above_0
from servobus.core.exchange import Now
from servobus.core.operation import Priority, bus_method, urgent
from servobus.core.units import deg, finite, said, show
from servobus.core.values import frozen
from servobus.errors import BadValue, MotionError, UnknownName, UsageError
from servobus.robots.base import BaseRobot
from servobus.robots.blocking import Robot
from servobus.robots.joints import jobs
from servobus.robots.joints.cycle import RobotResult
from servobus.robots.joints.joint import Joint
from servobus.robots.motions.stream import Streamed
from servobus.robots.motions.supervision import jumped
from servobus.robots.motions.turns import AsyncTurns, BlockingTurns
from servobus.robots.ports import BlockingPorts
from servobus.robots.steps import RobotJob, Together
from servobus.robots.trajectory.follower import BrakingFollower
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import State

if TYPE_CHECKING:
    from servobus.robots.asyncio import AsyncRobot

T = TypeVar("T")
AnyRobot: TypeAlias = BaseRobot[Any, Any]
LEADER, FOLLOWER = "leader", "follower"
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
        self._turn = 0
        self._last: dict[str, tuple[int, float]] = {}
        """Joint of the leader -> the turn in which it was read last, and its angle."""

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
            if jumps := self._jumps(leader):
                self._hold(f"the leader jumped as no hand can turn it: {', '.join(jumps)}")
            else:
                self._lead(goals)
        self._turn += 1
        self._last |= {name: (self._turn, angle) for name, angle in leader.items()}
        return self._follower.step(), clamped

    def _jumps(self, leader: Mapping[str, float]) -> list[str]:
        """Give the joints of the leader that are somewhere else than a hand can have turned them."""
        found = []
        for name, angle in leader.items():
            turn, before = self._last.get(name, (self._turn, angle))
            if jumped(before, angle, (self._turn + 1 - turn) * self.tick):
                found.append(name)
        return found

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


def _both(leader: AnyRobot, follower: AnyRobot) -> dict[str, Any]:
    """Give the buses of two robots, so that both have one clock and jobs of either can be carried out."""
    return {
        f"{role} {port}": bus
        for role, robot in ((LEADER, leader), (FOLLOWER, follower))
        for port, bus in robot.ports.buses.items()
    }


def _of(role: str, job: RobotJob[T]) -> RobotJob[T]:
    """Give a job of one of two robots as a job of both."""
    answer: Any = None
    try:
        while True:
            step = job.send(answer)
            if isinstance(step, Together):
                outcomes = yield Together({f"{role} {port}": one for port, one in step.jobs.items()})
                answer = {port: outcomes[f"{role} {port}"] for port in step.jobs}
            else:
                answer = yield step
    except StopIteration as stop:
        done: T = stop.value
        return done
    finally:
        job.close()


class Leadership(Streamed[TeleopTick]):
    """A leader and a follower, and what is done each turn; see the head of this module.

    joints   joint of the follower -> the joint of the leader that leads it, or a `Lead`; by default those of the same
             name
    rate     goals a second
    gate     rad between the robots beyond which the follower does not set off
    deadman  is asked each turn whether the person still wants it; None: as long as it runs

    Raises UnknownName for a joint that is not there, UsageError where no joint leads another.
    """

    def __init__(
        self,
        clock: Callable[[], float],
        leader: AnyRobot,
        follower: AnyRobot,
        joints: Mapping[str, str | Lead] | None = None,
        *,
        rate: float = RATE,
        gate: float = GATE,
        deadman: Callable[[], bool] | None = None,
    ) -> None:
        leads = _leads(leader, follower, joints)
        super().__init__(follower.ports, [joint for joint in follower if joint.name in leads], rate)
        self._clock = clock
        self.leader, self.follower = leader, follower
        self.deadman = deadman
        self._read: list[Joint] = [leader[name] for name in dict.fromkeys(lead.leader for lead in leads.values())]
        self.leading = Leading(
            self.limits,
            {joint.name: joint.limits for joint in self.joints},
            leads,
            self.period,
            check_above_0("gate", gate),
        )

    def stop(self) -> None:
        """End it: the follower holds where it is, and `wait` returns."""
        self.over = True

    @bus_method
    @urgent(Priority.MOTION)
    def begin(self) -> RobotJob[None]:
        """Make sure that the leader is limp and the follower has torque. Nothing moves yet."""
        states = yield from _of(LEADER, jobs.look(self._read))
        for joint in self._read:
            states[joint.name]  # raises what came instead of an answer
        if stiff := [name for name, state in states.items() if state.torque]:
            raise MotionError(
                f"{', '.join(stiff)}: the torque of the leader is on, so nobody could move it; hold the leader, and "
                "switch it off"
            )
        self.leading.begin((yield from _of(FOLLOWER, self.set_off())))

    @bus_method
    @urgent(Priority.MOTION)
    def step(self) -> RobotJob[TeleopTick | None]:
        """Read the leader, and send the follower its next goals; None once it is over.

        Raises what ended it: all joints of the follower were stopped then.
        """
        if self.over:
            return None
        began: float = yield Now()
        seen = yield from _of(LEADER, jobs.read(self._read, "present_position"))
        held = self.deadman is None or self.deadman()
        states, clamped = self.leading.step(dict(seen), held=held)
        result = yield from _of(FOLLOWER, self.send(states))
        wanted = {name: state.position for name, state in states.items()}
        if not seen.lost:
            wanted = self.leading.wanted(seen)[0]
        ended: float = yield Now()
        return TeleopTick(self.leading.phase, self.leading.why, wanted, result, clamped, ended - began)

    @bus_method
    @urgent(Priority.STOP)
    def end(self, error: BaseException | None = None) -> RobotJob[None]:
        """Let the follower hold where it is, and give its servos their speeds back."""
        return _of(FOLLOWER, self.finish(error, stop=True))


class Teleop(BlockingTurns[TeleopTick], Leadership):
    """A leader and a follower: iterate over it, or `wait`; see the head of this module and `Leadership`."""

    def __init__(
        self, leader: Robot, follower: Robot, joints: Mapping[str, str | Lead] | None = None, **options: Any
    ) -> None:
        self._ports = BlockingPorts(_both(leader, follower))
        super().__init__(self, self._ports.now, leader, follower, joints, **options)

    def do(self, job: RobotJob[T], *, priority: Priority = Priority.READ) -> T:
        """Carry out a job of both robots."""
        return self._ports.do(job, priority)


class AsyncTeleop(AsyncTurns[TeleopTick], Leadership):
    """A leader and a follower of asyncio: iterate over it with `async for`, or await `wait()`."""

    def __init__(
        self,
        leader: "AsyncRobot",
        follower: "AsyncRobot",
        joints: Mapping[str, str | Lead] | None = None,
        **options: Any,
    ) -> None:
        from servobus.robots.asyncio import AsyncPorts  # noqa: PLC0415 - asyncio is slow to import

        self._ports = AsyncPorts(_both(leader, follower))
        super().__init__(self, self._ports.now, leader, follower, joints, **options)

    async def do(self, job: RobotJob[T], *, priority: Priority = Priority.READ) -> T:
        """Carry out a job of both robots."""
        return await self._ports.do(job, priority)


def _leads(leader: AnyRobot, follower: AnyRobot, joints: Mapping[str, str | Lead] | None) -> dict[str, Lead]:
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
