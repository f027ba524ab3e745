"""What a plot shows: values in the units people use, gaps, a trigger that fires once, and CSV."""

import math
from collections.abc import Mapping
from typing import Any

import pytest

from servobus.errors import BadValue
from servobus.server.web.page.parts.plotting import Channel, Recording, Trigger, lanes, subscriptions

POSITION = Channel("main", "dynamixel:1@57600", "present_position", "elbow", "rad")
VOLTAGE = Channel("main", "dynamixel:1@57600", "present_voltage", "elbow", "V")
OTHER = Channel("second", "lewansoul:3@115200", "torque_enable", "=1+1", "")


def sample(t: float, values: Mapping[str, Any] | None, *, of: Channel = POSITION) -> dict[str, Any]:
    return {"bus": of.bus, "t": t, "servos": {of.servo: {"values": values, "alarms": []}}}


def test_values_are_drawn_in_the_units_of_people_and_their_times_begin_with_0() -> None:
    recording = Recording((POSITION, VOLTAGE, OTHER))
    assert recording.add(sample(7.5, {"present_position": math.pi / 2, "present_voltage": 12.1})) == (
        0.0,
        {0: 90.0, 1: 12.1},
    )
    assert recording.add(sample(7.6, {"torque_enable": True}, of=OTHER)) == (0.1, {2: 1.0})


def test_a_servo_that_does_not_answer_makes_a_gap_and_another_bus_does_not() -> None:
    recording = Recording((POSITION, OTHER))
    assert recording.add(sample(1.0, None)) == (0.0, {0: None})
    assert recording.add({"bus": "third", "t": 1.1, "servos": {}}) is None


@pytest.mark.parametrize("value", [None, "low", ["overload"], math.nan, math.inf])
def test_what_is_no_number_is_not_drawn(value: Any) -> None:
    assert POSITION.number(value) is None


def test_csv_has_a_head_with_units_and_an_empty_field_where_nothing_was_read() -> None:
    recording = Recording((POSITION, OTHER))
    recording.add(sample(5.0, {"present_position": math.pi}))
    recording.add(sample(5.25, {"torque_enable": False}, of=OTHER))
    recording.add(sample(6.0, None))
    assert recording.csv() == (
        "time [s],elbow present position [°],'=1+1 torque enable\n0.0000,180,\n0.2500,,0\n1.0000,,\n"
    )
    assert recording.csv(0.2, 0.5).splitlines()[1:] == ["0.2500,,0"]


def test_the_oldest_rows_are_forgotten_first() -> None:
    recording = Recording((POSITION,), most=2)
    for t in range(4):
        recording.add(sample(float(t), {"present_position": 0.0}))
    assert [time for time, _ in recording.rows] == [2.0, 3.0]


def test_one_lane_for_each_unit_and_a_bound_on_them() -> None:
    assert lanes((POSITION, VOLTAGE, OTHER, POSITION)) == ["°", "V", ""]
    with pytest.raises(BadValue, match="more than 20"):
        lanes([POSITION] * 21)
    with pytest.raises(BadValue, match="more than 10 axes"):
        lanes([Channel("main", "1", "register", "servo", f"unit{n}") for n in range(11)])


def test_registers_are_asked_for_by_bus_and_servo() -> None:
    assert subscriptions((POSITION, VOLTAGE, OTHER)) == {
        "main": {"dynamixel:1@57600": ["present_position", "present_voltage"]},
        "second": {"lewansoul:3@115200": ["torque_enable"]},
    }


@pytest.mark.parametrize(
    ("edge", "values", "fires"),
    [
        ("rising", [1, 4, 5, 3, 9], 2),
        ("falling", [9, 6, 5, 9], 2),
        ("either", [9, 9, 4, 9], 2),
        ("rising", [9, 4, 3], None),
        ("rising", [9, 9], None),  # it is above from the beginning: nothing has crossed
        ("falling", [1, None, 9, None, 2], 4),
    ],
)
def test_a_trigger_fires_once_where_its_level_is_crossed(
    edge: Any, values: list[float | None], fires: int | None
) -> None:
    trigger = Trigger(0, 5.0, edge)
    fired = [n for n, value in enumerate(values) if trigger.see((float(n), {0: value}))]
    assert fired == ([] if fires is None else [fires])
    assert trigger.fired == (None if fires is None else float(fires))
