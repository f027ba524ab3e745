"""A servo as an object: what can be set on it, and which registers it takes."""

from typing import Any

import pytest

import servobus
from servobus import LX16A, RX28, UnknownName, UsageError, deg

ARM = "virtual:rx28@1,lx16a@2?clock=virtual"


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("goal_position", 1.0, r"RX-28 id 1: to write a register: servo\.write\(RX28\.goal_position, \.\.\.\)"),
        ("torque_enable", True, r"servo\.write\(RX28\.torque_enable, \.\.\.\)"),
        ("max_temperature", 80, r"servo\.write\(RX28\.highest_limit_temperature, \.\.\.\)"),
        ("led", True, r"servo\.write\(RX28\.led, \.\.\.\)"),
        ("position", 1.0, r"has no attribute 'position'; to write a register: servo\.write\(RX28\.goal_position"),
        ("torque", True, r"torque cannot be set; to write a register"),
        ("read", 1, r"read cannot be set"),
        ("model", LX16A, r"model cannot be set"),
        ("id", 5, r"id is not set like this; use servo\.change_id\(\.\.\.\)"),
        ("baud", 9600, r"baud is not set like this; use servo\.change_baud\(\.\.\.\)"),
    ],
)
def test_an_attribute_that_means_a_register_is_refused(name: str, value: Any, said: str) -> None:
    bus = servobus.open(ARM)
    servo = bus.attach(RX28, 1)
    servo.read(RX28.id)  # what is found on the object from then on can be set no more than before
    with pytest.raises(AttributeError, match=said):
        setattr(servo, name, value)
    assert bus.stats[1].sent == 1
    assert callable(servo.read)


def test_what_is_meant_to_be_set_can_be() -> None:
    servo = servobus.open(ARM).attach(RX28, 1)
    servo.max_step = 10 * deg
    servo.safe_action = "free"
    servo.state = None
    servo.alarms = servo.latched = 4
    assert (servo.max_step, servo.safe_action, servo.alarms) == (10 * deg, "free", 4)


def test_so_it_is_on_a_bus() -> None:
    bus: Any = servobus.open(ARM)
    bus.safe_action = "free"
    bus.bauds = (57_600,)
    for name in ("goal_position", "torque", "scan", "stats", "speed"):
        with pytest.raises(AttributeError, match=rf"has no attribute '{name}'.*bus\[id\]\.write\(RX28\.goal_position"):
            setattr(bus, name, 1)


def test_a_cycle_takes_registers_and_names_and_servos_and_ids() -> None:
    bus = servobus.open(ARM)
    rx, lx = bus.attach(RX28, 1), bus.attach(LX16A, 2)
    for read in (["present_position"], [RX28.present_position], RX28.present_position, "present_position"):
        cycle = bus.cycle(read=read, servos=[rx, 2], write="goal_position")
        seen = cycle.run()
        assert (set(seen), set(seen[1]), seen[lx] == seen[2]) == ({rx, lx}, {"present_position"}, True)
    with pytest.raises(UnknownName, match="LX-16A id 2: LX-16A has no register 'moving'"):
        bus.cycle(read=[RX28.moving])


def test_torque_takes_servos_and_ids_and_by_default_all() -> None:
    bus = servobus.open(ARM)
    rx, lx = bus.attach(RX28, 1), bus.attach(LX16A, 2)

    def on() -> list[bool]:
        bus.transport.sleep(0.1)
        return [real.torque for real in bus.transport.servos]  # type: ignore[attr-defined]

    bus.torque_on([1, lx])
    assert on() == [True, True]
    bus.torque_off([rx])
    assert on() == [False, True]
    bus.torque_off()
    assert on() == [False, False]
    with bus.torque([2]):
        assert on() == [False, True]
    bus.torque_on()
    assert on() == [True, True]
    bus.move({rx: 140 * deg, 2: 110 * deg}, time=0.2).wait()
    with pytest.raises(UnknownName, match=r"no servo with id 3 is known here \(known: 1, 2\)"):
        bus.torque_on([1, 3])


def test_a_name_or_an_alias_stands_for_a_register() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.find(1, family="dynamixel")
        assert servo.read("present_position") == servo.read(RX28.present_position)
        assert servo.read_raw(["present_position", RX28.moving]) == servo.read_raw([RX28.present_position, "moving"])
        servo.write("led", True)
        servo.write_many({"max_temperature": 70.0, RX28.punch: 0.1})
        servo.write_raw({"highest_limit_temperature": 71})
        servo.store({"max_temperature": 72.0})
        seen = servo.read_many(["led", "max_temperature", RX28.punch])
        assert seen == {"led": True, "highest_limit_temperature": 72.0, "punch": pytest.approx(0.1, abs=0.001)}


def test_a_name_that_is_none_sends_nothing() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        servo = bus.attach(RX28, 1)
        with pytest.raises(UnknownName, match="RX-28 has no register 'present_positon'; did you mean present_position"):
            servo.read("present_positon")
        with pytest.raises(
            UsageError, match=r"36 is no register: give one such as RX28\.present_position, or its name"
        ):
            servo.read(36)  # type: ignore[arg-type] # what a reader of the manual tries
        with pytest.raises(UsageError, match="highest_limit_temperature is given twice"):
            servo.write_many({"max_temperature": 70.0, RX28.highest_limit_temperature: 71.0})
        assert bus.stats.total.sent == 0
