"""The arm of the tests: six joints of three families on three ports, on the virtual clock.

Directions, zeros and ratios are mixed, and one joint has two servos, of which one is turned round. What its virtual
servos really do is told by the functions here.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import servobus
from servobus.robots.blocking import Robot
from servobus.robots.file.reading import read_text
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort

SIX = """\
# The arm of the tests.

[robot]
format = 1
name = "six"
rest = "home"

# Where the servos are.
[port.base]
path = "virtual:rx28@1-3?clock=virtual"  # the USB adapter at the back

[port.upper]
path = "virtual:drs0602@1-2?clock=virtual"

[port.hand]
path = "virtual:lx16a@1-2?clock=virtual"

# The base turns the whole arm.
[joint.base]
port = "base"
model = "rx28"
id = 1
zero = "150deg"
limits = ["-120deg", "120deg"]
speed = "120deg/s"
# acceleration = "400deg/s2"

# Two servos lift it, one of them turned round.
[joint.lift]
port = "base"
model = "rx28"
id = 2
zero = "120deg"
direction = -1
limits = ["-60deg", "80deg"]
speed = "90deg/s"

[joint.lift.mirror]
id = 3
zero = "170deg"
disagreement = "4deg"

[joint.elbow]
port = "upper"
model = "drs0602"
id = 1
zero = "-20deg"
direction = -1
ratio = 2.0
limits = ["-100deg", "100deg"]
safe_action = "hold"

[joint.turn]
port = "upper"
model = "drs0602"
id = 2
zero = "35deg"
ratio = 1.5

[joint.wrist]
port = "hand"
model = "lx16a"
id = 1
zero = "110deg"
direction = -1
limits = ["-70deg", "100deg"]

[joint.grip]
port = "hand"
model = "lx16a"
id = 2
zero = "60deg"
ratio = 2.5
limits = ["0deg", "70deg"]

[group]
arm = ["base", "lift", "elbow", "turn"]
hand = ["wrist", "grip"]

# Poses.

[pose.home]
base = "0deg"
lift = "10deg"
elbow = "20deg"
turn = "0deg"
wrist = "0deg"
grip = "5deg"  # nearly closed

[pose.open]
grip = "60deg"

[motion.wave]
steps = [
  { pose = "home", time = "0s" },
  { joints = { wrist = "20deg" }, time = "1s" },
]
"""

JOINTS = ("base", "lift", "elbow", "turn", "wrist", "grip")

LIVE = (
    SIX.replace(
        'zero = "120deg"\ndirection = -1\nlimits = ["-60deg"', 'zero = "130deg"\ndirection = -1\nlimits = ["-60deg"'
    )
    .replace('limits = ["-100deg", "100deg"]', 'limits = ["-65deg", "65deg"]\nacceleration = "600deg/s2"')
    .replace("ratio = 1.5\n", 'ratio = 1.5\nlimits = ["-120deg", "80deg"]\nacceleration = "600deg/s2"\n')
    .replace('speed = "90deg/s"\n', 'speed = "90deg/s"\nacceleration = "400deg/s2"\njerk = "8000deg/s3"\n')
    + """
[pose.up]
base = "30deg"
lift = "-30deg"
elbow = "50deg"
turn = "20deg"
wrist = "-20deg"
grip = "40deg"

[motion.bow]
steps = [
  { pose = "home", time = "0s" },
  { pose = "up", time = "0.6s" },
  { joints = { wrist = "20deg" }, time = "0.8s" },
  { pose = "home", time = "1.4s" },
]

[motion.nod]
steps = [
  { joints = { base = "0deg", grip = "5deg" }, time = "0s" },
  { joints = { base = "20deg", grip = "25deg" }, time = "0.4s" },
  { joints = { base = "0deg", grip = "5deg" }, time = "0.8s" },
]
"""
)
"""The same for servos as they come, with motions: both servos of the pair agree where they stand, and no limit is
beyond those that a DRS-0602 has from the factory."""


@contextmanager
def opened(text: str = LIVE) -> Iterator[Robot]:
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
