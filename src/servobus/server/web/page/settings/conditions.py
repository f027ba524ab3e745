"""Conditions and policies: what a servo takes for an alarm, and what follows, in one grid for all families."""

from collections.abc import Mapping
from typing import Any

from servobus.core.registers import Register
from servobus.core.units import Flags
from servobus.core.values import frozen
from servobus.families.base import Answers
from servobus.families.change import policy_register
from servobus.families.model import Model

LIGHT = ("alarm_led", "alarm_led_policy")
TORQUE = ("alarm_shutdown", "torque_policy")
"""Names that tables have for the alarms that make the LED blink, and those that switch the torque off."""

_ABOUT: Mapping[str, tuple[str, str]] = {
    "input_voltage": ("Supply out of range", "Check the supply at the servo while it moves: voltage and wires."),
    "over_voltage": ("Supply too high", "Switch the supply off, and use one that is made for this servo."),
    "angle_limit": ("Goal outside the limits", "Send goals inside the limits, or widen the limits."),
    "position_limit": ("Goal outside the limits", "Send goals inside the limits, or widen the limits."),
    "overheating": ("Too hot", "Take the load off and let it cool without torque."),
    "temperature": ("Too hot", "Take the load off and let it cool without torque."),
    "over_temperature": ("Too hot", "Take the load off and let it cool without torque."),
    "overload": ("Overload", "Free the shaft or take load off, then rearm the servo."),
    "locked_rotor": ("Shaft blocked", "Free the shaft; then switch the torque on again."),
    "range": ("Value out of range", "A program has written a value that the register does not take."),
    "checksum": ("Packet damaged", "Noise on the line: check wires, ground and speed."),
    "instruction": ("Unknown instruction", "A program has sent what this servo does not know."),
    "invalid_packet": ("Packet not understood", "Noise, or requests for servos of another family; clear it."),
    "driver_fault": ("Motor driver fault", "Switch the power off and on; if it comes back, the servo is broken."),
    "eep_distorted": ("Settings damaged", "Restore factory settings, then a backup."),
}
"""What an alarm is called, and what mends it."""
_LIMITS: Mapping[str, tuple[str, ...]] = {
    "input_voltage": ("min_voltage", "max_voltage"),
    "over_voltage": ("max_voltage",),
    "angle_limit": ("min_position", "max_position"),
    "position_limit": ("min_position", "max_position"),
    "overheating": ("max_temperature",),
    "temperature": ("max_temperature",),
    "over_temperature": ("max_temperature",),
    "overload": ("max_torque", "overload_pwm_threshold"),
}
"""Which registers say when it is raised."""


@frozen
class Condition:
    """One alarm of a model.

    name    as the tables call it
    title   for people
    mend    what to do about it
    limits  the registers that say when it is raised
    light   its bit in the register of the LED, or None if that cannot be chosen
    torque  its bit in the register of the torque, or None
    """

    name: str
    title: str
    mend: str
    limits: tuple[Register[Any], ...]
    light: int | None
    torque: int | None


def light_row(model: type[Model]) -> Register[Any] | None:
    """Find the register that says which alarms make the LED blink."""
    return _row(model, LIGHT)


def torque_row(model: type[Model]) -> Register[Any] | None:
    """Find the register that says which alarms switch the torque off."""
    return _row(model, TORQUE)


def conditions(model: type[Model]) -> list[Condition]:
    """List the alarms of which the servo lets one choose what follows."""
    light, torque = _bits(light_row(model)), _bits(torque_row(model))
    found = []
    for name in dict.fromkeys((*light, *torque)):
        title, mend = about(name)
        rows = [model.registers.get(model.aliases.get(one, one)) for one in _LIMITS.get(name, ())]
        limits = tuple(row for row in rows if row is not None)
        found.append(Condition(name, title, mend, limits, light.get(name), torque.get(name)))
    return found


def about(alarm: str) -> tuple[str, str]:
    """Give the title of an alarm and what mends it; an alarm that is not known here keeps its name."""
    return _ABOUT.get(alarm, (alarm.replace("_", " ").capitalize(), ""))


def with_bit(raw: int, bit: int, on: bool) -> int:
    """Give a set of flags with one of them on or off."""
    return raw | bit if on else raw & ~bit


ANSWERS: Mapping[Answers, tuple[str, str]] = {
    Answers.NOTHING: (
        "Nothing",
        "Quickest, and blind: whether a servo took something cannot be told. It still answers a ping.",
    ),
    Answers.READS: ("Reads", "What is asked is answered; whether a write was taken has to be read back."),
    Answers.EVERYTHING: ("Reads and writes", "Each write is confirmed, so a fault is noticed at once."),
}
"""Which requests are answered: title, and what that means."""


def answer_policy(model: type[Model]) -> Register[Any] | None:
    """Find the register that says which requests are answered; None where all are."""
    return policy_register(model)


def _row(model: type[Model], names: tuple[str, ...]) -> Register[Any] | None:
    found = [model.registers.get(model.aliases.get(name, name)) for name in names]
    return next((row for row in found if row is not None and isinstance(row.scale, Flags) and row.writable), None)


def _bits(row: Register[Any] | None) -> dict[str, int]:
    if row is None or not isinstance(row.scale, Flags):
        return {}
    return {row.scale.show(flag): int(flag) for flag in row.scale.used}
