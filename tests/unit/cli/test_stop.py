"""`stop` and `torque ... off` reach whoever can be reached, and what is printed to stop a servo does so."""

import shlex
from collections.abc import Callable
from typing import Any

import pytest

import servobus
from samples import (
    SAMPLE_KEYS,
    factory_baud,
    factory_bauds,
    has,
    one_model_of_each_family,
    other_bauds,
    sample_models,
    turning,
)
from servobus import MODELS, connect, deg
from servobus.cli import stop
from servobus.core.ids import BROADCAST
from servobus.families import registry
from servobus.virtual.serve.inprocess import VirtualPort
from unit.cli.conftest import Run

EACH_SPEED = {(model.family.name, factory_baud(model)): key for key, model in reversed(list(MODELS.items()))}
"""Family and factory speed -> the first model with both."""
KEYS = list(dict.fromkeys([*SAMPLE_KEYS, *EACH_SPEED.values()]))
ALL_FAMILIES = ",".join(f"{key}@{n + 1}" for n, key in enumerate(KEYS))


@pytest.fixture
def ports(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Any]:
    """Make a port that lasts from command to command: its servos go on, and the test sees them."""

    def make(spec: str) -> Any:
        bus = connect.open(f"virtual:{spec}?clock=virtual")

        def opened(_: str) -> servobus.Bus:
            port: VirtualPort = bus.transport  # type: ignore[assignment] # a virtual: port is one
            port.reopen()
            return servobus.Bus(port)

        monkeypatch.setattr(servobus, "open", opened)
        return bus

    return make


def set_going(bus: Any, turn: bool) -> None:
    """Set all servos of a bus going, slowly, or without end where they can."""
    for real in bus.transport.servos:
        servo = bus.attach(real.model, real.id, baud=near(real))
        servo.torque_on()
        if turn and servo.model.turns:
            servo.turn(**turning(servo.model))
        else:
            servo.start_move(servo.look().position + 40 * deg, time=2.5)
    bus.transport.sleep(0.3)


def near(real: Any) -> int:
    """Give the speed of a servo as its manual prints it."""
    return min((int(baud) for baud in real.model.bauds), key=lambda baud: abs(baud - real.baud))


def stand(bus: Any) -> list[bool]:
    """Tell which shafts have come to rest."""
    port = bus.transport
    port.reopen()
    port.sleep(0.3)
    before = [real.shaft.position for real in port.servos]
    port.sleep(0.3)
    return [abs(real.shaft.position - was) < 0.01 * deg for real, was in zip(port.servos, before, strict=True)]


def set_baud(bus: Any, baud: int) -> None:
    for real in bus.transport.servos:
        if baud in real.model.bauds and has(real.model, "baud"):
            row = real.model.register("baud")
            real.memory.store(row, row.encode(baud))
            real.power_on(bus.transport.now())


@sample_models
@pytest.mark.parametrize("turn", [False, True])
@pytest.mark.parametrize("verb", ["stop", "torque"])
def test_N2_one_that_is_missing_keeps_no_other_moving(
    ports: Callable[[str], Any], run: Run, key: str, turn: bool, verb: str
) -> None:
    bus = ports(f"{key}@1,2")
    set_going(bus, turn)
    words = ("off",) if verb == "torque" else ()
    result = run(verb, "arm", 1, 99, 2, *words, code=1)
    assert stand(bus) == [True, True]
    assert result.stdout.count(": torque off\n" if words else " stopped: ") == 2
    assert "no servo answers to id 99" in result.stderr
    assert "may still move" in result.stderr


@sample_models
def test_N2_both_are_stopped_before_the_missing_one_is_looked_for(
    ports: Callable[[str], Any], run: Run, key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = ports(f"{key}@1,2")
    set_going(bus, turn=False)
    begun, told = bus.transport.now(), []
    monkeypatch.setattr(stop, "note", lambda text: told.append((text, bus.transport.now() - begun)))
    run("stop", "arm", 1, 99, 2, code=1)
    text, seconds = told[0]
    assert text == ("looking for id 99 at every speed of dynamixel, herkulex, lewansoul, which takes some seconds")
    assert seconds < 2.0  # by then all were asked twice, in all families and at all speeds from the factory
    assert stand(bus) == [True, True]


@sample_models
@pytest.mark.parametrize("faults", ["mute#1-2", "mute", "flip#1-3"])
def test_N2_neither_does_a_lost_answer(ports: Callable[[str], Any], run: Run, key: str, faults: str) -> None:
    """Of one that never answers it is told that it may still move; but it was told to let go, and hears that."""
    bus = ports(f"{key}@1")
    set_going(bus, turn=False)
    bus.transport.inject(faults)
    result = run("stop", "arm", 1, code=1 if faults == "mute" else 0)
    bus.transport.inject(None)
    assert stand(bus) == [True], result.output
    assert faults != "mute" or "told to switch its torque off all the same" in result.stderr


def test_N2_an_id_of_two_families_is_both(ports: Callable[[str], Any], run: Run) -> None:
    bus = ports("rx28@10,lx16a@10,drs0602@10")
    set_going(bus, turn=False)
    assert run("stop", "arm", 10).stdout.count(" stopped: held at ") == 3
    assert stand(bus) == [True] * 3


@sample_models
def test_N2_one_at_another_speed_is_looked_for_there(ports: Callable[[str], Any], run: Run, key: str) -> None:
    for baud in other_bauds(MODELS[key]):
        bus = ports(f"{key}@1")
        set_baud(bus, baud)
        set_going(bus, turn=False)
        assert " stopped: held at " in run("stop", "arm", 1).stdout
        assert stand(bus) == [True]


@pytest.mark.parametrize("verb", ["stop", "torque"])
@pytest.mark.parametrize(
    ("key", "rows"), [("rx28", {"model_number": 29}), ("drs0602", {"model_no1": 1, "model_no2": 2})]
)
def test_N2_one_of_an_unknown_model_is_stopped_too(
    ports: Callable[[str], Any], run: Run, key: str, rows: dict[str, int], verb: str
) -> None:
    bus = ports(f"{key}@1")
    set_going(bus, turn=False)
    for name, raw in rows.items():
        bus.transport.servos[0].put(name, raw)
    words = ("off",) if verb == "torque" else ()
    result = run(verb, "arm", 1, *words)
    assert "torque off" in result.stdout or "stopped: held at " in result.stdout
    assert stand(bus) == [True]


# Torque off, to all


@pytest.mark.parametrize("turn", [False, True])
def test_N6_all_off_reaches_every_family_at_its_factory_speed(
    ports: Callable[[str], Any], run: Run, turn: bool
) -> None:
    bus = ports(ALL_FAMILIES)
    set_going(bus, turn)
    run("torque", "arm", "all", "off")
    assert [real.torque for real in bus.transport.servos] == [False] * len(KEYS)


@sample_models
def test_N6_all_off_reaches_every_speed_within_two_seconds(ports: Callable[[str], Any], run: Run, key: str) -> None:
    for baud in MODELS[key].bauds:
        bus = ports(f"{key}@1,2,219")
        set_baud(bus, baud)
        set_going(bus, turn=False)
        begun = bus.transport.now()
        said = run("torque", "arm", "all", "off").stdout
        assert bus.transport.now() - begun < 2
        assert [real.torque for real in bus.transport.servos] == [False] * 3, baud
        assert str(baud) in said
        assert "every servo" not in said


@pytest.mark.parametrize("baud", [2_000_000, 222_222, 34_482, 10_000, 7_843])
def test_N6_all_off_reaches_speeds_that_are_not_usual(ports: Callable[[str], Any], run: Run, baud: int) -> None:
    """RX-28: 2 Mbit/s / (code + 1), any code from 0 to 254 (3-4-1 Baud Rate)."""
    bus = ports("rx28@1")
    servo = bus.find(1)
    servo.torque_on()
    real = bus.transport.servos[0]
    real.memory.store(servo.model.register("baud"), round(2_000_000 / baud) - 1)
    real._listen()
    begun = bus.transport.now()
    run("torque", "arm", "all", "off")
    assert not bus.transport.servos[0].torque
    assert bus.transport.now() - begun < 4


def test_N6_a_speed_that_the_port_refuses_keeps_no_other_from_being_told(
    ports: Callable[[str], Any], run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = ports("rx28@1")
    bus.find(1).torque_on()
    set_speed = bus.transport.set_baud

    def refuse(baud: int) -> None:
        if baud != 57_600:
            raise servobus.PortError(f"arm cannot be set to {baud} baud")
        set_speed(baud)

    monkeypatch.setattr(bus.transport, "set_baud", refuse)
    assert "nobody was told there: arm cannot be set to 666666 baud" in run("torque", "arm", "all", "off").stderr
    assert not bus.transport.servos[0].torque


def test_N6_servos_of_all_families_at_one_speed_hear_it(ports: Callable[[str], Any], run: Run) -> None:
    speeds = [set(registry.bauds(family)) for family in registry.FAMILIES.values() if len(registry.bauds(family)) > 1]
    for baud in sorted(set.intersection(*speeds)):
        bus = ports(ALL_FAMILIES)
        set_baud(bus, baud)
        set_going(bus, turn=False)
        run("torque", "arm", "all", "off")
        assert [real.torque for real in bus.transport.servos] == [False] * len(KEYS), baud


def test_N6_it_is_told_twice_and_only_where_it_is_asked_for(ports: Callable[[str], Any], run: Run) -> None:
    bus = ports("rx28@1")
    heard: list[Any] = []
    real = bus.transport.servos[0]
    hear = real.hear

    def heard_too(event: Any, now: float) -> Any:
        heard.append(event)
        return hear(event, now)

    real.hear = heard_too
    said = run("torque", "arm", "all", "off", "--baud", 57600, "--family", "dynamixel").stdout
    assert said == "torque off: told all ids\n  dynamixel at 57600\n"
    # WRITE_DATA of Torque Enable, address 24 (3-4), to the broadcast id
    assert [(one.id, one.code, one.data) for one in heard] == [(BROADCAST, 3, bytes([24, 0]))] * 2


# What is printed


@one_model_of_each_family
def test_N5_what_turn_prints_works_for_a_servo_at_another_speed(
    ports: Callable[[str], Any], run: Run, key: str
) -> None:
    model = MODELS[key]
    baud = next(iter(other_bauds(model)), model.factory_baud)
    bus = ports(f"{key}@1")
    set_baud(bus, baud)
    how = ("--speed", "60") if model.turns_at_speed() else ("--output", "40")
    result = run("turn", "arm", 1, *how, "--baud", baud, "--family", model.family.name)
    stopping = shlex.split(result.stdout.split("`")[1])
    assert f"--family {model.family.name}" in result.stdout
    assert ("--baud" in stopping) == (baud not in factory_bauds(model.family))
    assert "it turns no more" in run(*stopping[1:]).stdout
    assert stand(bus) == [True]
    back = shlex.split(result.stderr.partition("back to angles: ")[2].splitlines()[0])
    assert "takes angles again" in run(*back[1:]).stdout


def test_N5_the_model_that_was_said_is_said_again(run: Run) -> None:
    port = "virtual:lx16a@1?clock=virtual"
    said = run("turn", port, 1, "--output", "10", "--model", "lx16a").stdout
    assert f"`servobus stop '{port}' 1 --model lx16a` stops it" in said


def test_N5_what_reset_prints_undoes_it(ports: Callable[[str], Any], run: Run, tmp_path: Any) -> None:
    bus = ports("drs0602@5")
    set_baud(bus, 500_000)
    file = tmp_path / "saved.toml"
    where = ["--family", "herkulex", "--baud", "500000"]
    result = run("reset", "arm", 5, "--keep", "baud", "--yes", *where, "--backup", file)
    undo = [shlex.split(line)[1:] for line in result.stdout.splitlines() if line.startswith("  servobus ")]
    assert len(undo) == 2  # what was saved, and the id
    for words in undo:
        assert words[-4:] == where
        run(*words, *(["--yes"] if words[0] == "restore" else []))
    bus.transport.reopen()
    assert (bus.transport.servos[0].id, near(bus.transport.servos[0])) == (5, 500_000)
