"""`doctor`: what is wrong with a port and its servos, why, and what mends it."""

import re
import textwrap
from contextlib import ExitStack
from typing import TYPE_CHECKING

import click

from servobus.cli.finding import Where
from servobus.cli.options import as_json, on_port, verb
from servobus.cli.output import console, print_json
from servobus.cli.values import id_list
from servobus.core.ids import LAST_ID
from servobus.doctor import Finding, Rounds, SearchPlan, Severity, examine
from servobus.families import registry

if TYPE_CHECKING:
    import rich.progress

COLUMNS = 80
MOST_READS = 1_000_000
_COLOURS = {Severity.OK: "green", Severity.WARN: "yellow", Severity.FAIL: "red", Severity.UNKNOWN: "cyan"}
_INDENT = " " * 9


@verb(
    "doctor",
    "servobus doctor /dev/ttyUSB0",
    "servobus doctor /dev/ttyUSB0 --family dynamixel --ids 1-20 --reads 10000",
    "servobus doctor virtual:rx28@1-3",
)
@on_port
@click.option("--ids", metavar="LIST", default=f"0-{LAST_ID}", show_default=True, help="Ids to ask.")
@click.option("--reads", type=int, default=1000, show_default=True, metavar="N", help="Reads to count losses in.")
@as_json
def doctor(port: str, where: Where, ids: str, reads: int, json: bool) -> None:
    """Find out what is wrong with PORT and the servos on it. Moves nothing, changes nothing.

    Looks at the port, its adapter and what uses it, then at the servos: which answer, twice the same id, supply,
    heat, errors, and how many of N reads are lost. Says the cause first, then the command that mends it. If
    no servo answers at the factory speeds, all others are tried. The exit code is 1 if something is wrong.
    """
    if not 0 <= reads <= MOST_READS:
        raise click.UsageError(f"--reads {reads} is not in 0 .. {MOST_READS}")
    if not port.strip():
        raise click.UsageError("PORT is empty; `servobus ports` lists what is plugged in")
    plan = SearchPlan(list(where.rounds()), _other_speeds(where), id_list(ids), reads, where.model)
    findings = []
    with ExitStack() as stack:
        bar = ProgressBar(stack)
        for finding in examine(port, plan, bar.update):
            bar.hide()
            findings.append(finding)
            if not json:
                _print_finding(finding)
    if json:
        print_json([finding.entry() for finding in findings])
    else:
        _print_summary(findings)
    if any(finding.level is Severity.FAIL for finding in findings):
        raise click.exceptions.Exit(1)


def _other_speeds(where: Where) -> Rounds:
    """List the speeds to try if no servo answers at the factory speeds, the likely ones of all families first."""
    if where.baud is not None:
        return ()
    rounds = [
        (family, place, baud) for family, _ in where.rounds() for place, baud in enumerate(where.usual_bauds(family))
    ]
    rounds.sort(key=lambda item: item[1])
    return [(family, (baud,)) for family, _, baud in rounds if baud not in registry.factory_bauds(family)]


def _print_finding(finding: Finding) -> None:
    level = finding.level
    mark = click.style(f"{level.upper() if level is Severity.FAIL else level:<8}", fg=_COLOURS[level], bold=True)
    first, *rest = _wrap(f"{finding.check}: {finding.what}")
    click.echo(f"{mark} {first}")
    for line in rest + _wrap(finding.cause):
        click.echo(_INDENT + line)
    for command in finding.mend:
        for line in command.splitlines():  # as it is: it is there to be copied
            click.echo(f"{_INDENT}  {line}")


def _wrap(text: str) -> list[str]:
    """Wrap a text at its spaces; a list of speeds such as 57600/115200, too long for a line, at its strokes too."""
    width = COLUMNS - len(_INDENT)
    speeds = re.compile(r"[\d/]+,?")
    long = (len(word) > width and speeds.fullmatch(word) for word in text.split(" "))
    words = [word.replace("/", "/ ") if cut else word for word, cut in zip(text.split(" "), long, strict=True)]
    return textwrap.wrap(" ".join(words), width, break_long_words=False, break_on_hyphens=False)


def _print_summary(findings: list[Finding]) -> None:
    counts = {level: sum(finding.level is level for finding in findings) for level in (Severity.FAIL, Severity.WARN)}
    words = {Severity.FAIL: "wrong", Severity.WARN: "worth a look"}
    said = [f"{number} {words[level]}" for level, number in counts.items() if number]
    click.echo(", ".join(said) or "nothing is wrong")


class ProgressBar:
    """Shows on stderr how far something is, if that is a terminal; a finding takes it away."""

    def __init__(self, stack: ExitStack) -> None:
        self._console = console(stderr=True)
        self._bar: rich.progress.Progress | None = None
        self._stage = ""
        stack.callback(self.hide)

    def update(self, stage: str, done: int, total: int) -> None:
        if not self._console.is_terminal:
            return
        if stage != self._stage:
            self.hide()
        if self._bar is None:
            from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415 - slow to import

            columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
            self._bar = Progress(*columns, console=self._console, transient=True)
            self._task = self._bar.add_task(stage, total=total)
            self._bar.start()
            self._stage = stage
        self._bar.update(self._task, completed=done, total=total)

    def hide(self) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
