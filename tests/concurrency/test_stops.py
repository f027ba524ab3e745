"""Stops that meet something else: a port that is opened again, another event loop, an error that is under way."""

import asyncio
import logging
import threading
import time

import pytest

import servobus
from servobus import RX28
from unit.served import Arm


def test_a_stop_that_waits_for_a_reopen_stops_and_leaves_the_bus_in_order() -> None:
    with Arm("rx28@1") as arm, arm.open() as bus:
        servo = bus.attach(RX28, 1)
        servo.torque_on()
        reopen = bus.transport.reopen
        begun = threading.Event()

        def slow() -> None:
            begun.set()
            reopen()
            time.sleep(0.05)

        bus.transport.reopen = slow  # type: ignore[method-assign]
        opening = threading.Thread(target=bus.reopen)
        opening.start()
        assert begun.wait(5)
        bus.make_safe()
        opening.join()
        assert not servo.permit.driven
        assert not bus.link.superseded
        servo.read(RX28.present_position)


def test_a_stop_that_outlives_its_event_loop_holds_up_no_other() -> None:
    with Arm("rx28@1") as arm:
        bus = servobus.open_async(arm.name, echo=False)
        servo = bus.attach(RX28, 1)

        async def first() -> None:
            await servo.torque_on()
            bus.attach(RX28, 9).permit.mark_moving()  # a silent one: the stop takes its time
            bus.make_safe()

        async def second() -> None:
            async with asyncio.timeout(10), bus:
                await servo.read(RX28.present_position)

        asyncio.run(first())
        asyncio.run(second())


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_the_error_under_way_is_the_one_that_comes_out(
    error: type[BaseException], caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.attach(RX28, 1)
        with caplog.at_level(logging.ERROR), pytest.raises(error), servo.torque():
            monkeypatch.setattr(bus.transport, "write", _gone)
            raise error
        assert "the torque may still be on" in caplog.text


def _gone(_: bytes) -> None:
    raise servobus.PortLost("unplugged")


def test_a_servo_that_is_attached_as_another_model_is_still_stopped() -> None:
    class Other(RX28):
        title, number = "Other", 65_001

    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        bus.attach(RX28, 1).torque_on()
        other = bus.attach(Other, 1)
        assert bus.safety.drives()
        bus.make_safe("free")
        assert not other.read("torque_enable")
