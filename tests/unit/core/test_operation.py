"""What can be found out about an operation at run time: `help`, `inspect.signature`, and with them Jupyter."""

import inspect
import pydoc
from collections.abc import Awaitable
from typing import Any

import pytest

import servobus
from servobus import RX28, AsyncBus, AsyncBusServo, Bus, BusServo, Cycle, Servo, Snapshot
from servobus.bus.base import BaseBus
from servobus.bus.cycle import AsyncBusCycle, BusCycle
from servobus.core.operation import bus_method

CLASSES: list[type] = [Bus, AsyncBus, BusServo, AsyncBusServo, BusCycle, AsyncBusCycle, Cycle, Servo, BaseBus]


def operations(kind: type) -> list[str]:
    return [name for name in dir(kind) if isinstance(inspect.getattr_static(kind, name), bus_method)]


EVERY = [(kind, name) for kind in CLASSES for name in operations(kind)]


def objects() -> list[Any]:
    bus, other = (opener("virtual:rx28@1?clock=virtual") for opener in (servobus.open, servobus.open_async))
    servo, twin = bus.attach(RX28, 1), other.attach(RX28, 1)
    return [bus, other, servo, twin, bus.cycle(), other.cycle(), Servo(servo.target)]


def true_parameters(kind: type, name: str) -> list[tuple[str, Any, Any]]:
    """Read them from the function as it is written."""
    build = inspect.getattr_static(kind, name)._build
    return [(each.name, each.kind, each.default) for each in inspect.signature(build).parameters.values()]


def test_all_classes_have_operations() -> None:
    assert len(EVERY) > 100
    assert {"scan", "find", "read_all", "torque_on"} <= set(operations(Bus))
    assert {"read", "write", "led", "turn", "change_id"} <= set(operations(BusServo))
    assert operations(Cycle) == ["run"]


@pytest.mark.parametrize(("kind", "name"), EVERY, ids=[f"{kind.__name__}.{name}" for kind, name in EVERY])
def test_M5_on_a_class_an_operation_shows_what_it_takes(kind: type, name: str) -> None:
    operation = getattr(kind, name)
    shown = inspect.signature(operation)
    assert [(each.name, each.kind, each.default) for each in shown.parameters.values()] == true_parameters(kind, name)
    assert operation.__name__ == name
    assert operation.__doc__ == inspect.getattr_static(kind, name)._build.__doc__
    text = pydoc.plain(pydoc.render_doc(operation))
    assert f"{name}(self" in text
    assert operation.__doc__.splitlines()[0] in text
    assert "~S" not in text or kind is BaseBus


@pytest.mark.parametrize("thing", objects(), ids=lambda thing: type(thing).__name__)
def test_M5_on_an_object_it_shows_the_same_without_self(thing: Any) -> None:
    for name in operations(type(thing)):
        for _ in range(2):  # the second time it is found on the object itself
            operation = getattr(thing, name)
            shown = [(each.name, each.kind, each.default) for each in inspect.signature(operation).parameters.values()]
            assert shown == true_parameters(type(thing), name)[1:]
            assert (operation.__name__, operation.__doc__) == (name, getattr(type(thing), name).__doc__)
        text = pydoc.plain(pydoc.render_doc(operation))
        assert f"\n{name}(" in text
        assert "P.args" not in text


def test_M5_what_it_gives_is_told_for_each_kind_of_bus() -> None:
    def given(operation: Any) -> Any:
        return inspect.signature(operation).return_annotation

    assert given(Bus.scan) == list[BusServo]
    assert given(AsyncBus.scan) == Awaitable[list[AsyncBusServo]]
    assert given(Bus.find) is BusServo
    assert given(BusServo.look) is Snapshot
    assert given(AsyncBusServo.look) == Awaitable[Snapshot]
    assert given(BusServo.write) is None
    assert given(AsyncBusServo.write) == Awaitable[None]
    assert given(Bus.protect) == "ByServo[BusServo, Level]"
    assert given(AsyncBus.protect) == "Awaitable[ByServo[AsyncBusServo, Level]]"
    assert "BusServo" in str(inspect.signature(Bus.torque_on))
    assert "Generator" in str(given(Servo.look))


def test_M5_the_whole_help_of_a_class_names_every_operation() -> None:
    for kind in CLASSES:
        text = pydoc.plain(pydoc.render_doc(kind))
        assert all(f"{name}(self" in text for name in operations(kind) if not name.startswith("_"))


def test_an_operation_can_be_called_on_the_class_as_any_method() -> None:
    bus = servobus.open("virtual:rx28@1?clock=virtual")
    (servo,) = Bus.scan(bus, ids=[1], family="dynamixel")
    assert BusServo.read(servo, RX28.id) == 1
