"""lewansoul-lx16a drives virtual LX-16As, over a pseudo terminal and over TCP, each test its own."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import serial

module = pytest.importorskip("lewansoul_lx16a")

Serve = Callable[..., str]
Eventually = Callable[[Callable[[], bool]], None]
LINKS = {"pty": (), "tcp": ("--tcp", "127.0.0.1:0")}


@pytest.fixture(scope="module", params=LINKS)
def controller(request: pytest.FixtureRequest, serve: Serve) -> Iterator[Any]:
    name = serve("lx16a@1-5", *LINKS[request.param])
    with serial.serial_for_url(name, baudrate=115_200, timeout=1) as port:
        yield module.ServoController(port, timeout=2)


def test_a_new_servo(controller: Any) -> None:
    assert controller.get_servo_id(1) == 1
    assert controller.get_position(1) == 500
    assert controller.get_position_offset(1) == 0
    assert controller.get_position_limits(1) == (0, 1000)
    assert controller.get_voltage_limits(1) == (6500, 12000)
    assert controller.get_max_temperature_limit(1) == 85
    assert (controller.get_temperature(1), controller.get_voltage(1)) == (25, 7400)
    assert (controller.get_mode(1), controller.get_motor_speed(1)) == (0, 0)
    assert controller.is_motor_on(1) is False  # EL-08: off until it is switched on
    assert controller.is_led_on(1) is True
    assert controller.get_led_errors(1) == 7
    with pytest.raises(module.TimeoutError):
        controller.get_position(6, timeout=0.2)


def test_moves(controller: Any, eventually: Eventually) -> None:
    for id in (2, 3, 4):
        controller.motor_on(id)
    controller.move(2, 900, 500)
    eventually(lambda: controller.get_position(2) == 900)
    controller.move_prepare(3, 100, 300)
    controller.move_prepare(4, 700, 300)
    assert controller.get_prepared_move(3) == (100, 300)
    assert controller.get_position(3) == 500
    controller.move_start()  # all of them
    eventually(lambda: (controller.get_position(3), controller.get_position(4)) == (100, 700))


def test_settings(controller: Any, eventually: Eventually) -> None:
    controller.set_position_offset(5, -50)
    assert controller.get_position_offset(5) == -50
    assert controller.get_position(5) == 550  # without torque the shaft stays where it is
    controller.set_position_limits(5, 100, 900)
    assert controller.get_position_limits(5) == (100, 900)
    controller.set_voltage_limits(5, 6000, 11000)
    assert controller.get_voltage_limits(5) == (6000, 11000)
    controller.set_max_temperature_limit(5, 70)
    assert controller.get_max_temperature_limit(5) == 70
    controller.led_off(5)
    assert controller.is_led_on(5) is False
    controller.set_led_errors(5, 5)
    assert controller.get_led_errors(5) == 5
    controller.set_motor_mode(5, -300)
    assert (controller.get_mode(5), controller.get_motor_speed(5)) == (1, -300)
    controller.motor_on(5)
    before = controller.get_position(5)
    eventually(lambda: bool(controller.get_position(5) < before))
    controller.set_servo_mode(5)
    assert controller.get_mode(5) == 0
    controller.set_servo_id(5, 9)
    assert controller.get_servo_id(9) == 9
