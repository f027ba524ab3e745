import pytest

from servobus.core.framing import Packet
from servobus.errors import Refused, WrongReply
from servobus.families.dynamixel import protocol


def test_a_reading_without_its_bytes_and_without_a_reason_is_a_wrong_reply() -> None:
    """Status packets (3-4): one without parameters and without error bits tells nothing; range error is bit 3."""
    asked = protocol.read_data(1, 36, 2)
    with pytest.raises(WrongReply, match="0 bytes of data and refuses nothing"):
        asked.interpret(Packet(1, 0, b""))
    with pytest.raises(Refused, match="range"):
        asked.interpret(Packet(1, 0x08, b""))
