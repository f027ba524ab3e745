# ruff: noqa: ARG005 - all cases take the same
"""Nobody moves: every method of servos and buses that is no motion by its name, on every family, in every mode.

The methods are listed from the code, so that a new one without a case here fails.
"""

import contextlib
from collections.abc import Callable
from typing import Any

import pytest

import servobus
from samples import one_model_of_each_family, turning
from servobus import MODELS, ServobusError, deg
from servobus.bus.base import BaseBus
from servobus.bus.servo import Servo
from servobus.core.operation import bus_method
from servobus.virtual.device.servo import VirtualServo

Case = Callable[[Any, Any], Any]

MOTION = {"start_move", "start_move_by", "start_planned", "turn", "wait_arrival", "has_ended", "cancel"}
"""Methods that move a servo by their name, or that are given a move."""

CASES: dict[str, Case] = {
    "ping": lambda bus, servo: servo.ping(),
    "look": lambda bus, servo: servo.look(),
    "read_alarms": lambda bus, servo: servo.read_alarms(),
    "verify": lambda bus, servo: servo.verify(),
    "read": lambda bus, servo: servo.read("present_position"),
    "read_many": lambda bus, servo: servo.read_many(["present_position", "goal_position"]),
    "read_raw": lambda bus, servo: servo.read_raw(["present_position"]),
    "write": lambda bus, servo: servo.write("max_position", servo.look().position + 5 * deg),
    "write_many": lambda bus, servo: servo.write_many({"max_position": servo.look().position - 20 * deg}),
    "write_raw": lambda bus, servo: servo.write_raw({"min_position": 0, "max_position": 0}),
    "store": lambda bus, servo: servo.store({"max_position": servo.look().position - 20 * deg}),
    "torque_on": lambda bus, servo: servo.torque_on(),
    "torque_off": lambda bus, servo: servo.torque_off(),
    "rearm": lambda bus, servo: servo.rearm(),
    "stop": lambda bus, servo: servo.stop(),
    "position_mode": lambda bus, servo: servo.position_mode(),
    "led": lambda bus, servo: servo.led("on"),
    "reboot": lambda bus, servo: servo.reboot(),
    "reset": lambda bus, servo: servo.reset(),
    "change_id": lambda bus, servo: servo.change_id(7),
    "change_baud": lambda bus, servo: servo.change_baud(servo.model.bauds[-1]),
    "backup": lambda bus, servo: servo.backup(),
    "restore": lambda bus, servo: servo.restore(servo.backup()),
    "scan": lambda bus, servo: bus.scan(ids=range(3)),
    "find": lambda bus, servo: bus.find(1),
    "read_all": lambda bus, servo: bus.read_all("present_position"),
    "plan_move": lambda bus, servo: bus.plan_move({servo: servo.look().position + 5 * deg}),
    "protect": lambda bus, servo: bus.protect(),
    "_take_hold": lambda bus, servo: bus._take_hold([servo], []),
    "_leave": lambda bus, servo: bus._leave([servo], [servo]),
}


def limp(servo: Any, real: VirtualServo, port: Any) -> None:
    real.turn_shaft(real.position + 25 * deg)
    port.sleep(0.1)


def holding(servo: Any, real: VirtualServo, port: Any) -> None:
    servo.torque_on()


def outside(servo: Any, real: VirtualServo, port: Any) -> None:
    servo.store({"max_position": servo.look().position - 30 * deg})


def turned(servo: Any, real: VirtualServo, port: Any) -> None:
    servo.torque_on()
    servo.turn(**turning(servo.model))
    port.sleep(0.3)
    servo.stop()
    port.sleep(0.8)


def turned_and_limp(servo: Any, real: VirtualServo, port: Any) -> None:
    servo.torque_on()
    servo.turn(**turning(servo.model))
    port.sleep(0.3)
    servo.torque_off()
    port.sleep(1.5)


def shut_down(servo: Any, real: VirtualServo, port: Any) -> None:
    servo.torque_on()
    real.temperature = 110.0
    port.sleep(1.0)
    servo.ping()
    port.sleep(0.1)
    real.turn_shaft(real.position + 25 * deg)
    real.temperature = 25.0
    port.sleep(0.5)


MODES = [limp, holding, outside, turned, turned_and_limp, shut_down]


def methods() -> set[str]:
    """List what a servo or a bus can be asked."""
    kinds = (kind for top in (Servo, BaseBus) for kind in top.__mro__)
    return {name for kind in kinds for name, item in vars(kind).items() if isinstance(item, bus_method)}


def test_every_method_has_a_case() -> None:
    assert methods() - MOTION == CASES.keys()


@pytest.mark.parametrize("reading", ["practice", "manual"])
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.__name__)
@one_model_of_each_family
def test_nobody_moves(key: str, mode: Any, reading: str) -> None:
    for name, case in CASES.items():
        bus = servobus.open(f"virtual:{key}@1?clock=virtual&as={reading}")
        port: Any = bus.transport
        servo = bus.find(1, family=MODELS[key].family)
        mode(servo, port.servos[0], port)
        here = port.servos[0].shaft.position
        with contextlib.suppress(ServobusError):  # a refusal moves nothing either
            case(bus, servo)
        for _ in range(12):
            port.sleep(0.1)
            assert port.servos[0].shaft.position == pytest.approx(here, abs=0.4 * deg), name
