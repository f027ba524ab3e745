"""Torque that comes on moves nothing, a written register obeys the rules of moves, a failed move leaves no goal.

Shafts are watched by the true angle of the virtual servo.
"""

import asyncio
import contextlib
from typing import Any

import pytest

import servobus
from samples import can_turn, has, minds_overload, models_that, sample_models, sample_of, turning
from servobus import (
    DRS0602,
    LX16A,
    MODELS,
    RX28,
    BadValue,
    MoveTimeout,
    NoReply,
    OutsideLimits,
    ServobusError,
    Stopped,
    TorqueOff,
    UsageError,
    deg,
)
from servobus.families.base import Answers
from servobus.virtual.physics.motor import Load

READINGS = pytest.mark.parametrize("goal_torque", [True, False], ids=["practice", "manual"])


def servo_of(key: str, query: str = "") -> tuple[Any, Any, Any]:
    """Give a servo, its virtual servo, and the port, on a virtual clock."""
    bus = servobus.open(f"virtual:{key}@1?clock=virtual{query}")
    servo = bus.find(1, family=MODELS[key].family)
    return servo, bus.transport.servos[0], bus.transport  # type: ignore[attr-defined]


def still(port: Any, real: Any, seconds: float = 1.5) -> bool:
    """Tell whether the shaft stays where it is, to half a degree, for so long."""
    here = real.shaft.position
    for _ in range(30):
        port.sleep(seconds / 30)
        if abs(real.shaft.position - here) > 0.5 * deg:
            return False
    return True


# S1: torque on outside the limits


@pytest.mark.parametrize("verb", ["torque_on", "rearm"])
@READINGS
def test_S1_torque_outside_the_limits_is_refused_and_comes_in_slowly_when_told(goal_torque: bool, verb: str) -> None:
    servo, real, port = servo_of("rx28")
    real.goal_torque = goal_torque
    servo.store({RX28.cw_angle_limit: 100 * deg, RX28.ccw_angle_limit: 200 * deg})
    real.turn_shaft(20 * deg)
    port.sleep(0.1)
    with pytest.raises(OutsideLimits, match=r"is at 19\.9°, .* 100\.0° \.\. 200\.0°, .*--to-limit"):
        getattr(servo, verb)()
    assert still(port, real)
    began = port.now()
    getattr(servo, verb)(to_limit=True, speed=40 * deg)
    assert port.now() - began >= 80 / 40 * 0.9
    assert real.torque
    assert real.shaft.position == pytest.approx(100 * deg, abs=3.5 * deg)
    assert servo.read(RX28.moving_speed) == 0.0  # what it came in with does not stay


@sample_models
def test_S1_torque_on_of_a_servo_that_is_limp_moves_nothing(key: str) -> None:
    servo, real, port = servo_of(key)
    real.turn_shaft(real.position + 40 * deg)
    port.sleep(0.1)
    servo.torque_on()
    assert still(port, real)
    assert real.torque


@pytest.mark.parametrize("key", ["drs0602", "lx16a"])
def test_S1_what_holds_outside_its_limits_by_itself_is_not_refused(key: str) -> None:
    servo, real, port = servo_of(key)
    row = servo.model.register("max_position")
    servo.store({row: servo.look().position - 30 * deg})
    servo.torque_on()
    assert still(port, real)


@pytest.mark.parametrize("verb", ["torque_on", "rearm", "write"])
def test_S1_torque_on_moves_no_herkulex_that_kept_its_goal(verb: str) -> None:
    servo, real, port = servo_of("drs0602")
    real.goal_after_limp = "kept"
    servo.led("blue")
    real.turn_shaft(real.position + 50 * deg)
    port.sleep(0.1)
    if verb == "write":
        servo.write_raw({"torque_control": servo.family.driven})
    else:
        getattr(servo, verb)()
    assert still(port, real)
    assert real.torque
    assert real.led == "blue"  # the JOGs leave the light as it was
    servo.start_move(real.position + 40 * deg, time=1.0)
    servo.torque_on()  # one that has torque goes on
    port.sleep(1.2)
    assert real.position > 80 * deg


@models_that(can_turn)
@READINGS
def test_S1_a_lost_request_before_torque_on_leaves_no_old_goal(key: str, goal_torque: bool) -> None:
    for lost in range(1, 13):
        servo, real, port = servo_of(key)
        if hasattr(real, "goal_torque"):
            real.goal_torque = goal_torque
        real.goal_after_limp = "kept"
        if has(servo.model, "answer_level"):
            servo.write_raw({"answer_level": Answers.READS})
        servo.torque_on()
        servo.turn(**turning(servo.model))
        port.sleep(0.3)
        servo.torque_off()
        servo.position_mode()
        real.turn_shaft(real.position + 50 * deg)
        port.sleep(1.0)
        port.inject(f"deaf#{lost}")
        for call in (servo.torque_on, servo.position_mode, servo.rearm):
            with contextlib.suppress(ServobusError):
                call()
            assert still(port, real, 0.5), (lost, call)


@sample_models
def test_N7_torque_that_is_written_off_is_off_though_the_write_was_lost(key: str) -> None:
    servo, real, port = servo_of(key)
    if has(servo.model, "answer_level"):
        servo.write_raw({"answer_level": Answers.READS})
    servo.torque_on()
    port.inject("deaf#1")
    servo.write_raw({"torque_enable": 0})
    assert not real.torque
    assert not servo.permit.driven


def test_S2_a_brake_that_was_lost_is_told_again() -> None:
    servo, real, port = servo_of("drs0602")
    servo.torque_on()
    servo.turn(speed=90 * deg)
    port.sleep(0.3)
    port.inject("deaf#1")
    servo._bus.make_safe("brake")
    port.sleep(0.5)
    assert still(port, real)


# S3: a written register moves


@sample_models
def test_S3_a_goal_is_not_written_to_a_limp_servo(key: str) -> None:
    servo, real, port = servo_of(key)
    row = servo.model.register("goal_position")
    if not row.writable:
        return
    with pytest.raises(TorqueOff, match="torque is off"):
        servo.write(row, 20 * deg)
    assert still(port, real)
    assert not servo.permit.driven
    servo.torque_on()
    servo.permit.mark_idle()
    servo.max_step = 10 * deg
    with pytest.raises(BadValue, match="max_step"):
        servo.write(row, 20 * deg)
    servo.write(row, servo.look().position + 5 * deg)
    assert servo.permit.driven


def test_S3_limits_that_would_move_a_servo_with_torque_are_refused_and_without_torque_written() -> None:
    servo, real, port = servo_of("rx28")
    servo.torque_on()
    for values in ({RX28.max_position: 0.0}, {RX28.max_position: 100 * deg}, {RX28.min_position: 200 * deg}):
        with pytest.raises(UsageError, match=r"has torque|outside the limits that it would get"):
            servo.write_many(values)
    assert still(port, real)
    servo.torque_off()
    servo.write(RX28.max_position, 100 * deg)
    assert still(port, real)


def test_S3_an_offset_turns_an_lx16a_as_far_as_max_step_lets_it() -> None:
    servo, real, port = servo_of("lx16a")
    servo.write(LX16A.angle_offset, 5 * deg)  # limp: nothing moves
    assert not servo.permit.driven
    assert still(port, real)
    servo.torque_on()
    servo.permit.mark_idle()
    servo.max_step = 10 * deg
    with pytest.raises(BadValue, match="max_step"):
        servo.write(LX16A.angle_offset, 24 * deg)
    assert still(port, real)
    servo.write(LX16A.angle_offset, 10 * deg)
    assert servo.permit.driven


def test_S3_the_zero_of_a_herkulex_with_torque_is_left_alone() -> None:
    servo, real, port = servo_of("drs0602")
    servo.torque_on()
    for row, raw in ((DRS0602.calibration_difference, 500), (DRS0602.aux_1, 2)):
        with pytest.raises(UsageError, match="switch its torque off first"):
            servo.write_raw({row: raw})
    assert still(port, real)


# S4, N10, N3: limp although torque_enable says on


@models_that(minds_overload)
def test_S4_a_servo_that_has_shut_down_says_so_and_names_rearm(key: str) -> None:
    servo, real, port = servo_of(key)
    servo.torque_on()
    real.shaft.load = Load(blocked=1.0)
    servo.start_move(servo.look().position + 60 * deg, time=0.5)
    port.sleep(3.0)
    real.shaft.load = Load()
    port.sleep(0.5)
    assert "shut down (" in str(servo.look())
    assert not servo.state.torque
    calls = [servo.torque_on, lambda: servo.move(servo.state.position)]
    if servo.model.turns:
        calls.append(lambda: servo.turn(**turning(servo.model)))
    for call in calls:
        with pytest.raises(TorqueOff, match=r"has shut down .*rearm"):
            call()
    assert still(port, real)
    servo.rearm()
    assert still(port, real)
    assert servo.look().torque


def test_N10_a_torque_limit_given_back_is_no_way_round_rearm() -> None:
    servo, real, port = servo_of("rx28")
    servo.torque_on()
    servo.write(RX28.torque_limit, 0.0)
    real.turn_shaft(100 * deg)
    real.put("goal_position", 900)
    with pytest.raises(TorqueOff, match="rearm"):
        servo.write(RX28.torque_limit, 1.0)
    servo.rearm()
    assert still(port, real)


@sample_models
def test_N3_one_that_is_too_hot_is_not_moved_then_or_later(key: str) -> None:
    servo, real, port = servo_of(key)
    real.temperature = 110.0
    port.sleep(1.0)
    # What an RX-28 keeps of it is Torque Limit 0 (3-4-1 Alarm Shutdown).
    cause = "torque limit 0" if servo.family.name == "dynamixel" else sample_of(key).hot_word
    for call in (servo.torque_on, lambda: servo.move(servo.look().position + 20 * deg)):
        with pytest.raises(TorqueOff, match=rf"has shut down \(.*{cause}.*\), so nothing would move; rearm\(\)"):
            call()
    real.temperature = 25.0
    assert still(port, real, 3.0)


# S5: leaving endless turn


@pytest.mark.parametrize("kept", ["present", "kept"])
@READINGS
def test_S5_position_mode_moves_nothing_whatever_goal_the_servo_remembers(goal_torque: bool, kept: str) -> None:
    servo, real, port = servo_of("rx28")
    real.goal_torque, real.goal_after_turn, real.goal_after_limp = goal_torque, kept, kept
    servo.torque_on()
    servo.move(250 * deg).wait()
    servo.turn(output=-0.3)
    port.sleep(0.6)
    servo.stop()
    port.sleep(0.5)
    servo.position_mode()
    assert still(port, real)
    assert real.torque
    with pytest.raises(BadValue, match="is not below"):
        servo.position_mode((200 * deg, 100 * deg))


def test_S5_position_mode_with_limits_that_leave_it_outside_is_refused_before_anything_is_written() -> None:
    servo, real, port = servo_of("rx28")
    servo.torque_on()
    servo.turn(output=0.1)
    servo.stop()
    port.sleep(0.5)
    with pytest.raises(OutsideLimits, match="that it would get"):
        servo.position_mode((0.0, 50 * deg))
    assert servo.read_raw([RX28.min_position, RX28.max_position]) == [0, 0]
    assert still(port, real)


# N11, T9: longer than can be told


def test_N11_a_move_of_default_speed_over_the_whole_range_is_made() -> None:
    servo, _, _ = servo_of("drs0602")
    servo.torque_on()
    servo.move(-150 * deg).wait()
    move = servo.move(150 * deg)
    assert move.duration <= 2.8448
    move.wait()
    assert servo.look().position == pytest.approx(150 * deg, abs=2 * deg)


def test_T9_a_longer_time_goes_in_parts_and_takes_that_time() -> None:
    servo, real, port = servo_of("drs0602")
    servo.torque_on()
    began = port.now()
    servo.move(100 * deg, time=7.0).wait()
    assert 6.9 <= port.now() - began <= 7.5
    assert real.position == pytest.approx(100 * deg, abs=1 * deg)
    move = servo.move(0.0, time=7.0)
    port.sleep(3.0)
    move.cancel()
    assert still(port, real, 5.0)
    with pytest.raises(Stopped):
        move.wait()


# T11: what a move sets for itself


@pytest.mark.parametrize("key", ["rx28", "lx16a"])
def test_T11_a_move_leaves_no_speed_behind(key: str) -> None:
    servo, _, _ = servo_of(key)
    name = "moving_speed" if key == "rx28" else "goal_time"
    before = servo.read(name)
    servo.torque_on()
    start = servo.look().position
    servo.move(start + 4 * deg, time=3.0).wait()
    assert servo.read(name) == before
    servo.move(start, time=5.0)  # not waited for
    servo.write("goal_position", start + 60 * deg)
    assert servo.read(name) == before


@pytest.mark.parametrize("way", ["stop", "stop all", "cancel", "make safe"])
@pytest.mark.parametrize("key", ["rx28", "lx16a"])
def test_T11_a_move_that_is_stopped_leaves_no_speed_behind(key: str, way: str) -> None:
    servo, real, port = servo_of(key)
    bus = servo._bus
    name = "moving_speed" if key == "rx28" else "goal_time"
    before = servo.read(name)
    servo.torque_on()
    move = servo.move(servo.look().position + 40 * deg, time=3.0)
    port.sleep(0.5)
    assert servo.read(name) != before
    {"stop": servo.stop, "stop all": bus.stop, "cancel": move.cancel, "make safe": bus.make_safe}[way]()
    port.sleep(0.3)
    assert still(port, real)
    assert servo.read(name) == before


def test_T11_a_cycle_after_a_slow_move_follows() -> None:
    servo, real, port = servo_of("rx28")
    servo.torque_on()
    servo.move(152 * deg, time=4.0)
    cycle = servo._bus.cycle(read=["present_position"])
    cycle.run({1: 200 * deg})
    port.sleep(1.0)
    assert real.position == pytest.approx(200 * deg, abs=2 * deg)


# Failed moves


@sample_models
def test_N3_a_move_that_fails_leaves_the_present_position_as_the_goal(key: str) -> None:
    servo, real, port = servo_of(key)
    servo.torque_on()
    real.shaft.load = Load(blocked=1.0)
    move = servo.move(servo.look().position + 40 * deg, time=0.3)
    with pytest.raises(MoveTimeout, match=r"did not reach .*; (it stays where it is|.*shut down)"):
        move.wait()
    assert move.done
    real.shaft.load = Load()
    assert still(port, real)


@sample_models
def test_a_line_that_fails_on_the_way_tells_who_may_go_on(key: str) -> None:
    servo, _, port = servo_of(key)
    servo.torque_on()
    move = servo.move(servo.look().position + 40 * deg, time=1.0)
    port.inject("mute")
    with pytest.raises(NoReply, match="cannot be reached and may go on"):
        move.wait()


# M8: the handle


@sample_models
def test_M8_a_move_says_what_it_is_and_whether_it_is_done(key: str) -> None:
    servo, real, port = servo_of(key)
    servo.torque_on()
    move = servo.move(servo.look().position + 20 * deg, time=1.0)
    assert repr(move).startswith(f"<Move {servo.target} to ")
    assert repr(move).endswith("under way>")
    sent = servo._bus.stats.total.sent
    assert not move.done
    assert servo._bus.stats.total.sent == sent  # nothing is asked before it should be there
    with pytest.raises(MoveTimeout, match=r"within the timeout of 0.1 s; it is still on its way"):
        move.wait(timeout=0.1)
    port.sleep(1.5)
    assert move.done
    assert repr(move).endswith("ended>")
    again = servo.move(real.position - 20 * deg, time=1.0)
    port.sleep(0.3)
    again.cancel()
    assert again.done
    with pytest.raises(Stopped):
        again.wait()


def test_M8_asynchronous_moves_have_the_same() -> None:
    async def main() -> None:
        async with servobus.open_async("virtual:rx28@1?clock=virtual") as bus:
            servo = await bus.find(1)
            await servo.torque_on()
            move = servo.move(100 * deg, time=1.0)
            assert repr(move) == "<AsyncMove: not started>"
            await move
            assert not await move.done
            await move.cancel()
            assert await move.done
            with pytest.raises(Stopped):
                await move.wait()

    asyncio.run(main())
