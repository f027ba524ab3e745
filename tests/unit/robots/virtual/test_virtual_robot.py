"""The robot of a file on virtual servos: who is there, where they stand, and what hangs on them."""

import asyncio
import math
from dataclasses import replace
from pathlib import Path

import pytest

import servobus
from servobus import deg
from servobus.errors import BadValue, RobotFileError, UsageError
from servobus.robots.blocking import Robot
from servobus.robots.file.entries import RobotFile
from servobus.robots.file.reading import read_file, read_text
from servobus.robots.virtual.building import build_robot, virtual_ports
from servobus.virtual.physics.motor import GRAVITY
from servobus.virtual.serve.inprocess import VirtualPort
from unit.robots.arms import JOINTS, SIX

M1, L1, M2, L2 = 0.3, 0.15, 0.2, 0.12

TWO = f"""
[robot]
format = 1
rest = "up"
[port.lower]
path = "/dev/ttyUSB0"
[port.upper]
path = "/dev/ttyUSB1"
[joint.shoulder]
port = "lower"
model = "rx28"
id = 1
zero = "140deg"
direction = -1
baud = 1000000
[joint.shoulder.load]
mass = "{M1}kg"
length = "{L1}m"
down = "-90deg"
[joint.elbow]
port = "upper"
model = "rx28"
id = 1
zero = "150deg"
ratio = 1.5
[joint.elbow.load]
mass = "{M2}kg"
length = "{L2}m"
down = "0deg"
parent = "shoulder"
[pose.up]
shoulder = "80deg"
elbow = "10deg"
[pose.out]
shoulder = "0deg"
"""


def two(options: str = "clock=virtual") -> RobotFile:
    return replace(read_text(TWO), virtual=options)


def let_pass(arm: Robot, seconds: float) -> None:
    for bus in arm.buses.values():
        bus.transport.sleep(seconds)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(TWO, encoding="utf-8")
    return path


def test_a_file_opens_with_virtual_servos_in_place_of_its_own(path: Path) -> None:
    with servobus.robot(f"virtual:{path}?clock=virtual&load=blocked") as arm:
        assert arm.positions() == pytest.approx({"shoulder": 80 * deg, "elbow": 10 * deg}, abs=0.5 * deg)
        lower = arm.buses["lower"].transport
        assert isinstance(lower, VirtualPort)
        assert [(servo.model, servo.id, servo.baud) for servo in lower.servos] == [(servobus.RX28, 1, 1_000_000)]
        assert not any(state.torque for state in arm.look().values())
        assert arm.file.path == path


def test_the_same_for_asyncio(path: Path) -> None:
    async def positions() -> dict[str, float]:
        async with servobus.robot_async(f"virtual:{path}?clock=virtual&load=blocked&pose=out") as arm:
            return dict(await arm.positions())

    assert asyncio.run(positions()) == pytest.approx({"shoulder": 0.0, "elbow": 0.0}, abs=0.5 * deg)


def test_three_families_on_three_ports_stand_where_the_robot_rests() -> None:
    with servobus.robot(replace(read_text(SIX), virtual="clock=virtual")) as arm:
        assert list(arm.buses) == ["base", "upper", "hand"]
        home = arm.file.poses["home"]
        assert arm.positions() == pytest.approx({name: home[name] for name in JOINTS}, abs=0.5 * deg)
        assert not arm.check().findings


def test_what_is_said_of_servos_reaches_those_that_have_it(tmp_path: Path) -> None:
    file = replace(read_text(SIX), virtual=f"clock=virtual&voltage=12&torque_memory=off&state={tmp_path / 'arm.json'}")
    with pytest.raises(UsageError, match="torque_memory"):
        build_robot(file)
    file = replace(file, virtual=f"clock=virtual&voltage=12&goal_torque=off&state={tmp_path / 'arm.json'}")
    robot = build_robot(file)
    assert {servo.voltage for rig in robot.rigs.values() for servo in rig.servos} == {12.0}
    assert robot.servos["base"][0].options["goal_torque"] is False
    assert sorted(one.name for one in tmp_path.iterdir()) == ["arm.base.json", "arm.hand.json", "arm.upper.json"]
    robot.close()


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(UsageError, match="has no pose 'down'; there are: up, out"):
        virtual_ports(two("pose=down"))
    with pytest.raises(BadValue, match="clock"):
        virtual_ports(two("clock=slow"))
    with pytest.raises(UsageError, match="names no joints"):
        virtual_ports(replace(read_text("[robot]\nformat = 1\n"), virtual=""))
    with pytest.raises(RobotFileError, match="no such file"):
        read_file("virtual:nowhere.toml?clock=virtual")
    with pytest.raises(RobotFileError, match="shoulder sits on elbow sits on shoulder"):
        read_text(TWO.replace('down = "-90deg"', 'down = "-90deg"\nparent = "elbow"'))


def torques(shoulder: float, elbow: float) -> tuple[float, float]:
    """Give what gravity does at the joints, N·m, from a drawing: 0 is level, up is positive, as is the elbow."""
    reach = L1 * math.cos(shoulder), L2 * math.cos(shoulder + elbow)
    outer = -M2 * GRAVITY * reach[1]
    return outer - (M1 + M2) * GRAVITY * reach[0], outer


@pytest.mark.parametrize(
    ("shoulder", "elbow"), [(0, 0), (0, 90), (45, -45), (90, 0), (-60, 30), (20, -80)], ids=lambda angle: f"{angle:g}"
)
def test_a_two_link_arm_sags_as_the_torques_at_its_joints_ask(shoulder: float, elbow: float) -> None:
    goals = {"shoulder": shoulder * deg, "elbow": elbow * deg}
    with servobus.robot(two("clock=virtual&motor=lossless")) as arm, arm.torque():
        arm.move(goals, time=1.5)  # who waits for its end is told that it does not quite get there
        let_pass(arm, 3.0)
        servos = [bus.transport.servos[0] for bus in arm.buses.values() if isinstance(bus.transport, VirtualPort)]
        held, reached = [0.0, 0.0], [0.0, 0.0]
        for _ in range(200):  # without friction they swing a little from one step of the sensor to the next
            let_pass(arm, 0.007)
            for n, (servo, joint) in enumerate(zip(servos, arm, strict=True)):
                held[n] += servo.shaft.current * servo.shaft.motor.constant / 200
                reached[n] += joint.parts[0].axis.to_joint(servo.position) / 200
    pulls = torques(*reached)
    for name, at, pull, hold, turns in zip(goals, reached, pulls, held, (-1.0, 1.5), strict=True):
        assert hold * turns == pytest.approx(-pull, abs=0.02), name
        # RX-28 manual 3-4-2: behind a margin of 1 the output grows from 32/1023 to all of it within 32 units of
        # 300/1023 degrees; 3.70 N·m at 16 V (1-3) are all of it.
        share = abs(pull / turns) / 3.70
        units = 0.0 if share < 32 / 1023 else 1 + 32 * (share - 32 / 1023) / (1 - 32 / 1023)
        sag = math.copysign(units * 300 / 1023 * deg / abs(turns), pull)
        assert at - goals[name] == pytest.approx(sag, abs=1.1 * 300 / 1023 * deg), name


def test_a_limp_arm_falls_and_hangs_down() -> None:
    with servobus.robot(two("clock=virtual&pose=out")) as arm:
        let_pass(arm, 10.0)
        angles = arm.positions()
    pulls = torques(angles["shoulder"], angles["elbow"])
    assert abs(pulls[0]) <= 0.05 + 0.01  # N·m: the friction of the RX-28's motor data, and a step of the reading
    assert abs(pulls[1]) <= 0.05 * 1.5 + 0.01  # through a gear of 1.5
    assert angles["shoulder"] == pytest.approx(-90 * deg, abs=8 * deg)


def test_on_the_real_clock_ports_share_one_lock_and_threads_do_not_stand_in_each_others_way() -> None:
    with servobus.robot(two("")) as arm:
        ports = [bus.transport for bus in arm.buses.values()]
        assert len({id(port.rig.lock) for port in ports if isinstance(port, VirtualPort)}) == 1
        with arm.torque():
            cycle = arm.cycle()
            for _ in range(10):
                assert not cycle.run(shoulder=75 * deg).lost


@pytest.mark.parametrize(
    ("model", "zero"), [("rx28", "150deg"), ("mx64", "180deg"), ("drs0602", "0deg"), ("lx16a", "120deg")]
)
def test_two_servos_on_one_axis_hold_a_load_together(model: str, zero: str) -> None:
    text = f"""
[robot]
format = 1
[port.one]
path = "/dev/ttyUSB0"
[port.two]
path = "/dev/ttyUSB1"
[joint.lift]
port = "one"
model = "{model}"
id = 1
zero = "{zero}"
mirror = {{ id = 1, port = "two", zero = "{zero}" }}
load = {{ mass = "0.5kg", length = "0.2m", down = "-90deg" }}
"""
    with servobus.robot(replace(read_text(text), virtual="clock=virtual")) as arm, arm.torque():
        arm.move(lift=0.0, time=0.5)
        let_pass(arm, 3.0)
        state = arm.look()["lift"]
        shafts = [bus.transport.servos[0].shaft for bus in arm.buses.values() if isinstance(bus.transport, VirtualPort)]
    assert state.position == pytest.approx(0.0, abs=2 * deg)
    assert state.disagreement < 1 * deg
    assert [shaft.velocity for shaft in shafts] == [0.0, 0.0]
    # The second one is turned round. 0.5 kg at 0.2 m are 0.98 N·m; what friction carries of it is not driven.
    held = shafts[0].current * shafts[0].motor.constant - shafts[1].current * shafts[1].motor.constant
    assert 0.3 < held < 1.8
