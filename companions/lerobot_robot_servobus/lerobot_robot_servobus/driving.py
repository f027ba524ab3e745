"""Goals at the rate of somebody else: each is gone to within the limits of speed and acceleration of the joints."""

from collections.abc import Mapping

from servobus import ServobusError
from servobus.bus.servo import Servo
from servobus.core.operation import Priority
from servobus.robots import jobs, stream
from servobus.robots.blocking import Robot
from servobus.robots.cycle import RobotCycle
from servobus.robots.motion import limits_of
from servobus.robots.supervision import LOST, Supervision
from servobus.robots.trajectory.follower import BrakingFollower
from servobus.robots.trajectory.path import State

SOONEST, LATEST = 0.001, 0.1
"""s between two goals, as far as it is taken into account: after a longer pause a joint goes on as after this one."""


class Driving:
    """Leads all joints of a robot, from the first goals on: then their torque is switched on, where they stand."""

    def __init__(self, arm: Robot) -> None:
        self.arm, self.joints = arm, list(arm)
        self.driven = False
        """Whether the torque was switched on here."""
        self._limits = {joint.name: limits_of(joint) for joint in self.joints}
        self._cycle = RobotCycle(arm.ports, self.joints, "present_position", 0.0)
        self._supervision = Supervision(self.joints)
        self._had: dict[Servo, int] = {}
        self._follower: BrakingFollower | None = None
        self._last = 0.0

    def lead(self, goals: Mapping[str, float]) -> dict[str, float]:
        """Go on towards these goals, joint -> angle in rad, and give where these joints are sent now.

        Raises what ended the motion: a joint that is silent, held or without torque. All joints were stopped then, and
        the next goals set off from where they are.
        """
        follower = self._follower or self._begin()
        now = self.arm.ports.now()
        since, self._last = now - self._last, now
        if since > LOST:  # nobody looked meanwhile, so nothing is known of it
            self.arm.do(self._supervision.begin(), priority=Priority.MOTION)
        follower.tick = min(max(since, SOONEST), LATEST)
        follower.aim(goals)
        states = follower.step()
        sent = {}
        for joint in self.joints:
            low, high = joint.limits
            sent[joint.name] = min(max(states[joint.name].position, low), high)
        try:
            seen = self.arm.do(self._cycle.turn(sent), priority=Priority.MOTION)
            self.arm.do(self._supervision.watch(states, seen), priority=Priority.MOTION)
        except BaseException as error:
            try:
                self._stop()
            except ServobusError as failure:
                error.add_note(str(failure))
            raise
        return {name: sent[name] for name in goals}

    def end(self, *, release: bool) -> None:
        """Stop and make safe; with `release` go to the pose `rest` of the file, if there is one, and go limp."""
        if not self.driven:
            return
        try:
            self._stop()
            if release and (rest := self.arm.file.robot.rest) is not None:
                self.arm.move(self.arm.pose(rest)).wait()
        except BaseException:
            self.arm.make_safe()
            raise
        if release:
            self.arm.torque_off()
        else:
            self.arm.make_safe()

    def _begin(self) -> BrakingFollower:
        self.arm.torque_on()
        self.driven = True
        self._had = self.arm.do(stream.begin(self.joints), priority=Priority.MOTION)
        start = self.arm.do(stream.where(self.joints), priority=Priority.MOTION)
        self.arm.do(self._supervision.begin(), priority=Priority.MOTION)
        self._last = self.arm.ports.now()
        self._follower = BrakingFollower({name: State(angle) for name, angle in start.items()}, self._limits, LATEST)
        return self._follower

    def _stop(self) -> None:
        """Stop all joints where they are, and give their servos back what streaming took."""
        self._follower = None
        try:
            self.arm.do(jobs.stop(self.joints), priority=Priority.STOP)
        finally:
            self.arm.do(stream.end(self.joints, self._had), priority=Priority.MOTION)
            self._had = {}
