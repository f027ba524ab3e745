"""What the commands share: how ports, servos and values are typed, and how servos are found."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any, Literal, TypeVar

import click

import servobus
from servobus import Bus, BusServo
from servobus.cli.app import Verb
from servobus.core.ids import LAST_ID, check_id
from servobus.core.units import parse
from servobus.errors import BadValue, NoReply
from servobus.families import registry
from servobus.families.base import Family

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

    def rounds(self) -> list[tuple[Family, tuple[int, ...]]]:
        """List the families to ask, each with its speeds."""
        families = [registry.family(self.family)] if self.family else list(registry.FAMILIES.values())
        return [(family, self._bauds(family)) for family in families]

    def _bauds(self, family: Family) -> tuple[int, ...]:
        if self.baud == ALL:
            return registry.bauds(family)
        return registry.factory_bauds(family) if self.baud is None else (self.baud,)

    def __str__(self) -> str:
        return ", ".join(f"{family.name} at {'/'.join(map(str, bauds))}" for family, bauds in self.rounds())


def where_options(command: F) -> F:
    """Add --family and --baud, which arrive as one `where`."""

    def _where(ctx: click.Context, param: click.Parameter, value: Any) -> None:
        # Both options fill one value, so that the commands pass on one.
        old = ctx.params.get("where") or Where()
        family = value if param.name == "family" else old.family
        baud = value if param.name == "baud" else old.baud
        if family is not None:
            registry.family(family)  # an unknown name is refused before the port is opened
        ctx.params["where"] = Where(family, baud)

    options = (
        click.option("--family", metavar="FAMILY", expose_value=False, callback=_where,
                     help="Look only for dynamixel, herkulex or lewansoul servos."),
        click.option("--baud", type=BAUD, metavar="N|all", expose_value=False, callback=_where,
                     help="Look at this speed, or at every speed; else at each family's factory speed."),
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


def open_port(port: str) -> Bus:
    """Open a port, for `with`. Raises BadValue if its name is empty."""
    if not port.strip():
        raise BadValue("PORT is empty; `servobus ports` lists what is plugged in")
    return servobus.open(port)


def find(bus: Bus, where: Where, id: int) -> BusServo:
    """Find one servo. Raises NoReply with what can be tried next."""
    # A scan asks each id once, for most are not there. A servo that is named is expected to be there: after one lost
    # byte it is asked again before it counts as missing.
    for family, bauds in where.rounds() * TRIES:
        try:
            return bus.find(id, family=family, bauds=bauds)
        except NoReply:
            pass
    hint = "is it powered and connected?" if where.baud == ALL else "is it powered? `--baud all` tries every speed"
    raise NoReply(f"{bus.transport.name}: no servo answers to id {id} (tried {where}); {hint}")


def find_all(bus: Bus, where: Where, ids: Sequence[int]) -> list[BusServo]:
    """Find several servos: in one sweep over the ids, then once more for each that is missing."""
    found: dict[int, BusServo] = {}
    for family, bauds in where.rounds():
        missing = [id for id in ids if id not in found]
        if missing:
            found.update((servo.id, servo) for servo in bus.scan(family=family, bauds=bauds, ids=missing))
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
