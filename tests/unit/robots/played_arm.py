"""A virtual arm of six joints: three families on three ports, all mixed, and one joint with two servos.

It lives on the virtual clock, so its tests are quick and always the same.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import servobus
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_text
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort

ARM = """
[robot]
format = 1
name = "arm"
rest = "rest"

[port.left]
path = "virtual:rx28@1-4?clock=virtual"
[port.right]
path = "virtual:drs0602@1-2?clock=virtual"
[port.hand]
path = "virtual:lx16a@1?clock=virtual"

[joint.base]
port = "left"
model = "rx28"
id = 1
zero = "150deg"
limits = ["-120deg", "120deg"]
speed = "120deg/s"
acceleration = "500deg/s2"

[joint.shoulder]
port = "left"
model = "rx28"
id = 2
zero = "140deg"
direction = -1
limits = ["-90deg", "90deg"]
speed = "100deg/s"
acceleration = "400deg/s2"
jerk = "8000deg/s3"
[joint.shoulder.mirror]
id = 3
zero = "160deg"

[joint.elbow]
port = "right"
model = "drs0602"
id = 1
direction = -1
limits = ["-100deg", "100deg"]
speed = "150deg/s"
acceleration = "600deg/s2"

[joint.wrist]
port = "right"
model = "drs0602"
id = 2
zero = "10deg"
limits = ["-45deg", "60deg"]
acceleration = "600deg/s2"

[joint.roll]
port = "left"
model = "rx28"
id = 4
zero = "150deg"
ratio = 2.0
limits = ["-60deg", "60deg"]
speed = "90deg/s"
acceleration = "400deg/s2"

[joint.grip]
port = "hand"
model = "lx16a"
id = 1
zero = "120deg"
direction = -1
limits = ["-50deg", "80deg"]
speed = "120deg/s"
acceleration = "500deg/s2"

[group]
arm = ["base", "shoulder", "elbow"]

[pose.rest]
base = "0deg"
shoulder = "0deg"
elbow = "0deg"
wrist = "0deg"
roll = "0deg"
grip = "0deg"

[pose.up]
base = "30deg"
shoulder = "-40deg"
elbow = "50deg"
wrist = "20deg"
roll = "-30deg"
grip = "40deg"

[motion.wave]
steps = [
  { pose = "rest", time = "0s" },
  { pose = "up", time = "0.6s" },
  { joints = { wrist = "-5deg" }, time = "0.8s" },
  { pose = "rest", time = "1.4s" },
]

[motion.nod]
steps = [
  { joints = { base = "0deg", grip = "0deg" }, time = "0s" },
  { joints = { base = "20deg", grip = "20deg" }, time = "0.4s" },
  { joints = { base = "0deg", grip = "0deg" }, time = "0.8s" },
]
"""


@contextmanager
def opened(text: str = ARM) -> Iterator[Robot]:
    """Open the arm."""
    with servobus.robot(read_text(text)) as arm:
        yield arm


def port_of(arm: Robot, name: str) -> VirtualPort:
    """Give the virtual port of a port of the arm."""
    port = arm.buses[name].transport
    assert isinstance(port, VirtualPort)
    return port


def servos_of(arm: Robot, joint: str) -> list[VirtualServo]:
    """Give the virtual servos of a joint, up to date."""
    found = []
    for part in arm[joint].parts:
        there = port_of(arm, part.port).servos
        found.append(next(servo for servo in there if servo.id == part.servo.id and servo.model is part.servo.model))
    return found


def shaft_angles(arm: Robot, joint: str) -> list[float]:
    """Give the angle of the joint, rad, that the shaft of each of its servos really has."""
    return [
        part.axis.to_joint(servo.shaft.position)
        for part, servo in zip(arm[joint].parts, servos_of(arm, joint), strict=True)
    ]


def goals_in(arm: Robot, joint: str) -> list[float]:
    """Give the goal of the joint, rad, that each of its servos holds in its registers."""
    goals = []
    for part, servo in zip(arm[joint].parts, servos_of(arm, joint), strict=True):
        row = servo.model.register("goal_position")
        goals.append(part.axis.to_joint(row.decode(servo.memory[row])))
    return goals
