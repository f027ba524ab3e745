"""What a packet asks for, with the golden packets. Who answers what: RX-28 manual 3-4-1 (Status Return Level), 3-5;
DRS-0602 manual 4-2 NO 8 (ACK Policy), 5-2; LewanSoul manual 3 and 4."""

import pytest

from golden.golden import load
from servobus.core.exchange import ReplyPattern
from servobus.core.framing import Packet
from servobus.families.registry import FAMILIES

GOLDEN = {(family, case.name): case.packet for family in FAMILIES for case in load(family)}


@pytest.mark.parametrize(
    ("family", "name", "asks"),
    [
        ("dynamixel", "ex3_ping", (ReplyPattern(1, None, (0,)),)),
        ("dynamixel", "ex1_read_temperature", (ReplyPattern(1, None, (1, 0)),)),
        ("dynamixel", "ex6_read_model", (ReplyPattern(1, None, (3, 0)),)),
        ("dynamixel", "ex16_torque_led_on", (ReplyPattern(1, None, (0,), certain=False),)),
        ("dynamixel", "em_reg_write_500", (ReplyPattern(1, None, (0,), certain=False),)),
        ("dynamixel", "ex4_reset", (ReplyPattern(0, None, (0,), certain=False),)),
        ("dynamixel", "ex20_action", ()),
        ("dynamixel", "ex5_sync_write", ()),
        ("dynamixel", "ex2_broadcast_id", ()),
        ("dynamixel", "ex1_reply", None),
        ("herkulex", "ram_read_request", (ReplyPattern(253, 0x44, (5, 2)),)),
        ("herkulex", "eep_read_request", (ReplyPattern(253, 0x42, (8, 2)),)),
        ("herkulex", "stat_request", (ReplyPattern(253, 0x47, (2,)),)),
        ("herkulex", "stat_broadcast", (ReplyPattern(None, 0x47, (2,)),)),
        ("herkulex", "ram_write_torque_on", (ReplyPattern(253, 0x43, (2,), certain=False),)),
        ("herkulex", "ijog_position", (ReplyPattern(253, 0x45, (2,), certain=False),)),
        ("herkulex", "reboot_broadcast", ()),
        ("herkulex", "sjog_two", ()),
        ("herkulex", "ram_read_reply", None),
        ("herkulex", "stat_reply", None),
        ("lewansoul", "pos_read", (ReplyPattern(1, 28, (2,)),)),
        ("lewansoul", "move_time_read", (ReplyPattern(1, 2, (4,)),)),
        ("lewansoul", "id_read_broadcast", (ReplyPattern(None, 14, (1,)),)),
        ("lewansoul", "move_time_write", ()),
        ("lewansoul", "move_start_broadcast", ()),
        ("lewansoul", "pos_read_answer", None),
    ],
)
def test_golden_packets(family: str, name: str, asks: tuple[ReplyPattern, ...] | None) -> None:
    (packet,) = FAMILIES[family].framing.decode(GOLDEN[family, name])
    assert isinstance(packet, Packet)
    assert FAMILIES[family].replies_to(packet) == asks


def test_nobody_reads_all_servos_at_once() -> None:
    assert FAMILIES["dynamixel"].replies_to(Packet(254, 0x02, b"\x24\x02")) == ()
    assert FAMILIES["herkulex"].replies_to(Packet(254, 0x04, b"\x3a\x02")) == ()
    assert FAMILIES["lewansoul"].replies_to(Packet(254, 28)) == ()


def test_a_herkulex_that_does_not_know_a_command_may_say_so() -> None:
    assert FAMILIES["herkulex"].replies_to(Packet(1, 0x0F)) == (ReplyPattern(1, 0x4F, (2,), certain=False),)
