import math
import re
import tomllib
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from rich.console import Console

from servobus import deg
from servobus.cli.app import app
from servobus.cli.robots.calibrate import _table
from servobus.cli.robots.person import Script
from servobus.robots.blocking import Robot
from servobus.robots.calibration.flow import Calibration
from servobus.robots.file.entries import JointEntry
from servobus.robots.file.reading import read_file, read_text
from servobus.virtual.device.servo import VirtualServo
from unit.cli.conftest import Run
from unit.robots.arms import SIX

FILE = """\
# My arm.
[robot]
format = 1

[port.left]
path = "virtual:rx28@1,2?clock=virtual"

[joint.shoulder]
port = "left"
model = "rx28"
id = 1
zero = "10deg"  # guessed

[joint.elbow]
port = "left"
model = "rx28"
id = 2
"""
HAND = """\
# What a hand does to servo 1, and which keys it presses.
await SHOULDER: move this joint
turn left:1=170
await push it to
turn left:1=150deg
await push it back
turn left:1=170
await both ends
turn left:1=60 at 180deg/s
turn left:1=240 at 180
turn left:1=60 at 180
turn left:1=240 at 180
turn left:1=149
await press ENTER
wait 0.2
press enter
await Take
press y
"""


@pytest.fixture(autouse=True)
def arm(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("arm.toml").write_text(FILE)
    return Path("arm.toml")


@pytest.fixture
def servos(monkeypatch: pytest.MonkeyPatch) -> list[VirtualServo]:
    """Give the virtual servos of the robot that the command opens, once it has."""
    seen: list[VirtualServo] = []
    begin = Script.__init__

    def look(self: Script, arm: Robot, path: Path) -> None:
        seen.extend(arm.buses["left"].transport.servos)  # type: ignore[attr-defined] # it is a virtual one
        begin(self, arm, path)

    monkeypatch.setattr(Script, "__init__", look)
    return seen


def script(*lines: str) -> str:
    Path("hand.txt").write_text(HAND + "\n".join(lines) + "\n")
    return "hand.txt"


def test_one_joint_by_hand_and_back(run: Run, arm: Path, servos: list[VirtualServo]) -> None:
    lines = (
        "await write this to",
        "press y",
        "await test shoulder",
        "press y",
        "hold space 1",
        "wait 1",
        "press enter",
    )
    result = run("robot", "calibrate", "arm.toml", "shoulder", "--script", script(*lines))
    assert "  [joint.shoulder] zero: 10deg -> 150deg\n" in result.stdout
    assert "  [joint.shoulder] direction: not said -> -1\n" in result.stdout
    assert "  [joint.shoulder] limits: not said -> -87.8deg .. 87.8deg\n" in result.stdout
    text = arm.read_text()
    assert text.startswith("# My arm.\n")
    assert 'zero = "150deg"  # guessed' in text
    joint = read_file(arm).joints["shoulder"]
    assert (joint.direction, tomllib.loads(text)["joint"]["elbow"]) == (-1, tomllib.loads(FILE)["joint"]["elbow"])
    # It went towards positive angles, which is against the servo, for the second that the key was held, and no farther.
    assert 149 - 8 < servos[0].position * 57.2957795 < 149 - 3
    assert not servos[0].torque
    assert "shoulder is limp again" in result.stderr

    assert "brought back" in run("robot", "calibrate", "arm.toml", "--undo").stdout
    assert arm.read_text() == FILE


def test_a_dry_run_and_a_no_write_nothing(run: Run, arm: Path) -> None:
    result = run("robot", "calibrate", "arm.toml", "shoulder", "--dry-run", "--script", script())
    assert "zero: 10deg -> 150deg" in result.stdout
    assert "arm.toml is as it was: --dry-run writes nothing" in result.stderr
    result = run("robot", "calibrate", "arm.toml", "shoulder", "--script", script("press n"), code=1)
    assert result.stderr.endswith("servobus: nothing was written\n")
    assert arm.read_text() == FILE
    assert sorted(path.name for path in Path().iterdir()) == ["arm.toml", "hand.txt"]


def test_a_known_pose_and_a_margin(run: Run, arm: Path) -> None:
    run(
        "robot", "calibrate", "arm.toml", "shoulder", "--zero", "shoulder=90", "--margin", "5", "--yes", "--no-test",
        "--script", script(),
    )  # fmt: skip
    joint = read_file(arm).joints["shoulder"]
    assert joint.axis.to_joint(2.6179939) == pytest.approx(1.5707963, abs=1e-4)  # 150° of the servo is 90°


def test_an_angle_is_typed(run: Run, arm: Path) -> None:
    text = HAND.replace("press enter", "press a\nawait at which angle\ntype 30deg\nawait 30.0\npress enter")
    Path("hand.txt").write_text(text)
    run("robot", "calibrate", "arm.toml", "shoulder", "--yes", "--no-test", "--script", "hand.txt")
    assert read_file(arm).joints["shoulder"].axis.to_joint(2.6179939) == pytest.approx(0.5235988, abs=1e-4)


def test_the_offset_of_a_servo_is_kept_in_the_file(run: Run, arm: Path) -> None:
    text = FILE.replace("virtual:rx28@1,2?clock=virtual", "virtual:lx16a@1,2?clock=virtual&state=lx.json")
    arm.write_text(text.replace('"rx28"', '"lx16a"'))
    port = "virtual:lx16a@1,2?clock=virtual&state=lx.json"
    run("write", port, 1, "angle_offset=-12deg", "--save", "--model", "lx16a")
    Path("hand.txt").write_text(HAND.replace("=240", "=220"))
    run("robot", "calibrate", "arm.toml", "shoulder", "--yes", "--no-test", "--script", "hand.txt")
    # By its manual an LX-16A counts the offset in steps of 0.24°.
    assert read_file(arm).joints["shoulder"].registers == {"angle_offset": -50}
    assert "nothing to write" in run("robot", "plan", "arm.toml").stdout


def test_torque_goes_off_after_a_question(run: Run, arm: Path, servos: list[VirtualServo]) -> None:
    shown = script("press n")
    Path(shown).write_text("press n\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("servobus.cli.robots.calibrate._check_there", lambda arm, _: arm["shoulder"].torque_on())
        result = run("robot", "calibrate", "arm.toml", "shoulder", "--script", shown, code=1)
        assert "hold the arm: shoulder goes limp. Go on?" in result.stderr
        assert servos[0].torque
        servos.clear()
        Path(shown).write_text("press y\n" + HAND)
        run("robot", "calibrate", "arm.toml", "shoulder", "--dry-run", "--script", shown)
        assert not servos[0].torque


def test_of_a_pair_both_servos_go_limp(run: Run, arm: Path, servos: list[VirtualServo]) -> None:
    arm.write_text(FILE[: FILE.index("[joint.elbow]")] + "[joint.shoulder.mirror]\nid = 2\nzero = '300deg'\n")
    Path("hand.txt").write_text("press y\nwait 0.1\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "servobus.cli.robots.calibrate._check_there", lambda arm, _: arm["shoulder"].parts[1].servo.torque_on()
        )
        result = run("robot", "calibrate", "arm.toml", "shoulder", "--script", "hand.txt", code=1)
    assert "hold the arm: shoulder goes limp" in result.stderr
    assert not servos[1].torque


def test_a_pose_outside_of_the_new_limits_is_told_and_nothing_is_lost(run: Run, arm: Path) -> None:
    arm.write_text(FILE + '[pose.high]\nshoulder = "120deg"\n')
    before = arm.read_text()
    result = run("robot", "calibrate", "arm.toml", "shoulder", "--yes", "--script", script(), code=1)
    assert "limits: not said -> -87.8deg .. 87.8deg" in result.stdout
    assert "[pose.high.shoulder] 120.0° is outside the limits of the joint" in result.stderr
    assert "nothing was written: mend that in the file first, or write what is shown above by hand" in result.stderr
    assert arm.read_text() == before


def test_what_failed_is_told_and_the_others_are_written(run: Run, arm: Path) -> None:
    dead = (
        "await ELBOW: move", "turn left:2=250", "await push it to", "turn left:2=280", "await push it back",
        "turn left:2=250", "await both ends", "turn left:2=299.9", "await write this", "press y", "press n",
    )  # fmt: skip
    result = run("robot", "calibrate", "arm.toml", "--script", script(*dead), code=1)
    assert "servobus: not calibrated: elbow: the travel reaches into the dead zone of the RX-28" in result.stderr
    assert read_file(arm).joints["shoulder"].direction == -1


def broken_at(monkeypatch: pytest.MonkeyPatch, text: str, what: Callable[[Script], None]) -> None:
    """Have something happen when this prompt is shown."""
    key = Script.key

    def wrapped(self: Script, seconds: float) -> str:
        if text in self._prompt:
            what(self)
        return key(self, seconds)

    monkeypatch.setattr(Script, "key", wrapped)


def interrupt(_: Script) -> None:
    raise KeyboardInterrupt


def test_ctrl_c_leaves_the_file_as_it_was(run: Run, arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken_at(monkeypatch, "both ends", interrupt)
    result = run("robot", "calibrate", "arm.toml", "shoulder", "--script", script(), code=130)
    assert "arm.toml is as it was, and the servos hold what they held" in result.stderr
    assert arm.read_text() == FILE


def test_ctrl_c_in_a_test_move_stops_the_joint(
    run: Run, arm: Path, monkeypatch: pytest.MonkeyPatch, servos: list[VirtualServo]
) -> None:
    positions: list[float] = []

    def moving(_: Script) -> None:
        positions.append(servos[0].position)
        if len(positions) > 20:
            raise KeyboardInterrupt

    broken_at(monkeypatch, "hold SPACE", moving)
    lines = ("press y", "hold space 5")
    run("robot", "calibrate", "arm.toml", "shoulder", "--yes", "--script", script(*lines), code=130)
    assert positions[-1] < positions[0] - 0.01
    assert not servos[0].torque
    assert servos[0].position == pytest.approx(positions[-1], abs=0.02)
    assert read_file(arm).joints["shoulder"].direction == -1


def test_a_pulled_cable_ends_it_and_leaves_the_file(
    run: Run, arm: Path, monkeypatch: pytest.MonkeyPatch, servos: list[VirtualServo]
) -> None:
    def pull(self: Script) -> None:
        rig: Any = self._arm.buses["left"].transport
        rig.rig.unplug(servos[:1], rig.now())

    broken_at(monkeypatch, "both ends", pull)
    result = run("robot", "calibrate", "arm.toml", "shoulder", "--script", script(), code=1)
    assert "no reply" in result.stderr
    assert "arm.toml is as it was" in result.stderr
    assert arm.read_text() == FILE


def test_who_is_not_there_or_unknown_is_refused(run: Run, refused: Callable[..., str], arm: Path) -> None:
    assert "no joint 'nose'" in refused("robot", "calibrate", "arm.toml", "nose")
    assert "no joint 'elbow'" in refused("robot", "calibrate", "arm.toml", "shoulder", "--zero", "elbow=1")
    arm.write_text(FILE.replace("id = 2", "id = 7"))
    assert "elbow is missing" in refused("robot", "calibrate", "arm.toml", "elbow")
    assert "hand.txt: cannot be read" in refused("robot", "calibrate", "arm.toml", "shoulder", "--script", "hand.txt")


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("dance", "hand.txt:1: there is no dance here: await, turn, press, hold, type or wait"),
        ("turn right:1=20", "hand.txt:1: right:1: the robot has no virtual port right"),
        ("turn left:9=20", "hand.txt:1: left:9: there is no servo with this id on left"),
        ("turn left:1=far", "hand.txt:1: 'far' is not a number"),
        ("await Godot", "hand.txt:1: this prompt never came; the last was: SHOULDER: move this joint"),
        ("wait 0.1", "hand.txt: the script has ended, and there is still to do: SHOULDER: hold the arm still"),
    ],
)
def test_a_wrong_script_is_told_with_its_line(
    run: Run, arm: Path, monkeypatch: pytest.MonkeyPatch, line: str, told: str
) -> None:
    monkeypatch.setattr("servobus.cli.robots.person.PATIENCE", 1.0)
    Path("hand.txt").write_text(line + "\n")
    result = run("robot", "calibrate", "arm.toml", "shoulder", "--script", "hand.txt", code=1)
    assert told in result.stderr
    assert arm.read_text() == FILE


def test_without_a_terminal_nothing_happens(arm: Path) -> None:
    result = CliRunner().invoke(app, ["robot", "calibrate", "arm.toml", "shoulder"])
    assert result.exit_code == 1
    assert "nobody is there to press a key" in result.stderr
    assert arm.read_text() == FILE


def test_a_person_sees_a_table() -> None:
    flow = Calibration(read_file("arm.toml"), ["shoulder", "elbow"])
    console = Console(width=100, file=StringIO(), record=True)
    console.print(_table(flow))
    shown = console.export_text()
    assert "shoulder  find" in shown
    assert "elbow     waiting" in shown
    assert "SHOULDER: hold the arm still" in shown


def test_a_six_joint_arm_of_three_families_learns_what_it_was_made_as(run: Run, arm: Path) -> None:
    """The hand turns the shafts as the zeros, directions and ratios of the arm say; the file knows none of them."""
    true = read_text(SIX)
    text = re.sub(r"(?m)^(zero|direction|limits) = .*\n", "", SIX[: SIX.index("# Poses.")]).replace(
        'rest = "home"\n', ""
    )
    arm.write_text(text.replace("id = 3\n", 'id = 3\nzero = "300deg"\n'))
    lines = [line for joint in true.joints.values() for line in _hand_for(joint)]
    Path("hand.txt").write_text("\n".join(lines) + "\n")
    run("robot", "calibrate", "arm.toml", "--yes", "--no-test", "--margin", "0", "--script", "hand.txt")
    made = read_file(arm)
    for name, joint in made.joints.items():
        for servo, other in zip(joint.servos, true.joints[name].servos, strict=True):
            assert (servo.id, servo.axis.direction) == (other.id, other.axis.direction)
            # The sensor of an RX-28, the coarsest of the three, tells steps of 0.29°.
            assert servo.axis.zero == pytest.approx(other.axis.zero, abs=0.2 * deg)
        assert joint.limits == pytest.approx(_travel(true.joints[name]), abs=0.4 * deg)


def _travel(joint: JointEntry) -> tuple[float, float]:
    return joint.limits or (-60 * deg, 70 * deg)


def _hand_for(joint: JointEntry) -> list[str]:
    """Give what a hand does with a joint, all angles those of the joint, in rad."""

    def turn(angle: float) -> str:
        goals = (f"{servo.port}:{servo.id}={servo.axis.to_servo(angle) / deg:.4f}" for servo in joint.servos)
        return f"turn {' '.join(goals)} at 180"

    low, high = _travel(joint)
    middle, push, pose = (low + high) / 2, 16 * deg / joint.ratio, max(0.0, low + 5 * deg)
    lines = [turn(middle - push), f"await {joint.name.upper()}: move", turn(middle), "await push it to"]
    lines += [turn(middle + push), "await push it back", turn(middle - push), "await both ends"]
    lines += [turn(low), turn(high), turn(low), turn(high), turn(pose), "await press ENTER", "wait 0.2"]
    lines += [] if pose == 0 else ["press a", f"type {pose / deg:g}"]
    servo = joint.servos[0]
    row = servo.model.register("present_position")
    seen = row.decode(row.scale.encode(servo.axis.to_servo(pose))) - servo.axis.change_to_servo(pose)
    away = abs(math.remainder(seen, 15 * deg))  # a round zero is offered where one is near
    return [*lines, "press enter", *(["press n"] if 0.05 * deg < away <= 4 * deg else [])]
