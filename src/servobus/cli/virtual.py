"""`virtual`: servos on a virtual port."""

import shlex
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from servobus.cli import complete
from servobus.cli.app import Verb
from servobus.cli.interrupts import stop_on_signals
from servobus.cli.live_table import LiveTable
from servobus.cli.output import note
from servobus.cli.values import BAUD, UnitType
from servobus.cli.virtual_console import VirtualConsole, read_commands
from servobus.cli.virtual_options import options_text, write_options
from servobus.virtual.device.options import READINGS
from servobus.virtual.physics.motor import NOTHING
from servobus.virtual.serve.ports import serve_pty, serve_tcp
from servobus.virtual.serve.rig import Rig, build_rig
from servobus.virtual.serve.spec import REAL_CLOCK, Servos, Setup, parse_load, parse_specs
from servobus.virtual.wire.adapter import WHOLE, Adapter
from servobus.virtual.wire.faults import KINDS, NO_FAULTS, SETTINGS, Faults, explain


class ReadType(click.ParamType[Any]):
    """A word that a function reads, such as what hangs on a shaft."""

    def __init__(self, name: str, read: Callable[[str], Any]) -> None:
        self.name = name
        self._read = read

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ARG002
        return self._read(value) if isinstance(value, str) else value


class FaultsType(ReadType):
    """What goes wrong on the line; `help` lists what there is and ends the command."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "help" and ctx is not None:
            click.echo(explain())
            ctx.exit()
        return super().convert(value, param, ctx)


class VirtualVerb(Verb):
    """A verb whose help lists the options of virtual servos."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        super().format_options(ctx, formatter)
        write_options(formatter)


FILE = click.Path(path_type=Path)

EXAMPLES = (
    "servobus virtual rx28@1-4,7",
    "servobus virtual lx16a@1,2 --pty /tmp/arm --state arm.json",
    "servobus virtual drs0602@219 --tcp 127.0.0.1:3333",
    "servobus virtual rx28@1-4 --load mass=0.2,length=0.1 --show",
    "servobus virtual rx28@1-4,goal_torque=off,lx16a@7 --as practice",
    "servobus virtual rx28@1-4 --faults seed=7,drop=0.01,stall=0.001:120ms",
    "servobus virtual arm.toml --pty /tmp/arm",
    "",
    "and then, in another terminal:",
    "servobus scan /tmp/arm",
)


@click.command("virtual", cls=VirtualVerb, examples=EXAMPLES)
@click.argument("specs", metavar="SPEC...", nargs=-1, required=True, shell_complete=complete.specs)
@click.option("--pty", type=FILE, metavar="LINK", help="Make LINK a symbolic link to the terminal.")
@click.option("--tcp", metavar="[HOST:]PORT", help="Serve a TCP port instead; port 0 takes any free one.")
@click.option("--baud", type=BAUD, metavar="N", help="Speed the servos start with; else the factory speed.")
@click.option("--state", type=FILE, metavar="FILE", help="Keep the EEPROM contents in FILE, so that it survives.")
@click.option("--echo", is_flag=True, help="Give back what is sent, as some adapters do.")
@click.option("--voltage", type=UnitType("volts", "V"), metavar="V", help="Supply; else the model's nominal voltage.")
@click.option("--temperature", type=UnitType("degrees Celsius", "degC"), metavar="C", help="Of the cases; else 25.")
@click.option(
    "--supply-resistance",
    type=UnitType("ohm", "ohm"),
    metavar="OHM",
    help="Let the servos of a wire share their supply through so much; else nothing pulls it down.",
)
@click.option("--motor", metavar="NAME", help="Set of motor data, such as manual or measured; else the model's first.")
@click.option(
    "--load",
    type=ReadType("load", parse_load),
    metavar="LOAD",
    default=NOTHING,
    show_default=False,
    help="What hangs on every shaft: mass=KG,length=M for an arm, inertia=KGM2, torque=NM, blocked.",
)
@click.option(
    "--adapter",
    type=ReadType("adapter", Adapter.parse),
    metavar="KIND",
    default=WHOLE,
    show_default=False,
    help="In which pieces answers come: whole (the default), none (byte by byte), usb:16ms (a latency timer) or "
    "fifo:14 (a UART).",
)
@click.option(
    "--faults",
    type=FaultsType("faults", Faults.parse),
    metavar="SPEC",
    default=NO_FAULTS,
    show_default=False,
    help=f"What goes wrong, such as seed=7,drop=0.01,flip@12#5. There are {', '.join(KINDS)}, and "
    f"{', '.join(SETTINGS)}; `--faults help` explains them.",
)
@click.option(
    "--as",
    "reading",
    type=click.Choice(READINGS),
    default=READINGS[0],
    show_default=True,
    help="Do what is known of real servos, or what their manuals say: the values of all options below.",
)
@click.option("--clock", type=click.Choice(("real", "virtual")), default="real", hidden=True)
@click.option("--show", is_flag=True, help="Show every servo in a live table. Needs a terminal.")
def virtual(
    specs: tuple[str, ...], pty: Path | None, tcp: str | None, show: bool, baud: int | str | None, **surroundings: Any
) -> None:
    """Be servos on a pseudo terminal, which any program opens like a serial port, until interrupted.

    SPEC is MODEL@IDS, such as rx28@1-4,7; `servobus models` lists the models. Servos of several families get
    a wire each, behind one port. Prints `ready PATH` once they answer. Ctrl-C switches them off.

    A robot file in place of SPEC gives its servos, with their loads, each of its ports on a terminal of its own: --pty
    DIR makes links DIR/PORT, and DIR/FILE, a robot file that names them. Prints `ready PORT PATH` for each.

    What real servos do in different ways is an option, for the servos in front of it: rx28@1-4,goal_torque=off. So is
    what a register of the EEPROM holds: rx28@1,ccw_angle_limit=0xFFFF.

    Lines typed meanwhile change what surrounds the servos: `load 1 torque=0.5`, `block 1`, `voltage 11`, `unplug 3`,
    `faults drop=0.01`; `help` lists them.
    """
    if show and not sys.stderr.isatty():
        raise click.UsageError("--show needs a terminal")
    if pty and tcp:
        raise click.UsageError("say either --pty or --tcp")
    if isinstance(baud, str):
        raise click.UsageError("--baud: servos have one speed, not all")
    text = ",".join(specs)
    address = _host_and_port(tcp) if tcp else None
    if len(specs) == 1 and specs[0].partition("?")[0].endswith(".toml"):
        from servobus.cli.virtual_robot import serve  # noqa: PLC0415 - only robots need what they are made of

        if show or baud is not None:
            raise click.UsageError("--show and --baud are for servos that are named one by one, not for a robot file")
        serve(specs[0], pty, address, stop_on_signals(), surroundings)
        return
    if "?" in text:
        raise click.UsageError(
            REAL_CLOCK if "clock=virtual" in text else "what stands behind ? in a port's name is an option here"
        )
    servos = parse_specs(text)
    setup = Setup(servos, baud=baud, **surroundings)
    stop = stop_on_signals()
    rig = build_rig(setup)
    _note_duplicate_ids(servos)
    _note_options(rig)
    table = LiveTable(rig, stop) if show else None

    def ready(name: str) -> None:
        _ready(name)
        if table:
            table.start(name)
        console = VirtualConsole(rig, table.show_note if table else note)
        read_commands(console, stop, table.line_typed if table and sys.stdin.isatty() else None)

    try:
        if address:
            serve_tcp(rig, *address, stop, ready)
        else:
            serve_pty(rig, pty, stop, ready)
    finally:
        stop.set()
        if table:
            table.join()
    if sys.stderr.isatty():
        note("")  # the terminal shows ^C
    if counts := rig.fault_counts:
        note("faults: " + ", ".join(f"{kind} {count}" for kind, count in sorted(counts.items())))


def _note_duplicate_ids(servos: Servos) -> None:
    """Note which servos share an id: their replies collide, by mistake or on purpose."""
    ids = Counter((model.family.name, id) for model, some, *_ in servos for id in some)
    for (family, id), count in ids.items():
        if count > 1:
            note(f"{count} {family} servos with id {id}: their answers collide, as those of real ones do")


def _note_options(rig: Rig) -> None:
    """Note which servos have other options than by default."""
    servos: dict[str, list[int]] = {}
    for servo in rig.servos:
        if text := options_text(servo):
            servos.setdefault(f"{servo.model.title}: {text}", []).append(servo.id)
    for text, ids in servos.items():
        title, _, options = text.partition(": ")
        note(f"{title} id {', '.join(map(str, ids))}: {options}")


def _ready(name: str) -> None:
    click.echo(f"ready {name}")
    sys.stdout.flush()  # a program that waits for this line may wait on a pipe
    if sys.stderr.isatty():
        note(f"try: servobus scan {shlex.quote(name)}     (Ctrl-C here switches the servos off)")


def _host_and_port(text: str) -> tuple[str, int]:
    """Read HOST:PORT, [::1]:PORT or PORT."""
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or int(port) > 65535:
        raise click.UsageError(f"--tcp {text}: write [HOST:]PORT, such as 127.0.0.1:3333")
    return host.strip("[]") or "127.0.0.1", int(port)
