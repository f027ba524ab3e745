"""The models servobus knows: one class body each."""

from servobus.errors import UnknownName
from servobus.families.base import Family, Model
from servobus.families.dynamixel.models.rx28 import RX28
from servobus.families.herkulex.models.drs0602 import DRS0602
from servobus.families.lewansoul.models.lx16a import LX16A

MODELS: dict[str, type[Model]] = {model.key(): model for model in (RX28, DRS0602, LX16A)}
"""key -> model: "rx28", "drs0602", "lx16a"."""

FAMILIES: dict[str, Family] = {model.family.name: model.family for model in MODELS.values()}
"""name -> family: "dynamixel", "herkulex", "lewansoul"."""


def model(name: str) -> type[Model]:
    """Find a model as people write it: "rx28", "RX-28". Raises UnknownName."""
    found = MODELS.get(name.replace("-", "").replace("_", "").lower())
    if found is None:
        raise UnknownName(_unknown("model", name, list(MODELS)))
    return found


def family(name: str) -> Family:
    """Find a family by name. Raises UnknownName."""
    found = FAMILIES.get(name.lower())
    if found is None:
        raise UnknownName(_unknown("family", name, list(FAMILIES)))
    return found


def identified(family: Family, number: int | None) -> type[Model] | None:
    """Find the model of a family that reports this number; None if no such model is known here.

    A family whose servos cannot say what they are (number None) is taken for its first model.
    """
    for candidate in MODELS.values():
        if candidate.family.name == family.name and number in (None, candidate.number):
            return candidate
    return None


def _unknown(kind: str, name: str, known: list[str]) -> str:
    import difflib  # noqa: PLC0415 - only ever needed for this message

    near = difflib.get_close_matches(name.lower(), known, n=1, cutoff=0.4)
    hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
    return f"no {kind} {name!r}; {hint}"


__all__ = ["DRS0602", "FAMILIES", "LX16A", "MODELS", "RX28", "family", "identified", "model"]
