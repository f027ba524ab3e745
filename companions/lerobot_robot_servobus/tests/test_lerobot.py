"""The robot and its leader under LeRobot, on virtual servos. Angles are those of the arm in conftest.py."""

import io
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import draccus
import pytest
from lerobot.motors import MotorCalibration
from lerobot.robots import RobotConfig, make_robot_from_config
from lerobot.teleoperators import TeleoperatorConfig, make_teleoperator_from_config
from lerobot.utils.errors import DeviceNotConnectedError
from lerobot.utils.import_utils import register_third_party_plugins
from lerobot_robot_servobus import ServobusLeader, ServobusLeaderConfig, ServobusRobot, ServobusRobotConfig

import servobus
from servobus import deg
from servobus.robots.blocking import Robot as Arm
from servobus.robots.file.reading import read_file, read_text
from servobus.robots.formats import lerobot as calibrations
from servobus.robots.formats.base import ALL, Given

KEYS = ["shoulder.pos", "lift.pos", "grip.pos"]
Make = Callable[..., ServobusRobot]


@dataclass
class Program:
    """The settings of a program of LeRobot."""

    robot: RobotConfig
    teleop: TeleoperatorConfig


@pytest.fixture
def make(arm: Path, tmp_path: Path) -> Iterator[Make]:
    """Make robots; those that are connected at the end are disconnected."""
    made: list[ServobusRobot] = []

    def robot(**config: object) -> ServobusRobot:
        made.append(ServobusRobot(ServobusRobotConfig(file=str(arm), id="a", calibration_dir=tmp_path, **config)))
        return made[-1]

    yield robot
    for one in made:
        if one.is_connected:
            one.disconnect()


def wait(robot: ServobusRobot, seconds: float) -> None:
    """Let time pass between two actions."""
    for bus in robot._arm.buses.values():
        bus.transport.sleep(seconds)


def lead(robot: ServobusRobot, action: dict[str, float], turns: int, period: float = 1 / 30) -> list[dict[str, float]]:
    """Send an action again and again, as LeRobot does at its rate; give what was really sent each time."""
    sent = []
    for _ in range(turns):
        sent.append(robot.send_action(action))
        wait(robot, period)
    return sent


def torque(robot: ServobusRobot) -> list[bool]:
    return [state.torque for state in robot._arm.look().values()]


def test_lerobot_finds_both_by_their_distribution() -> None:
    register_third_party_plugins()
    assert RobotConfig.get_choice_class("servobus") is ServobusRobotConfig
    assert TeleoperatorConfig.get_choice_class("servobus_leader") is ServobusLeaderConfig


def test_lerobot_makes_both_from_its_command_line(arm: Path, tmp_path: Path) -> None:
    words = ["--robot.type=servobus", f"--robot.file={arm}", "--robot.percent=[grip]", "--robot.id=a"]
    words += ["--teleop.type=servobus_leader", f"--teleop.file={arm}", "--teleop.id=a"]
    words += [f"--{device}.calibration_dir={tmp_path}" for device in ("robot", "teleop")]
    program = draccus.parse(Program, args=words)
    robot = make_robot_from_config(program.robot)
    assert isinstance(robot, ServobusRobot)
    assert robot.config.percent == ["grip"]
    assert isinstance(make_teleoperator_from_config(program.teleop), ServobusLeader)


def test_features_are_known_unconnected(make: Make) -> None:
    robot = make()
    assert list(robot.observation_features) == list(robot.action_features) == KEYS
    assert set(robot.action_features.values()) == {float}
    assert robot.is_calibrated
    with pytest.raises(DeviceNotConnectedError):
        robot.get_observation()


def test_connecting_moves_nothing_and_asks_nothing(make: Make) -> None:
    robot = make()
    robot.connect()
    before = robot.get_observation()
    wait(robot, 1.0)
    assert robot.get_observation() == before
    assert torque(robot) == [False] * 3
    assert list(before) == KEYS


def test_actions_arrive_within_limits_and_say_what_was_sent(make: Make) -> None:
    robot = make()
    robot.connect()
    sent = lead(robot, {"shoulder.pos": 30.0, "lift.pos": 500.0, "grip.pos": 10.0}, 120)
    assert sent[-1] == pytest.approx({"shoulder.pos": 30.0, "lift.pos": 60.0, "grip.pos": 10.0})
    assert robot.get_observation() == pytest.approx(sent[-1], abs=1.5)
    assert all(torque(robot))


def test_the_way_keeps_the_greatest_speed(make: Make) -> None:
    robot = make()
    robot.connect()
    robot.send_action({})  # torque on, where it stands
    last = robot.get_observation()["shoulder.pos"], robot._arm.ports.now()
    wait(robot, 1 / 30)
    speeds = []
    for _ in range(60):
        now = robot._arm.ports.now()
        sent = robot.send_action({"shoulder.pos": 80.0})["shoulder.pos"]
        speeds.append((sent - last[0]) / (now - last[1]))
        last = sent, now
        wait(robot, 1 / 30)
    assert 95 < max(speeds[1:]) < 100.1
    assert last[0] == pytest.approx(80.0)


def test_only_the_joints_of_an_action_are_sent(make: Make) -> None:
    robot = make()
    robot.connect()
    before = robot.get_observation()
    assert list(robot.send_action({"grip.pos": 20.0, "camera": 1})) == ["grip.pos"]
    lead(robot, {"grip.pos": 20.0}, 60)
    after = robot.get_observation()
    assert after["shoulder.pos"] == pytest.approx(before["shoulder.pos"], abs=0.5)
    assert after["grip.pos"] == pytest.approx(20.0, abs=1.0)


def test_a_gripper_may_count_percent(make: Make) -> None:
    robot = make(percent=["grip"])
    robot.connect()
    lead(robot, {"grip.pos": 25.0}, 60)
    assert robot.get_observation()["grip.pos"] == pytest.approx(25.0, abs=1.0)
    assert robot._arm.grip.position() == pytest.approx(20 * deg, abs=0.5 * deg)  # 25 % of 0 .. 80°
    with pytest.raises(servobus.UnknownName, match="gripper"):
        make(percent=["gripper"])


@pytest.mark.parametrize(
    ("action", "error"),
    [({"elbow.pos": 1.0}, servobus.UnknownName), ({"grip.pos": float("nan")}, servobus.BadValue)],
)
def test_a_wrong_action_sends_nothing(make: Make, action: dict[str, float], error: type[Exception]) -> None:
    robot = make()
    robot.connect()
    with pytest.raises(error):
        robot.send_action(action)
    assert torque(robot) == [False] * 3


def test_a_joint_that_falls_silent_stops_all(make: Make) -> None:
    robot = make()
    robot.connect()
    lead(robot, {"shoulder.pos": 80.0}, 5)
    robot._arm.buses["right"].transport.inject("mute#1-100000")
    with pytest.raises(servobus.NoReply, match="grip does not answer any more"):
        lead(robot, {"shoulder.pos": 80.0}, 60)
    here = robot._arm.shoulder.position()
    wait(robot, 0.5)
    assert robot._arm.shoulder.position() == pytest.approx(here, abs=2 * deg)
    with pytest.raises(servobus.StopFailed, match="grip may still move"):
        robot.disconnect()
    assert not robot.is_connected


def test_disconnecting_holds_unless_it_shall_let_go(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    left = at_close(monkeypatch)
    robot = make()
    robot.connect()
    lead(robot, {"shoulder.pos": 20.0}, 60)
    robot.disconnect()
    assert left["angles"]["shoulder"] == pytest.approx(20 * deg, abs=1.5 * deg)
    assert left["torque"] == [True] * 3
    assert not robot.is_connected
    with pytest.raises(DeviceNotConnectedError):
        robot.send_action({"grip.pos": 1.0})


def test_releasing_goes_to_rest_first(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    left = at_close(monkeypatch)
    robot = make(release=True)
    robot.connect()
    lead(robot, {"shoulder.pos": 20.0}, 30)
    robot.disconnect()
    assert left["angles"] == pytest.approx({"shoulder": 0, "lift": 0, "grip": 40 * deg}, abs=1.5 * deg)
    assert left["torque"] == [False] * 3


def at_close(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """See how robots are when they are closed."""
    left: dict[str, Any] = {}
    close = Arm.close

    def look_and_close(arm: Arm) -> None:
        left.update(angles=dict(arm.positions()), torque=[state.torque for state in arm.look().values()])
        close(arm)

    monkeypatch.setattr(Arm, "close", look_and_close)
    return left


def test_what_never_was_driven_is_left_as_it_is(make: Make) -> None:
    robot = make(release=True)
    robot.connect()
    robot.disconnect()
    assert not robot.is_connected


# The leader


def leader(arm: Path, tmp_path: Path) -> ServobusLeader:
    return ServobusLeader(ServobusLeaderConfig(file=str(arm), id="a", calibration_dir=tmp_path, percent=["grip"]))


def test_a_leader_is_read(arm: Path, tmp_path: Path) -> None:
    hand = leader(arm, tmp_path)
    assert list(hand.action_features) == KEYS
    assert hand.feedback_features == {}
    hand.connect()
    seen = hand.get_action()
    assert list(seen) == KEYS
    angles = hand._arm.positions()
    assert seen["shoulder.pos"] == pytest.approx(angles["shoulder"] / deg)
    assert seen["grip.pos"] == pytest.approx(angles["grip"] / (80 * deg) * 100)
    hand.send_feedback({})
    with pytest.raises(servobus.UsageError):
        hand.send_feedback({"grip.pos": 1.0})
    hand.disconnect()
    with pytest.raises(DeviceNotConnectedError):
        hand.get_action()


def test_a_leader_with_torque_is_refused(arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hand = leader(arm, tmp_path)
    opened = servobus.robot(read_file(arm))
    opened.grip.torque_on()
    monkeypatch.setattr("servobus.robot", lambda _: opened)
    with pytest.raises(servobus.MotionError, match="grip: the torque of the leader is on"):
        hand.connect()
    assert not hand.is_connected


def test_a_leader_leads_a_robot(make: Make, arm: Path, tmp_path: Path) -> None:
    robot, hand = make(percent=["grip"]), leader(arm, tmp_path)
    robot.connect()
    hand.connect()
    lead(robot, hand.get_action(), 90)
    assert robot.get_observation() == pytest.approx(hand.get_action(), abs=2.0)
    hand.disconnect()


# Its calibration files


def test_lerobot_reads_what_is_written_and_writes_the_same_bytes(arm: Path, tmp_path: Path) -> None:
    text = calibrations.write(read_file(arm)).text
    path = tmp_path / "a.json"
    path.write_text(text)
    robot = ServobusRobot(ServobusRobotConfig(file=str(arm), id="a", calibration_dir=tmp_path))
    assert robot.calibration["shoulder"] == MotorCalibration(1, 1, 0, 205, 818)
    robot._save_calibration()
    assert path.read_text() == text


def test_what_lerobot_writes_is_read(arm: Path) -> None:
    out = io.StringIO()
    with draccus.config_type("json"):
        draccus.dump({"shoulder": MotorCalibration(1, 0, 12, 100, 900)}, out, indent=4)
    said = out.getvalue()
    assert json.loads(said)["shoulder"]["range_max"] == 900
    draft = calibrations.new(said.encode(), Given("a.json", models={ALL: "rx28"}))
    assert draft.joints["shoulder"]["id"] == 1
    changes = calibrations.onto(said.encode(), read_text(arm.read_text()), Given("a.json"))
    assert changes.changes["joint", "shoulder", "direction"] == 1
