"""Commands whose line goes half-way: the command that brings back what was there is printed."""

import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from servobus import RX28
from servobus.core.framing import Corrupt, Packet
from servobus.virtual.device.servo import Replies
from unit.cli.conftest import Run
from unit.served import Arm


@pytest.fixture
def arm() -> Iterator[Arm]:
    with Arm("rx28@1") as arm:
        arm.servos[0].memory.store(RX28.cw_angle_limit, 68)  # 19.9 degrees, by the scale of manual 3-4-2
        arm.servos[0].memory.store(RX28.ccw_angle_limit, 955)
        yield arm


def printed(text: str, port: str) -> list[list[str]]:
    """Give the commands in what was printed, without `servobus`."""
    found = []
    for line in text.splitlines():
        if f" {port} " in line and "servobus " in line:
            command = line.rpartition("servobus ")[2].partition(" brings")[0].rstrip("`")
            found.append(shlex.split(command))
    return found


def fail_after(arm: Arm, code: int, address: int) -> None:
    """Let the servo go silent for good once it has obeyed such a packet; `plug` brings it back."""
    servo = arm.servos[0]
    hear = servo.hear

    def heard(event: Packet | Corrupt, now: float) -> Replies:
        replies = hear(event, now)
        if isinstance(event, Packet) and event.code == code and event.data[:1] == bytes([address]):
            servo.deaf_until = float("inf")
            return []
        return replies

    servo.hear = heard  # type: ignore[method-assign]


def plug(arm: Arm) -> None:
    arm.servos[0].deaf_until = 0.0
    del arm.servos[0].hear


def test_N23_turn_prints_the_command_that_sets_the_limits_again(run: Run, arm: Arm) -> None:
    fail_after(arm, 3, 6)
    result = run("turn", arm.name, 1, "--output", 20, code=1)
    assert arm.servos[0].get("ccw_angle_limit") == 0
    assert "it gives up its angle limits, 19.9° to 280.1°, for that" in result.stderr
    plug(arm)
    command = printed(result.stderr, arm.name)[0]
    assert command == ["turn", arm.name, "1", "--end", "--limits", "19.9", "280.1"]
    run(*command)
    servo = arm.servos[0]
    assert (servo.get("cw_angle_limit"), servo.get("ccw_angle_limit")) == (68, 955)


def test_N23_set_id_prints_the_command_that_brings_the_id_back(run: Run, arm: Arm) -> None:
    fail_after(arm, 3, 3)
    result = run("set-id", arm.name, 1, 7, code=1)
    plug(arm)
    assert arm.servos[0].id == 7
    run(*printed(result.stderr, arm.name)[0])
    assert arm.servos[0].id == 1


def test_N23_set_baud_prints_the_command_that_brings_the_speed_back(run: Run, arm: Arm) -> None:
    fail_after(arm, 3, 4)
    result = run("set-baud", arm.name, 1, 500_000, code=1)
    plug(arm)
    command = printed(result.stderr, arm.name)[0]
    assert command == ["set-baud", arm.name, "1", "57600", "--baud", "500000"]
    run(*command)
    assert arm.servos[0].get("baud_rate") == 34


def test_N23_reset_names_the_file_and_the_commands(
    run: Run, arm: Arm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run("set-id", arm.name, 1, 9)
    servo = arm.servos[0]
    hear = servo.hear

    def heard(event: Packet | Corrupt, now: float) -> Replies:
        replies = hear(event, now)
        if isinstance(event, Packet) and event.code == 6:  # RESET
            servo.deaf_until = float("inf")
        return replies

    servo.hear = heard  # type: ignore[method-assign]
    result = run("reset", arm.name, 9, "--yes", code=1)
    assert "its settings before are in rx28-id9-" in result.stderr
    plug(arm)
    assert (servo.id, servo.get("cw_angle_limit")) == (1, 0)
    commands = printed(result.stderr, arm.name)
    assert [command[0] for command in commands] == ["restore", "set-id"]
    run(*commands[0], "--yes")
    run(*commands[1])
    assert (servo.id, servo.get("cw_angle_limit"), servo.get("ccw_angle_limit")) == (9, 68, 955)
