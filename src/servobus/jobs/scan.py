"""Finding servos: all of them, or one."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from servobus.core.exchange import Batch, Exchange, Procedure, SetBaud
from servobus.core.ids import LAST_ID, check_id
from servobus.core.values import frozen
from servobus.errors import BusError, NoReply
from servobus.families import registry
from servobus.families.base import Answers, Family, Identity, Model, ServoRef
from servobus.jobs.look import Snapshot, look


@frozen
class FoundServo:
    """A servo that answered. `model` is None if its number is of no model known here."""

    family: Family
    id: int
    baud: int
    identity: Identity
    model: type[Model] | None
    state: Snapshot | None
    """None for a servo whose registers cannot be read: an unknown model, or one that answers nothing."""
    alarms: int = 0
    """Alarm bits that stood in its answer."""


@frozen
class ScanProblem:
    """Something answered that made no sense."""

    family: Family
    id: int
    baud: int
    error: BusError

    def __str__(self) -> str:
        return (
            f"{self.family.title}, id {self.id} at {self.baud} baud: something answers, but not clearly ({self.error})"
        )


@frozen
class ScanProgress:
    """How far a scan is."""

    done: int
    total: int
    family: Family
    baud: int
    id: int
    found: FoundServo | None = None


class ScanResult:
    """What a scan saw."""

    def __init__(self) -> None:
        self.found: list[FoundServo] = []
        self.troubles: list[ScanProblem] = []


AT_ONCE = 16
"""Ids that a scan asks before it looks at the answers."""

Watcher = Callable[[ScanProgress], None]


def scan(
    families: Sequence[Family],
    bauds: Sequence[int] | None = None,
    ids: Iterable[int] = range(LAST_ID + 1),
    watch: Watcher | None = None,
    survey: ScanResult | None = None,
) -> Procedure[ScanResult]:
    """Ask every id of every family at every speed whether it is there. Moves nothing, changes nothing.

    `bauds` None means the factory speeds of each family's models. What is found is put into `survey` at once, so it is
    there even if the scan is broken off.
    """
    wanted = [check_id(id) for id in ids]
    rounds = [(baud, family) for family in families for baud in bauds or registry.factory_bauds(family)]
    survey = ScanResult() if survey is None else survey
    done = 0
    for baud, family in sorted(rounds, key=lambda item: item[0]):
        yield SetBaud(baud)
        for start in range(0, len(wanted), AT_ONCE):
            some = wanted[start : start + AT_ONCE]
            # A scan mostly meets silence: it does not ask twice, but where something was heard.
            answers = yield Batch([family.ping(id).no_retry() for id in some])
            for id, answer in zip(some, answers, strict=True):
                done += 1
                found = None
                if not isinstance(answer, NoReply):
                    found = yield from _met(family, id, baud, survey)
                if watch is not None:
                    watch(ScanProgress(done, len(rounds) * len(wanted), family, baud, id, found))
    return survey


def _met(family: Family, id: int, baud: int, survey: ScanResult) -> Procedure[FoundServo | None]:
    """Look closer at what may have answered, and put it into the survey."""
    try:
        ping: Exchange[Any] = family.ping(id)
        alarms = (yield ping.mapped(ping.alarms)) if ping.alarms is not None else (yield ping) or 0
        found = yield from _meet(family, id, baud, alarms)
    except NoReply:
        return None
    except BusError as error:
        survey.troubles.append(ScanProblem(family, id, baud, error))
        return None
    survey.found.append(found)
    return found


def _meet(family: Family, id: int, baud: int, alarms: int) -> Procedure[FoundServo]:
    """Get to know a servo that is there."""
    identity = yield from family.identify(id)
    model = registry.identified(family, identity.number)
    state = None
    if model is not None and identity.answers is not Answers.NOTHING:
        state = yield from look(ServoRef(id, model, identity.answers))
    return FoundServo(family, id, baud, identity, model, state, alarms)


def find(families: Sequence[Family], bauds: Sequence[int] | None, id: int) -> Procedure[FoundServo]:
    """Look for one servo. Raises NoReply if nobody answers, BusError if it is no model known here."""
    survey = yield from scan(families, bauds, [id])
    for found in survey.found:
        if found.model is not None:
            yield SetBaud(found.baud)
            return found
        raise BusError(
            f"id {id} at {found.baud} baud answers as {found.family.title} model {found.identity.number}, "
            "which is not known here"
        )
    if survey.troubles:
        raise survey.troubles[0].error
    tried = ", ".join(
        f"{family.name} at {'/'.join(map(str, bauds or registry.factory_bauds(family)))}" for family in families
    )
    raise NoReply(f"no servo answers to id {id} (tried {tried}); is it powered, and is that its speed?")
