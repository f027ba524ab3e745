"""Modes beside angles of one turn: several turns, wheel by speed or by output, control of the current.

Figures are those of the ROBOTIS e-manual, pages mx-28 and mx-64: multi-turn mode is both angle limits 4095, its goals
are -28672 .. 28672 in two's complement, wheel mode is both limits 0; 0.088° and 0.114 rpm; 4.5 mA a unit of torque.
"""

from typing import Any

import pytest

import servobus
from samples import has, keys_that, limits_turn, models_that
from servobus import MODELS, BadValue, OutsideLimits, UsageError, deg, rpm
from servobus.core.registers import Int
from servobus.families.base import Model
from servobus.families.dynamixel.models.mx import MX28, MX64
from servobus.families.motion import Reach

UNIT = 360 / 4096 * deg
LIMITS = ["min_position", "max_position"]


def counts_turns(model: type[Model]) -> bool:
    return has(model, "multi_turn_offset")


def controls_current(model: type[Model]) -> bool:
    return has(model, "goal_torque")


several_turns = models_that(counts_turns)
by_current = models_that(controls_current)


def arm(key: str, position: float = 90 * deg, **memory: int) -> tuple[Any, Any, Any]:
    bus = servobus.open(f"virtual:{key}@1?clock=virtual")
    (servo,) = bus.scan(ids=[1])
    port: Any = bus.transport
    (real,) = port.servos
    for name, raw in memory.items():
        servo.write_raw({name: raw})
    real.turn_shaft(position)
    port.sleep(0.1)
    return servo, real, port


def still(port: Any, real: Any, seconds: float = 1.0) -> bool:
    before = real.shaft.position
    port.sleep(seconds)
    return bool(abs(real.shaft.position - before) < 0.5 * deg)


# What limits mean


@pytest.mark.parametrize(
    ("model", "limits", "reach"),
    [
        ("mx28", (0, 4095), Reach(0, 4095)),
        ("mx28", (0, 0), Reach(0, 0, turning=True)),
        ("mx28", (4095, 4095), Reach(-28672, 28672)),
        ("mx28", (0, 1023), Reach(0, 1023)),
        ("ax12a", (0, 0), Reach(0, 0, turning=True)),
        ("ax12a", (1023, 1023), Reach(1023, 1023)),
        ("ex106p", (4095, 4095), Reach(4095, 4095)),
        ("dx117", (0, 0), Reach(0, 0)),
    ],
)
def test_what_two_limits_mean(model: str, limits: tuple[int, int], reach: Reach) -> None:
    assert MODELS[model].family.reach(MODELS[model], *limits) == reach


def test_goals_beyond_a_turn_on_the_wire() -> None:
    goal = MX28.goal_position
    for angle, raw, wire in ((7 * 360, 28672, "00 70"), (-7 * 360, -28672, "00 90"), (-90, -1024, "00 fc")):
        assert goal.encode(angle * deg) == raw
        assert goal.layout.pack(raw).hex(" ") == wire
        assert goal.layout.unpack(bytes.fromhex(wire)) == raw
    with pytest.raises(BadValue):
        goal.encode(7.01 * 360 * deg)
    assert goal.layout == Int(2, signed=True)


def test_speeds_above_1_mbit() -> None:
    """250, 251 and 252 are codes of their own; of the others 2000000 / (code + 1) is the speed."""
    for baud, code in ((2_250_000, 250), (2_500_000, 251), (3_000_000, 252), (1_000_000, 1), (57_600, 34)):
        assert MX28.baud_rate.encode(baud) == code
    assert [MX28.baud_rate.decode(code) for code in (250, 251, 252, 1)] == [2_250_000, 2_500_000, 3_000_000, 1_000_000]
    with pytest.raises(BadValue):
        MX28.baud_rate.encode(7_968)  # 2000000 / 251
    with pytest.raises(BadValue):
        MODELS["ax12a"].register("baud").encode(2_250_000)


def test_the_current_of_an_mx64() -> None:
    assert MX64.present_current.decode(2048 + 100) == pytest.approx(0.45)
    assert MX64.present_current.decode(2048 - 100) == pytest.approx(-0.45)
    assert not MX64.present_current.writable  # ED-41
    assert MX64.goal_torque.layout.pack(MX64.goal_torque.encode(-0.45)).hex(" ") == "64 04"


# Several turns


@several_turns
def test_goals_of_several_turns_either_way(key: str) -> None:
    servo, real, port = arm(key)
    servo.torque_on()
    servo.position_mode(multi_turn=True)
    assert still(port, real)
    assert servo.read_raw(LIMITS) == [4095, 4095]
    assert servo.look().torque
    for turns in (3, -2.5):
        start, before = real.shaft.position, servo.look().position
        servo.move(turns * 360 * deg, speed=300 * deg).wait()
        assert servo.look().position == pytest.approx(turns * 360 * deg, abs=3 * deg)
        assert real.shaft.position - start == pytest.approx(turns * 360 * deg - before, abs=3 * deg)
    with pytest.raises(BadValue, match=r"is outside -2520\.0° \.\. 2520\.0°"):
        servo.move(7.5 * 360 * deg, time=10)
    servo.move(-3 * 360 * deg, speed=90 * deg)
    port.sleep(0.5)
    assert str(servo.stop()).startswith("held at -")
    port.sleep(0.3)
    assert still(port, real)


@several_turns
def test_a_divided_resolution_counts_where_a_servo_comes_in_from_outside_its_limits(key: str) -> None:
    servo, real, port = arm(key, min_position=4095, max_position=4095, multi_turn_offset=24576, resolution_divider=4)
    real.turn_shaft(real.shaft.position + 4 * (28672 + 100 - 24576) * UNIT)
    port.sleep(0.1)
    before, began = real.shaft.position, port.now()
    servo.max_step = 100 * deg
    with pytest.raises(BadValue, match="in one step is more than its max_step"):
        servo.torque_on(to_limit=True)
    servo.max_step = None
    servo.torque_on(to_limit=True, speed=60 * deg)
    way = before - real.shaft.position
    assert way > 120 * deg
    assert port.now() - began > 0.9 * way / (60 * deg)


@several_turns
def test_back_to_one_turn(key: str) -> None:
    servo, real, port = arm(key)
    servo.torque_on()
    servo.position_mode(multi_turn=True)
    servo.position_mode(multi_turn=True)
    servo.move(500 * deg, speed=300 * deg).wait()
    before = real.memory.stored()
    with pytest.raises(OutsideLimits, match=r"is at \d+\.\d°, outside the limits that it would get") as refused:
        servo.position_mode()
    assert str(refused.value).endswith("move it inside first, or switch its torque off")
    assert "to_limit" not in str(refused.value)
    assert real.memory.stored() == before
    assert servo.look().torque
    servo.move(200 * deg, speed=300 * deg).wait()
    servo.position_mode((20 * deg, 300 * deg))
    assert still(port, real)
    assert servo.read_raw(LIMITS) == [round(20 / 360 * 4096), round(300 / 360 * 4096)]
    assert servo.look().torque
    assert servo.look().position == pytest.approx(200 * deg, abs=3 * deg)


@several_turns
def test_without_torque_it_goes_back_from_anywhere(key: str) -> None:
    servo, real, port = arm(key)
    servo.position_mode(multi_turn=True)
    real.turn_shaft(real.shaft.position + 4 * 360 * deg)
    port.sleep(0.1)
    assert servo.look().position == pytest.approx((90 + 4 * 360) * deg, abs=1 * deg)
    servo.position_mode()
    assert servo.look().position == pytest.approx(90 * deg, abs=1 * deg)
    servo.torque_on()
    assert still(port, real)


@several_turns
@pytest.mark.parametrize(("offset", "divider"), [(1024, 1), (-2048, 1), (0, 2), (5000, 4)])
def test_present_position_is_real_by_divider_and_offset(key: str, offset: int, divider: int) -> None:
    """What the page says: present = real / divider + offset; 512 steps are 45°."""
    servo, real, port = arm(key, 45 * deg, multi_turn_offset=offset, resolution_divider=divider)
    assert servo.look().position == pytest.approx(45 * deg, abs=UNIT)  # it acts in multi-turn mode alone
    servo.torque_on()
    servo.position_mode(multi_turn=True)
    assert still(port, real)
    (raw,) = servo.read_raw(["present_position"])
    assert raw == pytest.approx(512 / divider + offset, abs=1)
    assert servo.look().position == pytest.approx(raw * UNIT)
    start, goal = real.shaft.position, servo.look().position + 90 * deg
    servo.move(goal, speed=60 * deg).wait()
    assert real.shaft.position - start == pytest.approx(90 * deg * divider, abs=4 * deg)
    if 0 <= servo.look().position <= 359 * deg:
        servo.position_mode()
        assert still(port, real)


@several_turns
@pytest.mark.parametrize("driven", [True, False])
def test_limits_that_are_written_by_hand_obey_the_rules_of_motion(key: str, driven: bool) -> None:
    servo, real, port = arm(key, multi_turn_offset=3000)
    if not driven:
        servo.write_raw(dict.fromkeys(LIMITS, 4095))
        assert servo.read_raw(LIMITS) == [4095, 4095]
        servo.write_raw({"min_position": 0})  # of both: the other is 4095 and not 28672
        assert servo.read_raw(LIMITS) == [0, 4095]
        return
    servo.torque_on()
    for values, said in (((4095, 4095), "counted otherwise"), ((0, 0), "endless turn")):
        before = real.memory.stored()
        with pytest.raises(UsageError, match=said):
            servo.write_raw(dict(zip(LIMITS, values, strict=True)))
        assert real.memory.stored() == before
    servo.position_mode(multi_turn=True)
    for values, said in (((0, 4095), "counted otherwise"), ((0, 0), "endless turn")):
        with pytest.raises(UsageError, match=said):
            servo.write_raw(dict(zip(LIMITS, values, strict=True)))
    with pytest.raises(UsageError, match="counted otherwise"):
        servo.write_raw({"min_position": 0})
    with pytest.raises(UsageError, match="may turn by a new multi_turn_offset; switch its torque off first"):
        servo.write_raw({"multi_turn_offset": 0})
    assert still(port, real)


@pytest.mark.parametrize("key", ["rx28", "ex106p", "dx117", "drs0602", "lx16a"])
def test_others_have_one_turn(key: str) -> None:
    servo = servobus.open(f"virtual:{key}@1?clock=virtual").attach(MODELS[key], 1)
    with pytest.raises(UsageError, match="cannot count its goals over several turns"):
        servo.position_mode(multi_turn=True)


@several_turns
def test_a_wheel_comes_back_to_several_turns(key: str) -> None:
    servo, real, port = arm(key)
    servo.torque_on()
    servo.position_mode(multi_turn=True)
    servo.turn(speed=60 * deg)
    port.sleep(0.5)
    servo.stop()
    port.sleep(0.3)
    servo.position_mode(multi_turn=True)
    assert still(port, real)
    assert servo.read_raw(LIMITS) == [4095, 4095]


# Endless turn


@several_turns
@pytest.mark.parametrize("way", [1, -1])
def test_an_mx_turns_at_a_speed(key: str, way: int) -> None:
    servo, real, port = arm(key)
    servo.torque_on()
    servo.turn(speed=way * 20 * rpm)
    port.sleep(1.0)
    assert real.shaft.velocity == pytest.approx(way * 20 * rpm, rel=0.1)
    unit = 0.916 if key == "mx12w" else 0.114
    assert servo.read_raw(["moving_speed"]) == [way * round(20 / unit)]
    assert str(servo.stop()) == "it turns no more"
    port.sleep(0.3)
    assert still(port, real)
    with pytest.raises(UsageError, match=r"its endless turn controls the speed; give speed="):
        servo.turn(output=0.3)
    with pytest.raises(BadValue):
        servo.turn(speed=2000 * rpm)


@pytest.mark.parametrize("key", keys_that(lambda model: limits_turn(model) and not model.turns_at_speed()))
def test_others_turn_by_output(key: str) -> None:
    servo, real, port = arm(key)
    servo.torque_on()
    servo.turn(output=-0.5)
    port.sleep(0.5)
    assert servo.read_raw(["moving_speed"]) == [-512]
    assert real.shaft.velocity < -0.1
    with pytest.raises(UsageError, match=r"give output=-1\.\.1"):
        servo.turn(speed=1.0)


# Control of the current


@by_current
def test_torque_control_begins_and_ends_without_a_jump(key: str) -> None:
    servo, real, port = arm(key)
    servo.torque_on()
    limits = servo.read_raw(LIMITS)
    servo.turn(current=0.45)
    assert servo.read_raw(["torque_control_mode_enable", "goal_torque"]) == [1, 100]
    port.sleep(0.5)
    assert real.shaft.velocity > 0.5
    with pytest.raises(UsageError, match="turns without end"):
        servo.move(90 * deg)
    assert str(servo.stop()).startswith("held at ")
    assert servo.read_raw(["torque_control_mode_enable", "goal_torque", *LIMITS]) == [0, 0, *limits]
    port.sleep(2.0)
    assert still(port, real)
    servo.verify()  # what a stop has changed is no restart
    servo.position_mode()
    assert still(port, real)
    assert servo.read_raw(["torque_control_mode_enable", "goal_torque", *LIMITS]) == [0, 0, *limits]
    assert servo.look().torque
    servo.move(60 * deg, speed=90 * deg).wait()


@by_current
@pytest.mark.parametrize("mode", ["one turn", "several turns", "wheel"])
@pytest.mark.parametrize("options", ["", ",turn_goal=refused,goal_after_turn=kept,goal_after_limp=kept"])
def test_a_stop_holds_what_hangs_on_a_servo_in_torque_control(key: str, mode: str, options: str) -> None:
    bus = servobus.open(f"virtual:{key}@1{options}?clock=virtual&load=torque=0.5")
    (servo,) = bus.scan(ids=[1])
    port: Any = bus.transport
    (real,) = port.servos
    servo.torque_on()
    if mode == "several turns":
        servo.position_mode(multi_turn=True)
    elif mode == "wheel":
        servo.turn(speed=30 * deg)
    servo.turn(current=0.6)
    port.sleep(0.2)
    servo.stop()
    port.sleep(0.5)
    assert still(port, real)
    assert servo.read_raw(["torque_enable", "torque_control_mode_enable"]) == [1, 0]


@by_current
@pytest.mark.parametrize("current", [2.0, -2.0])
def test_a_stop_near_the_end_of_a_turn_does_not_run_back_over_all_of_it(key: str, current: float) -> None:
    for seconds in (0.2, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7):
        servo, real, port = arm(key)
        servo.torque_on()
        servo.turn(current=current)
        port.sleep(seconds)
        before = real.shaft.position
        servo.stop()
        port.sleep(1.0)
        assert abs(real.shaft.position - before) < 45 * deg


@by_current
def test_from_torque_control_to_a_wheel_and_back(key: str) -> None:
    servo, real, port = arm(key)
    servo.torque_on()
    servo.turn(current=-0.45)
    port.sleep(0.3)
    servo.turn(speed=60 * deg)
    port.sleep(0.5)
    assert servo.read_raw(["torque_control_mode_enable", "goal_torque", *LIMITS]) == [0, 0, 0, 0]
    assert real.shaft.velocity == pytest.approx(60 * deg, rel=0.1)
    servo.turn(current=0.2)
    assert servo.read_raw(["torque_control_mode_enable", *LIMITS]) == [1, 0, 0]
    servo.stop()
    port.sleep(2.0)
    servo.position_mode()
    assert still(port, real)
    assert servo.read_raw(LIMITS) == [0, 4095]


@by_current
def test_torque_on_leaves_no_old_current(key: str) -> None:
    servo, real, port = arm(key)
    servo.torque_on()
    servo.turn(current=0.45)
    port.sleep(0.2)
    servo.torque_off()
    port.sleep(3.0)
    servo.torque_on()
    assert servo.read_raw(["goal_torque"]) == [0]
    assert still(port, real)


@by_current
def test_torque_control_by_hand_is_motion(key: str) -> None:
    servo, real, port = arm(key)
    with pytest.raises(servobus.TorqueOff):
        servo.write_raw({"torque_control_mode_enable": 1})
    with pytest.raises(servobus.TorqueOff):
        servo.turn(current=0.3)
    servo.torque_on()
    servo.turn(current=0.0)
    with pytest.raises(UsageError, match="turns without end"):
        servo.write_raw({"torque_control_mode_enable": 0})
    with pytest.raises(BadValue):
        servo.turn(current=5.0)  # 1023 units are 4.6 A
    with pytest.raises(UsageError, match="goes without"):
        servo.turn(current=1.0, speed=1.0)
    assert still(port, real)


@pytest.mark.parametrize("key", ["rx28", "ax12a", "drs0602", "lx16a", *keys_that(lambda m: m.title == "MX-28")])
def test_others_control_no_current(key: str) -> None:
    servo = servobus.open(f"virtual:{key}@1?clock=virtual").attach(MODELS[key], 1)
    with pytest.raises(UsageError, match="cannot turn with a given current"):
        servo.turn(current=0.3)


@several_turns
@pytest.mark.parametrize("baud", [2_250_000, 2_500_000, 3_000_000, 57_600])
def test_a_servo_at_a_speed_above_1_mbit(key: str, baud: int) -> None:
    servo, _, port = arm(key)
    servo.change_baud(baud)
    assert servo.look().position == pytest.approx(90 * deg, abs=1 * deg)
    assert port.servos[0].baud == pytest.approx(baud, rel=0.01)
    assert servo.baud == baud
    servo.reset()
    assert (servo.id, servo.baud) == (1, MODELS[key].factory_baud)
