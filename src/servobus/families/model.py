"""A model: the table of its registers, the data of its maker, and what else differs from model to model.

    class AX12A(RX28):
        title, number, factory_baud = "AX-12A", 12, 1_000_000
        sheet = SpecSheet(...)
        highest_limit_temperature = RX28.highest_limit_temperature.with_(default=70)

A table inherits the rows of its parents. A row in the class body takes the place of the inherited one of the same name,
`NAME = None` takes that one out. Inherited rows are copies, so each says whose it is; a row of a parent can be used for
a child all the same, see `Model.own`. A table is checked when its class is made: a wrong one cannot be imported.

At the head of a family stands a table of what all its models share, and a model made from that alone, which stands for
servos whose model is not known: `generic = True`. It has no data sheet. What has another unit from model to model is
`RAW` in it and can only be read.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from servobus.core.registers import Register, check_overlap, check_row
from servobus.core.units import Quantity, Raw
from servobus.core.values import frozen
from servobus.errors import UnknownName, UsageError

if TYPE_CHECKING:
    from servobus.families.base import Family

T = TypeVar("T")

REQUIRED = {
    "id": "",
    "goal_position": "rad",
    "present_position": "rad",
    "min_position": "rad",
    "max_position": "rad",
    "present_voltage": "V",
    "min_voltage": "V",
    "max_voltage": "V",
    "present_temperature": "degC",
    "max_temperature": "degC",
    "torque_enable": "",
}
"""Registers that every model has under these names, with the unit of their values. All that serves several families
looks them up by these names and no others."""

OPTIONAL = {
    "model_number": "",
    "baud": "baud",
    "answer_level": "",
    "present_speed": "rad/s",
    "present_load": "1",
    "goal_speed": "rad/s",
    "goal_time": "s",
    "output_limit": "1",
    "calibration": "",
}
"""The same for what some models lack; `Model.optional` finds it.

    model_number   what the servo says when asked for its model, if that is one register
    baud           speed on the bus, for good
    answer_level   which requests it answers, as in `Answers`
    goal_speed     speed of the moves from now on, which a move by time sets
    goal_time      time of a goal that is written, which a move sets
    output_limit   in RAM, bounds the output
    calibration    shifts the angles that are read; a factory reset may leave it alone as "calibration"
"""

_TOLD = ("family", "number", "sheet", "factory_baud", "bauds", "turn_scale")
"""What a model must say beside its table."""
_SHEET = ("sheet", "turn_scale")
"""What of that a generic model lacks: the sheet always, the scale of endless turn where that differs."""


@frozen
class Performance:
    """One line of a data sheet: what the servo reaches at this voltage."""

    voltage: float
    """V"""
    stall_torque: float | None = None
    """N·m"""
    speed: float | None = None
    """rad/s without load"""
    stall_current: float | None = None
    """A"""


class Confidence(StrEnum):
    """How sure the data of a model are."""

    HIGH = "high"
    """The maker's own text, or a measurement."""
    MEDIUM = "medium"
    """Two or more texts of others that agree."""
    LOW = "low"
    """A single mention, or taken over from a sibling."""


@frozen
class SpecSheet:
    """The maker's specification of a model, in SI units. None where the manual does not say."""

    maker: str
    performance: tuple[Performance, ...]
    voltage: tuple[float, float] | None
    """Supply, V: lowest and highest."""
    angle: float
    """Range in position mode, rad."""
    resolution: float
    """rad per position unit"""
    nominal_voltage: float | None = None
    temperature: tuple[float, float] | None = None
    """Working range, °C."""
    weight: float | None = None
    """kg"""
    size: tuple[float, float, float] | None = None
    """m: width, depth and height"""
    gear_ratio: float | None = None
    gear: str = ""
    motor: str = ""
    standby_current: float | None = None
    """A"""
    max_current: float | None = None
    """A"""
    link: str = ""
    confidence: Confidence = Confidence.HIGH
    remarks: tuple[str, ...] = ()
    """What of this is uncertain, or contradicts another source: a sentence each."""

    @property
    def stall_torque(self) -> float | None:
        """N·m at the highest voltage for which it is told."""
        return next((at.stall_torque for at in reversed(self.performance) if at.stall_torque is not None), None)

    @property
    def speed(self) -> float | None:
        """rad/s without load, at the highest voltage for which it is told."""
        return next((at.speed for at in reversed(self.performance) if at.speed is not None), None)

    @property
    def supply(self) -> float | None:
        """V at which it is meant to run: nominal, or the middle of what it allows."""
        if self.nominal_voltage is None and self.voltage is not None:
            return sum(self.voltage) / 2
        return self.nominal_voltage


@frozen
class LimitPair:
    """Two registers of a model, of which the first must be below the second.

    Some servos ignore crossed limits, others take them and refuse every goal from then on.
    """

    low: str
    high: str
    equal: tuple[int, ...] = ()
    """Raw values that both may have at once: what that means is said where it may be."""

    def rows(self, model: type["Model"]) -> tuple[Register[Any], Register[Any]]:
        """Give the two registers."""
        return model.register(self.low), model.register(self.high)

    def fits(self, low: int, high: int) -> bool:
        """Tell whether the pair may be set to these raw values."""
        return low < high or (low == high and low in self.equal)


def key_of(name: str) -> str:
    """Give a name of a model as it is used in commands and files: "rx28" for "RX-28", "ex106p" for "EX-106+"."""
    return name.replace("-", "").replace("_", "").replace("+", "p").lower()


POSITION_LIMITS = LimitPair("min_position", "max_position")
VOLTAGE_LIMITS = LimitPair("min_voltage", "max_voltage")


class Model:
    """What servobus knows of one model. Subclass it; do not instantiate it.

    firmware and motors name what only virtual servos need, as "package.module:NAME". Nothing imports them before a
    virtual servo is made.
    """

    title: ClassVar[str]
    """The name on the case."""
    names: ClassVar[tuple[str, ...]] = ()
    """Other names of the same model, as sellers and earlier editions have them; a child does not inherit them."""
    series: ClassVar[str] = ""
    """The series it belongs to: its siblings have the same firmware and differ in a few rows and figures."""
    family: ClassVar["Family"]
    number: ClassVar[int | None]
    """What the servo says when asked for its model; None for families that cannot be asked."""
    sheet: ClassVar[SpecSheet]
    factory_baud: ClassVar[int]
    """Speed that it has from the factory, bit/s."""
    bauds: ClassVar[tuple[int, ...]]
    """Speeds that it can be set to, bit/s, most likely first."""
    max_move_time: ClassVar[float | None] = None
    """Longest time in seconds that one timed move can take; None if moves are given by speed."""
    turn_scale: ClassVar[Quantity]
    """Scale of the number that turns it without end: a speed ("rad/s"), or a share of full output ("1")."""
    turns: ClassVar[bool] = True
    """Whether it can turn without end."""
    limit_pairs: ClassVar[tuple[LimitPair, ...]] = (POSITION_LIMITS, VOLTAGE_LIMITS)
    """Registers of which one must be below the other."""
    brakes: ClassVar[bool] = False
    """Whether it can brake: short its motor, so that the shaft turns only slowly."""
    answers_together: ClassVar[bool] = False
    """Whether it can be read along with others by one request, which they answer one behind the other."""
    firmware: ClassVar[str] = ""
    """The class of its virtual servo, a `VirtualServo`; "" for a model that cannot be simulated."""
    practice: ClassVar[Mapping[str, Any]] = {}
    """Options of its virtual servo that are otherwise, under the reading `practice`, than its firmware has them: name
    -> value. What a parent says holds for a child too."""
    generic: ClassVar[bool] = False
    """Whether it stands for servos of the family whose model is not known. A model made from it is known again."""
    motors: ClassVar[str] = ""
    """What is known of the motors of its family: key of a model -> `MotorData`. All else is derived from the sheet."""

    registers: ClassVar[dict[str, Register[Any]]] = {}
    """Every row once, by its own name."""
    aliases: ClassVar[dict[str, str]] = {}
    """Second names: alias -> name of the row."""
    _body: ClassVar[dict[str, Register[Any] | None]] = {}
    """What the class body itself says of rows: name -> row, or None for one that is taken out."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls.generic = vars(cls).get("generic", False)
        cls.names = vars(cls).get("names", ())
        _check_body(cls)
        cls._body = {name: row for name, row in vars(cls).items() if isinstance(row, Register) or _takes_out(cls, name)}
        cls.registers, cls.aliases = {}, {}
        for kind in reversed(cls.__mro__):
            before = ""
            for name, row in vars(kind).get("_body", {}).items():
                cls._declare(name, row, before)
                before = name if name in cls.registers else before
        for name, row in cls.registers.items():
            if row.owner is not cls:
                cls.registers[name] = copy = row.with_(**cls._told_default(row))
                copy.__set_name__(cls, name)
                setattr(cls, name, copy)
        for alias, name in cls.aliases.items():
            if name not in cls.registers:
                raise TypeError(f"{cls.__name__}: {alias} is another name for {name}, which the table does not have")
            setattr(cls, alias, cls.registers[name])
            cls.registers[name].aliases += (alias,)
        for row in cls.registers.values():
            check_row(row)
        check_overlap(cls.registers.values())
        if "title" in vars(cls):  # else it is a parent of models, and may lack what they all add
            _check_complete(cls)

    @classmethod
    def _declare(cls, name: str, row: Register[Any] | None, before: str) -> None:
        """Take over one statement of a class body about a row; a new one stands behind the one before it there."""
        if row is None:
            cls.registers.pop(name, None)
            cls.aliases = {alias: whose for alias, whose in cls.aliases.items() if name not in (alias, whose)}
        elif row.name == name:
            cls.aliases.pop(name, None)
            new = name not in cls.registers
            cls.registers[name] = row
            if new and before:
                names = [known for known in cls.registers if known != name]
                names.insert(names.index(before) + 1, name)
                cls.registers = {known: cls.registers[known] for known in names}
        else:
            cls.registers.pop(name, None)
            cls.aliases[name] = row.name

    @classmethod
    def _told_default(cls, inherited: Register[Any]) -> dict[str, int]:
        """Give the factory value of an inherited row where the model says it beside its table."""
        for name, value in cls._told().items():
            if inherited.name == cls.aliases.get(name, name) and value is not None:
                return {"default": inherited.scale.encode(value)}
        return {}

    @classmethod
    def _told(cls) -> dict[str, int | None]:
        """Give what a model says beside its table that is the factory value of a row too: name of the row -> value."""
        return {"model_number": getattr(cls, "number", None), "baud": getattr(cls, "factory_baud", None)}

    @classmethod
    def key(cls) -> str:
        """Give the name used in commands and files: rx28 for RX-28."""
        return key_of(cls.title)

    @classmethod
    def named(cls, ids: str) -> str:
        """Name servos of this model: "RX-28 id 1" for "id 1"."""
        return f"{cls.title}, {ids}" if cls.generic else f"{cls.title} {ids}"

    @classmethod
    def unscaled(cls, *names: str) -> bool:
        """Tell whether one of these rows, or any of all if none is named, has a unit that is not known."""
        rows = map(cls.register, names) if names else cls.registers.values()
        return any(isinstance(row.scale, Raw) for row in rows)

    @classmethod
    def turns_at_speed(cls) -> bool:
        """Tell whether it controls the speed of endless turn; else a share of full output is set."""
        return cls.turn_scale.unit == "rad/s"

    @classmethod
    def register(cls, name: str) -> Register[Any]:
        """Find a row by its name or alias. Raises UnknownName, with the nearest names."""
        row = cls.registers.get(cls.aliases.get(name, name))
        if row is None:
            raise UnknownName(f"{cls.title} has no register {name!r:.60}; {cls._instead_of(name)}")
        return row

    @classmethod
    def _instead_of(cls, name: object) -> str:
        """Say what may be meant by what is no name of a register."""
        word = str(name).strip().lower()
        if word.isdecimal():
            near = [row.name for row in cls.registers.values() if any(at == int(word) for _, at in row.place.locations)]
        else:
            import difflib  # noqa: PLC0415 - only ever needed for this message

            names = [*cls.registers, *cls.aliases]
            close = difflib.get_close_matches(word.replace(" ", "_"), names, n=3, cutoff=0.5)
            parts = [known for known in names if len(word) > 2 and word in known]
            near = close[:1] if word.replace(" ", "_") in close else list(dict.fromkeys(parts + close))[:3]
        if near:
            return f"did you mean {' or '.join(near)}?"
        return f"`servobus registers {cls.key()}` lists them"

    @classmethod
    def optional(cls, name: str) -> Register[Any] | None:
        """Find the row for one of the names of `OPTIONAL`; None if the model lacks it."""
        if name not in OPTIONAL:
            raise UnknownName(
                f"{name!r} is no name that models may have for a register; these are {', '.join(OPTIONAL)}"
            )
        return cls.registers.get(cls.aliases.get(name, name))

    @classmethod
    def own(cls, register: Register[T]) -> Register[T]:
        """Give this model's own row for a register.

        That is the row of the same name where the register belongs to a parent, or to another child of one, and its
        values mean the same: `RX28.goal_position` stands for the goal of every model that is made from the RX-28.
        Raises UsageError for a register of a model that has nothing to do with this one, or that means something else.
        """
        row = cls.registers.get(register.name)
        if row is register:
            return register
        parents = () if register.owner is None else register.owner.__mro__
        related = any(register.name in vars(kind).get("registers", {}) and issubclass(cls, kind) for kind in parents)
        if row is not None and related and isinstance(row.scale, Raw) and register.owner is not row.owner:
            raise UsageError(
                f"{register.model} {register.name} is no register of {cls.title}, where its unit is not known; "
                f'"{register.name}" reads it raw, and --model, models= or attach() tells the model'
            )
        if row is None or not related or not row.same_value(register):
            raise UsageError(f"{register.model} {register.name} is not a register of {cls.title}")
        return row


def _check_body(cls: type[Model]) -> None:
    """Refuse what looks like a statement about a row and is none. Raises TypeError."""
    inherited = {name for parent in _parents(cls) for names in (parent.registers, parent.aliases) for name in names}
    for name, value in vars(cls).items():
        if name in inherited and not (value is None or isinstance(value, Register)):
            raise TypeError(
                f"{cls.__name__}: {name} = {value!r} is no register; change an inherited row with "
                f"{name} = {cls.__mro__[1].__name__}.{name}.with_(...), or take it out with {name} = None"
            )
        owner = value.owner if isinstance(value, Register) else None
        if owner is not None and owner is not cls and not issubclass(cls, owner):
            raise TypeError(
                f"{cls.__name__}: {name} = {value!r} is a row of another model; make one like it with "
                f"{name} = {owner.__name__}.{value.name}.with_()"
            )
        says_nothing = name.startswith("_") or name in Model.__annotations__ or hasattr(Model, name)
        if value is None and name not in inherited and not says_nothing:
            raise TypeError(f"{cls.__name__}: {name} = None takes out a row that no parent of it has")


def _takes_out(table: type[Model], name: str) -> bool:
    """Tell whether a class body takes an inherited row out, or a second name for one."""
    return vars(table)[name] is None and any(name in kind.registers or name in kind.aliases for kind in _parents(table))


def _parents(table: type[Model]) -> list[type[Model]]:
    return [kind for kind in table.__mro__[1:] if issubclass(kind, Model)]


def _check_complete(model: type[Model]) -> None:
    """Refuse a model that lacks what verbs and jobs rely on, with a TypeError that names it."""
    told = [name for name in _TOLD if not (model.generic and name in _SHEET)]
    if missing := [name for name in told if not hasattr(model, name)]:
        raise TypeError(f"{model.title}: a model says its {', '.join(missing)}")
    needs = dict.fromkeys(model.family.needs, "") | REQUIRED
    if missing := [name for name in needs if name not in model.registers and name not in model.aliases]:
        raise TypeError(
            f"{model.title} lacks the register{'s' * (len(missing) > 1)} {', '.join(missing)}: the verbs of "
            f"{model.family.title} servos rely on it; add a row, or a second name for one"
        )
    for required in map(model.register, REQUIRED):
        if not required.readable:
            raise TypeError(f"{required} must be a register that can be read: verbs rely on it")
    if not model.register("torque_enable").writable:
        raise TypeError(
            f"{model.register('torque_enable')} must be a register that can be written: no stop works without"
        )
    for name, unit in (REQUIRED | OPTIONAL).items():
        row = model.registers.get(model.aliases.get(name, name))
        unknown = row is not None and model.generic and isinstance(row.scale, Raw)
        if row is not None and unit and row.unit != unit and not unknown:
            raise TypeError(f"{row}: {name} is in {unit}, not in {row.unit or 'no unit'}")
    if not model.generic and model.unscaled():
        raw = [row.name for row in model.registers.values() if isinstance(row.scale, Raw)]
        raise TypeError(f"{model.title}: the unit of {', '.join(raw)} is not said; only a generic model may lack it")
    if wrong := [row.name for row in model.registers.values() if isinstance(row.scale, Raw) and row.writable]:
        raise TypeError(f"{model.title}: {', '.join(wrong)} can only be read as long as the unit is not known")
    goal = model.register("goal_position")
    for name in ("min_position", "max_position"):
        limit = model.register(name)
        if limit.scale != goal.scale:
            raise TypeError(f"{limit} has another scale than {goal.name}, to whose raw values it is compared")
    for pair in model.limit_pairs:
        low, high = pair.rows(model)
        if low.scale != high.scale:
            raise TypeError(f"{low} has another scale than {high.name}, to which it is compared")
    limit_row = model.optional("output_limit")
    if limit_row is not None and not (limit_row.writable and limit_row.acts_in_ram):
        raise TypeError(f"{limit_row}: an output_limit can be written in RAM")
    if model.factory_baud not in model.bauds:
        raise TypeError(f"{model.title}: its factory speed {model.factory_baud} is not among its bauds")
    for name, value in model._told().items():
        row = model.optional(name)
        if row is not None and value is not None and row.scale.encode(value) != row.default:
            raise TypeError(f"{row}: the factory setting {row.default} is not {value}, as the model says")
    model.family.check_model(model)
