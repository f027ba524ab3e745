"""Errors that the verbs of all families raise in the same words."""

from typing import Any

from servobus.core.registers import Register
from servobus.core.units import finite, said
from servobus.errors import BadValue, BusError, Refused, UsageError
from servobus.families.target import ServoRef

TELL_MODEL = "say which it is: --model MODEL, models={id: MODEL} or attach(MODEL, id)"
"""The remedy for a servo whose model is not known."""


def cannot(target: ServoRef, what: str, why: str) -> UsageError:
    """Make the error for a verb that a family does not have."""
    return UsageError(f"{target} cannot {what}: {why}")


def mute(target: ServoRef, policy: str, setting: str) -> UsageError:
    """Make the error for reading a servo whose policy is to answer no reads; `setting` lets it answer."""
    return cannot(target, "be read", f"its {policy} is 0; `servobus write PORT {target.id} {setting}` lets it answer")


def not_taken(target: ServoRef, row: Register[Any], raw: int) -> BusError:
    """Make the error for a value that was written again and again, and that the servo does not have."""
    return BusError(f"{target} did not take {row.name} = {row.show(row.decode(raw))}")


def stays_off(target: ServoRef, standing: int, shown: str) -> Refused:
    """Make the error for a torque that cannot come back, for what switched it off is still there: these alarms."""
    return Refused(f"{target}: the torque stays off, for the cause is still there: {shown}", standing)


def require_turning(target: ServoRef) -> None:
    """Raise UsageError if the servo cannot turn without end, or if its model is not known."""
    require_model(target, "turn without end")
    if not target.model.turns:
        raise cannot(target, "turn without end", f"the {target.model.series} series has no such mode")


def require_model(target: ServoRef, what: str) -> None:
    """Raise UsageError if it is not known what an angle is on this servo, for its model is not known."""
    if target.model.unscaled("goal_position"):
        raise UsageError(
            f"{target} cannot {what} as long as its model is not known, for each model has its own units; {TELL_MODEL}"
        )


def check_output(output: float) -> float:
    """Give a share of full output back, or raise BadValue."""
    share = finite(output)
    if share is None or not -1 <= share <= 1:
        raise BadValue(f"output {said(output)} is not a share of full output, -1 .. 1")
    return share
