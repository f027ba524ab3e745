"""Every register of the RX-28 that can be written: host -> virtual servo -> host gives the same raw value.

And what no driver of ours would send: raw values beyond the limits, in packets made by hand, are refused
with the error bit that the manual has for them (3-3), and change nothing.
"""

from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import servobus
from servobus.core.registers import Access, Area, Register
from servobus.errors import Refused, UsageError
from servobus.families.base import Answers
from servobus.families.dynamixel.models.rx28 import RX28
from servobus.families.dynamixel.places import TABLE, Address
from servobus.virtual.serve.inprocess import VirtualPort

WRITABLE = [row for row in RX28.registers.values() if row.access is Access.READ_WRITE]
PLAIN_BYTES = [
    RX28.return_delay_time, RX28.highest_limit_temperature, RX28.lowest_limit_voltage, RX28.highest_limit_voltage,
    RX28.alarm_led, RX28.alarm_shutdown, RX28.torque_enable, RX28.led, RX28.cw_compliance_margin,
    RX28.ccw_compliance_margin, RX28.cw_compliance_slope, RX28.ccw_compliance_slope, RX28.registered_instruction,
]  # fmt: skip
PLAIN_WORDS = [
    RX28.cw_angle_limit, RX28.ccw_angle_limit, RX28.max_torque, RX28.goal_position, RX28.torque_limit, RX28.punch,
]  # fmt: skip
SPECIAL = [
    RX28.id, RX28.baud_rate, RX28.status_return_level, RX28.reserved_19, RX28.lock, RX28.moving_speed,
]  # fmt: skip
"""Each of these has a test of its own."""
RANGE, ANGLE = 0x08, 0x02
"""Error bits (3-3)."""
few = settings(deadline=None, max_examples=40)
word = st.integers(0, 0xFFFF) | st.integers(900, 2200)
"""Any two bytes, those about the limits more often."""


class Bench:
    """A bus with one virtual RX-28, and its ends."""

    def __init__(self) -> None:
        self.bus = servobus.open("virtual:rx28@1?clock=virtual")
        assert isinstance(self.bus.transport, VirtualPort)
        self.port = self.bus.transport
        self.servo = self.bus.attach(RX28, 1, answers=Answers.EVERYTHING)
        self.virtual = self.port.servos[0]

    def write(self, values: Mapping[Register[Any], int]) -> None:
        self.bus.do(self.servo.family.put(self.servo.target, values, keep=False))

    def read(self, *rows: Register[Any]) -> tuple[int, ...]:
        return tuple(self.servo.read_raw(rows))

    def round_trip(self, row: Register[Any], raw: int) -> None:
        self.write({row: raw})
        assert self.read(row) == (raw,)
        assert self.virtual.memory[row] == raw
        if row.area is Area.EEPROM:
            assert self.virtual.memory.eeprom[row] == raw

    def send(self, row: Register[Any], data: bytes) -> int:
        """Send WRITE_DATA with any bytes; give the error byte of the status packet."""
        assert isinstance(row.place, Address)
        body = bytes((self.virtual.id, len(data) + 3, 3, row.place.address)) + data
        self.port.write(b"\xff\xff" + body + bytes((~sum(body) & 0xFF,)))
        reply = b""
        while len(reply) < 6 and (piece := self.port.read(0.01)):
            reply += piece
        assert (len(reply), reply[:4]) == (6, bytes((0xFF, 0xFF, self.virtual.id, 2)))
        return reply[4]

    def image(self) -> dict[str, int]:
        """Give all that can be set; with the torque off the goal stays where the shaft is."""
        return {row.name: self.virtual.memory[row] for row in WRITABLE}


def edges(row: Register[Any]) -> st.SearchStrategy[int]:
    low, high = row.limits
    return st.integers(low, high) | st.sampled_from((low, low + 1, high - 1, high))


def test_every_register_that_can_be_written_is_here() -> None:
    rows = [*PLAIN_BYTES, *PLAIN_WORDS, *SPECIAL]
    assert len(rows) == len(WRITABLE)
    assert {*rows} == {*WRITABLE}


# Round trips


@pytest.mark.parametrize("row", PLAIN_BYTES, ids=str)
def test_a_byte_comes_back_whatever_it_is(row: Register[Any]) -> None:
    bench = Bench()
    low, high = row.limits
    for raw in range(low, high + 1):
        bench.round_trip(row, raw)


@pytest.mark.parametrize("row", PLAIN_WORDS, ids=str)
@few
@given(data=st.data())
def test_two_bytes_come_back_together(row: Register[Any], data: st.DataObject) -> None:
    bench = Bench()
    for raw in data.draw(st.lists(edges(row), min_size=1, max_size=5)):
        bench.round_trip(row, raw)


@few
@given(limits=st.lists(edges(RX28.cw_angle_limit), min_size=2, max_size=2), goal=edges(RX28.goal_position))
def test_a_goal_comes_back_if_it_is_within_the_angle_limits(limits: list[int], goal: int) -> None:
    low, high = sorted(limits)
    bench = Bench()
    bench.write({RX28.cw_angle_limit: low, RX28.ccw_angle_limit: high})
    assert bench.read(RX28.cw_angle_limit, RX28.ccw_angle_limit) == (low, high)
    before = bench.read(RX28.goal_position)
    if low <= goal <= high or low == high == 0:  # in endless turn there are no limits (D-77)
        bench.round_trip(RX28.goal_position, goal)
    else:
        with pytest.raises(Refused):
            bench.write({RX28.goal_position: goal})
        assert bench.read(RX28.goal_position) == before


@few
@given(raw=edges(RX28.moving_speed))
def test_the_speed_comes_back_and_backwards_in_endless_turn_only(raw: int) -> None:
    bench = Bench()
    if raw >= 0:
        bench.round_trip(RX28.moving_speed, raw)
    else:
        with pytest.raises(Refused):
            bench.write({RX28.moving_speed: raw})
        assert bench.read(RX28.moving_speed) == (0,)
    bench.write({RX28.cw_angle_limit: 0, RX28.ccw_angle_limit: 0})
    bench.round_trip(RX28.moving_speed, raw)


def test_every_id_comes_back_from_the_new_id() -> None:
    bench = Bench()
    for raw in range(254):
        bench.write({RX28.id: raw})
        bench.servo = bench.bus.attach(RX28, raw, answers=Answers.EVERYTHING)
        assert bench.read(RX28.id) == (raw,)


def test_every_speed_of_the_bus_comes_back_at_that_speed() -> None:
    bench = Bench()
    for raw in range(255):
        bench.write({RX28.baud_rate: raw})
        bench.servo = bench.bus.attach(RX28, 1, baud=round(2_000_000 / (raw + 1)), answers=Answers.EVERYTHING)
        assert bench.read(RX28.baud_rate) == (raw,)


def test_every_return_level_comes_back_where_reads_are_answered() -> None:
    bench = Bench()
    for raw in (2, 1, 2):
        bench.servo.write_raw({RX28.status_return_level: raw})
        bench.port.sleep(0.002)
        assert bench.read(RX28.status_return_level) == (raw,)
    bench.servo.write_raw({RX28.status_return_level: 0})
    with pytest.raises(UsageError):
        bench.read(RX28.status_return_level)
    assert bench.virtual.memory[RX28.status_return_level] == 0
    bench.servo.ping()
    bench.servo.write_raw({RX28.status_return_level: 1})  # the servo is silent about it
    bench.port.sleep(0.002)
    assert bench.read(RX28.status_return_level) == (1,)


def test_the_byte_without_a_meaning_takes_0_and_1_and_stays_0() -> None:
    bench = Bench()
    for raw in (1, 0):
        bench.write({RX28.reserved_19: raw})
        assert bench.read(RX28.reserved_19) == (0,)  # ED-22


def test_the_lock_comes_back_and_stays() -> None:
    bench = Bench()
    bench.round_trip(RX28.lock, 0)
    bench.round_trip(RX28.lock, 1)
    with pytest.raises(Refused):
        bench.write({RX28.lock: 0})
    assert bench.read(RX28.lock) == (1,)
    with pytest.raises(Refused):
        bench.write({RX28.punch: 100})
    bench.round_trip(RX28.led, 1)  # 24 .. 35 can be written as before


# Beyond the limits


@pytest.mark.parametrize("row", [row for row in WRITABLE if row.layout.size == 1], ids=str)
def test_a_byte_out_of_range_is_refused(row: Register[Any]) -> None:
    bench = Bench()
    image = bench.image()
    for raw in range(256):
        if not row.accepts(raw):
            assert bench.send(row, bytes((raw,))) == RANGE
            assert bench.image() == image


@pytest.mark.parametrize("row", [row for row in WRITABLE if row.layout.size == 2], ids=str)
@few
@given(raw=word.filter(lambda raw: raw > 1023))
def test_two_bytes_out_of_range_are_refused(row: Register[Any], raw: int) -> None:
    bench = Bench()
    image = bench.image()
    assert bench.send(row, raw.to_bytes(2, "little")) == RANGE
    assert bench.image() == image


@few
@given(raw=word.filter(lambda raw: raw > 2047))
def test_a_speed_beyond_the_direction_bit_is_refused_in_endless_turn_too(raw: int) -> None:
    bench = Bench()
    bench.write({RX28.cw_angle_limit: 0, RX28.ccw_angle_limit: 0})
    image = bench.image()
    assert bench.send(RX28.moving_speed, raw.to_bytes(2, "little")) == RANGE
    assert bench.image() == image


@few
@given(goal=st.integers(0, 1023).filter(lambda goal: not 300 <= goal <= 700) | st.sampled_from((299, 701)))
def test_a_goal_beyond_the_angle_limits_is_refused_with_its_own_bit(goal: int) -> None:
    bench = Bench()
    bench.write({RX28.cw_angle_limit: 300, RX28.ccw_angle_limit: 700})
    image = bench.image()
    assert bench.send(RX28.goal_position, goal.to_bytes(2, "little")) == ANGLE
    assert bench.image() == image


@pytest.mark.parametrize("row", [row for row in RX28.registers.values() if not row.writable], ids=str)
def test_what_can_only_be_read_refuses_every_byte(row: Register[Any]) -> None:
    bench = Bench()
    image, before = bench.image(), bench.virtual.memory.space(TABLE)
    for raw in range(0, 256, 17):
        assert bench.send(row, bytes((raw,)) * row.layout.size) == RANGE
    assert bench.image() == image
    assert bench.virtual.memory.space(TABLE) == before
