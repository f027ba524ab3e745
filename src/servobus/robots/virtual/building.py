"""The robot of a file on virtual servos: `servobus.robot("virtual:arm.toml")`.

Each port of the file becomes a rig of virtual servos, with the models, ids and speeds that the file names. They stand
at first where the robot rests: in its pose `rest`, or in the pose of the option `pose`; joints that this does not name
are at 0. Torque is off, and settings that the file wants its servos to keep are not written yet.

Joints with a load hang on each other over all ports, see servobus.virtual.device.mechanism, and two servos on one axis
turn together. What stands behind `?` is said of all ports, as in the name of a virtual port; `state=arm.json` becomes a
file for each port, such as `arm.left.json`.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any
from urllib.parse import parse_qsl

from servobus.core.values import frozen
from servobus.errors import UsageError
from servobus.robots.file.entries import JointEntry, LoadEntry, RobotFile, ServoEntry
from servobus.virtual.device.mechanism import Mechanism, Seat
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.physics.linkage import Link
from servobus.virtual.serve.inprocess import VirtualPort
from servobus.virtual.serve.rig import Rig, build_rig
from servobus.virtual.serve.spec import Group, Setup, has_option, setup_of

NO_LOAD = LoadEntry()


@frozen
class VirtualRobot:
    """The servos of a robot file, none of them real.

    rigs    port -> its servos, of the ports that have any
    servos  joint -> its servos, in the order of the file
    """

    rigs: Mapping[str, Rig]
    servos: Mapping[str, tuple[VirtualServo, ...]]

    def close(self) -> None:
        """Let others have the files that keep what the servos remember."""
        for rig in self.rigs.values():
            rig.close()


def virtual_ports(file: RobotFile) -> dict[str, VirtualPort]:
    """Make the ports of a robot file, of virtual servos in this process; those without servos are left out.

    Raises UsageError or BadValue for options that make no sense.
    """
    rigs = build_robot(file).rigs
    return {
        port: VirtualPort(f"virtual:{file.name}, port {port}", rig, real=rig.clock == "real")
        for port, rig in rigs.items()
    }


def build_robot(file: RobotFile, said: Mapping[str, Any] | None = None) -> VirtualRobot:
    """Make the servos of a robot file, at time 0, and hang them on each other.

    `said` is what surrounds them, as fields of `Setup`, beside the options of the file. Raises UsageError or BadValue.
    """
    name = f"virtual:{file.name}"
    if not file.joints:
        raise UsageError(f"{name}: the file names no joints; write [joint.NAME] with port, model and id")
    pairs = parse_qsl(file.virtual or "", keep_blank_values=True)
    angles = _start(file, [value for key, value in pairs if key == "pose"])
    places = [
        (joint.name, servo, _group(servo, angles[joint.name]))
        for joint in file.joints.values()
        for servo in joint.servos
    ]
    setup = setup_of([group for *_, group in places], [pair for pair in pairs if pair[0] != "pose"], name)
    setup = replace(setup, **(said or {}))
    rigs: dict[str, Rig] = {}
    servos: dict[str, dict[ServoEntry, VirtualServo]] = {joint: {} for joint in file.joints}
    with ExitStack() as stack:
        for port in file.ports:
            there = [place for place in places if place[1].port == port]
            if not there:
                continue
            families = list(dict.fromkeys(servo.model.family.name for _, servo, _ in there))
            there.sort(key=lambda place: families.index(place[1].model.family.name))  # as a rig has them, wire by wire
            rigs[port] = rig = build_rig(_of_port(setup, port, [group for *_, group in there]))
            stack.callback(rig.close)
            for (joint, entry, _), made in zip(there, rig.servos, strict=True):
                servos[joint][entry] = made
        stack.pop_all()
    robot = VirtualRobot(
        rigs, {joint.name: tuple(servos[joint.name][entry] for entry in joint.servos) for joint in file.joints.values()}
    )
    _hang(file, robot, in_turn=setup.clock == "virtual")
    return robot


def _start(file: RobotFile, poses: Sequence[str]) -> dict[str, float]:
    """Give the angles of all joints at first: those of a pose, else 0, and each within what its servos can have."""
    if len(poses) > 1:
        raise UsageError(f"virtual:{file.name} says pose twice; leave one out")
    if poses and poses[0] not in file.poses:
        known = ", ".join(file.poses) or "none"
        raise UsageError(f"virtual:{file.name}: {file.name} has no pose {poses[0]!r}; there are: {known}")
    name = poses[0] if poses else file.robot.rest
    pose = {} if name is None else file.poses[name]
    angles = {}
    for joint in file.joints.values():
        low, high = joint.range
        angles[joint.name] = min(max(pose.get(joint.name, 0.0), low), high)
    return angles


def _group(servo: ServoEntry, angle: float) -> Group:
    """Give a servo as the virtual servos have it, with its joint at an angle."""
    register = servo.model.optional("baud")
    options = {} if servo.baud is None or register is None else {"baud": str(register.encode(servo.baud))}
    return Group(servo.model, [servo.id], options, servo.axis.to_servo(angle))


def _of_port(setup: Setup, port: str, groups: list[Group]) -> Setup:
    """Give what is said of all servos for those of one port."""
    state = setup.state
    options = {
        name: word for name, word in setup.options.items() if any(has_option(group.model, name) for group in groups)
    }
    return replace(
        setup,
        servos=groups,
        options=options,
        state=None if state is None else state.with_name(f"{state.stem}.{port}{state.suffix}"),
    )


# Loads


def _hang(file: RobotFile, robot: VirtualRobot, *, in_turn: bool) -> None:
    """Hang joints on each other: those with a load and all that carry them, and two servos on one axis."""
    coupled = False
    for tree in _trees(file):
        if any(_load(joint).mass or joint.mirror for joint in tree):
            _mechanism(tree, robot, in_turn=in_turn)
            coupled = True
    if coupled:
        lock = next(iter(robot.rigs.values())).lock
        for rig in robot.rigs.values():
            rig.lock = lock


def _trees(file: RobotFile) -> list[list[JointEntry]]:
    """Give the joints that hang on each other, each behind the one that it sits on."""
    trees: dict[str, list[JointEntry]] = {}
    root: dict[str, str] = {}
    left = dict(file.joints)
    while left:
        for name, joint in list(left.items()):
            parent = _load(joint).parent
            if parent is None or parent in root:
                root[name] = name if parent is None else root[parent]
                trees.setdefault(root[name], []).append(left.pop(name))
    return list(trees.values())


def _mechanism(tree: Sequence[JointEntry], robot: VirtualRobot, *, in_turn: bool) -> None:
    numbers = {joint.name: number for number, joint in enumerate(tree)}
    links = []
    for joint in tree:
        load = _load(joint)
        parent = None if load.parent is None else numbers[load.parent]
        links.append(Link(mass=load.mass, length=load.length, down=load.down, sense=load.sense, parent=parent))
    seats = [
        [
            Seat(servo, entry.port, zero=entry.axis.zero, gear=entry.axis.change_to_servo(1.0))
            for servo, entry in zip(robot.servos[joint.name], joint.servos, strict=True)
        ]
        for joint in tree
    ]
    Mechanism(links, seats, in_turn=in_turn)


def _load(joint: JointEntry) -> LoadEntry:
    return joint.load or NO_LOAD
