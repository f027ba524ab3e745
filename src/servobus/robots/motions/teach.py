"""Teaching: limp joints are moved by hand, and where they were is kept.

    teach = arm.teach("shoulder", "elbow", keep="wave.raw.csv")
    for tick in teach:
        print(tick.positions)
        if key == " ":
            teach.mark()             # keeps a pose
        if key == "q":
            teach.stop()
    motion = teach.motion()          # all that was recorded: teach.kept() tells what was lost
    motion = teach.steps()           # or the poses alone

The joints that are named go limp as it begins, and stay so; a limp arm falls, so hold it. All others stay as they are.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from servobus.core.operation import Priority, bus_method, urgent
from servobus.core.units import deg
from servobus.core.values import frozen
from servobus.errors import MotionError, ServobusError, UsageError
from servobus.robots.joints import jobs
from servobus.robots.joints.cycle import RobotCycle, RobotResult
from servobus.robots.joints.joint import Joint
from servobus.robots.motions.motion import Motion, limits_of
from servobus.robots.motions.recording import Moment, Recorder, recorder
from servobus.robots.motions.thinning import TOLERANCE, Kept, kept
from servobus.robots.motions.turns import AsyncTurns, BlockingTurns, Seen, Turns
from servobus.robots.ports import Ports
from servobus.robots.steps import RobotJob

RATE = 50.0
"""Readings a second, if nothing else is said."""
SILENT = 2.0
"""s without an answer of a joint after which the recording ends."""
STEP_SPEED, STEP_TIME = 45 * deg, 0.5
"""rad/s at most from one marked pose to the next, and s at least; *assumption*: unhurried, as on the way there."""


@frozen
class TeachTick(Seen):
    """One turn: `time` is s since the first reading."""

    time: float
    result: RobotResult


class Teach(Turns[TeachTick]):
    """A recording under way; see the head of this module.

    joints   those that are recorded
    moments  what was read, turn by turn
    poses    the poses that were marked: joint -> angle, rad
    keep     the file that each reading is written to as it comes; None for none
    """

    def __init__(
        self, ports: Ports[Any], joints: Sequence[Joint], rate: float, keep: Path | None, *, named: bool
    ) -> None:
        super().__init__(ports, rate)
        self.joints = list(joints)
        self.moments: list[Moment] = []
        self.poses: list[dict[str, float]] = []
        self.keep = keep
        self._named = named
        self._recorder: Recorder | None = None
        self._cycle: RobotCycle | None = None
        self._began = 0.0
        self._seen: dict[str, float] = {}

    def stop(self) -> None:
        """End the recording; the joints stay limp."""
        self.over = True

    def mark(self) -> Mapping[str, float]:
        """Keep the pose that was read last, and give it: joint -> angle, rad.

        No pose is kept, and UsageError raised, where nothing is read yet, or where a joint did not answer in this turn;
        BadValue where a joint is outside its limits.
        """
        if not self.moments:
            raise UsageError("nothing has been read yet, so there is no pose to mark")
        pose = dict(self.moments[-1].positions)
        if lost := [joint.name for joint in self.joints if joint.name not in pose]:
            raise UsageError(f"{', '.join(lost)} did not answer just now, so this pose was not kept; mark it again")
        pose = {joint.name: joint.check(pose[joint.name]) for joint in self.joints}
        self.poses.append(pose)
        return pose

    def kept(self, tolerance: float = TOLERANCE) -> Kept:
        """Make a motion of all readings, thinned within a tolerance, rad; see servobus.robots.motions.thinning."""
        return kept(self.moments, self.joints, tolerance)

    def motion(self, tolerance: float = TOLERANCE) -> Motion:
        """Make a motion of all readings; `kept` tells what was lost."""
        return self.kept(tolerance).motion

    def steps(self) -> Motion:
        """Make a motion of the marked poses, each reached as long after the one before as an unhurried way takes."""
        return motion_of_poses(self.poses, self.joints)

    # Steps, written once for both drivers

    @bus_method
    @urgent(Priority.MOTION)
    def begin(self) -> RobotJob[None]:
        """Let the joints go limp that were named; where none was, find those that are.

        Raises MotionError if none is limp, and what kept a joint from going limp: then nothing is recorded.
        """
        if not self._named:
            states = yield from jobs.look(self.joints)
            self.joints = [joint for joint in self.joints if states[joint.name].limp]
            if not self.joints:
                raise MotionError("all joints have torque, so nobody could move them: name those that are to go limp")
        self._cycle = RobotCycle(self._ports, self.joints, "present_position", self.period)
        if self.keep is not None:
            self._recorder = recorder(self.keep, [joint.name for joint in self.joints])
        if self._named:
            yield from jobs.torque_off(self.joints)

    @bus_method
    def step(self) -> RobotJob[TeachTick | None]:
        """Read all joints; None once it has ended. Raises if a joint is silent for SILENT s."""
        if self.over or self._cycle is None:
            return None
        result = yield from self._cycle.turn({})
        moment = sum(result.times.values()) / len(result.times)
        if not self._seen:
            self._began, self._seen = moment, {joint.name: moment for joint in self.joints}
        read = Moment(moment - self._began, dict(result.positions), {})
        if not self.moments or read.time > self.moments[-1].time:
            self.moments.append(read)
            if self._recorder is not None:
                self._recorder.write(read)
        for name in self._seen:
            if name not in result.lost:
                self._seen[name] = moment
            elif moment - self._seen[name] > SILENT:
                raise self._silent(name, result.lost[name])
        return TeachTick(read.time, result)

    @bus_method
    def end(self, error: BaseException | None = None) -> RobotJob[None]:  # noqa: ARG002 - the joints stay limp anyhow
        """Close the file. The joints stay limp."""
        self.over = True
        if self._recorder is not None:
            self._recorder.close()
        yield from ()

    def _silent(self, name: str, error: ServobusError) -> ServobusError:
        where = f"; what was recorded until then is in {self.keep}" if self.keep is not None else ""
        error.args = (f"{name} does not answer any more, so the recording has ended{where} ({error})", *error.args[1:])
        return error


def motion_of_poses(poses: Sequence[Mapping[str, float]], joints: Sequence[Joint]) -> Motion:
    """Give the motion through marked poses. Raises UsageError for fewer than two, BadValue outside the limits."""
    if len(poses) < 2:
        raise UsageError(f"a motion has at least two poses, and {len(poses) or 'none'} was marked")
    if lost := [joint.name for joint in joints if any(joint.name not in pose for pose in poses)]:
        raise UsageError(f"{', '.join(lost)} did not answer at one of the poses; leave that pose out")
    times = [0.0]
    for before, after in pairwise(poses):
        need = max(
            abs(after[joint.name] - before[joint.name]) / min(STEP_SPEED, limits_of(joint).speed) for joint in joints
        )
        times.append(round(times[-1] + max(STEP_TIME, need), 2))
    return Motion(
        tuple(times), {joint.name: tuple(joint.check(pose[joint.name]) for pose in poses) for joint in joints}
    )


class BlockingTeach(BlockingTurns[TeachTick], Teach):
    """A recording by a blocking robot: iterate over it."""


class AsyncTeach(AsyncTurns[TeachTick], Teach):
    """A recording by an asynchronous robot: iterate over it with `async for`."""
