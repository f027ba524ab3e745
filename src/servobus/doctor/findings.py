"""A finding as a value, and what all checks build findings with."""

import shlex
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum

from servobus.core.ids import LAST_ID
from servobus.core.units import show
from servobus.families import registry
from servobus.families.base import Family

SHOWN = 3
"""Things of one kind that are told one by one."""

Watcher = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""


class Severity(StrEnum):
    """How bad a finding is."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Finding:
    """What one check found.

    check  what was looked at, in one or two words
    what   what is the case
    cause  why that may be so, and what to do about it by hand; empty if nothing is wrong
    mend   commands that mend it, for a shell; some have several lines
    """

    level: Severity
    check: str
    what: str
    cause: str = ""
    mend: tuple[str, ...] = ()

    def entry(self) -> dict[str, object]:
        """Give it for JSON."""
        return {
            "level": str(self.level),
            "check": self.check,
            "what": self.what,
            "cause": self.cause,
            "mend": list(self.mend),
        }


def command(verb: str, port: str, *words: object) -> str:
    """Write a command of ours as a shell takes it; empty words are left out."""
    return " ".join(["servobus", verb, shlex.quote(port), *filter(None, map(str, words))])


def for_each(ids: Iterable[int], command: str) -> str:
    """Write a command for several servos; it has $id where the id belongs."""
    listed = list(map(str, ids))
    return (
        command.replace("$id", listed[0]) if len(listed) == 1 else f"for id in {' '.join(listed)}; do {command}; done"
    )


def at(family: Family, baud: int) -> str:
    """Give the option that finds a servo; none is needed at a factory speed of its family."""
    return "" if baud in registry.factory_bauds(family) else f"--baud {baud}"


def duplicate_id(port: str, what: str, servo: tuple[Family, int, int], taken: set[int]) -> Finding:
    """Give the finding that two servos may have one id: they answer one after the other, or garble each other.

    `servo` is the family, the id and the speed in question. `taken` are the ids at which something answers, however
    badly, and those that were offered before; the one that is offered here is added.
    """
    family, id, baud = servo
    taken.add(id)
    free = next((number for number in range(1, LAST_ID + 1) if number not in taken), None)
    cause = f"two servos with id {id}? Leave one of them alone on the wire and give it another id; or noise"
    if free is None:
        return Finding(Severity.FAIL, "ids", what, cause)
    taken.add(free)
    return Finding(Severity.FAIL, "ids", what, cause, (command("set-id", port, id, free, at(family, baud)),))


def is_noise(garbled: int, answering: int) -> bool:
    """Tell whether so many garbled servos of all that answer have one cause: two pairs with one id each are rare."""
    return garbled > 1 and 2 * garbled >= answering


NOISE = (
    "noise, since it is not one id alone: a missing ground wire, a line that is too long or without termination, a "
    "weak supply, or another program that talks on it"
)
"""Cause where many answers are garbled."""


def id_list(ids: Iterable[int]) -> str:
    """Name several servos: id 1; ids 1, 2."""
    listed = sorted(ids)
    return f"id{'s' * (len(listed) > 1)} {', '.join(map(str, listed))}"


def span(values: Iterable[float], unit: str) -> str:
    """Write the lowest and the highest of some values, or the one that they all are."""
    listed = list(values)
    low, high = show(min(listed), unit), show(max(listed), unit)
    return low if low == high else f"{low} .. {high}"
