"""New goals in flight, for programs that decide at each turn where joints are to go: by a camera, or a policy.

    with arm.torque():
        follow = arm.follow("shoulder", "elbow")
        for tick in follow:
            follow.aim(shoulder=seen_angle())
            if done():
                follow.stop()

Goals may jump: the joints go there within their limits of speed and acceleration, and come to rest on the last goal.
Joints are watched as those of a motion that is played are: who falls silent, loses its torque or stays behind ends it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from servobus.core.operation import Priority, bus_method, urgent
from servobus.core.values import frozen
from servobus.robots.joints.cycle import RobotResult
from servobus.robots.joints.joint import Joint
from servobus.robots.motions.stream import Streamed
from servobus.robots.motions.turns import AsyncTurns, BlockingTurns, Seen
from servobus.robots.ports import Ports
from servobus.robots.steps import RobotJob
from servobus.robots.trajectory.follower import BrakingFollower, Follower
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import State
from servobus.robots.values import named_angles


@frozen
class FollowTick(Seen):
    """One turn.

    goals    joint -> what it was sent last, rad: a point on the way to where it was told to go
    result   what was read, by joint
    settled  whether all joints were sent to rest where they were told to go
    """

    goals: Mapping[str, float]
    result: RobotResult
    settled: bool


class Follow(Streamed[FollowTick]):
    """Joints that follow goals; see the head of this module.

    rate  goals a second
    jerk  rad/s³, for joints of which the robot file says none: with it their jerk is limited too, which needs ruckig
    """

    def __init__(self, ports: Ports[Any], joints: Sequence[Joint], rate: float, jerk: float | None) -> None:
        super().__init__(ports, joints, rate)
        self._smooth = jerk is not None
        if self._smooth:
            self.limits = {
                name: JointLimits(one.speed, one.acceleration, one.jerk or jerk) for name, one in self.limits.items()
            }
        self._follower = self._made({name: 0.0 for name in self.limits})  # noqa: C420 - so what it lacks is told now
        self._aimed: dict[str, float] = {}
        self._stopping = self._holding = False

    def aim(self, goals: Any = None, /, **angles: float) -> None:
        """Send joints somewhere else from the next turn on: name -> angle in rad, or keywords; others go on.

        Raises BadValue outside the limits of a joint, UnknownName for one that does not follow; then nothing changes.
        """
        named = named_angles(goals, [joint.name for joint in self.joints], angles)
        by_name = {joint.name: joint for joint in self.joints}
        self._aimed |= {name: by_name[name].check(angle) for name, angle in named.items()}

    def stop(self) -> None:
        """Come to rest as soon as the limits allow, and end there."""
        self._stopping = True

    @bus_method
    @urgent(Priority.MOTION)
    def begin(self) -> RobotJob[None]:
        """Make sure that all joints have torque. They stand until they are given goals."""
        self._follower = self._made((yield from self.set_off()))

    @bus_method
    @urgent(Priority.MOTION)
    def step(self) -> RobotJob[FollowTick | None]:
        """Send the next goals and read all joints; None once it has ended."""
        if self.over:
            return None
        aimed, self._aimed = self._aimed, {}
        if self._stopping and not self._holding:
            self._follower.hold()
            self._holding = True
        elif not self._stopping:
            self._follower.aim(aimed)
        states = self._follower.step()
        settled = self._follower.settled
        result = yield from self.send(states)
        self.over = self._stopping and settled and self.arrived(states)
        return FollowTick({name: self.sent[name] for name in states}, result, settled)

    @bus_method
    @urgent(Priority.MOTION)
    def end(self, error: BaseException | None = None) -> RobotJob[None]:
        """Give the servos their speeds back; after an error stop all joints first."""
        return self.finish(error, stop=False)

    def _made(self, here: Mapping[str, float]) -> Follower:
        kind: type[Follower] = BrakingFollower
        if self._smooth:
            from servobus.robots.trajectory.online import RuckigFollower as kind  # noqa: N813, PLC0415 - an extra
        return kind({name: State(angle) for name, angle in here.items()}, self.limits, self.period)


class BlockingFollow(BlockingTurns[FollowTick], Follow):
    """Joints of a blocking robot that follow goals: iterate over it."""


class AsyncFollow(AsyncTurns[FollowTick], Follow):
    """Joints of an asynchronous robot that follow goals: iterate over it with `async for`."""
