"""The values that LeRobot sees of a robot file: `<joint>.pos`, in degrees, or in percent of the way between limits."""

from collections.abc import Iterable, Mapping
from typing import Any

from servobus import BadValue, UnknownName, deg
from servobus.core.units import finite, said
from servobus.robots.file.entries import RobotFile

POS = ".pos"


class Features:
    """How angles of joints and the values of LeRobot belong together.

    ranges   joint -> its least and greatest angle, rad
    percent  joints that count 0 .. 100 between these; all others count degrees
    """

    def __init__(self, file: RobotFile, percent: Iterable[str]) -> None:
        self.ranges = {name: joint.range for name, joint in file.joints.items()}
        self.percent = frozenset(percent)
        if unknown := self.percent - self.ranges.keys():
            raise UnknownName(f"{file.name}: no joint {min(unknown)!r}; there are {', '.join(self.ranges)}")

    @property
    def types(self) -> dict[str, type]:
        """The features as LeRobot has them: key -> type."""
        return {f"{name}{POS}": float for name in self.ranges}

    def values(self, angles: Mapping[str, float]) -> dict[str, float]:
        """Turn angles in rad, by joint, into values of LeRobot. Nothing is clipped."""
        return {f"{name}{POS}": self._value(name, angle) for name, angle in angles.items()}

    def angles(self, action: Mapping[str, Any]) -> dict[str, float]:
        """Turn an action into angles in rad, by joint, within their limits.

        Raises UnknownName for a joint that is not there, BadValue for what is no number.
        """
        found = {}
        for key, value in action.items():
            if not key.endswith(POS):
                continue  # what belongs to another device of the same action
            name = key.removesuffix(POS)
            if name not in self.ranges:
                raise UnknownName(f"no joint {name!r} for the action {key!r}; there are {', '.join(self.ranges)}")
            number = finite(float(value))
            if number is None:
                raise BadValue(f"{key}: {said(value)} is no number; nothing was sent")
            low, high = self.ranges[name]
            angle = low + number / 100 * (high - low) if name in self.percent else number * deg
            found[name] = min(max(angle, low), high)
        return found

    def _value(self, name: str, angle: float) -> float:
        low, high = self.ranges[name]
        return (angle - low) / (high - low) * 100 if name in self.percent else angle / deg
