import math
from pathlib import Path

import pytest

from servobus.core.ids import parse_ids
from servobus.errors import BadValue, UnknownName, UsageError
from servobus.families.registry import LX16A, RX28
from servobus.virtual.physics.motor import Load
from servobus.virtual.serve.spec import Group, Setup, parse_load, parse_specs, parse_url


def test_models_with_ids_and_ranges() -> None:
    assert parse_specs("rx28@1-4,7,lx16a@2") == [Group(RX28, [1, 2, 3, 4, 7]), Group(LX16A, [2])]
    assert parse_specs(" RX-28@0, 253 ") == [Group(RX28, [0, 253])]


def test_an_id_may_be_named_twice() -> None:
    assert parse_specs("rx28@1,1,rx28@1") == [Group(RX28, [1, 1]), Group(RX28, [1])]


@pytest.mark.parametrize("text", ["", "rx28", "1,2", "rx28@", "rx28@1,", "rx28@x", "rx28@-1", "rx28@1-", "rx28@4-2"])
def test_malformed(text: str) -> None:
    with pytest.raises(UsageError):
        parse_specs(text)


@pytest.mark.parametrize("text", ["rx28@254", "rx28@1-255"])
def test_ids_no_servo_can_have(text: str) -> None:
    with pytest.raises(BadValue, match="253"):
        parse_specs(text)


def test_unknown_model_is_told_with_the_nearest() -> None:
    with pytest.raises(UnknownName, match="rx28"):
        parse_specs("rx82@1")
    with pytest.raises(UnknownName):
        parse_specs("@1")


def test_options() -> None:
    text = "virtual:rx28@1?clock=virtual&voltage=12&temperature=30&echo=1&baud=57600&state=a/b.json"
    assert parse_url(text) == Setup([Group(RX28, [1])], "virtual", True, 57600, 12.0, 30.0, Path("a/b.json"))
    assert parse_url("virtual:rx28@1") == Setup([Group(RX28, [1])])


@pytest.mark.parametrize("query", ["clock=fast", "echo=maybe", "baud=fast", "voltage=12A", "colour=red", "state="])
def test_options_that_make_no_sense(query: str) -> None:
    with pytest.raises(UsageError, match=query.partition("=")[0]):
        parse_url(f"virtual:rx28@1?{query}")


def test_motor_supply_and_load() -> None:
    setup = parse_url("virtual:rx28@1?motor=measured&supply_resistance=0.5&load=mass:0.2+length:0.1+blocked")
    assert (setup.motor, setup.supply_resistance) == ("measured", 0.5)
    assert setup.load == Load(mass=0.2, length=0.1, blocked=1.0)
    assert parse_url("virtual:rx28@1?load=torque=-0.5,down=90").load == Load(torque=-0.5, down=math.pi / 2)
    assert parse_url("virtual:rx28@1?supply_resistance=0ohm").supply_resistance == 0.0


@pytest.mark.parametrize(
    "query",
    [
        "voltage=300", "voltage=-1", "temperature=900", "supply_resistance=-1", "supply_resistance=wire",
        "load=weight:1", "load=mass:-1", "load=mass", "load=blocked:maybe", "load=torque:1e999", "motor=",
    ],
)  # fmt: skip
def test_surroundings_that_make_no_sense(query: str) -> None:
    with pytest.raises(UsageError, match=query.partition("=")[0].split("_")[0]):
        parse_url(f"virtual:rx28@1?{query}")


@pytest.mark.parametrize("volts", [-0.1, 30.1, float("nan"), float("inf")])
def test_no_supply_of_300_volts(volts: float) -> None:
    with pytest.raises(BadValue, match="voltage"):
        Setup([Group(RX28, [1])], voltage=volts)


def test_loads_change_what_was_there() -> None:
    arm = parse_load("mass=0.2kg, length=0.1m inertia=1e-3")
    assert arm == Load(mass=0.2, length=0.1, inertia=0.001)
    assert parse_load("blocked", arm) == Load(mass=0.2, length=0.1, inertia=0.001, blocked=1.0)
    assert parse_load("blocked=off torque=1", parse_load("blocked")) == Load(torque=1.0)
    assert parse_load("none", arm) == parse_load("") == Load()
    assert parse_load("none torque=1", arm) == Load(torque=1.0)


def test_ids() -> None:
    assert parse_ids("1-3, 7") == [1, 2, 3, 7]
    with pytest.raises(UsageError):
        parse_ids("one")
