"""The options of virtual servos as the command line shows them: made from their declarations."""

from collections.abc import Mapping
from typing import Any

import click

from servobus import MODELS
from servobus.families.base import Model
from servobus.transports.base import Transport
from servobus.virtual.device.options import Option, defaults, options_of
from servobus.virtual.device.servo import VirtualServo, firmware
from servobus.virtual.serve.inprocess import VirtualPort


def option_entries(model: type[Model]) -> list[dict[str, str]]:
    """Give the options of a model for tables and JSON, in the order of their declaration; none without firmware."""
    if not model.firmware:
        return []
    kind = firmware(model)
    practice, manual = defaults(kind, model), defaults(kind, model, "manual")
    return [
        {
            "name": name,
            "practice": option.kind.show(practice[name]),
            "manual": option.kind.show(manual[name]),
            "values": option.kind.words,
            "decision": option.decision,
            "text": option.text,
        }
        for name, option in options_of(kind).items()
    ]


def option_rows(model: type[Model]) -> list[tuple[str, str]]:
    """Give the options of a model as two columns."""
    return [
        (
            f"{one['name']}={one['practice']}",
            f"{one['text']} ("
            + "; ".join(
                [f"takes {one['values']}"]
                + [f"by the manual {one['manual']}"] * (one["manual"] != one["practice"])
                + [one["decision"]] * bool(one["decision"])
            )
            + ")",
        )
        for one in option_entries(model)
    ]


def write_options(formatter: click.HelpFormatter) -> None:
    """Write the options of all models, those with the same ones together."""
    titles: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for model in MODELS.values():
        if rows := option_rows(model):
            titles.setdefault(tuple(rows), []).append(model.title)
    for options, names in titles.items():
        with formatter.section(f"Options of {names[0]}{' and others' * (len(names) > 1)}, such as {options[0][0]}"):
            if len(names) > 1:
                formatter.write_text(f"The same for {', '.join(names[1:])}.")
            formatter.write_dl(list(options), col_max=26)


def options_text(servo: VirtualServo, *, all: bool = False) -> str:
    """Say which options of a servo are not as by default, or what all of them are."""
    usual: Mapping[str, Any] = {} if all else defaults(type(servo), servo.model)
    known: Mapping[str, Option[Any]] = options_of(type(servo))
    return ", ".join(
        f"{name}={known[name].kind.show(value)}"
        for name, value in sorted(servo.options.items())
        if all or value != usual[name]
    )


def options_at(transport: Transport, model: type[Model], id: int) -> dict[str, str]:
    """Give the options of a servo behind a port, as people type them; none if it is real, or behind another program."""
    if not isinstance(transport, VirtualPort):
        return {}
    for servo in transport.servos:
        if servo.id == id and (servo.model is model or (model.generic and servo.model.family is model.family)):
            known = options_of(type(servo))
            return {name: known[name].kind.show(value) for name, value in sorted(servo.options.items())}
    return {}
