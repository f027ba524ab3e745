"""A program is killed, or its terminal closed, in play, teach and teleop: nothing moves on, and nothing is lost.

Each is a program of its own, on a terminal, and the servos live on in the test.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from servobus import deg
from servobus.robots.file.reading import read_file
from servobus.robots.motions.motion import motion_of
from servobus.robots.motions.recording import read_recording
from unit.served import PATIENCE, Arm, wait_for

JOINT = """
[robot]
format = 1
[port.p]
path = "{port}"
[joint.a]
port = "p"
model = "rx28"
id = 1
zero = "150deg"
speed = "60deg/s"
limits = ["-100deg", "100deg"]
[motion.swing]
loop = true
steps = [
  {{ joints = {{ a = "-60deg" }}, time = "0s" }},
  {{ joints = {{ a = "60deg" }}, time = "2s" }},
  {{ joints = {{ a = "-60deg" }}, time = "4s" }},
]
"""
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such terminals")


@pytest.fixture
def arm() -> Iterator[Arm]:
    with Arm("rx28@1") as arm:
        yield arm


def robot_file(path: Path, arm: Arm) -> str:
    path.write_text(JOINT.format(port=arm.name))
    return str(path)


class Terminal:
    """A program on a terminal of its own."""

    def __init__(self, *command: str) -> None:
        self._master, slave = os.openpty()
        self.program = subprocess.Popen(
            [sys.executable, "-m", "servobus", *command],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
        )
        os.close(slave)

    def type(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def kill(self) -> None:
        """Kill it as the system does when memory runs out: no handler of it runs."""
        self.program.kill()
        self.program.wait(PATIENCE)

    def hang_up(self) -> None:
        """Close the terminal, and send what the system sends then to the program in its foreground."""
        os.close(self._master)
        self._master = -1
        self.program.send_signal(signal.SIGHUP)
        self.program.wait(PATIENCE)

    def close(self) -> None:
        self.program.kill()
        self.program.wait(PATIENCE)
        if self._master >= 0:
            os.close(self._master)


@contextmanager
def on_terminal(*command: str) -> Iterator[Terminal]:
    terminal = Terminal(*command)
    try:
        yield terminal
    finally:
        terminal.close()


def angle(arm: Arm) -> float:
    return arm.servos[0].shaft.position - 150 * deg


def stands(arm: Arm) -> None:
    """Make sure that the servo comes to rest within a moment, and that nobody tells it anything any more."""
    time.sleep(0.3)
    heard, before = len(arm.heard), angle(arm)
    time.sleep(0.3)
    assert angle(arm) == pytest.approx(before, abs=0.3 * deg)
    assert len(arm.heard) == heard


def holds(arm: Arm) -> bool:
    servo = arm.servos[0]
    return bool(servo.memory[servo.model.register("torque_enable")])


ENDS: list[Callable[[Terminal], None]] = [Terminal.kill, Terminal.hang_up]


@pytest.mark.parametrize("end", ENDS)
def test_play(arm: Arm, tmp_path: Path, end: Callable[[Terminal], None]) -> None:
    file, run = robot_file(tmp_path / "arm.toml", arm), tmp_path / "run.csv"
    with on_terminal("play", file, "swing", "--record", str(run)) as terminal:
        wait_for(lambda: abs(angle(arm)) > 10 * deg)
        end(terminal)
        stands(arm)
    assert holds(arm)
    assert len(read_recording(run)) > 5


@pytest.mark.parametrize("end", ENDS)
def test_teach(arm: Arm, tmp_path: Path, end: Callable[[Terminal], None]) -> None:
    file, raw = robot_file(tmp_path / "arm.toml", arm), tmp_path / "wave.raw.csv"
    with on_terminal("teach", file, "wave", "a") as terminal:
        wait_for(lambda: raw.exists() and raw.read_text().count("\n") > 10)
        count = raw.read_text().count("\n") - 1
        end(terminal)
        stands(arm)
    assert len(read_recording(raw)) >= count
    assert not holds(arm)
    if end is Terminal.hang_up:  # it had time to keep what was recorded
        assert len(motion_of(read_file(file), "wave").times) >= 2
    else:
        assert "wave" not in read_file(file).motions


@pytest.mark.parametrize("end", ENDS)
def test_teleop(arm: Arm, tmp_path: Path, end: Callable[[Terminal], None]) -> None:
    with Arm("rx28@1") as hand:
        leader, follower = robot_file(tmp_path / "leader.toml", hand), robot_file(tmp_path / "follower.toml", arm)
        with on_terminal("teleop", leader, follower, "--no-deadman") as terminal:
            wait_for(lambda: holds(arm))

            def led() -> bool:
                hand.servos[0].turn_shaft(hand.servos[0].shaft.position + 0.5 * deg)
                return abs(angle(arm)) > 15 * deg

            wait_for(led)
            end(terminal)
            hand.servos[0].turn_shaft(120 * deg)
            stands(arm)
        assert holds(arm)


def test_the_deadman_on_a_terminal(arm: Arm, tmp_path: Path) -> None:
    with Arm("rx28@1") as hand:
        leader, follower = robot_file(tmp_path / "leader.toml", hand), robot_file(tmp_path / "follower.toml", arm)
        hand.servos[0].turn_shaft(170 * deg)
        with on_terminal("teleop", leader, follower) as terminal:
            wait_for(lambda: holds(arm))
            time.sleep(0.3)
            assert abs(angle(arm)) < 1 * deg, "nobody holds the key yet"

            def led() -> bool:
                terminal.type(" ")
                time.sleep(0.03)
                return angle(arm) > 10 * deg

            wait_for(led)
            time.sleep(0.8)  # the key is let go
            before = angle(arm)
            time.sleep(0.3)
            assert angle(arm) == pytest.approx(before, abs=0.3 * deg)
            terminal.type("q")
            assert terminal.program.wait(PATIENCE) == 0
        assert holds(arm)
