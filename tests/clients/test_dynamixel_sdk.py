"""ROBOTIS' own DYNAMIXEL SDK drives virtual servos over a pseudo terminal, each test its own."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

sdk = pytest.importorskip("dynamixel_sdk")

Serve = Callable[..., str]
Eventually = Callable[[Callable[[], bool]], None]
OK = (0, 0)
"""COMM_SUCCESS, no error bit."""


class Port:
    """The SDK's port and packet handler, and its functions without their names' tails."""

    def __init__(self, name: str) -> None:
        self.port = sdk.PortHandler(name)
        self.port.baudrate = 57_600  # what openPort opens it at; the servos are at their factory speed
        assert self.port.openPort()
        self.packets = sdk.PacketHandler(1.0)

    def __getattr__(self, name: str) -> Any:
        call = getattr(self.packets, name)
        return lambda *arguments: call(self.port, *arguments)

    def word(self, id: int, address: int) -> int:
        value, *state = self.read2ByteTxRx(id, address)
        assert tuple(state) == OK
        assert isinstance(value, int)
        return value

    def byte(self, id: int, address: int) -> int:
        value, *state = self.read1ByteTxRx(id, address)
        assert tuple(state) == OK
        assert isinstance(value, int)
        return value


@pytest.fixture(scope="module")
def port(serve: Serve) -> Iterator[Port]:
    port = Port(serve("rx28@2-10"))
    with pytest.MonkeyPatch.context() as patch:
        # The SDK gives an answer 34 ms, which a busy computer may exceed without any servo's fault.
        patch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 150)
        yield port
    port.port.closePort()


def test_ping_read_write(port: Port) -> None:
    assert port.ping(2) == (28, 0, 0)
    assert port.ping(10) == (28, 0, 0)
    assert port.ping(11)[1] == sdk.COMM_RX_TIMEOUT
    assert [port.byte(2, address) for address in (3, 4, 5, 11, 12, 13)] == [2, 34, 250, 80, 60, 240]
    assert [port.word(2, address) for address in (6, 8, 14)] == [0, 1023, 1023]
    assert (port.byte(2, 42), port.byte(2, 43)) == (144, 25)  # 14.4 V, 25 degrees
    assert port.word(2, 36) in (511, 512)  # the middle is between them
    assert port.write1ByteTxRx(2, 25, 1) == OK
    assert port.byte(2, 25) == 1
    assert port.write2ByteTxRx(2, 48, 0x123) == OK
    assert port.word(2, 48) == 0x123
    data, *state = port.readTxRx(2, 24, 6)
    assert (list(data), tuple(state)) == ([0, 1, 0, 0, 32, 32], OK)


def test_a_move_takes_its_time_and_ends_at_the_goal(port: Port, eventually: Eventually) -> None:
    assert port.write1ByteTxRx(3, 24, 1) == OK
    assert port.write2ByteTxRx(3, 32, 300) == OK  # 300 * 0.111 rpm: about 680 units a second
    assert port.write2ByteTxRx(3, 30, 800) == OK
    assert port.byte(3, 46) == 1
    assert 500 < port.word(3, 36) < 800
    eventually(lambda: port.byte(3, 46) == 0)
    assert port.word(3, 36) == 800
    assert port.word(3, 38) == 0


def test_sync_write_and_reg_write(port: Port, eventually: Eventually) -> None:
    group = sdk.GroupSyncWrite(port.port, port.packets, 30, 4)
    for id, goal in ((4, 100), (5, 500), (6, 900)):
        assert port.write1ByteTxRx(id, 24, 1) == OK
        assert group.addParam(id, [*goal.to_bytes(2, "little"), *(1000).to_bytes(2, "little")])
    assert group.txPacket() == sdk.COMM_SUCCESS
    eventually(lambda: [port.word(id, 36) for id in (4, 5, 6)] == [100, 500, 900])
    assert port.regWriteTxRx(4, 30, 2, [0x2C, 0x01]) == OK
    assert (port.byte(4, 44), port.word(4, 30)) == (1, 100)
    assert port.action(254) == sdk.COMM_SUCCESS
    eventually(lambda: port.word(4, 36) == 300)
    assert port.byte(4, 44) == 0


def test_refusals_come_as_error_bits(port: Port) -> None:
    assert port.write2ByteTxRx(7, 30, 1024) == (0, sdk.ERRBIT_RANGE)
    assert port.write2ByteTxRx(7, 36, 1) == (0, sdk.ERRBIT_RANGE)  # present position can only be read
    assert port.write2ByteTxRx(7, 6, 400) == OK
    assert port.write2ByteTxRx(7, 30, 399) == (0, sdk.ERRBIT_ANGLE)
    assert "range" in port.packets.getRxPacketError(sdk.ERRBIT_RANGE)


def test_wheel_mode(port: Port, eventually: Eventually) -> None:
    assert port.write2ByteTxRx(8, 8, 0) == OK  # the other limit is 0 already
    assert port.write1ByteTxRx(8, 24, 1) == OK
    before = port.word(8, 36)
    assert port.write2ByteTxRx(8, 32, 1024 + 512) == OK  # clockwise
    eventually(lambda: port.word(8, 36) < before)
    assert port.word(8, 38) & 1024
    assert port.write2ByteTxRx(8, 32, 0) == OK
    eventually(lambda: port.word(8, 38) == 0)


@pytest.fixture(scope="module")
def mx(serve: Serve) -> Iterator[Port]:
    port = Port(serve("mx28@1-3,mx64@4,ax12a@5", "--baud", "57600"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 150)
        yield port
    port.port.closePort()


def bulk_read(port: Port, *reads: tuple[int, int, int]) -> list[bytes | None]:
    """Ask by one request for (id, address, length) each; give the answers, None for one that does not come.

    As the SDK's GroupBulkRead does, which in the version at hand fails for protocol 1.0: it hands its packet handler
    an argument too many.
    """
    words = [byte for id, address, length in reads for byte in (length, id, address)]
    assert port.bulkReadTx(words, len(words)) == sdk.COMM_SUCCESS
    answers: list[bytes | None] = []
    for id, _, length in reads:
        data, result, error = port.readRx(id, length)
        answers.append(bytes(data) if (result, error) == OK else None)
    return answers


def test_bulk_read_of_mx_servos(mx: Port) -> None:
    """One request, an answer from each, of different addresses and lengths."""
    answers = bulk_read(mx, (3, 36, 2), (1, 0, 2), (4, 12, 2), (2, 42, 1))
    assert answers[0] in (b"\xff\x07", b"\x00\x08")
    assert answers[1:] == [bytes([29, 0]), bytes([60, 240]), bytes([120])]  # 29; 6.0 and 24.0 V; 12.0 V


def test_bulk_read_of_a_servo_that_is_not_there(mx: Port) -> None:
    assert bulk_read(mx, (1, 0, 2), (9, 0, 2)) == [bytes([29, 0]), None]
    assert mx.ping(1) == (29, 0, 0)  # and no harm is done


def test_an_ax_knows_no_bulk_read(mx: Port) -> None:
    assert bulk_read(mx, (5, 0, 2)) == [None]
    assert mx.ping(5)[:2] == (12, 0)


def test_turns_and_wheel_of_an_mx(mx: Port, eventually: Eventually) -> None:
    assert mx.write2ByteTxRx(1, 6, 4095) == OK  # the other limit is 4095 already: multi-turn mode
    assert mx.write1ByteTxRx(1, 24, 1) == OK
    assert mx.write2ByteTxRx(1, 30, 6144) == OK  # one turn and a half
    eventually(lambda: abs(mx.word(1, 36) - 6144) < 10)
    assert mx.write2ByteTxRx(1, 30, 0x10000 - 1024) == OK
    eventually(lambda: mx.word(1, 36) > 0x8000 and abs(mx.word(1, 36) - 0x10000 + 1024) < 10)
    assert mx.write2ByteTxRx(2, 8, 0) == OK  # wheel mode
    assert mx.write1ByteTxRx(2, 24, 1) == OK
    assert mx.write2ByteTxRx(2, 32, 1024 + 200) == OK  # clockwise at 200 units of 0.114 rpm
    eventually(lambda: abs((mx.word(2, 38) & 1023) - 200) <= 2)
    assert mx.word(2, 38) & 1024
    assert mx.write2ByteTxRx(2, 32, 0) == OK


def test_a_new_id_a_new_speed_and_back(port: Port) -> None:
    assert port.write1ByteTxRx(9, 3, 77) == OK
    assert port.ping(77) == (28, 0, 0)
    assert port.ping(9)[1] == sdk.COMM_RX_TIMEOUT
    assert port.write1ByteTxRx(77, 4, 1) == OK  # 1 Mbit/s from the next packet on
    assert port.ping(77)[1] != sdk.COMM_SUCCESS
    assert port.port.setBaudRate(1_000_000)
    assert port.ping(77) == (28, 0, 0)
    assert port.ping(2)[1] != sdk.COMM_SUCCESS
    assert port.factoryReset(77) == OK
    assert port.port.setBaudRate(57_600)
    assert port.ping(77)[1] == sdk.COMM_RX_TIMEOUT
    assert port.ping(1) == (28, 0, 0)
