"""A virtual robot behind ports: other programs open it by a robot file that names them."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import servobus
from servobus import deg
from servobus.errors import PortError
from servobus.robots.file.reading import read_file, read_text
from servobus.robots.virtual.serving import serve_robot
from unit.robots.virtual.test_virtual_robot import TWO

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo terminals")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(TWO, encoding="utf-8")
    return path


@pytest.mark.parametrize("tcp", [None, ("127.0.0.1", 0)])
def test_another_program_opens_what_is_served(path: Path, tmp_path: Path, tcp: tuple[str, int] | None) -> None:
    folder = tmp_path / "ports"
    with serve_robot(read_file(f"virtual:{path}?pose=out&load=blocked"), folder=folder, tcp=tcp) as served:
        assert served.path == folder / "arm.toml"
        assert served.servos["shoulder"][0].angle == pytest.approx(140 * deg)
        with servobus.robot(served.path) as arm:
            assert arm.positions()["shoulder"] == pytest.approx(0.0, abs=2 * deg)
        assert list(read_file(served.path).joints) == ["shoulder", "elbow"]
        assert [port.path for port in read_file(served.path).ports.values()] == list(served.ports.values())
        assert all(port.served for port in served.ports.values())
    assert not served.path.exists()
    assert not any(port.served for port in served.ports.values())


def test_a_file_of_somebody_else_is_not_replaced(path: Path) -> None:
    before = path.read_text(encoding="utf-8")
    with (
        pytest.raises(PortError, match="is there already, and would be replaced"),
        serve_robot(read_file(path), folder=path.parent),
    ):
        pass
    assert path.read_text(encoding="utf-8") == before


def test_two_at_the_same_place_is_one_too_many(path: Path, tmp_path: Path) -> None:
    folder = tmp_path / "ports"
    with serve_robot(read_file(path), folder=folder) as served:
        with pytest.raises(PortError, match="served"), serve_robot(read_file(path), folder=folder):
            pass
        assert served.path.exists()


def test_the_command_serves_a_robot_file_and_takes_lines(path: Path, tmp_path: Path) -> None:
    folder = tmp_path / "ports"
    command = [sys.executable, "-m", "servobus", "virtual", str(path), "--pty", str(folder)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            assert [process.stdout.readline() for _ in range(2)] == [
                f"ready lower {folder / 'lower'}\n",
                f"ready upper {folder / 'upper'}\n",
            ]
            process.stdin.write("turn shoulder 30\nblock shoulder\nblock foot\n")
            process.stdin.flush()
            said = sorted(process.stderr.readline() for _ in range(3))
            with servobus.robot(folder / "arm.toml") as arm:
                assert arm.positions()["shoulder"] == pytest.approx(30 * deg, abs=0.5 * deg)
        finally:
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=10)
    assert process.returncode == 0
    assert said == [
        "block foot: there is no joint foot; there are shoulder, elbow\n",
        "lower: RX-28 id 1: load blocked\n",
        "lower: shoulder: at 30.0°\n",
    ]
    assert not (folder / "arm.toml").exists()


def test_a_file_without_a_name_can_be_served() -> None:
    with serve_robot(replace(read_text(TWO), virtual="load=blocked")) as served, servobus.robot(served.path) as arm:
        assert [joint.name for joint in arm] == ["shoulder", "elbow"]
