"""What the overview shows of each servo."""

import asyncio
import math
from collections.abc import Callable
from enum import IntFlag
from typing import Any

import pytest

import servobus
from servobus.bus.asyncio import AsyncBusServo
from servobus.families.dynamixel.protocol import Error
from servobus.families.herkulex.protocol import StatusError
from servobus.families.lewansoul.protocol import Alarm
from servobus.server.web.page.parts.alarms import ALARMS, alarms_said
from servobus.server.web.page.rows import changed, first_row, live_row
from servobus.server.web.page.shell import stop_said


def of(model: str, look: Callable[[AsyncBusServo], Any]) -> Any:
    """Give what is said of a servo of a model, which is asked nothing."""

    async def told() -> Any:
        bus = servobus.open_async(f"virtual:{model}@7")
        try:
            return look(bus.attach(model, 7))
        finally:
            bus.close()

    return asyncio.run(told())


def sample(alarms: list[str] | None = None, **values: Any) -> dict[str, Any]:
    return {"values": values, "alarms": alarms or []}


@pytest.mark.parametrize(
    ("model", "low", "high"),
    [
        ("rx28", 0.0, 300.0),  # manual of the RX-28: 0 to 300°
        ("lx16a", 0.0, 240.0),  # manual of the LX-16A: 0 to 240°
        ("drs0101", -166.4, 166.1),  # manual of the DRS-0101: goals 0 to 1023 in steps of 0.325°, the middle is 512
        ("drs0602", None, None),  # more than a turn
        ("mx28", None, None),
    ],
)
def test_the_dial_shows_where_goals_can_be(model: str, low: float | None, high: float | None) -> None:
    row = of(model, lambda servo: first_row(servo, ""))
    assert (row["low"], row["high"]) == (pytest.approx(low), pytest.approx(high))


def test_names_are_those_of_joints() -> None:
    assert of("rx28", lambda servo: first_row(servo, "elbow"))["name"] == "elbow"
    row = of("rx28", lambda servo: first_row(servo, ""))
    assert (row["name"], row["model"], row["key"]) == ("Servo 7", "RX-28", "dynamixel:7@57600")


def test_values_are_written_as_people_read_them() -> None:
    told = sample(
        present_position=math.pi / 2,
        goal_position=math.pi,
        present_speed=-math.pi,
        present_load=-0.25,
        present_voltage=14.4,
        present_temperature=31.0,
        torque_enable=True,
        led=True,
    )
    row = of("rx28", lambda servo: live_row(servo, told))
    assert row == {
        "state": "ok", "angle": 90.0, "goal": 180.0, "speed": "-180.0°/s", "load": -0.25, "volts": "14.4 V",
        "volts_bad": False, "temp": "31 °C", "temp_bad": False, "torque": "on", "led": "red", "alarms": [],
    }  # fmt: skip


def test_other_families_name_their_registers_otherwise() -> None:
    told = sample(calibrated_position=0.5, torque_control="free", led_control=["green", "blue"], voltage=7.0)
    row = of("drs0602", lambda servo: live_row(servo, told))
    assert (row["angle"], row["torque"], row["led"]) == (28.6, "off", "rgb(0 255 255)")
    assert row["volts_bad"]  # data sheet of the DRS-0602: 9.5 to 14.8 V
    brake = of("drs0602", lambda servo: live_row(servo, sample(torque_control="brake")))
    assert brake["torque"] == "brake"


@pytest.mark.parametrize(("degrees", "bad"), [(74.0, False), (76.0, True)])
def test_heat_is_marked_before_it_is_too_much(degrees: float, bad: bool) -> None:
    # Data sheet of the RX-28: -5 to 85 °C.
    assert of("rx28", lambda servo: live_row(servo, sample(present_temperature=degrees)))["temp_bad"] is bad


def test_a_servo_without_an_answer_keeps_what_was_seen_last() -> None:
    row = of("rx28", lambda servo: live_row(servo, {"values": None, "alarms": []}))
    assert row == {"state": "lost", "alarms": []}


def test_nothing_is_sent_that_has_not_changed() -> None:
    row = {"angle": 1.0, "volts": "12.0 V", "goal": None}
    assert changed(row, {"angle": 2.0, "volts": "12.0 V"}) == {"angle": 2.0}
    assert row == {"angle": 2.0, "volts": "12.0 V", "goal": None}
    assert changed(row, {"angle": 2.0}) == {}


@pytest.mark.parametrize("kind", [Error, StatusError, Alarm])
def test_every_alarm_of_every_family_has_words_and_a_mend(kind: type[IntFlag]) -> None:
    for alarm in kind:
        assert alarm.name is not None
        said = ALARMS[alarm.name.lower()]
        assert said.words
        assert said.mend.endswith(".")


def test_alarms_with_the_same_words_are_told_once() -> None:
    assert [one.words for one in alarms_said(["checksum", "invalid_packet", "0x80"])] == [
        "Garbled request",
        "Alarm 0x80",
    ]


def test_a_stop_names_who_and_what() -> None:
    both = {"left": "browser 1a", "right": "browser 1a"}
    assert stop_said(both, ["left", "right"]).startswith("Everything was stopped by browser 1a. ")
    assert stop_said({"left": "x"}, ["left", "right"]).startswith("left was stopped by x. ")
