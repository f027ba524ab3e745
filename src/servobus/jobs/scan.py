"""Finding servos: all of them, or one."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from servobus.core.exchange import Batch, Exchange, LateAnswers, Lateness, Pause, Procedure, SetBaud, Settle
from servobus.core.ids import LAST_ID, check_id
from servobus.core.values import frozen
from servobus.errors import BadReading, BusError, NoReply, OtherProtocol, UnknownName, UsageError
from servobus.families import registry
from servobus.families.base import Answers, Family, Identity, Model, ServoRef, Stranger
from servobus.jobs.look import Snapshot, look


@frozen
class FoundServo:
    """A servo that answered.

    `model` is the generic one of its family if it is not known which it is, None if the family has no such model.
    """

    family: Family
    id: int
    baud: int
    identity: Identity
    model: type[Model] | None
    state: Snapshot | None
    """None for a servo whose registers cannot be read, such as one that answers nothing."""
    alarms: int = 0
    """Alarm bits that stood in its answer."""

    @property
    def number_text(self) -> str:
        """The number of the model that it reports, as people know it."""
        return self.family.number_text(self.identity.number)


@frozen
class ScanProblem:
    """Something answered that made no sense."""

    family: Family
    id: int
    baud: int
    error: BusError

    def __str__(self) -> str:
        if isinstance(self.error, OtherProtocol):
            return f"{self.error}, at {self.baud} baud"
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


@frozen
class ModelConflict:
    """A servo says that it is of another model than `attach` gave. It stays what it was attached as."""

    attached: ServoRef
    found: FoundServo

    def __str__(self) -> str:
        says = self.found.model.title if self.found.model else f"model {self.found.number_text}"
        attached = self.attached.model.title
        return (
            f"id {self.found.id} at {self.found.baud} baud was attached as {attached} and says that it is {says}; "
            f"it stays {attached} until it is attached anew"
        )


class ScanResult:
    """What a scan saw."""

    def __init__(self) -> None:
        self.found: list[FoundServo] = []
        self.troubles: list[ScanProblem] = []
        self.conflicts: list[ModelConflict] = []
        self.late = 0.0
        """s by which answers came later than their bits allow, if that is much; else 0."""


Models: TypeAlias = str | type[Model] | Mapping[int, str | type[Model]]
"""What servos are that cannot say it: a model for all of its family, or id -> model. Models by name or themselves."""


def model_told(models: Models | None, family: Family, id: int) -> type[Model] | None:
    """Give the model that was said to be the one of a servo. Raises UnknownName for an unknown name."""
    told = models.get(id) if isinstance(models, Mapping) else models
    model = registry.model(told) if isinstance(told, str) else told
    return model if model is not None and model.family is family else None


def check_models(models: Models | None) -> Models | None:
    """Give back what servos are said to be. Raises UnknownName for a name of no model, BadValue for an id."""
    if isinstance(models, Mapping):
        for id in models:
            check_id(id)
    for told in models.values() if isinstance(models, Mapping) else () if models is None else (models,):
        given: object = told
        if isinstance(told, str):
            registry.model(told)
        elif not (isinstance(given, type) and issubclass(given, Model)):
            raise UsageError(f'{given!r:.60} is no model: give one such as LX16A, or its name, "lx16a"')
    return models


Identify: TypeAlias = Callable[[Family, int, int, int | None], type[Model] | None]
"""Tells the model of a servo by its family, id, speed and the number that it reports; see `FoundServo.model`."""


def by_number(family: Family, _id: int, _baud: int, number: int | None) -> type[Model] | None:
    """Tell the model by what the servo says."""
    return registry.identified(family, number) or registry.unknown(family, number)


AT_ONCE = 32
"""Ids that a scan asks before it looks at the answers, if nothing else waits for the line."""
MUCH = 0.02
"""s; a USB adapter that hands answers over after 16 ms is not worth telling."""
LATE = 0.3
"""s for which a scan that heard nothing listens for late answers, at its end and before it asks the same family at
another speed; assumption: none comes later."""
STRANGERS = 0.3
"""s in which further answers to a question to all that speak another protocol pass by."""
SPACING = 0.002
"""s; no two questions of a scan on one wire leave closer together."""
GIVE_WAY = Pause(0.0, shared=True)
"""A scan takes seconds: whatever else waits for the line comes first, between any two ids."""

Watcher = Callable[[ScanProgress], None]


def scan(
    families: Sequence[Family],
    bauds: Sequence[int] | Mapping[str, Sequence[int]] | None = None,
    ids: Iterable[int] = range(LAST_ID + 1),
    watch: Watcher | None = None,
    survey: ScanResult | None = None,
    identify: Identify = by_number,
) -> Procedure[ScanResult]:
    """Ask every id of every family at every speed whether it is there, each once. Moves nothing, changes nothing.

    `bauds` are speeds for all families, or family -> speeds; None means the factory speeds of each family's models.
    Where the speed on the wire is set elsewhere, each family is asked once, at the slowest of them.
    What is found is put into `survey` at once, so it is there even if the scan is broken off. Servos whose answers come
    after they were given up are asked again, with the patience that this has taught the link; and those that were
    silent while an adapter or a computer stood still, or that fell silent after a first answer. A line on which no
    servo answers costs `LATE` s once, and once more for each further speed of a family.
    """
    wanted = list(dict.fromkeys(check_id(id) for id in ids))
    rounds = in_order(families, bauds)
    if rounds and (yield SetBaud(rounds[0][0])):  # at any other speed the same servos would answer again
        rounds = one_of_each_family(rounds)
    survey = ScanResult() if survey is None else survey
    known = len(survey.found)
    done = 0
    asked: list[tuple[int, Family]] = []

    def tell(family: Family, baud: int, id: int, found: FoundServo | None) -> None:
        if watch is not None:
            watch(ScanProgress(done, len(rounds) * len(wanted), family, baud, id, found))

    for n, (baud, family) in enumerate(rounds):
        asked.insert(0, (baud, family))
        answered: set[int] = set()
        yield SetBaud(baud)
        for start in range(0, len(wanted), AT_ONCE):
            some = wanted[start : start + AT_ONCE]
            while some:
                # A scan mostly meets silence: it does not ask twice, but where something was heard.
                answers = yield Batch([family.ping(id).no_retry() for id in some], yields=True)
                for id, answer in zip(some, answers, strict=False):
                    yield GIVE_WAY
                    done += 1
                    found = None
                    if not isinstance(answer, NoReply):
                        answered.add(id)
                        found = yield from _met(family, id, baud, survey, identify)
                    tell(family, baud, id, found)
                some = some[len(answers) :]
        if len(wanted) > LAST_ID:
            yield from _ask_strangers(family, baud, survey)
        # A late answer at one speed of a family would be taken for one at its next speed.
        later = rounds[n + 1 :]
        waits = not later or any(other is family for _, other in later)
        lateness: Lateness = yield LateAnswers(LATE if waits else 0.0)
        yield from _ask_late_ones_again(asked, wanted, lateness, survey, identify, tell)
        yield from _ask_lost_ones_again(family, baud, wanted, answered, lateness, survey, identify, tell)
        here = [other for speed, other in rounds if speed == baud]
        if family is here[-1]:
            for other in here:
                yield Settle(other.framing)
    # Those that were found at a second look stand where those are that answered at once.
    found_now = sorted(
        survey.found[known:], key=lambda one: (rounds.index((one.baud, one.family)), wanted.index(one.id))
    )
    survey.found[known:] = found_now
    return survey


def _ask_strangers(family: Family, baud: int, survey: ScanResult) -> Procedure[None]:
    """Ask for what speaks another protocol on lines of this family."""
    for question in family.strangers():
        yield GIVE_WAY
        (answer,) = yield Batch([question.no_retry()])
        if isinstance(answer, Stranger):
            error = OtherProtocol(f"{answer.text}")
            survey.troubles.append(ScanProblem(family, answer.id, baud, error))
            yield Pause(STRANGERS)


def _ask_late_ones_again(
    asked: Sequence[tuple[int, Family]],
    ids: Sequence[int],
    lateness: Lateness,
    survey: ScanResult,
    identify: Identify,
    tell: Callable[[Family, int, int, FoundServo], None],
) -> Procedure[None]:
    """Look at the servos whose answers came too late, at each speed at which they were asked, the last one first."""
    survey.late = lateness.usual if lateness.usual > MUCH else 0.0
    for framing, id in sorted(lateness.servos, key=lambda one: one[1]):
        if id not in ids:
            continue  # it answers what was asked before this scan
        for baud, family in asked:
            if family.framing is not framing:
                continue
            if any(one.family is family and one.id == id for one in survey.found):
                break
            yield GIVE_WAY
            yield SetBaud(baud)
            if found := (yield from _met(family, id, baud, survey, identify)):
                tell(family, baud, id, found)


def _ask_lost_ones_again(
    family: Family,
    baud: int,
    ids: Sequence[int],
    answered: set[int],
    lateness: Lateness,
    survey: ScanResult,
    identify: Identify,
    tell: Callable[[Family, int, int, FoundServo], None],
) -> Procedure[None]:
    """Look again at those whose answer may have met another one, and at those that fell silent after the first answer.

    Questions keep so far apart that no two answers meet. But an adapter or a computer that stands still sends on at
    once what has piled up, and then they meet; what tells is that another answer came later than questions are apart.
    """
    lost = set(ids) if lateness.longest > SPACING else set(answered)
    lost -= {one.id for one in survey.found if (one.family, one.baud) == (family, baud)}
    lost -= {one.id for one in survey.troubles if (one.family, one.baud) == (family, baud)}
    again = [id for id in ids if id in lost]
    for start in range(0, len(again), AT_ONCE):
        some = again[start : start + AT_ONCE]
        yield GIVE_WAY
        yield SetBaud(baud)
        answers = yield Batch([family.ping(id).no_retry() for id in some])
        for id, answer in zip(some, answers, strict=True):
            if isinstance(answer, NoReply):
                continue
            yield GIVE_WAY
            if found := (yield from _met(family, id, baud, survey, identify)):
                tell(family, baud, id, found)


def in_order(
    families: Sequence[Family], bauds: Sequence[int] | Mapping[str, Sequence[int]] | None
) -> list[tuple[int, Family]]:
    """Give each speed and family to ask once, the slowest speed first; see `scan`.

    At one speed those come first that hear requests alone, on a wire of their own: requests to other families are all
    that can spoil theirs.
    """
    rounds = {
        (baud, family): None
        for family in families
        for baud in (bauds[family.name] if isinstance(bauds, Mapping) else bauds or registry.factory_bauds(family))
    }
    return sorted(rounds, key=lambda item: (item[0], not item[1].full_duplex))


def one_of_each_family(rounds: Iterable[tuple[int, Family]]) -> list[tuple[int, Family]]:
    """Give the first of the rounds of each family, for a line on which all speeds are the same."""
    first: dict[Family, int] = {}
    for baud, family in rounds:
        first.setdefault(family, baud)
    return [(baud, family) for family, baud in first.items()]


def _met(family: Family, id: int, baud: int, survey: ScanResult, identify: Identify) -> Procedure[FoundServo | None]:
    """Look closer at what may have answered, and put it into the survey."""
    try:
        ping: Exchange[Any] = family.ping(id)
        alarms = (yield ping.mapped(ping.alarms)) if ping.alarms is not None else (yield ping) or 0
        found = yield from _meet(family, id, baud, alarms, identify)
    except NoReply:
        return None
    except BusError as error:
        survey.troubles.append(ScanProblem(family, id, baud, error))
        return None
    survey.found.append(found)
    survey.troubles = [one for one in survey.troubles if (one.family, one.id, one.baud) != (family, id, baud)]
    return found


def _meet(family: Family, id: int, baud: int, alarms: int, identify: Identify) -> Procedure[FoundServo]:
    """Get to know a servo that is there."""
    identity = yield from family.identify(id)
    model = identify(family, id, baud, identity.number)
    state = None
    if model is not None and identity.answers is not Answers.NOTHING:
        try:
            state = yield from look(ServoRef(id, model, identity.answers))
        except BadReading:  # the servo is there, and can be stopped, whatever its registers read as
            state = None
    if model is not None:
        alarms = family.known_alarms(model, alarms)
    return FoundServo(family, id, baud, identity, model, state, alarms)


def find(
    families: Sequence[Family], bauds: Sequence[int] | None, id: int, identify: Identify = by_number
) -> Procedure[FoundServo]:
    """Look for one servo.

    Raises NoReply if no servo answers, UnknownName if two servos have this id, BusError if it is no model known here.
    """
    survey = yield from scan(families, bauds, [id], identify=identify)
    if len(survey.found) > 1:
        names = " and ".join(
            f"{found.model.named(f'id {id}') if found.model else f'{found.family.title} id {id}'} at {found.baud}"
            for found in survey.found
        )
        ways = " or ".join(dict.fromkeys(f'family="{found.family.name}"' for found in survey.found))
        if len({found.family.name for found in survey.found}) < len(survey.found):
            ways += ", and bauds="
        raise UnknownName(f"id {id} is not unique here: {names}; say which, with {ways}")
    for found in survey.found:
        if found.model is not None:
            yield SetBaud(found.baud)
            return found
        raise unknown_model(found)
    if survey.troubles:
        raise survey.troubles[0].error
    tried = ", ".join(
        f"{family.name} at {'/'.join(map(str, bauds or registry.factory_bauds(family)))}" for family in families
    )
    raise NoReply(f"no servo answers to id {id} (tried {tried}); is it powered, and is that its speed?")


def unknown_model(found: FoundServo) -> BusError:
    """Say that a servo was found whose model is not known here."""
    return BusError(
        f"id {found.id} at {found.baud} baud answers as {found.family.title} model {found.number_text}, "
        "which is not known here; a model can be said to be meant, with `models=` or --model"
    )
