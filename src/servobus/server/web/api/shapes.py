"""What goes in and out of the API, for checks of requests and for its description."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,39}$")]
Text = Annotated[str, Field(max_length=200)]
ServoKey = Annotated[
    str, Field(max_length=80, description="FAMILY:ID@BAUD, such as dynamixel:1@57600; the id alone where it is unique")
]
Id = Annotated[int, Field(ge=0, le=253)]
Baud = Annotated[int, Field(ge=1, le=10_000_000)]
Angle = Annotated[Finite, Field(description="rad")]
Seconds = Annotated[Finite, Field(gt=0, le=3600, description="s")]
Speed = Annotated[Finite, Field(gt=0, le=1000, description="rad/s")]


class Body(BaseModel):
    """What is sent: unknown keys and values of another type are refused."""

    model_config = ConfigDict(extra="forbid", strict=True)


class RawValue(Body):
    """A raw integer, as it stands in the register."""

    raw: int


RegisterValue = bool | int | Finite | Text | Annotated[list[Text], Field(max_length=32)] | RawValue
"""A number in SI units, true or false for a switch, a text as people type it, a list of flags, or a raw integer."""
RegisterValues = Annotated[dict[Text, RegisterValue], Field(min_length=1, max_length=256)]
Goals = Annotated[dict[ServoKey, Angle], Field(min_length=1, max_length=254)]


class LoginBody(Body):
    """One of both: the token of a link, or the password."""

    token: Annotated[str, Field(max_length=200)] | None = None
    password: Annotated[str, Field(max_length=1024)] | None = None


class OpenBody(Body):
    name: Name
    port: Annotated[str, Field(min_length=1, max_length=400, description="/dev/ttyUSB0, COM4, virtual:rx28@1-4, ...")]


class AttachBody(Body):
    model: Annotated[str, Field(max_length=60, description="a name of GET /models")]
    id: Id
    baud: Baud | None = None


class StopBody(Body):
    servos: Annotated[list[ServoKey], Field(max_length=254)] | None = Field(
        default=None, description="which servos; all of the bus by default"
    )


class TakeBody(Body):
    servos: Annotated[list[ServoKey], Field(min_length=1, max_length=254)]


class WriteBody(Body):
    values: RegisterValues
    save: bool = Field(default=False, description="whether they survive power-off: EEPROM is written")


class MoveBody(Body):
    goals: Goals
    time: Seconds | None = None
    speed: Speed | None = Field(default=None, description="rad/s of the servo with the longest way")


class JointMoveBody(Body):
    goals: Annotated[dict[Text, Angle], Field(min_length=1, max_length=254)] | None = Field(
        default=None, description="joint -> rad"
    )
    pose: Text | None = Field(default=None, description="the name of a pose, in place of goals")
    time: Seconds | None = None
    speed: Speed | None = None


class TorqueBody(Body):
    on: bool
    to_limit: bool = Field(default=False, description="whether servos outside their limits are brought to the nearest")
    servos: Annotated[list[ServoKey], Field(max_length=254)] | None = None


class SwitchBody(Body):
    on: bool


class TurnBody(Body):
    """One of three, whichever the model controls."""

    speed: Annotated[Finite, Field(ge=-1000, le=1000, description="rad/s")] | None = None
    output: Annotated[Finite, Field(ge=-1, le=1)] | None = None
    current: Annotated[Finite, Field(ge=-100, le=100, description="A")] | None = None


class PositionModeBody(Body):
    limits: Annotated[list[Angle], Field(min_length=2, max_length=2)] | None = None
    multi_turn: bool = False


class LedBody(Body):
    colour: Annotated[str, Field(max_length=40, description='"on", "off", or a colour where the model has one')]


class ScanBody(Body):
    families: Annotated[list[Text], Field(min_length=1, max_length=16)] | None = None
    bauds: Annotated[list[Baud], Field(min_length=1, max_length=32)] | None = Field(
        default=None, description="factory speeds by default"
    )
    ids: Annotated[list[Id], Field(min_length=1, max_length=254)] | None = None


class DoctorBody(Body):
    ids: Annotated[list[Id], Field(min_length=1, max_length=254)] | None = None
    reads: Annotated[int, Field(ge=0, le=100_000)] = 1000


class BackupBody(Body):
    text: Annotated[str, Field(max_length=500_000, description="a backup file, as GET .../backup gives it")]


class RestoreBody(BackupBody):
    torque_off: bool = Field(default=False, description="whether a servo with torque goes limp first")


class IdentityBody(Body):
    id: Id | None = None
    baud: Baud | None = None


class ResetBody(Body):
    keep: Annotated[list[Literal["id", "baud", "calibration"]], Field(max_length=3)] = []


class ApplyBody(Body):
    torque_off: bool = False
    offsets: bool = Field(default=False, description="whether offsets are written that shift the angles of joints")


class UndoBody(Body):
    torque_off: bool = False


class TokenBody(Body):
    name: Name
    role: Literal["viewer", "operator", "admin"]


class LinkBody(Body):
    role: Literal["viewer", "operator", "admin"] = "viewer"


# What comes back


class Problem(BaseModel):
    """What went wrong."""

    type: str = Field(description="the class of the error, such as NoReply or BadValue")
    message: str
    remedy: str | None = None
    detail: Any = None


class Error(BaseModel):
    error: Problem


class Health(BaseModel):
    ok: bool


class Ok(BaseModel):
    ok: bool = True


class Who(BaseModel):
    id: str
    name: str
    role: Literal["viewer", "operator", "admin"]
    kind: Literal["browser", "program"]


class Server(BaseModel):
    version: str
    time: float = Field(description="s, by the clock that the live connection tells times by")
    warning: str | None = Field(description="what every page must show; null where nothing is the matter")
    read_only: bool
    you: Who
    clients: int


class Bus(BaseModel):
    name: str
    port: str
    gone: str | None = Field(description="why the port cannot be used")
    stopped_by: str | None = Field(description="who has stopped it; nothing moves until somebody resumes")
    servos: int
    sent: int
    failed: int


class SeenState(BaseModel):
    position: float | None = Field(description="rad")
    voltage: float | None = Field(description="V")
    temperature: float | None = Field(description="°C")
    torque: bool
    shutdown: str | None
    text: str


class Servo(BaseModel):
    key: str
    family: str
    model: str | None
    model_number: int | None
    id: int
    baud: int
    firmware: str
    title: str
    state: SeenState | None = Field(description="as it was seen last")
    alarms: list[str]
    latched: list[str] = Field(description="alarms that are over, too")
    lost: bool
    driven: bool
    holder: str | None = Field(description="who drives it, and is watched meanwhile; nobody else may")
    restarted: bool
    eeprom_writes: int


class Value(BaseModel):
    value: Any = Field(description="in the SI unit; a list of names for flags, a name for a choice")
    unit: str
    raw: int
    text: str


class RegisterRow(BaseModel):
    model_config = ConfigDict(extra="allow")

    name: str
    aliases: list[str]
    access: str
    area: str
    kind: str
    unit: str
    limits: list[Any] | None
    default: Any
    meaning: str


class RegisterNow(RegisterRow):
    now: Value | None = Field(description="null where this servo lacks it")
    stored: Value | None = Field(description="what survives power-off, where that is a copy of its own")


class Change(BaseModel):
    old: Any
    new: Any
    unit: str
    text: str


class Written(Change):
    taken: bool | None = Field(description="whether it was read back as asked for; null where nothing can be read")


class WriteResult(BaseModel):
    changes: dict[str, Written]
    saved: bool


class Preview(BaseModel):
    changes: dict[str, Change]
    eeprom_writes: int


class RestorePreview(Preview):
    impossible: dict[str, str]
    torque: bool = Field(description="whether the torque is on: then it has to go off first")


class Names(BaseModel):
    names: list[str]


class Job(BaseModel):
    id: str
    kind: str
    bus: str
    by: str
    state: Literal["running", "done", "failed", "cancelled"]
    done: int
    total: int
    text: str
    found: list[Any]
    result: Any
    error: Problem | None
    began: float
    ended: float | None


class SavedBackup(BaseModel):
    family: str
    model: str | None
    model_number: int | None
    id: int
    baud: int
    firmware: str
    text: str = Field(description="the file, as `servobus restore` takes it too")
    settings: dict[str, Value]


class ModelTable(BaseModel):
    sheet: dict[str, Any]
    registers: list[RegisterRow]


class Robot(BaseModel):
    name: str
    file: str
    buses: list[str]
    joints: dict[str, Any]
    groups: dict[str, list[str]]
    poses: dict[str, dict[str, float]]
    motions: list[str]


class Positions(BaseModel):
    positions: dict[str, float]
    lost: dict[str, str]


class Plan(BaseModel):
    file: str
    changes: int
    eeprom_writes: int
    servos: list[Any]
    problems: list[str]
    text: str


class Recording(BaseModel):
    name: str
    size: int
    time: float


class Secret(BaseModel):
    token: str = Field(description="shown this once")


class Link(BaseModel):
    url: str
    seconds: float
