"""Results of several servos: a mapping whose keys are the servos, and that can be asked by id as well.

An id alone does not name a servo: one port may carry two of them with the same id, of two families or at two speeds.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from servobus.errors import ServobusError, UnknownName

if TYPE_CHECKING:
    from servobus.bus.servo import Servo

S = TypeVar("S", bound="Servo")
V = TypeVar("V")


class ByServo(Mapping[S, V], Generic[S, V]):
    """Servo -> value, in the order in which the servos are known.

    `result[servo]` always works, `result[1]` where one servo in it has that id: else it raises UnknownName, which names
    those that have. Iteration gives the servos. Printed, and compared with a plain dict, ids stand for the servos where
    each id is there once.
    """

    def __init__(self, values: Mapping[S, V] | None = None) -> None:
        self._values: dict[S, V] = dict(values or {})

    def __getitem__(self, key: S | int) -> V:
        try:
            return self._values[key]  # type: ignore[index] # where it is a servo
        except KeyError:
            return self._values[pick(self._values, key)]

    @property
    def by_servo(self) -> Mapping[S, V]:
        """Servo -> value as a plain mapping, for loops: nothing in it can be asked by id."""
        return self._values

    def get(self, key: S | int, default: Any = None) -> Any:
        """Give the value, or the default if there is none. Raises UnknownName for an id that two servos have."""
        return self[key] if key in self else default  # noqa: SIM401 - this is get

    def __iter__(self) -> Iterator[S]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, key: object) -> bool:
        return key in self._values or any(servo.id == key for servo in self._values)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, ByServo):
            return self._values == other._values
        if isinstance(other, Mapping):
            return self._values == other or (self._unique() and self.by_id() == other)
        return NotImplemented

    __hash__ = None  # type: ignore[assignment] # as of any mapping whose values may change

    def __repr__(self) -> str:
        if self._unique():
            return repr(self.by_id())
        return "{" + ", ".join(f"{name(servo)}: {value!r}" for servo, value in self._values.items()) + "}"

    def by_id(self) -> dict[int, V]:
        """Give id -> value. Raises UnknownName if two servos in it have one id, since one of them would be lost."""
        if not self._unique():
            raise UnknownName(f"ids are not unique here: {_names(self._values)}")
        return {servo.id: value for servo, value in self._values.items()}

    def _unique(self) -> bool:
        return len({servo.id for servo in self._values}) == len(self._values)


class Readings(ByServo[S, V]):
    """What was read of servos: servo -> value of those that answered, and `lost` of the others: servo -> error.

    Asking for the value of one that is lost raises its error. Both can be asked by id where that is unique.
    """

    def __init__(self, values: Mapping[S, V], lost: Mapping[S, ServobusError]) -> None:
        super().__init__(values)
        self.lost: ByServo[S, ServobusError] = ByServo(lost)

    def __getitem__(self, key: S | int) -> V:
        if key in self.lost and key not in self:
            raise self.lost[key]
        if not isinstance(key, int) or not self.lost:
            return super().__getitem__(key)
        # Two servos may have this id, one of them lost.
        return self._values[pick([*self._values, *self.lost], key)]


def pick(servos: Iterable[S], key: S | int, *, where: str = "known here", remedy: str = "") -> S:
    """Find the servo that is meant by itself or by its id. Raises UnknownName."""
    known = list(servos)
    matches = [servo for servo in known if servo is key or servo.id == key]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise UnknownName(f"id {key} is not unique here: {_names(matches)}; give the servo itself in place of its id")
    ids = ", ".join(str(servo.id) for servo in known) or "none"
    wanted = f"servo with id {key}" if isinstance(key, int) else f"such servo as {key!r:.60}"
    given: object = key
    if isinstance(given, str):
        remedy = "; an id is a number, not a text"
    raise UnknownName(f"no {wanted} is {where} ({'known' if where == 'known here' else 'in it'}: {ids}){remedy}")


def name(servo: "Servo") -> str:
    """Say which servo is meant, so that it is told from every other on its port."""
    return f"{servo.target} at {servo.baud}"


def _names(servos: Iterable["Servo"]) -> str:
    return " and ".join(map(name, servos))
