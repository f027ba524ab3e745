"""New goals in flight under limits of jerk. Needs ruckig, an extra: `pip install "servobus[ruckig]"`.

The community edition of ruckig sends whatever has intermediate positions to a server, and ignores limits of position
without a word. Neither is used here: each step plans from the present state to one goal, on this computer alone.
"""

from collections.abc import Mapping
from typing import Any

from servobus.errors import BadValue, MotionError, UsageError
from servobus.robots.trajectory.follower import Follower
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import CLOSE, State


class RuckigFollower(Follower):
    """A follower that keeps limits of speed, acceleration and jerk; each joint goes as quickly as it can.

    Each joint needs a limit of jerk. Raises UsageError, with the name of the extra, where ruckig is not installed.
    """

    def __init__(self, starts: Mapping[str, State], limits: Mapping[str, JointLimits], tick: float) -> None:
        super().__init__(starts, limits, tick)
        for joint, one in self.limits.items():
            if one.jerk is None:
                raise BadValue(f"{joint} has no limit of jerk: give one in rad/s³, or take the BrakingFollower")
        try:
            import ruckig  # noqa: PLC0415 - an extra
        except ImportError:
            raise UsageError('limits of jerk in flight need ruckig: pip install "servobus[ruckig]"') from None
        self._ruckig: Any = ruckig
        count = len(self.states)
        self._planner, self._output, self._input = (
            ruckig.Ruckig(count, self.tick),
            ruckig.OutputParameter(count),
            ruckig.InputParameter(count),
        )
        self._input.synchronization = ruckig.Synchronization.No
        self._input.max_velocity = [one.speed for one in self.limits.values()]
        self._input.max_acceleration = [one.acceleration for one in self.limits.values()]
        self._input.max_jerk = [one.jerk for one in self.limits.values()]
        self._input.current_position = [one.position for one in self.states.values()]
        self._input.current_velocity = [one.speed for one in self.states.values()]
        self._input.current_acceleration = [one.acceleration for one in self.states.values()]
        self._braking = set[str]()
        self.hold()

    def aim(self, goals: Mapping[str, float]) -> None:
        super().aim(goals)
        self._braking -= goals.keys()

    def hold(self) -> None:
        self._braking = set(self.states)
        way = self._ruckig.Trajectory(len(self.states))
        self._set_goals()
        self._check(self._planner.calculate(self._input, way))
        positions, _, _ = way.at_time(way.duration)
        self.goals = dict(zip(self.states, positions, strict=True))

    def step(self) -> dict[str, State]:
        """Go on by one tick. Raises MotionError if ruckig finds no way; then the states are what they were."""
        self._set_goals()
        self._check(self._planner.update(self._input, self._output))
        self._output.pass_to_input(self._input)
        reached = zip(self._output.new_position, self._output.new_velocity, self._output.new_acceleration, strict=True)
        for joint, (position, speed, acceleration) in zip(self.states, reached, strict=True):
            goal = self.goals[joint]
            rests = abs(position - goal) < CLOSE and abs(speed) < CLOSE and abs(acceleration) < CLOSE
            self.states[joint] = State(goal) if rests else State(position, speed, acceleration)
        return dict(self.states)

    def _set_goals(self) -> None:
        """Tell ruckig where each joint goes; one that brakes is to lose its speed, wherever that is."""
        ways = self._ruckig.ControlInterface
        self._input.per_dof_control_interface = [
            ways.Velocity if joint in self._braking else ways.Position for joint in self.states
        ]
        self._input.target_position = list(self.goals.values())

    def _check(self, result: Any) -> None:
        if result < 0:
            raise MotionError(f"ruckig finds no way to {self.goals}: {result.name}; the joints go no further")
