"""Every way of moving x every fault x every way of ending: motion is over within 0.5 s, or what may still move is told.

The true shaft is looked at, on the virtual clock. Signals and the end of a terminal need whole programs, and the watch
needs real time: see tests/unit/safety/test_signals.py and the end of this file.
"""

import asyncio
import itertools
import logging
from collections.abc import Callable, Sequence
from typing import Any

import pytest

import extent
import servobus
from drivers import result_of
from samples import (
    ONE_OF_EACH_FAMILY,
    SERIES_KEYS,
    can_be_silenced,
    has,
    one_model_of_each_family,
    other_bauds,
    series_models,
    turning,
)
from servobus import MODELS, BusError, StopFailed, deg
from servobus.bus.asyncio import AsyncBus
from servobus.families import registry
from servobus.families.base import Answers, Model
from servobus.families.herkulex.protocol import StatusError
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.physics.motor import Load
from servobus.virtual.serve.inprocess import VirtualPort, connect

LIMIT = 0.5
"""s within which motion is over."""
WAY = 60 * deg


class Scene:
    """Two servos of one model on one port, ids 1 and 2, and a driver for them."""

    def __init__(self, key: str, *, driver: Any = servobus.Bus) -> None:
        self.model: type[Model] = MODELS[key]
        self.port: VirtualPort = connect(f"virtual:{key}@1,2?clock=virtual")
        self.bus: Any = driver(self.port, echo=False)
        self.servos = [self.bus.attach(self.model, id) for id in (1, 2)]
        self.may_be_deaf = False

    @property
    def reals(self) -> list[VirtualServo]:
        return self.port.servos

    def hold_shafts(self, held: bool) -> None:
        """Close a vice around the shafts, or open it: what was not stopped meanwhile goes on then."""
        if held and has(self.model, "overload_detection_period"):  # being held is no overload here
            for servo in self.servos:
                result_of(servo.write_raw({self.model.register("overload_detection_period"): 0}))
        for real in self.reals:
            real.shaft.load = Load(blocked=1.0 if held else 0.0)

    def torque_on(self) -> None:
        result_of(self.bus.torque_on())
        self.heres = [real.position for real in self.reals]


# Ways of moving


def move(scene: Scene) -> None:
    for servo, here in zip(scene.servos, scene.heres, strict=True):
        result_of(servo.start_move(here + WAY, time=2.5))


def fast_move(scene: Scene) -> None:
    for servo, here in zip(scene.servos, scene.heres, strict=True):
        result_of(servo.start_move(here + WAY, time=0.02))  # as `step`


def group_move(scene: Scene) -> None:
    goals = dict(zip(scene.servos, (here + WAY for here in scene.heres), strict=True))
    result_of(scene.bus.start_move(goals, time=2.5))


def turn(scene: Scene) -> None:
    """Turn without end; a model that cannot goes to a goal."""
    if not scene.model.turns:
        move(scene)
        return
    for servo in scene.servos:
        result_of(servo.turn(**turning(scene.model)))


def stream(scene: Scene) -> None:
    cycle = scene.bus.cycle(read=["present_position"], time=1.0)
    for step in range(1, 6):
        goals = dict(zip(scene.servos, (here + WAY * step / 5 for here in scene.heres), strict=True))
        result_of(cycle.run(goals))
        scene.port.sleep(0.02)


def raw_goal(scene: Scene) -> None:
    """Write the goal itself, where there is a register for it."""
    row = scene.model.register("goal_position")
    if not row.writable:
        fast_move(scene)
        return
    for servo, here in zip(scene.servos, scene.heres, strict=True):
        values: dict[Any, float] = {row: here + WAY}
        if has(scene.model, "goal_time"):
            values["goal_time"] = 2.5
        result_of(servo.write_many(values))


WAYS: list[Callable[[Scene], None]] = [move, fast_move, group_move, turn, stream, raw_goal]


def is_quick(model: type[Model], way: Callable[[Scene], None]) -> bool:
    """Tell whether nothing but the motor bounds the speed, so that a motion can be over before it must be stopped."""
    return way is fast_move or (way in (stream, raw_goal) and not has(model, "goal_time"))


# Faults, while it moves


def no_fault(scene: Scene) -> None: ...


def absent_neighbours(scene: Scene) -> None:
    for id in (8, 9):
        scene.bus.attach(scene.model, id).permit.mark_moving()
    # They come first.
    scene.bus._servos._servos.sort(key=lambda servo: -servo.id)


def lost_answers(scene: Scene) -> None:
    scene.port.inject("mute#1-5")


def no_answers(scene: Scene) -> None:
    scene.port.inject("mute")


def garbled(scene: Scene) -> None:
    scene.port.inject("flip#1-3,flip#7")


def bad_line(scene: Scene) -> None:
    scene.port.inject("drop=0.1,flip=0.05")


def lost_requests(scene: Scene) -> None:
    scene.port.inject("deaf#1-2")


def cut_off(scene: Scene) -> None:
    """Nothing reaches a servo any more."""
    scene.may_be_deaf = True
    scene.port.inject("deaf")


def outside_limits(scene: Scene) -> None:
    row = scene.model.register("max_position")
    for real in scene.reals:
        if real.get("min_position") or real.get("max_position"):  # an RX-28 that turns has none
            real.put(row.name, row.scale.encode(real.position - 20 * deg))


def shut_down(scene: Scene) -> None:
    for real in scene.reals:
        if has(scene.model, "torque_limit"):
            real.put("torque_limit", 0)
        elif has(scene.model, "status_error"):
            real._fault(StatusError.OVERLOAD)  # type: ignore[attr-defined] # one of a HerkuleX
        else:
            real.temperature = 95.0
    scene.port.sleep(0.1)


def silent(scene: Scene) -> None:
    """They answer no reads any more, as they were told."""
    if can_be_silenced(scene.model):
        row = scene.model.register("answer_level")
        for servo in scene.servos:
            result_of(servo.write_raw({row: Answers.NOTHING}))


def other_speed(scene: Scene) -> None:
    """They are at another speed than others, and known to be there."""
    bauds = other_bauds(scene.model)
    if bauds:
        scene.bus.attach(scene.model, 9, baud=scene.model.factory_baud).permit.mark_moving()


def unknown_model(scene: Scene) -> None:
    """What they are is not known, but for their family."""
    model = registry.unknown(scene.model.family, 65_001)
    assert model is not None
    baud, answers = scene.servos[0].baud, scene.servos[0].target.answers
    scene.servos = [scene.bus.attach(model, id, baud=baud, answers=answers) for id in (1, 2)]


FAULTS: list[Callable[[Scene], None]] = [
    no_fault, absent_neighbours, lost_answers, no_answers, garbled, bad_line, lost_requests, cut_off, outside_limits,
    shut_down, silent, other_speed, unknown_model,
]  # fmt: skip


# Ways of ending: each gives what it tells


def stop_each(scene: Scene) -> str:
    said = ""
    for servo in scene.servos:
        try:
            result_of(servo.stop())
        except BusError as error:
            said += f"{servo.target} may still move: {error}"
    return said


def stop_bus(scene: Scene) -> str:
    try:
        result_of(scene.bus.stop())
    except StopFailed as error:
        return str(error)
    return ""


def make_safe(scene: Scene) -> str:
    result_of(scene.bus.make_safe())
    return ""


def free(scene: Scene) -> str:
    result_of(scene.bus.make_safe("free"))
    return ""


class _SlipError(Exception):
    pass


def crash(scene: Scene, error: type[BaseException] = _SlipError) -> str:
    if isinstance(scene.bus, AsyncBus):

        async def leave() -> None:
            async with scene.bus:
                raise error

        with pytest.raises(error) as caught:
            asyncio.run(leave())
    else:
        with pytest.raises(error) as caught, scene.bus:
            raise error
    scene.port.reopen()
    return "\n".join(getattr(caught.value, "__notes__", ()))


def ctrl_c(scene: Scene) -> str:
    return crash(scene, KeyboardInterrupt)


def torque_block(scene: Scene) -> str:
    """Leave `with bus.torque()` by an error."""
    bus = scene.bus
    if isinstance(bus, AsyncBus):

        async def leave() -> None:
            with bus.safety.letting_go(error):
                await bus._let_go(scene.servos, scene.servos, error)

        error = _SlipError()
        asyncio.run(leave())
    else:
        error = _SlipError()
        with bus.safety.letting_go(error):
            bus._leave(bus.safety.secure(scene.servos, error), scene.servos)
    return "\n".join(getattr(error, "__notes__", ()))


ENDS: list[Callable[[Scene], str]] = [stop_each, stop_bus, make_safe, free, crash, ctrl_c, torque_block]


def moves(scene: Scene) -> list[bool]:
    """Tell which shafts move, but for those that nothing drives any more, which run down."""
    driven = [real.torque for real in scene.reals]
    before = [real.shaft.position for real in scene.reals]
    scene.port.sleep(0.1)
    still = [abs(real.shaft.position - was) > 0.05 * deg for real, was in zip(scene.reals, before, strict=True)]
    if any(still) and not all(driven):
        scene.port.sleep(3.0)
        return [moving and on for moving, on in zip(still, driven, strict=True)] if not any(driven) else moves(scene)
    return still


def play(
    scene: Scene, way: Callable[[Scene], None], fault: Callable[[Scene], None], end: Callable[[Scene], str]
) -> str:
    """Move, let something go wrong, end it, and check; give what was told."""
    scene.torque_on()
    if is_quick(scene.model, way):
        scene.hold_shafts(True)
    way(scene)
    scene.port.sleep(0.15)
    fault(scene)
    begun = scene.port.now()
    said = end(scene)
    scene.port.sleep(begun + LIMIT - scene.port.now())
    scene.port.inject(None)
    if is_quick(scene.model, way):
        scene.hold_shafts(False)
    still = moves(scene)
    if shut_down is fault:  # what switched it off is over: it does not go on either
        for real in scene.reals:
            real.temperature = 25.0
        scene.port.sleep(0.5)
        still = moves(scene)
    assert not any(still) or scene.may_be_deaf, (way.__name__, said, still)
    return said


def cells(*axes: Sequence[Any]) -> list[Any]:
    """Give the cells of a table: a model, then one of each axis. Without `--all` each cell is one family's."""
    every = len(ONE_OF_EACH_FAMILY)
    return [
        pytest.param(key, *cell, id="-".join([key, *(one.__name__ for one in cell)]))
        for (k, key), *numbered in itertools.product(enumerate(SERIES_KEYS), *map(enumerate, axes))
        for numbers, cell in [zip(*numbered, strict=True)]
        if extent.in_turn(k, *numbers, every=every)
    ]


@pytest.mark.parametrize(("key", "way", "fault", "end"), cells(WAYS, FAULTS, ENDS))
def test_motion_ends(
    key: str,
    way: Callable[[Scene], None],
    fault: Callable[[Scene], None],
    end: Callable[[Scene], str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.ERROR):
        said = play(Scene(key), way, fault, end) + caplog.text
    if fault is cut_off:
        assert all(f"{MODELS[key].title} id {id} may still move" in said for id in (1, 2)) or end is torque_block
        assert "may still" in said
    if fault in (absent_neighbours, other_speed) and end in (stop_bus, make_safe, crash):
        assert "id 9 may still move" in said or not (fault is absent_neighbours or other_bauds(MODELS[key]))


@pytest.mark.parametrize(("key", "fault", "end"), cells(FAULTS, ENDS))
def test_motion_ends_with_asyncio(key: str, fault: Callable[[Scene], None], end: Callable[[Scene], str]) -> None:
    play(Scene(key, driver=AsyncBus), move, fault, end)


@series_models
@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
def test_a_cell_fails_where_an_end_stops_nothing(key: str, way: Callable[[Scene], None]) -> None:
    def nothing(scene: Scene) -> str:
        return ""

    with pytest.raises(AssertionError, match=way.__name__):
        play(Scene(key), way, no_fault, nothing)


@one_model_of_each_family
def test_the_watch_ends_motion(key: str) -> None:
    with servobus.open(f"virtual:{key}@1,2?clock=real", echo=False) as bus:
        for id in (1, 2):
            servo = bus.attach(MODELS[key], id)
            servo.torque_on()
            servo.turn(**turning(servo.model))
        bus.attach(MODELS[key], 9).permit.mark_moving()
        port: Any = bus.transport
        with bus.watch(timeout=0.05) as watch:
            assert watch.wait(10)
        port.sleep(LIMIT)
        before = [real.shaft.position for real in port.servos]
        port.sleep(0.1)
        assert [real.shaft.position for real in port.servos] == pytest.approx(before, abs=0.05 * deg)
