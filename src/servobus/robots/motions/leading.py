"""Leading by hand: what a follower does as a leader is moved, without a port and without a clock.

WAITING     the robots are too far apart at the start: it begins when each joint is within the gate
STARTING    the follower comes slowly to where the leader is
FOLLOWING   the follower follows
HOLDING     the follower stands: the leader does not answer, a joint of it jumped as no hand can turn it, or the
deadman is not held. From here it starts anew
"""

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

from servobus.core.units import deg, show
from servobus.robots.motions.supervision import jumped
from servobus.robots.trajectory.follower import BrakingFollower
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import State

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
