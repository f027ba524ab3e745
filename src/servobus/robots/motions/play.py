"""Motions played: goals of all joints sent at a fixed rate, and their positions watched.

    with arm.torque():
        play = arm.play("wave")
        play.wait()                          # or: for tick in play: print(tick.positions)

The arm first goes slowly to where the motion begins. Goals go out while `wait` waits, or while one iterates; `pause`,
`resume`, `set_pace` and `stop` may be called meanwhile, from other threads too. All of them keep the limits of speed
and acceleration of each joint.

A joint that does not answer, that lost its torque, or that stays behind its goal ends the motion, see
servobus.robots.motions.supervision: all joints stop where they are, and the error says which joint it was.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from servobus.core.operation import Priority, bus_method, urgent
from servobus.core.units import deg, show
from servobus.core.values import frozen
from servobus.errors import BadValue
from servobus.robots.joints.cycle import RobotResult
from servobus.robots.joints.joint import Joint
from servobus.robots.motions.motion import Motion, check_known
from servobus.robots.motions.stream import Streamed
from servobus.robots.motions.turns import AsyncTurns, BlockingTurns, Seen
from servobus.robots.ports import Ports
from servobus.robots.steps import RobotJob
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import Trajectory
from servobus.robots.trajectory.playback import Playback
from servobus.robots.trajectory.profile import synchronised

RATE = 100.0
"""Goals a second, if nothing else is said. More bring 2 to 3 ms less lag with the servos here."""
APPROACH = 45 * deg
"""rad/s at most on the way to the first pose; *assumption*: slow enough that a person can step back."""


@frozen
class PlayTick(Seen):
    """One turn of a motion under way.

    time       s of the motion's own time; negative on the way to its first pose
    goals      joint -> goal that it was sent last, rad; a joint that is silent is sent none
    result     what was read, by joint
    """

    time: float
    goals: Mapping[str, float]
    result: RobotResult


class Play(Streamed[PlayTick]):
    """A motion that is played; see the head of this module.

    joints   those of the robot
    motion   what is played; joints that it does not name stay as they are
    rate     goals a second
    """

    def __init__(
        self, ports: Ports[Any], joints: Sequence[Joint], motion: Motion | Trajectory, rate: float, *, loop: bool | None
    ) -> None:
        if isinstance(motion, Motion):
            check_known(motion, joints)
        names = motion.poses if isinstance(motion, Motion) else motion.paths
        super().__init__(ports, [joint for joint in joints if joint.name in names], rate)
        if isinstance(motion, Motion):
            fit = motion.fitted(self.joints)
            self.trajectory, self.stretches = fit.trajectory, fit.stretches
        else:
            motion.check_positions({joint.name: joint.limits for joint in self.joints})
            self.trajectory, self.stretches = motion.stretched(self.limits), ()
        self.loop = loop if loop is not None else isinstance(motion, Motion) and motion.loop
        self.stopped = False
        """Whether `stop` has ended it before its end."""
        self._pace = 1.0
        self._paused = False
        self._stages: Iterator[tuple[Playback, bool]] = iter(())
        self._playback: Playback | None = None
        self._approaching = False

    @property
    def duration(self) -> float:
        """S that the motion takes, without the way to its first pose, at full pace."""
        return self.trajectory.duration

    # What may be called while it is under way

    def pause(self) -> None:
        """Bring all joints to rest as soon as their limits allow, on the path of the motion."""
        self._paused = True

    def resume(self) -> None:
        """Go on after `pause`."""
        self._paused = False

    def stop(self) -> None:
        """Come to rest on the path, and end there; `wait` returns then."""
        self.stopped = True

    def set_pace(self, pace: float) -> None:
        """Play in slow motion: 1 is the pace it was planned for, 0.5 takes twice as long. Raises BadValue."""
        if not 0 < pace <= 1:
            raise BadValue(f"{pace!r} is no pace: give more than 0, at most 1")
        self._pace = pace

    # Steps, written once for both drivers

    @bus_method
    @urgent(Priority.MOTION)
    def begin(self) -> RobotJob[None]:
        """Make sure that all joints have torque, and plan the way from where they are to the first pose."""
        start = yield from self.set_off()
        slow = {
            name: JointLimits(min(one.speed, APPROACH), one.acceleration, one.jerk) for name, one in self.limits.items()
        }
        self._stages = self._all_stages(start, slow)
        self._playback, self._approaching = next(self._stages)

    def _all_stages(
        self, start: Mapping[str, float], slow: Mapping[str, JointLimits]
    ) -> Iterator[tuple[Playback, bool]]:
        """Give what is played one after the other: the way to the first pose, the motion, and again if it loops."""
        here = dict(start)
        while True:
            way = synchronised(here, self.trajectory.start, slow)
            if way.duration > 0:
                yield Playback(way, slow, self.period), True
            yield Playback(self.trajectory, self.limits, self.period), False
            if not self.loop:
                return
            here = self.trajectory.goal

    @bus_method
    @urgent(Priority.MOTION)
    def step(self) -> RobotJob[PlayTick | None]:
        """Send the next goals and read all joints; None once the motion is over.

        Raises what ended the motion: all joints were stopped then.
        """
        if self._playback is None or self.over:
            return None
        if self._playback.finished and not self._next_stage() and self.arrived(self._playback.states):
            self.over = True
            return None
        playback = self._playback
        playback.set_rate(0.0 if self.stopped or self._paused else self._pace)
        states = playback.step()
        result = yield from self.send(states)
        if self.stopped and playback.paused and self.arrived(states):
            self.over = True
        goals = {name: self.sent[name] for name in states}
        time = playback.time - (playback.trajectory.duration if self._approaching else 0.0)
        return PlayTick(time, goals, result)

    def _next_stage(self) -> bool:
        stage = next(self._stages, None)
        if stage is None:
            return False
        self._playback, self._approaching = stage
        return True

    @bus_method
    @urgent(Priority.MOTION)
    def end(self, error: BaseException | None = None) -> RobotJob[None]:
        """Give the servos their speeds back; after an error stop all joints first."""
        return self.finish(error, stop=False)

    def __repr__(self) -> str:
        state = (
            "over" if self.over else "paused" if self._paused else "ready" if self._playback is None else "under way"
        )
        return f"<{type(self).__name__} of {', '.join(self.limits)}, {show(self.duration, 's')}: {state}>"


class BlockingPlay(BlockingTurns[PlayTick], Play):
    """A motion played by a blocking robot: iterate over it, or `wait`."""


class AsyncPlay(AsyncTurns[PlayTick], Play):
    """A motion played by an asynchronous robot: iterate over it with `async for`, or await `wait()`."""
