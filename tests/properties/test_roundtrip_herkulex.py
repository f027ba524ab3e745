"""Every register of the DRS-0602 that can be written: host -> virtual servo -> host gives the same raw value.

And what no driver of ours would send: raw values beyond the limits, in packets made by hand, are refused as
H-40 has it, and change nothing.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import servobus
from servobus.core.registers import Access, Register
from servobus.families.herkulex.models.magnetic import DRS0602
from servobus.families.herkulex.places import EEP, RAM, Eep, EepRam, Ram
from servobus.families.herkulex.protocol import Aux, eep_read, ram_read
from servobus.virtual.serve.inprocess import VirtualPort

WRITABLE = [row for row in DRS0602.registers.values() if row.access is Access.READ_WRITE]
SPECIAL = [
    DRS0602.baud_rate, DRS0602.id, DRS0602.ack_policy, DRS0602.status_error, DRS0602.status_detail, DRS0602.aux_1,
    DRS0602.torque_control, DRS0602.led_control,
]  # fmt: skip
"""Each of these has a test of its own."""
PLAIN_BYTES = [row for row in WRITABLE if row not in SPECIAL and row.layout.size == 1]
PLAIN_WORDS = [row for row in WRITABLE if row not in SPECIAL and row.layout.size == 2]
REFUSED = (0x08, 0x10)
"""Status Error and Status Detail of a write that may not be (H-15, H-38, H-40)."""
CAUSES = 0x3C
EEP_WRITE, RAM_WRITE, STAT, REBOOT = 1, 3, 7, 9
SIZES = {EEP_WRITE: 54, RAM_WRITE: 74}
few = settings(deadline=None, max_examples=20)


class Bench:
    """A bus with one virtual DRS-0602, and its ends."""

    def __init__(self) -> None:
        self.bus = servobus.open("virtual:drs0602@1?clock=virtual&voltage=14.8")
        assert isinstance(self.bus.transport, VirtualPort)
        self.port = self.bus.transport
        self.servo = self.bus.attach(DRS0602, 1)
        self.virtual = self.port.servos[0]

    def write(self, row: Register[Any], raw: int) -> None:
        self.bus.do(self.servo.family.put(self.servo.target, {row: raw}, keep=False))

    def read(self, row: Register[Any]) -> int:
        (raw,) = self.servo.read_raw([row])
        return raw

    def read_stored(self, *rows: Register[Any]) -> list[int]:
        return self.bus.do(self.servo.family.read_stored(self.servo.target, rows))

    def store(self, values: Mapping[Register[Any], int]) -> None:
        self.bus.do(self.servo.family.put(self.servo.target, values, keep=True))

    def round_trip(self, values: Mapping[Register[Any], int]) -> None:
        """Write registers that are in both maps: for now, then for good."""
        rows, raws = [*values], [*values.values()]
        stored = [self.virtual.memory.eeprom[row] for row in rows]
        # As they are: limits that cross, which `write` refuses, have bytes too.
        self.bus.do(self.servo.family.put(self.servo.target, values, keep=False))
        assert self.servo.read_raw(rows) == raws
        assert self.read_stored(*rows) == stored
        assert [self.virtual.memory[row] for row in rows] == raws
        self.store(values)
        assert self.read_stored(*rows) == raws
        assert self.servo.read_raw(rows) == raws
        assert [self.virtual.memory.eeprom[row] for row in rows] == raws

    def send(self, command: int, data: bytes = b"") -> bytes:
        """Send any packet; give the bytes that come back."""
        size = len(data) + 7
        xor = size ^ self.virtual.id ^ command
        for byte in data:
            xor ^= byte
        self.port.write(bytes((0xFF, 0xFF, size, self.virtual.id, command, xor & 0xFE, ~xor & 0xFE)) + data)
        reply = b""
        while piece := self.port.read(0.01):
            reply += piece
        return reply

    def put(self, command: int, address: int, data: bytes) -> tuple[int, int]:
        """Clear the status and write any bytes; give what the status is then, less what only shows the state."""
        self.send(RAM_WRITE, bytes((48, 2, 0, 0)))
        reply = self.send(command, bytes((address, len(data))) + data)
        assert len(reply) == (9 if self.virtual.memory[DRS0602.ack_policy] == 2 else 0)
        error, detail = self.send(STAT)[-2:]
        return error, detail & CAUSES

    def image(self) -> tuple[bytes, bytes]:
        """Give all that can be set, less the status."""
        ram = self.virtual.memory.space(RAM)
        return self.virtual.memory.space(EEP), ram[:48] + ram[50:54]


def addresses(row: Register[Any]) -> list[tuple[int, int]]:
    """Give the commands that write a register, with its address there."""
    match row.place:
        case EepRam(eep, ram):
            return [(EEP_WRITE, eep), (RAM_WRITE, ram)]
        case Eep(eep):
            return [(EEP_WRITE, eep)]
        case Ram(ram):
            return [(RAM_WRITE, ram)]
    raise AssertionError(row)


def edges(row: Register[Any]) -> st.SearchStrategy[int]:
    low, high = row.limits
    return st.integers(low, high) | st.sampled_from((low, low + 1, high - 1, high))


def refused(row: Register[Any]) -> list[int]:
    low, high = row.layout.range
    return [raw for raw in range(low, high + 1) if not row.accepts(raw)]


def test_every_register_that_can_be_written_is_here() -> None:
    assert {*PLAIN_BYTES, *PLAIN_WORDS, *SPECIAL} == {*WRITABLE}


# Round trips


def test_bytes_come_back_whatever_they_are() -> None:
    bench = Bench()
    seen: set[tuple[str, int]] = set()
    for raw in range(-0x80, 0x100):
        values = {row: raw for row in PLAIN_BYTES if row.accepts(raw)}
        bench.round_trip(values)
        seen |= {(row.name, raw) for row in values}
    assert len(seen) == sum(row.limits[1] - row.limits[0] + 1 for row in PLAIN_BYTES)


@pytest.mark.parametrize("row", PLAIN_WORDS, ids=str)
def test_two_bytes_come_back_at_their_limits(row: Register[Any]) -> None:
    bench = Bench()
    low, high = row.limits
    for raw in (low, low + 1, max(low, -1), 0, 1, 0xFF, 0x100, high - 1, high):
        bench.round_trip({row: raw})


@settings(deadline=None, max_examples=60)
@given(st.fixed_dictionaries({row: edges(row) for row in PLAIN_BYTES + PLAIN_WORDS}))
def test_all_come_back_together(values: dict[Register[Any], int]) -> None:
    Bench().round_trip(values)


def test_every_id_comes_back_from_the_new_id() -> None:
    bench = Bench()
    for raw in range(254):
        before = bench.virtual.memory.eeprom[DRS0602.id]
        bench.write(DRS0602.id, raw)
        bench.servo = bench.bus.attach(DRS0602, raw)
        assert bench.read(DRS0602.id) == raw
        assert bench.read_stored(DRS0602.id) == [before]
        bench.store({DRS0602.id: raw})
        assert bench.read_stored(DRS0602.id) == [raw]


def test_every_speed_comes_back_and_acts_after_the_restart() -> None:
    bench = Bench()
    assert DRS0602.baud_rate.allowed is not None
    for raw in (*DRS0602.baud_rate.allowed, 0x10):
        bench.write(DRS0602.baud_rate, raw)
        assert bench.read(DRS0602.baud_rate) == raw
        bench.send(REBOOT)
        bench.port.sleep(0.5)
        baud = DRS0602.baud_rate.decode(raw)
        bench.port.set_baud(baud)
        bench.servo = bench.bus.attach(DRS0602, 1, baud=baud)
        assert bench.read(DRS0602.baud_rate) == raw


def test_the_ack_policy_decides_what_comes_back() -> None:
    bench = Bench()
    for raw in (2, 1, 2, 0):
        bench.servo.write_raw({DRS0602.ack_policy: raw})
        assert bench.port.servos[0].memory[DRS0602.ack_policy] == raw
        assert (bench.send(4, bytes((1, 1))) != b"") == (raw > 0)
        assert (bench.send(RAM_WRITE, bytes((53, 1, 0))) != b"") == (raw > 1)
    bench.servo.write_raw({DRS0602.ack_policy: 1})
    assert bench.read(DRS0602.ack_policy) == 1


def test_status_error_comes_back_but_for_the_driver_fault() -> None:
    bench = Bench()
    for raw in range(0x80):
        bench.write(DRS0602.status_error, raw)
        assert bench.read(DRS0602.status_error) == raw & 0x5F  # H-59


def test_status_detail_comes_back_as_far_as_it_can_be_set() -> None:
    bench = Bench()
    for raw in range(0x80):
        bench.write(DRS0602.status_detail, raw)
        assert bench.read(DRS0602.status_detail) == raw & CAUSES  # H-41


def test_aux_1_acts_and_comes_back_as_0() -> None:
    bench = Bench()
    for raw in Aux:
        bench.write(DRS0602.aux_1, raw)
        assert bench.read(DRS0602.aux_1) == 0  # H-104


@pytest.mark.parametrize(
    ("row", "raws"), [(DRS0602.torque_control, (0, 0x40, 0x60, 0)), (DRS0602.led_control, range(8))]
)
def test_what_is_in_ram_only_comes_back(row: Register[Any], raws: Sequence[int]) -> None:
    bench = Bench()
    for raw in raws:
        bench.write(row, raw)
        assert bench.read(row) == bench.virtual.memory[row] == raw


# Beyond the limits


@pytest.mark.parametrize(
    "row", [row for row in WRITABLE if row.layout.size == 1 and row is not DRS0602.torque_control], ids=str
)
def test_a_byte_out_of_range_is_refused(row: Register[Any]) -> None:
    bench = Bench()
    image = bench.image()
    for raw in refused(row):
        for command, address in addresses(row):
            assert bench.put(command, address, row.layout.pack(raw)) == REFUSED
            assert bench.image() == image


def test_torque_control_has_no_value_out_of_range() -> None:
    bench = Bench()
    for raw in range(0x100):
        assert bench.put(RAM_WRITE, 52, bytes((raw,))) == (0, 0)
        assert bench.read(DRS0602.torque_control) == {0: 0, 0x20: 0, 0x40: 0x40, 0x60: 0x60}[raw & 0x60]  # H-46


@pytest.mark.parametrize("row", PLAIN_WORDS, ids=str)
@few
@given(data=st.data())
def test_two_bytes_out_of_range_are_refused(row: Register[Any], data: st.DataObject) -> None:
    (least, most), (low, high) = row.layout.range, row.limits
    outside = st.integers(high + 1, most) | st.sampled_from((high + 1, most))
    if least < low:
        outside |= st.integers(least, low - 1) | st.sampled_from((least, low - 1))
    bench = Bench()
    image = bench.image()
    for raw in data.draw(st.lists(outside, min_size=1, max_size=5)):
        for command, address in addresses(row):
            assert bench.put(command, address, row.layout.pack(raw)) == REFUSED
            assert bench.image() == image


@pytest.mark.parametrize("row", [row for row in DRS0602.registers.values() if row.access is Access.READ], ids=str)
def test_what_can_only_be_read_is_refused(row: Register[Any]) -> None:
    bench = Bench()
    image = bench.image()
    for command, address in addresses(row):
        for raw in row.layout.range:
            assert bench.put(command, address, row.layout.pack(raw)) == REFUSED
            assert bench.image() == image


@pytest.mark.parametrize("row", [row for row in DRS0602.registers.values() if row.access is Access.RESERVED], ids=str)
def test_what_is_reserved_stays_0(row: Register[Any]) -> None:
    bench = Bench()
    image = bench.image()
    for command, address in addresses(row):
        for raw in range(0x100):
            assert bench.put(command, address, bytes((raw,))) == (0, 0)
            assert bench.image() == image


KEEPS_ITS_WORD = {
    EEP_WRITE: [at for at in range(54) if at not in (5, 10, 51)],
    RAM_WRITE: [at for at in range(48) if at not in (4, 45)] + [53],
}
"""Addresses that read back what is written: all but reserved bytes, status, Aux 1 and Torque Control."""


@few
@given(
    command=st.sampled_from((EEP_WRITE, RAM_WRITE)),
    address=st.integers(0, 80),
    data=st.binary(max_size=8) | st.lists(st.integers(0, 2), max_size=8).map(bytes),
)
def test_a_write_is_taken_whole_or_not_at_all(command: int, address: int, data: bytes) -> None:
    bench = Bench()
    image = bench.image()
    status = bench.put(command, address, data)
    end = address + len(data)
    if status == REFUSED:
        assert bench.image() == image
        return
    assert end <= SIZES[command]
    memory = bench.virtual.memory.space(EEP) if command == EEP_WRITE else bench.virtual.memory.space(RAM)
    for at in KEEPS_ITS_WORD[command]:
        if address <= at < end:
            assert memory[at] == data[at - address]


@few
@given(command=st.sampled_from((2, 4)), address=st.integers(0, 255), length=st.integers(1, 212))
def test_a_read_is_answered_whole_or_not_at_all(command: int, address: int, length: int) -> None:
    bench = Bench()
    reading = eep_read if command == 2 else ram_read
    inside = address + length <= (54 if command == 2 else 74)
    if inside:
        assert len(bench.bus.do(reading(1, address, length))) == length
    else:
        with pytest.raises(servobus.Refused):
            bench.bus.do(reading(1, address, length))
