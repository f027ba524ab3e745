"""Raw values with bits beyond those of their register: none is dropped, and each is said to be out of range (T3)."""

import pytest

import extent
import servobus
from samples import every_model, sample_models
from servobus import DRS0602, MODELS, RX28, BadReading, deg
from servobus.core.present import value_entry, value_text
from servobus.core.registers import U8, U16, Int, Register
from servobus.core.units import Count, Switch
from servobus.errors import BusError
from servobus.families.dynamixel.firmware import ComplianceServo
from servobus.families.dynamixel.places import TABLE, Address
from unit.scripted import Scripted


def status(data: str) -> str:
    """A status packet of id 1 without an error; the checksum is that of RX-28 manual 3-3."""
    body = bytes((1, len(bytes.fromhex(data)) + 2, 0)) + bytes.fromhex(data)
    return (b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))).hex()


@sample_models
def test_T3_every_word_of_every_row_goes_back_or_is_out_of_range(key: str) -> None:
    """All 65536 words of each row of two bytes; without `--all`, of one row of each layout."""
    rows = [row for row in MODELS[key].registers.values() if row.layout.size == 2]
    for row in rows if extent.everything else {row.layout: row for row in rows}.values():
        unpack, pack, flags = row.layout.unpacker(), row.layout.pack, row.layout.flags
        for word in range(1 << 16):
            data = word.to_bytes(2, "little")
            raw = unpack(data)
            assert raw == row.layout.unpack(data)
            if row.holds(raw):
                back = int.from_bytes(pack(raw), "little")
                negative_zero = row.layout.sign_bit is not None and word == 1 << row.layout.sign_bit
                assert back == word & ~flags or negative_zero, f"{row} {word:#06x}"
            else:
                assert raw == word, f"{row} {word:#06x}"
                assert row.said(raw) == f"out of range (raw {word:#06x})"


@every_model
def test_T3_what_a_row_holds_is_what_encode_takes_back(key: str) -> None:
    for row in MODELS[key].registers.values():
        low, high = row.layout.range
        for raw in {low, low + 1, 0, 1, high - 1, high}:
            try:
                value = row.decode(raw)
            except BadReading:
                continue  # a code without a known meaning
            assert row.scale.encode(value) == raw or isinstance(row.scale, Switch), f"{row} {raw}"


@pytest.mark.parametrize(
    ("word", "raw", "said"),
    [
        (0x0151, 337, "224.4°/s"),
        (0x0551, -337, "-224.4°/s"),
        (0x0D51, 0x0D51, "out of range (raw 0x0d51)"),
        (0xFFFF, 0xFFFF, "out of range (raw 0xffff)"),
        (0x0800, 0x0800, "out of range (raw 0x0800)"),
        (0x0400, 0, "0.0°/s"),  # minus zero
        (0x07FF, -1023, "-681.3°/s"),
    ],
)
def test_T3_the_speed_of_an_rx28_has_a_sign_in_bit_10_and_nothing_above(word: int, raw: int, said: str) -> None:
    assert RX28.present_speed.layout.unpack(word.to_bytes(2, "little")) == raw
    assert value_text(RX28.present_speed, raw) == said


def test_T3_json_keeps_the_raw_word_and_gives_no_value() -> None:
    assert value_entry(RX28.present_speed, 0x0D51) == {"value": None, "unit": "°/s", "raw": 0x0D51}


def test_T3_a_position_of_ten_bits() -> None:
    assert value_text(RX28.present_position, 512) == "150.1°"
    assert value_text(RX28.present_position, 0x8200) == "out of range (raw 0x8200)"
    assert value_text(RX28.ccw_angle_limit, 0xFFFF) == "out of range (raw 0xffff)"


@pytest.mark.parametrize("word", [0x4000, 0xC000])
def test_T3_P8_bit_15_of_a_herkulex_position_is_no_part_of_it(word: int) -> None:
    """The maker's PC tool masks it off with 0x7FFF. 16384 is 0°."""
    layout = DRS0602.present_position.layout
    assert layout.unpack(word.to_bytes(2, "little")) == 16384
    assert layout.flags_in(word.to_bytes(2, "little")) == word & 0x8000
    assert layout.unpacker()(word.to_bytes(2, "little")) == 16384


def test_T3_the_driver_refuses_a_reading_that_cannot_be() -> None:
    servo = servobus.Bus(Scripted(*[status("51 0D")] * 9), echo=False).attach(RX28, 1)
    with pytest.raises(BadReading, match=r"RX-28 id 1: present_speed is out of range \(raw 0x0d51\)") as refused:
        servo.read(RX28.present_speed)
    assert isinstance(refused.value, BusError)
    with pytest.raises(BadReading):
        servo.read_many(["present_speed"])
    assert servo.read_raw(["present_speed"]) == [0x0D51]


def test_T3_P8_the_driver_reads_a_position_with_flag_bits() -> None:
    # size ^ id ^ command ^ data = 0D^01^44^3A^02^00^C0 = B0 -> B0, 4E
    port = Scripted("FF FF 0D 01 44 B0 4E 3A 02 00 C0 00 00", baud=115_200)
    servo = servobus.Bus(port, echo=False).attach(DRS0602, 1)
    assert servo.read(DRS0602.present_position) == pytest.approx(0.0)


def test_T3_a_code_without_meaning_is_an_error_of_the_driver_too() -> None:
    # torque control 41: 0C^01^44^34^01^41 = 3D -> 3C, C2
    port = Scripted("FF FF 0C 01 44 3C C2 34 01 41 00 00", baud=115_200)
    servo = servobus.Bus(port, echo=False).attach(DRS0602, 1)
    with pytest.raises(BadReading, match=r"DRS-0602 id 1: torque_control is raw 65 \(no known meaning\)"):
        servo.read(DRS0602.torque_control)


def test_T3_a_servo_whose_position_cannot_be_is_found_and_can_be_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    sense = ComplianceServo._sense

    def nonsense(self: ComplianceServo) -> None:
        sense(self)
        self.memory.write(TABLE, 36, b"\x00\x82")

    monkeypatch.setattr(ComplianceServo, "_sense", nonsense)
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        (servo,) = bus.scan(ids=[1])
        assert servo.model is RX28
        with pytest.raises(BadReading, match=r"present_position is out of range \(raw 0x8200\)"):
            servo.read(RX28.present_position)
        servo.torque_off()


def test_T3_a_switch_that_reads_neither_0_nor_1() -> None:
    assert RX28.led.said(1) == "on"
    assert RX28.led.said(5) == "on (raw 5)"


def test_a_model_that_counts_further_has_the_width_of_its_bytes() -> None:
    wider = RX28.goal_position.with_(limits=(0, 4095))
    assert (wider.layout, wider.limits) == (U16, (0, 4095))
    assert RX28.goal_position.with_(meaning="goal").layout == Int(2, bits=10)
    assert RX28.present_position.with_(scale=Count()).said(4000) == "4000"
    assert RX28.goal_position.with_(scale=Count()).limits == (0, 1023)


def test_flags_are_the_uppermost_bits() -> None:
    class Strange:
        row = Register(Address(0), Int(2, flags=0x4000), Count(), "a gap")

    from servobus.core.registers import check_row  # noqa: PLC0415 - for this test alone

    with pytest.raises(TypeError, match="flags 0x4000"):
        check_row(Strange.row)
    check_row(Register(Address(0), U8, Count(), "none"))
    assert RX28.present_position.decode(1023) == pytest.approx(300 * deg)
