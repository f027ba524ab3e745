"""The blocking robot.

with servobus.robot("arm.toml") as arm:
    with arm.torque():
        arm.move(shoulder=20 * deg, elbow=-45 * deg, time=1.5).wait()
        print(arm.positions())
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from os import PathLike, fspath
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from servobus.bus.blocking import Bus
from servobus.core.registers import Register
from servobus.families.record import SafeAction
from servobus.robots.base import BaseRobot, JointSet, JointVerbs
from servobus.robots.file.entries import JointEntry, RobotFile
from servobus.robots.joints.joint import Part
from servobus.robots.joints.move import JointMove
from servobus.robots.ports import BlockingPorts, OnPorts

if TYPE_CHECKING:
    from servobus.robots.joints.cycle import BlockingRobotCycle
    from servobus.robots.motions.follow import BlockingFollow
    from servobus.robots.motions.motion import Motion
    from servobus.robots.motions.play import BlockingPlay
    from servobus.robots.motions.teach import BlockingTeach
    from servobus.robots.trajectory.path import Trajectory


class RobotMove:
    """A move of joints under way. A way that takes longer than a servo can be told goes on only while `wait` waits."""

    def __init__(self, joints: "RobotJoints", started: JointMove) -> None:
        self._joints, self.planned = joints, started

    @property
    def duration(self) -> float:
        """Seconds from start to arrival."""
        return self.planned.duration

    @property
    def done(self) -> bool:
        """Whether it has ended; asks the servos, but only from when they should be there until they are."""
        return self._joints.has_ended(self.planned)

    def wait(self, timeout: float | None = None) -> None:
        """Wait until the joints stand still near their goals.

        Raises MoveTimeout `timeout` s from now, or 2 s after they should have arrived, and Stopped at once if a joint
        was made safe, stopped or switched off. Where one joint fails the others stop too.
        """
        self._joints.wait_arrival(self.planned, timeout)

    def cancel(self) -> None:
        """Stop the joints where they are, unless the move has ended."""
        self._joints.cancel(self.planned)

    def __repr__(self) -> str:
        return f"<RobotMove {self.planned}: {'ended' if self.planned.over else 'under way'}>"


class RobotJoint(OnPorts, JointVerbs):
    """A joint of a blocking robot."""

    def __init__(self, ports: BlockingPorts, entry: JointEntry, parts: tuple[Part, ...]) -> None:
        self._ports = ports
        super().__init__(entry, parts)

    def move(self, angle: float, *, time: float | None = None, speed: float | None = None) -> RobotMove:
        """Start a move to an angle in rad and give a handle to wait for its end; see `Robot.move`."""
        joints = RobotJoints(self._ports, {self.name: self})
        return RobotMove(joints, self.start_move(angle, time=time, speed=speed))


class RobotJoints(OnPorts, JointSet[RobotJoint]):
    """Joints of a blocking robot that are asked and moved together."""

    def __init__(self, ports: BlockingPorts, joints: Mapping[str, RobotJoint]) -> None:
        self._ports: BlockingPorts = ports
        super().__init__(joints)
        self._close()

    def move(
        self, goals: Any = None, /, *, time: float | None = None, speed: float | None = None, **angles: float
    ) -> RobotMove:
        """Move joints that start together and arrive together, over all ports and families.

        goals   name -> angle in rad, or one angle for each joint in their order, as a list or an array; or keywords:
                `move(shoulder=20 * deg, elbow=-45 * deg)`
        time    s that the move takes, or
        speed   rad/s of the joint with the longest way; 90°/s if neither is given. No joint exceeds its own `speed`

        The servos run the move by themselves, and speed up as they do. A joint with a limit of acceleration gets at
        least the time of its quickest move that keeps it; `play` keeps it at every instant. Everything is checked
        before anything moves. Raises BadValue outside the limits or for too short a time, TorqueOff, Disagreement or
        UsageError.
        """
        return RobotMove(self, self.start_move(goals, time=time, speed=speed, **angles))

    def cycle(
        self,
        read: Iterable[Register[Any] | str] | Register[Any] | str = "present_position",
        *,
        time: float = 0.0,
    ) -> "BlockingRobotCycle":
        """Prepare a control cycle: goals out and readings in, on all ports side by side; nothing is sent.

        `read` are registers that all have, `time` the s a goal is given where the family has such a time.
        """
        from servobus.robots.joints.cycle import BlockingRobotCycle  # noqa: PLC0415 - only control loops need it

        return BlockingRobotCycle(self._ports, list(self), read, time)

    @contextmanager
    def torque(self) -> Iterator[Self]:
        """Torque on for these joints inside the `with`, off again on the way out; see `Bus.torque`."""
        if self._has_pairs:
            self.positions()  # raises Disagreement where two servos on one axis would fight each other
        with ExitStack() as stack:
            for port, servos in self._servos().items():
                stack.enter_context(self._ports.buses[port].torque(servos))
            yield self


class Robot(RobotJoints, BaseRobot[RobotJoint, Bus]):
    """A robot on its ports; see `servobus.robot`. May be shared between threads."""

    def __init__(self, file: RobotFile, buses: Mapping[str, Bus]) -> None:
        ports = self._ports = BlockingPorts(buses)
        self._stack = ExitStack()
        BaseRobot.__init__(self, file, ports, RobotJoint, RobotJoints)

    def __enter__(self) -> Self:
        for bus in self.buses.values():
            self._stack.enter_context(bus)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)
        self.close()

    def close(self) -> None:
        """Give the ports back. Torque stays as it is."""
        for bus in self.buses.values():
            bus.close()
        self._ports.close()

    def play(
        self, motion: "str | Motion | Trajectory", *, rate: float = 100.0, loop: bool | None = None
    ) -> "BlockingPlay":
        """Prepare a motion: a name of the robot file, a `Motion`, or a `Trajectory`. Nothing is sent yet.

        rate   goals a second, 1 to 1000
        loop   whether it begins again where it ends; as the file says by default

        Raises UnknownName, and BadValue where a joint would leave its limits. Limits of speed, acceleration and jerk
        stretch the time of the motion where it is too quick; `duration` of what is given tells the time.
        """
        from servobus.robots.motions.play import BlockingPlay  # noqa: PLC0415 - not every program plays motions

        return BlockingPlay(self._ports, list(self), self.motion(motion), rate, loop=loop)

    def follow(self, *joints: str, rate: float = 100.0, jerk: float | None = None) -> "BlockingFollow":
        """Prepare joints, by default all, to be given new goals while they move; see servobus.robots.motions.follow.

        rate  goals a second, 1 to 1000
        jerk  rad/s³, the limit for joints of which the file says none: with it jerk is limited, which needs ruckig

        Nothing is sent yet. Raises UnknownName for a joint that is not there, UsageError where ruckig is not installed.
        """
        from servobus.robots.motions.follow import BlockingFollow  # noqa: PLC0415 - not every program gives goals in flight

        return BlockingFollow(self._ports, self.named(*joints), rate, jerk)

    def teach(self, *joints: str, rate: float = 50.0, keep: str | PathLike[str] | None = None) -> "BlockingTeach":
        """Prepare a recording of joints that are moved by hand; see servobus.robots.motions.teach. Nothing is sent yet.

        joints  those that go limp as it begins: hold them. If none is named, those are recorded that are limp already
        rate    readings a second, 1 to 1000
        keep    a file, .csv or .mcap, that each reading is written to as it comes

        Raises UnknownName for a joint that is not there.
        """
        from servobus.robots.motions.teach import BlockingTeach  # noqa: PLC0415 - not every program teaches

        path = None if keep is None else Path(fspath(keep))
        return BlockingTeach(self._ports, self.named(*joints), rate, path, named=bool(joints))

    def make_safe(self, action: SafeAction | None = None, *, interrupt: bool = False) -> None:
        """Run the safe action, or this one, of each joint that this robot has switched on or set in motion."""
        for bus in self.buses.values():
            bus.make_safe(action, interrupt=interrupt)
