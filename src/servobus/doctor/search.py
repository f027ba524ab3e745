"""Which servos answer, at which speeds, and whether each id is there once."""

from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field

from servobus.bus.blocking import Bus, BusServo
from servobus.core.ids import LAST_ID, shown_ids
from servobus.doctor.findings import (
    NOISE,
    SHOWN,
    Finding,
    Severity,
    Watcher,
    at,
    command,
    duplicate_id,
    id_list,
    is_noise,
)
from servobus.errors import DuplicateId, Garbled, OtherProtocol
from servobus.families import registry
from servobus.families.base import Answers, Family
from servobus.jobs.scan import LATE, FoundServo, Models, ScanProblem, ScanProgress, in_order, one_of_each_family

Rounds = Sequence[tuple[Family, tuple[int, ...]]]
"""Families to ask, each with its speeds."""


@dataclass(frozen=True, slots=True)
class SearchPlan:
    """What to look for, and how long.

    rounds  families and speeds to ask
    spare   families and speeds to ask if no servo answers there, until one does
    ids     ids to ask
    reads   how many reads to count lost answers in
    models  what servos are that cannot say it themselves
    """

    rounds: Rounds
    spare: Rounds = ()
    ids: Sequence[int] = range(LAST_ID + 1)
    reads: int = 1000
    models: Models | None = None


@dataclass(slots=True)
class SearchResult:
    """What a search found."""

    servos: list[BusServo] = field(default_factory=list)
    found: list[FoundServo] = field(default_factory=list)
    troubles: list[ScanProblem] = field(default_factory=list)
    late: float = 0.0
    """s by which answers come late, if that is much."""

    @property
    def ids(self) -> set[int]:
        """Ids at which something answers, however badly."""
        return {one.id for one in self.found} | {one.id for one in self.troubles}


def search(
    bus: Bus, plan: SearchPlan, watch: Watcher, taken: set[int] | None = None
) -> Generator[Finding, None, list[BusServo]]:
    """Look for servos; give those that can be spoken to. Moves nothing, changes nothing.

    Ids at which something answers, and those that are offered as free, are put into `taken`.
    """
    taken = set() if taken is None else taken
    result = _scan(bus, plan.rounds, plan.ids, watch)
    if not result.found and not result.troubles and plan.spare:
        result = _scan(bus, plan.spare, plan.ids, watch, until_found=True)
    if bus.echo is not None:
        heard = "the adapter hears what it sends; that is taken out" if bus.echo else "none"
        yield Finding(Severity.OK, "echo", heard)
    port = bus.transport.name
    if result.late:
        yield _late(result.late)
    if result.found:
        yield from _list_servos(port, result.found)
        yield _speeds(port, result.found)
    elif not result.troubles:
        yield _no_answer(port, plan)
    taken |= result.ids
    yield from _unclear_answers(port, result, taken)
    return result.servos


def _scan(bus: Bus, rounds: Rounds, ids: Sequence[int], watch: Watcher, *, until_found: bool = False) -> SearchResult:
    result = SearchResult()
    done = 0

    def tell(_: ScanProgress) -> None:
        nonlocal done
        done += 1
        watch("scanning", done, total)

    speeds: dict[str, list[int]] = {}
    for family, bauds in rounds:
        speeds.setdefault(family.name, []).extend(bauds)
    # All are asked in the order of a scan; of several guesses the likely ones come first.
    likely = [(baud, family) for family, bauds in rounds for baud in bauds]
    order = likely if until_found else in_order([family for family, _ in rounds], speeds)
    if bus.transport.baud_elsewhere:
        order = one_of_each_family(order)
    total = len(ids) * len(order)
    for baud, family in order:
        result.servos += bus.scan(family=family, bauds=[baud], ids=ids, watch=tell)
        result.found += bus.survey.found
        result.troubles += bus.survey.troubles
        result.late = max(result.late, bus.survey.late)
        if result.found and until_found:
            break
    return result


def _late(seconds: float) -> Finding:
    what = f"answers come {1000 * seconds:.0f} ms late"
    cause = (
        "the adapter or its driver holds them back (its latency timer), a network is slow, or the servos are; "
        f"{1 / seconds:.0f} reads a second at most. servobus waits for them; other programs may see no servo"
    )
    return Finding(Severity.WARN, "lateness", what, cause)


def _no_answer(port: str, plan: SearchPlan) -> Finding:
    speeds: dict[str, list[int]] = {}
    for family, bauds in [*plan.rounds, *plan.spare]:
        speeds.setdefault(family.name, []).extend(bauds)
    asked = ", ".join(f"{name} at {'/'.join(map(str, bauds))}" for name, bauds in speeds.items())
    cause = (
        "no power, no common ground, a wire that is loose or in the wrong place, an adapter that does not switch "
        f"its direction, a speed or an id that was not asked, or answers that come more than {LATE:g} s late"
    )
    everything = all(set(bauds) >= set(registry.bauds(family)) for family, bauds in plan.rounds) or plan.spare
    mend = () if everything else (command("doctor", port, "--baud all"),)
    return Finding(Severity.FAIL, "servos", f"nobody answers (asked {asked})", cause, mend)


def _list_servos(port: str, found: list[FoundServo]) -> Iterator[Finding]:
    kinds: dict[str, list[int]] = {}
    for one in found:
        kinds.setdefault(one.model.title if one.model else f"unknown {one.family.title}", []).append(one.id)
    listed = "; ".join(f"{title} {id_list(ids)}" for title, ids in kinds.items())
    if silent := [one.id for one in found if one.model is not None and registry.never_told(one.model)]:
        cause = "some cannot say of which model they are; all works but what needs the figures of their makers"
        mend = command("remember", port, shown_ids(silent).partition(" ")[2], "MODEL")
        yield Finding(Severity.OK, "servos", listed, cause, (mend,))
    else:
        yield Finding(Severity.OK, "servos", listed)
    for one in found:
        if one.model is None:
            what = f"id {one.id} is {one.family.title} model {one.number_text}, not known here"
            yield Finding(Severity.WARN, "servos", what, "its registers cannot be read or written by name")
        elif one.identity.answers is Answers.NOTHING:
            row = one.model.register("answer_level").name
            mend = command("write", port, one.id, f"{row}={Answers.EVERYTHING.value}", at(one.family, one.baud))
            what = f"{one.model.named(f'id {one.id}')} answers no reads: nothing else is known of it"
            yield Finding(Severity.WARN, "servos", what, f"its {row} is {Answers.NOTHING.value}", (mend,))


def _speeds(port: str, found: list[FoundServo]) -> Finding:
    groups: dict[Family, list[FoundServo]] = {}
    for one in found:
        groups.setdefault(one.family, []).append(one)
    said, odd = [], []
    for family, members in groups.items():
        counts = Counter(one.baud for one in members)
        common_baud = counts.most_common(1)[0][0]
        odd += [(one, common_baud) for one in members if one.baud != common_baud]
        for baud in sorted(counts):
            factory = _factory_bauds(family, [one for one in members if one.baud == baud])
            unusual = "" if baud in factory else f" (from the factory {' or '.join(map(str, factory))})"
            said.append(f"{family.name} at {baud}{unusual}")
    what = ", ".join(said)
    if not odd:
        strange = [one for one in found if one.baud not in registry.factory_bauds(one.family)]
        cause = f"other commands find them with {at(strange[0].family, strange[0].baud)}" if strange else ""
        return Finding(Severity.OK, "speed", what, cause)
    cause = "servos of one wire have different speeds: each hears what is meant for the others as garbage"
    mend = tuple(
        command("set-baud", port, one.id, common_baud, f"--family {one.family.name}", f"--baud {one.baud}")
        for one, common_baud in odd[:SHOWN]
    )
    return Finding(Severity.WARN, "speed", what, cause, mend)


def _factory_bauds(family: Family, found: list[FoundServo]) -> tuple[int, ...]:
    """Give the speeds that these servos had from the factory, as far as their models are known."""
    known = dict.fromkeys(one.model.factory_baud for one in found if one.model is not None)
    return tuple(known) or registry.factory_bauds(family)


def _unclear_answers(port: str, result: SearchResult, taken: set[int]) -> Iterator[Finding]:
    """Report answers that made no sense. Two servos with one id garble each other, or answer one after the other."""
    garbled = {one.id for one in result.troubles if isinstance(one.error, Garbled)}
    noise = is_noise(len(garbled), len(result.ids))
    for one in result.troubles[:SHOWN]:
        what = f"{one.family.title} id {one.id} at {one.baud}: something answers, but not clearly ({one.error})"
        others = [near.family.name for near in result.found if near.baud == one.baud and near.family is not one.family]
        if isinstance(one.error, OtherProtocol):
            yield Finding(Severity.WARN, "ids", str(one), "a servo whose firmware speaks another protocol")
        elif isinstance(one.error, DuplicateId):
            yield duplicate_id(port, what, (one.family, one.id, one.baud), taken)
        elif others:
            cause = "a servo of another family that heard what was not meant for it?"
            yield Finding(Severity.WARN, "ids", what, cause, (command("doctor", port, f"--family {others[0]}"),))
        elif noise:
            yield Finding(Severity.FAIL, "ids", what, NOISE)
        elif isinstance(one.error, Garbled):
            yield duplicate_id(port, what, (one.family, one.id, one.baud), taken)
        else:
            yield Finding(Severity.FAIL, "ids", what, "noise, or a servo that answers too late?")
    if (more := len(result.troubles) - SHOWN) > 0:
        yield Finding(Severity.WARN, "ids", f"and {more} more unclear answers, probably of the same cause")
    if result.found and not result.troubles:
        yield Finding(Severity.OK, "ids", f"each is there once, as far as answers tell{_shared(result.found)}")


def _shared(found: list[FoundServo]) -> str:
    """Say which ids servos of several families have. That is allowed, but an id alone does not tell them apart."""
    owners: dict[int, list[str]] = {}
    for one in found:
        owners.setdefault(one.id, []).append(one.model.title if one.model else one.family.title)
    said = [f"id {id} is that of {' and '.join(titles)}" for id, titles in owners.items() if len(titles) > 1]
    return f"; {', '.join(said[:SHOWN])}: --family tells which is meant" if said else ""
