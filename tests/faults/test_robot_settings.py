"""What goes wrong while the settings of a robot's servos are written: nothing moves, and the same again does the rest.

What must happen stands as a table in docs/robot.md. Time is virtual.
"""

from collections.abc import Callable
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from servobus import ServobusError
from servobus.robots.blocking import Robot
from servobus.robots.settings import adopting
from servobus.robots.settings.backups import Backups
from servobus.virtual.physics.motor import Load
from servobus.virtual.serve.inprocess import VirtualPort
from unit.robots.settings.workshop import Killed, Workshop

JOINTS = """\
[joint.one]
port = "left"
model = "rx28"
id = 1
zero = "150deg"
limits = ["-90deg", "45deg"]
limits_in_servo = true
[joint.one.registers]
max_torque = "50%"
[joint.two]
port = "left"
model = "rx28"
id = 2
zero = "150deg"
[joint.two.registers]
max_torque = "60%"
[joint.grip]
port = "right"
model = "drs0602"
id = 219
[joint.grip.registers]
dead_zone = 3
"""
HELD = {
    # By the manuals: 1023 is 100 % of max_torque; 60° and 195° of an RX-28 are raw 204.6 and 664.95, rounded inwards.
    ("left", 1, "max_torque"): 512,
    ("left", 1, "cw_angle_limit"): 205,
    ("left", 1, "ccw_angle_limit"): 664,
    ("left", 2, "max_torque"): 614,
    ("right", 219, "dead_zone"): 3,
}
Fault = Callable[[Workshop], Callable[[], None]]
"""Makes something go wrong, and gives what mends it."""


def nothing() -> None:
    pass


def port_of(shop: Workshop, name: str) -> VirtualPort:
    port = shop.buses[name].transport
    assert isinstance(port, VirtualPort)
    return port


def cable(shop: Workshop) -> Callable[[], None]:
    """The cable of a servo comes off."""
    there = port_of(shop, "left")
    gone = [there.servos[-1]]
    there.rig.unplug(gone, there.now())
    return lambda: there.rig.plug(gone, shop.now)


def port(shop: Workshop) -> Callable[[], None]:
    """The adapter is pulled out."""
    there = port_of(shop, "left")
    there.inject("gone#1")
    return lambda: there.inject(None)


def restart(shop: Workshop) -> Callable[[], None]:
    """A servo loses its supply for a moment."""
    there = port_of(shop, "left")
    there.rig.unplug(there.servos, there.now())
    there.rig.plug(there.servos, there.now())
    return nothing


def swap(shop: Workshop) -> Callable[[], None]:
    """Somebody exchanges two servos, and puts them back afterwards."""
    there = port_of(shop, "left")

    def exchange() -> None:
        one, other, *_ = there.servos
        there.rig.unplug([one, other], shop.now)
        row = one.model.register("id")
        ids = one.memory.eeprom[row], other.memory.eeprom[row]
        one.memory.store(row, ids[1])
        other.memory.store(row, ids[0])
        there.rig.plug([one, other], shop.now)

    exchange()
    return exchange


def stall(shop: Workshop) -> Callable[[], None]:
    """Something holds the joints."""
    for servo in port_of(shop, "left").servos:
        servo.shaft.load = Load(blocked=True)
    return nothing


def kill(_: Workshop) -> Callable[[], None]:
    """The program is killed."""
    raise Killed


def terminal(_: Workshop) -> Callable[[], None]:
    """The terminal is closed, or Ctrl-C is pressed: the command line makes one of the other."""
    raise KeyboardInterrupt


FAULTS: list[Fault] = [cable, port, restart, swap, stall, kill, terminal]


def named(value: Any) -> str:
    return str(getattr(value, "__name__", value))


def at(shop: Workshop, request: int, fault: Fault) -> Callable[[], None]:
    """Let something go wrong at this request after the first that has changed a servo; gives what mends it."""
    numbers = count()
    mends: list[Callable[[], None]] = []
    untouched = shop.memories()

    def before(_: bytes) -> None:
        if shop.memories() != untouched and next(numbers) == request:
            shop.before = lambda _: None
            mends.append(nothing)
            mends[0] = fault(shop)

    shop.before = before

    def mend() -> None:
        assert mends, "it came too late to happen"
        mends[0]()

    return mend


def states(shop: Workshop) -> list[tuple[bool, float]]:
    return [(servo.torque, round(servo.shaft.position, 6)) for rig in shop.rigs.values() for servo in rig.servos]


@pytest.mark.parametrize("request_", [0, 7])
@pytest.mark.parametrize("fault", FAULTS, ids=named)
def test_apply(tmp_path: Path, fault: Fault, request_: int) -> None:
    shop = Workshop(tmp_path, JOINTS, {"left": "rx28@1-2", "right": "drs0602@219"})
    before, stood = shop.memories(), states(shop)
    with shop.open() as arm:
        plan = arm.plan_settings()
        mend = at(shop, request_, fault)
        with suppress(ServobusError, Killed, KeyboardInterrupt):
            arm.apply_settings(plan)
    mend()
    assert states(shop) == stood
    with shop.open() as arm:
        for bus in arm.buses.values():
            bus.transport.sleep(1.0)
        arm.apply_settings()
        assert {key: shop.get(*key) for key in HELD} == HELD
        assert arm.plan_settings().changes() == 0
        while Backups(arm.file).latest() is not None:
            arm.undo_settings()
    assert states(shop) == stood
    if fault is not swap:  # what one servo held was kept as what the other held
        assert shop.memories() == before


def adopt(shop: Workshop, arm: Robot) -> None:
    """Do what the command does."""
    bus, backups = arm.buses["left"], Backups(arm.file)
    if (left := adopting.left_over(arm.attendance, arm.joints, backups, None)) is not None:
        with backups.adopting("two", 0, left[1]):
            bus.do(adopting.finish(*left))
        return
    vacancy = adopting.vacant(arm.attendance, arm.joints, None)
    parts = [part for joint in arm for part in joint.parts if part.port == "left"]
    plan = bus.do(
        adopting.adoption(vacancy, bus.do(adopting.newcomer(bus, vacancy, parts, ids=range(10))), None, "nowhere")
    )
    kept = backups.keep_new("two", 0, plan.before)
    with backups.adopting("two", 0, plan.wanted):
        bus.do(adopting.carry_out(plan, "PORT", kept))


@pytest.mark.parametrize("request_", [0, 6])
@pytest.mark.parametrize("fault", FAULTS, ids=named)
def test_adopt(tmp_path: Path, fault: Fault, request_: int) -> None:
    """The new servo has id 9 and no setting of its joint."""
    shop = Workshop(tmp_path, JOINTS, {"left": "rx28@1,9", "right": "drs0602@219"})
    stood = states(shop)
    with shop.open() as arm:
        arm.check(strangers="near")
        mend = at(shop, request_, fault)
        with suppress(ServobusError, Killed, KeyboardInterrupt):
            adopt(shop, arm)
    mend()
    assert states(shop) == stood
    with shop.open() as arm:
        for bus in arm.buses.values():
            bus.transport.sleep(1.0)
        if not arm.check(strangers="near"):
            adopt(shop, arm)
        assert arm.check(strangers="near")
        arm.apply_settings()
        assert {key: shop.get(*key) for key in HELD} == HELD
    assert states(shop) == stood
