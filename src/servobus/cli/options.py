"""Arguments and options that several commands share."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import click
from click.shell_completion import CompletionItem

from servobus.cli import complete
from servobus.cli.app import Verb
from servobus.cli.finding import Where
from servobus.cli.values import BAUD, ID, IDS, SPEED, Ids, joined_ids, split_ids
from servobus.errors import BadValue
from servobus.families import registry

F = TypeVar("F", bound=Callable[..., Any])


def verb(name: str, *examples: str) -> Callable[[Callable[..., Any]], click.Command]:
    """Make a command with examples in its help. Its text is the docstring's."""
    return click.command(name, cls=Verb, examples=examples)


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
