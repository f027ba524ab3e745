"""The models and families servobus knows: the built-in ones, and those that other distributions bring.

A distribution adds models under the entry point group `servobus.families`; each entry point names a list of models:

    [project.entry-points."servobus.families"]
    arms = "our_arms.servos:MODELS"

A model brings its family with it, and so does the generic model of a family, which stands for servos whose model is not
known and is in no list of models. Entry points are looked for when a question goes beyond what is built in (a name that
is not known, a look at all families), never at import: reading what is installed takes longer than reading a servo.
"""

import itertools
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import TypeVar

from servobus.errors import UnknownName, UsageError
from servobus.families.base import Family, Model
from servobus.families.dynamixel.models.ax import AX12A, AX12W, AX18A
from servobus.families.dynamixel.models.dx import DX113, DX116, DX117
from servobus.families.dynamixel.models.ex import EX106P
from servobus.families.dynamixel.models.mx import MX12W, MX28, MX64, MX106
from servobus.families.dynamixel.models.rx import RX10, RX24F, RX64
from servobus.families.dynamixel.models.rx28 import RX28
from servobus.families.dynamixel.models.table import UnknownDynamixel
from servobus.families.herkulex.models.magnetic import DRS0402, DRS0602
from servobus.families.herkulex.models.small import DRS0101, DRS0201
from servobus.families.herkulex.models.table import UnknownHerkulex
from servobus.families.herkulex.models.x01 import DRS0401, DRS0601
from servobus.families.lewansoul.models.htd import HTD35H, HTD45H
from servobus.families.lewansoul.models.hts import HTS16L, HTS20H, HTS20L, HTS21H, HTS30HS, HTS35H
from servobus.families.lewansoul.models.hx import HX06L, HX12H, HX20L, HX35H
from servobus.families.lewansoul.models.lx import LX15D, LX16A, LX224, LX224HV, LX225, LX824, LX824HV, LX1501
from servobus.families.lewansoul.models.table import UnknownLx
from servobus.families.model import key_of

T = TypeVar("T")

MANY = 12
"""More names than these are not listed in an error."""
GROUP = "servobus.families"
"""Entry points of this group name lists of models."""


class Known(Mapping[str, T]):
    """Name -> model or family. What is not built in is looked for when it is needed, see the head of this module."""

    def __init__(self) -> None:
        self.entries: dict[str, T] = {}
        """What has been added so far."""

    def __getitem__(self, name: str) -> T:
        if name not in self.entries:
            load_installed()
        return self.entries[name]

    def __iter__(self) -> Iterator[str]:
        told = tuple(self.entries)
        yield from told
        load_installed()
        yield from (name for name in tuple(self.entries) if name not in told)

    def __len__(self) -> int:
        load_installed()
        return len(self.entries)

    def __repr__(self) -> str:
        return f"<{', '.join(self)}>"


MODELS: Known[type[Model]] = Known()
"""key -> model: "rx28", "drs0602", "lx16a", and those of other distributions."""

FAMILIES: Known[Family] = Known()
"""name -> family: "dynamixel", "herkulex", "lewansoul", and those of other distributions."""

GENERIC: dict[str, type[Model]] = {}
"""name of a family -> the model that stands for its servos of which no more is known."""

_numbered: dict[tuple[str, int], type[Model]] = {}
"""Generic models of servos that report a number which no known model has."""

_loaded = False
"""Whether the entry points have been looked at."""


def add(*models: type[Model]) -> None:
    """Make models known, and their families with them: they are found by scans and by name from then on.

    Raises UsageError for a name that another model or family has already, or a number that another model of the family
    reports; then none of them is added.
    """
    families: dict[str, Family] = {}
    keys: dict[str, type[Model]] = {}
    generic: dict[str, type[Model]] = {}
    for model in models:
        if "title" not in vars(model):
            raise UsageError(f"{model.__name__} is a parent of models: a model has a title of its own")
        key, family = model.key(), model.family
        if model.generic:
            other = generic.get(family.name) or GENERIC.get(family.name)
            if other not in (None, model):
                raise UsageError(f"{model.title} cannot be added: {family.name} has a generic model already")
            generic[family.name], families[family.name] = model, family
            continue
        other = keys.get(key) or MODELS.entries.get(key)
        if other not in (None, model):
            raise UsageError(f"{model.title} cannot be added: there is a model {key} already")
        known = families.get(family.name) or FAMILIES.entries.get(family.name)
        if known not in (None, family):
            raise UsageError(f"{model.title} cannot be added: there is another family {family.name} already")
        known_models = {**MODELS.entries, **keys}.values()
        twin = next((one for one in known_models if one.family is family and one.number == model.number), model)
        if model.number is not None and twin is not model:
            raise UsageError(
                f"{model.title} cannot be added: {twin.title} reports number {model.number} too, so that no scan could "
                "tell them apart; give it the number that it reports, or None"
            )
        keys[key], families[family.name] = model, family
    MODELS.entries.update(keys)
    FAMILIES.entries.update(families)
    GENERIC.update(generic)


def load_installed() -> None:
    """Add the models of other distributions, once. One that cannot be used is warned of and left out."""
    global _loaded  # noqa: PLW0603 - what is installed is one thing for the whole process
    if _loaded:
        return
    _loaded = True
    if not _mentioned():
        return
    from importlib.metadata import entry_points  # noqa: PLC0415 - slow to import, and mostly not needed

    for point in entry_points(group=GROUP):
        try:
            add(*point.load())
        except Exception as error:  # noqa: BLE001 - whatever is wrong with it, the rest must go on working
            import warnings  # noqa: PLC0415 - only ever needed for this message

            warnings.warn(f"servo family {point.name} ({point.value}) is left out: {error}", stacklevel=2)


def _mentioned() -> bool:
    """Tell whether something that is installed may have entry points of ours.

    To look for the name of the group in all entry_points.txt takes a millisecond or two; importlib.metadata takes tens
    of them, as long as all the rest of a command that reads one servo.
    """
    for folder in sys.path:
        try:
            with os.scandir(folder or ".") as entries:
                infos = [entry.path for entry in entries if entry.name.endswith((".dist-info", ".egg-info"))]
        except NotADirectoryError:
            return True  # an archive: importlib.metadata can look into it
        except OSError:
            continue  # what is on the path need not be there
        for info in infos:
            try:
                with open(os.path.join(info, "entry_points.txt"), "rb") as file:  # noqa: PTH118, PTH123 - pathlib is slow
                    if GROUP.encode() in file.read():
                        return True
            except OSError:
                pass  # most have none
    return False


def model(name: str) -> type[Model]:
    """Find a model as people write it: "rx28", "RX-28"; or "dynamixel", which stands for those that are not known.

    Raises UnknownName.
    """
    found = _called(name)
    if found is None:
        generic = {model.key(): model for model in GENERIC.values()}
        found = generic.get(key_of(name))
        if found is None:
            raise UnknownName(_no_such("model", name, [*MODELS, *generic], len(MODELS)))
    return found


def simulated(name: str) -> type[Model]:
    """Find a model that has a virtual servo, as people write it. Raises UnknownName, which offers those that have."""
    found = _called(name)
    if found is not None and found.firmware:
        return found
    if found is None and key_of(name) not in {one.key() for one in GENERIC.values()}:
        raise UnknownName(_no_such("model", name, [key for key, one in MODELS.items() if one.firmware]))
    raise UnknownName(f"there is no virtual servo for {name!r}; `servobus models` lists the models")


def _called(name: str) -> type[Model] | None:
    """Find a model by one of its names."""
    key = key_of(name)
    return MODELS.get(key) or next((model for model in MODELS.values() if key in map(key_of, model.names)), None)


def family(name: str) -> Family:
    """Find a family by name. Raises UnknownName."""
    found = FAMILIES.get(name.lower())
    if found is None and (known := MODELS.get(key_of(name))):
        raise UnknownName(f"no family {name!r}: {known.title} is a model, of the family {known.family.name}")
    if found is None:
        raise UnknownName(_no_such("family", name, list(FAMILIES)))
    return found


def identified(family: Family, number: int | None) -> type[Model] | None:
    """Find the model of a family that reports this number; None if no such model is known here, or none is reported."""
    return None if number is None else next((model for model in models_of(family) if model.number == number), None)


def unknown(family: Family, number: int | None = None) -> type[Model] | None:
    """Give the model that stands for a servo of a family of which no more is known, or no more than a number.

    None for a family that has no such model. A family with a single model, which cannot say what it is, needs none.
    """
    generic = GENERIC.get(family.name)
    if generic is None and number is None and len(models := list(models_of(family))) == 1:
        return models[0] if models[0].number is None else None
    if generic is None or number is None:
        return generic
    made = _numbered.get((family.name, number))
    if made is None or not issubclass(made, generic):
        body = {
            "title": generic.title.replace("model unknown", f"model {family.number_text(number)}"),
            "number": number,
            "generic": True,
        }
        made = _numbered[family.name, number] = type(f"{generic.__name__}{number}", (generic,), body)
    return made


def never_told(model: type[Model]) -> bool:
    """Tell whether a servo is of an unknown model because no servo of its family can say what it is."""
    return model.generic and all(one.number is None for one in models_of(model.family))


def models_of(family: Family) -> Iterator[type[Model]]:
    """Give the models of a family, the built-in ones first."""
    return (model for model in MODELS.values() if model.family.name == family.name)


def by_series() -> list[type[Model]]:
    """Give all models, those of one family and series together, each in the order in which they are known."""
    series = list(dict.fromkeys((model.family.name, model.series) for model in MODELS.values()))
    families = list(FAMILIES)
    return sorted(
        MODELS.values(),
        key=lambda model: (families.index(model.family.name), series.index((model.family.name, model.series))),
    )


def first_model(family: Family) -> type[Model]:
    """Give the model whose registers are meant where none is named. Raises UnknownName for a family without any."""
    for model in models_of(family):
        return model
    raise UnknownName(f"no model of the family {family.name} is known here")


def factory_bauds(family: Family) -> tuple[int, ...]:
    """Give the speeds that servos of a family have from the factory, each once, that of its first model first."""
    return tuple(dict.fromkeys(model.factory_baud for model in models_of(family)))


def bauds(family: Family) -> tuple[int, ...]:
    """Give the speeds that servos of a family can have, each once, most likely first."""
    return tuple(
        dict.fromkeys((*factory_bauds(family), *(baud for model in models_of(family) for baud in model.bauds)))
    )


def names(known: Iterable[str]) -> str:
    """List names for a sentence: "dynamixel, herkulex or lewansoul"."""
    *most, last = known
    return f"{', '.join(most)} or {last}" if most else last


def _no_such(kind: str, name: str, known: list[str], listed: int | None = None) -> str:
    """Say that there is none of this name; `listed` of the known ones are listed by a command, else all."""
    key = key_of(name)
    # One series has not the models of another: an MX-28 is no RX-28 with a slip.
    near = [one for one in known if _one_slip(key, one) and (kind != "model" or _series(key) == _series(one))]
    told = (
        f"known are {', '.join(known)}"
        if len(known) <= MANY
        else f"`servobus {kind}s` lists all {listed or len(known)}"
    )
    hint = f"did you mean {near[0]}?" if near else told
    return f"no {kind} {name!r}; {hint}"


def _series(key: str) -> str:
    return "".join(itertools.takewhile(str.isalpha, key))


def _one_slip(one: str, other: str) -> bool:
    """Tell whether two names differ by one letter more, less or other, or by two that are swapped."""
    if len(one) == len(other):
        wrong = [at for at in range(len(one)) if one[at] != other[at]]
        return len(wrong) <= 1 or (len(wrong) == 2 and [one[at] for at in wrong] == [other[at] for at in wrong[::-1]])
    short, long = sorted((one, other), key=len)
    return any(long[:at] + long[at + 1 :] == short for at in range(len(long)))


add(RX28, DRS0602, LX16A, UnknownDynamixel, UnknownHerkulex, UnknownLx)
add(AX12A, AX12W, AX18A, RX10, RX24F, RX64, EX106P, DX113, DX116, DX117, MX28, MX64, MX106, MX12W)
add(DRS0101, DRS0201, DRS0401, DRS0402, DRS0601)
add(LX15D, LX224, LX224HV, LX225, LX824, LX824HV, LX1501)
add(HTS20H, HTS16L, HTS20L, HTS21H, HTS30HS, HTS35H, HTD35H, HTD45H, HX12H, HX06L, HX20L, HX35H)

__all__ = [
    "DRS0602",
    "FAMILIES",
    "GENERIC",
    "LX16A",
    "MODELS",
    "RX28",
    "add",
    "bauds",
    "by_series",
    "factory_bauds",
    "family",
    "first_model",
    "identified",
    "load_installed",
    "model",
    "models_of",
    "names",
    "never_told",
    "simulated",
    "unknown",
]
