"""Which registers belong together for whom sets up a servo: a purpose for each row of a table, by its name and kind."""

import re
from collections.abc import Iterable
from enum import Enum
from typing import Any

from servobus.core.registers import Motion, Register


class Purpose(Enum):
    """Groups of the page, in the order in which they stand there: title and what it is about."""

    RANGE = "Range and zero", "How far the shaft may turn, and where its angles are counted from"
    PROTECTION = "Protection", "When the servo reports an alarm, and what follows"
    STRENGTH = "Torque", "How strong the motor may get"
    CONTROL = "Control", "How the servo goes to its goal and holds there"
    MOTION = "Motion", "Goals, speeds and modes; they are lost at power-off"
    LIGHT = "Light", "The LED"
    LINE = "Bus", "How the servo talks on the line"
    IDENTITY = "Identity", "Which servo this is"
    MEASURED = "Measured", "What the servo tells about itself; nothing to set"

    def __init__(self, title: str, about: str) -> None:
        self.title, self.about = title, about


_BY_NAME: tuple[tuple[str, Purpose], ...] = (
    (r"id|baud_rate|model_n(umber|o\d)|firmware_version|version\d", Purpose.IDENTITY),
    (
        r"alarm_.*|led_error|torque_policy|.*limit_(temperature|voltage)|(min|max)_(voltage|temperature)",
        Purpose.PROTECTION,
    ),
    (r"overload_.*|adc_fault_.*|status_error", Purpose.PROTECTION),
    (r"led.*", Purpose.LIGHT),
    (r"return_delay_time|status_return_level|ack_policy|packet_garbage_.*|registered_instruction|lock", Purpose.LINE),
    (r"status_detail|.*reserved.*", Purpose.LINE),
    (r".*torque_limit|max_torque|torque_enable|torque_control|(min|max)_pwm", Purpose.STRENGTH),
    (r"goal_(acceleration)|acceleration_ratio|max_acceleration_time", Purpose.CONTROL),
    (r".*_k[pid]|[pid]_gain|.*compliance.*|punch|dead_zone|saturator.*|pwm_offset|.*feedforward.*", Purpose.CONTROL),
    (r"stop_.*|inposition_margin", Purpose.CONTROL),
    (r"(cw|ccw)_angle_limit|(min|max)_position|drive_mode", Purpose.RANGE),
)
_BY_MOTION = {Motion.ZERO: Purpose.RANGE, Motion.LIMIT: Purpose.RANGE}


def purpose(row: Register[Any]) -> Purpose:
    """Tell what a register is for."""
    for pattern, found in _BY_NAME:
        if re.fullmatch(pattern, row.name):
            return found
    if row.motion in _BY_MOTION:
        return _BY_MOTION[row.motion]
    return Purpose.MOTION if row.writable else Purpose.MEASURED


def grouped(rows: Iterable[Register[Any]]) -> dict[Purpose, list[Register[Any]]]:
    """Sort the rows that can be read by what they are for, in the order of the groups; no group is empty."""
    groups: dict[Purpose, list[Register[Any]]] = {one: [] for one in Purpose}
    for row in rows:
        if row.readable and not row.name.startswith("reserved"):
            groups[purpose(row)].append(row)
    return {one: some for one, some in groups.items() if some}


def title(row: Register[Any]) -> str:
    """Write the name of a register for people: "Highest limit temperature"."""
    words = row.name.replace("_", " ")
    words = re.sub(r"\b(id|led|pwm|cw|ccw|adc)\b", lambda word: word[0].upper(), words)
    return words[0].upper() + words[1:]


def matches(row: Register[Any], asked: str) -> bool:
    """Tell whether a row is meant by what somebody types to find it: each word in its names or its meaning."""
    text = " ".join((row.name, title(row), *row.aliases, row.meaning)).lower()
    return all(word in text for word in asked.lower().split())


def meaning(row: Register[Any]) -> str:
    """Write what a register means as a sentence begins."""
    return row.meaning[0].upper() + row.meaning[1:]
