"""Joints under way: which of them is silent, has no torque any more, or stays behind its goal.

A joint that does not answer for LOST, or that stays behind its goal for STALL, ends the motion of all.
"""

from collections.abc import Mapping, Sequence

from servobus.core.exchange import Now
from servobus.core.units import deg, show
from servobus.errors import ServobusError, Stopped, TorqueOff
from servobus.robots import jobs
from servobus.robots.cycle import RobotResult
from servobus.robots.joint import Joint
from servobus.robots.steps import RobotJob
from servobus.robots.trajectory.path import State

LOST = 0.25
"""s without an answer of a joint after which all stop."""
BEHIND, LAG = 12 * deg, 0.15
"""A joint stays behind if it is farther from its goal than BEHIND and than it goes in LAG s; *assumption*: three times
what unloaded servos lag behind at 94°/s."""
STALL = 0.5
"""s for which a joint may stay behind."""


class Supervision:
    """Watches joints that are given goals at a fixed rate."""

    def __init__(self, joints: Sequence[Joint]) -> None:
        self.joints = list(joints)
        self._seen: dict[str, float] = {}
        """Joint -> when it was seen last."""
        self._near: dict[str, float] = {}
        """Joint -> when it was near its goal last."""

    def begin(self) -> RobotJob[None]:
        """Begin to watch now."""
        now: float = yield Now()
        self._seen = {joint.name: now for joint in self.joints}
        self._near = dict(self._seen)

    def watch(self, states: Mapping[str, State], result: RobotResult) -> RobotJob[None]:
        """Compare what was read with the goals that were sent. Raises what ends the motion."""
        now: float = yield Now()
        for joint in self.joints:
            name = joint.name
            if name in result.lost:
                if now - self._seen[name] > LOST:
                    raise _silent(name, result.lost[name])
                continue
            self._seen[name] = now
            behind = abs(states[name].position - result[name]["present_position"])
            if behind <= max(BEHIND, abs(states[name].speed) * LAG):
                self._near[name] = now
            elif now - self._near[name] > STALL:
                raise (yield from _why(joint, behind))


def _silent(name: str, error: ServobusError) -> ServobusError:
    """Say in an error of the line which joint it is about, and what was done."""
    error.args = (f"{name} does not answer any more; all joints of the motion were stopped ({error})", *error.args[1:])
    return error


def _why(joint: Joint, behind: float) -> RobotJob[ServobusError]:
    """Tell why a joint stays behind its goal: no torque any more, or something holds it."""
    state = (yield from jobs.look([joint]))[joint.name]
    if not state.torque:
        why = f" ({state.shutdown})" if state.shutdown else ": it restarted, or its torque was switched off"
        return TorqueOff(f"{joint.name} has no torque any more{why}; all joints of the motion were stopped")
    return Stopped(
        f"{joint.name} stays {show(behind, 'rad')} behind its goal at {show(state.position, 'rad')}: something holds "
        "it, or its load is too heavy for this motion; all joints of the motion were stopped"
    )
