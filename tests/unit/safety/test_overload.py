"""Heat and stall (F25): warned of, weakened, made safe; and back again without flapping."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

import servobus
from samples import hottest, models_that, output_limit, sample_models
from servobus import LX16A, MODELS, RX28, BadValue, NoReply, Stopped, UsageError, deg
from servobus.families.base import Answers
from servobus.safety.overload import Level, OverloadMonitor, Thresholds
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort
from unit.lossy import ASYNC, SYNC

DRIVERS = pytest.mark.parametrize("driver", [SYNC, ASYNC])

OK, WARN, DERATE, SAFE = Level


# The judgement


def heat(monitor: OverloadMonitor, *temperatures: float) -> list[Level]:
    return [monitor.judge(0.0, temperature, 0.0, 0.0) for temperature in temperatures]


def test_levels_begin_where_they_are_said_to() -> None:
    assert heat(OverloadMonitor(80.0), 25, 69.9, 70, 74.9, 75, 79.9, 80, 95) == [
        OK,
        OK,
        WARN,
        WARN,
        DERATE,
        DERATE,
        SAFE,
        SAFE,
    ]


def test_levels_end_two_degrees_below_where_they_began() -> None:
    cooling = heat(OverloadMonitor(80.0), 95, 78, 77.9, 73, 72.9, 68, 67.9, 25)
    assert cooling == [SAFE, SAFE, DERATE, DERATE, WARN, WARN, OK, OK]


def test_a_temperature_that_trembles_at_a_bound_does_not_flap() -> None:
    for bound, level in ((70, WARN), (75, DERATE), (80, SAFE)):
        levels = heat(OverloadMonitor(80.0), *[bound, bound - 1] * 10)
        assert set(levels) == {level}


def test_bounds_can_be_set() -> None:
    monitor = OverloadMonitor(60.0, Thresholds(warn=20, derate=1, back=0.5))
    assert heat(monitor, 39, 40, 58, 59, 58.6, 58.4, 39.6, 39.4) == [OK, WARN, WARN, DERATE, DERATE, WARN, WARN, OK]


@pytest.mark.parametrize(
    "bounds",
    [{"warn": 1.0, "derate": 2.0}, {"derate": -1.0}, {"back": -1.0}, {"push": 0.0}, {"push": 2.0}, {"stall": 0.0}],
)
def test_bounds_that_contradict_each_other_are_refused(bounds: dict[str, float]) -> None:
    with pytest.raises(BadValue):
        OverloadMonitor(80.0, Thresholds(**bounds))


def test_a_stall_is_pushing_without_moving_for_a_while() -> None:
    monitor = OverloadMonitor(80.0)
    assert [monitor.judge(now, 25, -0.9, 1.0) for now in (0, 0.2, 0.4, 0.5, 3.0)] == [OK, OK, OK, SAFE, SAFE]
    assert monitor.stalled
    assert monitor.judge(3.1, 25, 0.1, 1.0) is OK
    assert not monitor.stalled


def test_who_pushes_and_moves_is_not_stalled() -> None:
    monitor = OverloadMonitor(80.0)
    assert {monitor.judge(now / 4, 25, 1.0, now * 1.01 * deg) for now in range(20)} == {OK}


def test_who_holds_lightly_is_not_stalled() -> None:
    monitor = OverloadMonitor(80.0)
    assert {monitor.judge(now, 25, 0.79, 1.0) for now in range(20)} == {OK}


def test_a_short_let_up_begins_the_count_anew() -> None:
    monitor = OverloadMonitor(80.0)
    pushes = [(0, 1.0), (0.4, 1.0), (0.5, 0.5), (0.6, 1.0), (1.0, 1.0), (1.2, 1.0)]
    assert [monitor.judge(now, 25, push, 1.0) for now, push in pushes] == [OK, OK, OK, OK, OK, SAFE]


# On virtual servos


class Bench:
    """One virtual servo that is driven, and its temperature in our hands."""

    def __init__(self, key: str, driver: str = SYNC, extra: str = "") -> None:
        opener: Any = servobus.open if driver == SYNC else servobus.open_async
        self._driver = driver
        self.bus = opener(f"virtual:{key}@1?clock=virtual{extra}")
        self.line: VirtualPort = self.bus.transport
        self.servo = self.bus.attach(MODELS[key], 1)

    def do(self, job: Callable[[Any], Any]) -> Any:
        if self._driver == SYNC:
            return job(self.servo)

        async def main() -> Any:
            return await job(self.servo)

        return asyncio.run(main())

    @property
    def real(self) -> VirtualServo:
        return self.line.servos[0]

    def holds(self) -> bool:
        return self.real.torque

    def at(self, temperature: float, *, wait: float = 0.1) -> Level:
        self.real.temperature = temperature
        self.line.sleep(wait)
        return self.look()

    def look(self) -> Level:
        levels = self.do(lambda _: self.bus.protect())
        assert [servo.id for servo in levels] == [1]
        level = levels[1]
        assert isinstance(level, Level)
        return level

    def output_limit(self) -> int:
        """What bounds the servo's output, raw."""
        self.line.sleep(0.02)
        row = output_limit(self.real.model)
        assert row is not None
        return self.real.get(row.name)


@DRIVERS
@sample_models
def test_a_ramp_of_heat_goes_through_all_levels_and_back(key: str, driver: str) -> None:
    bench, limit = Bench(key, driver), hottest(MODELS[key])
    bench.servo.safe_action = "free"
    bench.do(lambda servo: servo.torque_on())
    goal = bench.real.position + 10 * deg
    # From 10 °C below its limit on, and from 5, as near as readings come to that.
    row = MODELS[key].register("present_temperature")
    told = [row.decode(raw) for raw in range(row.limits[1])]
    cool, warm, hot = (
        [one for one in told if far > limit - one >= near] for far, near in ((99, 10.01), (10.01, 5.01), (5.01, 0.5))
    )
    levels = [bench.at(degrees) for degrees in (25, max(cool), min(warm), max(warm), min(hot), max(hot))]
    assert levels == [OK, OK, WARN, WARN, DERATE, DERATE]
    assert bench.holds()
    bench.do(lambda servo: servo.start_move(goal, time=0.2))
    assert bench.at(limit) is SAFE
    bench.line.sleep(0.02)
    assert not bench.holds()
    for move in (lambda servo: servo.torque_on(), lambda servo: servo.rearm()):
        with pytest.raises(Stopped, match=rf"is not moved: it reached {limit:g} °C"):
            bench.do(move)
    assert bench.at(limit - 1.5) is SAFE
    assert [bench.at(degrees) for degrees in (limit - 4, limit - 8, limit - 20)] == [DERATE, WARN, OK]
    bench.do(lambda servo: servo.torque_on())
    bench.do(lambda servo: servo.start_move(goal, time=0.2))


@models_that(lambda model: output_limit(model) is None)
def test_near_the_limit_a_servo_whose_output_has_no_bound_is_moved_at_half_the_speed(key: str) -> None:
    bench, limit = Bench(key), hottest(MODELS[key])
    bench.do(lambda servo: servo.torque_on())
    goal = bench.real.position + 20 * deg
    durations = []
    for degrees in (25, limit - 4, limit - 3, 25):
        bench.at(degrees)
        durations.append(bench.do(lambda servo: servo.start_move(goal, time=1.0)).duration)
    assert durations == [1.0, 2.0, 2.0, 1.0]


@models_that(lambda model: output_limit(model) is not None)
def test_near_the_limit_it_is_weakened_once_and_gets_its_strength_back(key: str) -> None:
    bench, limit, own = Bench(key), hottest(MODELS[key]), output_limit(MODELS[key])
    bench.do(lambda servo: servo.write_raw({own: 801}))
    strengths = []
    for degrees in (25.0, limit - 4, limit - 3, limit - 6, limit - 8, 25.0):
        bench.at(degrees)
        strengths.append(bench.output_limit())
    assert strengths == [801, 400, 400, 400, 801, 801]


def test_what_shut_itself_down_gets_nothing_back_and_does_not_jump() -> None:
    """An RX-28 that shuts down has Torque Limit 0; any other value there would set it going again (3-4-1)."""
    bench = Bench("rx28")
    bench.do(lambda servo: servo.torque_on())
    bench.at(76.0)
    bench.real.put("torque_limit", 0)
    bench.at(25.0)
    assert bench.output_limit() == 0


def test_what_restarted_is_weakened_again() -> None:
    bench = Bench("rx28")
    assert bench.at(76.0) is DERATE
    assert bench.output_limit() == 511
    bench.real.power_off()
    bench.real.power_on(bench.line.now())
    bench.line.sleep(0.1)
    assert bench.output_limit() == 1023
    assert bench.look() is DERATE
    assert bench.output_limit() == 511
    assert bench.at(25.0) is OK
    assert bench.output_limit() == 1023


@sample_models
def test_a_blocked_shaft_is_made_safe(key: str) -> None:
    bench = Bench(key, extra="&load=blocked")
    bench.do(lambda servo: servo.torque_on())
    here = bench.real.position
    bench.do(lambda servo: servo.start_move(here + 60 * deg, time=0.5))
    levels = []
    for _ in range(20):
        bench.line.sleep(0.1)
        levels.append(bench.look())
        if levels[-1] is SAFE:
            break
    assert levels[-1] is SAFE
    assert len(levels) >= 5  # half a second at ten looks a second
    assert not bench.servo.alarms  # it was quicker than the servo's own protection
    assert set(levels[:-1]) == {OK}
    with pytest.raises(Stopped, match="it pushed without moving"):
        bench.do(lambda servo: servo.start_move(here, time=0.5))
    # Held where it is it does not push any more, and may move again.
    bench.line.sleep(0.5)
    assert bench.look() is OK
    assert bench.real.torque
    bench.do(lambda servo: servo.start_move(here, time=0.5))


@sample_models
def test_a_servo_that_moves_and_holds_is_left_alone(key: str) -> None:
    bench = Bench(key)
    bench.do(lambda servo: servo.torque_on())
    here = bench.real.position
    for goal in (here + 60 * deg, here - 60 * deg):
        bench.servo.start_move(goal, time=2.5)
        for _ in range(40):
            bench.line.sleep(0.1)
            assert bench.look() is OK


def test_motor_mode_of_an_lx16a_is_no_stall() -> None:
    bench = Bench("lx16a")
    bench.do(lambda servo: servo.torque_on())
    bench.do(lambda servo: servo.start_move(200 * deg, time=30.0))
    bench.do(lambda servo: servo.turn(output=0.0))
    for _ in range(12):
        bench.line.sleep(0.1)
        assert bench.look() is OK


def test_one_that_is_gone_does_not_keep_the_others_from_being_guarded() -> None:
    bus = servobus.open("virtual:lx16a@1-3?clock=virtual", safe_action="free")
    for id in (1, 2, 3):
        bus.attach(LX16A, id).torque_on()
    line: Any = bus.transport
    bus.protect()
    line.servos[0].power_off()
    for servo in line.servos[1:]:
        servo.temperature = 85.0
    line.sleep(0.1)
    with pytest.raises(NoReply, match="id 1"):
        bus.protect()
    line.sleep(0.1)
    assert [servo.torque for servo in line.servos[1:]] == [False, False]


def test_nor_does_one_that_cannot_be_read() -> None:
    bus = servobus.open("virtual:rx28@1,lx16a@2?clock=virtual", safe_action="free")
    bus.attach(RX28, 1, answers=Answers.NOTHING)
    bus.attach(LX16A, 2).torque_on()
    line: Any = bus.transport
    line.servos[1].temperature = 85.0
    line.sleep(0.1)
    with pytest.raises(UsageError, match="RX-28 id 1 cannot be read"):
        bus.protect()
    line.sleep(0.1)
    assert not line.servos[1].torque


def test_one_that_was_only_looked_at_is_not_switched() -> None:
    bus = servobus.open("virtual:rx28@1?clock=virtual", safe_action="free")
    bus.attach(RX28, 1)
    line: Any = bus.transport
    line.servos[0].put("torque_enable", 1)  # by another program
    line.servos[0].temperature = 80.0
    line.sleep(0.1)
    assert bus.protect() == {1: SAFE}
    line.sleep(0.1)
    assert line.servos[0].get("torque_enable") == 1


def test_lx_servos_that_were_moved_together_are_not_taken_to_be_blocked() -> None:
    """Command 2 tells the goal of the last command 1, not the one that commands 7 and 11 gave (points 2 to 5)."""
    bus = servobus.open("virtual:lx16a@1-2?clock=virtual", models="lx16a")
    bus.scan(ids=[1, 2])
    line: Any = bus.transport
    bus.torque_on()
    bus.move({1: 60 * deg, 2: 200 * deg})
    for _ in range(4):
        line.sleep(1.0)
        assert bus.protect() == {1: OK, 2: OK}
    bus.cycle(read=["present_position"]).run({1: 90 * deg, 2: 170 * deg})
    for _ in range(4):
        line.sleep(1.0)
        assert bus.protect() == {1: OK, 2: OK}
    line.servos[1].shaft.load = replace(line.servos[1].shaft.load, blocked=1.0)
    bus.move({1: 100 * deg, 2: 120 * deg})
    levels = []
    for _ in range(4):
        line.sleep(1.0)
        levels.append(bus.protect())
    assert {1: OK, 2: SAFE} in levels
