"""What the commands share: how ports, servos and values are typed, and how servos are found."""

import contextlib
import math
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from types import FrameType
from typing import Any, Literal, TypeVar

import click

import servobus
from servobus import Bus, BusServo
from servobus.cli.app import Verb
from servobus.core.ids import LAST_ID, check_id
from servobus.core.units import parse
from servobus.errors import BadValue, NoReply, UsageError
from servobus.families import registry
from servobus.families.base import Family, Model

F = TypeVar("F", bound=Callable[..., Any])

ALL: Literal["all"] = "all"
TRIES = 2
"""Times that a servo is looked for before it counts as missing."""


def verb(name: str, *examples: str) -> Callable[[Callable[..., Any]], click.Command]:
    """Make a command with examples in its help. Its text is the docstring's."""
    return click.command(name, cls=Verb, examples=examples)


# Values


class IdType(click.ParamType[int]):
    """The id of one servo; the broadcast id is refused, since every servo would obey."""

    name = "id"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        try:
            id = int(value)
        except ValueError:
            self.fail(f"{value!r} is not an id: a number 0 .. {LAST_ID}", param, ctx)
        return check_id(id)


class IdOrAll(IdType):
    """An id, or the word `all`."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return ALL if value == ALL else super().convert(value, param, ctx)


class BaudType(click.ParamType[int | Literal["all"]]):
    """A speed in baud, or the word `all`."""

    name = "baud"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == ALL:
            return ALL
        try:
            baud = int(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number of baud nor `all`", param, ctx)
        if not 1 <= baud <= 4_000_000:
            raise BadValue(f"{baud} is not a speed in baud")
        return baud


class UnitType(click.ParamType[float]):
    """A quantity as people type it: "1.5", "1.5s", "60deg/s"."""

    def __init__(self, name: str, unit: str) -> None:
        self.name = name
        self._unit = unit

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:  # noqa: ARG002
        if isinstance(value, float):
            return value
        try:
            return parse(value, self._unit)
        except ValueError as error:
            raise BadValue(f"{param.opts[0] if param else self.name}: {error}") from None


ID = IdType()
ID_OR_ALL = IdOrAll()
BAUD = BaudType()
ANGLE = UnitType("angle", "rad")
SECONDS = UnitType("seconds", "s")
SPEED = UnitType("deg/s", "rad/s")
SHARE = UnitType("percent", "1")


def split_assignment(text: str, kind: str) -> tuple[str, str]:
    """Cut NAME=VALUE in two."""
    name, equals, value = text.partition("=")
    if not (name.strip() and equals and value.strip()):
        raise click.UsageError(f"{text!r} is not {kind}")
    return name.strip(), value.strip()


def id_list(text: str) -> list[int]:
    """Read "1-4,7"."""
    ids: set[int] = set()
    for part in text.split(","):
        low, dash, high = part.strip().partition("-")
        if not low.isdecimal() or (dash and not high.isdecimal()):
            raise click.BadParameter(f"{text!r} is no list of ids; write it like 1-4,7", param_hint="--ids")
        first, last = check_id(int(low)), check_id(int(high or low))
        if first > last:
            raise BadValue(f"ids {part.strip()}: {first} is above {last}")
        ids.update(range(first, last + 1))
    return sorted(ids)


def check_unique(ids: Iterable[int]) -> None:
    """Refuse an id that is named twice: it is not known which of the two was meant."""
    seen: set[int] = set()
    for id in ids:
        if id in seen:
            raise BadValue(f"id {id} is named twice")
        seen.add(id)


# Where to look


@dataclass(frozen=True, slots=True)
class Where:
    """Where a servo is looked for: which families, at which speeds."""

    family: str | None = None
    baud: int | Literal["all"] | None = None
    model: type[Model] | None = None
    """What a servo is that cannot say it itself."""

    def __post_init__(self) -> None:
        if self.family is not None:
            family = registry.family(self.family)  # an unknown name is refused before the port is opened
            if self.model is not None and self.model.family is not family:
                raise UsageError(f"{self.model.title} is of the family {self.model.family.name}, not {self.family}")

    def rounds(self) -> Iterator[tuple[Family, tuple[int, ...]]]:
        """Give the families to ask, each with its speeds; those of other distributions come last."""
        # One after the other: to find out what is installed takes a while, and mostly a built-in family is meant.
        for family in self._families():
            yield family, self._bauds(family)

    def _families(self) -> Iterable[Family]:
        if self.model is not None:
            return [self.model.family]
        return [registry.family(self.family)] if self.family else registry.FAMILIES.values()

    def models_of(self, family: Family) -> Iterable[type[Model]]:
        """Give the models that servos of a family can be of."""
        return registry.models_of(family) if self.model is None else [self.model]

    def _bauds(self, family: Family) -> tuple[int, ...]:
        if isinstance(self.baud, int):
            return (self.baud,)
        if self.baud == ALL:
            return self.usual_bauds(family)
        return registry.factory_bauds(family) if self.model is None else (self.model.factory_baud,)

    def usual_bauds(self, family: Family) -> tuple[int, ...]:
        """Give the speeds that servos of a family can have."""
        return registry.bauds(family) if self.model is None else self.model.bauds

    def checked(self, servo: BusServo) -> BusServo:
        """Give a servo back, or raise UsageError if it says that it is of another model than is asked for."""
        if self.model is not None and servo.model is not self.model:
            raise UsageError(f"id {servo.id} says that it is {servo.model.title}, not {self.model.title}")
        return servo

    def __str__(self) -> str:
        return ", ".join(f"{family.name} at {'/'.join(map(str, bauds))}" for family, bauds in self.rounds())


class FamilyOption(click.Option):
    """An option that takes the name of a family; its help names those that are known, in place of {families}."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        record = super().get_help_record(ctx)
        return record and (record[0], record[1].format(families=registry.names(registry.FAMILIES)))


def where_options(command: F) -> F:
    """Add --family, --baud and --model, which arrive as one `where`."""

    def _where(ctx: click.Context, param: click.Parameter, value: Any) -> None:
        # The options fill one value, so that the commands pass on one.
        old: Where = ctx.params.get("where") or Where()
        if param.name == "model" and value is not None:
            value = registry.model(value)
        ctx.params["where"] = replace(old, **{str(param.name): value})

    options = (
        click.option("--family", cls=FamilyOption, metavar="FAMILY", expose_value=False, callback=_where,
                     help="Look only for {families} servos."),
        click.option("--model", metavar="MODEL", expose_value=False, callback=_where,
                     help="What a servo is that cannot say it itself; only its family is looked for."),
        click.option("--baud", type=BAUD, metavar="N|all", expose_value=False, callback=_where,
                     help="Look at this speed, or at every speed; else at the factory speeds."),
    )  # fmt: skip
    for option in reversed(options):
        command = option(command)
    return command


def on_port(command: F) -> F:
    """Take PORT first, and where to look."""
    return click.argument("port")(where_options(command))


def on_servo(command: F) -> F:
    """Take PORT and ID first, and where to look."""
    return click.argument("port")(click.argument("id", type=ID)(where_options(command)))


def as_json(command: F) -> F:
    return click.option("--json", "json", is_flag=True, help="Print JSON.")(command)


def to_limit_options(command: F) -> F:
    """Add --to-limit and --speed, for torque that comes on outside the limits."""
    command = click.option("--speed", type=SPEED, metavar="DEG/S", help="With --to-limit: how fast; else 20°/s.")(
        command
    )
    help = "Bring a servo that stands outside its limits slowly to the nearest."
    return click.option("--to-limit", is_flag=True, help=help)(command)


def check_to_limit(to_limit: bool, speed: float | None) -> None:
    """Refuse a speed that is none, or that nothing would be moved with."""
    if speed is not None and not to_limit:
        raise click.UsageError("--speed goes with --to-limit")
    if speed is not None and not 0 < speed < math.inf:
        raise BadValue("--speed must be above 0")


def open_port(port: str) -> Bus:
    """Open a port, for `with`. Raises BadValue if its name is empty."""
    if not port.strip():
        raise BadValue("PORT is empty; `servobus ports` lists what is plugged in")
    return servobus.open(port)


def find(bus: Bus, where: Where, id: int) -> BusServo:
    """Find one servo. Raises NoReply with what can be tried next."""
    # A scan asks each id once, for most are not there. A servo that is named is expected to be there: after one lost
    # byte it is asked again before it counts as missing.
    bus.models = where.model
    for _ in range(TRIES):
        for family, bauds in where.rounds():
            try:
                return where.checked(bus.find(id, family=family, bauds=bauds))
            except NoReply:
                pass
    hint = "is it powered and connected?" if where.baud == ALL else "is it powered? `--baud all` tries every speed"
    raise NoReply(f"{bus.transport.name}: no servo answers to id {id} (tried {where}); {hint}")


def find_all(bus: Bus, where: Where, ids: Sequence[int]) -> list[BusServo]:
    """Find several servos: in one sweep over the ids, then once more for each that is missing."""
    found: dict[int, BusServo] = {}
    bus.models = where.model
    for family, bauds in where.rounds():
        if not (missing := [id for id in ids if id not in found]):
            break
        for servo in bus.scan(family=family, bauds=bauds, ids=missing):
            found[servo.id] = where.checked(servo)
    return [found.get(id) or find(bus, where, id) for id in ids]


@contextlib.contextmanager
def sigterm_as_interrupt() -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt, as Ctrl-C does, so that servos are made safe after both."""

    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    try:
        old = signal.signal(signal.SIGTERM, stop)
    except ValueError:  # not the main thread: it gets no signals
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, old)


def stop_on_signals() -> threading.Event:
    """Give an event that Ctrl-C, SIGTERM and the end of the terminal set, for commands that run until then."""
    stop = threading.Event()

    def handle(_signal: int, _frame: FrameType | None) -> None:
        stop.set()

    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):  # Windows has no SIGHUP
            signal.signal(getattr(signal, name), handle)
    return stop
