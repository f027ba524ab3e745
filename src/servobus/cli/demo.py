"""`demo`: all of it, without hardware."""

import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import click

from servobus import MODELS, BusServo, ServobusError
from servobus.cli.demo_motion import SWING, Dancer
from servobus.cli.options import terminated_like_interrupted, verb
from servobus.cli.output import console, note
from servobus.core.units import show
from servobus.errors import BadValue
from servobus.virtual.serve.ports import PtyPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import Setup, parse_specs

if TYPE_CHECKING:
    from rich.console import RenderableType

CAST = (("rx28", "1-4", range(1, 7)), ("drs0602", "219,220", range(217, 223)), ("lx16a", "1-3", range(1, 6)))
"""model, ids of the virtual servos, ids that the scan asks"""
FRAME = 1 / 20
"""s between two pictures."""
LINE = 1.0
"""s between two lines where there is no terminal to draw on."""


@verb("demo", "servobus demo", "servobus demo --seconds 30")
@click.option("--seconds", type=float, default=8.0, show_default=True, metavar="N", help="How long they move.")
def demo(seconds: float) -> None:
    """Find, move and read servos of all three families: virtual ones, nothing needs to be plugged in.

    Each family is served on a pseudo terminal, as for any program, and driven from there as on a real port.
    Ctrl-C ends it; the torque is released either way.
    """
    if not 0 < seconds <= 3600:
        raise BadValue(f"--seconds {seconds:g} is not in 0 .. 3600")
    with terminated_like_interrupted(), ExitStack() as stack:
        dancers = [
            stack.enter_context(Dancer(stack.enter_context(_served(f"{name}@{ids}")), MODELS[name], asked))
            for name, ids, asked in CAST
        ]
        for dancer in dancers:
            asked = f"{dancer.ids[0]}-{dancer.ids[-1]}"
            click.echo(f"servobus scan {dancer.port} --family {dancer.model.family.name} --ids {asked}")
            for servo in dancer.scan():
                click.echo(f"  {servo}")
        click.echo(f"\nNow they move for {seconds:g} s; Ctrl-C ends it.\n")
        _dance(dancers, seconds)
        _summary(dancers)


@contextmanager
def _served(spec: str) -> Iterator[str]:
    """Serve virtual servos and give the port's name."""
    if os.name != "posix":  # there are no pseudo terminals
        yield f"virtual:{spec}"
        return
    stop = threading.Event()
    with PtyPort(build_rig(Setup(parse_specs(spec)))) as port:
        thread = threading.Thread(target=port.serve, args=(stop,), daemon=True)
        thread.start()
        try:
            yield port.name
        finally:
            stop.set()
            thread.join()


def _dance(dancers: Sequence[Dancer], seconds: float) -> None:
    """Let all dance, and show it."""
    stop = threading.Event()
    threads = [threading.Thread(target=dancer.dance, args=(seconds, stop), daemon=True) for dancer in dancers]
    for thread in threads:
        thread.start()
    try:
        out = console()
        if out.is_terminal:
            from rich.live import Live  # noqa: PLC0415 - slow to import, and only wanted on terminals

            with Live(console=out, auto_refresh=False) as live:
                while any(thread.is_alive() for thread in threads):
                    live.update(_picture(dancers), refresh=True)
                    time.sleep(FRAME)
                live.update(_picture(dancers), refresh=True)
        else:
            start = time.monotonic()
            while alive := [thread for thread in threads if thread.is_alive()]:
                _print_line(dancers, time.monotonic() - start)
                alive[0].join(LINE)
    except KeyboardInterrupt:
        note("\nending; the torque is released")
        raise click.exceptions.Exit(130) from None
    finally:
        # Each thread releases the torque of its servos before it ends.
        stop.set()
        for thread in threads:
            thread.join()
    for dancer in dancers:
        if dancer.failure is not None:
            raise dancer.failure


def _picture(dancers: Sequence[Dancer]) -> "RenderableType":
    from rich.table import Table  # noqa: PLC0415 - slow to import, and only wanted on terminals

    from servobus.cli.progress import angle, bar  # noqa: PLC0415 - needs rich

    table = Table.grid(padding=(0, 1))
    for dancer in dancers:
        low, high = dancer.middle - 1.2 * SWING, dancer.middle + 1.2 * SWING
        for place, (id, seen) in enumerate(list(dancer.seen.items())):
            title = dancer.model.title if place == 0 else ""
            way = bar(seen.position, seen.goal, low, high, 44)
            table.add_row(title, f"id {id}", angle(seen.position), way)
    return table


def _print_line(dancers: Sequence[Dancer], seconds: float) -> None:
    parts = [
        f"{dancer.model.title} " + " ".join(show(seen.position, "rad") for seen in list(dancer.seen.values()))
        for dancer in dancers
    ]
    click.echo(f"{seconds:5.1f} s  " + " | ".join(parts))


def _summary(dancers: Sequence[Dancer]) -> None:
    click.echo("\nAsked for, and read back:")
    for dancer in dancers:
        for id, seen in dancer.seen.items():
            asked, read = show(seen.goal, "rad"), show(seen.position, "rad")
            servo: BusServo = dancer.bus[id]
            servo.look()
            torque = "on" if servo.state and servo.state.torque else "off"
            click.echo(f"  {servo.target!s:<16} {asked:>7} {read:>7}   torque {torque}")
            if torque == "on":
                raise ServobusError(f"{servo.target}: the torque is still on")
    moves = ", ".join(f"{dancer.moves} of {len(dancer.seen)} {dancer.model.title}" for dancer in dancers)
    click.echo(f"Moves sent: {moves}. Torque is off.\n")
    click.echo("The same with servos of yours:")
    click.echo("  servobus scan /dev/ttyUSB0")
    click.echo("  servobus move /dev/ttyUSB0 1=90 2=120 --time 1")
