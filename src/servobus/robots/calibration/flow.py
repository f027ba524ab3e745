"""Calibrating joints by hand, as a flow without I/O: it takes readings and what a person answers, and says what to do.

    flow = Calibration(file, ["shoulder", "elbow"])
    while not flow.over:
        flow.take(now, angles)      # servo -> angle as read, rad; servos that did not answer are left out
        print(flow.prompt)          # what the person is to do now
        flow.confirm()              # ENTER was pressed
    changes = flow.changes()        # for `servobus.robots.file.writing.edited`

For each joint: which servo turns when the joint is moved, which way is positive, how far the joint goes, and where its
zero is. The zero is where a person puts the joint, and never the middle of the sweep, which depends on the hand. All
joints are limp. Nothing is written and nothing moves: that is up to who asks.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from servobus.core.units import show
from servobus.errors import UsageError
from servobus.robots.calibration.joint import (
    ALONE,
    MARGIN,
    MOVED,
    NEAR,
    QUESTIONS,
    TOGETHER,
    JointFlow,
    Key,
    Result,
    Step,
    key_of,
)
from servobus.robots.calibration.sweep import Track, why_unusable
from servobus.robots.file.entries import JointEntry, RobotFile
from servobus.robots.file.writing import quantity


class Calibration:
    """The flow over all joints that are calibrated, one after the other."""

    def __init__(
        self,
        file: RobotFile,
        joints: Sequence[str],
        zeros: Mapping[str, float] | None = None,
        margin: float = MARGIN,
    ) -> None:
        self.file = file
        known = dict(zeros or {})
        self.joints = {name: JointFlow(file.joints[name], known.get(name), margin) for name in joints}
        self.current: JointFlow | None = None
        """The joint that is dealt with; None at the end."""
        self._owners = {key_of(servo): entry.name for entry in file.joints.values() for servo in entry.servos}
        self._first_owners = dict(self._owners)
        """Servo -> the joint that the file gives it to."""
        self._tracks = {key_of(servo): Track(servo.model) for entry in file.joints.values() for servo in entry.servos}
        """All servos of the robot, for the step in which it is found out which of them turns."""
        self._next()

    @property
    def over(self) -> bool:
        """Whether there is nothing left to do."""
        return self.current is None

    @property
    def failures(self) -> dict[str, str]:
        """The joints that could not be calibrated -> why, with the remedy."""
        return {name: joint.message for name, joint in self.joints.items() if joint.step is Step.FAILED}

    @property
    def asks(self) -> bool:
        """Whether a yes or a no is waited for."""
        return self.current is not None and self.current.step in QUESTIONS

    # What comes in

    def take(self, now: float, angles: Mapping[Key, float]) -> None:
        """Take readings: servo -> angle, rad. `now` is any clock, s."""
        joint = self.current
        if joint is None:
            return
        for key, angle in angles.items():
            self._tracks[key].add(angle)
            if key in joint.tracks:
                joint.tracks[key].add(angle)
        own = {key: track.angle for key, track in joint.tracks.items() if key in angles and track.angle is not None}
        if joint.step is Step.FIND:
            everyone = {key: self._tracks[key].angle for key in angles}
            self._find(joint, joint.turned(now, {key: at for key, at in everyone.items() if at is not None}))
        elif len(own) < len(joint.tracks):
            return  # one that was not read says nothing
        elif joint.step is Step.PUSH:
            self._push(joint, joint.turned(now, own))
        elif joint.step is Step.BACK:
            self._back(joint, own)
        elif joint.step is Step.SWEEP:
            self._sweep(joint, own)
        elif joint.step is Step.ZERO:
            joint.rests(now, own)

    def confirm(self, at: float | None = None) -> None:
        """Take note that the joint is where its angle is known: `at`, else as was said before, else 0 rad."""
        joint = self.current
        if joint is None or joint.step is not Step.ZERO:
            return
        first = joint.angle
        if first is None:
            return
        slack = NEAR * joint.entry.ratio
        if not joint.ends.low - slack <= first <= joint.ends.high + slack:
            joint.message = f"{joint.name} is outside of what it was swept over: sweep it again, to both ends"
            self._begin_sweep(joint)
            return
        joint.zeros = joint.find_zeros(at if at is not None else joint.zero_at or 0.0)
        joint.snapped = joint.near_round(joint.zeros)
        if joint.snapped:
            joint.go(Step.SNAP)
        else:
            self._done(joint)

    def answer(self, yes: bool) -> None:
        """Take the answer to a question."""
        joint = self.current
        if joint is None:
            return
        if joint.step is Step.SNAP:
            joint.zeros = joint.snapped if yes else joint.zeros
            self._done(joint)
        elif joint.step is Step.PAIR:
            if yes:
                self._fail(joint, self._pair_failure(joint))
            else:
                self._again(joint, "then move it once more, and hold all others still")
        elif joint.step is Step.SWAPPED:
            if yes:
                self._exchange(joint)
            else:
                self._again(joint, f"then move {joint.name} alone")

    def redo(self) -> None:
        """Begin anew with the joint that is dealt with, from which servo it has."""
        if self.current is not None:
            self.current.message = f"{self.current.name} begins anew"
            self.current.restart(Step.FIND)

    # What is told

    @property
    def prompt(self) -> str:
        """What the person is to do now, or is asked."""
        joint = self.current
        if joint is None:
            return "all joints have had their turn"
        name = joint.name.upper()
        if joint.step in (Step.FIND, Step.PUSH) and not joint.at_rest:
            return f"{name}: hold the arm still"
        match joint.step:
            case Step.FIND:
                return f"{name}: move this joint to and fro, and no other"
            case Step.SWAPPED:
                other = joint.asked.name if joint.asked is not None else "another joint"
                return f"{name}: the servo of {other} turned. Was it {joint.name} that you moved (y), or {other} (n)?"
            case Step.PAIR:
                moved = self._moved_text(joint)
                return f"{name}: {moved} turned together. Are they on one axis (y), or were two joints moved (n)?"
            case Step.PUSH:
                return f"{name}: push it to where its angle shall grow"
            case Step.BACK:
                return f"{name}: push it back, to where its angle shall get smaller"
            case Step.SWEEP:
                low, high = joint.ends.touched
                if joint.directions[0] < 0:
                    low, high = high, low
                return f"{name}: move it to both ends, twice (lower end {low} of 2, upper end {high} of 2)"
            case Step.ZERO:
                at = show(joint.zero_at or 0.0, "rad")
                return f"{name}: bring it to {at} of the joint, a known pose or a mark, hold it there and press ENTER"
            case Step.SNAP:
                there, near = show(joint.zeros[0], "rad"), show(joint.snapped[0], "rad")
                return f"{name}: its zero is at {there} of the servo, {near} is near. Take {near} (y), or {there} (n)?"
        return f"{name}: {joint.message}"

    @property
    def message(self) -> str:
        """What happened last in the joint that is dealt with."""
        return "" if self.current is None else self.current.message

    def results(self) -> list[Result]:
        """Give what was found, of the joints that are done; of two that have each other's servos both or none."""
        done = {name: joint for name, joint in self.joints.items() if joint.step is Step.DONE}
        return [
            joint.result()
            for joint in done.values()
            if all(self._first_owners[key_of(servo)] in done for servo in joint.servos)
            and all(self._owners[key_of(servo)] in done for servo in joint.entry.servos)
        ]

    def changes(self) -> dict[tuple[str, ...], Any]:
        """Give what is to be changed in the robot file: path of a key -> value."""
        made: dict[tuple[str, ...], Any] = {}
        for one in self.results():
            made |= _changes(self.file.joints[one.joint], one)
        return made

    # Steps

    def _next(self) -> None:
        ended = (Step.DONE, Step.FAILED)
        self.current = next((joint for joint in self.joints.values() if joint.step not in ended), None)
        if self.current is not None:
            self.current.restart(Step.FIND)

    def _fail(self, joint: JointFlow, why: str) -> None:
        """Give a joint up, and go on with the next."""
        joint.step, joint.message = Step.FAILED, why
        self._next()

    def _again(self, joint: JointFlow, message: str) -> None:
        joint.message = message
        joint.restart(Step.FIND)

    def _find(self, joint: JointFlow, turned: Mapping[Key, float]) -> None:
        """Tell which servos turn when the joint is moved."""
        farthest = max(map(abs, turned.values()), default=0.0)
        if farthest < MOVED:
            return
        moved = {key for key, way in turned.items() if abs(way) >= TOGETHER * farthest}
        unclear = {key for key, way in turned.items() if ALONE * farthest < abs(way) < TOGETHER * farthest}
        own = {key_of(servo) for servo in joint.servos}
        owners = {self._owners[key] for key in moved}
        if unclear:
            joint.message = "several servos turned, not alike: move one joint alone"
            joint.rebase()
        elif moved == own:
            joint.message = f"{joint.name} has {self._who(moved)}"
            joint.go(Step.PUSH)
        elif len(owners) == 1 and owners != {joint.name} and len(moved) == len(own):
            (other,) = owners
            joint.asked = self.joints.get(other) or JointFlow(self.file.joints[other], None, joint.margin)
            joint.go(Step.SWAPPED)
        elif len(moved) == 2 and own <= moved:
            joint.base = dict.fromkeys(moved, 0.0)
            joint.step = Step.PAIR
        elif moved < own:
            rest = self._who(own - moved)
            self._fail(
                joint,
                f"{self._who(moved)} turned alone, and {rest} did not, although the file has both on one axis: look at "
                f"the horn and the screw of that one, or take [joint.{joint.name}.mirror] out of the file",
            )
        else:
            joint.message = f"{self._who(moved)} turned: move {joint.name} alone"
            joint.rebase()

    def _push(self, joint: JointFlow, turned: Mapping[Key, float]) -> None:
        if not turned or min(map(abs, turned.values())) < MOVED:
            return
        joint.directions = tuple(1 if turned[key_of(servo)] > 0 else -1 for servo in joint.servos)
        joint.go(Step.BACK)
        joint.base = {key: track.angle for key, track in joint.tracks.items() if track.angle is not None}

    def _back(self, joint: JointFlow, own: Mapping[Key, float]) -> None:
        """Wait until all servos have turned back from where they were farthest."""
        returned = True
        for servo, direction in zip(joint.servos, joint.directions, strict=True):
            key = key_of(servo)
            joint.base[key] = max(direction * joint.base[key], direction * own[key]) * direction
            returned = returned and direction * (joint.base[key] - own[key]) >= MOVED
        if returned:
            joint.message = f"{joint.name}: positive is {'with' if joint.directions[0] > 0 else 'against'} its servo"
            self._begin_sweep(joint)

    def _begin_sweep(self, joint: JointFlow) -> None:
        joint.go(Step.SWEEP)
        joint.begin_sweep()

    def _sweep(self, joint: JointFlow, own: Mapping[Key, float]) -> None:
        for key, angle in own.items():
            joint.all_ends[key].add(angle)
            if (why := why_unusable(joint.tracks[key], joint.all_ends[key])) is not None:
                self._fail(joint, why)
                return
        if joint.ends.complete:
            joint.message = f"{joint.name}: both ends are known"
            joint.go(Step.ZERO)

    def _done(self, joint: JointFlow) -> None:
        try:
            joint.result()
        except UsageError as error:
            self._fail(joint, str(error))
            return
        joint.step, joint.message = Step.DONE, f"{joint.name} is calibrated"
        self._next()

    def _exchange(self, joint: JointFlow) -> None:
        """Let two joints have each other's servos, as the person says that they do."""
        other = joint.asked
        assert other is not None  # the question named it
        if other.name not in self.joints:
            self._fail(
                joint,
                f"it has the servo that the file gives to {other.name}: calibrate both, `servobus robot calibrate FILE "
                f"{joint.name} {other.name}`",
            )
            return
        mine, others = joint.servos, other.servos
        if [servo.model for servo in mine] != [servo.model for servo in others]:
            self._fail(
                joint,
                f"it has the {others[0].model.title} that the file gives to {other.name}, and the file says that it is "
                f"a {mine[0].model.title}: exchange model, port, id and baud of the two in the file",
            )
            return
        for servo in (*mine, *others):
            self._owners[key_of(servo)] = other.name if servo in mine else joint.name
        joint.give(others)
        other.give(mine)
        if other.step in (Step.DONE, Step.FAILED):
            other.restart(Step.WAITING)
        joint.message = f"{joint.name} and {other.name} have each other's servos: the ids are exchanged in the file"
        joint.go(Step.PUSH)

    def _pair_failure(self, joint: JointFlow) -> str:
        own = {key_of(servo) for servo in joint.servos}
        ((port, id, _),) = (key for key in joint.base if key not in own)
        owner = next(name for key, name in self._owners.items() if key in joint.base and key not in own)
        return (
            f"{self._moved_text(joint)} are on one axis, and the file has two joints: take "
            f'[joint.{owner}] out, write [joint.{joint.name}.mirror] with port = "{port}", id = {id} and '
            'zero = "0deg", and calibrate again'
        )

    def _moved_text(self, joint: JointFlow) -> str:
        return self._who(set(joint.base))

    def _who(self, keys: set[Key]) -> str:
        return " and ".join(f"id {id} on {port}" for port, id, _ in sorted(keys))


def _changes(entry: JointEntry, one: Result) -> dict[tuple[str, ...], Any]:
    """Give what of a joint changes in the file."""
    path = ("joint", entry.name)
    made: dict[tuple[str, ...], Any] = {}
    before = entry.servos
    for n, (servo, zero, direction) in enumerate(zip(one.servos, one.zeros, one.directions, strict=True)):
        table = path if n == 0 else (*path, "mirror")
        if key_of(servo) != key_of(before[n]):
            made[(*table, "port")] = servo.port
            made[(*table, "id")] = servo.id
            if servo.baud != before[n].baud:
                made[(*table, "baud")] = servo.baud
        made[(*table, "zero")] = quantity(zero, "rad")
        # That of a second servo is the opposite of the first one's if it is not said.
        default = before[n].axis.direction if n == 0 else -one.directions[0]
        said = n > 0 and entry.mirror is not None and entry.mirror.direction is not None
        if direction != default or said:
            made[(*table, "direction")] = direction
    made[(*path, "limits")] = [quantity(angle, "rad") for angle in one.limits]
    return made
