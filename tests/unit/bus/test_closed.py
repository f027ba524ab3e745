"""A bus that was closed: what begins on it is refused, what goes on in another thread or task ends."""

import asyncio
import threading

import pytest

import servobus
from samples import every_model
from servobus import PortError, ServobusError, UsageError, deg
from unit.served import PATIENCE


def test_a_with_block_on_a_closed_bus_is_refused() -> None:
    bus = servobus.open("virtual:rx28@1?clock=virtual")
    with bus:
        bus.find(1)
    with pytest.raises(UsageError, match="is closed; open it anew, or call reopen"), bus:
        pass
    bus.reopen()
    with bus:
        bus[1].ping()


def test_an_async_with_block_on_a_closed_bus_is_refused() -> None:
    async def main() -> None:
        bus = servobus.open_async("virtual:rx28@1?clock=virtual")
        async with bus:
            await bus.find(1)
        with pytest.raises(UsageError, match="is closed; open it anew, or call reopen"):
            async with bus:
                pass

    asyncio.run(main())


def new_place(servo: servobus.BusServo) -> float:
    here: float = servo.read("present_position")
    return here + 60 * deg


@every_model
def test_close_by_another_thread_ends_waiting_for_a_move(key: str) -> None:
    bus = servobus.open(f"virtual:{key}@1")
    servo = bus.find(1)
    servo.torque_on()
    move = servo.move(new_place(servo), time=2.8)
    ended: list[ServobusError | None] = []

    def wait() -> None:
        try:
            move.wait()
        except ServobusError as error:
            ended.append(error)
        else:
            ended.append(None)

    thread = threading.Thread(target=wait)
    thread.start()
    bus.close()
    thread.join(PATIENCE)
    assert isinstance(ended[0], PortError)
    assert "is closed" in str(ended[0])


def test_close_by_another_task_ends_waiting_for_a_move() -> None:
    async def main() -> None:
        bus = servobus.open_async("virtual:rx28@1")
        servo = await bus.find(1)
        await servo.torque_on()
        move = await servo.move(200 * deg, time=2.8)
        waiting = asyncio.ensure_future(move.wait())
        await asyncio.sleep(0)
        bus.close()
        with pytest.raises(PortError, match="is closed"):
            await waiting

    asyncio.run(main())
