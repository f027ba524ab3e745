"""Nobody moves: every verb of the command line and every public method that is no motion by its name.

They are listed from the code, so that a new one without a case here fails. Each is tried on every family, with several
firmwares, in every mode; what changes something, without `--all`, in every other mode of each. What counts is the true
shaft of the virtual servo.
"""

import contextlib
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

import extent
from drivers import result_of
from samples import ONE_OF_EACH_FAMILY, one_model_of_each_family, turning
from servobus import MODELS, AsyncBus, Bus, ServobusError, deg
from servobus.bus.asyncio import AsyncBusServo
from servobus.bus.blocking import BusServo
from servobus.cli.app import app
from servobus.core.units import Quantity
from servobus.jobs.backup import Backup
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort, connect
from unit.cli.verbs import NAMES

FIRMWARES = {"manual": "&as=manual", "kept": ""}
"""What is open in the manuals: as they say, or as users report but with every goal remembered, whatever comes between:
a driver may rely on neither."""
PORT = "/dev/arm"
"""Name of the virtual port on the command line: `sniff` listens at no port that says it is virtual."""
REMEMBERED = {"goal_after_limp", "goal_after_turn"}
"""Options of such firmware. A HerkuleX of it has a test of its own."""
SPAN = 0.1
"""s between two looks where the shaft is."""


class World:
    """One virtual servo on a virtual clock, and a driver for it."""

    def __init__(self, key: str, firmware: str, driver: type[Bus] | type[AsyncBus] = Bus) -> None:
        self.port: VirtualPort = connect(f"virtual:{key}@1?clock=virtual{FIRMWARES[firmware]}")
        if firmware == "kept":
            for name in REMEMBERED & self.real.options.keys() if key != "drs0602" else ():
                setattr(self.real, name, "kept")
        self.bus: Any = driver(self.port, echo=False)
        self.servo: Any = self.bus.attach(MODELS[key], 1)

    @property
    def real(self) -> VirtualServo:
        return self.port.servos[0]

    def settle(self) -> None:
        """Wait until the shaft rests; a torque that comes back by itself may bring it to a remembered goal."""
        for _ in range(30):
            before = self.real.shaft.position
            self.port.sleep(SPAN)
            if self.real.shaft.position == before:
                return
        raise AssertionError("it never rests")

    def stands(self, case: Callable[[], Any], said: str) -> None:
        """Make sure that the shaft stays where it is, to the last unit of its register, through a case and after."""
        scale = self.real.row("present_position").scale
        assert isinstance(scale, Quantity)
        here = self.real.shaft.position
        case()
        for _ in range(6):
            assert abs(self.real.shaft.position - here) < scale.step, said
            self.port.sleep(SPAN)


# Modes: what came before

Mode = Callable[[World], None]


def limp(world: World) -> None:
    world.real.turn_shaft(world.real.position + 25 * deg)


def holding(world: World) -> None:
    result_of(world.servo.torque_on())


def outside(world: World) -> None:
    result_of(world.servo.store({"max_position": world.real.position - 30 * deg}))


def turned(world: World) -> None:
    holding(world)
    result_of(world.servo.turn(**turning(world.servo.model)))
    world.port.sleep(0.1)
    result_of(world.servo.stop())


def turned_and_limp(world: World) -> None:
    turned(world)
    result_of(world.servo.torque_off())


def shut_down(world: World) -> None:
    """Too hot, turned by hand, and cool again: what is remembered is another goal."""
    holding(world)
    world.real.temperature = 110.0
    world.port.sleep(0.3)
    result_of(world.servo.ping())  # what an LX does about the heat it does when it is asked
    world.port.sleep(0.3)
    if not world.real.torque:
        world.real.turn_shaft(world.real.position + 25 * deg)
    world.real.temperature = 25.0


MODES: list[Mode] = [limp, holding, outside, turned, turned_and_limp, shut_down]
in_every_mode = pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.__name__)
with_each_firmware = pytest.mark.parametrize(
    ("key", "firmware"), [("rx28", "manual"), *((key, "kept") for key in ONE_OF_EACH_FAMILY)]
)
"""Of the other families manual and practice say the same about motion."""


# Public methods

Case = Callable[[World], Any]

MOTION = {
    "cancel", "do_in_turn", "has_ended", "move", "move_by", "start_move", "start_move_by", "start_planned", "turn",
    "wait_arrival",
}  # fmt: skip
"""Methods that move a servo by their name, or that are given a move or a turn of the line (`do` has a case)."""


def through(open: Callable[[World], Any]) -> Case:
    """Make a case of a `with`, which is gone through."""

    def case(world: World) -> Any:
        context = open(world)
        if isinstance(world.bus, Bus):
            with context:
                return None

        async def inside() -> None:
            async with context:
                pass

        return inside()

    return case


def protect_twice(world: World) -> None:
    for _ in range(2):
        result_of(world.bus.protect())
        world.port.sleep(0.2)


def choose(world: World) -> None:
    world.servo.safe_action = "free"
    world.bus.safe_action = "hold"
    world.servo.max_step = 5 * deg


def here(world: World) -> float:
    """Give where the shaft is, as a value that can be written."""
    return world.real.position


@functools.cache
def other_settings(key: str) -> Backup:
    """Give a backup of a model with other limits than it has from the factory."""
    world = World(key, "manual")
    row = MODELS[key].register("max_position")
    assert row.default is not None
    world.servo.write_raw({row: row.default - 300, "max_temperature": 60})
    saved: Backup = world.servo.backup()
    return saved


ASKS: dict[str, list[Case]] = {
    "alarm_text": [lambda w: w.servo.alarm_text()],
    "clear_latched": [lambda w: w.servo.clear_latched()],
    "note_alarms": [lambda w: w.servo.note_alarms(0)],
    "do": [lambda w: w.bus.do(w.servo.family.ping(1)), lambda w: w.servo.do(w.servo.family.ping(1))],
    "ping": [lambda w: w.servo.ping()],
    "look": [lambda w: w.servo.look()],
    "read_alarms": [lambda w: w.servo.read_alarms()],
    "verify": [lambda w: w.servo.verify()],
    "read": [lambda w: w.servo.read("present_position")],
    "read_many": [lambda w: w.servo.read_many(["present_position", "goal_position"])],
    "read_raw": [lambda w: w.servo.read_raw(["present_position"])],
    "backup": [lambda w: w.servo.backup()],
    "scan": [lambda w: w.bus.scan(ids=range(3))],
    "find": [lambda w: w.bus.find(1)],
    "identify": [lambda w: w.bus.identify(w.servo.family, 1, w.servo.baud, None)],
    "adopt": [lambda w: [w.bus.adopt(found) for found in w.bus.survey.found]],
    "attach": [lambda w: w.bus.attach(w.servo.model, 1), lambda w: w.bus.attach("ax12a", 2)],
    "read_all": [lambda w: w.bus.read_all("present_position")],
    "plan_move": [lambda w: w.bus.plan_move({1: here(w) + 5 * deg})],
    "cycle": [lambda w: w.bus.cycle(servos=[1]), lambda w: w.bus.cycle("present_position", servos=[1]).run()],
    "max_step": [choose],
}
"""Name -> ways to call what changes nothing in a servo."""

CHANGES: dict[str, list[Case]] = {
    "write": [
        lambda w: w.servo.write("max_position", here(w) + 5 * deg),
        lambda w: w.servo.write("torque_enable", w.servo.model.register("torque_enable").decode(w.servo.family.driven)),
    ],
    "write_many": [lambda w: w.servo.write_many({"max_position": here(w) - 20 * deg})],
    "write_raw": [lambda w: w.servo.write_raw({"min_position": 0, "max_position": 0})],
    "store": [lambda w: w.servo.store({"max_position": here(w) - 20 * deg})],
    "torque_on": [lambda w: w.bus.torque_on()],
    "torque_off": [lambda w: w.bus.torque_off()],
    "torque": [through(lambda w: w.servo.torque())],
    "rearm": [lambda w: w.servo.rearm()],
    "stop": [lambda w: w.bus.stop()],
    "position_mode": [lambda w: w.servo.position_mode()],
    "led": [lambda w: w.servo.led("on")],
    "reboot": [lambda w: w.servo.reboot()],
    "reset": [lambda w: w.servo.reset()],
    "change_id": [lambda w: w.servo.change_id(7)],
    "change_baud": [lambda w: w.servo.change_baud(w.servo.model.bauds[-1])],
    "restore": [
        lambda w: w.servo.restore(other_settings(w.servo.model.key())),
        lambda w: w.servo.restore(other_settings(w.servo.model.key()), torque_off=True),
    ],
    "forget": [lambda w: w.bus.forget(1)],
    "protect": [protect_twice],
    "make_safe": [lambda w: w.bus.make_safe(), lambda w: w.bus.make_safe("free")],
    "safe_action": [choose],
    "watch": [lambda w: w.bus.watch()],
    "reopen": [lambda w: w.bus.reopen()],
    "close": [lambda w: w.bus.close()],
}


def public(kind: type) -> set[str]:
    """List what can be done with objects of a class: methods, and attributes that can be set."""
    return {
        name
        for base in kind.__mro__
        for name, item in vars(base).items()
        if not name.startswith("_")
        and (item.fset is not None if isinstance(item, property) else callable(item) or hasattr(item, "__get__"))
    }


def own(kind: type) -> set[str]:
    """List what a driver says in its own words, beside what both drivers share."""
    return public(kind) & vars(kind).keys()


@pytest.mark.parametrize("kind", [BusServo, Bus, AsyncBusServo, AsyncBus])
def test_every_public_method_has_a_case(kind: type) -> None:
    assert public(kind) - MOTION <= ASKS.keys() | CHANGES.keys()


def world_in(key: str, firmware: str, mode: Mode, driver: type[Bus] | type[AsyncBus] = Bus) -> World:
    world = World(key, firmware, driver)
    mode(world)
    world.settle()
    return world


@with_each_firmware
@in_every_mode
def test_no_method_moves_a_servo(key: str, mode: Mode, firmware: str) -> None:
    world = world_in(key, firmware, mode)
    for name, cases in ASKS.items():
        for case in cases:
            world.stands(functools.partial(attempt, world, case), name)
    table = ONE_OF_EACH_FAMILY.index(key) + (firmware == "manual")
    for n, (name, case) in enumerate((name, case) for name, cases in CHANGES.items() for case in cases):
        if extent.in_turn(n, MODES.index(mode), table, every=2):
            world = world_in(key, firmware, mode)
            world.stands(functools.partial(attempt, world, case), name)


@pytest.mark.parametrize("verb", ["torque_on", "rearm"])
def test_a_herkulex_that_remembers_its_goal_is_stopped_before_it_gets_far(verb: str) -> None:
    """No source tells of such firmware (EH-43). What it does between two packets cannot be held back."""
    world = World("drs0602", "kept")
    world.real.goal_after_limp = "kept"  # type: ignore[attr-defined] # an option
    limp(world)
    here = world.real.shaft.position
    getattr(world.servo, verb)()
    world.settle()
    assert world.real.torque
    assert world.real.shaft.position == pytest.approx(here, abs=0.5 * deg)


@pytest.mark.parametrize("mode", [limp, holding], ids=lambda mode: mode.__name__)
@one_model_of_each_family
def test_no_method_of_the_asynchronous_driver_moves_a_servo(key: str, mode: Mode) -> None:
    for name in (own(AsyncBus) | own(AsyncBusServo)) - MOTION:
        for case in (ASKS | CHANGES)[name]:
            world = world_in(key, "kept", mode, AsyncBus)
            world.stands(functools.partial(attempt, world, case), name)


def attempt(world: World, case: Case) -> None:
    with contextlib.suppress(ServobusError):  # a refusal moves nothing either
        result_of(case(world))


# The command line

MOVES = {"move", "replay", "step"}
"""Verbs that move a servo by their name, `replay` virtual ones alone; and `turn`, but for its end."""
ROBOTS = {"robot", "pose", "teach", "play", "teleop"}
"""Verbs that are given a robot file: tests/unit/cli/test_robot_verbs.py and its neighbours look after them."""
ALONE = {"ports", "virtual", "demo", "models", "registers", "decode", "serve"} | ROBOTS
"""Verbs that are given no port; and `serve`, which asks no servo by itself and runs until it is ended."""

ASKING_LINES: dict[str, list[str]] = {
    "scan": ["--ids 0-3"],
    "doctor": ["--ids 0-3 --reads 10"],
    "info": ["1"],
    "read": ["1 present_position", "1 present_position --watch --seconds 0.3 --interval 0.1"],
    "plot": ["1 present_position --seconds 0.3"],
    "backup": ["1 -"],
    "sniff": [""],
    "remember": ["1 lx16a", "all lx16a"],
    "forget": ["", "1"],
}
"""verb -> what is said behind the port, for those that change nothing in a servo"""

CHANGING_LINES: dict[str, list[str]] = {
    "turn": ["1 --end"],
    "stop": ["1"],
    "torque": ["1 on", "1 off", "all off --family {family}"],
    "rearm": ["1"],
    "led": ["1 on"],
    "write": ["1 max_temperature=60", "1 min_position=0 max_position=0", "1 torque_enable=on"],
    "set-id": ["1 7"],
    "set-baud": ["1 115200"],
    "restore": ["1 other.toml --yes", "1 other.toml --yes --torque-off"],
    "reset": ["1 --yes --backup before.toml"],
    "reboot": ["1"],
}


def given_a_port(name: str) -> bool:
    command = app.get_command(click.Context(app), name)
    assert command is not None
    return any(parameter.name in ("port", "what") for parameter in command.params)


def test_every_verb_has_a_case() -> None:
    assert {name for name in NAMES if given_a_port(name)} - MOVES == ASKING_LINES.keys() | CHANGING_LINES.keys()
    assert {name for name in NAMES if not given_a_port(name)} == ALONE


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[World], None]:
    """Have commands find the port of a world under a name like that of a real one."""

    def plug(world: World) -> None:
        def opened(_: str) -> VirtualPort:
            world.port.reopen()
            return world.port

        world.bus.close()
        monkeypatch.setattr("servobus.virtual.serve.inprocess.connect", opened)
        for file in tmp_path.iterdir():
            file.unlink()
        Path("other.toml").write_text(other_settings(world.real.model.key()).text())

    monkeypatch.setattr("servobus.connect.VIRTUAL", PORT)
    monkeypatch.chdir(tmp_path)
    return plug


@in_every_mode
@one_model_of_each_family
def test_no_verb_moves_a_servo(key: str, mode: Mode, plugged: Callable[[World], None]) -> None:
    world = world_in(key, "kept", mode)
    plugged(world)
    for name, lines in ASKING_LINES.items():
        for line in lines:
            world.stands(functools.partial(run, world, name, line), f"{name} {line}")
    for n, (name, line) in enumerate((name, line) for name, lines in CHANGING_LINES.items() for line in lines):
        if extent.in_turn(n, MODES.index(mode), ONE_OF_EACH_FAMILY.index(key), every=2):
            world = world_in(key, "kept", mode)
            plugged(world)
            world.stands(functools.partial(run, world, name, line), f"{name} {line}")


def run(world: World, name: str, line: str) -> None:
    if name == "sniff":  # listens until the port goes away
        world.port.inject(f"gone#{world.port.now() + 0.2:.3f}s-")
    result = CliRunner().invoke(
        app, [name, PORT, *line.format(family=world.real.model.family.name).split()], prog_name="servobus"
    )
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in (0, 1), result.output
    world.port.inject(None)
