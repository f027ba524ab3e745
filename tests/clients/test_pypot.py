"""pypot itself loads what `robot export` writes, and reads each motor as the robot file reads its joint.

It is not among what tests install, for it brings hundreds of megabytes: `pip install --no-deps pypot` and numpy do.
"""

import json
from typing import Any

import pytest

from servobus.core.units import deg
from servobus.robots.file.reading import read_text
from servobus.robots.formats import pypot as files
from servobus.robots.formats.base import Given
from servobus.robots.formats.draft import draft_text

pypot = pytest.importorskip("pypot.robot", reason="pypot is not installed")
conversion: Any = pytest.importorskip("pypot.dynamixel.conversion")

ARM = """\
[robot]
format = 1
[port.bus]
path = "/dev/ttyUSB0"
[joint.shoulder]
port = "bus"
model = "rx28"
id = 1
zero = "130deg"
direction = -1
limits = ["-65deg", "70deg"]
[joint.elbow]
port = "bus"
model = "mx28"
id = 2
zero = "200deg"
limits = ["-90deg", "45deg"]
[joint.wrist]
port = "bus"
model = "mx106"
id = 3
zero = "150deg"
direction = -1
limits = ["-20deg", "45deg"]
[group]
arm = ["shoulder", "elbow"]
"""


def test_pypot_reads_what_the_robot_file_reads() -> None:
    file = read_text(ARM)
    robot = pypot.from_config(json.loads(files.write(file).text), sync=False, use_dummy_io=True)
    assert [motor.name for motor in robot.arm] == ["shoulder", "elbow"]
    for name, joint in file.joints.items():
        motor = getattr(robot, name)
        row = joint.model.register("goal_position")
        for count in (100, 512, 1000):
            motor.__dict__["present_position"] = conversion.dxl_to_degree(count, motor.model)
            # pypot rounds to a hundredth of a degree, and takes 4095 parts of a turn for 4096
            assert motor.present_position == pytest.approx(joint.axis.to_joint(row.decode(count)) / deg, abs=0.06)
            motor.goal_position = 12.5
            assert conversion.degree_to_dxl(motor.__dict__["goal_position"], motor.model) == pytest.approx(
                row.encode(joint.axis.to_servo(12.5 * deg)), abs=1
            )
        low, high = sorted(motor.angle_limit)
        assert (low, high) == pytest.approx([end / deg for end in joint.range], abs=0.35)  # a count, rounded inwards


def test_what_pypot_reads_is_what_an_import_reads() -> None:
    """There and back through pypot's own objects: direction, zero and limits stay."""
    file = read_text(ARM)
    text = files.write(file).text
    back = read_text(draft_text(files.new(text.encode(), Given("robot.json")), "arm"))
    for name, joint in file.joints.items():
        assert back.joints[name].direction == joint.direction
        assert back.joints[name].zero == pytest.approx(joint.zero, abs=1e-5)
