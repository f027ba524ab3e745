"""Protection of joints: heat and stalls of their servos by the thresholds of each joint, and pairs that disagree.

A pair is one joint: where one of its servos is made safe, so is the other.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from servobus.bus.protection import Protection
from servobus.bus.servo import Servo
from servobus.core.exchange import Procedure, SetBaud
from servobus.errors import BusError, Disagreement, ServobusError, UsageError
from servobus.jobs.make_safe import make_safe
from servobus.robots.joints import jobs
from servobus.robots.joints.joint import Joint, Part
from servobus.robots.steps import RobotJob, each
from servobus.robots.values import ByJoint

if TYPE_CHECKING:
    from servobus.safety.overload import Level


class Protections:
    """The monitors of the servos of a robot."""

    def __init__(self, joints: Sequence[Joint]) -> None:
        self._joints = list(joints)
        self._of: dict[Servo, Protection[Servo]] = {part.servo: Protection() for one in joints for part in one.parts}

    def look(self) -> "RobotJob[ByJoint[Level]]":
        """Look at each joint once, judge it, and act; see `Robot.protect`."""
        apart = yield from self._stop_disagreeing()
        outcomes = yield from each(jobs.on_each_port(self._joints, self._look_all))
        levels: dict[str, Level] = {}
        lost: dict[str, ServobusError] = {}
        for joint in self._joints:
            found = [_of_part(outcomes[part.port], part) for part in joint.parts]
            errors = [one for one in found if isinstance(one, ServobusError)]
            if errors:
                lost[joint.name] = errors[0]
            else:
                levels[joint.name] = max(one for one in found if not isinstance(one, ServobusError))
        yield from self._both_or_none(outcomes)
        if apart is not None:
            raise apart
        return ByJoint(levels, lost)

    def _look_all(self, parts: Sequence[Part]) -> "Procedure[dict[Servo, Level | ServobusError]]":
        """Look at the servos of a port, by the thresholds of their joints."""
        bounds = {part.servo: joint.entry.thresholds for joint in self._joints for part in joint.parts}
        found: dict[Servo, Level | ServobusError] = {}
        for part in parts:
            try:
                found[part.servo] = (yield from self._of[part.servo].look([part.servo], bounds[part.servo]))[part.servo]
            except (BusError, UsageError) as error:
                found[part.servo] = error
        return found

    def _both_or_none(
        self, outcomes: "Mapping[str, Mapping[Servo, Level | ServobusError] | ServobusError]"
    ) -> RobotJob[None]:
        """Make the second servo of a pair safe where the first was, and the other way round."""
        from servobus.safety.overload import Level  # noqa: PLC0415 - only some programs need it

        torn = [
            joint
            for joint in self._joints
            if len(joint.parts) > 1 and any(_of_part(outcomes[part.port], part) is Level.SAFE for part in joint.parts)
        ]
        yield from each(jobs.on_each_port(torn, _make_safe_all))

    def _stop_disagreeing(self) -> RobotJob[Disagreement | None]:
        """Stop each pair whose servos disagree; gives the first Disagreement."""
        first: Disagreement | None = None
        for joint in self._joints:
            if len(joint.parts) > 1:
                try:
                    yield from jobs.read([joint], "present_position")
                except Disagreement as error:
                    first = first or error
                    yield from jobs.stop([joint])
        return first


def _of_part(outcome: "Mapping[Servo, Level | ServobusError] | ServobusError", part: Part) -> "Level | ServobusError":
    return outcome if isinstance(outcome, ServobusError) else outcome[part.servo]


def _make_safe_all(parts: Sequence[Part]) -> Procedure[None]:
    for part in parts:
        target = part.servo.target
        if target.permit.driven:
            yield SetBaud(target.baud)
            yield from make_safe(target, target.permit.safe_action or "hold")
