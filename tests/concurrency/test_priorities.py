"""Several clients of one bus: a stop comes before motion, motion before reads, reads before a scan."""

import asyncio
from collections.abc import Awaitable

import servobus
from servobus import RX28, deg
from servobus.core.exchange import Pause, Procedure
from unit.served import Arm


def busy() -> Procedure[None]:
    yield Pause(0.05)


def test_what_waits_for_the_line_gets_it_by_its_urgency() -> None:
    async def main() -> list[str]:
        async with servobus.open_async("virtual:rx28@1") as bus:
            (servo,) = await bus.scan(family="dynamixel", ids=[1])
            done = list[str]()

            async def note(name: str, work: Awaitable[object]) -> None:
                await work
                done.append(name)

            async with asyncio.TaskGroup() as group:
                group.create_task(note("busy", bus.do(busy())))
                await asyncio.sleep(0.01)
                group.create_task(note("scan", bus.scan(family="dynamixel", ids=[1])))
                group.create_task(note("read", servo.read("present_position")))
                group.create_task(note("motion", servo.torque_on()))
                group.create_task(note("stop", servo.stop()))
            await servo.torque_off()
            return done

    assert asyncio.run(main()) == ["busy", "stop", "motion", "read", "scan"]


def test_a_stop_that_is_awaited_stops_on_a_real_descriptor() -> None:
    """A task that stops a servo holds the line most urgently of all, and must still hear the answers."""

    async def main(name: str) -> None:
        async with servobus.open_async(name, echo=False) as bus:
            servo = bus.attach(RX28, 1)
            await servo.torque_on()
            await servo.move(250 * deg, time=3.0)
            await asyncio.sleep(0.2)
            await servo.stop()
            await asyncio.sleep(0.3)
            first, second = await servo.read(RX28.present_position), await servo.read(RX28.present_position)
            assert abs(first - second) < 1 * deg
            assert first < 220 * deg
            await servo.torque_off()

    with Arm("rx28@1") as arm:
        asyncio.run(main(arm.name))
