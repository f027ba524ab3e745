"""Stopping servos, and making them safe: hold them, free them or brake them.

Several are gone through twice. First each is dealt with in the careful way, so that one which does not answer keeps the
others waiting for its time-outs only. Then those with which that failed have a second turn, in which the torque is
switched off where nothing else works.
"""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import TypeAlias

from servobus.core.exchange import Procedure, SetBaud
from servobus.errors import BusError
from servobus.families.base import KnownServo, StopOutcome
from servobus.families.record import SafeAction

FREED = StopOutcome("let go, its torque is off", let_go=True)
BRAKED = StopOutcome("braked", let_go=True)
STOPPED_BEFORE = StopOutcome("it was stopped before")

Outcomes: TypeAlias = Mapping[KnownServo, StopOutcome | BusError]
"""What became of each servo that was to be stopped."""


def stop(target: KnownServo) -> Procedure[StopOutcome]:
    """Stop one servo, and take note of it; see `Family.stop`."""
    return _noted(target, (yield from target.model.family.stop(target)))


def stop_all(targets: Iterable[KnownServo]) -> Procedure[Outcomes]:
    """Stop servos at any speeds, each of them though another fails. Raises nothing for one that may still move."""
    outcomes: dict[KnownServo, StopOutcome | BusError] = {}
    for target in targets:
        yield SetBaud(target.baud)
        try:
            outcomes[target] = _noted(target, (yield from target.model.family.hold(target)))
        except (BusError, ValueError) as error:
            outcomes[target] = error if isinstance(error, BusError) else BusError(str(error))
    for target in [target for target, outcome in outcomes.items() if isinstance(outcome, BusError)]:
        yield SetBaud(target.baud)
        try:
            outcomes[target] = yield from stop(target)
        except BusError as error:
            outcomes[target] = error
    for target, outcome in outcomes.items():  # when all have stopped, for it delays none then
        if isinstance(outcome, StopOutcome) and not outcome.let_go:
            yield from give_back(target)
    return outcomes


def let_go(target: KnownServo) -> Procedure[None]:
    """Switch the torque of a servo off, and take note that nothing drives it; see `Family.let_go`."""
    yield from target.model.family.let_go(target)
    target.permit.mark_idle()


def give_back(target: KnownServo) -> Procedure[None]:
    """Set the speed of moves again that stood in a servo before a move; where that fails the next write does it."""
    if target.record.lent:
        yield SetBaud(target.baud)
        with suppress(BusError):
            yield from target.model.family.give_back(target)


def make_safe(target: KnownServo, action: SafeAction) -> Procedure[StopOutcome]:
    """Hold a servo where it is, free it or brake it. Raises BusError, or UsageError for one that answers no reads."""
    family = target.model.family
    if action == "free":
        yield from family.let_go(target)
        outcome = FREED
    elif action == "brake":
        yield from family.brake(target)
        outcome = BRAKED
    else:
        outcome = STOPPED_BEFORE if target.permit.stopped else (yield from family.hold(target))
    target.permit.mark_idle()
    return outcome


def make_safe_anyhow(target: KnownServo, action: SafeAction) -> Procedure[StopOutcome]:
    """Make a servo safe with which the careful way has failed: once more, else its torque is switched off."""
    family = target.model.family
    if action == "hold":
        outcome = yield from family.stop(target)
    else:
        yield from family.let_go(target)
        outcome = FREED
    target.permit.mark_idle()
    return outcome


def _noted(target: KnownServo, outcome: StopOutcome) -> StopOutcome:
    if outcome.let_go:
        target.permit.mark_idle()
    else:
        target.permit.stopped = True
    return outcome
