"""`demo`: scan, move and read, without hardware."""

import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import click

from servobus import MODELS, BusServo, ServobusError
from servobus.cli.demo_motion import SWING, DemoBus
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.options import verb
from servobus.cli.output import console, note
from servobus.core.units import show
from servobus.virtual.serve.ports import PtyPort
from servobus.virtual.serve.rig import build_rig
from servobus.virtual.serve.spec import Setup, parse_specs

if TYPE_CHECKING:
    from rich.console import RenderableType

SERVOS = (("rx28", "1-4", range(1, 7)), ("drs0602", "219,220", range(217, 223)), ("lx16a", "1-3", range(1, 6)))
"""model, ids of the virtual servos, ids that the scan asks"""
DRAW_PERIOD = 1 / 20
"""s between two drawings."""
PRINT_PERIOD = 1.0
"""s between two lines where there is no terminal to draw on."""


@verb("demo", "servobus demo", "servobus demo --seconds 30", "servobus demo robot")
@click.argument("shown", metavar="[servos|robot]", type=click.Choice(("servos", "robot")), default="servos")
@click.option("--seconds", type=float, default=8.0, show_default=True, metavar="N", help="How long they move.")
def demo(shown: str, seconds: float) -> None:
    """Find, move and read servos of all three families: virtual ones, nothing needs to be plugged in.

    With `robot` it is two arms, described by robot files: a hand moves the limp one, and the other one, of other
    servos with other zeros, directions and gears, follows.

    Each family is served on a pseudo terminal, as for any program, and driven from there as on a real port.
    Ctrl-C ends it; the torque is released either way.
    """
    if not 0 < seconds <= 3600:
        raise click.UsageError(f"--seconds {seconds:g} is not in 0 .. 3600")
    if shown == "robot":
        from servobus.cli.demo_robot import demo_robot  # noqa: PLC0415 - only it needs robots

        with signals_as_interrupt():
            demo_robot(seconds)
        return
    with signals_as_interrupt(), ExitStack() as stack:
        buses = [
            stack.enter_context(DemoBus(stack.enter_context(_served(f"{name}@{ids}")), MODELS[name], asked))
            for name, ids, asked in SERVOS
        ]
        for one in buses:
            asked = f"{one.ids[0]}-{one.ids[-1]}"
            said = f"--family {one.model.family.name}" if one.model.number is not None else f"--model {one.model.key()}"
            click.echo(f"servobus scan {one.port} {said} --ids {asked}")
            for servo in one.scan():
                click.echo(f"  {servo}")
        click.echo(f"\nNow they move for {seconds:g} s; Ctrl-C ends it.\n")
        _run(buses, seconds)
        _summary(buses)


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


def _run(buses: Sequence[DemoBus], seconds: float) -> None:
    """Let the servos of all buses follow the wave, and show it."""
    stop = threading.Event()
    threads = [threading.Thread(target=one.follow_wave, args=(seconds, stop), daemon=True) for one in buses]
    for thread in threads:
        thread.start()
    try:
        out = console()
        if out.is_terminal:
            from rich.live import Live  # noqa: PLC0415 - slow to import, and only wanted on terminals

            with Live(console=out, auto_refresh=False) as live:
                while any(thread.is_alive() for thread in threads):
                    live.update(_track_table(buses), refresh=True)
                    time.sleep(DRAW_PERIOD)
                live.update(_track_table(buses), refresh=True)
        else:
            start = time.monotonic()
            while alive := [thread for thread in threads if thread.is_alive()]:
                _print_line(buses, time.monotonic() - start)
                alive[0].join(PRINT_PERIOD)
    except KeyboardInterrupt:
        note("\nending; the torque is released")
        raise click.exceptions.Exit(130) from None
    finally:
        # Each thread releases the torque of its servos before it ends.
        stop.set()
        for thread in threads:
            thread.join()
    for one in buses:
        if one.failure is not None:
            raise one.failure


def _track_table(buses: Sequence[DemoBus]) -> "RenderableType":
    from rich.table import Table  # noqa: PLC0415 - slow to import, and only wanted on terminals

    from servobus.cli.progress import angle_column, position_bar  # noqa: PLC0415 - needs rich

    table = Table.grid(padding=(0, 1))
    for one in buses:
        low, high = one.middle - 1.2 * SWING, one.middle + 1.2 * SWING
        for place, (id, track) in enumerate(list(one.tracks.items())):
            title = one.model.title if place == 0 else ""
            way = position_bar(track.position, track.goal, low, high, 44)
            table.add_row(title, f"id {id}", angle_column(track.position), way)
    return table


def _print_line(buses: Sequence[DemoBus], seconds: float) -> None:
    parts = [
        f"{one.model.title} " + " ".join(show(track.position, "rad") for track in list(one.tracks.values()))
        for one in buses
    ]
    click.echo(f"{seconds:5.1f} s  " + " | ".join(parts))


def _summary(buses: Sequence[DemoBus]) -> None:
    click.echo("\nAsked for, and read back:")
    for one in buses:
        for id, track in one.tracks.items():
            asked, read = show(track.goal, "rad"), show(track.position, "rad")
            servo: BusServo = one.bus[id]
            servo.look()
            torque = "on" if servo.state and servo.state.torque else "off"
            click.echo(f"  {servo.target!s:<16} {asked:>7} {read:>7}   torque {torque}")
            if torque == "on":
                raise ServobusError(f"{servo.target}: the torque is still on")
    moves = ", ".join(f"{one.moves} of {len(one.tracks)} {one.model.title}" for one in buses)
    click.echo(f"Moves sent: {moves}. Torque is off.\n")
    click.echo("The same with servos of yours:")
    click.echo("  servobus scan /dev/ttyUSB0")
    click.echo("  servobus move /dev/ttyUSB0 1=90 2=120 --time 1")
