"""A new servo in the place of a dead one: found on the port, and given what the file and the old one's backup say.

    vacant      which servo of the file is missing
    newcomer    the one servo on its port that is in no joint, whatever id and speed it has
    adoption    what would be changed in the newcomer
    carry_out   do so: settings first, then speed and id, and last which requests it answers
    left_over   which servo is in its place, but lacks the last of that, because the program was killed then
    finish      give it the rest

As long as it has its old id or speed the newcomer is a stranger on its port. So wherever this is broken off, the same
again finds it and goes on; and what it is to hold is kept in a file until it does.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from servobus.bus.base import BaseBus
from servobus.core.exchange import Procedure, SetBaud
from servobus.core.ids import LAST_ID
from servobus.core.present import value_text
from servobus.core.registers import Area, Register
from servobus.core.values import frozen, replace
from servobus.errors import NotRestored, ServobusError, UsageError
from servobus.families import registry
from servobus.families.base import KnownServo, ServoRef, policy_register
from servobus.families.change import set_registers
from servobus.jobs import reconfigure
from servobus.jobs.backup import Backup, Comparison, backup, compare, identity_names, restore
from servobus.jobs.look import identify_at
from servobus.jobs.make_safe import let_go
from servobus.jobs.scan import FoundServo, ScanProblem, ScanResult, Watcher, scan
from servobus.robots.joints.attendance import Attendance
from servobus.robots.joints.joint import Joint, Part
from servobus.robots.settings.backups import Backups
from servobus.robots.settings.planning import wanted


@frozen
class Vacancy:
    """A servo of the file that does not answer: which one of its joint."""

    joint: Joint
    n: int

    @property
    def part(self) -> Part:
        """The servo that is missing."""
        return self.joint.parts[self.n]

    def __str__(self) -> str:
        return f"{self.joint.name} ({self.part.servo.target} on {self.part.port})"


def vacant(found: Attendance, joints: Mapping[str, Joint], name: str | None) -> Vacancy:
    """Give the servo that is missing, of the joint with this name or of any. Raises UsageError if that is not one."""
    gone = [one for one in found.findings if one.kind == "missing" and name in (None, one.joint)]
    if not gone:
        who = "all servos answer" if name is None else f"the servo of {name} answers"
        raise UsageError(
            f"{found.name}: {who}, so no new one is needed; `servobus robot plan` compares what they hold with the file"
        )
    if len({one.joint for one in gone}) > 1:
        said = ", ".join(dict.fromkeys(one.joint for one in gone))
        raise UsageError(
            f"{found.name}: {said} are missing; connect the new servo of one of them, and name that joint: "
            f"`servobus robot adopt FILE {gone[0].joint}`"
        )
    return Vacancy(joints[gone[0].joint], gone[0].n)


def newcomer(
    bus: BaseBus[Any],
    vacancy: Vacancy,
    known: Iterable[Part],
    *,
    ids: Iterable[int] = range(LAST_ID + 1),
    watch: Watcher | None = None,
) -> Procedure[FoundServo]:
    """Find the one servo on a port that none of these parts is, at any speed. Moves nothing, changes nothing.

    Raises UsageError if there is none, if there are several, or if it is of another model; each is named.
    """
    meant, family = vacancy.part.servo.model, vacancy.part.servo.family
    survey = ScanResult()
    yield from scan([family], registry.bauds(family), list(ids), watch, survey, bus.identify)
    named = {(part.servo.family.name, part.servo.id, part.servo.baud) for part in known}
    strangers = [one for one in survey.found if (one.family.name, one.id, one.baud) not in named]
    alone = "connect the new servo alone to another adapter and name that: --port PORT"
    if survey.troubles:
        raise UsageError(f"{_troubles(survey.troubles)}; if two servos have one id, {alone}")
    if not strangers:
        raise UsageError(
            f"{vacancy}: no new servo answers at any speed of {family.title} servos; look at its plug and its power. "
            f"One that has the id of another servo hides behind that: {alone}"
        )
    if len(strangers) > 1:
        said = ", ".join(_title(one) for one in strangers)
        raise UsageError(
            f"{vacancy}: {len(strangers)} servos are in no joint: {said}; leave only the new one on the line"
        )
    (one,) = strangers
    model = one.model
    if model is None or not (model is meant or registry.never_told(model)):
        raise UsageError(
            f"{vacancy}: {_title(one)} is no {meant.title}; take one of that model, or change `model` in the file"
        )
    return one


def _title(one: FoundServo) -> str:
    title = one.model.title if one.model is not None else f"{one.family.title} servo"
    return f"{title} id {one.id} at {one.baud} baud"


def _troubles(troubles: Sequence[ScanProblem]) -> str:
    return "; ".join(map(str, troubles))


@frozen
class Adoption:
    """What is to be changed in a newcomer.

    vacancy   whose place it takes
    target    the newcomer, as it is
    before    all its settings as they are
    settings  the settings that it is to have, raw, of all that survive power-off
    ram       those in RAM that the file asks for, raw
    found     what of that differs
    source    where the settings come from beside the file; "" if nowhere
    """

    vacancy: Vacancy
    target: KnownServo
    before: Backup
    settings: Backup
    ram: Mapping[Register[Any], int]
    found: Comparison
    source: str

    @property
    def id(self) -> int:
        """The id that it gets."""
        return self.vacancy.part.servo.id

    @property
    def baud(self) -> int:
        """The speed that it gets, bit/s."""
        return self.vacancy.part.servo.baud

    @property
    def wanted(self) -> Backup:
        """The settings that it is to have, for `Backups.adopting`."""
        return replace(self.settings, id=self.id, baud=self.baud)

    @property
    def after(self) -> Backup:
        """All its settings as they are to be."""
        values = {**self.before.values, **self.settings.values}
        return replace(self.before, id=self.id, baud=self.baud, values=values)

    def __str__(self) -> str:
        lines = [f"{self.target} at {self.target.baud} baud takes the place of {self.vacancy}:"]
        if self.target.baud != self.baud:
            lines.append(f"  speed: {self.target.baud} baud -> {self.baud} baud   [EEPROM]")
        if self.target.id != self.id:
            lines.append(f"  id: {self.target.id} -> {self.id}   [EEPROM]")
        for row, raw in self.found.changes.items():
            lines.append(
                f"  {row.name}: {value_text(row, self.found.present[row])} -> {value_text(row, raw)}   [EEPROM]"
            )
        lines += [f"  {row.name}: {value_text(row, raw)}   [RAM]" for row, raw in self.ram.items()]
        lines += [f"  {row.name} stays: {why}" for row, why in self.found.impossible.items()]
        lines.append(f"  settings from {self.source}" if self.source else "  no settings of the old servo are kept")
        if self.found.driven:
            lines.append("  its torque goes off")
        return "\n".join(lines)


def adoption(vacancy: Vacancy, one: FoundServo, saved: Backup | None, source: str) -> Procedure[Adoption]:
    """Tell what is to be changed in a newcomer: what the backup of the old servo says, and before that the file.

    Raises UsageError for a backup of another model.
    """
    model, joint = vacancy.part.servo.model, vacancy.joint
    if saved is not None and saved.model is not model and not registry.never_told(saved.model):
        raise UsageError(f"{source}: that is a backup of a {saved.model.title}, and {vacancy} is none")
    target = KnownServo.of(ServoRef(one.id, model, one.identity.answers), one.baud)
    yield SetBaud(target.baud)
    before = yield from backup(target, one.identity.firmware, target.baud)
    asked = wanted(joint.entry, joint.entry.servos[vacancy.n])
    kept = {row.name: raw for row, raw in asked.items() if row.area is Area.EEPROM}
    old = {} if saved is None else {n: raw for n, raw in saved.values.items() if n not in identity_names(model)}
    settings = replace(before, values={**old, **kept})
    found = yield from compare(target, settings)
    ram = {row: raw for row, raw in asked.items() if row.area is not Area.EEPROM}
    return Adoption(vacancy, target, before, settings, ram, found, source if saved is not None else "")


def carry_out(plan: Adoption, port: str, kept_in: Path) -> Procedure[KnownServo]:
    """Give a newcomer its settings, then speed and id, and last which requests it answers. Gives it as it is then.

    Its torque goes off. `kept_in` has its settings as they were, for whoever wants them back. Raises NotRestored with
    what it did not take, when all the rest is done, and BusError or PortError where the line is broken; their message
    says what was there before.
    """
    policy = policy_register(plan.target.model)
    late = {} if policy is None else {n: raw for n, raw in plan.settings.values.items() if n == policy.name}
    early = {name: raw for name, raw in plan.settings.values.items() if name not in late}
    target = old = plan.target
    refused: NotRestored | None = None
    try:
        yield SetBaud(target.baud)
        if (yield from target.model.family.read_torque(target)).on:
            yield from let_go(target)
        try:
            yield from restore(target, replace(plan.settings, values=early), torque_off=True)
        except NotRestored as error:
            refused = error  # it is told at the end: without the rest the servo would not even be in its place
        if plan.baud != target.baud:
            baud = yield from reconfigure.change_baud(target, plan.baud)
            target = yield from _met(target, target.id, baud)
        if plan.id != target.id:
            yield from reconfigure.change_id(target, plan.id)
            target = yield from _met(target, plan.id, target.baud)
        if plan.ram:
            yield from set_registers(target, dict(plan.ram))
        if late:
            yield from restore(target, replace(plan.settings, values=late), torque_off=True)
            target = yield from _met(target, target.id, target.baud)
    except UsageError:
        raise
    except ServobusError as error:
        error.tell_before({"id": old.id, "baud": old.baud}, _way_back(plan, port, kept_in))
        raise
    if refused is not None:
        raise refused
    return target


def left_over(
    found: Attendance, joints: Mapping[str, Joint], backups: Backups, name: str | None
) -> tuple[Vacancy, Backup] | None:
    """Give the servo whose adoption was broken off when it was in its place already, and what it is to hold.

    Of the joint with this name, or of any; None if there is none. Raises UsageError for a file that is damaged.
    """
    absent = {(one.joint, one.n) for one in found.grave}
    for joint in joints.values():
        for n in range(len(joint.parts)):
            if name in (None, joint.name) and (joint.name, n) not in absent:
                saved = backups.adoption(joint.name, n)
                if saved is not None:
                    return Vacancy(joint, n), saved
    return None


def finish(left: Vacancy, saved: Backup) -> Procedure[KnownServo]:
    """Give a servo that is in its place the settings that it lacks; give it as it is then. Its torque goes off.

    Raises NotRestored with what it did not take, and BusError or PortError where the line is broken.
    """
    target = left.part.servo.target
    yield SetBaud(target.baud)
    if (yield from target.model.family.read_torque(target)).on:
        yield from let_go(target)
    asked = wanted(left.joint.entry, left.joint.entry.servos[left.n])
    if ram := {row: raw for row, raw in asked.items() if row.area is not Area.EEPROM}:
        yield from set_registers(target, ram)
    yield from restore(target, saved, torque_off=True)
    return (yield from _met(target, target.id, target.baud))


def _met(target: KnownServo, id: int, baud: int) -> Procedure[KnownServo]:
    """Give a servo that is somewhere else now, with what it answers there."""
    identity = yield from identify_at(target.model.family, id, baud)
    return replace(target, id=id, baud=baud, answers=identity.answers)


def _way_back(plan: Adoption, port: str, kept_in: Path) -> str:
    """Say what was there before, and the commands that bring it back."""
    old, model = plan.target, plan.target.model.key()
    steps = [f"`servobus restore {port} {old.id} {kept_in} --model {model} --baud all`"]
    if plan.id != old.id:
        steps.insert(0, f"`servobus set-id {port} {plan.id} {old.id} --model {model} --baud all`")
    if plan.baud != old.baud:
        steps.append(f"`servobus set-baud {port} {old.id} {old.baud} --model {model} --baud all`")
    return (
        f"the new servo was id {old.id} at {old.baud} baud before; `servobus robot adopt` again goes on from here, "
        f"{', then '.join(steps)} bring back what was there before"
    )
