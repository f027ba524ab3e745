"""The LX-16A's table, against what the protocol document says in its section 4."""

import math
from typing import Any

import pytest

from servobus.core.registers import Access, Area, Register
from servobus.core.units import deg
from servobus.errors import BadValue, UnknownName
from servobus.families.lewansoul.models.lx import LX16A
from servobus.families.lewansoul.places import Pair
from servobus.families.lewansoul.protocol import Alarm, Command, Mode


def test_its_name() -> None:
    assert LX16A.key() == "lx16a"
    assert LX16A.number is None


def test_every_pair_of_commands_is_in_the_table() -> None:
    places = [row.place for row in LX16A.registers.values()]
    assert all(isinstance(place, Pair) for place in places)
    used = {code for place in places if isinstance(place, Pair) for code in (place.write, place.read)}
    # The other three do something and hold nothing.
    acts = {Command.SERVO_MOVE_START, Command.SERVO_MOVE_STOP, Command.SERVO_ANGLE_OFFSET_WRITE}
    assert used - {None} == set(Command) - acts


@pytest.mark.parametrize("row", LX16A.registers.values(), ids=str)
def test_each_row_is_laid_out_as_the_parameter_it_stands_for(row: Register[Any]) -> None:
    assert isinstance(row.place, Pair)
    read = Command(row.place.read)
    at = 0
    found = None
    for _, layout in read.reply:
        if at == row.place.at:
            found = layout
        at += layout.size
    assert found == row.layout
    assert (row.place.write is None) == (row.access is Access.READ)
    if row.place.write is not None:
        assert Command(row.place.write).params[-1][1] == read.reply[-1][1]


def test_what_survives_power_off() -> None:
    saved = {row.name for row in LX16A.registers.values() if row.area is Area.EEPROM}
    assert saved == {
        "id", "angle_offset", "min_position", "max_position", "min_voltage", "max_voltage", "max_temperature",
        "led", "led_error",
    }  # fmt: skip


def test_factory_values() -> None:
    values = {row.name: row.decode(row.default) for row in LX16A.registers.values() if row.default is not None}
    assert values == {
        "goal_time": 0.0,
        "id": 1,
        "angle_offset": 0.0,
        "min_position": 0.0,
        "max_position": pytest.approx(240 * deg),
        "min_voltage": 6.5,
        "max_voltage": 12.0,
        "max_temperature": 85.0,
        "mode": Mode.POSITION,
        "motor_speed": 0.0,
        "torque_enable": False,
        "led": True,
        "led_error": Alarm.OVER_TEMPERATURE | Alarm.OVER_VOLTAGE | Alarm.LOCKED_ROTOR,
    }


def test_a_position_unit_is_0_24_degrees() -> None:
    assert LX16A.goal_position.encode(120 * deg) == 500
    assert math.degrees(LX16A.present_position.decode(-12)) == pytest.approx(-2.88)
    assert LX16A.present_position.layout.unpack(b"\xf4\xff") == -12
    assert LX16A.angle_offset.layout.pack(LX16A.angle_offset.encode(-12 * deg)) == b"\xce"


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("goal_position", (0, 1000), (-1, 1001)),
        ("goal_time", (0, 30000), (-1, 30001)),
        ("id", (0, 253), (-1, 254)),
        ("angle_offset", (-125, 125), (-126, 126)),
        ("min_position", (0, 1000), (-1, 1001)),
        ("max_voltage", (4500, 12000), (4499, 12001)),
        ("max_temperature", (50, 100), (49, 101)),
        ("mode", (0, 1), (-1, 2)),
        ("motor_speed", (-1000, 1000), (-1001, 1001)),
        ("led_error", (0, 7), (-1, 8)),
    ],
)
def test_ranges(name: str, good: tuple[int, int], bad: tuple[int, int]) -> None:
    row = LX16A.register(name)
    assert [row.check(raw) for raw in good] == list(good)
    for raw in bad:
        with pytest.raises(BadValue):
            row.check(raw)


def test_a_motor_speed_is_a_share_of_full_output() -> None:
    assert LX16A.motor_speed.show(LX16A.motor_speed.decode(-500)) == "-50.0 %"


def test_the_light_is_inverted() -> None:
    assert [LX16A.led.encode(on) for on in (True, False)] == [0, 1]


def test_other_names_of_the_same_rows() -> None:
    assert LX16A.register("load") is LX16A.torque_enable
    assert LX16A.register("alarm_led") is LX16A.led_error
    with pytest.raises(UnknownName):
        LX16A.register("baud")


def test_the_data_sheet() -> None:
    weak, strong = LX16A.sheet.performance
    assert (weak.voltage, strong.voltage) == (6.0, 7.4)
    assert weak.speed
    assert strong.speed
    assert strong.stall_torque == pytest.approx(1.912, abs=0.001)
    assert weak.stall_torque == pytest.approx(1.667, abs=0.001)
    assert 60 * deg / strong.speed == pytest.approx(0.16)
    assert 60 * deg / weak.speed == pytest.approx(0.20)
    assert LX16A.sheet.angle == pytest.approx(1000 * LX16A.sheet.resolution)
