"""`robot export` and `robot import`: files of other programs, from and to robot files."""

from collections.abc import Callable, Sequence
from pathlib import Path

import click
from click.shell_completion import CompletionItem

from servobus.cli import complete
from servobus.cli.options import verb
from servobus.cli.output import note
from servobus.errors import FormatError, RobotFileError
from servobus.robots.file.reading import read_file, read_text
from servobus.robots.file.writing import create, edited, save
from servobus.robots.formats.base import ALL, Format, Given, plain_name
from servobus.robots.formats.d6a import KINDS
from servobus.robots.formats.draft import draft_text
from servobus.robots.formats.table import FORMATS, by_name, recognised

COMING = [name for name, one in FORMATS.items() if one.new or one.onto]
GOING = [name for name, one in FORMATS.items() if one.write]


class FormatName(click.ParamType[Format]):
    """The name of a format."""

    name = "format"

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> Format:  # noqa: ARG002
        return by_name(value, self.names)

    def shell_complete(self, _ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return [CompletionItem(name, help=FORMATS[name].title) for name in self.names if name.startswith(incomplete)]


@verb(
    "export",
    "servobus robot export arm.toml lerobot -o follower.json",
    "servobus robot export arm.toml pypot -o robot.json",
    "servobus robot export arm.toml ros2_control | less",
)
@click.argument("file", type=click.Path())
@click.argument("format", type=FormatName(GOING))
@click.option("-o", "--output", metavar="OUT", help="Where to; standard output without it.")
@click.option("--force", is_flag=True, help="Replace OUT if it exists.")
def export(file: str, format: Format, output: str | None, force: bool) -> None:
    """Write the robot of FILE as a file of another program.

    FORMAT is lerobot (calibration), pypot (configuration), robotis (.robot), urdf, or ros2_control (URDF for
    dynamixel_hardware). Notes on standard error say what such a file cannot carry. No port is opened.
    """
    assert format.write is not None  # its name was among those
    made = format.write(read_file(file))
    if output is None:
        click.echo(made.text, nl=False)
    else:
        _write(Path(output), made.text, force=force)
        click.echo(f"{format.title} written to {output}")
    note(f"not in {format.a_title}: {format.lacks}")
    for text in made.notes:
        note(text)


def _write(path: Path, text: str, *, force: bool) -> None:
    try:
        with path.open("w" if force else "x", encoding="utf-8", newline="\n") as out:
            out.write(text)
    except FileExistsError:
        raise FormatError(f"{path} exists already; choose another name, or replace it with --force") from None
    except OSError as error:
        raise FormatError(f"{path}: cannot be written: {error.strerror or error}") from None


def _pairs(what: str, *, for_all: bool) -> Callable[..., dict[str, str]]:
    """Read options such as NAME=VALUE; without a name the value is for all, if that makes sense."""

    def read(_ctx: click.Context, _param: click.Parameter, words: tuple[str, ...]) -> dict[str, str]:
        pairs: dict[str, str] = {}
        for word in words:
            name, equals, value = word.rpartition("=")
            if not value or (not equals and not for_all) or (equals and not name):
                raise click.UsageError(f"{word!r} is no {what}")
            pairs[name if equals else ALL] = value
        return pairs

    return read


def _ports(_ctx: click.Context, _param: click.Parameter, words: tuple[str, ...]) -> dict[str, str]:
    """Read --port: a path may have = in it, so a name is one only if it looks like one."""
    pairs: dict[str, str] = {}
    for word in words:
        name, equals, path = word.partition("=")
        named = bool(equals) and plain_name(name) == name
        pairs[name if named else ALL] = path if named else word
    return pairs


@verb(
    "import",
    "servobus robot import robot.json -o arm.toml --port /dev/ttyUSB0",
    "servobus robot import follower.json --onto arm.toml",
    "servobus robot import arm.urdf --onto arm.toml --joint joint1=base",
    "servobus robot import wave.d6a --onto arm.toml --name wave",
)
@click.argument("source", metavar="IN", type=click.Path())
@click.option(
    "--format", type=FormatName(COMING), metavar="F", help="Format of IN; told by what is in it without this."
)
@click.option("-o", "--output", metavar="FILE", help="The robot file to make; standard output without it.")
@click.option("--onto", metavar="FILE", help="The robot file to take it into; it keeps all else, and its comments.")
@click.option(
    "--port",
    "ports",
    multiple=True,
    metavar="[NAME=]PATH",
    callback=_ports,
    shell_complete=complete.ports,
    help="Path of a port, where IN has none or another.",
)
@click.option(
    "--model",
    "models",
    multiple=True,
    metavar="[JOINT=]MODEL",
    callback=_pairs("model: write JOINT=MODEL, or MODEL for all", for_all=True),
    help="Model of a servo, where IN does not say it.",
)
@click.option(
    "--joint",
    "joints",
    multiple=True,
    metavar="THEIRS=OURS",
    callback=_pairs("pair of names: write THEIRS=OURS", for_all=False),
    help="What a joint, motor or servo of IN is called in FILE.",
)
@click.option("--kind", type=click.Choice(KINDS), help="Positions of an action group: counts of bus servos, or pulses.")
@click.option("--name", "motion", help="Name of the motion; that of IN without this.")
def import_(
    source: str,
    format: Format | None,
    output: str | None,
    onto: str | None,
    ports: dict[str, str],
    models: dict[str, str],
    joints: dict[str, str],
    kind: str | None,
    motion: str | None,
) -> None:
    """Make a robot file of a file of another program, or take it into one: limits, a calibration, a motion.

    IN is a calibration of LeRobot, a configuration or .move of pypot, a .robot file of ROBOTIS, a URDF, also one with
    the tags of dynamixel_hardware, an action group of Hiwonder (.d6a), or a motion file of RoboPlus (.mtn). Notes on
    standard error say what was left out. The file that is changed is kept as a dated copy. No port is opened, and
    nothing moves.
    """  # fmt: skip
    if output is not None and onto is not None:
        raise click.UsageError("say -o for a new robot file, or --onto for one that is there")
    path = Path(source)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    found = format or recognised(data, path.name)
    given = Given(path.name, ports, models, joints, kind, motion)
    if onto is None:
        _make(found, data, given, output)
    else:
        _take(found, data, given, onto)


def _make(format: Format, data: bytes, given: Given, output: str | None) -> None:
    """Make a new robot file."""
    if format.new is None:
        raise FormatError(
            f"{given.source}: {format.a_title} names no servos; make a robot file first (`servobus robot init PORT -o "
            "arm.toml`), then say --onto arm.toml"
        )
    draft = format.new(data, given)
    _check_used(format, given)
    text = draft_text(draft, "robot" if output is None else plain_name(Path(output).stem))
    try:
        read_text(text)
    except RobotFileError as error:
        raise FormatError(f"{given.source}: what it says makes no robot file: {error}") from None
    if output is None:
        click.echo(text, nl=False)
    else:
        create(output, text)
        click.echo(f"{len(draft.joints)} joints on {len(draft.ports)} ports written to {output}")
    for sentence in (*draft.notes, *draft.lost):
        note(sentence)


def _check_used(format: Format, given: Given) -> None:
    """Refuse what was said and has no meaning here: a slip in a name, or an option for another format."""
    if unused := given.unused():
        raise click.UsageError(f"{', '.join(unused)}: nothing in this {format.title} has to do with it")


def _take(format: Format, data: bytes, given: Given, onto: str) -> None:
    """Take it into a robot file."""
    if format.onto is None:
        raise FormatError(f"{given.source}: {format.a_title} makes a robot file of its own; say -o instead of --onto")
    file = read_file(onto)
    changes = format.onto(data, file, given)
    _check_used(format, given)
    text = edited(file, changes.changes)
    read_text(text, Path(onto))  # a wrong one is refused before a file is written beside it
    written: list[Path] = []
    try:
        for name, content in changes.files.items():
            beside = Path(onto).parent / name
            try:
                with beside.open("x", encoding="utf-8", newline="\n") as out:
                    written.append(beside)
                    out.write(content)
            except FileExistsError:
                raise FormatError(f"{beside} exists already; give the motion another name with --name") from None
            except OSError as error:
                raise FormatError(f"{beside}: cannot be written: {error.strerror or error}") from None
        save(file, text)
    except (FormatError, RobotFileError):
        for beside in written:
            beside.unlink()
        raise
    for sentence in changes.notes:
        note(sentence)
    more = "".join(f", samples in {path}" for path in written)
    click.echo(f"{onto}: {changes.done}{more}")
