"""The first text of a robot file, from servos that were found: commented, and to be edited by hand."""

from collections.abc import Sequence

from servobus.core.units import deg, show
from servobus.core.values import frozen
from servobus.families.model import Model
from servobus.robots.axis import Axis
from servobus.robots.file.entries import FORMAT
from servobus.robots.file.writing import quantity

HEAD = """\
# A robot file of servobus: which servos a robot has, and what its joints are called.
#
# Angles are those of the joints: joint = direction * (servo - zero) / ratio. `servobus robot calibrate` finds zero,
# direction and limits by moving the joints by hand; `servobus robot check` tells whether all servos are there.
"""


@frozen
class DraftJoint:
    """A servo that becomes a joint: its name, where it is, and the angle of the servo, rad, that is 0 of the joint."""

    name: str
    port: str
    model: type[Model]
    id: int
    baud: int
    zero: float


def middle(model: type[Model]) -> float:
    """Give the middle of the angles that a servo can be sent to, rad, to a tenth of a degree."""
    row = model.register("goal_position")
    low, high = (float(row.decode(raw)) for raw in row.limits)
    return round((low + high) / 2 / deg, 1) * deg


def draft(name: str, ports: dict[str, str], joints: Sequence[DraftJoint]) -> str:
    """Write the text of a robot file; `ports` are name -> path."""
    tables = [f"{HEAD}\n[robot]\nformat = {FORMAT}\nname = {_quoted(name)}\n"]
    tables += [f"[port.{port}]\npath = {_quoted(path)}\n" for port, path in ports.items()]
    tables += [_joint(joint) for joint in joints]
    if not joints:
        tables.append("# No servo was found. A joint is a table [joint.NAME] with port, model and id.\n")
    return "\n".join(tables)


def _joint(joint: DraftJoint) -> str:
    row = joint.model.register("goal_position")
    low, high = Axis(joint.zero).range_to_joint(*(row.decode(raw) for raw in row.limits))
    speed = [f"baud = {joint.baud}"] if joint.baud != joint.model.factory_baud else []
    lines = [
        f"[joint.{joint.name}]",
        f'port = "{joint.port}"',
        f'model = "{joint.model.key()}"',
        f"id = {joint.id}",
        *speed,
        f'zero = "{quantity(joint.zero, "rad")}"  # angle of the servo where the joint is at 0',
        "direction = 1  # -1 where the joint turns against its servo",
        f'# limits = ["{quantity(low, "rad")}", "{quantity(high, "rad")}"]  # without them all that the servo can',
        f'# speed = "90deg/s"  # the {joint.model.title} can {_speed(joint.model)}',
    ]
    return "\n".join(lines) + "\n"


def _speed(model: type[Model]) -> str:
    speed = model.sheet.speed
    return "what its data sheet does not say" if speed is None else show(speed, "rad/s")


def _quoted(text: str) -> str:
    """Write a TOML string."""
    plain = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in plain) + '"'
