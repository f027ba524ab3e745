"""The asynchronous driver: what it waits for and gives up on. What it sends is shared with the blocking one."""

import asyncio
import os

import pytest

from servobus import RX28, NoReply, TorqueOff, deg
from servobus.bus.asyncio import AsyncBus
from servobus.transports.base import Transport
from unit.bus.test_blocking import ANSWER, OK, TEMPERATURE, motion_status, torque_state
from unit.scripted import Scripted


def test_read_write_and_torque() -> None:
    async def main() -> None:
        port = Scripted(ANSWER, torque_state(0), motion_status(0, 512), OK, OK, torque_state(1), OK)
        async with AsyncBus(port, echo=False) as bus:
            elbow = bus.attach(RX28, 1)
            assert await elbow.read(RX28.present_temperature) == 32.0
            async with elbow.torque() as same:
                assert same is elbow
        assert port.requests[-1] == "FF FF 01 04 03 18 00 DF"
        assert port.closed

    asyncio.run(main())


def test_move_starts_when_awaited() -> None:
    async def main() -> None:
        port = Scripted(motion_status(0, 512))
        bus = AsyncBus(port, echo=False)
        move = bus.attach(RX28, 1).move(90 * deg)
        assert port.requests == []
        with pytest.raises(TorqueOff):
            await move

    asyncio.run(main())


def test_two_tasks_take_turns() -> None:
    async def main() -> None:
        port = Scripted(ANSWER, ANSWER)
        servo = AsyncBus(port, echo=False).attach(RX28, 1)
        values = tuple(await asyncio.gather(servo.read(RX28.present_temperature), servo.read(RX28.present_temperature)))
        assert values == (32.0, 32.0)
        assert port.requests == [TEMPERATURE, TEMPERATURE]

    asyncio.run(main())


class Pipe(Transport):
    """A port with a real descriptor: what arrives is what the test writes to `wire`."""

    name, baud, latency = "pipe", 57_600, 0.05

    def __init__(self) -> None:
        self._fd, self.wire = os.pipe()
        os.set_blocking(self._fd, False)

    def write(self, data: bytes) -> None:
        pass

    def read(self, timeout: float) -> bytes:
        assert timeout == 0, "an event loop must not be blocked"
        try:
            return os.read(self._fd, 4096)
        except BlockingIOError:
            return b""

    def fileno(self) -> int:
        return self._fd

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    def close(self) -> None:
        os.close(self._fd)
        os.close(self.wire)


def test_waits_on_the_descriptor_while_the_loop_goes_on() -> None:
    async def main() -> None:
        port = Pipe()
        async with AsyncBus(port, echo=False) as bus:
            asyncio.get_running_loop().call_later(0.01, os.write, port.wire, bytes.fromhex(ANSWER[:8]))
            asyncio.get_running_loop().call_later(0.02, os.write, port.wire, bytes.fromhex(ANSWER[8:]))
            assert await bus.attach(RX28, 1).read(RX28.present_temperature) == 32.0
            with pytest.raises(NoReply):
                await bus[1].ping()

    asyncio.run(main())


def test_a_cancelled_question_leaves_the_bus_usable() -> None:
    async def main() -> None:
        port = Pipe()
        async with AsyncBus(port, echo=False) as bus:
            servo = bus.attach(RX28, 1)
            question = asyncio.ensure_future(servo.ping())
            await asyncio.sleep(0.005)
            question.cancel()
            with pytest.raises(asyncio.CancelledError):
                await question
            os.write(port.wire, bytes.fromhex(OK))  # the late answer to the cancelled question
            asyncio.get_running_loop().call_later(0.01, os.write, port.wire, bytes.fromhex(ANSWER))
            assert await servo.read(RX28.present_temperature) == 32.0

    asyncio.run(main())
