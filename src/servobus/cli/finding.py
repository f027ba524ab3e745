"""How the commands find the servos that are meant: where they are looked for, and which of them are there."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import servobus
from servobus import Bus, BusServo
from servobus.cli.output import note
from servobus.cli.values import ALL, Ids
from servobus.core.ids import LAST_ID
from servobus.errors import NoReply, ServobusError, UnknownName, UsageError
from servobus.families import registry
from servobus.families.base import Family, Model
from servobus.families.explain import id_list
from servobus.jobs.scan import ScanResult, scan, unknown_model

TRIES = 2
"""Times that a servo is looked for before it counts as missing."""


@dataclass(frozen=True, slots=True)
class Where:
    """Where a servo is looked for: which families, at which speeds."""

    family: str | None = None
    baud: int | Literal["all"] | None = None
    model: type[Model] | None = None
    """What a servo is that cannot say it itself."""

    def __post_init__(self) -> None:
        if self.family is not None:
            family = registry.family(self.family)  # an unknown name is refused before the port is opened
            if self.model is not None and self.model.family is not family:
                raise UsageError(f"{self.model.title} is of the family {self.model.family.name}, not {self.family}")

    def rounds(self) -> Iterator[tuple[Family, tuple[int, ...]]]:
        """Give the families to ask, each with its speeds; those of other distributions come last."""
        # One after the other: to find out what is installed takes a while, and mostly a built-in family is meant.
        for family in self._families():
            yield family, self._bauds(family)

    def _families(self) -> Iterable[Family]:
        if self.model is not None:
            return [self.model.family]
        return [registry.family(self.family)] if self.family else registry.FAMILIES.values()

    def models_of(self, family: Family) -> Iterable[type[Model]]:
        """Give the models that servos of a family can be of."""
        return registry.models_of(family) if self.model is None else [self.model]

    def _bauds(self, family: Family) -> tuple[int, ...]:
        if isinstance(self.baud, int):
            return (self.baud,)
        if self.baud == ALL:
            return self.usual_bauds(family)
        return registry.factory_bauds(family) if self.model is None else (self.model.factory_baud,)

    def everywhere(self) -> list[tuple[Family, tuple[int, ...]]]:
        """Give the families, each with all speeds that its servos can have, or with the one that is asked for."""
        if isinstance(self.baud, int):
            return list(self.rounds())
        return [(family, self.usual_bauds(family)) for family in self._families()]

    def usual_bauds(self, family: Family) -> tuple[int, ...]:
        """Give the speeds that servos of a family can have."""
        return registry.bauds(family) if self.model is None else self.model.bauds

    def checked(self, servo: BusServo) -> BusServo:
        """Give a servo back, or raise UsageError if it says that it is of another model than is asked for."""
        if self.model is not None and servo.model is not self.model:
            raise UsageError(f"id {servo.id} says that it is {servo.model.title}, not {self.model.title}")
        return servo

    def __str__(self) -> str:
        return rounds_text(self.rounds())


def rounds_text(rounds: Iterable[tuple[Family, Sequence[int]]]) -> str:
    """Say which families are meant, each at which speeds."""
    return ", ".join(f"{family.name} at {'/'.join(map(str, bauds))}" for family, bauds in rounds)


def open_port(port: str) -> Bus:
    """Open a port, for `with`. What is the matter with what is remembered of its servos is noted."""
    bus = servobus.open(port)
    bus.remembered.tell = lambda problem: note(f"servobus: {problem}")
    return bus


class Search:
    """Which of the servos that are meant are there.

    servos   those that are, in the order in which they were asked for
    missing  id -> why this one cannot be used, for the others
    silent   those of the missing ids that no servo answers to
    """

    def __init__(self) -> None:
        self.servos: list[BusServo] = []
        self.missing: dict[int, ServobusError] = {}
        self.silent: list[int] = []

    def failures(self, bus: Bus, where: Where) -> list[ServobusError]:
        """Give what is the matter with the missing ones: one error for all that are silent, one for each other."""
        errors = [error for id, error in self.missing.items() if id not in self.silent]
        return [*errors, NoReply(_unanswered(bus, where, self.silent))] if self.silent else errors


def search(bus: Bus, where: Where, ids: Ids, *, shared: bool = False) -> Search:
    """Look for servos, in all families and at all speeds where they may be.

    An id that two servos have does not say which of them is meant, and counts as missing; with `shared` both are meant.
    Raises NoReply if all are meant and there is none.
    """
    bus.models = where.model
    result = ScanResult()
    wanted: Sequence[int] = range(LAST_ID + 1) if ids == ALL else ids
    # A scan asks each id once, for most are not there. A servo that is named is expected to be there: after one lost
    # byte it is asked again before it counts as missing.
    for _ in range(1 if ids == ALL else TRIES):
        met = {found.id for found in result.found}
        if absent := [id for id in wanted if id not in met]:
            for family, bauds in where.rounds():
                bus.do(scan([family], bauds, absent, None, result, bus.identify))
    outcome = Search()
    for id in wanted:
        try:
            outcome.servos += _identified(bus, where, id, result, shared=shared or ids == ALL, named=ids != ALL)
        except ServobusError as error:
            outcome.missing[id] = error
            if id not in {one.id for one in result.found} | {one.id for one in result.troubles}:
                outcome.silent.append(id)
    if ids == ALL and not outcome.servos:
        raise next(iter(outcome.missing.values()), NoReply(f"{bus.transport.name}: no servo answers ({where})"))
    return outcome


def _identified(
    bus: Bus, where: Where, id: int, result: ScanResult, *, shared: bool, named: bool
) -> Sequence[BusServo]:
    """Give the servos with an id. Raises ServobusError if it is not known which is meant, or if none can be used."""
    found = [one for one in result.found if one.id == id]
    if found:
        servos = [bus.adopt(one) for one in found]
        known = [where.checked(servo) for servo in servos if servo is not None]
        if len(known) > 1 and not shared:
            raise UnknownName(_ambiguous(id, known))
        if not known:
            raise unknown_model(found[0])
        return known
    if trouble := next((one for one in result.troubles if one.id == id), None):
        raise trouble.error
    if not named:
        return []
    raise NoReply(_unanswered(bus, where, [id]))


def _unanswered(bus: Bus, where: Where, ids: Sequence[int]) -> str:
    """Say that no servo answers to these ids, and what can be tried next."""
    powered = "is it powered" if len(ids) == 1 else "are they powered"
    hint = f"{powered} and connected?" if where.baud == ALL else f"{powered}? `--baud all` tries every speed"
    return f"{bus.transport.name}: no servo answers to {id_list(ids)} (tried {where}); {hint}"


def _ambiguous(id: int, servos: Sequence[BusServo]) -> str:
    names = " and ".join(f"{servo.target} at {servo.baud}" for servo in servos)
    families = dict.fromkeys(servo.family.name for servo in servos)
    options = (
        [f"--family {family}" for family in families]
        if len(families) == len(servos)
        else [f"--family {servo.family.name} --baud {servo.baud}" for servo in servos]
    )
    return f"id {id} is not unique here: {names}; say which with {' or '.join(options)}"


def find(bus: Bus, where: Where, id: int) -> BusServo:
    """Find one servo. Raises NoReply with what can be tried next, UnknownName for an id that two servos have."""
    (servo,) = find_all(bus, where, (id,))
    return servo


def find_all(bus: Bus, where: Where, ids: Ids, *, shared: bool = False) -> list[BusServo]:
    """Find servos, or none if one of them cannot be used: then raise what is the matter with that; see `search`."""
    outcome = search(bus, where, ids, shared=shared)
    for error in outcome.failures(bus, where):
        raise error
    return outcome.servos


def for_each(bus: Bus, where: Where, ids: Ids, action: Callable[[BusServo], None]) -> None:
    """Do something with each servo that is meant and there; what went wrong with the others is raised at the end."""
    outcome = search(bus, where, ids)
    failures = outcome.failures(bus, where)
    for servo in outcome.servos:
        try:
            action(servo)
        except ServobusError as error:
            failures.append(error)
    if len(failures) > 1:
        raise ServobusError("; ".join(map(str, failures)))
    for failure in failures:
        raise failure
