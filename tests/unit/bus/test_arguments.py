"""N24: names that look alike take the same things, and what is none of them is refused. N22: attributes."""

import asyncio
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import servobus
from servobus import LX16A, RX28, BadValue, BusServo, NoReply, Readings, ServobusError, Thresholds, UsageError, deg
from servobus.families.base import Answers
from servobus.virtual.serve.inprocess import VirtualPort

anyhow: Any = servobus
"""The package, for calls that a type checker would refuse."""
ARM = "virtual:rx28@1,lx16a@2?clock=virtual"
HUGE = 10**400
"""A whole number beyond the range of float."""
NO_NUMBERS = ["90", None, [1], HUGE, -HUGE, math.nan, math.inf]


@pytest.fixture
def bus() -> Any:
    with servobus.open(ARM) as bus:
        bus.attach(RX28, 1)
        bus.attach(LX16A, 2)
        yield bus


# Names that look alike


def torques(bus: servobus.Bus) -> list[bool]:
    bus.transport.sleep(0.1)
    assert isinstance(bus.transport, VirtualPort)
    return [real.torque for real in bus.transport.servos]


ONE_OR_SEVERAL: list[Callable[[Any], Any]] = [
    lambda servo: servo.id,
    lambda servo: servo,
    lambda servo: [servo.id],
    lambda servo: (servo,),
    lambda servo: {servo},
    lambda servo: iter([servo.id]),
    lambda servo: np.array([servo.id]),
    lambda servo: np.int64(servo.id),
]


@pytest.mark.parametrize("which", ONE_OR_SEVERAL)
def test_N24_servos_are_given_by_themselves_or_by_id_one_or_several(bus: Any, which: Callable[[Any], Any]) -> None:
    rx = bus[1]
    bus.torque_on(which(rx))
    assert torques(bus) == [True, False]
    bus.torque_off(which(rx))
    assert torques(bus) == [False, False]
    with bus.torque(which(rx)):
        assert torques(bus) == [True, False]
    assert list(bus.read_all("present_position", which(rx))) == [rx]
    assert bus.cycle("present_position", servos=which(rx)).servos == [rx]


@pytest.mark.parametrize("key", [lambda servo: servo.id, lambda servo: servo, lambda servo: np.int64(servo.id)])
def test_N24_keys_are_servos_or_ids(bus: Any, key: Callable[[Any], Any]) -> None:
    rx = bus[1]
    assert bus[key(rx)] is rx
    assert key(rx) in bus
    with bus.torque():
        bus.move({key(rx): 150 * deg}, time=0.2).wait()
        seen = bus.cycle("present_position").run({key(rx): 150 * deg})
    assert seen[key(rx)]["present_position"] == pytest.approx(150 * deg, abs=2 * deg)
    assert bus.read_all("present_position")[key(rx)] == pytest.approx(150 * deg, abs=2 * deg)
    bus.forget(key(rx))
    assert len(bus) == 1


@pytest.mark.parametrize("register", [RX28.present_position, "present_position"])
def test_N24_registers_are_given_by_themselves_or_by_name_one_or_several(bus: Any, register: Any) -> None:
    rx = bus[1]
    angle = rx.read(register)
    assert rx.read_many(register) == rx.read_many([register]) == {"present_position": angle}
    assert rx.read_raw(register) == rx.read_raw((register,))
    assert bus.read_all(register)[1] == angle
    for read in (register, [register], (register,)):
        assert bus.cycle(read, servos=1).run()[1]["present_position"] == angle


@pytest.mark.parametrize("bauds", [57_600, [57_600], (57_600, 115_200), np.int64(57_600), {57_600}])
@pytest.mark.parametrize("ids", [1, [1], range(1, 3), np.int64(1), {1}])
def test_N24_ids_and_speeds_one_or_several(bauds: Any, ids: Any) -> None:
    with servobus.open(ARM, bauds=bauds) as bus:
        assert [servo.id for servo in bus.scan(ids=ids, family="dynamixel")] == [1]
        assert bus.find(1, bauds=bauds).baud == 57_600
        assert len(bus.scan(ids=ids, bauds=bauds, family="dynamixel")) == 1


@pytest.mark.parametrize("model", [RX28, "rx28", "RX-28"])
def test_N24_models_by_themselves_or_by_name(model: Any) -> None:
    with servobus.open(ARM, models={1: model}) as bus:
        assert bus.attach(model, 1).model is RX28


def test_N24_a_port_may_be_a_path() -> None:
    with pytest.raises(servobus.PortError, match="/no/such/port: no such port"):
        servobus.open(Path("/no/such/port"))


# What is none


def refused_by(call: Callable[[], Any]) -> str:
    with pytest.raises(ServobusError) as caught:
        call()
    assert isinstance(caught.value, UsageError)
    said = str(caught.value)
    assert len(said) < 250
    assert "\n" not in said
    return said


@pytest.mark.parametrize("id", ["a", "1", None, 1.0, True, [1], -1, 254, HUGE, b"1"])
def test_N24_what_is_no_id(bus: Any, id: Any) -> None:
    asked = [lambda: bus.find(id), lambda: bus.attach(RX28, id), lambda: bus[1].change_id(id)]
    if not isinstance(id, list):
        asked.append(lambda: bus.scan(ids=id))
    asked.append(lambda: bus.scan(ids=[id]))
    for call in asked:
        assert "id" in refused_by(call)
    assert bus.stats.total.sent == 0
    assert len(bus) == 2


@pytest.mark.parametrize("baud", ["x", "57600", -5, 0, 1e9, math.nan, HUGE, True, [], [57_600, "x"], {57_600: 1}])
def test_N24_what_is_no_speed(bus: Any, baud: Any) -> None:
    calls = [
        lambda: bus.find(1, bauds=baud),
        lambda: bus.scan(bauds=baud),
        lambda: servobus.open(ARM, bauds=baud),
        lambda: bus.attach(RX28, 3, baud=baud),
        lambda: bus[1].change_baud(baud),
    ]
    for call in calls:
        assert "speed" in refused_by(call)
    assert bus.stats.total.sent == 0
    assert len(bus) == 2


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_N24_what_is_no_number(bus: Any, value: Any) -> None:
    rx = bus[1]
    calls = [
        lambda: rx.move(value),
        lambda: rx.move_by(value),
        lambda: bus.move({1: value}),
        lambda: bus.cycle("present_position").run({1: value}),
        lambda: rx.turn(output=[value]),
        lambda: rx.write(RX28.goal_position, value),
        lambda: bus.cycle("present_position", time=value),
        lambda: bus.cycle("present_position").every(value),
        lambda: rx.position_mode((value, 100 * deg)),
        lambda: bus.protect(Thresholds(warn=value)),
    ]
    if value is not None:
        calls += [
            lambda: rx.move(150 * deg, time=value),
            lambda: rx.move(150 * deg, speed=value),
            lambda: rx.turn(output=value),
            lambda: setattr(rx, "max_step", value),
        ]
    bus.torque_on()
    sent = bus.stats.total.sent
    for call in calls:
        refused_by(call)
    assert rx.max_step is None
    assert bus.stats.total.sent == sent


def test_N24_numbers_that_are_too_small() -> None:
    assert "no code comes within 3 %" in refused_by(lambda: anyhow.RX28.baud.encode(1e-310))
    assert "no code comes within 3 %" in refused_by(lambda: anyhow.RX28.baud.encode(5e-324))


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda bus: bus.find(1, family=5), "5 is no family: give its name, dynamixel, herkulex or lewansoul"),
        (lambda bus: bus.find(1, family="rx28"), "no family 'rx28': RX-28 is a model, of the family dynamixel"),
        (lambda bus: bus.find(1, family=RX28), "is no family"),
        (lambda bus: bus.attach("rx29", 1), "no model 'rx29'; did you mean rx28"),
        (lambda bus: bus.attach(1, RX28), "1 is no model: attach() takes a model and an id, as in attach(RX28, 1)"),
        (lambda bus: bus.attach(RX28, 3, answers=7), "answers 7 is none of Answers.NOTHING, "),
        (lambda _: anyhow.open(None), "None is no name of a port"),
        (lambda _: anyhow.open(b"/dev/x"), "is no name of a port"),
        (lambda _: servobus.open(""), "the name of the port is empty"),
        (lambda _: anyhow.open(ARM, models=5), "5 is no model"),
        (lambda bus: bus[1].read(["x"]), "read() reads one register, not ['x']; read_many() reads several"),
        (lambda bus: bus[1].read_many(["x", "y"]), "RX-28 has no register 'x'"),
        (lambda bus: bus[1].read_many(36), "36 is no register"),
        (lambda bus: bus[1].write_many([("led", True)]), "are no mapping: give them as in {RX28.led: True}"),
        (lambda bus: bus[1].write(RX28.led, "on"), "RX-28 led: 'on' is no switch: give True or False"),
        (lambda bus: bus["1"], "no such servo as '1' is known here (known: 1, 2); an id is a number, not a text"),
        (lambda bus: bus.read_all("present_position")["1"], "an id is a number, not a text"),
        (lambda bus: bus.move(5), "goals 5 are no mapping: give them as in {1: 90 * deg}"),
        (lambda bus: bus.move([1, 2]), "are no mapping"),
        (lambda bus: bus.cycle("present_position").run([1]), "are no mapping"),
        (lambda bus: bus.cycle(5), "5 is no register"),
        (lambda bus: bus.read_all(5), "5 is no register"),
        (lambda bus: bus.read_all(["present_position", "led"]), "is no register"),
        (lambda bus: bus.protect(5), "protect() takes Thresholds(warn=...), or nothing, not 5"),
        (lambda bus: bus[1].turn(), "RX-28 id 1: say how fast, as in turn(output=0.3)"),
        (lambda bus: bus[1].turn(output=300), "output 300 is not a share of full output, -1 .. 1"),
        (lambda bus: setattr(bus[1], "max_step", 30), "did you mean 30 * deg?"),
        (lambda bus: bus[1].restore("a = 1"), "restore() takes a Backup, as Backup.parse(text) gives"),
        (lambda bus: bus[1].position_mode(5), "limits 5 are not two angles"),
        (lambda bus: bus.torque_on("12"), "no such servo as '12'"),
        (lambda _: RX28.register("PRESENT_POSITION"), "did you mean present_position?"),
        (lambda _: RX28.register("36"), "did you mean present_position?"),
        (lambda _: RX28.register("goal"), "did you mean goal_position or "),
        (lambda _: RX28.register("xyzzy"), "`servobus registers rx28` lists them"),
    ],
)
def test_N24_a_slip_is_answered_with_what_is_meant(bus: Any, call: Callable[[Any], Any], said: str) -> None:
    assert said in refused_by(lambda: call(bus))


def test_N24_a_level_may_be_the_number_of_the_manual(bus: Any) -> None:
    assert bus.attach(RX28, 5, answers=1).target.answers is Answers.READS


# N22


@pytest.mark.parametrize("name", ["goal_position", "present_position", "torque_enable", "led", "max_temperature"])
@pytest.mark.parametrize("id", [1, 2])
def test_N22_a_register_is_no_attribute(bus: Any, name: str, id: int) -> None:
    servo = bus[id]
    with pytest.raises(AttributeError, match=rf"servo\.write\({servo.model.__name__}\..*nothing was sent"):
        setattr(servo, name, 1)
    if name != "led":  # that is a verb
        with pytest.raises(AttributeError, match=rf'to read a register: servo\.read\("{name}"\); nothing was asked'):
            getattr(servo, name)
    assert not hasattr(servo, "goal_position")
    assert bus.stats.total.sent == 0


def test_N22_other_names_are_answered_too(bus: Any) -> None:
    with pytest.raises(AttributeError, match=r'no attribute \'angle\'; to read a register: servo\.read\("present_pos'):
        bus[1].angle  # noqa: B018
    with pytest.raises(AttributeError, match=r"bus\[id\]\.read.*bus\.read_all"):
        bus.present_position  # noqa: B018
    assert not hasattr(bus[1], "_repr_html_")
    assert not hasattr(bus[1], "__array__")


def test_N22_an_unfinished_object_has_plain_errors() -> None:
    with pytest.raises(AttributeError, match="'BusServo' object has no attribute 'target'"):
        BusServo.__new__(BusServo).target  # noqa: B018


# M8: what came, and what did not


def test_M8_read_all_gives_what_came_and_says_what_did_not(bus: Any) -> None:
    rx, lx = bus
    gone = bus.attach(RX28, 77)
    seen = bus.read_all("present_temperature")
    assert isinstance(seen, Readings)
    assert seen.by_id() == {1: 25.0, 2: 25.0}
    assert (list(seen), list(seen.lost)) == ([rx, lx], [gone])
    assert isinstance(seen.lost[77], NoReply)
    for key in (77, gone):
        with pytest.raises(NoReply, match="id 77"):
            seen[key]
        assert key not in seen
        assert seen.get(key) is None
    with pytest.raises(servobus.UnknownName):
        seen[5]
    with pytest.raises(NoReply):
        bus.read_all("present_temperature", gone)


def test_M8_so_it_does_on_an_asynchronous_bus() -> None:
    async def ask() -> None:
        async with servobus.open_async(ARM) as bus:
            bus.attach(RX28, 1)
            bus.attach(RX28, 77)
            seen = await bus.read_all("present_temperature")
            assert (seen.by_id(), list(seen.lost.by_id())) == ({1: 25.0}, [77])

    asyncio.run(ask())


def test_M8_an_id_that_two_have_is_unclear_though_one_is_lost() -> None:
    with servobus.open("virtual:rx28@1?clock=virtual") as bus:
        rx, lx = bus.attach(RX28, 1), bus.attach(LX16A, 1)
        seen = bus.read_all("present_temperature")
        assert seen[rx] == 25
        assert list(seen.lost) == [lx]
        with pytest.raises(servobus.UnknownName, match="not unique"):
            seen[1]


# Relative moves


def test_M11_a_move_by_an_angle(bus: Any) -> None:
    for servo in bus:
        before = servo.read("present_position")
        with servo.torque():
            servo.move_by(-20 * deg).wait()
            servo.move_by(5 * deg, time=0.3).wait()
            assert servo.read("present_position") == pytest.approx(before - 15 * deg, abs=2 * deg)
            with pytest.raises(BadValue, match="outside"):
                servo.move_by(300 * deg)


def test_M11_so_it_does_on_an_asynchronous_bus() -> None:
    async def ask() -> None:
        async with servobus.open_async(ARM) as bus:
            servo = await bus.find(1)
            async with servo.torque():
                before: float = await servo.read("present_position")
                await servo.move_by(-20 * deg).wait()
                assert await servo.read("present_position") == pytest.approx(before - 20 * deg, abs=2 * deg)

    asyncio.run(ask())
