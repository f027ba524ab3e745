"""Goals at the rate of somebody else: each is gone to within the limits of speed and acceleration of the joints."""

from collections.abc import Mapping
from typing import Any

from servobus.core.operation import Priority
from servobus.robots.blocking import Robot
from servobus.robots.motions.stream import Streamed
from servobus.robots.motions.supervision import LOST
from servobus.robots.trajectory.follower import BrakingFollower
from servobus.robots.trajectory.path import State

RATE = 30.0
"""Goals a second that LeRobot gives, more or less: servos that are told a time for their way are told this one."""
SOONEST, LATEST = 0.001, 0.1
"""s between two goals, as far as it is taken into account: after a longer time a joint goes on as after this one."""


class Driving:
    """Leads all joints of a robot, from the first goals on: then their torque is switched on, where they stand."""

    def __init__(self, arm: Robot) -> None:
        self.arm, self.joints = arm, list(arm)
        self.driven = False
        """Whether the torque was switched on here."""
        self._stream: Streamed[Any] | None = None
        self._follower: BrakingFollower | None = None
        self._last = 0.0

    def lead(self, goals: Mapping[str, float]) -> dict[str, float]:
        """Go on towards these goals, joint -> angle in rad, and give where these joints are sent now.

        Raises what ended the motion: a joint that is silent, held or without torque. All joints were stopped then, and
        the next goals set off from where they are.
        """
        if self._stream is not None and self.arm.ports.now() - self._last > LOST:
            self._end(None, stop=False)  # nobody looked meanwhile: set off anew
        if self._stream is None or self._follower is None:
            self._begin()
        stream, follower = self._stream, self._follower
        assert stream is not None
        assert follower is not None
        now = self.arm.ports.now()
        follower.tick = min(max(now - self._last, SOONEST), LATEST)
        self._last = now
        follower.aim(goals)
        sent = {}
        states = follower.step()
        for joint in self.joints:
            low, high = joint.limits
            state = states[joint.name]
            sent[joint.name] = State(min(max(state.position, low), high), state.speed, state.acceleration)
        try:
            self.arm.do(stream.send(sent), priority=Priority.MOTION)
        except BaseException as error:
            self._end(error, stop=True)
            raise
        return {name: sent[name].position for name in goals}

    def end(self, *, release: bool) -> None:
        """Stop and make safe; with `release` go to the pose `rest` of the file, if there is one, and go limp."""
        if not self.driven:
            return
        try:
            if self._stream is not None:
                self._end(None, stop=True)
            else:
                self.arm.stop()
            if release and (rest := self.arm.file.robot.rest) is not None:
                self.arm.move(self.arm.pose(rest)).wait()
        except BaseException:
            self.arm.make_safe()
            raise
        if release:
            self.arm.torque_off()
        else:
            self.arm.make_safe()

    def _begin(self) -> None:
        self.arm.torque_on()
        self.driven = True
        stream = self._stream = Streamed(self.arm.ports, self.joints, RATE)
        try:
            start = self.arm.do(stream.set_off(), priority=Priority.MOTION)
        except BaseException as error:
            self._end(error, stop=True)
            raise
        self._follower = BrakingFollower({name: State(angle) for name, angle in start.items()}, stream.limits, LATEST)
        self._last = self.arm.ports.now()

    def _end(self, error: BaseException | None, *, stop: bool) -> None:
        """Give the servos back what streaming took, after all joints were stopped if that is asked for."""
        stream, self._stream, self._follower = self._stream, None, None
        if stream is not None:
            self.arm.do(stream.finish(error, stop=stop), priority=Priority.STOP if stop else Priority.MOTION)
