"""pylx16a drives virtual LX-16As, and an LX-224, over a pseudo terminal, each test its own. Its angles are degrees."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

module = pytest.importorskip("pylx16a.lx16a")
LX16A: Any = module.LX16A

Serve = Callable[..., str]
Eventually = Callable[[Callable[[], bool]], None]


@pytest.fixture(scope="module", autouse=True)
def port(serve: Serve) -> Iterator[None]:
    # Its 20 ms for an answer are what real servos need; a busy computer may need more.
    LX16A.initialize(serve("lx16a@1-7,lx224@20"), timeout=0.5)
    yield
    LX16A._controller.close()
    LX16A._controller = None


def test_a_new_servo() -> None:
    one = LX16A(1)
    assert one.get_id(poll_hardware=True) == 1
    assert one.get_physical_angle() == pytest.approx(120.0)
    assert one.get_angle_offset(poll_hardware=True) == 0
    assert one.get_angle_limits(poll_hardware=True) == (0.0, 240.0)
    assert one.get_vin_limits(poll_hardware=True) == (6500, 12000)
    assert one.get_temp_limit(poll_hardware=True) == 85
    assert one.is_motor_mode(poll_hardware=True) is False
    assert one.is_torque_enabled(poll_hardware=True) is True  # its constructor switches it on
    assert one.is_led_power_on(poll_hardware=True) is True
    assert one.get_led_error_triggers(poll_hardware=True) == (True, True, True)
    assert (one.get_temp(), one.get_vin()) == (25, 7400)
    with pytest.raises(module.ServoTimeoutError):
        LX16A(8)


def test_moves(eventually: Eventually) -> None:
    one, two, three = LX16A(2), LX16A(3), LX16A(4)
    started = time.monotonic()
    one.move(240, time=1000)
    assert one.get_last_instant_move_hw() == (240.0, 1000)
    assert 120 <= one.get_physical_angle() < 240
    eventually(lambda: math.isclose(one.get_physical_angle(), 240))
    assert time.monotonic() - started > 0.95
    two.move(60, time=300, wait=True)
    three.move(180, time=300, wait=True)
    assert two.get_last_delayed_move_hw() == (60.0, 300)
    assert two.get_physical_angle() == pytest.approx(120)
    two.move_start()
    three.move_start()
    eventually(lambda: math.isclose(two.get_physical_angle(), 60) and math.isclose(three.get_physical_angle(), 180))


def test_stop() -> None:
    one = LX16A(5)
    one.move(0, time=30000)
    time.sleep(0.1)
    one.move_stop()
    stopped = one.get_physical_angle()
    time.sleep(0.5)  # 2 degrees, if it were not
    assert one.get_physical_angle() == stopped
    assert 60 < stopped <= 120


def test_settings() -> None:
    one = LX16A(6)
    one.set_angle_offset(-12, permanent=True)
    assert one.get_angle_offset(poll_hardware=True) == pytest.approx(-12)
    one.set_angle_limits(24, 216)
    assert one.get_angle_limits(poll_hardware=True) == pytest.approx((24, 216))
    one.set_vin_limits(5000, 11000)
    assert one.get_vin_limits(poll_hardware=True) == (5000, 11000)
    one.set_temp_limit(70)
    assert one.get_temp_limit(poll_hardware=True) == 70
    one.led_power_off()
    assert one.is_led_power_on(poll_hardware=True) is False
    one.set_led_error_triggers(True, False, True)
    assert one.get_led_error_triggers(poll_hardware=True) == (True, False, True)
    one.disable_torque()
    assert one.is_torque_enabled(poll_hardware=True) is False
    one.set_id(9)
    assert one.get_id(poll_hardware=True) == 9


def test_motor_mode(eventually: Eventually) -> None:
    one = LX16A(7)
    before = one.get_physical_angle()
    one.motor_mode(-300)
    assert one.is_motor_mode(poll_hardware=True) is True
    assert one.get_motor_speed(poll_hardware=True) == -300
    eventually(lambda: bool(one.get_physical_angle() < before))
    one.servo_mode()
    assert one.is_motor_mode(poll_hardware=True) is False
    here = one.get_physical_angle()
    time.sleep(0.3)
    stopped = one.get_physical_angle()
    assert abs(stopped - here) < 1.5  # it had to brake
    time.sleep(0.2)
    assert one.get_physical_angle() == stopped


def test_an_lx_224_is_driven_alike(eventually: Eventually) -> None:
    one = LX16A(20)
    assert one.get_id(poll_hardware=True) == 20
    one.move(200, time=400)
    eventually(lambda: math.isclose(one.get_physical_angle(), 200, abs_tol=0.5))
    one.motor_mode(500)
    assert one.get_motor_speed(poll_hardware=True) == 500
    one.servo_mode()
    one.disable_torque()
    assert one.is_torque_enabled(poll_hardware=True) is False
