"""What packets say, in words. The bytes are those of tests/golden; the sentences are written by hand."""

import pytest

from golden.golden import load
from servobus import MODELS
from servobus.core.framing import Packet
from servobus.families.base import Model
from servobus.families.dynamixel import protocol as dynamixel1
from servobus.families.herkulex import protocol as herkulex
from servobus.families.registry import DRS0602, LX16A, RX28

GOLDEN = {(model, case.name): case.packet for model in MODELS.values() for case in load(model.family.name)}


def packet(model: type[Model], raw: bytes) -> Packet:
    (event,) = model.family.framing.decode(raw)
    assert isinstance(event, Packet)
    return event


def golden(model: type[Model], name: str, after: str | None = None, *, table: bool = True) -> str:
    """Explain a packet of the manuals, behind another one and with the model's table or without."""
    request = packet(model, GOLDEN[model, after]) if after else None
    return model.family.explain(packet(model, GOLDEN[model, name]), request, model if table else None)


def rx28(message: dynamixel1.Instruction | dynamixel1.Status, after: dynamixel1.Instruction | None = None) -> str:
    request = packet(RX28, dynamixel1.encode(after)) if after else None
    return RX28.family.explain(packet(RX28, dynamixel1.encode(message)), request, RX28)


def drs0602(message: herkulex.Request | herkulex.Ack) -> str:
    return DRS0602.family.explain(packet(DRS0602, herkulex.encode(message)), None, DRS0602)


# Dynamixel


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("ex3_ping", "PING id 1"),
        ("ex1_read_temperature", "READ_DATA id 1: 1 byte from address 43, present_temperature"),
        ("ex6_read_model", "READ_DATA id 1: 3 bytes from address 0, model_number, firmware_version"),
        ("ex17_goto_512", "WRITE_DATA id 1: goal_position 150.1°, moving_speed 341.0°/s"),
        ("wheel_cw_half", "WRITE_DATA id 1: moving_speed -341.0°/s"),
        ("ex2_broadcast_id", "WRITE_DATA to all: id 1"),
        ("ex8_baud_1m", "WRITE_DATA id 1: baud_rate 1000000 baud"),
        ("ex9_return_delay", "WRITE_DATA id 1: return_delay_time 4 µs"),
        ("ex12_voltage_limits", "WRITE_DATA id 1: lowest_limit_voltage 10.0 V, highest_limit_voltage 17.0 V"),
        ("ex13_max_torque_half", "WRITE_DATA id 1: max_torque 50.0 %"),
        ("ex15_alarm_overheat", "WRITE_DATA id 1: alarm_led overheating, alarm_shutdown overheating"),
        ("ex16_torque_led_on", "WRITE_DATA id 1: torque_enable on, led on"),
        ("em_reg_write_500", "REG_WRITE id 1: goal_position 146.6°"),
        ("ex20_action", "ACTION to all"),
        ("ex4_reset", "RESET id 0"),
        ("status_example", "status of id 1: ALARM overheating+overload"),
        ("ex3_reply", "status of id 1: ok"),
        ("ex1_reply", "status of id 1: ok, 20"),
    ],
)
def test_dynamixel(name: str, words: str) -> None:
    assert golden(RX28, name) == words


def test_dynamixel_sync_write() -> None:
    first, second = golden(RX28, "em_sync_write_two").split("; ")
    assert first == "SYNC_WRITE to all, for ids 0, 1: id 0: goal_position 4.7°, moving_speed 223.8°/s"
    assert second == "id 1: goal_position 159.5°, moving_speed 575.4°/s"


def test_dynamixel_answers() -> None:
    assert golden(RX28, "ex1_reply", "ex1_read_temperature") == "status of id 1: ok, present_temperature 32 °C"
    assert golden(RX28, "ex6_reply", "ex6_read_model") == "status of id 1: ok, model_number 28, firmware_version 8"
    assert golden(RX28, "ex3_ping", "ex3_ping") == "status of id 1: ALARM input_voltage"
    assert golden(RX28, "ex17_reply", "ex17_goto_512") == "status of id 1: ok"


def test_dynamixel_refusals() -> None:
    read = dynamixel1.ReadData(1, 36, 2)
    error = dynamixel1.Error
    assert rx28(dynamixel1.Status(1, error.RANGE), read) == "status of id 1: refused, range"
    both = dynamixel1.Status(1, error.RANGE | error.INSTRUCTION | error.OVERLOAD)
    assert rx28(both) == "status of id 1: refused, range+instruction; ALARM overload"
    warm = dynamixel1.Status(1, error.OVERHEATING, b"\x00\x02")
    assert rx28(warm, read) == "status of id 1: ALARM overheating, present_position 150.1°"


@pytest.mark.parametrize(
    "after",
    [
        dynamixel1.Ping(2),  # another id
        dynamixel1.ReadData(1, 43, 1),  # another length
        dynamixel1.WriteData(1, 25, b"\x01"),
        dynamixel1.ReadData(1, 36, 2),  # the same again
    ],
)
def test_dynamixel_what_does_not_fit_is_no_answer(after: dynamixel1.Instruction) -> None:
    asked = dynamixel1.ReadData(1, 36, 2)
    assert rx28(asked, after) == "READ_DATA id 1: 2 bytes from address 36, present_position"


def test_dynamixel_nobody_answers_as_all() -> None:
    assert rx28(dynamixel1.Action(254), dynamixel1.Action(254)) == "ACTION to all"
    assert RX28.family.explain(Packet(254, 0x91), None, RX28) == "undefined instruction 0x91, to all"


@pytest.mark.parametrize(
    ("address", "data", "words"),
    [
        (36, "00", "address 36: 00"),
        (37, "00 02", "address 37: 00 02"),
        (37, "02 00 06", "address 37: 02, present_speed -341.0°/s"),
        (30, "00 02 00", "goal_position 150.1°, address 32: 00"),
        (49, "00 01 02", "address 49: 00 01 02"),
        (16, "09", "status_return_level 9"),
    ],
)
def test_bytes_that_are_no_whole_register_stay_bytes(address: int, data: str, words: str) -> None:
    assert rx28(dynamixel1.WriteData(1, address, bytes.fromhex(data))) == f"WRITE_DATA id 1: {words}"


def test_half_a_register_is_not_named_where_it_is_read() -> None:
    assert rx28(dynamixel1.ReadData(1, 37, 1)) == "READ_DATA id 1: 1 byte from address 37"
    assert rx28(dynamixel1.ReadData(1, 37, 3)) == "READ_DATA id 1: 3 bytes from address 37, present_speed"


# HerkuleX


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("eep_read_request", "EEP_READ id 253: 4 bytes from address 30, position_kp, position_kd"),
        ("eep_read_reply", "ACK of EEP_READ from id 253: position_kp 55, position_kd 1000"),
        ("eep_write_request", "EEP_WRITE id 253: position_kp 25, position_kd 125"),
        ("ram_write_torque_on", "RAM_WRITE id 253: torque_control on"),
        ("ram_write_led_green", "RAM_WRITE id 253: led_control green"),
        ("ram_write_clear_status", "RAM_WRITE id 253: status_error none, status_detail none"),
        ("aux_center", "RAM_WRITE id 253: aux_1 centre"),
        ("read_calibrated_position", "RAM_READ id 253: 2 bytes from address 58, calibrated_position"),
        ("ram_read_reply", "ACK of RAM_READ from id 253: led_control green; inposition+torque_on"),
        ("ijog_center", "I_JOG id 253: id 253 to 0.0° (green, playtime 672 ms)"),
        ("ijog_velocity_negative", "I_JOG id 253: id 253 turns at -198.4°/s (blue, playtime 672 ms)"),
        ("sjog_two", "S_JOG to all, playtime 672 ms: id 1 to 0.0° (green), id 2 to 159.6° (green)"),
        ("stat_request", "STAT id 253"),
        ("stat_broadcast", "STAT to all"),
        ("stat_reply", "ACK of STAT from id 253: torque_on"),
        ("rollback_request", "ROLLBACK id 253, keeping id and baud"),
        ("rollback_reply", "ACK of ROLLBACK from id 253: ok"),
        ("reboot_request", "REBOOT id 253"),
    ],
)
def test_herkulex(name: str, words: str) -> None:
    assert golden(DRS0602, name) == words


def test_herkulex_jogs() -> None:
    jogs = (
        herkulex.Jog(1, 0, stop=True),
        herkulex.Jog(2, 0, invalid=True),
        herkulex.Jog(254, 16384, led=herkulex.Led.RED | herkulex.Led.BLUE, no_override=True),
    )
    words = "id 1 stops (lights off), id 2 left alone, all to 0.0° (blue+red, from speed 0)"
    assert drs0602(herkulex.SJog(254, 0, jogs)) == f"S_JOG to all, playtime 0 s: {words}"


def test_herkulex_alarms_and_refusals() -> None:
    error, detail = herkulex.StatusError, herkulex.StatusDetail
    hot = herkulex.Ack(1, herkulex.Code.RAM_READ, b"\x34\x01\x41", error.TEMPERATURE | error.OVERLOAD, detail(0))
    alarm = "ALARM temperature+overload"
    assert drs0602(hot) == f"ACK of RAM_READ from id 1: torque_control raw 65 (no known meaning); {alarm}"
    bad = herkulex.Ack(1, herkulex.Code.EEP_READ, b"", error.INVALID_PACKET, detail.EXCEED_REG_RANGE)
    assert drs0602(bad) == "ACK of EEP_READ from id 1: ALARM invalid_packet; exceed_reg_range"
    odd = herkulex.Ack(1, herkulex.Code.RAM_READ, b"\x34\x02\x60", error(0), detail(0))
    assert drs0602(odd) == "ACK of RAM_READ from id 1: 34 02 60"


def test_herkulex_the_two_maps_are_told_apart() -> None:
    assert drs0602(herkulex.EepWrite(1, 6, b"\x05")) == "EEP_WRITE id 1: id 5"
    assert drs0602(herkulex.RamWrite(1, 6, b"\x5f")) == "RAM_WRITE id 1: min_voltage 9.5 V"
    assert drs0602(herkulex.RamWrite(1, 6, b"")) == "RAM_WRITE id 1: nothing at address 6"
    assert drs0602(herkulex.Rollback(1)) == "ROLLBACK id 1, keeping nothing"


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (0x0A, "MI_JOG (command 0x0a of the DRS-03xx), id 1"),
        (0x0B, "MS_JOG (command 0x0b of the DRS-03xx), id 1"),
        (0x0C, "CALSET (command 0x0c of the DRS-03xx), id 1"),
        (0x4A, "ACK of MI_JOG (command 0x0a of the DRS-03xx), id 1"),
    ],
)
def test_herkulex_commands_of_other_models_are_named(code: int, said: str) -> None:
    """HerkuleX_manager_MFC, herkulex_protocol.h: multi-turn JOGs and the setting of a zero."""
    assert DRS0602.family.explain(Packet(1, code, b"\x00\x00"), None, DRS0602) == said


def test_herkulex_broken_requests() -> None:
    assert DRS0602.family.explain(Packet(1, 0x0D), None, DRS0602) == "unknown command 0x0d, id 1"
    assert DRS0602.family.explain(Packet(254, 7, b"\x00"), None, DRS0602) == "STAT with 1 data bytes, to all"


# LewanSoul


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("move_time_write", "SERVO_MOVE_TIME_WRITE id 1: goal_position 120.0°, goal_time 1 s"),
        ("move_time_wait_write", "SERVO_MOVE_TIME_WAIT_WRITE id 1: wait_goal_position 180.0°, wait_goal_time 500 ms"),
        ("move_start_broadcast", "SERVO_MOVE_START to all"),
        ("id_write", "SERVO_ID_WRITE id 1: id 2"),
        ("id_read_answer", "answer to SERVO_ID_READ id 1: id 1"),
        ("angle_offset_adjust", "SERVO_ANGLE_OFFSET_ADJUST id 1: angle_offset -12.0°"),
        ("vin_limit_write", "SERVO_VIN_LIMIT_WRITE id 1: min_voltage 6.5 V, max_voltage 12.0 V"),
        ("mode_write_motor", "SERVO_OR_MOTOR_MODE_WRITE id 1: mode motor, motor_speed -50.0 %"),
        ("load_write", "SERVO_LOAD_OR_UNLOAD_WRITE id 1: torque_enable on"),
        ("led_ctrl_write", "SERVO_LED_CTRL_WRITE id 1: led off"),
        ("pos_read", "SERVO_POS_READ id 1"),
        ("pos_read_answer", "answer to SERVO_POS_READ id 1: present_position -2.9°"),
        ("temp_read_answer", "answer to SERVO_TEMP_READ id 1: present_temperature 36 °C"),
    ],
)
def test_lewansoul(name: str, words: str) -> None:
    assert golden(LX16A, name) == words


def test_lewansoul_broken_requests() -> None:
    assert LX16A.family.explain(Packet(1, 99), None, LX16A) == "unknown command 99, id 1"
    assert LX16A.family.explain(Packet(254, 1, b"\x01"), None, LX16A).endswith("with 1 parameter bytes, to all")


# All


@pytest.mark.parametrize(
    ("model", "name", "words"),
    [
        (RX28, "ex10_ccw_limit", "WRITE_DATA id 1: address 8: 00 02"),
        (RX28, "ex1_read_temperature", "READ_DATA id 1: 1 byte from address 43"),
        (DRS0602, "eep_read_reply", "ACK of EEP_READ from id 253: address 30: B8 01 40 1F"),
        (DRS0602, "ijog_center", "I_JOG id 253: id 253 to 16384 (green, playtime 672 ms)"),
        (LX16A, "move_time_write", "SERVO_MOVE_TIME_WRITE id 1, angle 500, time_ms 1000"),
    ],
)
def test_without_a_model_there_are_no_names(model: type[Model], name: str, words: str) -> None:
    assert golden(model, name, table=False) == words


@pytest.mark.parametrize(("model", "name"), GOLDEN)
def test_no_packet_is_explained_by_a_repr(model: type[Model], name: str) -> None:
    assert not set("<>=[]'") & set(golden(model, name))
