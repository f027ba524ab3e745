"""Changing what a servo answers to: id, speed and factory settings, as transactions.

If an answer is lost on the way, it is unknown whether the servo took the change. So it is looked for at both ends:
where it should be now, then where it was. Nothing is told twice before it is known that the first time did not count.
"""

from collections.abc import Callable

from servobus.core.exchange import Procedure, SetBaud
from servobus.core.ids import check_id
from servobus.core.registers import Area, Register
from servobus.core.values import frozen, replace
from servobus.errors import BusError, NoReply, Refused, UsageError
from servobus.families.base import Answers, Family, KnownServo, Model

ROUNDS = 3
"""Times that both ends are asked before a servo counts as lost."""


@frozen
class BusAddress:
    """Where a servo can be reached."""

    id: int
    baud: int

    def __str__(self) -> str:
        return f"id {self.id} at {self.baud} baud"


def change_id(target: KnownServo, id: int) -> Procedure[None]:
    """Give a servo another id, for good.

    Raises UsageError if some servo has it already, BusError if the servo stays what it was, NoReply if it is found
    under neither id.
    """
    family = target.model.family
    old, new = BusAddress(check_id(target.id), target.baud), BusAddress(check_id(id), target.baud)
    if new == old:
        return
    if (yield from _taken(family, new, old)):
        raise UsageError(f"id {id} is not free: a servo answers to it")
    yield from _change(target, old, new, lambda end: family.set_id(target, end.id))


def change_baud(target: KnownServo, new_baud: int) -> Procedure[None]:
    """Set a servo to another speed, for good; the bus follows it.

    Raises UsageError if another servo with its id is there already, for nothing could tell the two apart; BusError if
    the servo stays at the old speed, NoReply if it is found at neither.
    """
    family = target.model.family
    old, new = BusAddress(check_id(target.id), target.baud), BusAddress(target.id, new_baud)
    if new != old and (yield from _taken(family, new, old)):
        raise UsageError(
            f"another servo answers to id {target.id} at {new_baud} baud: give one of them another id first"
        )
    yield from _change(target, old, new, lambda end: family.set_baud(target, end.baud))


def reset(target: KnownServo, keep: frozenset[str]) -> Procedure[BusAddress]:
    """Restore factory settings; gives where the servo is then.

    Raises UsageError if another servo has the factory id, for nothing but unplugging one would tell the two apart;
    BusError if the servo stays as it was, NoReply if it is found neither there nor where it should be.
    """
    family = target.model.family
    factory = target.model.register("id").default
    id = target.id if "id" in keep or factory is None else factory
    old = BusAddress(check_id(target.id), target.baud)
    new = BusAddress(id, target.baud if "baud" in keep else target.model.factory_baud)
    if new != old and (yield from _taken(family, new, old)):
        raise UsageError(
            f"{target} would get {new}, and another servo answers to that already: "
            "give that one another id first, or connect this one alone"
        )

    first = True

    def attempt(_: BusAddress) -> Procedure[None]:
        """Reset; where neither id nor speed tell whether it happened, the settings must."""
        nonlocal first
        servo = target
        if not first:  # it may have factory settings by now, and answer by them
            servo = replace(target, answers=(yield from family.identify(target.id)).answers)
        first = False
        if new != old or servo.answers is Answers.NOTHING:
            yield from family.reset(servo, keep)
            return
        rows = _resettable(target.model)
        before = yield from family.read_stored(servo, rows)
        yield from family.reset(servo, keep)
        after = yield from family.read_stored(servo, rows)
        if before == after and any(raw != row.default for row, raw in zip(rows, before, strict=True)):
            raise BusError(f"{target} still has its settings: it did not take the reset")

    yield from _change(target, old, new, attempt, back=False)
    return new


def _resettable(model: type[Model]) -> list[Register[int]]:
    """List the settings whose factory value is known and that is not to be kept."""
    kept = (model.register("id"), model.optional("baud"), model.optional("calibration"))
    return [
        row
        for row in model.registers.values()
        if row.area is Area.EEPROM and row.writable and row.default is not None and row not in kept
    ]


def _change(
    target: KnownServo,
    old: BusAddress,
    new: BusAddress,
    attempt: Callable[[BusAddress], Procedure[None]],
    *,
    back: bool = True,
) -> Procedure[None]:
    """Try to bring a servo from one end to the other, a second time if it is found where it was.

    If it stays there for good and `back` is true, it is told to: a HerkuleX keeps what is told in EEP, and would go to
    the new end with its next start.
    """
    problem: BusError | None = None
    for _ in range(2):
        problem = None
        try:
            yield from attempt(new)
        except BusError as error:
            problem = error
        end = yield from _locate(target.model.family, new, old)
        if end is None:
            yield SetBaud(old.baud)
            raise NoReply(
                f"{target} was told to go to {new} and answers neither there nor at {old}: is it powered and connected?"
            ) from problem
        if end == new and (new != old or problem is None):
            return
    if new == old and problem is not None:
        raise problem
    message = f"{target} is still at {old}: it was told twice to go to {new}"
    if back:
        try:
            yield from attempt(old)
        except BusError:
            message += ", and may be there after its next start"
    if isinstance(problem, Refused):
        raise problem
    raise BusError(message) from problem


def _locate(family: Family, new: BusAddress, old: BusAddress) -> Procedure[BusAddress | None]:
    """Find the end at which a servo answers clearly, the new one first; the bus is at its speed then."""
    for _ in range(ROUNDS):
        for end in (new, old):
            if (yield from _reach(family, end)) is None:
                return end
    return None


def _taken(family: Family, end: BusAddress, back: BusAddress) -> Procedure[bool]:
    """Tell whether any servo answers at an end, however badly; the bus is where it was then."""
    error = yield from _reach(family, end)
    yield SetBaud(back.baud)
    return not isinstance(error, NoReply)


def _reach(family: Family, end: BusAddress) -> Procedure[BusError | None]:
    """Ask at an end whether a servo is there; give what went wrong."""
    yield SetBaud(end.baud)
    try:
        yield from family.ping(end.id)
    except BusError as error:
        return error
    return None
