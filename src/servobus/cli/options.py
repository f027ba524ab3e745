"""What the commands share: how ports, servos and values are typed, and how servos are found."""

import contextlib
import math
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from types import FrameType
from typing import Any, Literal, TypeAlias, TypeVar

import click
from click.shell_completion import CompletionItem

import servobus
from servobus import Bus, BusServo
from servobus.cli import complete
from servobus.cli.app import Verb
from servobus.core.arguments import check_baud
from servobus.core.ids import LAST_ID, check_id, parse_ids
from servobus.core.units import parse
from servobus.errors import BadValue, NoReply, ServobusError, UnknownName, UsageError
from servobus.families import registry
from servobus.families.base import Family, Model
from servobus.jobs.scan import ScanResult, scan, unknown_model
from servobus.safety.signals import ENDING

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


Ids: TypeAlias = tuple[int, ...] | Literal["all"]
"""Which servos are meant: some ids, each once, or all that there are."""


class IdsType(click.ParamType[Ids]):
    """Ids as one word: "7", "1-4,7", or the word `all`."""

    name = "ids"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Ids:
        if not isinstance(value, str):
            return tuple(value)
        if value == ALL:
            return ALL
        try:
            return tuple(dict.fromkeys(parse_ids(value)))
        except BadValue:
            raise
        except UsageError as error:
            self.fail(str(error), param, ctx)


def id_list(text: str) -> list[int]:
    """Read the ids of the option --ids: "1-4,7", or `all`."""
    try:
        ids = IDS.convert(text, None, None)
    except UsageError as error:
        raise click.BadParameter(str(error), param_hint="--ids") from None
    return list(range(LAST_ID + 1)) if isinstance(ids, str) else sorted(ids)


def are_several(ids: Ids) -> bool:
    """Tell whether results are lists: more than one servo is named, or all."""
    return ids == ALL or len(ids) > 1


def joined_ids(words: Iterable[Ids]) -> Ids:
    """Give the ids that several words name, each once. Raises UsageError for ids beside `all`."""
    named = list(words)
    if ALL in named and len(named) > 1:
        raise click.UsageError(f"say either ids or `{ALL}`")
    if ALL in named:
        return ALL
    return tuple(dict.fromkeys(id for ids in named if not isinstance(ids, str) for id in ids))


def split_ids(words: Sequence[str]) -> tuple[Ids, tuple[str, ...]]:
    """Cut words in two: the ids at their beginning, and the others. Raises UsageError without ids.

    What begins with a digit and has no = in it is ids.
    """
    count = 1
    while count < len(words) and (words[count] == ALL or (words[count][:1].isdecimal() and "=" not in words[count])):
        count += 1
    return joined_ids(IDS.convert(word, None, None) for word in words[:count]), tuple(words[count:])


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
        return check_baud(baud)


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
IDS = IdsType()
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


def check_above_0(option: str, value: float | None) -> None:
    """Refuse a number that is not above 0. Raises BadParameter."""
    if value is not None and value <= 0:
        raise click.BadParameter(f"{value:g} is not above 0", param_hint=option)


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

    def everywhere(self) -> list[tuple[Family, tuple[int, ...]]]:
        """Give the families, each with all speeds that its servos can have, or with the one that is asked for."""
        if isinstance(self.baud, int):
            return list(self.rounds())
        return [(family, self.usual_bauds(family)) for family in self._families()]

    def usual_bauds(self, family: Family) -> tuple[int, ...]:
        """Give the speeds that servos of a family can have."""
        return registry.bauds(family) if self.model is None else self.model.bauds

    def checked(self, servo: BusServo) -> BusServo:
        """Give a servo back, or raise UsageError if it says that it is of another model than is asked for."""
        if self.model is not None and servo.model is not self.model:
            raise UsageError(f"id {servo.id} says that it is {servo.model.title}, not {self.model.title}")
        return servo

    def __str__(self) -> str:
        return rounds_text(self.rounds())


def rounds_text(rounds: Iterable[tuple[Family, Sequence[int]]]) -> str:
    """Say which families are meant, each at which speeds."""
    return ", ".join(f"{family.name} at {'/'.join(map(str, bauds))}" for family, bauds in rounds)


class FamilyOption(click.Option):
    """An option that takes the name of a family; its help names those that are known, in place of {families}."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        record = super().get_help_record(ctx)
        return record and (record[0], record[1].format(families=registry.names(registry.FAMILIES)))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        return complete.families(ctx, self, incomplete)


class ModelOption(click.Option):
    """An option that takes the name of a model."""

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        return complete.models(ctx, self, incomplete)


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
        click.option("--model", cls=ModelOption, metavar="MODEL", expose_value=False, callback=_where,
                     help="What a servo is that cannot say it itself; only its family is looked for."),
        click.option("--baud", type=BAUD, metavar="N|all", expose_value=False, callback=_where,
                     help="Look at this speed, or at every speed; else at the factory speeds."),
    )  # fmt: skip
    for option in reversed(options):
        command = option(command)
    return command


def port_argument() -> Callable[[F], F]:
    """Make the argument PORT."""
    return click.argument("port", shell_complete=complete.ports)


def on_port(command: F) -> F:
    """Take PORT first, and where to look."""
    return port_argument()(where_options(command))


def on_servo(command: F) -> F:
    """Take PORT and ID first, and where to look."""
    return port_argument()(click.argument("id", type=ID)(where_options(command)))


def on_servos(command: F) -> F:
    """Take PORT and ID... first, and where to look. The ids arrive as `ids`."""

    def _joined(_ctx: click.Context, _param: click.Parameter, words: tuple[Ids, ...]) -> Ids:
        return joined_ids(words)

    ids = click.argument("ids", metavar="ID...", type=IDS, nargs=-1, required=True, callback=_joined)
    return port_argument()(ids(where_options(command)))


def on_servos_with(
    name: str, metavar: str, *, needed: bool = True, shell_complete: complete.Complete | None = None
) -> Callable[[F], F]:
    """Take PORT and ID... first, then words of another kind, and where to look.

    The ids arrive as `ids`, the other words as `name`.
    """

    def _split(ctx: click.Context, _param: click.Parameter, words: tuple[str, ...]) -> tuple[str, ...]:
        ctx.params["ids"], rest = split_ids(words)
        if needed and not rest:
            raise click.UsageError(f"say {metavar} after the ids", ctx)
        return rest

    def take(command: F) -> F:
        words = click.argument(
            name,
            metavar=f"ID... {metavar}",
            nargs=-1,
            required=True,
            callback=_split,
            shell_complete=shell_complete,
        )
        return port_argument()(words(where_options(command)))

    return take


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
    """Open a port, for `with`."""
    return servobus.open(port)


class Search:
    """Which of the servos that are meant are there.

    servos   those that are, in the order in which they were asked for
    missing  id -> why this one cannot be used, for the others
    """

    def __init__(self) -> None:
        self.servos: list[BusServo] = []
        self.missing: dict[int, ServobusError] = {}


def search(bus: Bus, where: Where, ids: Ids, *, shared: bool = False) -> Search:
    """Look for servos, in all families and at all speeds where they may be.

    An id that two servos have does not say which of them is meant, and counts as missing; with `shared` both are meant.
    Raises NoReply if all are meant and there is none.
    """
    bus.models = where.model
    result = ScanResult()
    wanted: Sequence[int] = range(LAST_ID + 1) if ids == ALL else ids
    # A scan asks each id once, for most are not there. A servo that is named is expected to be there: after one lost
    # byte it is asked again before it counts as missing.
    for _ in range(1 if ids == ALL else TRIES):
        met = {found.id for found in result.found}
        if absent := [id for id in wanted if id not in met]:
            for family, bauds in where.rounds():
                bus.do(scan([family], bauds, absent, None, result, bus.identify))
    outcome = Search()
    for id in wanted:
        try:
            outcome.servos += _identified(bus, where, id, result, shared=shared or ids == ALL, named=ids != ALL)
        except ServobusError as error:
            outcome.missing[id] = error
    if ids == ALL and not outcome.servos:
        raise next(iter(outcome.missing.values()), NoReply(f"{bus.transport.name}: no servo answers ({where})"))
    return outcome


def _identified(
    bus: Bus, where: Where, id: int, result: ScanResult, *, shared: bool, named: bool
) -> Sequence[BusServo]:
    """Give the servos with an id. Raises ServobusError if it is not known which is meant, or if none can be used."""
    found = [one for one in result.found if one.id == id]
    if found:
        servos = [bus.adopt(one) for one in found]
        known = [where.checked(servo) for servo in servos if servo is not None]
        if len(known) > 1 and not shared:
            raise UnknownName(_ambiguous(id, known))
        if not known:
            raise unknown_model(found[0])
        return known
    if trouble := next((one for one in result.troubles if one.id == id), None):
        raise trouble.error
    if not named:
        return []
    hint = "is it powered and connected?" if where.baud == ALL else "is it powered? `--baud all` tries every speed"
    raise NoReply(f"{bus.transport.name}: no servo answers to id {id} (tried {where}); {hint}")


def _ambiguous(id: int, servos: Sequence[BusServo]) -> str:
    names = " and ".join(f"{servo.target} at {servo.baud}" for servo in servos)
    families = dict.fromkeys(servo.family.name for servo in servos)
    options = (
        [f"--family {family}" for family in families]
        if len(families) == len(servos)
        else [f"--family {servo.family.name} --baud {servo.baud}" for servo in servos]
    )
    return f"id {id} is not unique here: {names}; say which with {' or '.join(options)}"


def find(bus: Bus, where: Where, id: int) -> BusServo:
    """Find one servo. Raises NoReply with what can be tried next, UnknownName for an id that two servos have."""
    (servo,) = find_all(bus, where, (id,))
    return servo


def find_all(bus: Bus, where: Where, ids: Ids, *, shared: bool = False) -> list[BusServo]:
    """Find servos, or none if one of them cannot be used: then raise what is the matter with that; see `search`."""
    outcome = search(bus, where, ids, shared=shared)
    for error in outcome.missing.values():
        raise error
    return outcome.servos


def for_each(bus: Bus, where: Where, ids: Ids, action: Callable[[BusServo], None]) -> None:
    """Do something with each servo that is meant and there; what went wrong with the others is raised at the end."""
    outcome = search(bus, where, ids)
    failures = list(outcome.missing.values())
    for servo in outcome.servos:
        try:
            action(servo)
        except ServobusError as error:
            failures.append(error)
    if len(failures) > 1:
        raise ServobusError("; ".join(map(str, failures)))
    for failure in failures:
        raise failure


@contextlib.contextmanager
def unless_nobody_answers(otherwise: str) -> Iterator[None]:
    """Say which option answers a question in place of a person, where no person is there to answer."""
    try:
        yield
    except click.Abort as abort:
        if isinstance(abort.__context__, EOFError):
            click.echo(err=True)  # the question stands on a line of its own
            raise UsageError(f"nobody is there to answer, and nothing was changed: {otherwise}") from abort
        raise


@contextlib.contextmanager
def signals_as_interrupt() -> Iterator[None]:
    """Let what ends a program raise KeyboardInterrupt, as Ctrl-C does, so that servos are made safe.

    That is SIGTERM, SIGHUP (the terminal was closed) and SIGQUIT; not one that is ignored, as SIGHUP is under nohup.
    """

    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    old: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():  # no other gets signals
        old = {number: signal.getsignal(number) for number in ENDING}
        old = {number: handler for number, handler in old.items() if handler not in (None, signal.SIG_IGN)}
    try:
        for number in old:
            signal.signal(number, stop)
        yield
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)


def stop_on_signals() -> threading.Event:
    """Give an event that Ctrl-C, SIGTERM and the end of the terminal set, for commands that run until then.

    A signal that is ignored stays so, as SIGHUP under nohup.
    """
    stop = threading.Event()

    def handle(_signal: int, _frame: FrameType | None) -> None:
        stop.set()

    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handle)
    return stop
