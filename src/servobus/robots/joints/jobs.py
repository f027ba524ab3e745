"""Jobs on joints over several ports: read, look, torque, stop. Each is carried out on all ports side by side."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from servobus.bus import several
from servobus.bus.by_servo import Readings
from servobus.bus.servo import Servo
from servobus.core.exchange import Procedure, SetBaud
from servobus.core.units import show
from servobus.core.values import frozen
from servobus.errors import BusError, Disagreement, MotionError, ServobusError, StopFailed
from servobus.families.base import StopOutcome, TorqueState
from servobus.jobs.look import Snapshot
from servobus.jobs.look import look as look_at
from servobus.jobs.make_safe import let_go, stop_all
from servobus.jobs.torque import torque_on as switch_on
from servobus.robots.axis import Axis
from servobus.robots.joints.joint import Joint, Part, check_meant
from servobus.robots.steps import RobotJob, each, together
from servobus.robots.values import ByJoint

T = TypeVar("T")

ANGLES = ("present_position", "goal_position")
RATES = ("present_speed",)
LOADS = ("present_load",)


def to_joint(axis: Axis, name: str, value: Any) -> Any:
    """Turn what a register of a servo holds into the same of the joint: an angle, a speed or a load; else it stays."""
    if name in ANGLES:
        return axis.to_joint(value)
    if name in RATES:
        return axis.change_to_joint(value)
    if name in LOADS:
        return axis.load_to_joint(value)
    return value


@frozen
class JointState:
    """What one wants to see of a joint first."""

    position: float
    """Angle, rad."""
    voltage: float
    """V; of two servos the lower."""
    temperature: float
    """°C; of two servos the higher."""
    torque: bool
    """Whether it is driven; of two servos both."""
    shutdown: str = ""
    """What keeps the torque of a servo off until it is rearmed; "" if nothing does."""
    disagreement: float = 0.0
    """Angle of the joint by which its two servos disagree, rad."""
    half: bool = False
    """Whether one of its two servos has torque, and the other has none: it is not driven as it should be, nor limp."""

    @property
    def limp(self) -> bool:
        """Whether no servo of it has torque, so that a hand can move it."""
        return not self.torque and not self.half

    def __str__(self) -> str:
        torque = str(TorqueState(self.torque, self.shutdown))
        if self.half:
            torque = f"torque on of one servo alone{f' ({self.shutdown})' if self.shutdown else ''}"
        return f"{show(self.position, 'rad')}, {show(self.voltage, 'V')}, {show(self.temperature, 'degC')}, {torque}"


def on_each_port(joints: Iterable[Joint], job: Callable[[list[Part]], T]) -> dict[str, T]:
    """Make a job, or whatever else, for each port, of the servos of these joints that are on it."""
    parts: dict[str, list[Part]] = {}
    for joint in joints:
        for part in joint.parts:
            parts.setdefault(part.port, []).append(part)
    return {port: job(there) for port, there in parts.items()}


def one(joint: Joint, job: RobotJob[ByJoint[T]]) -> RobotJob[T]:
    """Give the value of one joint. Raises what came instead of it."""
    return (yield from job)[joint.name]


def read(joints: Sequence[Joint], name: str) -> RobotJob[ByJoint[Any]]:
    """Read a register of the servos of these joints. Gives name -> value, and those that are `lost`.

    Raises Disagreement where two servos on one axis stand too far apart.
    """
    for joint in joints:
        joint.servo.model.register(name)  # a name that is none is told before anything is sent
    meant = [joint for joint in joints if not joint.mistaken]
    outcomes = yield from each(on_each_port(meant, lambda parts: several.read([part.servo for part in parts], name)))
    seen, lost = _sorted(joints, outcomes)
    return ByJoint(
        {
            joint.name: joined(joint, name, [seen[part.servo] for part in joint.parts])
            for joint in joints
            if joint.name not in lost
        },
        lost,
    )


def _sorted(joints: Iterable[Joint], outcomes: Mapping[str, Any]) -> tuple[dict[Servo, Any], dict[str, ServobusError]]:
    """Give servo -> value, and joint -> the error of one of its servos."""
    seen: dict[Servo, Any] = {}
    lost: dict[str, ServobusError] = {}
    for joint in joints:
        if joint.mistaken:
            lost[joint.name] = joint.mismatch()
            continue
        for part in joint.parts:
            outcome = outcomes[part.port]
            if isinstance(outcome, ServobusError):
                lost.setdefault(joint.name, outcome)
            elif part.servo in outcome.lost:
                lost.setdefault(joint.name, outcome.lost[part.servo])
            else:
                seen[part.servo] = outcome[part.servo]
    return seen, lost


def servo_angles(joints: Sequence[Joint]) -> RobotJob[tuple[dict[Part, float], dict[Part, ServobusError]]]:
    """Read where the servos of joints are, rad, each as itself; gives those that were read, and those that were not."""
    parts = [part for joint in joints for part in joint.parts]
    outcomes = yield from each(
        on_each_port(joints, lambda there: several.read([part.servo for part in there], "present_position"))
    )
    seen: dict[Part, float] = {}
    lost: dict[Part, ServobusError] = {}
    for part in parts:
        outcome = outcomes[part.port]
        if isinstance(outcome, ServobusError):
            lost[part] = outcome
        elif part.servo in outcome.lost:
            lost[part] = outcome.lost[part.servo]
        else:
            seen[part] = outcome[part.servo]
    return seen, lost


def joined(joint: Joint, name: str, values: Sequence[Any]) -> Any:
    """Give what the servos of a joint say as one value of the joint."""
    turned = [to_joint(part.axis, name, value) for part, value in zip(joint.parts, values, strict=True)]
    if len(turned) == 1:
        return turned[0]
    if name == "present_position":
        agree(joint, turned)
    return sum(turned) / len(turned) if name in (*ANGLES, *RATES) else turned[0]


def agree(joint: Joint, angles: Sequence[float]) -> None:
    """Raise Disagreement if the servos of a joint stand at angles of it that are too far apart."""
    apart = max(angles) - min(angles)
    if len(angles) > 1 and apart > joint.disagreement:
        said = " and ".join(
            f"{part.servo.target} at {show(angle, 'rad')}" for part, angle in zip(joint.parts, angles, strict=True)
        )
        raise Disagreement(
            f"{joint.name}: {said}, {show(apart, 'rad')} apart, where {show(joint.disagreement, 'rad')} are allowed; "
            "they would fight each other: look at the horns and at both zeros"
        )


def look(joints: Sequence[Joint]) -> RobotJob[ByJoint[JointState]]:
    """Look at joints; gives name -> JointState, and those that are `lost`."""
    outcomes = yield from each(on_each_port([joint for joint in joints if not joint.mistaken], _look_at_all))
    seen, lost = _sorted(joints, outcomes)
    return ByJoint(
        {
            joint.name: _state(joint, [seen[part.servo] for part in joint.parts])
            for joint in joints
            if joint.name not in lost
        },
        lost,
    )


def _look_at_all(parts: Sequence[Part]) -> Procedure[Readings[Servo, Snapshot]]:
    seen: dict[Servo, Snapshot] = {}
    lost: dict[Servo, ServobusError] = {}
    for part in parts:
        yield SetBaud(part.servo.baud)
        try:
            part.servo.state = seen[part.servo] = yield from look_at(part.servo.target)
        except BusError as error:
            lost[part.servo] = error
    return Readings(seen, lost)


def _state(joint: Joint, seen: Sequence[Snapshot]) -> JointState:
    angles = [part.axis.to_joint(state.position) for part, state in zip(joint.parts, seen, strict=True)]
    return JointState(
        sum(angles) / len(angles),
        min(state.voltage for state in seen),
        max(state.temperature for state in seen),
        all(state.torque for state in seen),
        "; ".join(state.shutdown for state in seen if state.shutdown),
        max(angles) - min(angles),
        len({state.torque for state in seen}) > 1,
    )


def torque_on(joints: Sequence[Joint]) -> RobotJob[None]:
    """Switch the torque of joints on where they stand: of both servos on one axis, or of none.

    Raises Disagreement before the torque of any is switched on, and the first failure when all had their turn.
    """
    check_meant(joints)
    pairs = [joint for joint in joints if len(joint.parts) > 1]
    if pairs:
        yield from read(pairs, "present_position")
    outcomes = yield from each(on_each_port(joints, _switch_on_all))
    failures = _named(joints, outcomes)
    torn = [joint for joint in pairs if any(part.servo in failures for part in joint.parts)]
    yield from each(on_each_port(torn, _let_go_all))
    for outcome in outcomes.values():
        if isinstance(outcome, ServobusError):
            raise outcome
    for error in failures.values():
        raise error


def _switch_on_all(parts: Sequence[Part]) -> Procedure[dict[Servo, ServobusError]]:
    failures: dict[Servo, ServobusError] = {}
    for part in parts:
        yield SetBaud(part.servo.baud)
        try:
            yield from switch_on(part.servo.target)
        except (BusError, MotionError) as error:
            failures[part.servo] = error
    return failures


def _let_go_all(parts: Sequence[Part]) -> Procedure[dict[Servo, ServobusError]]:
    failures: dict[Servo, ServobusError] = {}
    for part in parts:
        yield SetBaud(part.servo.baud)
        try:
            yield from let_go(part.servo.target)
        except BusError as error:
            failures[part.servo] = error
    return failures


def torque_off(joints: Sequence[Joint]) -> RobotJob[None]:
    """Switch the torque of joints off: of each, though it fails with others; then raise the first failure."""
    outcomes = yield from together(on_each_port(joints, _let_go_all))
    for error in _named(joints, outcomes).values():
        raise error


def _named(joints: Iterable[Joint], outcomes: Mapping[str, Any]) -> dict[Servo, ServobusError]:
    """Give servo -> error of what came of all ports, the name of its joint in each."""
    names = {part.servo: joint.name for joint in joints for part in joint.parts}
    failures = {servo: error for port in outcomes.values() if isinstance(port, dict) for servo, error in port.items()}
    for servo, error in failures.items():
        error.tell_whose(names[servo])
    return failures


def stop(joints: Sequence[Joint]) -> RobotJob[dict[str, tuple[StopOutcome, ...]]]:
    """Stop joints, each though others fail; gives what was done with the servos of each. Raises StopFailed."""
    outcomes = yield from each(on_each_port(joints, lambda parts: stop_all([part.servo.target for part in parts])))
    done: dict[str, tuple[StopOutcome, ...]] = {}
    failures: dict[Any, Exception] = {}
    for joint in joints:
        ends = []
        for part in joint.parts:
            there = outcomes[part.port]
            end = there if isinstance(there, ServobusError) else there[part.servo.target]
            if isinstance(end, StopOutcome):
                ends.append(end)
            else:
                failures[joint.name] = end
        done[joint.name] = tuple(ends)
    if failures:
        said = "; ".join(f"{name} may still move: {why}" for name, why in failures.items())
        raise StopFailed(said, failures, {name: ends for name, ends in done.items() if name not in failures})
    return done
