"""Servos, and changes of their registers, as JSON in SI units."""

import math
from collections.abc import Mapping
from typing import Any

from servobus.bus.asyncio import AsyncBusServo
from servobus.core.present import si_value
from servobus.core.registers import Register
from servobus.jobs.look import Snapshot


def snapshot_entry(state: Snapshot) -> dict[str, Any]:
    """Give what was seen of a servo; None where a unit is not known."""
    return {
        "position": _known(state.position),
        "voltage": _known(state.voltage),
        "temperature": _known(state.temperature),
        "torque": state.torque,
        "shutdown": state.shutdown or None,
        "text": str(state),
    }


def alarm_names(servo: AsyncBusServo) -> list[str]:
    """Give the alarms of the last reply."""
    return servo.alarm_text().split("+") if servo.alarms else []


def latched_names(servo: AsyncBusServo) -> list[str]:
    """Give the alarms that were seen since the servo was last rearmed."""
    return servo._flags_text(servo.latched).split("+") if servo.latched else []


def change_entry(row: Register[Any], old: int | None, new: int) -> dict[str, Any]:
    """Give what a value was and what it becomes, both raw here: in the SI unit, and for people."""
    return {
        "old": None if old is None else si_value(row, old),
        "new": si_value(row, new),
        "unit": row.unit,
        "text": f"{'?' if old is None else row.said(old)} -> {row.said(new)}",
    }


def texts_of(raws: Mapping[Register[Any], int]) -> dict[str, Any]:
    """Give raw values for people, by the names of their registers."""
    return {row.name: row.said(raw) for row, raw in raws.items()}


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value
