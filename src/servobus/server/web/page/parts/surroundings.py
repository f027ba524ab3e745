"""What surrounds virtual servos, between sliders and the words that virtual servos understand."""

import math
import re
from collections.abc import Mapping

from servobus.remote.managing import BenchServo

HOT, COLD = 100.0, 0.0
"""degC between which the slider goes; no servo here works beyond."""
ARM = 0.1
"""m: the length of the arm that the weight hangs on, where none is there yet."""
FAULTS: Mapping[str, tuple[str, str, float, float]] = {
    "mute": ("Lost answers", "%", 20.0, 0.5),
    "flip": ("Flipped bits", "%", 20.0, 0.5),
    "drop": ("Lost bytes", "%", 20.0, 0.5),
    "junk": ("Junk on the line", "%", 20.0, 0.5),
    "latency": ("Adapter waits", "ms", 50.0, 1.0),
}
"""Fault -> its name for people, its unit, the end and the step of its slider."""
_ONE = re.compile(r"(?P<kind>[a-z]+)=(?P<number>[0-9.]+)(?P<unit>%|ms)?")


def read_faults(text: str) -> dict[str, float] | None:
    """Give the faults of the sliders in their units; None where other faults are among them."""
    found: dict[str, float] = {}
    for part in filter(None, re.split(r"[,\s]+", text)):
        one = _ONE.fullmatch(part)
        if one is None or one["kind"] not in FAULTS or one["kind"] in found:
            return None
        number = float(one["number"])
        if one["kind"] == "latency":
            if one["unit"] != "ms":
                return None
            found["latency"] = number
        else:
            found[one["kind"]] = number if one["unit"] == "%" else 100 * number
    return found


def faults_text(faults: Mapping[str, float]) -> str:
    """Give faults of the sliders in words; "none" where there are none."""
    said = []
    for kind, number in faults.items():
        if number > 0:
            said.append(f"{kind}={number:g}ms" if kind == "latency" else f"{kind}={number / 100:g}")
    return ",".join(said) or "none"


def load_text(servo: BenchServo, name: str, value: float) -> str:
    """Give the words that change one thing that hangs on a shaft."""
    if name == "mass":
        length = servo.length or ARM
        return f"mass={value:g},length={length:g}"
    return f"{name}={value:g}"


def supply_span(servo: BenchServo) -> float:
    """Give the end of the slider of the supply, V: well above what the servo is made for."""
    return float(math.ceil(1.5 * servo.nominal))


def torque_span(servo: BenchServo) -> float:
    """Give the end of the slider of the load, N·m: half as much again as the servo can bear, to two digits."""
    most = 1.5 * max(servo.stall, 0.05)
    digits = 1 - math.floor(math.log10(most))
    return round(most, digits)
