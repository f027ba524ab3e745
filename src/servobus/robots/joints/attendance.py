"""Who is there: the servos that answer, compared with the robot file. Nothing moves, nothing is written."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from servobus.bus.base import BaseBus
from servobus.core.exchange import Procedure, SetBaud
from servobus.core.ids import LAST_ID
from servobus.core.values import frozen
from servobus.errors import BusError, NoReply, Restarted, RobotMismatch, ServobusError
from servobus.families import registry
from servobus.jobs.look import identify_at, verify
from servobus.jobs.scan import ScanResult, scan
from servobus.robots.joints.joint import Joint, Part
from servobus.robots.steps import RobotJob, each

if TYPE_CHECKING:
    from servobus.robots.file.entries import RobotFile

Kind: TypeAlias = Literal["missing", "wrong model", "swapped", "restarted", "unclear", "port", "stranger"]
GRAVE: tuple[Kind, ...] = ("missing", "wrong model", "swapped", "unclear", "port")
"""What keeps a robot from being opened as a whole."""


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
    file: "RobotFile", buses: Mapping[str, BaseBus[Any]], joints: Sequence[Joint], *, strangers: bool
) -> RobotJob[Attendance]:
    """Compare who answers on these ports with the file."""
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
    scans = yield from each({port: _scan(buses[port], there, everywhere=strangers) for port, there in alive.items()})
    for port, found in scans.items():
        if isinstance(found, ScanResult):
            findings += _strangers(port, found, [part for _, part in parts[port]])
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


def _scan(bus: BaseBus[Any], parts: Sequence[tuple[Joint, Part]], *, everywhere: bool) -> Procedure[ScanResult]:
    """Look for servos of the families and at the speeds that the file has on this port.

    Unless everywhere, those ids alone are looked at that new servos have, as one has that somebody has just plugged in.
    """
    survey = ScanResult()
    families = list(dict.fromkeys(part.servo.family for _, part in parts))
    for family in families:
        speeds = tuple(dict.fromkeys(part.servo.baud for _, part in parts if part.servo.family is family))
        new = {model.register("id").default for model in registry.models_of(family)}
        ids = range(LAST_ID + 1) if everywhere else sorted(id for id in new if id is not None)
        yield from scan([family], speeds, ids, None, survey, bus.identify)
    return survey


def _strangers(port: str, survey: ScanResult, parts: Sequence[Part]) -> list[Finding]:
    named = {(part.servo.family.name, part.servo.id, part.servo.baud) for part in parts}
    findings = []
    for found in survey.found:
        if (found.family.name, found.id, found.baud) in named:
            continue
        title = found.model.title if found.model is not None else f"{found.family.title} servo"
        text = (
            f"a stranger on port {port}: {title} id {found.id} at {found.baud} baud is in no joint; give it one, or "
            "take it off the cable"
        )
        findings.append(Finding("stranger", "", port, text))
    return findings


def refuse(attendance: Attendance, *, incomplete: bool) -> None:
    """Raise RobotMismatch where servos are not those of the file, unless that is allowed."""
    if attendance.grave and not incomplete:
        said = "; ".join(finding.text for finding in attendance.grave)
        raise RobotMismatch(f"{attendance.name}: {said}", attendance.grave)
