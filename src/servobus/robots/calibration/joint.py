"""One joint in the flow of a calibration: its servos, the step it is in, and what was found of it so far."""

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import TypeAlias

from servobus.core.units import deg, show
from servobus.core.values import frozen
from servobus.errors import UsageError
from servobus.robots.axis import Axis
from servobus.robots.calibration.sweep import Ends, Track, goal_range
from servobus.robots.file.entries import JointEntry, ServoEntry

MOVED = 10 * deg
"""Angle of a servo by which it counts as turned by a hand."""
TOGETHER = 0.8
"""Share of the farthest turn from which on two servos turned together."""
ALONE = 0.3
"""Share of the farthest turn up to which a servo counts as having stood still beside another."""
TREMBLE, REST = 1.5 * deg, 0.4
"""A joint rests if it stays within TREMBLE for REST s."""
NEAR = 1 * deg
"""Angle of the joint within which an end counts as touched again."""
MARGIN = 2 * deg
"""Angle of the joint that limits keep off the ends of the sweep, if nothing else is said."""
SNAP, SNAP_NEAR = 15 * deg, 4 * deg
"""A zero that lies within SNAP_NEAR of a multiple of SNAP of the servo is offered that one: horns are put on so."""
ROUND = 0.1 * deg
"""Limits are rounded to this, inwards."""

Key: TypeAlias = tuple[str, int, int]
"""Which servo: port, id and speed."""


def key_of(servo: ServoEntry) -> Key:
    """Tell which servo is meant."""
    return servo.port, servo.id, servo.baud or servo.model.factory_baud


class Step(StrEnum):
    """Where a joint is in the flow."""

    WAITING = "waiting"
    FIND = "find"
    SWAPPED = "swapped"
    PAIR = "pair"
    PUSH = "push"
    BACK = "back"
    SWEEP = "sweep"
    ZERO = "zero"
    SNAP = "snap"
    DONE = "done"
    FAILED = "failed"


QUESTIONS = (Step.SWAPPED, Step.PAIR, Step.SNAP)
"""Steps that wait for a yes or a no."""


@frozen
class Result:
    """What was found of a joint; angles of the servos in their order, those of the joint in `travel` and `limits`."""

    joint: str
    servos: tuple[ServoEntry, ...]
    zeros: tuple[float, ...]
    directions: tuple[int, ...]
    travel: tuple[float, float]
    limits: tuple[float, float]
    notes: tuple[str, ...]


class JointFlow:
    """How far one joint is: its servos, its step, and what was found so far."""

    def __init__(self, entry: JointEntry, zero_at: float | None, margin: float) -> None:
        self.entry, self.margin = entry, margin
        self.servos = entry.servos
        self.zero_at = zero_at
        """Angle of the joint at which its zero is found; None: 0, unless another one is typed."""
        self.message = ""
        """What happened last, for the person."""
        self.asked: JointFlow | None = None
        """The joint whose servo turned instead."""
        self.restart(Step.WAITING)

    def restart(self, step: Step = Step.FIND) -> None:
        """Forget what was found."""
        self.step = step
        self.tracks = {key_of(servo): Track(servo.model) for servo in self.servos}
        self.directions: tuple[int, ...] = tuple(servo.axis.direction for servo in self.servos)
        self.zeros: tuple[float, ...] = ()
        self.snapped: tuple[float, ...] = ()
        self.begin_sweep()
        self.base: dict[Key, float] = {}
        """Servo -> the angle, rad, from which on its turn is measured; empty until the joint rests."""
        self._still: tuple[float, dict[Key, float]] | None = None
        """Since when, s, and where the servos rest, rad."""

    def begin_sweep(self) -> None:
        """Know nothing of the ends of the travel; seams that were passed before do not count."""
        self.all_ends = {key_of(servo): Ends(NEAR * self.entry.ratio) for servo in self.servos}
        for track in self.tracks.values():
            track.begin()

    @property
    def name(self) -> str:
        return self.entry.name

    @property
    def ends(self) -> Ends:
        """The ends of the travel, as angles of the first servo."""
        return self.all_ends[key_of(self.servos[0])]

    @property
    def angle(self) -> float | None:
        """Angle of the first servo, rad, continued beyond the seam."""
        return self.tracks[key_of(self.servos[0])].angle

    def give(self, servos: tuple[ServoEntry, ...]) -> None:
        """Let other servos be those of the joint."""
        self.servos = servos
        self.restart(self.step)

    def go(self, step: Step) -> None:
        """Go to a step; motion is measured from where the joint comes to rest."""
        self.step, self.base, self._still = step, {}, None

    # Motion

    def rests(self, now: float, angles: Mapping[Key, float]) -> bool:
        """Take note of angles, and tell whether all have stayed where they are for a while."""
        since, where = self._still or (now, {})
        if where.keys() != angles.keys() or any(abs(angle - where[key]) > TREMBLE for key, angle in angles.items()):
            since, where = now, dict(angles)
        self._still = since, where
        return now - since >= REST

    def turned(self, now: float, angles: Mapping[Key, float]) -> dict[Key, float]:
        """Give how far servos have turned since the joint rested; nothing before it has."""
        if not self.base:
            if self.rests(now, angles):
                self.base = dict(angles)
            return {}
        return {key: angle - self.base[key] for key, angle in angles.items() if key in self.base}

    @property
    def at_rest(self) -> bool:
        """Whether the joint has rested since the step began."""
        return bool(self.base)

    def rebase(self) -> None:
        """Wait for the joint to rest, and measure from there."""
        self.base, self._still = {}, None

    # Results

    def axes(self, zeros: Sequence[float]) -> tuple[Axis, ...]:
        return tuple(
            Axis(zero, direction, self.entry.ratio) for zero, direction in zip(zeros, self.directions, strict=True)
        )

    def find_zeros(self, at: float) -> tuple[float, ...]:
        """Give the zeros of the servos, rad, if the joint is at this angle now."""
        angles = [self.tracks[key_of(servo)].angle or 0.0 for servo in self.servos]
        return tuple(
            angle - direction * self.entry.ratio * at for angle, direction in zip(angles, self.directions, strict=True)
        )

    def near_round(self, zeros: tuple[float, ...]) -> tuple[float, ...]:
        """Give the same zeros shifted so that the first is a round angle, if one is near; else nothing."""
        first = round(zeros[0] / SNAP) * SNAP
        shift = first - zeros[0]
        if not 0.05 * deg < abs(shift) <= SNAP_NEAR:
            return ()
        return tuple(
            zero + shift * direction * self.directions[0]
            for zero, direction in zip(zeros, self.directions, strict=True)
        )

    def result(self) -> Result:
        """Give what was found. Raises UsageError if the travel leaves no room for limits."""
        axes = self.axes(self.zeros)
        travel = axes[0].range_to_joint(self.ends.low, self.ends.high)
        low, high = travel[0] + self.margin, travel[1] - self.margin
        notes = []
        for axis, servo in zip(axes, self.servos, strict=True):
            can = axis.range_to_joint(*goal_range(servo.model))
            if low < can[0] or can[1] < high:
                notes.append(
                    f"the joint goes beyond what the {servo.model.title} can be sent to, {show(can[0], 'rad')} .. "
                    f"{show(can[1], 'rad')} of the joint: the limits end there"
                )
            low, high = max(low, can[0]), min(high, can[1])
        low, high = math.ceil(low / ROUND - 1e-6) * ROUND, math.floor(high / ROUND + 1e-6) * ROUND
        if not low < high:
            raise UsageError(
                f"a travel of {show(travel[1] - travel[0], 'rad')} leaves no room for limits with a margin of "
                f"{show(self.margin, 'rad')}; say a smaller one with --margin"
            )
        return Result(self.name, self.servos, self.zeros, self.directions, travel, (low, high), tuple(notes))
