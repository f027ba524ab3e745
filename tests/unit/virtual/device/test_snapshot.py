import math

import pytest

from servobus.families.lewansoul.firmware import LewansoulServo
from servobus.families.registry import DRS0602, LX16A, RX28
from servobus.virtual.device.servo import virtual_servo
from servobus.virtual.device.snapshot import take_snapshot
from servobus.virtual.physics.motor import Load


@pytest.mark.parametrize("model", [RX28, DRS0602, LX16A])
def test_a_servo_from_its_box(model: type) -> None:
    seen = take_snapshot(virtual_servo(model, 7, temperature=31.0))
    assert (seen.title, seen.id, seen.powered, seen.torque) == (model.title, 7, True, False)  # type: ignore[attr-defined]
    assert (seen.speed, seen.duty, seen.current, seen.temperature, seen.errors) == (0, None, 0, 31.0, ())
    assert seen.voltage > 7


def test_a_stalled_servo() -> None:
    servo = virtual_servo(LX16A, 1)
    assert isinstance(servo, LewansoulServo)
    servo.shaft.load = Load(blocked=1.0)
    servo.put("torque_enable", 1)
    servo.put("mode", 1)
    servo.put("motor_speed", -1000)
    servo.advance(2.0)
    seen = take_snapshot(servo)
    assert (seen.duty, seen.torque, seen.errors) == (-1.0, True, ("locked rotor",))
    assert seen.current == pytest.approx(-7.4 / 2.9, rel=0.05)  # the winding is warm
    assert seen.angle == pytest.approx(math.radians(120))


def test_errors_of_every_family() -> None:
    for model, volts in ((RX28, 5.0), (DRS0602, 5.0), (LX16A, 5.0)):
        servo = virtual_servo(model, 1, voltage=volts)
        servo.advance(1.0)
        assert any("voltage" in word for word in take_snapshot(servo).errors)
    servo.power_off()
    assert (take_snapshot(servo).powered, take_snapshot(servo).torque, take_snapshot(servo).led) == (
        False,
        False,
        "off",
    )
