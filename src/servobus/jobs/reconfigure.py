"""Changing what a servo answers to: id, speed and factory settings, as transactions.

If an answer is lost on the way, it is unknown whether the servo took the change. So it is looked for at both ends:
where it should be now, then where it was. Nothing is told twice before it is known that the first time did not count.
What was there before is known before anything is sent, and an error tells it.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from servobus.core.exchange import Now, Pause, Procedure, SetBaud
from servobus.core.ids import check_id
from servobus.core.registers import Register
from servobus.core.values import frozen, replace
from servobus.errors import BadValue, BusError, NoReply, Refused, ServobusError, UsageError
from servobus.families.base import ASK_AGAIN, Answers, Family, KnownServo, Model
from servobus.families.change import value
from servobus.jobs.backup import settings

ROUNDS = 3
"""Times at least that both ends are asked before a servo counts as lost."""


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
    with telling_before(
        {"id": old.id}, f"it had id {old.id} before; if it answers to {id} now, change_id({old.id}) undoes that"
    ):
        yield from _change(target, old, new, lambda end: family.set_id(target, end.id))


def listed_baud(target: KnownServo, baud: int) -> int:
    """Give the speed of `Model.bauds` that a servo has when it is set to this one: 57142 baud is 57600 baud.

    Scans look for servos at those speeds, so at no other is a servo left. Raises BadValue if none of them is meant,
    with the nearest ones.
    """
    model = target.model
    row = model.optional("baud")
    if row is None or baud in model.bauds:
        return baud
    for listed in model.bauds:
        if is_one_speed(model, baud, listed):
            return listed
    below = [listed for listed in model.bauds if listed < baud]
    above = [listed for listed in model.bauds if listed > baud]
    near = " or ".join(f"{speed}" for speed in [*sorted(below)[-1:], *sorted(above)[:1]])
    speeds = ", ".join(map(str, sorted(model.bauds)))
    raise BadValue(
        f"{target} is not set to {baud} baud: no scan would find it there, and it can be set to {speeds} baud; "
        f"the nearest is {near}"
    )


def is_one_speed(model: type[Model], one: int, other: int) -> bool:
    """Tell whether two speeds are one to a servo: it has one code for both."""
    row = model.optional("baud")
    return one == other or (row is not None and _code(row, one) is not None and _code(row, one) == _code(row, other))


def _code(row: Register[Any], baud: int) -> int | None:
    """Give the raw value for a speed; None if the servo cannot have it."""
    try:
        return row.encode(baud)
    except BadValue:
        return None


def change_baud(target: KnownServo, baud: int) -> Procedure[int]:
    """Set a servo to another speed of its model, for good; the bus follows it. Gives that speed, see `listed_baud`.

    One that has it already is left as it is. Raises BadValue for a speed that scans do not try, UsageError if another
    servo with its id is there already, for nothing could tell the two apart; BusError if the servo stays at the old
    speed, NoReply if it is found at neither.
    """
    family, row = target.model.family, target.model.optional("baud")
    new_baud = listed_baud(target, baud)
    old, new = BusAddress(check_id(target.id), target.baud), BusAddress(target.id, new_baud)
    if is_one_speed(target.model, old.baud, new_baud):
        if row is None or target.answers is Answers.NOTHING:
            return new_baud
        if (yield from family.read_stored(target, [row])) == [row.encode(new_baud)]:
            return new_baud  # else a HerkuleX was told another one, for its next start
    elif (yield from _taken(family, new, old)):
        raise UsageError(
            f"another servo answers to id {target.id} at {new_baud} baud: give one of them another id first"
        )
    undo = f"if it answers at {new_baud} baud now, change_baud({old.baud}) undoes that"
    with telling_before({"baud": old.baud}, f"it talked at {old.baud} baud before; {undo}"):
        yield from _change(target, old, new, lambda end: family.set_baud(target, end.baud))
    return new_baud


def reboot(target: KnownServo) -> Procedure[None]:
    """Restart a servo, and ask until it answers again: `Family.patience` s at most.

    Raises UsageError where the family has no such command, NoReply if it does not come back.
    """
    family = target.model.family
    problem: BusError | None = None
    try:
        yield from family.reboot(target)
    except BusError as error:
        problem = error  # it may be on its way all the same
    yield Pause(ASK_AGAIN)
    yield from family.await_answer(target, "its restart")
    if problem is not None:
        raise problem


def reset(target: KnownServo, keep: frozenset[str]) -> Procedure[BusAddress]:
    """Restore factory settings; gives where the servo is then.

    Raises UsageError if another servo has the factory id, for nothing but unplugging one would tell the two apart;
    BusError if the servo stays as it was, NoReply if it is found neither there nor where it should be.
    """
    family = target.model.family
    family.check_reset(target, keep)
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
        yield from family.await_answer(servo, "its reset")
        after = yield from family.read_stored(servo, rows)
        if before == after and any(raw != row.default for row, raw in zip(rows, before, strict=True)):
            raise BusError(f"{target} still has its settings: it did not take the reset")

    yield from _change(target, old, new, attempt, back=False)
    return new


def read_settings(target: KnownServo) -> Procedure[dict[str, Any]]:
    """Read all that a reset loses, register -> value; of a servo that answers nothing, id and speed."""
    if target.answers is Answers.NOTHING:
        return {"id": target.id, "baud": target.baud}
    rows = settings(target.model)
    raws = yield from target.model.family.read_stored(target, rows)
    return {row.name: value(row, raw) for row, raw in zip(rows, raws, strict=True)}


def _resettable(model: type[Model]) -> list[Register[int]]:
    """List the settings whose factory value is known and that is not to be kept."""
    kept = (model.register("id"), model.optional("baud"), model.optional("calibration"))
    return [row for row in settings(model) if row.default is not None and row not in kept]


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
                f"{target} was told to go to {new} and answers neither there nor at {old} within "
                f"{target.model.family.patience:g} s: is it powered and connected?"
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


@contextmanager
def telling_before(before: Mapping[str, Any], text: str) -> Iterator[None]:
    """Have an error that breaks a change off tell what was there before; one that was raised before it does not."""
    try:
        yield
    except UsageError:
        raise
    except ServobusError as error:
        error.tell_before(before, text)
        raise


def _locate(family: Family, new: BusAddress, old: BusAddress) -> Procedure[BusAddress | None]:
    """Find the end at which a servo answers clearly, the new one first; the bus is at its speed then.

    A servo that starts anew, or writes its EEPROM, hears nothing meanwhile: both ends are asked again for
    `Family.patience` s.
    """
    began: float = yield Now()
    rounds = 0
    while rounds < ROUNDS or (yield Now()) - began < family.patience:
        for end in dict.fromkeys((new, old)):
            if (yield from _reach(family, end)) is None:
                return end
        rounds += 1
        yield Pause(ASK_AGAIN)
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
