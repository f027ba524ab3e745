"""`scan`: which servos are on this port."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from enum import IntFlag
from typing import TYPE_CHECKING, Any

import click

from servobus import Bus
from servobus.cli.advice import note_unknown
from servobus.cli.finding import Where, open_port
from servobus.cli.options import as_json, on_port, verb
from servobus.cli.output import console, note, print_json, quantity_entry
from servobus.cli.values import id_list
from servobus.core.ids import LAST_ID
from servobus.core.units import Flags
from servobus.families import registry
from servobus.families.present import servo_entry
from servobus.jobs.scan import FoundServo, ScanProblem, ScanProgress, ScanResult
from servobus.jobs.scan import scan as scan_procedure

if TYPE_CHECKING:
    import rich.progress


SHOWN = 2
"""Unclear answers that are told one by one."""


@verb(
    "scan",
    "servobus scan /dev/ttyUSB0",
    "servobus scan COM4 --family dynamixel --baud all --ids 1-20",
    "servobus scan virtual:rx28@1-3,lx16a@7 --json",
)
@on_port
@click.option("--ids", metavar="LIST", default=f"0-{LAST_ID}", show_default=True, help="Ids to ask.")
@as_json
def scan(port: str, where: Where, ids: str, json: bool) -> None:
    """Look for servos on PORT, and at each that is found. Moves nothing, changes nothing.

    Each id is asked in each family at its factory speed; with `--baud all` at every speed that the family
    has, which takes minutes on a real port. That no servo is there is a result too: --json prints [] then.
    """
    wanted = id_list(ids)
    rounds = list(where.rounds())
    if isinstance(where.baud, int) and not any(where.baud in registry.bauds(family) for family, _ in rounds):
        names = ", ".join(family.name for family, _ in rounds)
        note(f"{where.baud} baud is no usual speed of {names} servos; asking all the same")
    with open_port(port) as bus, ExitStack() as stack:
        bus.models = where.model
        total = len(wanted) * sum(len(bauds) for _, bauds in rounds)
        bar = ProgressBar(stack, total)

        def watch(progress: ScanProgress) -> None:
            if progress.found is not None and not json:
                with bar.hidden():
                    click.echo(_servo_text(bus, progress.found))
            bar.advance()

        result, broken_off = ScanResult(), False
        families, bauds = [family for family, _ in rounds], {family.name: bauds for family, bauds in rounds}
        try:
            bus.do(scan_procedure(families, bauds, wanted, watch, result, bus.identify))
        except KeyboardInterrupt:
            broken_off = True
            bar.remove()
            note("servobus: stopped; this is what was found so far")
    found, troubles = result.found, result.troubles
    _note_problems(troubles, found)
    if result.late:
        note(f"answers come {1000 * result.late:.0f} ms late; waited longer for them (`servobus doctor` says more)")
    if json:
        print_json([_entry(one) for one in found])
    elif not found and not broken_off:
        hint = "are they powered?" if where.baud == "all" else "are they powered? `--baud all` tries every speed"
        note(f"no servo answers (asked ids {ids}: {where}); {hint}")
    else:
        note_unknown(port, [(one.id, one.model) for one in found])
    if broken_off:
        raise click.exceptions.Exit(130)


def _entry(found: FoundServo) -> dict[str, Any]:
    """Give what was found for JSON: all that the line for people says, null where it is not known."""
    state, alarms = found.state, found.alarms
    tells_alarms = found.family.ping(found.id).alarms is not None
    return {
        **servo_entry(found.family, found.model, found.id, found.baud, found.identity.firmware),
        "position": quantity_entry(state.position, "rad") if state else None,
        "voltage": quantity_entry(state.voltage, "V") if state else None,
        "temperature": quantity_entry(state.temperature, "degC") if state else None,
        "torque": state.torque if state else None,
        "alarms": _names(alarms) if tells_alarms else None,
    }


def _names(alarms: int) -> list[str]:
    return Flags(type(alarms)).show(alarms).split("+") if alarms and isinstance(alarms, IntFlag) else []


def _note_problems(troubles: list[ScanProblem], found: list[FoundServo]) -> None:
    """Tell of answers that made no sense; of many, once: they have one cause more often than many."""
    for trouble in troubles[:SHOWN]:
        note(f"servobus: {trouble}")
    more = len(troubles) - SHOWN
    if more > 0:
        cause = " servos of another family or speed that heard what was not meant for them?" if found else ""
        note(f"servobus: and {more} more unclear answers;{cause} `--family` asks one family alone")


def _servo_text(bus: Bus, found: FoundServo) -> str:
    if found.model is None:
        return f"id {found.id} at {found.baud}: {found.family.title} model {found.number_text}, not known here"
    return str(bus.adopt(found))


class ProgressBar:
    """Shows on stderr how far a scan is, if that is a terminal."""

    def __init__(self, stack: ExitStack, total: int) -> None:
        err = console(stderr=True)
        self._bar: rich.progress.Progress | None = None
        if err.is_terminal:
            from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415 - slow to import

            columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
            self._bar = stack.enter_context(Progress(*columns, console=err, transient=True))
            self._task = self._bar.add_task("scanning", total=total)

    def advance(self) -> None:
        if self._bar is not None:
            self._bar.advance(self._task)

    def remove(self) -> None:
        """Take the bar away for good. Where a terminal shows ^C beside it, what comes next begins on a new line."""
        if self._bar is not None:
            self._bar.stop()
            click.echo(err=True)
            self._bar = None

    @contextmanager
    def hidden(self) -> Iterator[None]:
        """Remove the bar while something else is printed, perhaps on the same terminal."""
        if self._bar is not None:
            self._bar.stop()
        yield
        if self._bar is not None:
            self._bar.start()
