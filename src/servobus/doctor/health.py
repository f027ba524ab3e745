"""What servos report: supply, heat, and errors that stay."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from servobus.bus.blocking import Bus, BusServo
from servobus.core.units import show
from servobus.doctor.findings import Finding, Severity, at, command, for_each, id_list, span
from servobus.errors import BusError

WARM = 10.0
"""°C below its limit from which on a servo counts as warm."""

_WEAK = "a weak or wrong supply, or long and thin wires: measure it at the servo while it moves"
_STRONG = "a supply that is made for other servos: switch it off before it does harm"
_HOT = "too much load for too long, or a blocked shaft: take the load off, and let it cool without torque"
_ENDS = "it ends when its cause does"
_STAYS = "it stays until it is cleared: mend first what caused it; rearm clears it too and switches the torque on"
_FOREIGN = "noise, or requests that were meant for another family, as those of a search are"
_SHUT = "an alarm has shut it down: mend first what caused that; rearm switches the torque on, where it is"


_REARM = ("rearm", "$id")


@dataclass(frozen=True, slots=True)
class Problem:
    """What is wrong with one servo. Servos with the same problem become one finding.

    value  what was measured, as the register of the check tells it; None if the words say it
    mends  words of each command that mends it, $id among them
    """

    servo: BusServo
    level: Severity
    check: str
    value: float | None
    words: str
    cause: str
    mends: tuple[tuple[str, ...], ...] = ()

    @property
    def key(self) -> tuple[object, ...]:
        servo = self.servo
        return servo.model, servo.baud, self.level, self.check, self.words, self.cause, self.mends


def health(bus: Bus, servos: list[BusServo]) -> Iterator[Finding]:
    """Check voltage, temperature and latched errors. Changes nothing."""
    problems: list[Problem] = []
    heard: list[BusServo] = []
    for servo in servos:
        try:
            problems += _ask(servo)
        except BusError as error:
            problems.append(Problem(servo, Severity.UNKNOWN, "errors", None, f"did not tell ({error})", ""))
        else:
            heard.append(servo)
    states = [servo.state for servo in heard if servo.state is not None]
    fine = {
        "voltage": list(_within("voltage", [state.voltage for state in states], "V")),
        "temperature": list(_within("temperature", [state.temperature for state in states], "degC")),
        "errors": list(_without_errors(heard)),
    }
    for check, findings in fine.items():
        yield from _together(bus, [one for one in problems if one.check == check]) or findings


def _ask(servo: BusServo) -> list[Problem]:
    servo.look()
    names = ("present_voltage", "min_voltage", "max_voltage", "present_temperature", "max_temperature")
    volts, low, high, degrees, hot = servo.read_many(names).values()
    row = servo.model.optional("output_limit")
    # Only a limit that the servo itself changes tells that it has shut down.
    limit = servo.read(row) if row is not None and row.volatile else None
    return [*_voltage(servo, volts, low, high), *_heat(servo, degrees, hot), *_errors(servo, limit)]


def _voltage(servo: BusServo, volts: float, low: float, high: float) -> Iterator[Problem]:
    """Judge by the limits set in the servo; by its maker's, which are narrower, only one that says what it is."""
    row = servo.model.register("present_voltage")
    if not low <= volts <= high:
        words = f"is outside {row.show(low)} .. {row.show(high)}, the limits set in it"
        yield Problem(servo, Severity.FAIL, "voltage", volts, words, _WEAK if volts < low else _STRONG)
        return
    if servo.model.generic or servo.model.number is None:
        return  # it may be a servo for another supply
    if servo.model.sheet.voltage is None:
        return
    least, most = servo.model.sheet.voltage
    if not least <= volts <= most:
        words = f"is outside {show(least, 'V')} .. {show(most, 'V')}, what its maker allows"
        yield Problem(servo, Severity.WARN, "voltage", volts, words, _WEAK if volts < least else _STRONG)


def _heat(servo: BusServo, degrees: float, hot: float) -> Iterator[Problem]:
    row = servo.model.register("present_temperature")
    unscaled = servo.model.unscaled(row.name)
    # Some small HerkuleX tell a raw reading, of which not even is known whether it grows with heat.
    if not unscaled and degrees > hot - WARM:
        level = Severity.FAIL if degrees > hot else Severity.WARN
        words = f"where {row.show(hot)} is the limit set in it"
        yield Problem(servo, level, "temperature", degrees, words, _HOT, (("torque", "$id", "off"),))


def _errors(servo: BusServo, limit: float | None) -> Iterator[Problem]:
    """Tell of alarms in the answers, and of a shutdown, which takes the torque limit away."""
    if servo.alarms:
        said = servo.alarm_text()
        stays = [row.name for row in servo.model.registers.values() if row.latched]
        clear = ("write", "$id", *(f"{name}=0" for name in stays))
        mends: tuple[tuple[str, ...], ...] = (clear, _REARM) if stays else ()
        level, cause = Severity.FAIL, _STAYS if stays else _ENDS
        if said == "invalid_packet":  # of all errors the one that asking may have caused; it takes no torque
            level, cause, mends = Severity.WARN, _FOREIGN, mends[:1]
        yield Problem(servo, level, "errors", None, said, cause, mends)
    if limit == 0:
        words = "the torque limit is 0, so nothing moves"
        yield Problem(servo, Severity.FAIL, "errors", None, words, _SHUT, (_REARM,))


def _within(check: str, values: list[float], unit: str) -> Iterator[Finding]:
    """Say what was measured where nothing is wrong with it. NaN stands for a value of an unknown unit."""
    if known := [value for value in values if not math.isnan(value)]:
        yield Finding(Severity.OK, check, span(known, unit))
    elif values:
        yield Finding(
            Severity.UNKNOWN, check, "in units that are not known, as the model is", "--model tells which it is"
        )


def _without_errors(servos: list[BusServo]) -> Iterator[Finding]:
    mute = {servo.model.title for servo in servos if servo.family.ping(servo.id).alarms is None}
    if any(servo.model.title not in mute for servo in servos):
        yield Finding(Severity.OK, "errors", "none")
    if mute:
        yield Finding(Severity.UNKNOWN, "errors", f"{' and '.join(sorted(mute))} cannot be asked for them")


def _together(bus: Bus, problems: list[Problem]) -> list[Finding]:
    groups: dict[tuple[object, ...], list[Problem]] = {}
    for one in problems:
        groups.setdefault(one.key, []).append(one)
    return [_told(bus.transport.name, group) for group in groups.values()]


def _told(port: str, group: list[Problem]) -> Finding:
    one, servo = group[0], group[0].servo
    ids = [member.servo.id for member in group]
    value = ""
    if one.value is not None:
        row = servo.model.register(f"present_{one.check}")
        values = [member.value for member in group if member.value is not None]
        low, high = row.show(min(values)), row.show(max(values))
        value = f"{low} " if low == high else f"{low} .. {high} "
    what = f"{servo.model.named(id_list(ids))}: {value}{one.words}"
    commands = [command(verb, port, *words, at(servo.family, servo.baud)) for verb, *words in one.mends]
    return Finding(one.level, one.check, what, one.cause, tuple(for_each(ids, each) for each in commands))
