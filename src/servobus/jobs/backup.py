"""Backing up and restoring the settings of a servo: what survives power-off, in a file that people can read."""

import re
from collections.abc import Mapping
from typing import Any

from servobus.core.exchange import Procedure
from servobus.core.registers import Area, Register
from servobus.core.values import frozen
from servobus.errors import NotRestored, Refused, UsageError
from servobus.families import registry
from servobus.families.base import Answers, KnownServo, Model, ServoRef, policy_register, require_model
from servobus.families.change import said
from servobus.jobs.make_safe import let_go


@frozen
class Backup:
    """All settings of a servo that survive power-off, raw, with what they belong to."""

    model: type[Model]
    firmware: str
    id: int
    baud: int
    values: dict[str, int]

    def text(self) -> str:
        """Write it as a TOML file that people can read: raw values, each with its meaning beside it."""
        lines = [
            "# Settings of a servo, written by `servobus backup`.",
            f'model = "{self.model.key()}"',
            f'firmware = "{self.firmware}"',
            f"id = {self.id}",
            f"baud = {self.baud}",
            f"count = {len(self.values)}",
            "",
            "[settings]  # raw values",
        ]
        for name, raw in self.values.items():
            row = self.model.registers[name]
            beyond = "" if row.accepts(raw) else f", not {row.range_text()}"
            lines.append(f"{f'{name} = {raw}':<42} # {row.said(raw)}{beyond}: {row.meaning}")
        return "\n".join(lines) + "\n"

    @classmethod
    def parse(cls, text: str) -> "Backup":
        """Read a backup file. Raises UsageError for anything that is not one, with the line and the key.

        A value that the register does not take is no damage: a servo may have been found with it. A file that was cut
        off behind a whole line is told by its `count`, which those of older versions lack.
        """
        import tomllib  # noqa: PLC0415 - slow to import, and only needed to restore

        if not text.strip():
            raise UsageError("the file is empty: it holds no backup")
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise UsageError(f"this is not a backup file, or it is damaged: {_with_line(text, str(error))}") from None
        for name, kind in _HEAD.items():
            if name not in data:
                raise UsageError(f"this is not a backup file, or it is damaged: it has no {name}")
            if type(data[name]) is not kind:
                said_of = f"{name}{_where(text, name)} is {data[name]!r}"
                raise UsageError(f"the backup is damaged: {said_of}, and it should be {_KINDS[kind]}")
        try:
            model = registry.model(data["model"])
        except UsageError as error:
            raise UsageError(f"model{_where(text, 'model')}: {error}") from None
        values: dict[str, int] = {}
        for name, raw in data["settings"].items():
            row = _checked(text, model, name, raw)
            if row.name in values:
                raise UsageError(f"the backup is damaged: {row.name} stands in it twice, once as an alias")
            values[row.name] = raw
        *before, last = text.splitlines()
        if not text.endswith("\n") and "=" in last and "#" not in last:  # its value may be cut: 3 of 36
            raise UsageError(
                f"the backup is damaged: it ends within line {len(before) + 1} ({last.strip():.60}): take a whole "
                "copy, or end that line"
            )
        have = len(values)
        if (count := data.get("count", have)) != have:
            raise UsageError(
                f"the backup is damaged: count{_where(text, 'count')} says {count} settings, and {have} are here; take"
                "  a whole copy, or correct count if lines were taken out on purpose"
            )
        return cls(model, data["firmware"], data["id"], data["baud"], values)


_HEAD = {"model": str, "firmware": str, "id": int, "baud": int, "settings": dict}
_KINDS = {str: "a text", int: "a whole number", dict: "a table"}


def _checked(text: str, model: type[Model], name: str, raw: object) -> Register[Any]:
    """Give the register of a line of the file. Raises UsageError if it can be none that was saved."""
    where = _where(text, name)
    try:
        row = model.register(name)
    except UsageError as error:
        raise UsageError(f"the backup is damaged{where}: {error}") from None
    if row not in settings(model):
        raise UsageError(f"the backup is damaged: {name}{where} is no setting that survives power-off")
    if type(raw) is not int:  # 511.9 would be cut to 511, true taken for 1
        raise UsageError(f"the backup is damaged: {name}{where} is {raw!r}, and a raw value is a whole number")
    bits = 8 * row.layout.size
    if not -(1 << bits - 1) <= raw < 1 << bits:
        raise UsageError(f"the backup is damaged: {name}{where} is {raw}, which {row.layout.size} bytes cannot hold")
    return row


def _where(text: str, name: str) -> str:
    """Say in which line of the file a key stands; "" if that cannot be told."""
    lines = text.splitlines()
    line = next((n for n, line in enumerate(lines, 1) if line.partition("=")[0].strip(" \"'") == name), None)
    return f" in line {line}" if line is not None else ""


def _with_line(text: str, problem: str) -> str:
    """Put the number and the text of a line before what is wrong with it."""
    lines = text.splitlines()
    found = re.search(r" \(at line (\d+), column \d+\)$", problem)
    number = min(int(found[1]), len(lines)) if found else len(lines)
    what = problem[: found.start()] if found else problem.removesuffix(" (at end of document)")
    return f"line {number} ({lines[number - 1].strip():.60}): {what}"


def _same_settings(one: type[Model], other: type[Model]) -> bool:
    """Tell whether settings of one model mean the same on the other: LX servos cannot say which model they are."""
    unknown = one.family is other.family and (one.generic or other.generic)
    return one is other or (unknown and not one.unscaled() and not other.unscaled())


def settings(model: type[Model]) -> list[Register[Any]]:
    """List what a backup holds: every register that can be written and survives power-off."""
    return [row for row in model.registers.values() if row.area is Area.EEPROM and row.writable]


def identity_names(model: type[Model]) -> set[str]:
    """Name the registers that say which servo it is rather than how it behaves."""
    return {row.name for row in (model.register("id"), model.optional("baud")) if row is not None}


def backup(target: ServoRef, firmware: str, baud: int) -> Procedure[Backup]:
    """Read all settings that survive power-off."""
    rows = settings(target.model)
    values = yield from target.model.family.read_stored(target, rows)
    return Backup(
        target.model,
        firmware,
        target.id,
        baud,
        {row.name: raw for row, raw in zip(rows, values, strict=True)},
    )


@frozen
class Comparison:
    """What restoring a backup would do to a servo."""

    present: dict[Register[Any], int]
    """What the servo has, of all that the backup sets."""
    changes: dict[Register[Any], int]
    """What differs and can be written."""
    impossible: dict[Register[Any], str]
    """What differs and cannot be written -> why."""
    driven: bool
    """Whether its torque is on."""
    returns: bool
    """Whether an alarm keeps the torque off that comes back by itself when that is over."""


def compare(target: ServoRef, saved: Backup) -> Procedure[Comparison]:
    """Compare a servo with a backup. Raises UsageError for a backup of another model, or an unknown one."""
    model, family = target.model, target.model.family
    require_model(target, "be restored")
    if not _same_settings(saved.model, model):
        raise UsageError(
            f"the backup belongs to model {saved.model.title}, {target} is another model; nothing was written"
        )
    skip = identity_names(model)
    rows = [row for row in settings(model) if row.name in saved.values and row.name not in skip]
    present = dict(zip(rows, (yield from family.read_stored(target, rows)), strict=True))
    wanted = {row: saved.values[row.name] for row in rows}
    changes = {row: raw for row, raw in wanted.items() if raw != present[row]}
    impossible = {row: f"that is not {row.range_text()}" for row, raw in changes.items() if not row.accepts(raw)}
    possible = {row: raw for row, raw in changes.items() if row not in impossible}
    for pair in model.limit_pairs:
        low, high = pair.rows(model)
        ends = present | possible
        if low in ends and high in ends and not pair.fits(ends[low], ends[high]):
            why = f"{said(low, ends[low])} would not be below {said(high, ends[high])}"
            impossible.update({row: why for row in (low, high) if possible.pop(row, None) is not None})
    torque = model.register("torque_enable")
    driven = family.torque_on((yield from family.read(target, [torque]))[0])
    alarms = (yield from family.read_alarms(target)) if family.torque_returns and not driven else 0
    return Comparison(present, possible, impossible, driven, alarms != 0)


def restore(target: KnownServo, saved: Backup, *, torque_off: bool = False) -> Procedure[list[str]]:
    """Write the settings that differ from the backup; id and speed stay as they are. Gives their names.

    Settings can move a servo that holds: limits, offset, gains. So its torque must be off; `torque_off` switches it off
    first, if there is anything to write; one that an alarm keeps off, and that would come back by itself, goes off
    for good. What the servo cannot have, or does not take, is left out, and NotRestored
    names it when all the rest is written. Which requests the servo answers is set last.
    """
    found = yield from compare(target, saved)
    if found.changes and found.driven and not torque_off:
        raise UsageError(
            f"{target}: its torque is on, and the settings of a backup can move it; switch it off first, or have it "
            "switched off with torque_off=True; nothing was written"
        )
    if found.changes and (found.driven or found.returns):
        yield from let_go(target)
    policy = policy_register(target.model)
    last = {row: raw for row, raw in found.changes.items() if row is policy}
    first = {row: raw for row, raw in found.changes.items() if row is not policy}
    wrong = yield from _store(target, first)
    if wrong:  # of several that were written with one packet the servo may have refused all for one
        wrong = {}
        for group in _apart(target.model, first):
            wrong |= yield from _store(target, group)
    wrong |= yield from _changed_beside(target, found, {**first, **found.impossible, **last})
    wrong |= yield from _store(target, last)
    failed = {row: f"{said(row, saved.values[row.name])} ({why})" for row, why in (found.impossible | wrong).items()}
    restored = [row.name for row in found.present if row in found.changes and row not in failed]
    if failed:
        done = f"restored {', '.join(restored)}" if restored else "nothing was restored"
        raise NotRestored(
            f"{target}: {done}; not restored: {', '.join(failed.values())}",
            restored,
            {row.name: why for row, why in failed.items()},
        )
    return restored


def _store(target: KnownServo, changes: Mapping[Register[Any], int]) -> Procedure[dict[Register[Any], str]]:
    """Write for good, and read back: gives what the servo did not take -> why."""
    family, policy = target.model.family, policy_register(target.model)
    if not changes:
        return {}
    refusal = ""
    try:
        yield from family.store(target, changes)
    except Refused as error:
        refusal = str(error)
    if policy is not None and changes.get(policy) == Answers.NOTHING:
        return {}  # it cannot be read back any more
    after = yield from family.read_stored(target, list(changes))
    return {
        row: refusal or f"the servo did not take it: it is {row.said(raw)}"
        for row, raw in zip(changes, after, strict=True)
        if not row.took(changes[row], raw)
    }


def _apart(model: type[Model], changes: Mapping[Register[Any], int]) -> list[dict[Register[Any], int]]:
    """Part changes into those that can be written alone; limits that belong together stay so."""
    left = dict(changes)
    pairs = [{row: left.pop(row) for row in pair.rows(model) if row in left} for pair in model.limit_pairs]
    return [group for group in pairs if group] + [{row: raw} for row, raw in left.items()]


def _changed_beside(
    target: ServoRef, found: Comparison, meant: Mapping[Register[Any], Any]
) -> Procedure[dict[Register[Any], str]]:
    """Find settings that were not to change and did: an LX-16A gets both limits with one command, and may cut one."""
    rows = [row for row in found.present if row not in meant]
    if not found.changes:
        return {}
    after = yield from target.model.family.read_stored(target, rows)
    return {
        row: f"the servo changed it to {row.said(raw)} with what was written beside it"
        for row, raw in zip(rows, after, strict=True)
        if raw != found.present[row]
    }
