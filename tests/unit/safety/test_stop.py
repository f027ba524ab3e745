"""Stop always stops: `Servo.stop`, `Bus.stop`, `make_safe`, whatever state the servos and the line are in."""

import asyncio
import re
from typing import Any

import pytest

import servobus
from samples import can_be_silenced, can_turn, every_model, models_that, sample_models, turning
from servobus import MODELS, NoReply, StopFailed, TorqueOff, UnknownName, deg
from servobus.families.base import Answers
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort


def virtual(spec: str, **options: Any) -> Any:
    return servobus.open(f"virtual:{spec}?clock=virtual", **options)


def stands(port: VirtualPort, number: int = 0) -> bool:
    """Tell whether a shaft has come to rest within 0.5 s, by its true angle."""
    port.sleep(0.5)
    before = port.servos[number].shaft.position
    port.sleep(0.3)
    return abs(port.servos[number].shaft.position - before) < 0.01 * deg


def moving(servo: Any, way: float = 40 * deg, speed: float = 20 * deg) -> None:
    """Have a servo move, and be under way."""
    servo.torque_on()
    servo.start_move(servo.look().position + way, speed=speed)
    servo._bus.transport.sleep(0.3)


def pushed_out(key: str, beyond: float) -> tuple[Any, VirtualServo]:
    """Give a servo that goes slowly to a goal, and finds itself outside its limits, by so many rad."""
    bus = virtual(f"{key}@1")
    servo = bus.find(1)
    moving(servo, speed=15 * deg)
    real, limit = bus.transport.servos[0], servo.model.register("max_position")
    real.put(limit.name, limit.scale.encode(real.position - beyond))
    return servo, real


@sample_models
def test_S2_one_far_outside_its_limits_is_let_go_of(key: str) -> None:
    servo, real = pushed_out(key, 20 * deg)
    outcome = servo.stop()
    assert outcome.let_go
    assert "let go, its torque is off: it stood at" in str(outcome)
    assert "outside its limits" in str(outcome)
    assert stands(servo._bus.transport)
    assert not real.torque
    assert not servo.permit.driven


@sample_models
def test_S2_one_a_little_outside_its_limits_is_held_at_the_nearest_allowed_angle(key: str) -> None:
    servo, real = pushed_out(key, 1.5 * deg)
    before = real.position
    outcome = servo.stop()
    row = servo.model.register("goal_position")
    # A HerkuleX has a command that holds it where it is, at whatever angle.
    angle = servo.read("goal_position" if servo.family.name == "herkulex" else "max_position")
    assert (str(outcome), outcome.let_go) == (f"held at {row.show(angle)}", False)
    assert stands(servo._bus.transport)
    assert real.torque
    assert -1.5 * deg - MODELS[key].sheet.resolution <= real.position - before <= 0.5 * deg


@sample_models
@pytest.mark.parametrize("way", ["make_safe", "crash", "bus"])
def test_S2_so_does_every_other_stop(key: str, way: str, caplog: pytest.LogCaptureFixture) -> None:
    servo, real = pushed_out(key, 20 * deg)
    bus = servo._bus
    if way == "make_safe":
        bus.make_safe()
    elif way == "bus":
        assert bus.stop()[servo].let_go
    else:
        with pytest.raises(ValueError, match="a slip"), bus:
            raise ValueError("a slip")
        bus.transport.reopen()
    assert stands(bus.transport)
    assert not real.torque
    assert way == "bus" or "let go, its torque is off: it stood at" in caplog.text


@sample_models
@pytest.mark.parametrize(
    "faults", ["mute#1-4", "flip#1-4", "drop#1-4", "mute", "flip=1", "deaf#1-2", "deaf#3", "deaf#5"]
)
def test_S2_no_lost_or_garbled_answer_keeps_a_servo_moving(key: str, faults: str) -> None:
    servo = virtual(f"{key}@1").find(1)
    port = servo._bus.transport
    moving(servo)
    port.inject(faults)
    try:
        said = str(servo.stop())
    except servobus.BusError as error:  # where nothing is understood for good nothing can be known
        said = str(error)
        assert faults in {"mute", "flip=1"}
    port.inject(None)
    assert stands(port), said


@sample_models
def test_S2_a_refused_goal_is_no_reason_to_go_on(key: str) -> None:
    """The limits are changed by another program between the look and the goal."""
    servo = virtual(f"{key}@1").find(1)
    moving(servo)
    real, write = servo._bus.transport.servos[0], servo._bus.transport.write
    count = 0

    def crossed(data: bytes) -> None:
        nonlocal count
        count += 1
        if count == 2:
            real.put("min_position", real.get("max_position") - 1)
        write(data)

    servo._bus.transport.write = crossed
    servo.stop()
    assert stands(servo._bus.transport)


@models_that(can_turn)
def test_S2_endless_turn_is_ended(key: str) -> None:
    servo = virtual(f"{key}@1").find(1)
    servo.torque_on()
    servo.turn(**turning(servo.model))
    servo._bus.transport.sleep(0.3)
    assert str(servo.stop()) == "it turns no more"
    assert stands(servo._bus.transport)


@models_that(can_be_silenced)
def test_S2_one_that_answers_no_reads_is_let_go_of(key: str) -> None:
    servo = virtual(f"{key}@1").find(1)
    moving(servo)
    level = servo.model.register("answer_level")
    servo.write_raw({level: Answers.NOTHING})
    outcome = servo.stop()
    assert outcome.let_go
    assert "cannot be read" in str(outcome)
    assert stands(servo._bus.transport)


@sample_models
def test_S2_one_without_torque_stays_without(key: str) -> None:
    servo = virtual(f"{key}@1").find(1)
    real = servo._bus.transport.servos[0]
    if hasattr(real, "goal_torque"):
        real.goal_torque = True
    assert str(servo.stop()) == "it drives nothing: its torque was off"
    assert not servo._bus.transport.servos[0].torque


# Several


@sample_models
def test_M7_a_bus_stops_all_that_are_there_and_tells_of_the_others(key: str) -> None:
    bus = virtual(f"{key}@1,2")
    bus.attach(MODELS[key], 9)
    for id in (1, 2):
        bus.attach(MODELS[key], id).ping()
        moving(bus[id])
    bus.attach(MODELS[key], 10)
    begun = bus.transport.now()
    with pytest.raises(
        StopFailed, match=f"{re.escape(MODELS[key].title)} id 9 may still move.*id 10 may still move"
    ) as caught:
        bus.stop()
    assert bus.transport.now() - begun < 0.5
    assert all(isinstance(error, NoReply) for error in caught.value.failures.values())
    assert list(caught.value.failures) == [bus[9], bus[10]]
    assert stands(bus.transport, 0)
    assert stands(bus.transport, 1)
    with pytest.raises(StopFailed, match="id 77 may still move: no servo with this id is known") as caught:
        bus.stop([77, 1])
    assert isinstance(caught.value.failures[77], UnknownName)


def test_M7_one_id_of_two_families_is_both() -> None:
    bus = virtual("rx28@1,lx16a@1")
    bus.scan(ids=[1])
    for servo in bus:
        moving(servo)
    outcomes = bus.stop(1)
    assert [str(outcome)[:7] for outcome in outcomes.values()] == ["held at"] * 2
    assert stands(bus.transport, 0)
    assert stands(bus.transport, 1)


def test_M7_an_asynchronous_bus_stops_too() -> None:
    async def main() -> None:
        bus = servobus.open_async("virtual:rx28@1,lx16a@2?clock=virtual")
        for servo in await bus.scan(ids=[1, 2]):
            await servo.torque_on()
            await servo.start_move((await servo.look()).position + 1.0, speed=0.3)
        port: Any = bus.transport
        port.sleep(0.3)
        assert len(await bus.stop()) == 2
        assert stands(port, 0)
        assert stands(port, 1)

    asyncio.run(main())


def test_M7_a_wrong_attach_is_forgotten() -> None:
    bus = virtual("rx28@1")
    bus.attach(servobus.RX28, 1)
    bus.attach(servobus.RX28, 77)
    bus.forget(77)
    assert bus.read_all("present_voltage").keys() == {bus[1]}
    bus.attach(servobus.RX28, 78)
    bus.forget(bus[78])
    assert len(bus) == 1


def test_a_stop_that_fails_is_no_error_of_the_line() -> None:
    assert not issubclass(StopFailed, servobus.BusError)


# Errors under way


@sample_models
@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, ValueError, servobus.PortLost])
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("action", [None, "hold", "free"])
def test_N7_on_a_dead_line_the_error_under_way_comes_out(
    key: str, error: type[BaseException], whole: bool, action: Any, caplog: pytest.LogCaptureFixture
) -> None:
    bus = virtual(f"{key}@1")
    if action is not None:
        bus.safe_action = action
    servo = bus.find(1)
    with pytest.raises(error) as caught, bus.torque() if whole else servo.torque():
        bus.transport.inject("mute")
        raise error
    assert any("may still" in note for note in caught.value.__notes__)
    assert "may still" in caplog.text


@pytest.mark.parametrize("end", ["cancel", "timeout"])
@sample_models
def test_N7_a_cancellation_on_a_dead_line_is_one(key: str, end: str) -> None:
    async def main() -> None:
        bus = servobus.open_async(f"virtual:{key}@1?clock=virtual")
        servo = await bus.find(1)
        ready = asyncio.Event()

        async def work() -> None:
            async with servo.torque():
                bus.transport.inject("mute")  # type: ignore[attr-defined] # a virtual port
                ready.set()
                await asyncio.sleep(60)

        if end == "cancel":
            task = asyncio.create_task(work())
            await ready.wait()
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            assert task.cancelled()
        else:
            with pytest.raises(TimeoutError) as caught:
                async with asyncio.timeout(0.01):
                    await work()
            assert not isinstance(caught.value, servobus.ServobusError)

    asyncio.run(main())


def test_N7_a_crash_on_a_dead_line_is_the_one_that_leaves_the_bus() -> None:
    bus = virtual("lx16a@1", models="lx16a")
    with pytest.raises(ValueError, match="a slip") as caught, bus:
        bus.find(1).torque_on()
        bus.transport.inject("mute")
        raise ValueError("a slip")
    assert "LX-16A id 1 may still move" in caught.value.__notes__[0]


def test_B12_a_retry_loop_does_not_swallow_the_stop_of_a_watch() -> None:
    for error in (servobus.Stopped, StopFailed):
        assert not issubclass(error, servobus.BusError)
    with servobus.open("virtual:lx16a@1?clock=real") as bus:
        servo = bus.attach(servobus.LX16A, 1)
        servo.torque_on()
        with bus.watch(timeout=0.05) as watch:
            assert watch.wait(5)
            with pytest.raises(servobus.Stopped):
                for _ in range(3):
                    try:
                        servo.start_move(1.0)
                    except servobus.BusError:
                        continue


@sample_models
def test_N7_torque_on_of_a_closed_bus_leaves_nothing_driven(key: str) -> None:
    bus = virtual(f"{key}@1")
    servo = bus.find(1)
    bus.close()
    for job in (servo.torque_on, bus.torque_on, lambda: servo.start_move(1.0)):
        with pytest.raises(servobus.PortError, match="is closed"):
            job()
        assert not servo.permit.driven
    bus.reopen()
    servo.torque_on()
    assert servo.permit.driven


@sample_models
@pytest.mark.parametrize("whole", [True, False])
def test_a_torque_block_leaves_on_what_was_on_before(key: str, whole: bool) -> None:
    bus = virtual(f"{key}@1")
    servo, port = bus.find(1), bus.transport
    with servo.torque():
        with bus.torque() if whole else servo.torque():
            pass
        port.sleep(0.1)
        assert port.servos[0].torque
        with pytest.raises(ValueError, match="a slip"), bus.torque() if whole else servo.torque():
            servo.start_move(servo.look().position + 40 * deg, time=2.5)
            port.sleep(0.2)
            raise ValueError("a slip")
        assert port.servos[0].torque
        assert stands(port)
    port.sleep(0.1)
    assert not port.servos[0].torque
    servo.torque_on()
    with servo.torque():
        pass
    port.sleep(0.1)
    assert port.servos[0].torque


@every_model
@pytest.mark.parametrize("action", [None, "hold", "free", "brake"])
def test_a_servo_whose_torque_was_refused_is_not_driven_and_left_alone(key: str, action: Any) -> None:
    bus = virtual(f"{key}@1,{key}@2")
    one, two = bus.scan(ids=[1, 2], family=MODELS[key].family)
    if action is not None:
        if action == "brake" and not one.model.brakes:
            pytest.skip("nothing in it shorts the motor")
        bus.safe_action = action
    real = bus.transport.servos[1]
    bus.torque_on()
    real.temperature = 110.0
    bus.transport.sleep(1.0)
    bus.torque_off()
    two.record.forget()
    before = two.read("torque_enable")
    with pytest.raises(TorqueOff), bus.torque([2, 1]):
        pytest.fail("the block was entered")
    assert not two.record.ram, "it was told something"
    assert two.read("torque_enable") == before
    for servo in (one, two):
        assert not servo.permit.driven
    assert not any(servo.torque for servo in bus.transport.servos)


@every_model
@pytest.mark.parametrize("whole", [True, False])
def test_a_servo_whose_torque_may_have_come_on_is_let_go(key: str, whole: bool, monkeypatch: Any) -> None:
    bus = virtual(f"{key}@1")
    servo = bus.find(1)
    family = type(servo.family)
    switch_on = family.switch_on

    def lost(*args: Any) -> Any:
        yield from switch_on(*args)
        assert bus.transport.servos[0].torque
        raise NoReply("the answer was lost")

    monkeypatch.setattr(family, "switch_on", lost)
    with pytest.raises(NoReply, match="was lost"), bus.torque() if whole else servo.torque():
        pytest.fail("the block was entered")
    bus.transport.sleep(0.1)
    assert not bus.transport.servos[0].torque
    assert not servo.permit.driven


@every_model
@pytest.mark.parametrize("verb", ["move", "cycle"])
def test_a_move_that_one_servo_must_not_make_marks_none_as_driven(key: str, verb: str) -> None:
    bus = virtual(f"{key}@1,{key}@2")
    one, two = bus.scan(ids=[1, 2], family=MODELS[key].family)
    goals = {servo: servo.state.position for servo in (one, two)}
    bus.torque_on()
    bus.make_safe("hold")
    assert not bus.safety.drives()
    two.permit.inhibited = "it is too hot"
    with pytest.raises(servobus.Stopped, match="too hot"):
        bus.start_move(goals) if verb == "move" else bus.cycle("present_position").run(goals)
    assert not bus.safety.drives()


# Thresholds


@sample_models
def test_N12_thresholds_count_from_the_call_that_gives_them(key: str) -> None:
    limit = MODELS[key].register("max_temperature")
    assert limit.default is not None
    heat = limit.decode(limit.default) - 15
    bus = servobus.open(f"virtual:{key}@1?clock=virtual&temperature={heat:g}")
    bus.find(1)
    assert bus.protect()[1] is servobus.Level.OK
    assert bus.protect(servobus.Thresholds(warn=20))[1] is servobus.Level.WARN
    assert bus.protect()[1] is servobus.Level.WARN  # those given last stay
    assert bus.protect(servobus.Thresholds())[1] is servobus.Level.OK


@pytest.mark.parametrize("thresholds", [5, "warn", {"warn": 20}])
def test_N12_what_is_no_thresholds_is_refused(thresholds: Any) -> None:
    bus = virtual("rx28@1")
    bus.find(1)
    bus.protect()
    with pytest.raises(servobus.UsageError, match="Thresholds"):
        bus.protect(thresholds)
    for wrong in ({"warn": "20"}, {"stall": None}, {"push": float("nan")}, {"back": True}):
        with pytest.raises(servobus.BadValue, match=next(iter(wrong))):
            bus.protect(servobus.Thresholds(**wrong))
