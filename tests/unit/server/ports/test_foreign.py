"""Programs of other makes on ports of their own, beside each other and a bus of ours.

The programs here write bytes from the manuals. Those that people use are in tests/clients.
"""

import asyncio
import os
import sys
from collections.abc import Awaitable, Callable
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import pytest

import servobus
from servobus.bus.asyncio import AsyncBus
from servobus.core.exchange import Exchange
from servobus.core.operation import Priority
from servobus.errors import Held, NoReply, PortError, ServobusError
from servobus.link.ownership import Turn
from servobus.server.ports.foreign import ForeignPort, ForeignPty, ForeignTcp
from servobus.server.ports.gate import PermitAll
from servobus.server.ports.leases import Holder
from servobus.virtual.serve.inprocess import VirtualPort

if sys.platform != "win32":
    import termios
    import tty

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo terminals")

PATIENCE = 20.0
"""s; a limit against hanging, and never a measurement."""


def dynamixel(id: int, code: int, *data: int) -> bytes:
    """RX-28 manual 3-2: FF FF, id, length, instruction or error, parameters, checksum."""
    body = bytes([id, len(data) + 2, code, *data])
    return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])


def herkulex(id: int, command: int, *data: int) -> bytes:
    """DRS-0602 manual 5-1 and 5-2: FF FF, size, id, command, two checksums, data."""
    check = reduce(xor, (len(data) + 7, id, command, *data))
    return b"\xff\xff" + bytes([len(data) + 7, id, command, check & 0xFE, ~check & 0xFE, *data])


def lx(id: int, command: int, *data: int) -> bytes:
    """Protocol document of the LX, section 2."""
    body = bytes([id, len(data) + 3, command, *data])
    return b"\x55\x55" + body + bytes([~sum(body) & 0xFF])


def ping(id: int) -> bytes:
    return dynamixel(id, 1)


STOP, MOTION, READ = Priority.STOP, Priority.MOTION, Priority.READ
READ_ID = 2, 3, 1
"""READ_DATA of one byte at 3."""


class Program:
    """A program that has opened a port and knows nothing of it."""

    def __init__(self, port: str, baud: str = "B57600") -> None:
        self._file = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._file)
        self.set_speed(baud)
        self._heard = b""

    def set_speed(self, baud: str) -> None:
        settings = termios.tcgetattr(self._file)
        settings[4] = settings[5] = getattr(termios, baud)
        termios.tcsetattr(self._file, termios.TCSANOW, settings)

    def write(self, data: bytes) -> None:
        assert os.write(self._file, data) == len(data)

    async def hear(self, size: int) -> bytes:
        """Give the next so many bytes."""
        async with asyncio.timeout(PATIENCE):
            while len(self._heard) < size:
                try:
                    data = os.read(self._file, 1000)
                except BlockingIOError:
                    await asyncio.sleep(0.001)
                    continue
                assert data, "the port has gone"
                self._heard += data
        heard, self._heard = self._heard[:size], self._heard[size:]
        return heard

    async def check(self, request: bytes, answer: bytes) -> None:
        """Ask; this answer and nothing else must come next."""
        self.write(request)
        assert await self.hear(len(answer)) == answer

    def close(self) -> None:
        os.close(self._file)


class Gate(PermitAll):
    """Writes down what it is asked, and refuses what a test wants refused."""

    def __init__(self) -> None:
        self.admitted: list[tuple[Priority, bytes]] = []
        self.done: list[tuple[bytes, Any]] = []
        self.gone: list[Holder] = []
        self.then: Callable[[], None] | None = None
        self.refuses: Callable[[Exchange[Any]], bool] = lambda _: False

    def admit(
        self,
        who: Holder,
        bus: str,
        exchange: Exchange[Any],
        baud: int,
        asked: float,
        priority: Priority = Priority.READ,
    ) -> None:
        assert (who.name[:15], bus, baud > 0, asked > 0) == ("the program on ", "arm", True, True)
        if self.refuses(exchange):
            raise Held("held by somebody else", "somebody else")
        self.admitted.append((priority, exchange.request))

    def carried_out(self, who: Holder, bus: str, exchange: Exchange[Any], baud: int, outcome: Any) -> None:
        assert (bus, baud > 0, who.name.startswith("the program on ")) == ("arm", True, True)
        self.done.append((exchange.request, outcome))
        then, self.then = self.then, None
        if then is not None:
            then()

    def left(self, who: Holder) -> None:
        self.gone.append(who)


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have no answer be too late because this computer is busy."""
    monkeypatch.setattr("servobus.server.ports.foreign.ANSWERED_WITHIN", PATIENCE)


Scene = Callable[[AsyncBus, ForeignPty, Program, Gate], Awaitable[None]]


def virtual(servos: str) -> AsyncBus:
    """Open a bus with these servos, on a clock that waits for nothing: no answer is lost because a computer is busy."""
    return servobus.open_async(f"virtual:{servos}{'&' if '?' in servos else '?'}clock=virtual", echo=False)


def play(servos: str, scene: Scene, **more: Any) -> None:
    """Let a program talk through a pseudo terminal of its own to a bus with these servos."""

    async def run() -> None:
        gate = Gate()
        async with (
            virtual(servos) as bus,
            ForeignPty(bus, "arm", gate, **more) as port,
        ):
            program = Program(port.port)
            try:
                await scene(bus, port, program, gate)
            finally:
                program.close()

    asyncio.run(run())


async def until(done: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not done():  # noqa: ASYNC110 - what is waited for knows nothing of this test
            await asyncio.sleep(0.002)


def real(bus: AsyncBus, n: int = 0) -> Any:
    assert isinstance(bus.transport, VirtualPort)
    return bus.transport.servos[n]


def test_answers_are_those_of_the_servo() -> None:
    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        await program.check(ping(1), dynamixel(1, 0))
        await program.check(dynamixel(1, 2, 0, 2), dynamixel(1, 0, 28, 0))  # model number
        await program.check(dynamixel(1, 3, 25, 1), dynamixel(1, 0))
        assert real(bus).get("led") == 1
        await program.check(dynamixel(1, 3, 30, 0, 4), dynamixel(1, 0x08))  # 1024 is out of range (3-3)
        await program.check(dynamixel(1, 0x77, 1), dynamixel(1, 0x40))  # no such instruction
        assert port.counts.answered == port.counts.requests == 5
        assert gate.admitted[1:3] == [(READ, dynamixel(1, 2, 0, 2)), (MOTION, dynamixel(1, 3, 25, 1))]
        assert gate.done[-1][1].code == 0x40

    play("rx28@1", scene)


def test_silence_stays_silence() -> None:
    """A servo that is not there, a broadcast, a broken packet: nothing comes, nor with the next answer."""

    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        program.write(ping(9))
        await until(lambda: port.counts.silent == 1)
        program.write(dynamixel(254, 3, 25, 1))
        await until(lambda: len(gate.done) == 2)
        program.write(ping(1)[:-1] + b"\x00")
        await program.check(ping(1), dynamixel(1, 0))
        assert real(bus).get("led") == 1
        assert port.counts.garbage == 6
        sent = [request for request, _ in gate.done]
        assert sent == [ping(9), dynamixel(254, 3, 25, 1), ping(1)]  # each of them once
        assert isinstance(gate.done[0][1], NoReply)
        assert bus.stats.total.retries == 0

    play("rx28@1", scene)


def test_several_that_answer_one_request() -> None:
    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        request = dynamixel(254, 0x92, 0, 1, 2, 3, 2, 1, 0)  # BULK_READ: id of 2, model number of 1
        await program.check(request, dynamixel(2, 0, 2) + dynamixel(1, 0, 29, 0))
        await program.check(dynamixel(254, 0x92, 0, 1, 2, 3, 1, 9, 3), dynamixel(2, 0, 2))  # 9 is not there

    play("mx28@1,2", scene)


def test_programs_and_a_bus_side_by_side() -> None:
    """Three at once, as fast as they can: each hears its own servo and no other."""

    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        one, asked = bus.attach("rx28", 1, baud=1_000_000), 0

        async def read() -> None:
            for _ in range(40):
                assert await one.read("id") == 1

        async def ask(program: Program, id: int) -> None:
            nonlocal asked
            for _ in range(40):
                await program.check(dynamixel(id, *READ_ID), dynamixel(id, 0, id))
                asked += 1

        async with ForeignPty(bus, "arm", gate) as other_port:
            other = Program(other_port.port, "B1000000")
            async with asyncio.TaskGroup() as group:
                for work in (read(), ask(program, 2), ask(other, 3)):
                    group.create_task(work)
            other.close()
        assert asked == 80

    play("rx28@1-3?baud=1000000", scene_at("B1000000", scene))


def scene_at(baud: str, scene: Scene) -> Scene:
    async def faster(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        program.set_speed(baud)
        await scene(bus, port, program, gate)

    return faster


def test_each_has_a_speed_of_its_own() -> None:
    """An RX-28 talks at 57600 and an AX-12A at 1000000 from the factory; here with one id."""

    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        async with ForeignPty(bus, "arm", gate) as other_port:
            other = Program(other_port.port, "B1000000")
            for _ in range(3):
                bus.transport.sleep(0.2)  # what a servo heard at another speed it has forgotten by then
                await program.check(dynamixel(1, 2, 0, 1), dynamixel(1, 0, 28))
                bus.transport.sleep(0.2)
                await other.check(dynamixel(1, 2, 0, 1), dynamixel(1, 0, 12))
            other.set_speed("B57600")
            bus.transport.sleep(0.2)
            await other.check(dynamixel(1, 2, 0, 1), dynamixel(1, 0, 28))
            other.close()

    play("rx28@1,ax12a@1", scene)


def test_all_families_through_one_port() -> None:
    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        stat = herkulex(219, 7)
        for _ in range(2):
            await program.check(ping(1), dynamixel(1, 0))
            program.write(stat)
            assert (await program.hear(9))[:5] == bytes.fromhex("FFFF 09 DB 47")
            await program.check(lx(1, 14), lx(1, 14, 1))
        program.write(lx(1, 12))  # SERVO_MOVE_STOP
        await until(lambda: gate.admitted[-1] == (STOP, lx(1, 12)))
        program.write(herkulex(219, 3, 53, 1, 1))  # RAM_WRITE, green light; a new servo does not answer
        await program.check(ping(1), dynamixel(1, 0))
        assert real(bus, 1).get("led_control") == 1

    play("rx28@1,drs0602@219,lx16a@1?baud=115200", scene_at("B115200", scene))


def test_half_requests(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        request = dynamixel(1, 3, 25, 1)
        monkeypatch.setattr("servobus.server.ports.foreign.PARTIAL", PATIENCE)
        program.write(request[:4])
        await until(lambda: port._cutter.begun)
        await program.check(request[4:], dynamixel(1, 0))
        monkeypatch.setattr("servobus.server.ports.foreign.PARTIAL", 0.001)
        program.write(request[:5])
        await until(lambda: port.counts.garbage == 5)  # the rest has not come for too long
        monkeypatch.setattr("servobus.server.ports.foreign.PARTIAL", PATIENCE)
        program.write(request[5:])  # what is left is no request
        await program.check(ping(1), dynamixel(1, 0))
        program.write(request[:5])
        await program.check(ping(1), dynamixel(1, 0))  # a whole one ends the wait
        assert port.counts.requests == 3

    play("rx28@1", scene)


def test_what_is_refused_is_not_sent() -> None:
    told: list[tuple[ForeignPort, bytes, ServobusError]] = []

    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        gate.refuses = lambda exchange: exchange.request[4] == 3
        program.write(dynamixel(1, 3, 24, 1))
        await until(lambda: bool(told))
        await program.check(ping(1), dynamixel(1, 0))
        assert not real(bus).torque
        assert (told[0][0], told[0][1], type(told[0][2])) == (port, dynamixel(1, 3, 24, 1), Held)
        assert (port.counts.refused, [request for request, _ in gate.done]) == (1, [ping(1)])

    play("rx28@1", scene, refused=lambda port, exchange, error: told.append((port, exchange.request, error)))


def test_a_program_that_leaves_is_told_of_when_all_it_asked_for_is_done() -> None:
    async def scene(bus: AsyncBus, port: ForeignPty, last: Program, gate: Gate) -> None:
        await last.check(dynamixel(1, 3, 24, 1), dynamixel(1, 0))
        for _ in range(5):
            last.write(dynamixel(1, 3, 25, 1))
        last.write(dynamixel(1, 3, 24, 0))
        os.dup2(os.open("/dev/null", os.O_RDWR), last._file)  # it closes the port, and goes on
        await until(lambda: bool(gate.gone))
        assert not real(bus).torque
        assert gate.gone == [port]
        follower = Program(port.port)
        await follower.check(dynamixel(1, *READ_ID), dynamixel(1, 0, 1))  # and nothing of the other's answers
        follower.close()
        await until(lambda: len(gate.gone) == 2)

    play("rx28@1", scene)


def test_who_asks_anew_waits_for_no_older_answer() -> None:
    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        busy = Turn()
        assert bus.line.try_acquire(busy)
        program.write(dynamixel(1, 3, 48, 5, 0))  # punch
        program.write(dynamixel(1, 2, 0, 2))
        program.write(dynamixel(1, 2, 2, 1))
        await until(lambda: port.counts.requests == 3)
        bus.line.end(busy)
        assert await program.hear(7) == dynamixel(1, 0, real(bus).get("firmware_version"))
        assert real(bus).get("punch") == 5
        assert port.counts.outdated == 2
        assert len(gate.done) == 2  # the first question was not even asked

    play("rx28@1", scene)


def test_no_answer_comes_behind_the_next_question() -> None:
    """The program gives up and asks anew in the very moment in which the answer is there."""

    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        await program.check(ping(1), dynamixel(1, 0))
        gate.then = lambda: program.write(dynamixel(1, 2, 0, 1))
        program.write(dynamixel(1, *READ_ID))
        assert await program.hear(7) == dynamixel(1, 0, 28)
        assert (port.counts.outdated, len(gate.done)) == (1, 3)

    play("rx28@1", scene)


def test_no_answer_comes_when_the_program_may_have_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A question that waits too long for the line is not asked; a command is carried out, and its answer kept back."""

    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        monkeypatch.setattr("servobus.server.ports.foreign.ANSWERED_WITHIN", -PATIENCE)
        program.write(dynamixel(1, *READ_ID))
        await until(lambda: port.counts.outdated == 1)
        program.write(dynamixel(1, 3, 25, 1))
        await until(lambda: port.counts.outdated == 2)
        assert [request for request, _ in gate.done] == [dynamixel(1, 3, 25, 1)]
        monkeypatch.setattr("servobus.server.ports.foreign.ANSWERED_WITHIN", PATIENCE)
        await program.check(ping(1), dynamixel(1, 0))
        assert real(bus).get("led") == 1

    play("rx28@1", scene)


def test_of_too_many_requests_the_oldest_go() -> None:
    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        busy = Turn()
        assert bus.line.try_acquire(busy)
        for _ in range(100):
            program.write(dynamixel(254, 3, 25, 1))
        program.write(dynamixel(1, *READ_ID))
        await until(lambda: port.counts.requests == 101)
        bus.line.end(busy)
        assert await program.hear(7) == dynamixel(1, 0, 1)
        assert 101 - len(gate.done) == port.counts.dropped > 30

    play("rx28@1?baud=1000000", scene_at("B1000000", scene))


def test_nobody_waits_for_what_a_servo_does_not_answer() -> None:
    """Status Return Level 1, set by the program itself: writes are not answered, and reads are."""

    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        await program.check(dynamixel(1, 3, 16, 1), dynamixel(1, 0))  # answered by the old level
        for n in range(5):
            program.write(dynamixel(1, 3, 48, n, 0))
        await until(lambda: len(gate.done) == 6)
        assert all(outcome.id == 0 for _, outcome in gate.done[1:])  # it is what stands for no answer
        await program.check(dynamixel(1, 2, 48, 1), dynamixel(1, 0, 4))

    play("rx28@1", scene)


def test_a_link_of_its_own(tmp_path: Path) -> None:
    async def scene(bus: AsyncBus, port: ForeignPty, program: Program, gate: Gate) -> None:
        assert port.port == str(tmp_path / "arm")
        assert (tmp_path / "arm").is_symlink()
        await program.check(ping(1), dynamixel(1, 0))

    play("rx28@1", scene, link=tmp_path / "arm")
    assert not (tmp_path / "arm").exists()


def test_tcp() -> None:
    async def run() -> None:
        gate = Gate()
        async with virtual("ax12a@1") as bus:
            async with ForeignTcp(bus, "arm", gate, "127.0.0.1", 0, 1_000_000) as port:
                number = int(port.port.rpartition(":")[2])
                reader, writer = await asyncio.open_connection("127.0.0.1", number)
                writer.write(dynamixel(1, 2, 0, 1))
                assert await reader.readexactly(7) == dynamixel(1, 0, 12)
                second, other = await asyncio.open_connection("127.0.0.1", number)
                assert await hung_up(second)
                other.close()
                writer.write(dynamixel(1, *READ_ID))
                assert await reader.readexactly(7) == dynamixel(1, 0, 1)
                writer.close()
                await until(lambda: gate.gone == [port])
                reader, writer = await asyncio.open_connection("127.0.0.1", number)
                writer.write(ping(1))
                assert await reader.readexactly(6) == dynamixel(1, 0)
                with pytest.raises(PortError, match="cannot listen"):
                    await ForeignTcp(bus, "arm", gate, "127.0.0.1", number).__aenter__()
            assert await hung_up(reader)
            writer.close()

    asyncio.run(run())


async def hung_up(reader: asyncio.StreamReader) -> bool:
    try:
        return await asyncio.wait_for(reader.read(), PATIENCE) == b""
    except ConnectionError:
        return True
