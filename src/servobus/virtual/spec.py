"""Which virtual servos: the words people write.

rx28@1                       one RX-28 with id 1
rx28@1-4,7,lx16a@2           five RX-28 and an LX-16A
virtual:rx28@1?voltage=12    a port of this process, with options
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias
from urllib.parse import parse_qsl

from servobus import models
from servobus.errors import BadValue, UsageError
from servobus.families.base import Model
from servobus.protocols.ids import LAST_ID, check_id
from servobus.units import Switch, parse

Servos: TypeAlias = list[tuple[type[Model], list[int]]]
"""Models in the order they are named, each with its ids."""

PREFIX = "virtual:"
EXAMPLE = "rx28@1-4,7,lx16a@2"


@dataclass(frozen=True, slots=True)
class Setup:
    """Virtual servos and what surrounds them.

    clock        "real", or "virtual": time passes only while the client waits
    echo         whether the client hears what it sends
    baud         speed that the servos start with instead of the stored one
    voltage      supply, V
    temperature  of the cases, degC
    state        file that keeps the EEPROM contents
    """

    servos: Servos
    clock: Literal["real", "virtual"] = "real"
    echo: bool = False
    baud: int | None = None
    voltage: float | None = None
    temperature: float | None = None
    state: Path | None = None


def parse_specs(text: str) -> Servos:
    """Read "rx28@1-4,7,lx16a@2". Raises UnknownName for a model nobody knows, else UsageError."""
    servos: Servos = []
    for part in text.replace(" ", "").split(","):
        name, at, ids = part.rpartition("@")
        if at:
            servos.append((models.model(name), []))
        if not servos:
            raise UsageError(f"{text!r} names no servos; write MODEL@IDS, such as {EXAMPLE}")
        servos[-1][1].extend(_ids(ids, text))
    return servos


def parse_url(text: str) -> Setup:
    """Read "virtual:rx28@1-4?clock=virtual&voltage=12". Raises UsageError."""
    specs, _, query = text.removeprefix(PREFIX).partition("?")
    options: dict[str, Any] = {}
    for name, value in parse_qsl(query, keep_blank_values=True):
        try:
            options[name] = _option(name, value)
        except UsageError:
            raise
        except ValueError as error:
            raise BadValue(f"{text!r}: {name}: {error}") from None
    return Setup(parse_specs(specs), **options)


def _option(name: str, value: str) -> object:
    match name:
        case "clock":
            if value not in ("real", "virtual"):
                raise ValueError(f"{value!r} is neither real nor virtual")
            return value
        case "echo":
            return Switch().parse(value)
        case "baud":
            return int(value)
        case "voltage":
            return parse(value, "V")
        case "temperature":
            return parse(value, "degC")
        case "state" if value:
            return Path(value)
    raise UsageError(f"{name}={value}: options are clock, echo, baud, voltage, temperature and state=FILE")


def _ids(text: str, whole: str) -> range:
    match = re.fullmatch(r"(\d+)(?:-(\d+))?", text)
    if not match:
        raise UsageError(f"{whole!r}: {text!r} is no id; ids are numbers 0 .. {LAST_ID} and ranges, such as {EXAMPLE}")
    first, last = check_id(int(match[1])), check_id(int(match[2] or match[1]))
    if last < first:
        raise UsageError(f"{whole!r}: {text} runs backwards")
    return range(first, last + 1)
