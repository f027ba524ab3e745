"""Joints under way: which of them is silent, has no torque any more, or stays behind its goal.

A joint that does not answer for LOST, that has lost its torque, that stays behind its goal for STALL, or that is seen
where nothing can have brought it, ends the motion of all.

A joint that is silent is given no goals: it may be restarting, and a Dynamixel servo that has restarted goes to its
next goal at full speed, from wherever it has sunk to. So its torque is looked at before it is given goals again. The
same holds for joints that nobody has looked at for UNSEEN, because turns are that long or one of them came late.
"""

from collections.abc import Mapping, Sequence

from servobus.core.exchange import Now
from servobus.core.units import deg, show
from servobus.errors import ServobusError, Stopped, TorqueOff
from servobus.robots.joints import jobs
from servobus.robots.joints.cycle import RobotResult
from servobus.robots.joints.jobs import JointState
from servobus.robots.joints.joint import Joint
from servobus.robots.steps import RobotJob
from servobus.robots.trajectory.path import State

LOST = 0.25
"""s without an answer of a joint after which all stop; where turns are long, as long as PATIENCE of them."""
PATIENCE = 2.5
"""Turns: one reply that is lost ends no motion."""
BEHIND, LAG = 12 * deg, 0.15
"""A joint stays behind if it is farther from its goal than BEHIND and than it goes in a turn and LAG s; *assumption*:
three times what unloaded servos lag behind at 94°/s."""
UNSEEN = 0.1
"""s after which a joint may have restarted without anybody noticing; *assumption*: no servo starts more quickly. An
option of the virtual servos says how long theirs take."""
STALL = 0.5
"""s for which a joint may stay behind."""
JUMP, FASTEST = 12 * deg, 1500 * deg
"""A joint has jumped if it is seen farther from where it was than JUMP and than it goes at FASTEST rad/s; *assumption*:
neither a servo nor a hand turns it so quickly, so another servo answers, or a cable is loose."""


def jumped(before: float, after: float, seconds: float) -> bool:
    """Tell whether nothing can have turned a joint from one angle to another in this time."""
    return abs(after - before) > max(JUMP, FASTEST * seconds)


class Supervision:
    """Watches joints that are given goals at a fixed rate, `period` in s."""

    def __init__(self, joints: Sequence[Joint], period: float) -> None:
        self.joints = list(joints)
        self._lost, self._lag = max(LOST, PATIENCE * period), LAG + period
        self._seen: dict[str, float] = {}
        """Joint -> when it was seen last."""
        self._near: dict[str, float] = {}
        """Joint -> when it was near its goal last."""
        self._last: dict[str, float] = {}
        """Joint -> where it was seen last, rad."""
        self.silent: set[str] = set()
        """Joints that did not answer in the last turn."""
        self.behind: set[str] = set()
        """Joints that were farther than BEHIND from their goal when they were seen last."""

    def begin(self) -> RobotJob[None]:
        """Begin to watch now."""
        now: float = yield Now()
        self._seen = {joint.name: now for joint in self.joints}
        self._near = dict(self._seen)
        self._last, self.silent, self.behind = {}, set(), set()

    def look(self) -> RobotJob[None]:
        """Look at the torque of joints that nobody has looked at for long. Raises TorqueOff."""
        now: float = yield Now()
        unseen = [one for one in self.joints if one.name not in self.silent and now - self._seen[one.name] > UNSEEN]
        if unseen:
            states = yield from jobs.look(unseen)
            self.silent |= set(states.lost)
            for name, state in states.items():
                _check_torque(name, state)

    def watch(self, states: Mapping[str, State], result: RobotResult) -> RobotJob[None]:
        """Compare what was read with the goals that were sent. Raises what ends the motion."""
        now: float = yield Now()
        for joint in self.joints:
            name = joint.name
            if name in result.lost:
                if now - self._seen[name] > self._lost:
                    raise _silent(name, result.lost[name])
                continue
            here = result[name]["present_position"]
            if jumped(self._last.get(name, here), here, now - self._seen[name]):
                raise Stopped(
                    f"{name} was seen at {show(self._last[name], 'rad')} and at once at {show(here, 'rad')}: another "
                    "servo answers in its place, or a cable is loose; all joints of the motion were stopped"
                )
            if name in self.silent:
                _check_torque(name, (yield from jobs.look([joint]))[name])
            self._seen[name], self._last[name] = now, here
            behind = abs(states[name].position - here)
            if behind <= max(BEHIND, abs(states[name].speed) * self._lag):
                self._near[name] = now
                self.behind.discard(name)
                continue
            self.behind.add(name)
            if now - self._near[name] > STALL:
                _check_torque(name, (yield from jobs.look([joint]))[name])
                raise Stopped(
                    f"{name} stays {show(behind, 'rad')} behind its goal at {show(here, 'rad')}: something holds it, "
                    "or its load is too heavy for this motion; all joints of the motion were stopped"
                )
        self.silent = set(result.lost)


def _silent(name: str, error: ServobusError) -> ServobusError:
    """Say in an error of the line which joint it is about, and what was done."""
    error.args = (f"{name} does not answer any more; all joints of the motion were stopped ({error})", *error.args[1:])
    return error


def _check_torque(name: str, state: JointState) -> None:
    """Raise TorqueOff if a joint has no torque any more."""
    if not state.torque:
        why = f" ({state.shutdown})" if state.shutdown else ": it restarted, or its torque was switched off"
        raise TorqueOff(f"{name} has no torque any more{why}; all joints of the motion were stopped")
