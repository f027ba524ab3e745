"""Which virtual servos: the words people write.

rx28@1                       one RX-28 with id 1
rx28@1-4,7,lx16a@2           five RX-28 and an LX-16A
rx28@1-4,goal_torque=off     four RX-28 with an option of their firmware
virtual:rx28@1?voltage=12    a port of this process, with options
mass=0.2,length=0.1          a load: an arm of 10 cm with 200 g at its end
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, TypeAlias
from urllib.parse import parse_qsl

from servobus.core.ids import parse_range
from servobus.core.units import Switch, parse, show
from servobus.errors import BadValue, UsageError
from servobus.families import registry
from servobus.families.base import Model
from servobus.virtual.device.options import READINGS, Reading, options_of, read_options, suggestion
from servobus.virtual.device.servo import firmware
from servobus.virtual.physics.motor import NOTHING, Load
from servobus.virtual.wire.adapter import WHOLE, Adapter
from servobus.virtual.wire.faults import NO_FAULTS, Faults

NO_OPTIONS: Mapping[str, str] = MappingProxyType({})


class Group(NamedTuple):
    """Servos of one model: their ids, what is said of them, as it was typed, and where their shafts stand at first."""

    model: type[Model]
    ids: list[int]
    options: Mapping[str, str] = NO_OPTIONS
    position: float | None = None  # rad; None is where a servo out of its box has it


Clock: TypeAlias = Literal["real", "virtual"]
Servos: TypeAlias = list[Group]
"""Groups of servos in the order they are named."""

PREFIX = "virtual:"
EXAMPLE = "rx28@1-4,7,lx16a@2"

REAL_CLOCK = (
    "clock=virtual is for a port inside one program, such as virtual:rx28@1?clock=virtual: the virtual clock advances "
    "while that program waits for the servos, and programs behind a pseudo terminal or TCP wait by their own clocks; "
    "leave it out here"
)
"""Why servos that are served to other programs have no virtual clock."""

HIGHEST_VOLTAGE = 30.0
"""V; no servo here is made for more than 18.5, and a slip of the point would burn it."""
TEMPERATURES = -50.0, 200.0
"""degC that a case may be set to."""
HIGHEST_RESISTANCE = 1000.0
"""ohm of a supply."""

_LOAD_UNITS = {"inertia": "kgm2", "mass": "kg", "length": "m", "down": "rad", "tilt": "rad", "torque": "Nm"}
HIGHEST_LOADS = {
    "inertia": 1000.0, "mass": 1000.0, "length": 10.0, "down": 20 * math.pi, "tilt": 20 * math.pi, "torque": 10_000.0,
}  # fmt: skip
"""What a load may be, in kg·m², kg, m, rad and N·m. Assumption: far more than servos of these kinds could move."""
_NEVER_NEGATIVE = "inertia", "mass", "length"
LOAD_WORDS = "inertia, mass, length, torque, down, tilt, blocked, none"


@dataclass(frozen=True, slots=True)
class Setup:
    """Virtual servos and what surrounds them.

    clock        "real", or "virtual": time passes only while the client waits
    echo         whether the client hears what it sends
    baud         speed that the servos start with instead of the stored one
    voltage      supply, V
    temperature  of the cases, degC
    state        file that keeps the EEPROM contents
    motor        name of a set of motor data, see `servobus.virtual.device.motors`; `manual` by default
    supply_resistance
                 ohm between the supply and all servos of a line, which then share it; None: it is not felt
    load         what hangs on every shaft at the start
    adapter      in which pieces the client gets what it receives
    faults       what goes wrong between the servos and the client
    reading      whether servos do what is known from practice, or what their manuals say, where the two differ
    options      options for all servos that have them, and raw values that registers hold: name -> value as typed

    Raises BadValue for a value that makes no sense, UsageError for an option that no servo has.
    """

    servos: Servos
    clock: Clock = "real"
    echo: bool = False
    baud: int | None = None
    voltage: float | None = None
    temperature: float | None = None
    state: Path | None = None
    motor: str | None = None
    supply_resistance: float | None = None
    load: Load = NOTHING
    adapter: Adapter = WHOLE
    faults: Faults = NO_FAULTS
    reading: Reading = "practice"
    options: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.reading not in READINGS:
            raise BadValue(f"{self.reading!r} is no reading of the manuals: there are {', '.join(READINGS)}")
        models = dict.fromkeys(group.model for group in self.servos)
        for name in self.options:
            if not any(has_option(model, name) for model in models):
                raise UsageError(_unknown(name, list(models)))
        for group in self.servos:
            self.settings(group)
        if self.voltage is not None:
            check_voltage(self.voltage)
        if self.temperature is not None:
            check_temperature(self.temperature)
        if self.supply_resistance is not None and not 0 <= self.supply_resistance <= HIGHEST_RESISTANCE:
            raise BadValue(f"supply resistance {self.supply_resistance:g} ohm is not in 0 .. {HIGHEST_RESISTANCE:g}")

    def settings(self, group: Group) -> tuple[dict[str, Any], dict[str, int]]:
        """Give the options of a group, and what registers hold, by name. Raises BadValue or UsageError."""
        model = group.model
        said = {name: word for name, word in self.options.items() if has_option(model, name)} | dict(group.options)
        known = options_of(firmware(model))
        for name in said:
            if not has_option(model, name):
                raise UsageError(_unknown(name, [model]))
        options = read_options(firmware(model), model, {name: word for name, word in said.items() if name in known})
        return options, {name: _raw(model, name, word) for name, word in said.items() if name not in known}


def has_option(model: type[Model], name: str) -> bool:
    """Tell whether a model has an option of this name, or a register that can hold a value."""
    return name in options_of(firmware(model)) or name in model.registers or name in model.aliases


def _unknown(name: str, models: list[type[Model]]) -> str:
    if name in SURROUNDINGS:
        return (
            f"{name} is no option of a servo but of the whole port: ?{name}=... behind a port's name, or "
            f"--{name.replace('_', '-')} of `servobus virtual`"
        )
    has = "; ".join(f"{model.title}: {suggestion(name, options_of(firmware(model)))}" for model in models)
    said = f"{models[0].title} has no option" if len(models) == 1 else "no servo here has an option"
    return f"{said} {name!r}. {has}"


def _raw(model: type[Model], name: str, word: str) -> int:
    """Read what a register holds: a raw number, or a value with its unit."""
    row = model.register(name)
    try:
        return int(word, 0)
    except ValueError:
        pass
    try:
        raw: int = row.scale.encode(row.scale.parse(word))
    except ValueError as error:
        raise BadValue(f"{model.title}: {name}={word}: {error}") from None
    return raw


def check_voltage(volts: float) -> float:
    """Give back a supply in V. Raises BadValue unless it can be one."""
    if not 0 <= volts <= HIGHEST_VOLTAGE:
        raise BadValue(f"voltage {volts:g} V is not in 0 .. {HIGHEST_VOLTAGE:g}")
    return volts


def check_temperature(celsius: float) -> float:
    """Give back a temperature in degC. Raises BadValue unless a case can have it."""
    low, high = TEMPERATURES
    if not low <= celsius <= high:
        raise BadValue(f"temperature {celsius:g} °C is not in {low:g} .. {high:g}")
    return celsius


def parse_specs(text: str) -> Servos:
    """Read "rx28@1-4,7,lx16a@2,surplus=ignored". An option belongs to the servos of the last model in front of it.

    Raises UnknownName for a model that is not known, else UsageError.
    """
    servos: Servos = []
    for part in text.replace(" ", "").split(","):
        option, equals, value = part.partition("=")
        name, at, ids = part.rpartition("@")
        if at and not equals:
            servos.append(Group(registry.simulated(name), []))
        if not servos:
            raise UsageError(f"{text!r} names no servos; write MODEL@IDS, such as {EXAMPLE}")
        last = servos[-1]
        if equals:
            if option in last.options:
                raise UsageError(f"{text!r} says {option} twice of the same servos; leave one out")
            servos[-1] = last._replace(options={**last.options, option: value})
        else:
            last.ids.extend(parse_range(ids, text))
    return servos


def parse_url(text: str) -> Setup:
    """Read "virtual:rx28@1-4?clock=virtual&voltage=12". Raises UsageError."""
    specs, _, query = text.removeprefix(PREFIX).partition("?")
    return setup_of(parse_specs(specs), parse_qsl(query, keep_blank_values=True), text)


def setup_of(servos: Servos, said: Iterable[tuple[str, str]], text: str) -> Setup:
    """Read what is said of servos, name and value; `text` is for messages. Raises UsageError."""
    surroundings: dict[str, Any] = {}
    options: dict[str, str] = {}
    for name, value in said:
        if name in options or SURROUNDINGS.get(name) in surroundings:
            raise UsageError(f"{text!r} says {name} twice; leave one out")
        if name not in SURROUNDINGS:
            options[name] = value
            continue
        try:
            surroundings[SURROUNDINGS[name]] = _surrounding(name, value)
        except UsageError:
            raise
        except ValueError as error:
            raise BadValue(f"{text!r}: {name}: {error}") from None
    try:
        return Setup(servos, options=options, **surroundings)
    except UsageError as error:
        if not options:
            raise
        raise type(error)(f"{error}. Of the port itself there are {', '.join(SURROUNDINGS)}") from None


SURROUNDINGS = {one.name: one.name for one in fields(Setup) if one.name not in ("servos", "reading", "options")} | {
    "as": "reading"
}
"""What a URL says of all servos and of the port: its name there -> that of the field of `Setup`."""


def _surrounding(name: str, value: str) -> object:
    match name:
        case "clock":
            if value not in ("real", "virtual"):
                raise ValueError(f"{value!r} is neither real nor virtual")
            return value
        case "echo":
            return Switch().parse(value)
        case "baud":
            if not re.fullmatch("[0-9]{1,9}", value):
                raise ValueError(f"{value!r} is no speed; write it as a number such as 115200")
            return int(value)
        case "voltage":
            return parse(value, "V")
        case "temperature":
            return parse(value, "degC")
        case "state" | "motor" if not value:
            raise ValueError("this says nothing")
        case "state":
            return Path(value)
        case "supply_resistance":
            return parse(value, "ohm")
        case "load":
            return parse_load(value)
        case "adapter":
            return Adapter.parse(value)
        case "faults":
            return Faults.parse(value)
    return value


def parse_load(text: str, base: Load = NOTHING) -> Load:
    """Read "mass=0.2,length=0.1", "torque=-0.5 blocked" or "none": a load with these changes. Raises BadValue.

    Numbers are in kg, m, kg·m² and N·m, angles in degrees. Instead of = there may be a colon, for URLs, and
    instead of commas spaces.
    """
    load = base
    for part in filter(None, re.split(r"[,\s]+", text)):
        name, _, value = part.replace(":", "=").partition("=")
        try:
            load = NOTHING if part == "none" else replace(load, **{name: _load_value(name, value)})
        except ValueError as error:
            raise BadValue(f"load {part!r}: {error}") from None
    return load


def _load_value(name: str, value: str) -> float:
    if name == "blocked":
        return float(Switch().parse(value or "on"))
    if name not in _LOAD_UNITS:
        raise ValueError(f"a load has {LOAD_WORDS}")
    number = parse(value, _LOAD_UNITS[name])
    if not math.isfinite(number):
        raise ValueError("this is no number to reckon with")
    if number < 0 and name in _NEVER_NEGATIVE:
        raise ValueError("it cannot be negative")
    unit, most = _LOAD_UNITS[name], HIGHEST_LOADS[name]
    if abs(number) > most:
        raise ValueError(f"{show(number, unit)} is more than {show(most, unit)}")
    return number
