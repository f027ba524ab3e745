"""A scan takes seconds, and whatever else wants the line meanwhile comes first."""

import asyncio
import threading

import pytest

import servobus
from servobus import RX28
from servobus.jobs.scan import scan
from servobus.link.link import Link
from servobus.link.waits import Receive
from servobus.virtual.serve.inprocess import connect


@pytest.mark.parametrize(("baud", "longest"), [(1_000_000, 0.020), (57_600, 0.050)])
def test_another_client_waits_for_a_moment_only(baud: int, longest: float) -> None:
    """From any moment of a scan on it takes at most so long until the scan gives way, and the client is answered.

    On a virtual clock, so that the figure is that of the line and not of the computer that runs the test.
    """
    port = connect(f"virtual:rx28@1,2,40?clock=virtual&baud={baud}")
    wanted = False
    family = RX28.family
    link = Link(
        port, echo=False, heard=lambda *_: None, fences=lambda _, one: family.fences(one), contended=lambda: wanted
    )
    question = family.ping(40)
    worst, answered, asked_at, waits = 0.0, 0, 0.0, 0
    steps = link.run(scan([family], [baud], range(64)))
    try:
        wait = next(steps)
        while True:
            waits += 1
            if not wanted and waits % 3 == 0:
                wanted, asked_at = True, port.now()
            if isinstance(wait, Receive):
                wait = steps.send(port.read(wait.seconds))
                continue
            port.sleep(wait.seconds)
            if wanted and wait.shared:
                reading = link.run(question)
                try:
                    inner = next(reading)
                    while True:
                        if isinstance(inner, Receive):
                            inner = reading.send(port.read(inner.seconds))
                        else:
                            port.sleep(inner.seconds)
                            inner = reading.send(b"")
                except StopIteration:
                    answered += 1
                wanted = False
                worst = max(worst, port.now() - asked_at)
            wait = steps.send(b"")
    except StopIteration as stop:
        found = [one.id for one in stop.value.found]
    assert found == [1, 2, 40]
    assert answered > 20
    assert worst <= longest


def test_a_scan_beside_a_client_finds_the_same() -> None:
    async def main() -> None:
        async with servobus.open_async("virtual:rx28@1-3,17") as bus:
            servo = bus.attach(RX28, 2)
            stop = False

            async def read() -> int:
                count = 0
                while not stop:
                    await servo.read("present_position")
                    count += 1
                return count

            reading = asyncio.create_task(read())
            found = await bus.scan(family="dynamixel", ids=range(24))
            stop = True
            assert [one.id for one in found] == [1, 2, 3, 17]
            assert await reading > 3

    asyncio.run(main())


def test_the_same_in_threads() -> None:
    with servobus.open("virtual:rx28@1-3,17") as bus:
        servo, stop, counts = bus.attach(RX28, 2), threading.Event(), [0]

        def read() -> None:
            while not stop.is_set():
                servo.read("present_position")
                counts[0] += 1

        reading = threading.Thread(target=read)
        reading.start()
        try:
            found = bus.scan(family="dynamixel", ids=range(24))
        finally:
            stop.set()
            reading.join()
        assert [one.id for one in found] == [1, 2, 3, 17]
        assert counts[0] > 3
