"""Values of joints by name: what is read of a robot, and what is asked of one."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Generic, Self, TypeVar

from servobus.core.units import finite, said
from servobus.errors import BadValue, ServobusError, UnknownName

V = TypeVar("V")


class ByJoint(Mapping[str, V], Generic[V]):
    """Name of a joint -> value, in the order of the robot file.

    `lost` has the joints that could not be read: name -> error; asking for the value of one raises that error. Numpy
    takes the values as an array in that order: `numpy.asarray(arm.positions())`. A joint that is lost is NaN there.
    """

    def __init__(self, values: Mapping[str, V], lost: Mapping[str, ServobusError] | None = None) -> None:
        self._values = dict(values)
        self.lost: dict[str, ServobusError] = dict(lost or {})

    def __getitem__(self, joint: str) -> V:
        if joint in self.lost:
            raise self._error(joint)
        return self._values[joint]

    def __contains__(self, joint: object) -> bool:
        return joint in self._values  # asking for one that is lost raises its error, which is no answer here

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def complete(self) -> Self:
        """Give these values if those of all joints could be read. Raises what came instead of the first one else."""
        for joint in self.lost:
            raise self._error(joint)
        return self

    def _error(self, joint: str) -> ServobusError:
        """Give the error of a joint that is lost, with its name: packets name ids alone, and each port has its own."""
        error = self.lost[joint].copy()
        error.tell_whose(joint)
        return error

    def __repr__(self) -> str:
        said = [f"{name!r}: {value!r}" for name, value in self._values.items()]
        return f"{{{', '.join([*said, *(f'{name!r}: lost' for name in self.lost)])}}}"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        """Give the values as a numpy array. Raises ImportError where numpy is not installed."""
        import numpy as np  # noqa: PLC0415 - only who has numpy calls this

        return np.array([*self._values.values(), *(math.nan for _ in self.lost)], dtype=dtype or float)


def named_angles(goals: Any, names: Sequence[str], keywords: Mapping[str, float]) -> dict[str, float]:
    """Give goals by the name of their joint: from a mapping, from a sequence in the order of `names`, or by keywords.

    Raises UnknownName for a joint that is not among the names, BadValue for a sequence of another length.
    """
    given: dict[str, Any] = dict(keywords)
    if isinstance(goals, Mapping):
        given = {**goals, **given}
    elif goals is not None:
        angles = list(goals) if isinstance(goals, Iterable) and not isinstance(goals, str) else [goals]
        if len(angles) != len(names):
            raise BadValue(f"{len(angles)} angles for {len(names)} joints: give one for each of {', '.join(names)}")
        given = {**dict(zip(names, angles, strict=True)), **given}
    angles_by_name: dict[str, float] = {}
    for key, angle in given.items():
        name = getattr(key, "name", key)
        check_joint(name, names)
        number = finite(float(angle) if hasattr(angle, "__float__") and not isinstance(angle, bool | str) else angle)
        if number is None:
            raise BadValue(f"{name}: {said(angle)} is not a number; an angle is in radians, such as 90 * deg")
        angles_by_name[name] = number
    return angles_by_name


def check_joint(name: str, names: Iterable[str]) -> None:
    """Raise UnknownName for a name that is none of these joints."""
    known = list(names)
    if name not in known:
        raise UnknownName(f"no joint {name!r}; there are {', '.join(known) or 'none'}")
