"""Every register of the LX-16A that can be written: host -> virtual servo -> host gives the same raw value.

And what no driver of ours would send: raw values beyond the limits, in packets made by hand, are cut or
ignored as EL-15 and L-47 have it, and change nothing else.
"""

from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import servobus
from servobus.core.registers import Access, Area, Register
from servobus.errors import BadValue
from servobus.families.lewansoul.models.lx import LX16A
from servobus.virtual.serve.inprocess import VirtualPort

WRITABLE = [row for row in LX16A.registers.values() if row.access is Access.READ_WRITE]
PLAIN_BYTES = [LX16A.angle_offset, LX16A.max_temperature, LX16A.mode, LX16A.torque_enable, LX16A.led, LX16A.led_error]
MOVES = [(LX16A.goal_position, LX16A.goal_time), (LX16A.wait_goal_position, LX16A.wait_goal_time)]
LIMITS = [(LX16A.min_position, LX16A.max_position), (LX16A.min_voltage, LX16A.max_voltage)]
COMMANDS: dict[Register[Any], int] = {
    LX16A.goal_position: 1, LX16A.wait_goal_position: 7, LX16A.id: 13, LX16A.angle_offset: 17,
    LX16A.min_position: 20, LX16A.min_voltage: 22, LX16A.max_temperature: 24, LX16A.mode: 29,
    LX16A.torque_enable: 31, LX16A.led: 33, LX16A.led_error: 35,
}  # fmt: skip
"""The commands by the first register of each (manual 4)."""
few = settings(deadline=None, max_examples=60)
word = st.integers(0, 0xFFFF) | st.integers(0, 1100) | st.integers(4400, 12100)
"""Any two bytes, those about the limits more often."""


class Bench:
    """A bus with one virtual LX-16A, and its ends."""

    def __init__(self) -> None:
        self.bus = servobus.open("virtual:lx16a@1?clock=virtual")
        assert isinstance(self.bus.transport, VirtualPort)
        self.port = self.bus.transport
        self.servo = self.bus.attach(LX16A, 1)
        self.virtual = self.port.servos[0]
        # Before the first move its registers follow the shaft (L-20).
        for position, time in MOVES:
            self.write({position: 500, time: 0})

    def write(self, values: Mapping[Register[Any], int]) -> None:
        """Write as a host does; the write is not answered and takes its time."""
        self.bus.do(self.servo.family.put(self.servo.target, values, keep=False))
        self.port.sleep(0.002)

    def read(self, *rows: Register[Any]) -> tuple[int, ...]:
        return tuple(self.servo.read_raw(rows))

    def send(self, command: int, data: bytes) -> None:
        """Send a command with any parameters; check that nothing comes back."""
        body = bytes((self.virtual.id, len(data) + 3, command)) + data
        self.port.write(b"\x55\x55" + body + bytes((~sum(body) & 0xFF,)))
        assert self.port.read(0.01) == b""

    def image(self) -> dict[str, int]:
        """Give all that can be set, with what is stored of it."""
        memory = self.virtual.memory
        working = {row.name: memory[row] for row in WRITABLE}
        return working | {f"stored {row.name}": memory.eeprom[row] for row in WRITABLE if row.area is Area.EEPROM}


def image_with(image: dict[str, int], *changes: tuple[Register[Any], int], saved: bool = True) -> dict[str, int]:
    for row, raw in changes:
        image = image | {row.name: raw}
        if saved and row.area is Area.EEPROM:
            image = image | {f"stored {row.name}": raw}
    return image


def cut(row: Register[Any], raw: int) -> int:
    return max(row.limits[0], min(raw, row.limits[1]))


def two(*raws: int) -> bytes:
    return b"".join((raw & 0xFFFF).to_bytes(2, "little") for raw in raws)


def edges(row: Register[Any]) -> st.SearchStrategy[int]:
    low, high = row.limits
    return st.integers(low, high) | st.sampled_from((low, low + 1, high - 1, high))


def test_every_register_that_can_be_written_is_here() -> None:
    rows = {*PLAIN_BYTES, *(row for pair in MOVES + LIMITS for row in pair), LX16A.id, LX16A.motor_speed}
    assert rows == {*WRITABLE}


# Round trips


@pytest.mark.parametrize("row", PLAIN_BYTES, ids=str)
def test_a_byte_comes_back_whatever_it_is(row: Register[Any]) -> None:
    bench = Bench()
    low, high = row.limits
    for raw in range(low, high + 1):
        bench.write({row: raw})
        assert bench.read(row) == (raw,)
        assert bench.virtual.memory[row] == raw


def test_the_offset_is_stored_when_it_is_told_to_be() -> None:
    bench = Bench()
    for raw in (-125, -1, 1, 125, 0):
        before = bench.virtual.memory.eeprom[LX16A.angle_offset]
        bench.write({LX16A.angle_offset: raw})
        assert bench.virtual.memory.eeprom[LX16A.angle_offset] == before
        bench.servo.store({LX16A.angle_offset: LX16A.angle_offset.decode(raw)})
        bench.port.sleep(0.002)
        assert bench.virtual.memory.eeprom[LX16A.angle_offset] == raw


def test_every_id_comes_back_from_the_new_id() -> None:
    bench = Bench()
    for raw in range(254):
        bench.write({LX16A.id: raw})
        bench.servo = bench.bus.attach(LX16A, raw)
        assert bench.read(LX16A.id) == (raw,)
        assert bench.virtual.memory.eeprom[LX16A.id] == raw


@pytest.mark.parametrize("move", MOVES, ids=["at once", "kept"])
@few
@given(data=st.data())
def test_moves_come_back(move: tuple[Register[float], Register[float]], data: st.DataObject) -> None:
    position, time = move
    raw, milliseconds, alone = (data.draw(edges(row)) for row in (position, time, position))
    bench = Bench()
    bench.write({position: raw, time: milliseconds})
    assert bench.read(position, time) == (raw, milliseconds)
    bench.write({position: alone})  # a goal alone keeps its time
    assert bench.read(position, time) == (alone, milliseconds)
    with pytest.raises(BadValue):
        bench.write({time: milliseconds})  # a time alone would repeat the move


@pytest.mark.parametrize("pair", LIMITS, ids=["position", "voltage"])
@few
@given(data=st.data())
def test_limits_come_back(pair: tuple[Register[float], Register[float]], data: st.DataObject) -> None:
    lower, upper = pair
    low, high = sorted(data.draw(st.lists(edges(lower), min_size=2, max_size=2, unique=True)))
    bench = Bench()
    bench.write({lower: low, upper: high})
    assert bench.read(lower, upper) == (low, high)
    for row, raw in ((lower, high - 1), (upper, high), (lower, low)):  # one alone leaves the other
        bench.write({row: raw})
        assert bench.read(row) == (raw,)
    assert bench.read(lower, upper) == (low, high)
    assert [bench.virtual.memory.eeprom[row] for row in pair] == [low, high]


@few
@given(raw=edges(LX16A.motor_speed))
def test_the_motor_speed_comes_back_in_motor_mode(raw: int) -> None:
    bench = Bench()
    bench.write({LX16A.motor_speed: raw})
    assert bench.read(LX16A.mode, LX16A.motor_speed) == (0, 0)  # L-62
    bench.write({LX16A.mode: 1, LX16A.motor_speed: raw})
    assert bench.read(LX16A.mode, LX16A.motor_speed) == (1, raw)
    bench.write({LX16A.motor_speed: 0})
    bench.write({LX16A.motor_speed: raw})
    assert bench.read(LX16A.mode, LX16A.motor_speed) == (1, raw)


# Beyond the limits


@pytest.mark.parametrize("row", [row for row in PLAIN_BYTES if row is not LX16A.mode], ids=str)
def test_a_byte_out_of_range_is_cut(row: Register[Any]) -> None:
    bench = Bench()
    image = bench.image()
    low, high = row.layout.range
    for raw in range(low, high + 1):
        if not row.accepts(raw):
            bench.send(COMMANDS[row], row.layout.pack(raw))
            image = image_with(image, (row, cut(row, raw)), saved=row is not LX16A.angle_offset)
            assert bench.image() == image
            assert bench.read(row) == (cut(row, raw),)


@pytest.mark.parametrize("raw", [254, 255])
def test_an_id_that_no_servo_can_have_is_ignored(raw: int) -> None:
    bench = Bench()
    image = bench.image()
    bench.send(13, bytes((raw,)))
    assert bench.image() == image
    assert bench.read(LX16A.id) == (1,)


@pytest.mark.parametrize("move", MOVES, ids=["at once", "kept"])
@few
@given(raws=st.tuples(word, word))
def test_moves_out_of_range_are_cut(move: tuple[Register[float], Register[float]], raws: tuple[int, int]) -> None:
    bench = Bench()
    image = bench.image()
    bench.send(COMMANDS[move[0]], two(*raws))
    expected = tuple(cut(row, raw) for row, raw in zip(move, raws, strict=True))
    assert bench.image() == image_with(image, *zip(move, expected, strict=True))
    assert bench.read(*move) == expected


@pytest.mark.parametrize("pair", LIMITS, ids=["position", "voltage"])
@few
@given(raws=st.tuples(word, word))
def test_limits_out_of_range_are_cut_and_those_that_cross_are_ignored(
    pair: tuple[Register[float], Register[float]], raws: tuple[int, int]
) -> None:
    bench = Bench()
    image = bench.image()
    low, high = (cut(row, raw) for row, raw in zip(pair, raws, strict=True))
    bench.send(COMMANDS[pair[0]], two(*raws))
    assert bench.image() == (image_with(image, (pair[0], low), (pair[1], high)) if low < high else image)


@few
@given(mode=st.integers(0, 255) | st.integers(0, 1), null=st.integers(0, 255), speed=st.integers(-0x8000, 0x7FFF))
def test_a_mode_that_there_is_not_is_ignored_and_the_speed_is_cut(mode: int, null: int, speed: int) -> None:
    bench = Bench()
    bench.write({LX16A.mode: 1, LX16A.motor_speed: 123})
    image = bench.image()
    bench.send(29, bytes((mode, null)) + two(speed))
    kept = {0: (0, 0), 1: (1, cut(LX16A.motor_speed, speed))}.get(mode, (1, 123))
    assert bench.image() == image_with(image, (LX16A.mode, kept[0]), (LX16A.motor_speed, kept[1]))
    assert bench.read(LX16A.mode, LX16A.motor_speed) == kept
