"""Alarms in words: what each means, and what to do about it."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm for people."""

    words: str
    mend: str


_SUPPLY = Alarm(
    "Supply voltage", "Measure the supply at the servo while it moves: it is too weak, too strong, or far away."
)
_HEAT = Alarm("Too hot", "Take the load off and let the servo cool without torque.")
_LOAD = Alarm("Overload", "Free the shaft or take load off, then rearm: that switches the torque on again.")
_PACKET = Alarm("Garbled request", "Noise on the line, or a program that speaks another protocol. It does no harm.")
ALARMS = {
    "input_voltage": _SUPPLY,
    "over_voltage": _SUPPLY,
    "overheating": _HEAT,
    "temperature": _HEAT,
    "over_temperature": _HEAT,
    "overload": _LOAD,
    "locked_rotor": Alarm("Shaft blocked", "Free the shaft, then switch the torque on again."),
    "angle_limit": Alarm("Goal outside the limits", "Give a goal within the limits, or widen them on the page Servo."),
    "position_limit": Alarm("Outside the limits", "Bring the shaft back within the limits, or widen them."),
    "range": Alarm("Value out of range", "A program has written a value that this servo cannot hold."),
    "checksum": _PACKET,
    "invalid_packet": _PACKET,
    "instruction": Alarm("Unknown instruction", "A program has asked for what this servo cannot do."),
    "driver_fault": Alarm("Motor driver", "Switch the supply off and on. If the fault stays, the servo needs repair."),
    "eep_distorted": Alarm("Settings damaged", "Restore a backup, or the factory settings, on the page Servo."),
}
"""By their names in the families' tables."""


def alarms_said(names: Iterable[str]) -> list[Alarm]:
    """Give alarms for people; one without a name is shown as it is."""
    unknown = "The manual of this servo says what it means."
    return list(dict.fromkeys(ALARMS.get(name, Alarm(f"Alarm {name}", unknown)) for name in names))
