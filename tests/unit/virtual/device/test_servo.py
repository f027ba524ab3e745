import pytest

from servobus.core.units import deg
from servobus.errors import BadValue, UnknownName, UsageError
from servobus.families.dynamixel.firmware import ComplianceServo
from servobus.families.registry import LX16A, RX28
from servobus.virtual.device.servo import VirtualServo, virtual_servo


def moving(position: float = 0.0) -> VirtualServo:
    servo = virtual_servo(RX28, 1, position=position)
    servo.put("torque_enable", 1)
    servo.put("goal_position", 1023)
    servo.put("moving_speed", 200)
    return servo


def test_the_model_decides_the_firmware() -> None:
    servo = virtual_servo(RX28, 7, voltage=12.5, temperature=40.0, position=1.0)
    assert type(servo) is ComplianceServo
    assert (servo.id, servo.voltage, servo.temperature, servo.position) == (7, 12.5, 40.0, 1.0)
    assert (servo.powered, servo.torque, servo.model) == (True, False, RX28)


def test_without_being_told() -> None:
    servo = virtual_servo(RX28)
    assert (servo.id, servo.voltage, servo.temperature) == (1, 14.4, 25.0)
    assert servo.position == pytest.approx(150 * deg)


def test_ids_are_checked() -> None:
    with pytest.raises(BadValue):
        virtual_servo(RX28, 254)


def test_a_model_without_firmware() -> None:
    class Strange(RX28):
        title = "Strange"
        firmware = ""

    with pytest.raises(UnknownName, match="no virtual servo for Strange"):
        virtual_servo(Strange, 1)


@pytest.mark.parametrize(
    ("reference", "missing"),
    [
        ("servobus.nowhere:Servo", "no module servobus.nowhere"),
        ("servobus.families.dynamixel.firmware:Nothing", "no 'Nothing'"),
    ],
)
def test_firmware_that_is_not_where_the_model_says(reference: str, missing: str) -> None:
    class Strange(RX28):
        title = "Strange"
        firmware = reference

    with pytest.raises(UnknownName, match=missing):
        virtual_servo(Strange, 1)


def test_two_models_of_one_family_can_have_firmware_of_their_own() -> None:
    class Strange(RX28):
        title = "Strange"
        firmware = f"{__name__}:Slow"

    assert type(virtual_servo(Strange, 1)) is Slow
    assert type(virtual_servo(RX28, 1)) is ComplianceServo


class Slow(ComplianceServo):
    tick = 0.01


@pytest.mark.parametrize("steps", [1, 7, 1000, 12345])
def test_how_time_is_cut_makes_no_difference(steps: int) -> None:
    servo = moving()
    for step in range(1, steps + 1):
        servo.advance(1.2345 * step / steps)
    whole = moving()
    whole.advance(1.2345)
    assert (servo.position, servo.shaft.velocity) == (whole.position, whole.shaft.velocity)


def test_time_does_not_run_backwards() -> None:
    servo = moving()
    servo.advance(1.0)
    position = servo.position
    servo.advance(0.5)
    assert (servo.position, servo.time) == (position, 1.0)


def test_long_rests_cost_nothing() -> None:
    servo = virtual_servo(RX28, 1)
    servo.put("torque_enable", 1)
    servo.advance(1e9)
    assert servo.position == pytest.approx(150 * deg, abs=0.003)


def test_power_off_stops_and_frees() -> None:
    servo = moving()
    servo.advance(0.1)
    servo.power_off()
    position = servo.position
    servo.advance(5.0)
    assert servo.position == position
    assert servo.led == "off"
    servo.turn_shaft(1.0)
    servo.power_on(6.0)
    assert servo.get("goal_position") == servo.row("goal_position").scale.encode(1.0)


def test_hand_against_torque() -> None:
    with pytest.raises(UsageError, match="torque is on"):
        moving().turn_shaft(0.0)


def test_goal_follows_the_hand_while_the_torque_is_off() -> None:
    servo = virtual_servo(RX28, 1)
    servo.turn_shaft(60 * deg)
    servo.advance(0.1)
    assert servo.get("goal_position") == 205


def test_stored_speed() -> None:
    servo = virtual_servo(RX28, 1)
    servo.store_baud(1_000_000)
    assert servo.baud == 1e6
    servo.power_on(1.0)
    assert servo.baud == 1e6
    with pytest.raises(BadValue):
        servo.store_baud(700_000)


def test_servo_with_one_speed_only() -> None:
    servo = virtual_servo(LX16A, 1)
    servo.store_baud(115_200)
    with pytest.raises(BadValue, match="one speed"):
        servo.store_baud(9600)


def test_speed_depends_on_the_supply() -> None:
    servo = virtual_servo(RX28, 1)
    speeds = {}
    for voltage in (0.0, 6.0, 12.0, 16.0):
        servo.voltage = voltage
        speeds[voltage] = servo.top_speed
    assert speeds[0.0] == 0
    assert 60 * deg / speeds[12.0] == pytest.approx(0.167, rel=0.01)
    assert 60 * deg / speeds[16.0] == pytest.approx(0.126, rel=0.01)
    assert speeds[6.0] < speeds[12.0] / 2  # friction takes its share first
