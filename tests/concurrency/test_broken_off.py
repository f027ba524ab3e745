"""Jobs that are broken off at every wait, on a real descriptor, beside another client that must not notice.

An asynchronous job is cancelled at each of its awaits in turn, a blocking one gets Ctrl-C at each of its waits. Each
time the line must be free afterwards, the other client must have read nothing but the truth without an error, and the
bus must go on.
"""

import asyncio
import threading
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import pytest

import servobus
from servobus import deg
from unit.served import PATIENCE, Arm, wait_for

IDS = range(1, 5)
OTHER = 3
"""Id of the servo that the other client reads."""
SCANNED = (2, 5, 4)
"""Two that are there and, between them, one that is not: every wait of a scan comes up."""
MOST = 200
"""Waits of the longest job here, and more."""

JOBS: dict[str, Callable[[Any], Any]] = {
    "read": lambda bus: bus[1].read(bus[1].model.register("present_position")),
    "look": lambda bus: bus[1].look(),
    "read_all": lambda bus: bus.read_all("present_position"),
    "move": lambda bus: bus.move({1: 150 * deg + 0.01}, time=0.12).wait(),
    "scan": lambda bus: bus.scan(family="dynamixel", ids=SCANNED),
    "verify": lambda bus: bus[1].verify(),
}


@pytest.fixture(scope="module")
def arm() -> Iterator[Arm]:
    with Arm("rx28@1-4") as arm:
        for servo in arm.servos[1:]:
            servo.turn_shaft(servo.id * 20 * deg)
        yield arm


def truth(arm: Arm) -> Any:
    """Give the angle that the other client must read, as far as the register can tell it."""
    row = arm.servos[0].model.register("present_position")
    return row.decode(row.scale.encode(arm.servos[OTHER - 1].position))


@pytest.mark.parametrize("name", JOBS)
def test_a_task_cancelled_at_each_await(arm: Arm, name: str) -> None:
    asyncio.run(_cancel_at_each(arm, JOBS[name]))


async def _cancel_at_each(arm: Arm, job: Callable[[Any], Awaitable[Any]]) -> None:
    async with servobus.open_async(arm.name, echo=False) as bus:
        for id in IDS:
            bus.attach(servobus.RX28, id)
        await bus[1].torque_on()
        row, expected, polls = bus[OTHER].model.register("present_position"), truth(arm), 0

        async def poll() -> None:
            nonlocal polls
            while True:
                assert await bus[OTHER].read(row) == expected
                polls += 1
                await asyncio.sleep(0.001)

        other = asyncio.create_task(poll())
        victim: asyncio.Task[Any] | None = None
        left = 0

        def count() -> None:
            """Cancel the victim when it comes to its wait with this number: at that await, and no sooner."""
            nonlocal left
            if victim is not None and asyncio.current_task() is victim:
                left -= 1
                if left == 0:
                    victim.cancel()

        for owner, wait in ((bus._reader, "read"), (bus, "_pause"), (bus.line, "acquire_async")):
            _counted(owner, wait, count)
        for number in range(1, MOST):
            left = number
            victim = asyncio.ensure_future(job(bus))
            with_error = (await asyncio.wait_for(asyncio.gather(victim, return_exceptions=True), PATIENCE))[0]
            victim = None
            assert not other.done(), other.exception()
            before = polls
            assert await asyncio.wait_for(bus[OTHER].read(row), PATIENCE) == expected
            if not isinstance(with_error, asyncio.CancelledError):
                if isinstance(with_error, BaseException):
                    raise with_error
                break
        else:
            pytest.fail("the job never came to its end")
        assert number > 1, "nothing was broken off"
        await asyncio.sleep(0.02)
        assert polls > before
        other.cancel()
        await asyncio.gather(other, return_exceptions=True)
        assert bus.line.holder is None
        assert not bus.line.contended
        await bus[1].torque_off()


def _counted(owner: Any, name: str, count: Callable[[], None]) -> None:
    wait = getattr(owner, name)

    async def counted(*args: Any) -> Any:
        count()
        return await wait(*args)

    setattr(owner, name, counted)


@pytest.mark.parametrize("name", JOBS)
def test_ctrl_c_at_each_wait(arm: Arm, name: str) -> None:
    job, expected = JOBS[name], truth(arm)
    with servobus.open(arm.name, echo=False) as bus:
        for id in IDS:
            bus.attach(servobus.RX28, id)
        bus[1].torque_on()
        row = bus[OTHER].model.register("present_position")
        stop, wrong = threading.Event(), list[object]()
        polls = left = 0
        victim = threading.get_ident()

        def poll() -> None:
            nonlocal polls
            while not stop.is_set():
                try:
                    value = bus[OTHER].read(row)
                except BaseException as error:  # noqa: BLE001 - the other client must not meet any
                    wrong.append(error)
                    return
                if value != expected:
                    wrong.append(value)
                polls += 1

        def count() -> None:
            nonlocal left
            if threading.get_ident() == victim:
                left -= 1
                if left == 0:
                    raise KeyboardInterrupt

        other = threading.Thread(target=poll)
        other.start()
        try:
            for owner, wait in ((bus.transport, "read"), (bus.transport, "sleep"), (bus.line, "acquire")):
                _interrupted(owner, wait, count)
            for number in range(1, MOST):
                left = number
                try:
                    job(bus)
                except KeyboardInterrupt:
                    assert left <= 0
                    left = 0
                    assert bus[OTHER].read(row) == expected
                else:
                    left = 0
                    break
            else:
                pytest.fail("the job never came to its end")
            assert number > 1, "nothing was broken off"
            assert not wrong
            before = polls
            wait_for(lambda: polls > before)
        finally:
            stop.set()
            other.join(PATIENCE)
        assert not wrong
        assert bus.line.holder is None
        assert not bus.line.contended
        bus[1].torque_off()


def _interrupted(owner: Any, name: str, count: Callable[[], None]) -> None:
    wait = getattr(owner, name)

    def counted(*args: Any) -> Any:
        count()
        return wait(*args)

    setattr(owner, name, counted)
