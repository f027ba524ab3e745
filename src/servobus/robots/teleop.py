"""Teleoperation: a limp robot that is moved by hand leads another one, joint by joint, of any mix of families.

    with servobus.robot("leader.toml") as leader, servobus.robot("follower.toml") as follower, follower.torque():
        Teleop(leader, follower).wait()      # or: for tick in teleop: print(tick.phase, tick.why)

With asynchronous robots it is `AsyncTeleop(leader, follower)`.

The leader is only read. The follower is led joint by joint: those of the same name, or as `joints` says. What the
leader asks for is kept within the limits of the follower, and told (`clamped`); the way there keeps its limits of speed
and acceleration. What the follower does when is in servobus.robots.motions.leading.

Who waits for a person's hand needs little delay: `lag` tells how long a tick took from reading the leader to the goal.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from servobus.core.arguments import check_above_0
from servobus.core.exchange import Now
from servobus.core.operation import Priority, bus_method, urgent
from servobus.core.units import deg, finite, said
from servobus.core.values import frozen
from servobus.errors import BadValue, MotionError, UnknownName, UsageError
from servobus.robots.base import BaseRobot
from servobus.robots.blocking import Robot
from servobus.robots.joints import jobs
from servobus.robots.joints.cycle import RobotResult
from servobus.robots.joints.joint import Joint
from servobus.robots.motions.leading import Lead, Leading, Phase
from servobus.robots.motions.stream import Streamed
from servobus.robots.motions.turns import AsyncTurns, BlockingTurns, Seen
from servobus.robots.ports import BlockingPorts, Ports
from servobus.robots.steps import RobotJob, Together

if TYPE_CHECKING:
    from servobus.robots.asyncio import AsyncRobot

T = TypeVar("T")
AnyRobot: TypeAlias = BaseRobot[Any, Any]
LEADER, FOLLOWER = "leader", "follower"
RATE = 50.0
"""Goals a second: more bring 2 to 3 ms less lag with the servos here."""
GATE = 45 * deg
"""rad between leader and follower beyond which the follower does not set off; 0.8 rad as in GELLO's run_env.py."""


@frozen
class TeleopTick(Seen):
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
        ports: Ports[Any],
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
        self._ports = ports  # those of both robots
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
        states = (yield from _of(LEADER, jobs.look(self._read))).complete()
        if stiff := [name for name, state in states.items() if not state.limp]:
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
        super().__init__(BlockingPorts(_both(leader, follower)), leader, follower, joints, **options)


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

        super().__init__(AsyncPorts(_both(leader, follower)), leader, follower, joints, **options)


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
