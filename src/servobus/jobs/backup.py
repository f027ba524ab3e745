"""Backing up and restoring the settings of a servo: what survives power-off, in a file that people can read."""

from collections.abc import Mapping
from typing import Any

from servobus.core.exchange import Procedure
from servobus.core.registers import Area, Register
from servobus.core.values import frozen
from servobus.errors import BusError, UsageError
from servobus.families import registry
from servobus.families.base import Answers, KnownServo, Model, ServoRef, policy_register, require_model


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
            "",
            "[settings]  # raw values",
        ]
        for name, raw in self.values.items():
            row = self.model.registers[name]
            lines.append(f"{f'{name} = {raw}':<42} # {row.said(raw)}: {row.meaning}")
        return "\n".join(lines) + "\n"

    @classmethod
    def parse(cls, text: str) -> "Backup":
        """Read a backup file. Raises UsageError for anything that is not one."""
        import tomllib  # noqa: PLC0415 - slow to import, and only needed to restore

        try:
            data = tomllib.loads(text)
            model = registry.model(data["model"])
            settings = dict(data["settings"])
            firmware, id, baud = str(data["firmware"]), data["id"], data["baud"]
        except (tomllib.TOMLDecodeError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise UsageError(f"this is not a backup file: {error}") from None
        values: dict[str, int] = {}
        for name, raw in {"id": id, "baud": baud}.items():
            _check_whole(text, name, raw)
        for name, raw in settings.items():
            register = model.register(name)
            _check_whole(text, name, raw)
            if not register.accepts(raw):
                raise UsageError(f"the backup is damaged: {register.name} = {raw} is not {register.range_text()}")
            if register.name in values:
                raise UsageError(f"the backup is damaged: {register.name} stands in it twice, once as an alias")
            values[register.name] = raw
        return cls(model, firmware, id, baud, values)


def _check_whole(text: str, name: str, raw: object) -> None:
    """Refuse what only looks like a raw value: 511.9 would be cut to 511, true taken for 1."""
    if type(raw) is int:
        return
    lines = text.splitlines()
    line = next((n for n, line in enumerate(lines, 1) if line.partition("=")[0].strip(" \"'") == name), None)
    where = f" in line {line}" if line is not None else ""
    raise UsageError(f"the backup is damaged: {name}{where} is {raw!r}, and a raw value is a whole number")


def _same_settings(one: type[Model], other: type[Model]) -> bool:
    """Tell whether settings of one model mean the same on the other: LX servos cannot say which model they are."""
    unknown = one.family is other.family and (one.generic or other.generic)
    return one is other or (unknown and not one.unscaled() and not other.unscaled())


def _settings(model: type[Model]) -> list[Register[Any]]:
    """List what a backup holds: every register that can be written and survives power-off."""
    return [row for row in model.registers.values() if row.area is Area.EEPROM and row.writable]


def identity_names(model: type[Model]) -> set[str]:
    """Name the registers that say who a servo is rather than how it behaves."""
    return {row.name for row in (model.register("id"), model.optional("baud")) if row is not None}


def backup(target: ServoRef, firmware: str, baud: int) -> Procedure[Backup]:
    """Read all settings that survive power-off."""
    rows = _settings(target.model)
    values = yield from target.model.family.read_stored(target, rows)
    return Backup(
        target.model,
        firmware,
        target.id,
        baud,
        {row.name: raw for row, raw in zip(rows, values, strict=True)},
    )


def restore(target: KnownServo, saved: Backup) -> Procedure[list[str]]:
    """Write the settings that differ from the backup; id and speed stay as they are. Gives their names.

    Which requests the servo answers is set last, after all the others were read back.
    """
    require_model(target, "be restored")
    if not _same_settings(saved.model, target.model):
        raise UsageError(
            f"the backup belongs to model {saved.model.title}, {target} is another model; nothing was written"
        )
    skip = identity_names(target.model)
    rows = [row for row in _settings(target.model) if row.name in saved.values and row.name not in skip]
    present = yield from target.model.family.read_stored(target, rows)
    changes = {
        row: saved.values[row.name] for row, raw in zip(rows, present, strict=True) if raw != saved.values[row.name]
    }
    policy = policy_register(target.model)
    last = {policy: changes.pop(policy)} if policy is not None and policy in changes else {}
    yield from _store_and_check(target, changes)
    if policy in last:
        if last[policy] == Answers.NOTHING:
            yield from target.model.family.store(target, last)  # it cannot be read back any more
        else:
            yield from _store_and_check(target, last)
    return [row.name for row in rows if row in changes or row in last]


def _store_and_check(target: KnownServo, changes: Mapping[Register[Any], int]) -> Procedure[None]:
    """Write for good, and read back. Raises BusError for what the servo did not take."""
    yield from target.model.family.store(target, changes)
    after = yield from target.model.family.read_stored(target, list(changes))
    wrong = [row.name for row, raw in zip(changes, after, strict=True) if raw != changes[row]]
    if wrong:
        raise BusError(f"{target} did not take {', '.join(wrong)}")
