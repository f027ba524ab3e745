"""Servos whose model is not known: what their protocol gives works, and what needs a unit does not."""

from collections.abc import Callable
from typing import Any

import pytest

import servobus
from servobus import DRS0602, RX28, BadValue, BusServo, UsageError, deg
from servobus.families import registry
from servobus.families.base import Answers, Model
from servobus.families.herkulex.protocol import StatusError
from servobus.virtual.device.servo import VirtualServo

NUMBERS: dict[str, tuple[type[Model], int, str]] = {
    # An XL430-W250 has the number 1060, and speaks protocol 2.0 only: ROBOTIS e-manual. No HerkuleX reports 09 09.
    "dynamixel": (RX28, 1060, "Dynamixel servo, model 1060"),
    "herkulex": (DRS0602, 0x0909, "HerkuleX servo, model 0909"),
}
FAMILIES = pytest.mark.parametrize("family", NUMBERS)


class Drawer:
    """One virtual servo, id 1, that reports a number which no known model has."""

    def __init__(self, family: str, *, mute: bool = False, **options: Any) -> None:
        self.known, number, self.title = NUMBERS[family]
        self.bus = servobus.open(f"virtual:{self.known.key()}@1?clock=virtual", **options)
        memory = self.real.memory
        if family == "dynamixel":
            memory[RX28.model_number] = number
        else:
            memory[DRS0602.model_no1], memory[DRS0602.model_no2] = number.to_bytes(2)
        if mute:
            memory[self.known.register("answer_level")] = Answers.NOTHING

    @property
    def real(self) -> VirtualServo:
        real: VirtualServo = self.bus.transport.servos[0]  # type: ignore[attr-defined] # a virtual port
        return real

    def driven(self) -> bool:
        return self.real.torque

    def find(self) -> BusServo:
        return self.bus.find(1, family=self.known.family)


@FAMILIES
def test_T1_a_number_that_nobody_knows_is_no_known_model(family: str) -> None:
    drawer = Drawer(family)
    servo = drawer.find()
    assert servo.model.generic
    assert servo.model.title == drawer.title
    assert str(servo).startswith(f"{drawer.title}, id 1 at {drawer.known.factory_baud}: position ")
    assert drawer.find() is servo
    (found,) = drawer.bus.scan(ids=range(4))
    assert found is servo


@FAMILIES
def test_T1_a_servo_that_says_nothing_is_no_known_model(family: str) -> None:
    servo = Drawer(family, mute=True).find()
    assert servo.model is registry.GENERIC[family]
    assert "model unknown, id 1" in str(servo)
    with pytest.raises(UsageError, match=r"`servobus write PORT 1 \w+=\w+` lets it answer"):
        servo.read("present_position")


def test_T1_one_lost_read_makes_no_model() -> None:
    drawer = Drawer("dynamixel")
    port: Any = drawer.bus.transport
    write, lost = port.write, 0

    def lossy(data: bytes) -> None:
        nonlocal lost
        if data[4:7] == bytes((2, 0, 17)):  # the long read of `identify`
            lost += 1
            return
        write(data)

    port.write = lossy
    servo = drawer.find()
    assert lost
    assert servo.model.title == drawer.title
    assert servo.target.answers is Answers.EVERYTHING


def test_T1_what_a_servo_said_before_it_fell_silent_holds() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.find(1)
        servo.write(RX28.status_return_level, 0)
        assert bus.find(1).model is RX28


@FAMILIES
def test_T1_no_angle_is_sent_to_an_unknown_model(family: str) -> None:
    drawer = Drawer(family)
    servo = drawer.find()
    servo.torque_on()
    before = drawer.real.position
    refused: list[Callable[[], Any]] = [
        lambda: servo.move(10 * deg),
        lambda: drawer.bus.move({1: 10 * deg}),
        lambda: servo.turn(output=0.1),
        lambda: servo.turn(speed=1.0),
        servo.position_mode,
        lambda: servo.restore(servo.backup()),
        lambda: servo.read(drawer.known.goal_position),  # type: ignore[attr-defined] # both have one
    ]
    for verb in refused:
        with pytest.raises(UsageError, match="--model"):
            verb()
    for name in ("goal_position", "min_position", "max_position"):
        with pytest.raises(BadValue, match="--model"):
            servo.write(name, 100)
    drawer.bus.transport.sleep(1.0)
    assert drawer.real.position == pytest.approx(before, abs=0.5 * deg)


@FAMILIES
def test_T2_what_the_protocol_gives_works(family: str) -> None:
    drawer = Drawer(family)
    servo = drawer.find()
    servo.ping()
    assert isinstance(servo.read("present_position"), int)
    assert servo.look().torque is False
    before = drawer.real.position
    servo.torque_on()
    drawer.bus.transport.sleep(1.0)
    assert drawer.driven()
    assert drawer.real.position == pytest.approx(before, abs=0.5 * deg)
    servo.stop()
    assert drawer.real.position == pytest.approx(before, abs=0.5 * deg)
    servo.torque_off()
    servo.rearm()
    assert drawer.driven()
    drawer.bus.make_safe()
    servo.torque_off()
    assert not drawer.driven()
    servo.led("on")
    drawer.bus.transport.sleep(0.1)  # a HerkuleX does not answer that
    assert drawer.real.led != "off"
    servo.change_id(7)
    servo.change_baud(500_000)
    assert (drawer.real.id, drawer.real.baud) == (7, 500_000)
    if family == "herkulex":
        servo.reboot()
    assert servo.model.title == drawer.title


@FAMILIES
def test_T2_alarms_are_shown(family: str) -> None:
    drawer = Drawer(family)
    drawer.real.voltage = 4.0
    drawer.bus.transport.sleep(2.0)
    assert "ALARM input_voltage" in str(drawer.find())


def test_T2_a_herkulex_is_rearmed() -> None:
    drawer = Drawer("herkulex")
    drawer.real.memory[DRS0602.status_error] = StatusError.OVERLOAD
    servo = drawer.find()
    assert servo.alarm_text() == "overload"
    servo.rearm()
    assert servo.alarms == 0
    assert drawer.driven()


@FAMILIES
def test_T1_the_model_can_be_told(family: str) -> None:
    known = NUMBERS[family][0]
    for models in (known.key(), {1: known}):
        assert Drawer(family, models=models).find().model is known
        assert Drawer(family, mute=True, models=models).find().model is known
    drawer = Drawer(family)
    assert drawer.bus.attach(known, 1).model is known
    assert drawer.find().model is known
    assert Drawer(family, models=family).find().model.generic


def test_T1_settings_of_an_unknown_lx_fit_the_lx_16a() -> None:
    with servobus.open("virtual:lx16a@1?clock=virtual", models="lx") as bus:
        unknown = bus.find(1)
        assert str(unknown).startswith("LX/HTS bus servo, model unknown, id 1 at 115200: 120.0°, 7.4 V")
        unknown.torque_on()
        unknown.move(100 * deg, time=0.5).wait()
        saved = unknown.backup()
        known = bus.attach(servobus.LX16A, 1)
        assert known.restore(saved) == []
        assert bus.attach(registry.GENERIC["lewansoul"], 1).restore(known.backup()) == []
