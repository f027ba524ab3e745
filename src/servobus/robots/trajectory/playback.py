"""A trajectory under way, tick by tick: played, slowed down, paused and let go on, within the limits of the joints."""

from collections.abc import Mapping

from servobus.core.arguments import check_above_0
from servobus.core.units import finite, said
from servobus.errors import BadValue
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import State, Trajectory

_SEARCH = 30
"""Halvings of the range in which the next time is sought: to 1e-9 of a tick."""
_ROUNDING = 1e-6
"""Share by which a limit may seem to be exceeded for rounding alone."""


class Playback:
    """Where all joints are at each tick of a motion that may change its pace at any of them.

    tick    s between two steps
    time    how far the motion has come, in s of its own time
    rate    s of its own time for each s that passes: 1 is the pace it was planned for, 0 is a pause
    states  joint -> its state after the last step

    All joints keep to the poses of the motion whatever the pace; only its time runs slower. When the pace changes, the
    limits of acceleration hold for the differences of the positions that are given: each step takes as much of the
    change as they allow. Going on at the same pace always keeps them, since the motion does and is no quicker than
    planned. So a pause comes as soon as it can, and where all joints brake at their limits already, not before that.
    Jerk is not limited while the pace changes.
    """

    def __init__(self, trajectory: Trajectory, limits: Mapping[str, JointLimits], tick: float) -> None:
        """Stand at the start of the motion; the first `step` sets off at rate 1.

        Raises BadValue if the motion itself exceeds the limits: `Trajectory.stretched` and `fitted` mend that.
        """
        self.tick = check_above_0("the tick in s", tick)
        demand = trajectory.demand(limits)
        if demand.factor > 1 + _ROUNDING:
            raise BadValue(f"{demand}: the motion has to take {demand.factor:.3f} times as long")
        self.trajectory = trajectory
        self.time, self.rate = 0.0, 0.0
        self.states = {joint: State(position) for joint, position in trajectory.start.items()}
        self._accelerations = {joint: limits[joint].acceleration * (1 + _ROUNDING) for joint in self.states}
        self._wanted = 1.0

    def set_rate(self, rate: float) -> None:
        """Go over to another pace: 0 to pause, 1 to go on as planned, between them for slow motion.

        Raises BadValue for a rate outside 0 to 1; `Trajectory.slowed` with a factor below 1 makes a motion quicker.
        """
        number = finite(rate)
        if number is None or not 0 <= number <= 1:
            raise BadValue(f"{said(rate)} is no rate of a playback: give 0 (pause) to 1 (as planned)")
        self._wanted = number

    @property
    def paused(self) -> bool:
        """Whether the joints stand because of a pause."""
        return self.rate == self._wanted == 0

    @property
    def finished(self) -> bool:
        """Whether all joints rest at the end of the motion."""
        return self.time >= self.trajectory.duration and not any(one.speed for one in self.states.values())

    def step(self) -> dict[str, State]:
        """Go on by one tick; give and keep the states then. Their speed is that of the tick before."""
        kept, rate = self.rate, self._wanted
        states = self._after(rate)
        if not self._allowed(states):
            refused = rate
            for _ in range(_SEARCH):
                rate = (kept + refused) / 2
                if self._allowed(self._after(rate)):
                    kept = rate
                else:
                    refused = rate
            rate = kept
            states = self._after(rate)
        self.time = min(self.time + rate * self.tick, self.trajectory.duration)
        self.rate, self.states = rate, states
        return dict(states)

    def _after(self, rate: float) -> dict[str, State]:
        time, states = self.time + rate * self.tick, {}
        for joint, path in self.trajectory.paths.items():
            before, position = self.states[joint], path.at(time).position
            speed = (position - before.position) / self.tick
            states[joint] = State(position, speed, (speed - before.speed) / self.tick)
        return states

    def _allowed(self, states: Mapping[str, State]) -> bool:
        return all(abs(one.acceleration) <= self._accelerations[joint] for joint, one in states.items())
