"""Pollen Robotics' rustypot drives virtual RX-28s over a pseudo terminal, as an AX and as an MX.

Both have the RX-28's addresses for what is used here. What they have besides, the RX-28 refuses as the
real one would: SYNC_READ (0x82) is no instruction of the RX-28, and goes to id 254, so that it is not
answered at all; of MX goals, 0 .. 4095, only 0 .. 1023 are in range.
"""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

rustypot = pytest.importorskip("rustypot")

Serve = Callable[..., str]
Eventually = Callable[[Callable[[], bool]], None]
RANGE = 0x08


@pytest.fixture(scope="module", params=["AxPyController", "MxPyController"])
def controller(request: pytest.FixtureRequest, serve: Serve) -> Iterator[Any]:
    controller = getattr(rustypot, request.param)(serve("rx28@1-6"), 57_600, 0.5)
    yield controller
    controller.close()


def test_ping_read_write_and_move_one_or_several(controller: Any, eventually: Eventually) -> None:
    assert controller.ping(1) is True
    assert controller.ping(9) is False
    # Its scan gives an answer a few milliseconds, whatever the time-out; a busy computer may need more.
    eventually(lambda: bool(controller.scan([1, 3]) == {1: 28, 3: 28}))
    assert controller.read_model_number(2) == [28]
    assert controller.read_return_delay_time(2) == [250]
    assert controller.read_present_voltage(2) == [144]
    assert controller.read_present_temperature(2) == [25]
    controller.write_led(2, 1)
    assert controller.read_led(2) == [1]
    controller.write_torque_enable(1, 1)
    controller.write_moving_speed(1, 300)
    controller.write_raw_goal_position(1, 800)
    assert controller.read_moving(1) == [1]
    eventually(lambda: controller.read_moving(1) == [0])
    assert controller.read_raw_present_position(1) == [800]
    assert controller.read_raw_goal_position(1) == [800]
    controller.sync_write_torque_enable([3, 4, 5], [1, 1, 1])
    controller.sync_write_raw_goal_position([3, 4, 5], [200, 400, 600])
    eventually(lambda: [controller.read_raw_present_position(id)[0] for id in (3, 4, 5)] == [200, 400, 600])


def test_what_the_rx28_refuses_and_does_not_know(controller: Any) -> None:
    assert controller.write_register_with_error(6, "goal_position", 1024) == RANGE
    assert controller.write_raw_data_with_error(6, 0, [5]) == RANGE
    assert controller.read_raw_data_with_error(6, 0, 2) == ([28, 0], 0)
    assert controller.supports_sync_read()
    with pytest.raises(RuntimeError, match="timed out"):
        controller.sync_read_raw_present_position([3, 4, 5])  # 0x82 is no instruction of the RX-28
    assert controller.ping(6) is True  # and does no harm


def test_an_mx_drives_mx_28s(serve: Serve, eventually: Eventually) -> None:
    """Gains, goals and speeds of the MX, in its units."""
    controller = rustypot.MxPyController(serve("mx28@1-3"), 57_600, 0.5)
    try:
        eventually(lambda: bool(controller.scan([1, 3, 4]) == {1: 29, 3: 29}))
        assert controller.read_p_gain(1) == [32]
        controller.write_p_gain(1, 64)
        assert controller.read_p_gain(1) == [64]
        controller.write_goal_acceleration(1, 10)
        assert controller.read_goal_acceleration(1) == [10]
        controller.write_torque_enable(1, 1)
        controller.write_goal_position(1, 1.0)  # rad from the middle: 2048 + 1 / (2 pi / 4096)
        assert controller.read_raw_goal_position(1) == [pytest.approx(2700, abs=1)]
        eventually(lambda: controller.read_moving(1) == [0])
        assert controller.read_present_position(1) == [pytest.approx(1.0, abs=0.01)]
        controller.sync_write_raw_goal_position([2, 3], [1000, 3000])
        eventually(lambda: [controller.read_moving(id)[0] for id in (2, 3)] == [0, 0])
        assert [controller.read_raw_present_position(id)[0] for id in (2, 3)] == pytest.approx([1000, 3000], abs=8)
        with pytest.raises(RuntimeError, match="timed out"):
            controller.sync_read_raw_present_position([2, 3])  # 0x82 is no instruction of protocol 1.0 (ED-52)
    finally:
        controller.close()


def test_an_ax_drives_ax_12as(serve: Serve, eventually: Eventually) -> None:
    controller = rustypot.AxPyController(serve("ax12a@1-2"), 1_000_000, 0.5)
    try:
        eventually(lambda: bool(controller.scan([1, 2, 3]) == {1: 12, 2: 12}))
        controller.write_torque_enable(2, 1)
        controller.write_goal_position(2, 1.0)  # rad from the middle: 57.3 degrees, 195 of 1023 for 300 degrees
        assert controller.read_raw_goal_position(2) == [pytest.approx(707, abs=1)]
        eventually(lambda: controller.read_moving(2) == [0])
        assert controller.read_present_position(2) == [pytest.approx(1.0, abs=0.01)]
        assert controller.write_register_with_error(1, "goal_position", 1024) == RANGE
    finally:
        controller.close()


def test_angles_of_an_ax(serve: Serve, eventually: Eventually) -> None:
    controller = rustypot.AxPyController(serve("rx28@1"), 57_600, 0.5)
    try:
        controller.write_torque_enable(1, 1)
        controller.write_goal_position(1, -1.0)  # rad from the middle
        eventually(lambda: controller.read_moving(1) == [0])
        assert controller.read_present_position(1) == [pytest.approx(-1.0, abs=0.01)]
        # -57.3 degrees from 150 are 92.7, which is 316 of 1023 for 300 degrees.
        assert controller.read_raw_present_position(1) == [pytest.approx(316, abs=1)]
    finally:
        controller.close()
