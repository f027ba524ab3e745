"""Heat and stall: when a servo is warned of, weakened, and made safe.

An `OverloadMonitor` belongs to one servo; `Bus.protect` has each look at its own.

    OK      cool, and it moves if it pushes
    WARN    near its temperature limit: the caller is told
    DERATE  nearer: it gets half its strength, or half its speed where it has no register for that
    SAFE    at the limit, or it pushes and has not moved for a while: its safe action, and no motion until that is over
"""

from enum import IntEnum

from servobus.core.exchange import Now, Procedure
from servobus.core.units import deg, finite, said
from servobus.core.values import frozen
from servobus.errors import BadValue
from servobus.families.base import KnownServo
from servobus.jobs.make_safe import make_safe

STILL = 1 * deg
"""Way that counts as motion; assumption: more than the play and the noise of all three."""


class Level(IntEnum):
    """How bad it is."""

    OK = 0
    WARN = 1
    DERATE = 2
    SAFE = 3


@frozen
class Thresholds:
    """When a servo reaches which level. All defaults are assumptions; no manual says any.

    warn, derate   °C below the limit that is set in the servo
    back           °C that it must be cooler again before a level ends
    push           share of the output it is allowed, from which on it pushes
    stall          s for which it pushes without moving; less than the 0.6 s after which a DRS-0602 itself gives up
    """

    warn: float = 10.0
    derate: float = 5.0
    back: float = 2.0
    push: float = 0.8
    stall: float = 0.5

    def check(self) -> "Thresholds":
        """Give them back. Raises BadValue if one is no number, or if they contradict each other."""
        for name in ("warn", "derate", "back", "push", "stall"):
            if finite(value := getattr(self, name)) is None:
                raise BadValue(f"Thresholds: {name} {said(value)} is not a number")
        if not (self.warn >= self.derate >= 0 and self.back >= 0 and 0 < self.push <= 1 and self.stall > 0):
            raise BadValue(f"{self}: warn must be at least derate, push a share, and none below 0")
        return self


class OverloadMonitor:
    """Watches over one servo: judges by what is read of it now and then, and acts.

    `judge` has no bus and no clock. `look` reads the servo, judges, and does what the level asks for.
    """

    def __init__(self, limit: float, thresholds: Thresholds | None = None) -> None:
        self.limit = limit
        """°C, the one set in the servo."""
        self.thresholds = (thresholds or Thresholds()).check()
        self.level = Level.OK
        self.stalled = False
        self.output_limit: int | None = None
        """What its strength was before it was halved, raw."""
        self._heat = Level.OK
        self._since: tuple[float, float] | None = None
        """Time and position since which it pushes without moving."""

    @classmethod
    def of(cls, target: KnownServo, thresholds: Thresholds) -> "Procedure[OverloadMonitor]":
        """Make the monitor of a servo: its limit is the one set in it."""
        row = target.model.register("max_temperature")
        (raw,) = yield from target.model.family.read(target, [row])
        return cls(row.decode(raw), thresholds)

    def look(self, target: KnownServo) -> Procedure[Level]:
        """Read the servo, judge it, and act."""
        family, permit = target.model.family, target.permit
        names = ("present_temperature", "present_position")
        rows = [target.model.register(name) for name in names]
        temperature, position = yield from family.read(target, rows)
        # Of one that we do not drive, or have stopped, a goal that it never reached says nothing.
        push = 0.0 if permit.given_up else (yield from family.push(target))
        now = yield Now()
        level = self.judge(now, rows[0].decode(temperature), push, rows[1].decode(position))
        yield from self._act(target, level)
        return level

    # Judging

    def judge(self, now: float, temperature: float, push: float, position: float) -> Level:
        """Give the level at this time in s, from °C, the share of its allowed output, and rad."""
        self._heat = self._judge_heat(temperature)
        self.stalled = self._judge_stall(now, push, position)
        self.level = Level.SAFE if self.stalled else self._heat
        return self.level

    def _judge_heat(self, temperature: float) -> Level:
        bounds = self.thresholds
        starts = {
            Level.SAFE: self.limit,
            Level.DERATE: self.limit - bounds.derate,
            Level.WARN: self.limit - bounds.warn,
        }
        for level, start in starts.items():
            # A level that is reached ends later than it began, so that it does not flap.
            if temperature >= (start - bounds.back if self._heat >= level else start):
                return level
        return Level.OK

    def _judge_stall(self, now: float, push: float, position: float) -> bool:
        if abs(push) < self.thresholds.push:
            self._since = None
            return False
        if self._since is None or abs(position - self._since[1]) >= STILL:
            self._since = now, position
        return now - self._since[0] >= self.thresholds.stall

    # Acting

    def _act(self, target: KnownServo, level: Level) -> Procedure[None]:
        """Do what the level asks for, and undo what it does not ask for any more."""
        permit = target.permit
        if level >= Level.DERATE:
            yield from self._weaken(target)
        else:
            yield from self._strengthen(target)
        if level < Level.SAFE:
            permit.inhibited = ""
            return
        why = "it pushed without moving" if self.stalled else f"it reached {self.limit:g} °C"
        permit.inhibited = f"{target} is not moved: {why}; protect() allows it again when that is over"
        if permit.driven:
            yield from make_safe(target, permit.safe_action or "hold")

    def _weaken(self, target: KnownServo) -> Procedure[None]:
        row = target.model.optional("output_limit")
        if row is None:
            target.permit.speed_factor = 0.5
            return
        (limit,) = yield from target.model.family.read(target, [row])
        least = 1 if self.output_limit is None else self.output_limit // 2
        if limit > least:  # after a restart it has all again
            yield from target.model.family.write(target, {row: limit // 2})
            self.output_limit = limit

    def _strengthen(self, target: KnownServo) -> Procedure[None]:
        target.permit.speed_factor = 1.0
        row = target.model.optional("output_limit")
        if self.output_limit is not None and row is not None:
            (limit,) = yield from target.model.family.read(target, [row])
            # an RX-28 that has shut down has none, and would jump if it got some
            if limit == self.output_limit // 2:
                yield from target.model.family.write(target, {row: self.output_limit})
            self.output_limit = None
