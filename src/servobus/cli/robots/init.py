"""`robot init`: a robot file from the servos of ports."""

import re
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import click

from servobus.cli import complete
from servobus.cli.advice import note_unknown
from servobus.cli.finding import Where, open_port
from servobus.cli.interrupts import unless_nobody_answers
from servobus.cli.options import verb, where_options
from servobus.cli.output import note
from servobus.cli.scan import ProgressBar
from servobus.core.ids import LAST_ID
from servobus.core.units import show
from servobus.errors import UsageError
from servobus.jobs.scan import FoundServo, ScanResult
from servobus.jobs.scan import scan as scan_procedure
from servobus.robots.file.drafting import DraftJoint, draft, middle
from servobus.robots.file.kinds import NAME
from servobus.robots.file.writing import create


@verb(
    "init",
    "servobus robot init /dev/ttyUSB0 /dev/ttyUSB1 -o arm.toml",
    "servobus robot init virtual:rx28@1-3 -o arm.toml --yes",
)
@click.argument("ports", metavar="PORT...", nargs=-1, required=True, shell_complete=complete.ports)
@click.option("-o", "--output", metavar="FILE", required=True, type=click.Path(), help="The robot file to write.")
@click.option("--yes", is_flag=True, help="Do not ask: joints are called joint1, joint2, ...")
@click.option("--as-found", is_flag=True, help="0 of a joint is where it stands now; else the middle of its servo.")
@where_options
def init(ports: tuple[str, ...], where: Where, output: str, yes: bool, as_found: bool) -> None:
    """Look for servos on each PORT, ask what their joints are called, and write a robot file.

    Nothing moves, nothing is written to a servo, and a file that is there is not written over. Servos are looked for as
    `servobus scan` does. `servobus robot calibrate` then finds zero, direction and limits.
    """
    path = Path(output)
    if path.exists():
        raise UsageError(f"{path}: there is such a file already; give another name, or remove it")
    if len(set(ports)) < len(ports):
        raise UsageError("a port is named twice; name each once")
    names = {"main": ports[0]} if len(ports) == 1 else {f"port{n}": port for n, port in enumerate(ports, 1)}
    joints: list[DraftJoint] = []
    for name, port in names.items():
        for found in _found(port, where):
            assert found.model is not None
            zero = found.state.position if as_found and found.state else middle(found.model)
            title = _asked(found, port, [joint.name for joint in joints], yes=yes)
            joints.append(DraftJoint(title, name, found.model, found.id, found.baud, zero))
    if not joints:
        raise UsageError(
            "no servo was found, and nothing was written; are they powered? `--baud all` tries every speed"
        )
    create(path, draft(path.stem, names, joints))
    click.echo(f"{path}: {len(joints)} joints: {', '.join(joint.name for joint in joints)}")


def _found(port: str, where: Where) -> Sequence[FoundServo]:
    """Look for servos on a port; those whose model is not known are told, and left out."""
    with open_port(port) as bus, ExitStack() as stack:
        bus.models = where.model
        rounds = list(where.rounds())
        bar = ProgressBar(stack, (LAST_ID + 1) * sum(len(bauds) for _, bauds in rounds))
        result = ScanResult()
        families, bauds = [family for family, _ in rounds], {family.name: bauds for family, bauds in rounds}
        bus.do(scan_procedure(families, bauds, range(LAST_ID + 1), lambda _: bar.advance(), result, bus.identify))
    for trouble in result.troubles:
        note(f"servobus: {port}: {trouble}")
    usable = []
    for one in result.found:
        if one.model is None or one.model.generic:
            note(f"{port}: id {one.id} at {one.baud} is left out: its model is not known")
        else:
            usable.append(one)
    note_unknown(port, [(one.id, one.model) for one in result.found])
    return usable


def _asked(found: FoundServo, port: str, taken: Sequence[str], *, yes: bool) -> str:
    """Ask what the joint of a servo is called."""
    name = next(name for n in range(1, LAST_ID * 9) if (name := f"joint{n}") not in taken)
    if yes:
        return name

    def usable(text: str) -> str:
        if not re.fullmatch(NAME, text):
            raise click.UsageError(f"{text!r} is no name: letters, digits, _ and -, no digit first")
        if text in taken:
            raise click.UsageError(f"there is a joint {text} already")
        return text

    assert found.model is not None
    at = f", at {show(found.state.position, 'rad')}" if found.state else ""
    question = f"{found.model.title} id {found.id} on {port}{at}: name of its joint"
    with unless_nobody_answers("--yes takes joint1, joint2, ..."):
        answer: str = click.prompt(question, default=name, value_proc=usable, err=True)
    return answer
