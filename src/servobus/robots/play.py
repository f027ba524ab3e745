"""Motions played: goals of all joints sent at a fixed rate, and their positions watched.

    with arm.torque():
        play = arm.play("wave")
        play.wait()                          # or: for tick in play: print(tick.positions)

The arm first goes slowly to where the motion begins. Goals go out while `wait` waits, or while one iterates; `pause`,
`resume`, `set_pace` and `stop` may be called meanwhile, from other threads too. All of them keep the limits of speed
and acceleration of each joint.

A joint that does not answer, that lost its torque, or that stays behind its goal ends the motion, see
servobus.robots.supervision: all joints stop where they are, and the error says which joint it was.
"""

from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from typing import Any, TypeVar

from servobus.bus.rate import Rate
from servobus.core.operation import Awaiting, Blocking, Priority, bus_method, urgent
from servobus.core.units import deg, show
from servobus.core.values import frozen
from servobus.errors import BadValue, MotionError, ServobusError
from servobus.robots import jobs, stream
from servobus.robots.cycle import RobotCycle, RobotResult
from servobus.robots.joint import Joint
from servobus.robots.motion import Motion, check_known, limits_of
from servobus.robots.ports import Ports
from servobus.robots.steps import RobotJob
from servobus.robots.supervision import Supervision
from servobus.robots.trajectory.limits import JointLimits
from servobus.robots.trajectory.path import Trajectory
from servobus.robots.trajectory.playback import Playback
from servobus.robots.trajectory.profile import synchronised
from servobus.robots.values import ByJoint

T = TypeVar("T")

RATE = 100.0
"""Goals a second, if nothing else is said. More bring 2 to 3 ms less lag with the servos here."""
APPROACH = 45 * deg
"""rad/s at most on the way to the first pose; *assumption*: slow enough that a person can step back."""


@frozen
class PlayTick:
    """One turn of a motion under way.

    time       s of the motion's own time; negative on the way to its first pose
    goals      joint -> goal that was sent, rad
    result     what was read, by joint
    """

    time: float
    goals: Mapping[str, float]
    result: RobotResult

    @property
    def positions(self) -> ByJoint[float]:
        """Joint -> angle, rad; `lost` has the joints that did not answer."""
        return self.result.positions


class Play:
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
        self.joints = [joint for joint in joints if joint.name in names]
        self.limits = {joint.name: limits_of(joint) for joint in self.joints}
        if isinstance(motion, Motion):
            fit = motion.fitted(self.joints)
            self.trajectory, self.stretches = fit.trajectory, fit.stretches
        else:
            motion.check_positions({joint.name: joint.limits for joint in self.joints})
            self.trajectory, self.stretches = motion.stretched(self.limits), ()
        self.loop = loop if loop is not None else isinstance(motion, Motion) and motion.loop
        if not 1 <= rate <= 1000:
            raise BadValue(f"{rate!r} goals a second: give 1 to 1000")
        self.period = 1 / rate
        self.stopped = False
        """Whether `stop` has ended it before its end."""
        self.over = False
        self.cycle = RobotCycle(ports, self.joints, "present_position", self.period)
        self._clock = ports.now
        self._pace = 1.0
        self._paused = False
        self._had: dict[Any, int] = {}
        self._stages: Iterator[tuple[Playback, bool]] = iter(())
        self._playback: Playback | None = None
        self._approaching = False
        self._supervision = Supervision(self.joints)

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
        self._had = yield from stream.begin(self.joints)
        start = yield from stream.where(self.joints)
        slow = {
            name: JointLimits(min(one.speed, APPROACH), one.acceleration, one.jerk) for name, one in self.limits.items()
        }
        self._stages = self._all_stages(start, slow)
        self._playback, self._approaching = next(self._stages)
        yield from self._supervision.begin()

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
        if self._playback.finished and not self._next_stage():
            return None
        playback = self._playback
        playback.set_rate(0.0 if self.stopped or self._paused else self._pace)
        states = playback.step()
        if self.stopped and playback.paused:
            self.over = True
        goals = {name: state.position for name, state in states.items()}
        result = yield from self.cycle.turn(goals)
        yield from self._supervision.watch(states, result)
        time = playback.time - (playback.trajectory.duration if self._approaching else 0.0)
        return PlayTick(time, goals, result)

    def turns(self) -> Rate:
        """Give the turns at which goals are sent."""
        assert isinstance(self, Blocking | Awaiting)
        return Rate(self, self._clock, self.period)

    def _next_stage(self) -> bool:
        stage = next(self._stages, None)
        if stage is None:
            self.over = True
            return False
        self._playback, self._approaching = stage
        return True

    @bus_method
    @urgent(Priority.MOTION)
    def end(self, error: BaseException | None = None) -> RobotJob[None]:
        """Give the servos their speeds back; after an error stop all joints first."""
        self.over = True
        try:
            if error is not None:
                yield from jobs.stop(self.joints)
        except (MotionError, ServobusError) as failure:
            assert error is not None
            error.add_note(str(failure))
        finally:
            yield from stream.end(self.joints, self._had)

    def __repr__(self) -> str:
        state = (
            "over" if self.over else "paused" if self._paused else "ready" if self._playback is None else "under way"
        )
        return f"<{type(self).__name__} of {', '.join(self.limits)}, {show(self.duration, 's')}: {state}>"


class BlockingPlay(Blocking, Play):
    """A motion played by a blocking robot: iterate over it, or `wait`."""

    def __init__(self, robot: Blocking, *args: Any, **kwargs: Any) -> None:
        self._robot = robot
        super().__init__(*args, **kwargs)

    def do(self, job: RobotJob[T], *, priority: Priority = Priority.READ) -> T:
        """Carry out a job of the robot."""
        result: T = self._robot.do(job, priority=priority)
        return result

    def __iter__(self) -> Iterator[PlayTick]:
        try:
            self.begin()
            for _ in self.turns():
                if (tick := self.step()) is None:
                    break
                yield tick
        except BaseException as error:
            self.end(error)
            raise
        self.end()

    def wait(self) -> None:
        """Play it to its end, or until `stop`. Raises what ended it before: all its joints were stopped then."""
        for _ in self:
            pass


class AsyncPlay(Awaiting, Play):
    """A motion played by an asynchronous robot: iterate over it with `async for`, or await `wait()`."""

    def __init__(self, robot: Awaiting, *args: Any, **kwargs: Any) -> None:
        self._robot = robot
        super().__init__(*args, **kwargs)

    async def do(self, job: RobotJob[T], *, priority: Priority = Priority.READ) -> T:
        """Carry out a job of the robot."""
        result: T = await self._robot.do(job, priority=priority)
        return result

    async def __aiter__(self) -> AsyncIterator[PlayTick]:
        try:
            await self.begin()
            async for _ in self.turns():
                if (tick := await self.step()) is None:
                    break
                yield tick
        except BaseException as error:
            await self.end(error)
            raise
        await self.end()

    async def wait(self) -> None:
        """Play it to its end; see `BlockingPlay.wait`."""
        async for _ in self:
            pass
