"""Followers: joints on their way to goals that may change at any tick, as in teleoperation.

A follower is asked for the next state of each joint once a tick, and given new goals whenever there are some. It keeps
the limits of each joint whatever the goals do, and a joint comes to rest exactly on its goal.

    follower = BrakingFollower({"shoulder": State(0.0)}, {"shoulder": JointLimits(3.0, 10.0)}, tick=0.01)
    follower.aim({"shoulder": 1.0})
    while not follower.settled:
        send(follower.step())
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping

from servobus.core.arguments import check_above_0
from servobus.errors import UnknownName
from servobus.robots.trajectory.limits import JointLimits, limits_of, number_of
from servobus.robots.trajectory.path import State


class Follower(ABC):
    """What all followers do. They know no time but the tick in s: each `step` is one tick later.

    tick    s between two steps
    limits  joint -> its limits
    states  joint -> where the joint is after the last step
    goals   joint -> where the joint is to come to rest, in rad
    """

    def __init__(self, starts: Mapping[str, State], limits: Mapping[str, JointLimits], tick: float) -> None:
        """Begin at rest or in motion; until `aim` gives goals, each joint comes to rest as `hold` does.

        Raises BadValue for a tick or limits that are no numbers above 0, UnknownName for a joint without limits.
        """
        self.tick = check_above_0("the tick in s", tick)
        self.limits = limits_of(starts, limits)
        self.states = dict(starts)
        self.goals = {joint: number_of(joint, "start", one.position) for joint, one in starts.items()}

    def aim(self, goals: Mapping[str, float]) -> None:
        """Take new goals in rad from the next step on; joints that are not named keep theirs.

        Limits of position are the caller's business: a follower goes wherever it is sent. It does not leave the range
        between its start and its goals, unless it is in motion at the start. Raises UnknownName and BadValue, and then
        changes nothing.
        """
        for joint in goals:
            if joint not in self.states:
                raise UnknownName(f"{joint} is no joint of this follower: use {', '.join(self.states)}")
        self.goals |= {joint: number_of(joint, "goal", goal) for joint, goal in goals.items()}

    @property
    def settled(self) -> bool:
        """Whether all joints rest on their goals."""
        return all(state == State(self.goals[joint]) for joint, state in self.states.items())

    @abstractmethod
    def step(self) -> dict[str, State]:
        """Go on by one tick; give and keep the states then."""

    @abstractmethod
    def hold(self) -> None:
        """Bring all joints to rest as soon as their limits allow, from the next step on: where that is, is the goal."""


class BrakingFollower(Follower):
    """Limits of speed and acceleration. Limits of jerk are left aside: `RuckigFollower` keeps them.

    The speed of a state is that of the tick before it, and the acceleration is how much that speed differs from the
    one before, so the limits hold for differences of the positions that are sent. The law is worked out for ticks: a
    law for continuous time, v = √(2 a e), does not settle at ticks of 10 ms, but swings about its goal.

    With a·dt as unit of speed and a·dt² as unit of length, a joint that goes m in this tick and brakes by 1 from tick
    to tick needs the way D(m) = m + (m-1) + (m-2) + ... as long as the terms are above 0. The joint goes as far as it
    can such that D(m) is at most the way e that is left. For whole m, D(m) = m (m+1) / 2, which gives the law
    m = √(1/4 + 2e) - 1/2; in between, D(m) = (q+1) m - q (q+1) / 2 with q the whole part of m, so the last tick
    neither passes the goal nor brakes harder than allowed. A goal nearer than that is passed, and come back to.
    """

    def __init__(self, starts: Mapping[str, State], limits: Mapping[str, JointLimits], tick: float) -> None:
        super().__init__(starts, limits, tick)
        self.hold()

    def step(self) -> dict[str, State]:
        for joint, state in self.states.items():
            self.states[joint] = self._next(self.limits[joint], state, self.goals[joint])
        return dict(self.states)

    def hold(self) -> None:
        for joint, state in self.states.items():
            unit = self.limits[joint].acceleration * self.tick
            next_speed = max(0.0, abs(state.speed) / unit - 1)
            whole = math.floor(next_speed)
            way = (whole + 1) * next_speed - whole * (whole + 1) / 2
            self.goals[joint] = state.position + math.copysign(way * unit * self.tick, state.speed)

    def _next(self, limits: JointLimits, state: State, goal: float) -> State:
        unit = limits.acceleration * self.tick
        left, before = (goal - state.position) / (unit * self.tick), state.speed / unit
        way = abs(left)
        whole = math.floor(math.sqrt(0.25 + 2 * way) - 0.5)
        reach = min((way + whole * (whole + 1) / 2) / (whole + 1), limits.speed / unit)
        pace = min(max(math.copysign(reach, left), before - 1), before + 1)
        position = state.position + pace * unit * self.tick
        if abs(position - goal) <= _SAME * unit * self.tick + _DIGITS * abs(goal):
            position = goal
        speed = pace * unit
        return State(position, speed, (speed - state.speed) / self.tick)


_SAME = 1e-9
"""Share of a·dt² by which a position may miss the goal for rounding alone."""
_DIGITS = 1e-15
"""As a share of the goal itself."""
