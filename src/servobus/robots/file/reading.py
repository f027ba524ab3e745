"""Reading a robot file: TOML in, values out, and each mistake told with file, line, key, value and remedy."""

import difflib
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from os import PathLike, fspath
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn, TypeVar

from servobus.core.registers import Motion, Register
from servobus.core.units import deg, show
from servobus.core.values import frozen
from servobus.errors import RobotFileError, UsageError
from servobus.jobs.backup import identity_names
from servobus.robots.file.entries import (
    JointEntry,
    LoadEntry,
    MirrorEntry,
    MotionEntry,
    PortEntry,
    ProtectEntry,
    RobotEntry,
    RobotFile,
    ServoEntry,
    StepEntry,
    keys_of,
    raw_setting,
)
from servobus.robots.file.kinds import Measured, Name, Names, shown
from servobus.robots.file.lines import line_of

T = TypeVar("T")

TABLES = ("robot", "port", "joint", "group", "pose", "motion")
NAMED = {"port": PortEntry, "joint": JointEntry, "motion": MotionEntry}
"""Tables of tables, each with a name of its own."""
PARTS: dict[str, type] = {"mirror": MirrorEntry, "protect": ProtectEntry, "load": LoadEntry}
"""Tables inside that of a joint."""
ANGLE = Measured("rad", "90deg")
VIRTUAL = "virtual:"
"""What stands in front of the name of a file whose servos are to be virtual ones."""
ROUNDING = 1e-4 * deg
"""rad by which an angle may miss a limit: files have angles with so many digits, and reckoning rounds."""


def read_file(path: str | PathLike[str]) -> RobotFile:
    """Read a robot file; with "virtual:arm.toml?clock=virtual" it is that of a virtual robot. Raises RobotFileError."""
    given = fspath(path)
    if given.startswith(VIRTUAL):
        name, _, options = given.removeprefix(VIRTUAL).partition("?")
        return replace(read_file(name), virtual=options)
    where = Path(given)
    try:
        text = read_bytes(where)
    except FileNotFoundError:
        raise RobotFileError(
            f"{where}: no such file; `servobus robot init PORT -o {where.name}` makes one from the servos of a port"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise RobotFileError(f"{where}: cannot be read as text: {error}") from None
    return read_text(text, where)


def read_bytes(path: Path) -> str:
    """Give the text of a file, with its line ends as they are. Raises OSError or UnicodeDecodeError."""
    return path.read_bytes().decode("utf-8-sig")


def read_text(text: str, path: Path | None = None) -> RobotFile:
    """Read the text of a robot file; `path` is for messages. Raises RobotFileError."""
    name = "the robot file" if path is None else str(path)
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise RobotFileError(f"{name}: this is no TOML: {error}") from None
    return _Reader(name, text, tables).file(path)


@frozen
class _Reader:
    name: str
    text: str
    tables: Mapping[str, Any]

    def file(self, path: Path | None) -> RobotFile:
        self._known(self.tables, TABLES, (), "table")
        if "robot" not in self.tables:
            raise RobotFileError(f"{self.name}: there is no table [robot]; write [robot] and format = 1 at its head")
        robot = self._entry(RobotEntry, self.tables["robot"], ("robot",))
        ports = self._named("port", lambda name, table: self._entry(PortEntry, table, ("port", name), name=name))
        joints = self._named("joint", self._joint)
        motions = self._named("motion", self._motion)
        groups = self._groups()
        poses = self._named("pose", self._pose)
        file = RobotFile(
            path=path,
            text=self.text,
            robot=robot,
            ports=MappingProxyType(ports),
            joints=MappingProxyType(joints),
            groups=MappingProxyType(groups),
            poses=MappingProxyType(poses),
            motions=MappingProxyType(motions),
        )
        self._fits(file)
        return file

    # Tables

    def _joint(self, name: str, table: Mapping[str, Any]) -> JointEntry:
        parts: dict[str, Any] = {
            part: self._entry(entry, table[part], ("joint", name, part))
            for part, entry in PARTS.items()
            if part in table
        }
        rest = {key: value for key, value in table.items() if key not in parts}
        return self._entry(JointEntry, rest, ("joint", name), also=tuple(PARTS), name=name, **parts)

    def _motion(self, name: str, table: Mapping[str, Any]) -> MotionEntry:
        path = ("motion", name)
        steps = table.get("steps", [])
        if not isinstance(steps, list) or ("steps" in table) == ("file" in table) or ("steps" in table and not steps):
            self._refuse(path, f'write either steps = [{{ pose = "home", time = "0s" }}, ...], or file = "{name}.csv"')
        made = tuple(self._entry(StepEntry, step, (*path, "steps")) for step in steps)
        for step in made:
            if step.pose is None and not step.joints:
                self._refuse((*path, "steps"), "a step has a pose, or joints with their angles")
            for joint, angle in step.joints.items():
                self._value((*path, "steps", joint), ANGLE.read, angle)
        times = [step.time for step in made]
        late = next((two for one, two in pairwise(times) if not one < two), None)
        if late is not None:
            self._refuse((*path, "steps"), f"each step comes later than the one before it; {show(late, 's')} does not")
        rest = {key: value for key, value in table.items() if key != "steps"}
        return self._entry(MotionEntry, rest, path, also=("steps",), name=name, steps=made)

    def _pose(self, name: str, table: Mapping[str, Any]) -> Mapping[str, float]:
        path = ("pose", name)
        self._table(table, path)
        if not table:
            self._refuse(path, 'a pose has angles of joints, such as shoulder = "20deg"')
        return MappingProxyType(
            {joint: self._value((*path, joint), ANGLE.read, angle) for joint, angle in table.items()}
        )

    def _groups(self) -> dict[str, tuple[str, ...]]:
        table = self._table(self.tables.get("group", {}), ("group",))
        kind = Names(Name("joint"))
        return {name: self._value(("group", name), kind.read, joints) for name, joints in table.items()}

    def _named(self, kind: str, make: Callable[[str, Any], T]) -> dict[str, T]:
        """Read all tables [kind.NAME]."""
        made = {}
        for name, table in self._table(self.tables.get(kind, {}), (kind,)).items():
            self._value((kind, name), Name(kind).read, name)
            made[name] = make(name, self._table(table, (kind, name)))
        return made

    def _entry(self, entry: type[T], table: Any, path: tuple[str, ...], *, also: Sequence[str] = (), **given: Any) -> T:
        """Read a table by the keys that its entry declares."""
        self._table(table, path)
        keys = keys_of(entry)
        self._known(table, (*keys, *also), path, "key")
        if missing := [name for name, key in keys.items() if key.required and name not in table]:
            self._refuse(path, f"{missing[0]} is missing: {keys[missing[0]].about}")
        read = {name: self._value((*path, name), keys[name].kind.read, value) for name, value in table.items()}
        return entry(**read, **given)

    def _table(self, value: Any, path: tuple[str, ...]) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            self._refuse(path, f"{shown(value)} is no table; write [{'.'.join(path)}] and its keys below")
        return value

    def _value(self, path: tuple[str, ...], read: Callable[[Any], T], value: Any) -> T:
        try:
            return read(value)
        except ValueError as error:
            self._refuse(path, str(error))

    # What fits together

    def _fits(self, file: RobotFile) -> None:
        """Refuse what names something that is not there, or what contradicts something else."""
        taken: dict[tuple[str, str, int, int], str] = {}
        for name, joint in file.joints.items():
            path: tuple[str, ...] = ("joint", name)
            for servo, table in zip(joint.servos, (path, (*path, "mirror")), strict=False):
                self._there(servo.port, file.ports, (*table, "port"), "port")
                self._can(servo, table)
                who = servo.port, servo.model.family.name, servo.id, servo.baud or servo.model.factory_baud
                if who in taken:
                    self._refuse(
                        (*table, "id"), f"id {servo.id} on port {servo.port} is that of joint {taken[who]} already"
                    )
                taken[who] = name
            self._range(joint)
            self._value((*path, "protect"), JointEntry.thresholds.__get__, joint)
            self._registers(joint)
            self._parents(file, joint)
        for group, joints in file.groups.items():
            if group in file.joints:
                self._refuse(("group", group), f"a joint is called {group} already; give the group another name")
            for joint_name in joints:
                self._there(joint_name, file.joints, ("group", group), "joint")
        for pose, angles in file.poses.items():
            self._angles(file, ("pose", pose), angles)
        for name, motion in file.motions.items():
            path = "motion", name, "steps"
            for step in motion.steps:
                if step.pose is not None:
                    self._there(step.pose, file.poses, path, "pose")
                self._angles(file, path, {joint: ANGLE.read(angle) for joint, angle in step.joints.items()})
        if file.robot.rest is not None:
            self._there(file.robot.rest, file.poses, ("robot", "rest"), "pose")

    def _parents(self, file: RobotFile, joint: JointEntry) -> None:
        """Refuse a joint that sits on one that is not there, or on itself."""
        path = ("joint", joint.name, "load", "parent")
        seen, below = [joint.name], joint
        while below.load is not None and (parent := below.load.parent) is not None:
            self._there(parent, file.joints, ("joint", below.name, "load", "parent"), "joint")
            if parent == joint.name:
                self._refuse(path, f"{' sits on '.join([*seen, parent])}; one of them sits on none")
            if parent in seen:
                return  # a circle further down, which is told of its own joints
            seen.append(parent)
            below = file.joints[parent]

    def _can(self, servo: ServoEntry, path: tuple[str, ...]) -> None:
        speeds = servo.model.bauds
        if servo.baud is not None and speeds and servo.baud not in speeds:
            said = ", ".join(map(str, sorted(speeds)))
            self._refuse((*path, "baud"), f"{servo.baud} bit/s is no speed of the {servo.model.title}: it has {said}")

    def _range(self, joint: JointEntry) -> None:
        low, high = joint.range
        path = ("joint", joint.name, "limits")
        if joint.limits is None:
            if not low < high:
                self._refuse(
                    ("joint", joint.name, "zero"), "the two servos have no angle in common; look at both zeros"
                )
            return
        if low - joint.limits[0] > ROUNDING or joint.limits[1] - high > ROUNDING:
            can = replace(joint, limits=None).range
            self._refuse(
                path,
                f"the {joint.model.title} cannot be sent there: with this zero, direction and ratio the joint can go "
                f"from {show(can[0], 'rad')} to {show(can[1], 'rad')}",
            )

    def _registers(self, joint: JointEntry) -> None:
        path = ("joint", joint.name)
        if joint.limits_in_servo and joint.limits is None:
            self._refuse((*path, "limits_in_servo"), "there are no limits to keep in the servo; write `limits` too")
        for name, value in joint.registers.items():
            for servo in joint.servos:
                try:
                    row = servo.model.register(name)
                    raw_setting(row, value)
                except (UsageError, ValueError) as error:
                    self._refuse((*path, "registers", name), str(error))
                if (why := _no_setting(joint, row, servo)) is not None:
                    self._refuse((*path, "registers", name), why)

    def _angles(self, file: RobotFile, path: tuple[str, ...], angles: Mapping[str, float]) -> None:
        for joint, angle in angles.items():
            self._there(joint, file.joints, (*path, joint), "joint")
            low, high = file.joints[joint].range
            if not low - ROUNDING <= angle <= high + ROUNDING:
                self._refuse(
                    (*path, joint),
                    f"{show(angle, 'rad')} is outside the limits of the joint, {show(low, 'rad')} .. "
                    f"{show(high, 'rad')}",
                )

    def _there(self, name: str, known: Iterable[str], path: tuple[str, ...], kind: str) -> None:
        names = list(known)
        if name not in names:
            self._refuse(path, f'there is no {kind} "{name}"{_meant(name, names)}')

    def _known(self, table: Mapping[str, Any], names: Sequence[str], path: tuple[str, ...], kind: str) -> None:
        for name in table:
            if name not in names:
                there = f"in [{'.'.join(path)}]" if path else "here"
                self._refuse((*path, name), f'there is no {kind} "{name}" {there}{_meant(name, names)}')

    def _refuse(self, path: tuple[str, ...], why: str) -> NoReturn:
        line = line_of(self.text, path)
        where = self.name if line is None else f"{self.name}:{line}"
        raise RobotFileError(f"{where}: [{'.'.join(path)}] {why}")


def _no_setting(joint: JointEntry, row: Register[Any], servo: ServoEntry) -> str | None:
    """Say why a register cannot be a setting that is kept; None if it can."""
    if row.name in identity_names(servo.model):
        return f"{row.name} says where the servo is found: write `id` and `baud` of the joint, and set-id and set-baud"
    if row.motion in (Motion.GOAL, Motion.SPEED, Motion.MODE) or row is servo.model.register("torque_enable"):
        return f"{row.name} is a command and no setting: leave it out, and move the joint instead"
    limits = [servo.model.register(name) for name in ("min_position", "max_position")]
    if joint.limits_in_servo and row in limits:
        return f"{row.name} is worked out from the limits of the joint, for limits_in_servo is true; leave one out"
    return None


def _meant(name: str, names: Sequence[str]) -> str:
    """Say which of the names may have been meant, or which there are."""
    close = difflib.get_close_matches(name, names, 1)
    if close:
        return f"; did you mean {close[0]}?"
    return f"; there are {', '.join(names)}" if names else "; there is none at all"
