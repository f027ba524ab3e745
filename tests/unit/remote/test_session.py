"""What is asked of a server beside the servos, by messages that a room of the server adds to its table."""

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

import pytest

from servobus import RX28, PortError, PortLost, ServobusError, UnknownName
from servobus.bus.asyncio import AsyncBus
from servobus.core.values import frozen
from servobus.remote.messages import message
from servobus.remote.port import RemotePort
from servobus.remote.session import RemoteSession
from servobus.server.ports.service import Connection
from unit.remote.hosted import PATIENCE, Hosted
from unit.served import wait_for

SPEC = "virtual:rx28@1"
BROKEN, BROKEN_LATER = 77, 78
"""Numbers that make the server's own code fail."""


@message("test_double")
@frozen
class Double:
    """Ask for twice a number."""

    n: int
    number: int
    later: bool = False


@message("test_doubled")
@frozen
class Doubled:
    """The answer to that."""

    n: int
    number: int


@message("test_told")
@frozen
class Told:
    """What nobody asked for."""

    text: str


def double(connection: Connection, asked: Double) -> None:
    """Answer at once or later, and refuse negative numbers."""
    if asked.number == BROKEN:
        raise ZeroDivisionError("a fault of the server")
    if asked.number < 0:
        raise UnknownName(f"{asked.number} is below 0")
    if asked.later:
        connection.begin(asked.n, later(asked))
    else:
        connection.tell(Told("soon"))
        connection.tell(Doubled(asked.n, 2 * asked.number))


async def later(asked: Double) -> Doubled:
    await asyncio.sleep(0)
    if asked.number == BROKEN_LATER:
        raise ZeroDivisionError("a fault of the server")
    if asked.number > 100:
        raise UnknownName("too much")
    return Doubled(asked.n, 2 * asked.number)


@pytest.fixture
def hosted() -> Iterator[Hosted]:
    with Hosted({"arm": SPEC}) as running:
        running.service.handlers[Double] = double
        yield running


def run(work: Coroutine[Any, Any, Any]) -> Any:
    async def patient() -> Any:
        return await asyncio.wait_for(work, PATIENCE)

    return asyncio.run(patient())


async def until(done: Callable[[], bool]) -> None:
    """Wait for what happens in the server's thread."""
    while not done():  # noqa: ASYNC110 - no event of this loop tells it
        await asyncio.sleep(0.002)


def test_asked_and_answered(hosted: Hosted) -> None:
    async def main() -> None:
        heard: list[Any] = []
        async with RemoteSession(hosted.address("arm"), name="test") as session:
            session.told = heard.append
            assert (await session.ask(Double, number=4)).number == 8
            both = await asyncio.gather(session.ask(Double, number=5, later=True), session.ask(Double, number=6))
            assert [answer.number for answer in both] == [10, 12]
            for number, later in ((-1, False), (101, True)):
                with pytest.raises(UnknownName):
                    await session.ask(Double, number=number, later=later)
            assert heard == [Told("soon"), Told("soon")]

    run(main())


def test_a_fault_of_the_server_is_told_and_ends_nothing(hosted: Hosted, caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with RemoteSession(hosted.address("arm"), name="test") as session:
            for number, later in ((BROKEN, False), (BROKEN_LATER, True)):
                with pytest.raises(ServobusError, match="ZeroDivisionError: a fault of the server"):
                    await session.ask(Double, number=number, later=later)
            assert (await session.ask(Double, number=4)).number == 8

    run(main())
    assert caplog.text.count("of test failed") == 2


def test_asked_by_a_program_that_blocks(hosted: Hosted) -> None:
    port = RemotePort(hosted.address("arm"))
    heard: list[Any] = []
    port.told = heard.append
    assert port.ask(Double, number=4).number == 8
    with pytest.raises(UnknownName, match="below 0"):
        port.ask(Double, number=-1)
    assert heard == [Told("soon")]
    port.close()


def test_a_bus_acts_for_the_session(hosted: Hosted) -> None:
    async def main() -> None:
        async with RemoteSession(hosted.address(""), name="Ann", client="page") as session:
            async with AsyncBus(session.port("arm")) as bus:
                assert len(hosted.service.sessions) == 1
                assert [one.name for one in hosted.service.sessions.values()] == ["Ann"]
                assert await bus.attach(RX28, 1).read("present_temperature") == 25.0
            assert (await session.ask(Double, number=1)).number == 2

    run(main())


def test_a_session_is_as_alive_as_its_beats(hosted: Hosted) -> None:
    async def main() -> None:
        address = hosted.address("arm")
        async with (
            RemoteSession(address, name="by itself", deadman=0.05, beats=True) as alive,
            RemoteSession(address, name="nobody", deadman=0.05) as silent,
        ):
            sessions = hosted.service.sessions
            await until(lambda: sessions[silent.id].silent)
            assert alive.delay > 0
            silent.beat()
            await until(lambda: not sessions[silent.id].silent)

    run(main())


def test_the_end_is_told(hosted: Hosted) -> None:
    async def main() -> None:
        why: list[str] = []
        async with RemoteSession(hosted.address("arm"), name="test") as session:
            session.ended = why.append
            hosted._loop.call_soon_threadsafe(hosted.service.close, "enough")
            await until(lambda: bool(why))
            with pytest.raises(PortLost, match="enough"):
                await session.ask(Double, number=1)
        assert why == ["enough"]

    run(main())


def test_an_answer_that_never_comes_ends_with_the_connection(hosted: Hosted) -> None:
    async def main() -> None:
        hosted.service.handlers[Double] = lambda *_: None
        async with RemoteSession(hosted.address("arm"), name="test") as session:
            asked = asyncio.create_task(session.ask(Double, number=1))
            await asyncio.sleep(0)
            hosted._loop.call_soon_threadsafe(hosted.service.close, "enough")
            with pytest.raises(PortLost, match="enough"):
                await asked

    run(main())


def test_who_is_not_let_in_is_told(hosted: Hosted, monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        async with RemoteSession(hosted.address("arm"), name="test"):
            pass

    monkeypatch.setenv("SERVOBUS_TOKEN", "guessed")
    with pytest.raises(PortError, match="the token"):
        run(main())
    wait_for(lambda: not hosted.service.connections)
