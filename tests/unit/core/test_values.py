import copy
import pickle
from typing import Any, Generic, TypeVar

import pytest

from servobus.core.framing import Packet
from servobus.core.values import frozen, replace

T = TypeVar("T")


@frozen
class Point:
    x: int
    y: int = 0


@frozen
class Size:
    x: int
    y: int = 0


@frozen
class Box(Generic[T]):
    content: T

    def __repr__(self) -> str:
        return "a box"

    @property
    def full(self) -> bool:
        return self.content is not None


def test_fields_come_by_place_by_name_or_by_default() -> None:
    assert (Point(1, 2).x, Point(1, 2).y) == (1, 2)
    assert Point(y=2, x=1) == Point(1, 2)
    assert Point(1) == Point(1, 0)
    with pytest.raises(TypeError, match="'x'"):
        Point()  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="z"):
        Point(1, z=2)  # type: ignore[call-arg]


def test_values_are_equal_if_class_and_fields_are() -> None:
    assert Point(1, 2) == Point(1, 2)
    assert Point(1, 2) != Point(1, 3)
    others: list[object] = [Size(1, 2), (1, 2)]
    assert Point(1, 2) not in others
    assert len({Point(1, 2), Point(1, 2), Point(1, 3)}) == 2


def test_a_value_is_hashable_if_its_fields_are() -> None:
    with pytest.raises(TypeError, match="unhashable"):
        hash(Box([1]))


def test_nothing_changes_a_value() -> None:
    point: Any = Point(1, 2)
    with pytest.raises(AttributeError, match="Point is a value: its x cannot be changed"):
        point.x = 3
    with pytest.raises(AttributeError, match="its y cannot be changed"):
        del point.y
    with pytest.raises(AttributeError, match="its z cannot be changed"):
        point.z = 3
    assert point == Point(1, 2)
    assert not hasattr(point, "__dict__")


def test_replace_makes_another() -> None:
    point = Point(1, 2)
    assert replace(point, y=5) == Point(1, 5)
    assert point == Point(1, 2)
    with pytest.raises(TypeError, match="z"):
        replace(point, z=0)


def test_it_shows_its_fields() -> None:
    assert repr(Point(1, y=2)) == "Point(x=1, y=2)"


def test_its_own_methods_stay() -> None:
    assert repr(Box(1)) == "a box"
    assert Box[int](1).full


def test_patterns_match_its_fields_in_order() -> None:
    match Point(1, 2):
        case Point(x, y):
            assert (x, y) == (1, 2)


def test_copies_and_pickles_are_equal() -> None:
    for again in (copy.copy(Point(1, 2)), copy.deepcopy(Point(1, 2)), pickle.loads(pickle.dumps(Point(1, 2)))):
        assert again == Point(1, 2)


def test_where_a_packet_ends_does_not_count() -> None:
    assert Packet(1, 2, b"3", 10) == Packet(1, 2, b"3", 20)
    assert hash(Packet(1, 2, b"3", 10)) == hash(Packet(1, 2, b"3", 20))
    assert Packet(1, 2, b"3") != Packet(1, 2, b"4")
