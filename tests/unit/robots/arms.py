"""Robot files for tests: a six-joint arm of three families on three ports, on the virtual clock.

Directions, zeros and ratios are mixed, and one joint has two servos, of which one is turned round.
"""

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
    .replace('limits = ["-100deg", "100deg"]', 'limits = ["-65deg", "65deg"]')
    .replace("ratio = 1.5\n", 'ratio = 1.5\nlimits = ["-120deg", "80deg"]\n')
)
"""The same for servos as they come: both servos of the pair agree where they stand, and no limit is beyond those that
a DRS-0602 has from the factory."""
