"""The plugin, in a pytest of its own as another project would run it."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

BUSES = """
import pytest
import servobus
from servobus import deg

def test_a_bus(virtual_bus):
    bus = virtual_bus("rx28@1-4")
    assert [servo.id for servo in bus.scan(ids=range(6), family="dynamixel")] == [1, 2, 3, 4]
    assert not bus.transport.blocking()
    with bus.torque():
        bus.move({1: 90 * deg}, time=2.0).wait()
    assert bus.transport.now() > 2

def test_two_buses_with_options(virtual_bus):
    quick, real = virtual_bus("lx16a@7", echo=True, voltage=6.5), virtual_bus("rx28@3", clock="real")
    assert quick.find(7).read(servobus.LX16A.present_voltage) == 6.5
    assert real.find(3).id == 3
    by_manual, limp = virtual_bus("rx28@3", reading="manual"), virtual_bus("rx28@3", goal_torque=False)
    assert [bus.transport.servos[0].options["goal_torque"] for bus in (quick, real, by_manual, limp)] == [
        True, True, False, False
    ]
    assert real.transport.blocking()

def test_faults(virtual_bus):
    bus = virtual_bus("rx28@1", faults="mute")
    with pytest.raises(servobus.BusError):
        bus.find(1, family="dynamixel")
    assert bus.transport.rig.fault_counts["mute"] >= 1
    bus.transport.inject(None)
    assert bus.find(1, family="dynamixel").id == 1

KEPT = []

def test_it_is_open(virtual_bus):
    KEPT.append(virtual_bus("rx28@1"))

def test_it_was_closed():
    with pytest.raises(servobus.PortError, match="closed"):
        KEPT[0].transport.write(b"")
"""

PORTS = """
import os
import threading

import pytest
import serial

PING = bytes.fromhex("FF FF 01 02 01 FB")
PONG = bytes.fromhex("FF FF 01 02 00 FC")

@pytest.mark.parametrize("tcp", [False, True])
def test_a_port(virtual_port, tcp):
    path = virtual_port("rx28@1", tcp=tcp, faults="drop@3#2")
    assert path.startswith("socket://") if tcp else os.path.realpath(path).startswith("/dev/")
    with serial.serial_for_url(path, 57600, timeout=5) as line:
        for reply in PONG, PONG[:3] + PONG[4:]:
            line.write(PING)
            assert line.read(len(reply)) == reply

@pytest.mark.parametrize("tcp", [False, True])
def test_M9_a_handle_to_what_is_behind(virtual_port, tcp):
    port = virtual_port("rx28@1-4", tcp=tcp)
    with serial.serial_for_url(port, 57600, timeout=5) as line:
        line.write(PING)
        assert line.read(6) == PONG
        port.servo(1).temperature = 90
        line.write(PING)
        assert line.read(6)[4] == 4     # overheating
        port.unplug(1)
        line.timeout = 0.1
        line.write(PING)
        assert line.read(6) == b""
        port.plug(1)
        port.inject("mute")
        line.write(PING)
        assert line.read(6) == b""
        assert port.fault_counts["mute"] == 1
        port.inject(None)
        line.write(PING)
        assert len(line.read(6)) == 6

def test_M13_no_virtual_clock(virtual_port):
    with pytest.raises(ValueError, match="wait by their own clocks"):
        virtual_port("rx28@1", clock="virtual")

def test_nothing_is_left_running():
    assert threading.active_count() == 1
"""

ROBOTS = """
import pytest
import servobus
from servobus import deg

ARM = '''
[robot]
format = 1
[port.left]
path = "/dev/ttyUSB0"
[port.right]
path = "/dev/ttyUSB1"
[joint.shoulder]
port = "left"
model = "rx28"
id = 1
zero = "150deg"
[joint.elbow]
port = "right"
model = "lx16a"
id = 1
zero = "120deg"
[pose.up]
shoulder = "30deg"
'''

@pytest.fixture
def file(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(ARM)
    return path

def test_a_robot(virtual_robot, file):
    arm = virtual_robot(file, pose="up", voltage=7)
    assert arm.positions()["shoulder"] == pytest.approx(30 * deg, abs=0.01)
    with arm.torque():
        arm.move(shoulder=0, elbow=20 * deg, time=1).wait()

def test_a_served_robot(served_robot, file):
    served = served_robot(file)
    with servobus.robot(served.path) as arm:
        served.servos["elbow"][0].turn(150 * deg)
        assert arm.positions()["elbow"] == pytest.approx(30 * deg, abs=0.01)
        served.ports["right"].unplug()
        assert list(arm.positions().lost) == ["elbow"]
"""

LAZY = """
import sys

def test_nothing_is_imported_that_was_not_asked_for():
    assert "servobus.pytest_plugin" in sys.modules
    assert not [name for name in sys.modules if name.startswith(("servobus.virtual", "servobus.cli"))]
"""


def run(folder: Path, tests: str, *plugin: str, path: Path | None = None) -> str:
    (folder / "test_theirs.py").write_text(tests, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT / "src"), str(path or "")]))}
    if plugin:
        environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-W", "error", *plugin, str(folder)]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=120, check=False, env=environment, cwd=folder
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("tests", "count"),
    [
        pytest.param(BUSES, 5, id="buses"),
        pytest.param(PORTS, 6, id="ports", marks=pytest.mark.skipif(os.name != "posix", reason="pseudo terminals")),
        pytest.param(ROBOTS, 2, id="robots", marks=pytest.mark.skipif(os.name != "posix", reason="pseudo terminals")),
        pytest.param(LAZY, 1, id="lazy"),
    ],
)
def test_fixtures(tmp_path: Path, tests: str, count: int) -> None:
    assert f"{count} passed" in run(tmp_path, tests, "-p", "servobus.pytest_plugin")


def test_pytest_finds_it(tmp_path: Path) -> None:
    """With the entry point of pyproject.toml, as an installation puts it there."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    ((name, module),) = project["entry-points"]["pytest11"].items()
    installed = tmp_path / "site" / "theirs-1.0.dist-info"
    installed.mkdir(parents=True)
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n", encoding="utf-8")
    (installed / "entry_points.txt").write_text(f"[pytest11]\n{name} = {module}\n", encoding="utf-8")
    (tmp_path / "tests").mkdir()
    assert "1 passed" in run(tmp_path / "tests", LAZY, path=installed.parent)
