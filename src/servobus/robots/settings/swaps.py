"""Servos of one model that have changed places, told by the settings that they keep. Nothing is written here.

Two servos of one model say the same when they are asked who they are. But where the file asks for different settings of
two joints, and `apply_settings` has written them, each servo holds those of its own joint. Servos that hold each
other's settings have changed ids, or cables. So have three of which each holds those of the next.
"""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from servobus.core.exchange import Procedure, SetBaud
from servobus.core.registers import Area, Register
from servobus.core.values import replace
from servobus.errors import BusError, ServobusError, UsageError
from servobus.robots.joints.attendance import Attendance, Finding
from servobus.robots.joints.joint import Joint, Part
from servobus.robots.settings.planning import wanted
from servobus.robots.steps import RobotJob, each

Place: TypeAlias = tuple[Joint, int]
"""One servo of a joint, by its number."""
Raws: TypeAlias = Mapping[Register[object], int]


def added(found: Attendance, joints: Sequence[Joint]) -> RobotJob[Attendance]:
    """Give what was found, and the servos among the usable ones that hold the settings of each other."""
    unusable = found.unusable(joints)
    kept = {
        (joint, n): raws
        for joint in joints
        if joint.name not in unusable
        for n in range(len(joint.parts))
        if (raws := _kept(joint, n))
    }
    asked: dict[str, dict[Place, list[Register[object]]]] = {}
    for place, raws in kept.items():
        if rows := _telling(place, raws, kept):
            asked.setdefault(_part(place).port, {})[place] = rows
    outcomes = yield from each({port: _read(rows) for port, rows in asked.items()})
    held: dict[Place, Raws] = {}
    for outcome in outcomes.values():
        if not isinstance(outcome, ServobusError):
            held |= outcome
    return replace(found, findings=(*found.findings, *_findings(held, kept)))


def _part(place: Place) -> Part:
    joint, n = place
    return joint.parts[n]


def _kept(joint: Joint, n: int) -> Raws:
    """Give what the file asks the servo to keep: register -> raw value."""
    try:
        asked = wanted(joint.entry, joint.entry.servos[n])
    except UsageError:  # limits that the servo cannot have: `plan_settings` says so
        return {}
    return {row: raw for row, raw in asked.items() if row.area is Area.EEPROM}


def _telling(place: Place, raws: Raws, kept: Mapping[Place, Raws]) -> list[Register[object]]:
    """List the registers to read: all that are asked of servos of the same model, if some are to differ."""
    model = _part(place).servo.model
    others = [those for other, those in kept.items() if other != place and _part(other).servo.model is model]
    if not any(_differ(raws, those) for those in others):
        return []
    return list(dict.fromkeys(row for those in (raws, *others) for row in those))


def _differ(one: Raws, other: Raws) -> bool:
    return any(row in other and not row.took(raw, other[row]) for row, raw in one.items())


def _read(places: Mapping[Place, list[Register[object]]]) -> Procedure[dict[Place, Raws]]:
    held: dict[Place, Raws] = {}
    for place, rows in places.items():
        target = _part(place).servo.target
        yield SetBaud(target.baud)
        try:
            raws = yield from target.model.family.read_stored(target, rows)
        except (BusError, UsageError):
            continue  # what cannot be read tells nothing
        held[place] = dict(zip(rows, raws, strict=True))
    return held


def _findings(held: Mapping[Place, Raws], kept: Mapping[Place, Raws]) -> list[Finding]:
    wrong = [place for place, raws in held.items() if _differ(kept[place], raws)]
    taken = {
        place: other
        for place in wrong
        for other in wrong
        if _part(other).servo.model is _part(place).servo.model
        and _differ(kept[place], kept[other])
        and not _differ(kept[other], held[place])
    }
    findings = []
    for (joint, n), other in taken.items():
        if other not in taken:
            continue  # the other servo is not where this one should be
        part, its = joint.parts[n], _part(other)
        names = ", ".join(row.name for row, raw in kept[joint, n].items() if not row.took(raw, held[joint, n][row]))
        text = (
            f"{joint.name}: id {part.servo.id} on port {part.port} holds the settings of {other[0].name} (id "
            f"{its.servo.id} on port {its.port}: {names}), so both may be swapped: exchange their ids or their cables; "
            "or write the settings, if they were exchanged in the file: `servobus robot apply`"
        )
        findings.append(Finding("swapped", joint.name, part.port, text, n))
    return findings
