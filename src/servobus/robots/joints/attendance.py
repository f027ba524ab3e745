"""Who is there: the servos that answer, compared with the robot file. Nothing moves, nothing is written."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from servobus.bus.base import BaseBus
from servobus.core.exchange import Procedure, SetBaud
from servobus.core.ids import LAST_ID
from servobus.core.values import frozen
from servobus.errors import BusError, NoReply, Restarted, RobotMismatch, ServobusError
from servobus.families import registry
from servobus.families.base import Family
from servobus.jobs.look import identify_at, verify
from servobus.jobs.scan import ScanResult, Watcher, scan
from servobus.robots.joints.joint import Joint, Part
from servobus.robots.steps import RobotJob, each

if TYPE_CHECKING:
    from servobus.robots.file.entries import RobotFile

Kind: TypeAlias = Literal["missing", "wrong model", "swapped", "restarted", "unclear", "port", "stranger"]
GRAVE: tuple[Kind, ...] = ("missing", "wrong model", "swapped", "unclear", "port")
"""What keeps a robot from being opened as a whole."""
Sought: TypeAlias = Literal["near", "file", "everywhere"]
"""Where strangers are looked for:

near        at the ids that most servos have: those of new ones, up to LOW, and BESIDE those in the file. At the speeds
            of the servos in the file, and those that such servos come with. Takes half a second or so
file        at every id, at the same speeds: some seconds
everywhere  at every id of every family, at every speed that its servos can have: half a minute or more
"""
LOW, BESIDE = 10, 2
"""The highest id at which most strangers are, and how far from the ids in the file; *assumption*."""


@frozen
class Finding:
    """One thing that is not as the file says. `joint` is "" for a stranger and for a port.

    `n` says which servo of the joint is meant, from 0 on.
    """

    kind: Kind
    joint: str
    port: str
    text: str
    n: int = 0


@frozen
class Attendance:
    """What was found when a robot was compared with its file; true where all is as the file says."""

    name: str
    findings: tuple[Finding, ...]

    def __bool__(self) -> bool:
        return not self.findings

    @property
    def grave(self) -> tuple[Finding, ...]:
        """The findings without strangers and restarts, with which the robot works all the same."""
        return tuple(finding for finding in self.findings if finding.kind in GRAVE)

    @property
    def mistaken(self) -> dict[str, str]:
        """Joints that another servo answers for than the file says: name -> which, and what to do."""
        return {one.joint: one.text for one in self.findings if one.kind in ("wrong model", "swapped")}

    def unusable(self, joints: Iterable[Joint]) -> dict[str, str]:
        """Tell which of these joints cannot be used as the file says: name -> why."""
        ports = {finding.port: finding.text for finding in self.grave if finding.kind == "port"}
        gone = {joint.name: ports[part.port] for joint in joints for part in joint.parts if part.port in ports}
        return gone | {finding.joint: finding.text for finding in self.grave if finding.joint}

    def __str__(self) -> str:
        if not self.findings:
            return f"{self.name}: all servos are there"
        return "\n".join(f"{self.name}: {finding.text}" for finding in self.findings)


def check(
    file: "RobotFile",
    buses: Mapping[str, BaseBus[Any]],
    joints: Sequence[Joint],
    *,
    strangers: Sought,
    watch: Watcher | None = None,
) -> RobotJob[Attendance]:
    """Compare who answers on these ports with the file. `watch` is told of each id at which strangers were looked for.

    It is called from a thread for each port; see `Robot.check`.
    """
    parts: dict[str, list[tuple[Joint, Part]]] = {port: [] for port in buses}
    for joint in joints:
        for part in joint.parts:
            parts[part.port].append((joint, part))
    seen = yield from each({port: _ask(there) for port, there in parts.items()})
    findings: list[Finding] = []
    numbers: dict[tuple[Joint, Part], int | None] = {}
    for port, answers in seen.items():
        if isinstance(answers, ServobusError):
            findings.append(Finding("port", "", port, f"port {port}: {answers}"))
            continue
        for (joint, part), answer in answers.items():
            if isinstance(answer, Exception):
                findings.append(_absent(joint, part, answer))
            else:
                numbers[joint, part] = answer
    findings += _wrong(numbers)
    alive = {port: there for port, there in parts.items() if not isinstance(seen[port], ServobusError)}
    searches = {port: _search(buses[port], there, strangers, watch) for port, there in alive.items()}
    for port, found in (yield from each(searches)).items():
        if not isinstance(found, ServobusError):
            findings += [Finding("stranger", "", port, f"a stranger on port {port}: {text}") for text in found]
    return Attendance(file.name, tuple(findings))


def _ask(
    parts: Sequence[tuple[Joint, Part]],
) -> Procedure[dict[tuple[Joint, Part], int | Exception | None]]:
    """Ask each servo what it is: the number of its model, None if it cannot say, or the error that came."""
    answers: dict[Any, Any] = {}
    for joint, part in parts:
        target = part.servo.target
        try:
            identity = yield from identify_at(part.servo.family, target.id, target.baud)
            answers[joint, part] = identity.number
            yield SetBaud(target.baud)
            yield from verify(target)
        except (BusError, Restarted) as error:
            answers[joint, part] = error
    return answers


def _absent(joint: Joint, part: Part, error: Exception) -> Finding:
    servo = part.servo
    if isinstance(error, NoReply):
        text = (
            f"{joint.name} is missing: {servo.target} at {servo.baud} baud does not answer on port {part.port}; look "
            "at its plug and its power, or `servobus robot adopt` a new servo in its place"
        )
        return Finding("missing", joint.name, part.port, text, joint.parts.index(part))
    kind: Kind = "restarted" if isinstance(error, Restarted) else "unclear"
    return Finding(kind, joint.name, part.port, f"{joint.name}: {error}", joint.parts.index(part))


def _wrong(numbers: Mapping[tuple[Joint, Part], int | None]) -> list[Finding]:
    """Tell which servos are of another model than the file says; two that have each other's are swapped."""
    wrong = {key: number for key, number in numbers.items() if number not in (None, key[1].servo.model.number)}
    findings = []
    for (joint, part), number in wrong.items():
        family, meant = part.servo.family, part.servo.model
        model = registry.identified(family, number)
        title = f"a {model.title}" if model is not None else f"of model number {family.number_text(number)}"
        says = f"{joint.name}: id {part.servo.id} on port {part.port} is {title}, not a {meant.title} as the file says"
        other = next(
            (
                one
                for (one, its), its_number in wrong.items()
                if one is not joint and its_number == meant.number and its.servo.model.number == number
            ),
            None,
        )
        if other is not None:
            text = f"{says}; it may be swapped with that of {other.name}: exchange their ids or their cables"
            findings.append(Finding("swapped", joint.name, part.port, text))
        else:
            text = f"{says}; put the right one there, or change `model` in the file"
            findings.append(Finding("wrong model", joint.name, part.port, text))
    return findings


def _search(
    bus: BaseBus[Any], there: Iterable[tuple[Joint, Part]], sought: Sought, watch: Watcher | None
) -> Procedure[list[str]]:
    """Look for servos that are none of these on their port; tell of each."""
    parts = [part for _, part in there]
    fixed = bool(parts) and (yield SetBaud(parts[0].servo.baud))  # at any speed the same servos would answer
    survey = ScanResult()
    for families, bauds, ids in _rounds(parts, sought, fixed=fixed):
        yield from scan(families, bauds, ids, watch, survey, bus.identify)
    named = {(part.servo.family.name, part.servo.id, None if fixed else part.servo.baud) for part in parts}
    strangers = []
    for found in survey.found:
        if (found.family.name, found.id, None if fixed else found.baud) not in named:
            title = found.model.title if found.model is not None else f"{found.family.title} servo"
            strangers.append(
                f"{title} id {found.id} at {found.baud} baud is in no joint; give it one, or take it off the cable"
            )
    known = {(part.servo.family.name, part.servo.id) for part in parts}
    strangers += [
        f"{one}; two new servos with one id? Look at each alone"
        for one in survey.troubles
        if (one.family.name, one.id) not in known
    ]
    return strangers


def _rounds(
    parts: Sequence[Part], sought: Sought, *, fixed: bool
) -> Iterator[tuple[Sequence[Family], Mapping[str, Sequence[int]], Sequence[int]]]:
    """Tell where strangers are looked for on the port of these servos: families, their speeds, and ids.

    Where the speed of the line is set elsewhere, one speed of each family stands for all.
    """
    everyone = range(LAST_ID + 1)
    mine = {family: [part for part in parts if part.servo.family is family] for family in registry.FAMILIES.values()}
    speeds = {family: list(dict.fromkeys(part.servo.baud for part in there)) for family, there in mine.items()}
    if sought == "everywhere":
        bauds = {family.name: list(dict.fromkeys([*speeds[family], *registry.bauds(family)])) for family in mine}
        yield list(mine), {name: some[:1] for name, some in bauds.items()} if fixed else bauds, everyone
        return
    for family, there in mine.items():
        if not there:
            continue
        new = {id for model in registry.models_of(family) if (id := model.register("id").default) is not None}
        beside = {part.servo.id + step for part in there for step in range(-BESIDE, BESIDE + 1)}
        near = sorted((new | beside | set(range(LOW + 1))) & set(everyone))
        yield [family], {family.name: speeds[family]}, near if sought == "near" else everyone
        fresh = {part.servo.model.factory_baud for part in there} - set(speeds[family])
        if fresh and not fixed:
            yield [family], {family.name: sorted(fresh)}, sorted(new)


def ids_to_ask(ports: Iterable[str], joints: Iterable[Joint], sought: Sought) -> int:
    """Count the ids that a search for strangers asks on these ports, each in each family and at each speed."""
    parts = [part for joint in joints for part in joint.parts]
    return sum(
        len(ids) * sum(len(bauds[family.name]) for family in families)
        for port in ports
        for families, bauds, ids in _rounds([part for part in parts if part.port == port], sought, fixed=False)
    )


def refuse(attendance: Attendance, *, incomplete: bool) -> None:
    """Raise RobotMismatch where servos are not those of the file, unless that is allowed."""
    if attendance.grave and not incomplete:
        said = "; ".join(finding.text for finding in attendance.grave)
        raise RobotMismatch(f"{attendance.name}: {said}", attendance.grave)
