"""What stands in a robot file, as values.

A key is declared once, as a field: its kind reads it, its sentence explains it in the JSON Schema and in the docs, and
its default is what a file need not say. Angles are in rad, speeds in rad/s, times in s, as everywhere.

    [robot]             the file itself: `RobotEntry`
    [port.NAME]         a port: `PortEntry`
    [joint.NAME]        a joint and its servo: `JointEntry`
    [joint.NAME.mirror] a second servo on the same axis: `MirrorEntry`
    [joint.NAME.protect], [joint.NAME.load], [joint.NAME.registers]
    [group]             name -> names of joints
    [pose.NAME]         joint -> angle
    [motion.NAME]       steps through poses, or a file of samples: `MotionEntry`
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from servobus.core.ids import LAST_ID
from servobus.core.registers import Register
from servobus.core.units import deg
from servobus.families.model import Model
from servobus.families.record import SafeAction
from servobus.robots.axis import Axis
from servobus.robots.file.kinds import (
    Between,
    Direction,
    Kind,
    Measured,
    Name,
    Number,
    OneOf,
    ServoModel,
    Speed,
    Speeds,
    Switch,
    Table,
    Text,
    Whole,
)

if TYPE_CHECKING:
    from servobus.safety.overload import Thresholds

FORMAT = 1
"""Version of the format of robot files that is written and read here."""
OPEN_PORT = "?"
"""Path of a port that is not known yet: an import writes it, and opening the robot asks for the true one."""
SAFE_ACTIONS: tuple[SafeAction, ...] = ("hold", "free", "brake")

_ANGLE = Measured("rad", "90deg")


class Key(NamedTuple):
    """One key of a table: how it is read, what it is for, and whether a file must have it."""

    kind: Kind[Any]
    about: str
    required: bool


def key(kind: Kind[Any], about: str, **default: Any) -> Any:
    """Declare a key as a field; without a default the file must have it."""
    return field(metadata={"kind": kind, "about": about}, **default)


def keys_of(entry: type) -> dict[str, Key]:
    """Give the keys of a table by name."""
    return {
        one.name: Key(one.metadata["kind"], one.metadata["about"], one.default is one.default_factory is MISSING)
        for one in fields(entry)
        if "kind" in one.metadata
    }


def raw_setting(row: Register[Any], value: Any) -> int:
    """Give the raw value of a register for what stands in a table of registers: a whole number is raw already.

    Raises ValueError for what it cannot have.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        return row.check(value)
    return row.check(row.encode(row.parse(str(value).lower())))


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotEntry:
    """The table [robot]: what concerns all of it."""

    format: int = key(Whole(1, FORMAT), "Version of the format of this file.")
    name: str = key(Text("arm"), "What the robot is called.", default="robot")
    rest: str | None = key(Name("pose"), "Pose that the robot goes to before its torque is switched off.", default=None)
    changed: str | None = key(Text("2026-11-28"), "Date of the last change by servobus.", default=None)


@dataclass(frozen=True, slots=True, kw_only=True)
class PortEntry:
    """A table [port.NAME]."""

    name: str
    path: str = key(
        Text("/dev/ttyUSB0"),
        'Where it is: "/dev/ttyUSB0", "/dev/serial/by-id/...", "usb:SERIAL", "COM4", "socket://pi.local:3333", '
        '"virtual:rx28@1-4", "servobus:///arm" (a bus that a server shares).',
    )
    bauds: tuple[int, ...] | None = key(
        Speeds(1_000_000), "Speeds at which a search looks for servos, bit/s.", default=None
    )
    echo: bool | None = key(
        Switch(example=True), "Whether the adapter hears what it sends; found out without this.", default=None
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoEntry:
    """One servo of a joint: which it is, and how its angle belongs to that of the joint."""

    port: str
    model: type[Model]
    id: int
    baud: int | None
    axis: Axis


@dataclass(frozen=True, slots=True, kw_only=True)
class MirrorEntry:
    """A table [joint.NAME.mirror]: a second servo on the axis of the joint. What it lacks is as with the first."""

    id: int = key(Whole(0, LAST_ID), "Id of the second servo.")
    port: str | None = key(Name("port"), "Port of the second servo; that of the joint without this.", default=None)
    model: type[Model] | None = key(
        ServoModel("rx28"), "Model of the second servo; that of the joint without this.", default=None
    )
    baud: int | None = key(Speed(1_000_000), "Speed of the second servo, bit/s.", default=None)
    zero: float = key(_ANGLE, "Angle of the second servo where the joint is at 0.")
    direction: int | None = key(
        Direction(), "Direction of the second servo; the opposite of the joint's without this.", default=None
    )
    disagreement: float = key(
        Measured("rad", "5deg", above_0=True),
        "Angle of the joint by which the two servos may disagree before the joint is stopped.",
        default=5 * deg,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ProtectEntry:
    """A table [joint.NAME.protect]: when the joint is protected; see `servobus.Thresholds` for all of them."""

    warn: float | None = key(
        Measured("degC", "10degC", least=0.0), "Degrees below the servo's limit from which on is warned.", default=None
    )
    derate: float | None = key(
        Measured("degC", "5degC", least=0.0),
        "Degrees below the servo's limit from which on it is weakened.",
        default=None,
    )
    push: float | None = key(
        Measured("1", "80%", above_0=True), "Share of its output from which on a servo pushes.", default=None
    )
    stall: float | None = key(
        Measured("s", "0.5s", above_0=True), "Time of pushing without motion that is a stall.", default=None
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadEntry:
    """A table [joint.NAME.load]: what hangs on the joint of a virtual robot."""

    mass: float = key(Measured("kg", "0.2kg", least=0.0), "Mass at the end of the link.", default=0.0)
    length: float = key(Measured("m", "0.15m", least=0.0), "Length of the link.", default=0.0)
    down: float | None = key(
        _ANGLE,
        "Angle of the joint at which its link hangs straight down, or goes straight on from that of its parent, for a "
        "joint that swings in a vertical plane. Without it a joint with a parent rolls, and one without turns about a "
        "vertical axis.",
        default=None,
    )
    sense: int = key(
        Direction(),
        "-1 for a joint that swings the other way round than those of its arm with 1, seen from one side.",
        default=1,
    )
    parent: str | None = key(Name("joint"), "Joint at the end of whose link this one sits.", default=None)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointEntry:
    """A table [joint.NAME]."""

    name: str
    port: str = key(Name("port"), "Port that the servo is on.")
    model: type[Model] = key(ServoModel("rx28"), "Model of the servo, as `servobus models` lists it.")
    id: int = key(Whole(0, LAST_ID), "Id of the servo.")
    baud: int | None = key(Speed(1_000_000), "Speed of the servo, bit/s; its factory speed without this.", default=None)
    zero: float = key(_ANGLE, "Angle of the servo where the joint is at 0; 0deg without this.", default=0.0)
    direction: int = key(Direction(), "1, or -1 where the joint turns against its servo.", default=1)
    ratio: float = key(
        Number("3.0"), "Turns of the servo for one turn of the joint: the gear behind the horn.", default=1.0
    )
    limits: tuple[float, float] | None = key(
        Between(_ANGLE), "Least and greatest angle of the joint; all that the servo can without this.", default=None
    )
    limits_in_servo: bool = key(
        Switch(example=True),
        "Whether `robot apply` keeps the limits in the servos too, so that they hold whoever commands them.",
        default=False,
    )
    speed: float | None = key(Measured("rad/s", "120deg/s", above_0=True), "Greatest speed of the joint.", default=None)
    acceleration: float | None = key(
        Measured("rad/s2", "400deg/s2", above_0=True), "Greatest acceleration of the joint.", default=None
    )
    jerk: float | None = key(
        Measured("rad/s3", "4000deg/s3", above_0=True), "Greatest change of the acceleration in a second.", default=None
    )
    safe_action: SafeAction | None = key(
        OneOf(SAFE_ACTIONS), "What a crash of the program does with the joint; hold without this.", default=None
    )
    mirror: MirrorEntry | None = None
    protect: ProtectEntry | None = None
    load: LoadEntry | None = None
    registers: Mapping[str, Any] = key(
        Table("register", {"type": ["integer", "string", "boolean"]}),
        "Settings that the servos of the joint are to keep: register -> value, as `servobus registers` lists them.",
        default_factory=dict,
    )

    @property
    def thresholds(self) -> "Thresholds":
        """When the joint is protected: what [joint.NAME.protect] says, the rest as always. Raises BadValue."""
        from servobus.safety.overload import Thresholds  # noqa: PLC0415 - only some programs need it

        given = {} if self.protect is None else {name: getattr(self.protect, name) for name in keys_of(ProtectEntry)}
        return Thresholds(**{name: value for name, value in given.items() if value is not None}).check()

    @property
    def axis(self) -> Axis:
        """How the angle of the first servo belongs to that of the joint."""
        return Axis(self.zero, self.direction, self.ratio)

    @property
    def servos(self) -> tuple[ServoEntry, ...]:
        """The servos of the joint: one, or two on the same axis."""
        first = ServoEntry(port=self.port, model=self.model, id=self.id, baud=self.baud, axis=self.axis)
        if (second := self.mirror) is None:
            return (first,)
        direction = -self.direction if second.direction is None else second.direction
        return first, ServoEntry(
            port=second.port or self.port,
            model=second.model or self.model,
            id=second.id,
            baud=second.baud or (self.baud if second.model in (None, self.model) else None),
            axis=Axis(second.zero, direction, self.ratio),
        )

    @property
    def range(self) -> tuple[float, float]:
        """The angles of the joint that are allowed: its limits, within what its servos can be sent to."""
        low, high = self.limits or (-math.inf, math.inf)
        for servo in self.servos:
            row = servo.model.register("goal_position")
            ends = (row.decode(raw) for raw in row.limits)
            least, most = servo.axis.range_to_joint(*ends)
            low, high = max(low, least), min(high, most)
        return low, high


@dataclass(frozen=True, slots=True, kw_only=True)
class StepEntry:
    """One step of a motion: a pose, or angles of joints, and when it is reached."""

    time: float = key(
        Measured("s", "1.5s", least=0.0), "Time since the start of the motion at which this step is reached."
    )
    pose: str | None = key(Name("pose"), "Pose of this step.", default=None)
    joints: Mapping[str, Any] = key(
        Table("joint", _ANGLE.schema()),
        "Angles of joints, beside or instead of those of the pose.",
        default_factory=dict,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionEntry:
    """A table [motion.NAME]: steps, or a file of samples that was recorded."""

    name: str
    path: str = key(
        OneOf(("cubic", "quintic", "pchip")), "Curve through the steps: cubic, quintic or pchip.", default="cubic"
    )
    loop: bool = key(Switch(example=False), "Whether it begins again where it ends.", default=False)
    file: str | None = key(
        Text("wave.csv"), "File of samples, beside this one: time and angle of each joint.", default=None
    )
    steps: tuple[StepEntry, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotFile:
    """All that stands in a robot file.

    path     where it was read from; None for one that is no file
    virtual  None, or the options of the virtual servos that stand in for its own, as behind "virtual:arm.toml?"
    """

    path: Path | None
    text: str
    robot: RobotEntry
    ports: Mapping[str, PortEntry]
    joints: Mapping[str, JointEntry]
    groups: Mapping[str, tuple[str, ...]]
    poses: Mapping[str, Mapping[str, float]]
    motions: Mapping[str, MotionEntry]
    virtual: str | None = None

    @property
    def name(self) -> str:
        """The name for messages: that of the file."""
        return self.robot.name if self.path is None else self.path.name
