"""What the blocking and the asynchronous robot share: joints, groups of them, and what one asks of them together."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from servobus.bus.base import BaseBus
from servobus.core.closed import Closed
from servobus.core.operation import Priority, bus_method, urgent
from servobus.core.registers import Register, register_name
from servobus.errors import UnknownName, UsageError
from servobus.families.base import StopOutcome
from servobus.families.record import SafeAction
from servobus.jobs.scan import Watcher
from servobus.robots.file.entries import JointEntry, RobotFile
from servobus.robots.joints import attendance, jobs, move
from servobus.robots.joints.attendance import Attendance, Sought
from servobus.robots.joints.jobs import JointState
from servobus.robots.joints.joint import Joint, Part, check_meant, parts_of
from servobus.robots.joints.move import JointMove
from servobus.robots.joints.protection import Protections
from servobus.robots.ports import Ports
from servobus.robots.settings import applying, planning, swaps
from servobus.robots.settings.applying import Applied
from servobus.robots.settings.backups import Backups
from servobus.robots.settings.planning import Plan, limits_alone
from servobus.robots.steps import RobotJob
from servobus.robots.values import ByJoint, named_angles

if TYPE_CHECKING:
    from servobus.robots.motions.motion import Motion
    from servobus.robots.trajectory.path import Trajectory
    from servobus.safety.overload import Level

J = TypeVar("J", bound="JointVerbs")
B = TypeVar("B", bound=BaseBus[Any])


class JointVerbs(Joint):
    """What one can ask of one joint."""

    @bus_method
    def position(self) -> RobotJob[float]:
        """Read the angle, rad. Two servos on one axis give the mean of both."""
        return jobs.one(self, jobs.read([self], "present_position"))

    @bus_method
    def read(self, register: Register[Any] | str) -> RobotJob[Any]:
        """Read a register of its first servo: angles, speeds and loads as those of the joint, all else as it is."""
        return jobs.one(self, jobs.read([self], register_name(register)))

    @bus_method
    def look(self) -> RobotJob[JointState]:
        """Read angle, voltage, temperature and torque."""
        return jobs.one(self, jobs.look([self]))

    @bus_method
    @urgent(Priority.MOTION)
    def start_move(self, angle: float, *, time: float | None = None, speed: float | None = None) -> RobotJob[JointMove]:
        """Start a move to an angle in rad, and give what is needed to wait for its end."""
        return move.plan_and_start({self: angle}, time=time, speed=speed)

    @bus_method
    @urgent(Priority.MOTION)
    def torque_on(self) -> RobotJob[None]:
        """Switch the torque on where the joint stands; of both servos on one axis, or of none."""
        return jobs.torque_on([self])

    @bus_method
    @urgent(Priority.MOTION)
    def torque_off(self) -> RobotJob[None]:
        """Switch the torque off: the joint turns freely."""
        return jobs.torque_off([self])

    @bus_method
    @urgent(Priority.STOP)
    def stop(self) -> RobotJob[dict[str, tuple[StopOutcome, ...]]]:
        """End the motion; see `Servo.stop`. Raises StopFailed."""
        return jobs.stop([self])


class JointSet(Closed, Generic[J]):
    """Joints of a robot that are asked and moved together: all of them, or a group."""

    def __init__(self, joints: Mapping[str, J]) -> None:
        self.joints = dict(joints)
        """Name -> joint, in the order of the robot file."""

    def __getitem__(self, name: str) -> J:
        try:
            return self.joints[name]
        except (KeyError, TypeError):
            raise UnknownName(f"no joint {name!r}; there are {', '.join(self.joints)}") from None

    def __iter__(self) -> Iterator[J]:
        return iter(self.joints.values())

    def __len__(self) -> int:
        return len(self.joints)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {', '.join(self.joints)}>"

    def __contains__(self, joint: object) -> bool:
        return joint in self.joints or any(one is joint for one in self)

    def _no_attribute(self, name: str) -> str:
        return f"{name} cannot be set; to move a joint: move({name if name in self.joints else 'NAME'}=20 * deg)"

    def named(self, *names: str) -> list[J]:
        """Give joints by their names, each once and in the order of the robot file; all if none is named.

        Raises UnknownName.
        """
        wanted = {self[name].name for name in names} or set(self.joints)
        return [joint for name, joint in self.joints.items() if name in wanted]

    def _servos(self) -> dict[str, list[Any]]:
        """Sort the servos of these joints by port: port -> servos, which are those of its bus.

        Raises RobotMismatch where another servo answers than that of the file.
        """
        check_meant(self)
        return jobs.on_each_port(self, lambda parts: [part.servo for part in parts])

    @property
    def _has_pairs(self) -> bool:
        return any(len(joint.parts) > 1 for joint in self)

    # What one can ask of all

    @bus_method
    def positions(self) -> RobotJob[ByJoint[float]]:
        """Read the angles, rad: name -> angle. Joints that do not answer are in `lost` of it."""
        return jobs.read(list(self), "present_position")

    @bus_method
    def read(self, register: Register[Any] | str) -> RobotJob[ByJoint[Any]]:
        """Read a register of all: angles, speeds and loads as those of the joints, all else as their servos have it."""
        return jobs.read(list(self), register_name(register))

    @bus_method
    def look(self) -> RobotJob[ByJoint[JointState]]:
        """Read angle, voltage, temperature and torque of all: name -> JointState."""
        return jobs.look(list(self))

    @bus_method
    @urgent(Priority.MOTION)
    def start_move(
        self,
        goals: Any = None,
        /,
        *,
        time: float | None = None,
        speed: float | None = None,
        **angles: float,
    ) -> RobotJob[JointMove]:
        """Plan a move, make sure that all its joints have torque, and start it; see `move`."""
        named = named_angles(goals, list(self.joints), angles)
        return move.plan_and_start(move.goals_by_joint(self.joints, named), time=time, speed=speed)

    @bus_method
    @urgent(Priority.MOTION)
    def plan_move(
        self,
        goals: Any = None,
        /,
        *,
        time: float | None = None,
        speed: float | None = None,
        **angles: float,
    ) -> RobotJob[JointMove]:
        """Check a move without moving anything; see `move`."""
        named = named_angles(goals, list(self.joints), angles)
        return move.plan_joints(move.goals_by_joint(self.joints, named), time=time, speed=speed)

    @bus_method
    def wait_arrival(self, started: JointMove, timeout: float | None = None) -> RobotJob[None]:
        """Wait until all joints of a move stand still near their goals; see `RobotMove.wait`."""
        return move.wait_joints(started, timeout)

    @bus_method
    def has_ended(self, started: JointMove) -> RobotJob[bool]:
        """Tell whether a move has ended."""
        return move.joints_have_ended(started)

    @bus_method
    @urgent(Priority.STOP)
    def cancel(self, started: JointMove) -> RobotJob[None]:
        """Stop all joints of a move where they are, unless it has ended."""
        return move.cancel_joints(started)

    @bus_method
    @urgent(Priority.MOTION)
    def torque_on(self) -> RobotJob[None]:
        """Switch the torque of all on, each where it stands: nothing moves. Of two servos on one axis both or none.

        Raises Disagreement where two servos on one axis stand too far apart, before any torque is switched on.
        """
        return jobs.torque_on(list(self))

    @bus_method
    @urgent(Priority.MOTION)
    def torque_off(self) -> RobotJob[None]:
        """Switch the torque of all off, of each though others fail: the joints turn freely, and an arm may fall."""
        return jobs.torque_off(list(self))

    @bus_method
    @urgent(Priority.STOP)
    def stop(self) -> RobotJob[dict[str, tuple[StopOutcome, ...]]]:
        """Stop all joints, each though others fail. Gives what was done with the servos of each. Raises StopFailed."""
        return jobs.stop(list(self))


class BaseRobot(JointSet[J], Generic[J, B]):
    """The joints that a robot file names, on all its ports.

    file    what the robot file says
    buses   port -> the bus on it, for what only servos have
    groups  name -> the joints of a group
    """

    def __init__(
        self,
        file: RobotFile,
        ports: Ports[B],
        joint: Callable[[Any, JointEntry, tuple[Part, ...]], J],
        group: Callable[[Any, Mapping[str, J]], JointSet[J]],
    ) -> None:
        """Make the joints and groups that the file names: `joint` and `group` are their classes for this driver."""
        JointSet.__init__(
            self, {entry.name: joint(ports, entry, parts_of(entry, ports.buses)) for entry in file.joints.values()}
        )
        self.file, self.ports = file, ports
        self.groups = {
            name: group(ports, {member: self[member] for member in members}) for name, members in file.groups.items()
        }
        self._attendance = Attendance(file.name, ())
        self._protections = Protections(list(self))
        self._close()

    @property
    def attendance(self) -> Attendance:
        """What was found when it was last compared with its file."""
        return self._attendance

    @attendance.setter
    def attendance(self, found: Attendance) -> None:
        self._attendance = found
        mistaken = found.mistaken
        for joint in self:
            joint.mistaken = mistaken.get(joint.name, "")

    @property
    def buses(self) -> dict[str, B]:
        """The bus of each port, by the name of the port."""
        return self.ports.buses

    @property
    def poses(self) -> Mapping[str, Mapping[str, float]]:
        """The poses of the file: name -> joint -> angle, rad."""
        return self.file.poses

    def pose(self, name: str) -> Mapping[str, float]:
        """Give a pose of the file, joint -> angle, rad. Raises UnknownName."""
        if name not in self.file.poses:
            raise UnknownName(f"{self.file.name}: no pose {name!r}; there are {', '.join(self.file.poses) or 'none'}")
        return self.file.poses[name]

    def motion(self, motion: "str | Motion | Trajectory") -> "Motion | Trajectory":
        """Give a motion of the file by its name; one that is given itself is given back. Raises UnknownName."""
        if not isinstance(motion, str):
            return motion
        if motion not in self.file.motions:
            known = ", ".join(self.file.motions) or "none"
            raise UnknownName(f"{self.file.name}: no motion {motion!r}; there are {known}")
        from servobus.robots.motions.motion import motion_of  # noqa: PLC0415 - not every program plays motions

        return motion_of(self.file, motion)

    @bus_method
    @urgent(Priority.SCAN)
    def check(self, *, strangers: Sought = "file", watch: Watcher | None = None) -> RobotJob[Attendance]:
        """Compare who answers with the file: missing, strangers, wrong models, swapped ones. Moves nothing.

        strangers  "near": at the ids and speeds at which most strangers are, as opening looks for them; "file": at
                   every id, at the speeds of the servos in the file; "everywhere": at every id, family and speed
        watch      is told of each id at which strangers were looked for, and may be called from several threads

        Servos of one model that have changed places are told where the file asks for different settings of them
        (`registers`, `limits_in_servo`) that `apply_settings` has written.
        """
        found = yield from attendance.check(self.file, self.buses, list(self), strangers=strangers, watch=watch)
        self.attendance = yield from swaps.added(found, list(self))
        return self.attendance

    # Protection

    @bus_method
    def protect(self) -> "RobotJob[ByJoint[Level]]":
        """Look once how hot the servos of every joint are and whether they are stuck, and act; joint -> level.

        To be called again and again, as `Bus.protect`, which says what is done at each level. The thresholds of a joint
        are those of [joint.NAME.protect]. A joint with two servos is made safe with both, and stopped where they stand
        too far apart: then it raises Disagreement. Joints that do not answer are in `lost` of what is given.
        """
        return self._protections.look()

    def watch(self, timeout: float = 0.25, action: SafeAction | None = None) -> None:
        """Guard streamed motion on all ports; see `Bus.watch`."""
        for bus in self.buses.values():
            bus.watch(timeout, action)

    # Settings of the servos

    @bus_method
    @urgent(Priority.SCAN)
    def plan_settings(self) -> RobotJob[Plan]:
        """Compare the settings that the servos hold with the file. Moves nothing, writes nothing.

        That is what stands in [joint.NAME.registers], and the limits where `limits_in_servo` is true. Servos that are
        missing or of another model are in `problems` of it.
        """
        return self._plan()

    @bus_method
    @urgent(Priority.SCAN)
    def apply_settings(
        self, plan: Plan | None = None, *, torque_off: bool = False, offsets: bool = False
    ) -> RobotJob[Applied]:
        """Write what differs by a plan, by default by a new one, and read it back. Moves nothing.

        The torque of a servo that is written to must be off, or `torque_off` switches it off first. Offsets that servos
        have of their own are left alone, but for `offsets`. What was there before is kept in files beside the robot
        file; `undo_settings` brings it back. Broken off, the same again does the rest.

        Raises UsageError before anything is written, and NotRestored, when all the rest is written, with the servos
        that are not as the file says.
        """
        backups = Backups(self.file)
        made = (yield from self._plan()) if plan is None else plan
        return (yield from applying.apply(made, list(self), backups, torque_off=torque_off, offsets=offsets))

    @bus_method
    @urgent(Priority.SCAN)
    def undo_settings(self, *, torque_off: bool = False) -> RobotJob[dict[str, list[str]]]:
        """Bring back what the servos held before the last `apply_settings`; gives servo -> names of registers.

        The same again goes back further. Raises as `apply_settings`.
        """
        return applying.undo(self.buses, Backups(self.file), torque_off=torque_off)

    @bus_method
    @urgent(Priority.SCAN)
    def plan_limits(self) -> RobotJob[Plan]:
        """Compare the limits that the servos hold with those of the joints in the file. Writes nothing.

        Those of a servo are worked out from those of its joint: the lower one first, and rounded inwards. A joint
        without `limits` in the file is left as it is.
        """
        return self._plan(limits_alone(list(self)))

    @bus_method
    @urgent(Priority.SCAN)
    def sync_limits(self, plan: Plan | None = None, *, torque_off: bool = False) -> RobotJob[Applied]:
        """Write the limits of the joints into their servos too, by a plan of `plan_limits`; they hold whoever moves.

        Nothing moves. What was there before is kept, and `undo_settings` brings it back. Raises UsageError, before
        anything is written, where a servo stands outside the new limits, or where its torque is on and `torque_off` is
        false; else as `apply_settings`.
        """
        joints = limits_alone(list(self))
        made = (yield from self._plan(joints)) if plan is None else plan
        yield from planning.check_inside(made, joints)
        return (yield from applying.apply(made, joints, Backups(self.file), torque_off=torque_off))

    def _plan(self, joints: Sequence[Joint] | None = None) -> RobotJob[Plan]:
        joints = list(self) if joints is None else joints
        found = yield from attendance.check(self.file, self.buses, list(self), strangers="near")
        # A plan brings swapped settings in order too, so it is made although servos may have changed places.
        self.attendance = yield from swaps.added(found, list(self))
        return (yield from planning.plan(self.file.name, joints, found.unusable(joints)))

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_"):
            known = vars(self).get("joints", {})
            if name in known:
                return known[name]
            groups = vars(self).get("groups", {})
            if name in groups:
                return groups[name]
        return super().__getattr__(name)  # type: ignore[misc]

    def __dir__(self) -> list[str]:
        return sorted([*super().__dir__(), *self.joints, *self.groups])

    def _no_such_attribute(self, name: str) -> str:
        groups = f", groups {', '.join(self.groups)}" if self.groups else ""
        return f"{self.file.name} has no joint {name!r}; there are {', '.join(self.joints)}{groups}"

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.file.robot.name}: {', '.join(self.joints)}>"


def check_safe(joints: Iterable[Joint]) -> None:
    """Give each joint's servos the safe action of the file. Raises UsageError for one that a servo cannot do."""
    for joint in joints:
        if joint.entry.safe_action is None:
            continue
        for part in joint.parts:
            try:
                part.servo.safe_action = joint.entry.safe_action
            except UsageError as error:
                raise UsageError(f"{joint.name}: {error}") from None
