"""Changes of registers, with care for what they wear, for what they contradict, and for what they move.

write          by the rules of moves, and torque comes on as with `Family.torque`
set_registers  with care for EEPROM, limits and record, where a verb has seen to the motion already
Family.put     as told, without any care
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from servobus.core.exchange import Procedure
from servobus.core.registers import Motion, Register
from servobus.errors import BadValue, ServobusError, UsageError
from servobus.families.model import LimitPair, Model
from servobus.families.motion import begin_motion, movement
from servobus.families.target import Answers, KnownServo, ServoRef


def write(target: KnownServo, values: Mapping[Register[Any], int], *, keep: bool) -> Procedure[None]:
    """Write raw values by the rules of moves: with `keep` for good, else for now. See `Family.write`."""
    if keep:
        _check_kept(target, values)
    family, torque = target.model.family, target.model.register("torque_enable")
    waking = torque in values and family.torque_on(values[torque])
    others = {row: raw for row, raw in values.items() if row is not torque or not (waking or raw == 0)}
    if torque in values and values[torque] == 0:
        yield from family.let_go(target)
    if others:
        if (yield from movement(target, others)) is not None:
            begin_motion(target)
        if target.model.register("goal_position") in others:  # what a move has set for itself is not for this goal
            others = target.record.lent | others
        yield from set_registers(target, others, keep=keep)
    if waking:
        yield from family.torque(target, on=True)


def _check_kept(target: KnownServo, values: Mapping[Register[Any], int]) -> None:
    """Raise UsageError if one of these registers has no place where its value survives power-off."""
    for register in values:
        if not target.model.family.wears(register, keep=True):
            raise UsageError(f"{register.model} {register.name} lives in RAM and is not saved: it is lost at power-off")


def set_registers(target: KnownServo, values: Mapping[Register[Any], int], *, keep: bool = False) -> Procedure[None]:
    """Write raw values with care for EEPROM and record, and without asking what they move: for verbs that see to that.

    Every write of registers but `Family.put` and what stops a servo comes through here.
    """
    family, record = target.model.family, target.record
    yield from _check_not_crossed(target, values, keep=keep)
    worn = [register for register in values if family.wears(register, keep=keep)]
    before: dict[Register[Any], int] = {}
    if worn and target.answers is not Answers.NOTHING:  # what cannot be read cannot be compared
        before = dict(zip(worn, (yield from family.read_stored(target, worn)), strict=True))
    same = frozenset(row for row, raw in before.items() if raw == values[row] and family.stored_is_told(row))
    fresh = [register for register in worn if register not in same]
    if fresh:
        record.check_wear(str(target), fresh)
        yield from family.check_unlocked(target, fresh)
    in_ram = {register: raw for register, raw in values.items() if not register.volatile and register.acts_in_ram}
    record.forget(in_ram)  # until it is known that they arrived
    for register in values:
        record.lent.pop(register, None)
        if register.motion is Motion.GOAL:
            record.goal = None
        record.modes += register.motion in (Motion.LIMIT, Motion.MODE)
    try:
        with before_told({row: before[row] for row in fresh if row in before}):
            for part in _policy_last(target.model, values):
                yield from family.put(target, part, keep=keep, same=same)
    except ServobusError:
        record.wrote(fresh)  # they may have arrived
        raise
    record.wrote(fresh)
    record.set(in_ram)
    torque = target.model.register("torque_enable")
    if torque in values and family.torque_on(values[torque]):
        record.restarted = False


def policy_register(model: type[Model]) -> Register[Any] | None:
    """Give the register that says which requests a servo answers; None for a model that has none."""
    return model.optional("answer_level")


def _policy_last(model: type[Model], values: Mapping[Register[Any], int]) -> list[Mapping[Register[Any], int]]:
    """Part what is to be written: which requests are answered comes last, since what follows would go by it."""
    policy = policy_register(model)
    if policy is None or policy not in values or len(values) == 1:
        return [values]
    return [{register: raw for register, raw in values.items() if register is not policy}, {policy: values[policy]}]


# Limits that contradict each other


def _check_not_crossed(target: ServoRef, values: Mapping[Register[Any], int], *, keep: bool) -> Procedure[None]:
    """Refuse limits that would cross those beside which they are written, or which the servo has. Raises BadValue.

    What a servo that answers nothing has cannot be known, and is not compared.
    """
    family, pairs = target.model.family, pairs_touched(target.model, values)
    others = [row for pair in pairs for row in pair.rows(target.model) if row not in values]
    if others and target.answers is not Answers.NOTHING:
        have = yield from (family.read_stored if keep else family.read)(target, others)
        values = {**values, **dict(zip(others, have, strict=True))}
    check_pairs(target.model, values, str(target))


def pairs_touched(model: type[Model], rows: Mapping[Register[Any], int]) -> list[LimitPair]:
    """List the pairs of limits of which one at least is among these rows."""
    return [pair for pair in model.limit_pairs if any(row in rows for row in pair.rows(model))]


def check_pairs(model: type[Model], values: Mapping[Register[Any], int], who: str) -> None:
    """Refuse limits of which the lower is not below the upper. Raises BadValue.

    Pairs of which one limit is not among the values are left out.
    """
    for pair in pairs_touched(model, values):
        low, high = pair.rows(model)
        if low in values and high in values and not pair.fits(values[low], values[high]):
            raise BadValue(
                f"{who}: {said(low, values[low])} is not below {said(high, values[high])}; "
                "the lower limit must be below the upper one, and nothing was written"
            )


# What was there before


def said(row: Register[Any], raw: int) -> str:
    """Write a register with a value for people: "max_torque = 50.0 %"."""
    return f"{row.name} = {row.said(raw)}"


def value(row: Register[Any], raw: int) -> Any:
    """Give the value of a raw integer, or that integer where it has no meaning."""
    try:
        return row.decode(raw)
    except ServobusError:
        return raw


@contextmanager
def before_told(before: Mapping[Register[Any], int]) -> Iterator[None]:
    """Have an error that breaks off what is written inside tell what was there before."""
    try:
        yield
    except ServobusError as error:
        if before:
            values = ", ".join(said(row, raw) for row, raw in before.items())
            found = {row.name: value(row, raw) for row, raw in before.items()}
            error.tell_before(found, f"what was there before: {values}")
        raise
