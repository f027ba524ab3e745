"""`robot init`: a robot file from the servos of ports."""

import math
import re
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import click

from servobus.cli import complete
from servobus.cli.finding import Where, open_port
from servobus.cli.interrupts import unless_nobody_answers
from servobus.cli.options import verb, where_options
from servobus.cli.output import note
from servobus.cli.scan import ProgressBar
from servobus.core.ids import LAST_ID
from servobus.core.units import show
from servobus.errors import UsageError
from servobus.families import registry
from servobus.families.model import Model
from servobus.jobs.scan import FoundServo, ScanResult
from servobus.jobs.scan import scan as scan_procedure
from servobus.robots.file.drafting import DraftJoint, draft, middle
from servobus.robots.file.kinds import NAME
from servobus.robots.file.places import for_file
from servobus.robots.file.writing import create

LEFT_OUT = "none"
"""What is answered for a servo that is to be left out."""


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
    `servobus scan` does. The model of a servo that cannot say it is asked for; --yes takes the first of its family, and
    says so. `servobus robot calibrate` then finds zero, direction and limits.
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
            model = _model(found, port, yes=yes)
            if model is None:
                continue
            zero = _position(found, model) if as_found else None
            title = _asked(found, model, port, [joint.name for joint in joints], yes=yes)
            zero = middle(model) if zero is None else zero
            joints.append(DraftJoint(title, name, model, found.id, found.baud, zero))
    if not joints:
        raise UsageError(
            "no servo was found, and nothing was written; are they powered? `--baud all` tries every speed"
        )
    places = {name: for_file(port, path.parent) for name, port in names.items()}
    create(path, draft(path.stem, places, joints))
    click.echo(f"{path}: {len(joints)} joints: {', '.join(joint.name for joint in joints)}")


def _found(port: str, where: Where) -> Sequence[FoundServo]:
    """Look for servos on a port."""
    with open_port(port) as bus, ExitStack() as stack:
        bus.models = where.model
        rounds = list(where.rounds())
        bar = ProgressBar(stack, (LAST_ID + 1) * sum(len(bauds) for _, bauds in rounds))
        result = ScanResult()
        families, bauds = [family for family, _ in rounds], {family.name: bauds for family, bauds in rounds}
        bus.do(scan_procedure(families, bauds, range(LAST_ID + 1), lambda _: bar.advance(), result, bus.identify))
    for trouble in result.troubles:
        note(f"servobus: {port}: {trouble}")
    return result.found


def _model(found: FoundServo, port: str, *, yes: bool) -> type[Model] | None:
    """Give the model of a servo. One that cannot say it is asked for; None leaves the servo out.

    With `yes` it is taken for the first model of its family, whose angles are those of most. A servo with the number of
    a model that is not known here is left out: it may be anything.
    """
    if found.model is not None and not found.model.generic:
        return found.model
    if found.model is None or not registry.never_told(found.model):
        who = f"{found.family.title} id {found.id}"
        note(f"{port}: {who} is left out: it is of model {found.number_text}, which is not known here")
        return None
    who = f"{port}: {found.model.named(f'id {found.id}')}"
    known = {model.key(): model for model in registry.models_of(found.family)}
    first = next(iter(known))
    if yes:
        note(f"{who}: it cannot say its model, and is taken for {first}; change `model` in the file if it is another")
        return known[first]

    def usable(text: str) -> str:
        if text not in known and text != LEFT_OUT:
            raise click.UsageError(f"{text!r} is no model of this family: {', '.join(known)}, or {LEFT_OUT}")
        return text

    question = f"{who}: which model is it, or {LEFT_OUT} to leave it out?"
    with unless_nobody_answers(f"--yes takes {first}, --model MODEL says it for all"):
        answer: str = click.prompt(question, default=first, value_proc=usable, err=True)
    return known.get(answer)


def _position(found: FoundServo, model: type[Model]) -> float | None:
    """Give where a servo stands, rad; None where it did not tell."""
    if found.state is None:
        return None
    if found.state.raw is not None and math.isnan(found.state.position):
        return float(model.register("present_position").decode(found.state.raw[0]))
    return found.state.position


def _asked(found: FoundServo, model: type[Model], port: str, taken: Sequence[str], *, yes: bool) -> str:
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

    here = _position(found, model)
    at = "" if here is None else f", at {show(here, 'rad')}"
    question = f"{model.title} id {found.id} on {port}{at}: name of its joint"
    with unless_nobody_answers("--yes takes joint1, joint2, ..."):
        answer: str = click.prompt(question, default=name, value_proc=usable, err=True)
    return answer
