"""Jobs of several steps, written once for both drivers: look, move, scan, verify."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Real
from typing import Any

from servobus.core.exchange import Exchange, Pause, Procedure, SetBaud, Volley, ask
from servobus.core.ids import LAST_ID, check_id
from servobus.core.registers import Register
from servobus.core.units import deg, show
from servobus.core.values import frozen, replace
from servobus.errors import BadValue, BusError, MoveTimeout, NoReply, Restarted, Stopped, TorqueOff, UsageError
from servobus.families import registry
from servobus.families.base import Answers, Family, Identity, Leg, Model, Target
from servobus.families.record import SafeAction

DEFAULT_SPEED = 90 * deg
"""Speed of a move that names neither time nor speed: brisk enough to see, gentle enough for a first try."""
SHORTEST = 0.02
"""Seconds that a move takes at least if its time follows from a speed: one to where it stands still is one too."""

LOOK = 0.02
"""s between two looks whether a servo has arrived."""
ATTENTION = 0.05
"""s between two words to the watch while it cannot have arrived yet: well within the time-out of most."""


# Looking


@frozen
class State:
    """What one wants to see of a servo first."""

    position: float
    """rad"""
    voltage: float
    """V"""
    temperature: float
    """°C"""
    torque: bool

    def __str__(self) -> str:
        torque = "on" if self.torque else "off"
        return (
            f"{show(self.position, 'rad')}, {show(self.voltage, 'V')}, "
            f"{show(self.temperature, 'degC')}, torque {torque}"
        )


def look(target: Target) -> Procedure[State]:
    """Read position, voltage, temperature and torque."""
    names = ("present_position", "present_voltage", "present_temperature", "torque_enable")
    rows = [target.model.register(name) for name in names]
    raw = yield from ask(target.model.family.read(target, rows))
    position, voltage, temperature, _ = (row.decode(value) for row, value in zip(rows, raw, strict=True))
    return State(position, voltage, temperature, target.model.family.torque_on(raw[3]))


# Moving


@frozen
class Course:
    """A move of servos of one family: who goes where, and when all should be there."""

    legs: tuple[Leg, ...]
    loose: tuple[Target, ...]
    """Servos whose torque was off when the move was planned."""

    @property
    def duration(self) -> float:
        """Seconds from start to arrival."""
        return max(leg.duration for leg in self.legs)


def plan(goals: Mapping[Target, float], *, time: float | None = None, speed: float | None = None) -> Procedure[Course]:
    """Check a move of one servo or several that start together and arrive together; nothing moves yet.

    goals   target -> angle in rad, targets of one family
    time    seconds the move takes, or
    speed   rad/s of the servo that has the longest way; DEFAULT_SPEED if neither is given

    Raises BadValue for an angle, time or speed that cannot be, or for a step beyond `max_step`; UsageError for a servo
    in endless turn.
    """
    if time is not None and speed is not None:
        raise BadValue("a move takes either a time or a speed, not both")
    for name, value in (("time", time), ("speed", speed)):
        if value is not None and not (_is_number(value) and 0 < value < math.inf):
            raise BadValue(f"{name} {value!r} is not a number above 0")
    families = {target.model.family.name for target in goals}
    if len(families) != 1:
        raise UsageError(f"one move drives servos of one family, not {' and '.join(sorted(families)) or 'none'}")

    raw = {target: raw_goal(target, angle) for target, angle in goals.items()}
    family = next(iter(goals)).model.family
    distances: dict[Target, float] = {}
    loose = []
    for target, goal in raw.items():
        stance = yield from family.stance(target)
        if stance.turning:
            raise UsageError(
                f"{target} turns without end; position_mode() or `servobus turn PORT {target.id} --end` ends that"
            )
        row = target.model.register("goal_position")
        if not stance.low <= goal <= stance.high:
            low, high = row.show(row.decode(stance.low)), row.show(row.decode(stance.high))
            raise BadValue(f"{target}: {row.show(row.decode(goal))} is outside the limits set in it, {low} .. {high}")
        notes = target.notes
        if not stance.torque or (notes is not None and notes.restarted):
            loose.append(target)
        distances[target] = abs(row.decode(goal) - stance.position)
        if notes is not None:
            notes.check_step(str(target), distances[target])
    if time is None:
        time = max(max(distances.values()) / (speed or DEFAULT_SPEED), SHORTEST)
    time /= min(target.notes.slow if target.notes is not None else 1.0 for target in goals)
    if family.max_move_time is not None and time > family.max_move_time:
        raise BadValue(
            f"a {family.title} move takes {show(family.max_move_time, 's')} at most, "
            f"this one would take {show(time, 's')}: go in steps, or faster"
        )
    legs = tuple(Leg(target, goal, distances[target], time) for target, goal in raw.items())
    for leg in legs:
        family.check_leg(leg)
    return Course(legs, tuple(loose))


def launch(course: Course) -> Procedure[None]:
    """Start a move that was planned. Raises Stopped if one of its servos must not move now."""
    set_going(leg.target for leg in course.legs)
    yield from course.legs[0].target.model.family.launch(course.legs)


def set_going(targets: Iterable[Target]) -> None:
    """Take note that these are set in motion or switched on now. Raises Stopped if one must not be."""
    for target in targets:
        if target.notes is not None:
            target.notes.go()


def keep_going(targets: Iterable[Target]) -> None:
    """Take note that these are given goals again and again. As `set_going`, but quick for those that move already.

    The targets are on one bus, so that one word to its watch is enough.
    """
    attended = False
    for target in targets:
        notes = target.notes
        if notes is None:
            continue
        if not notes.driven or notes.held or notes.halted:
            notes.go()
        elif not attended:
            attend(target)
            attended = True


def make_safe(target: Target, action: SafeAction) -> Procedure[None]:
    """Hold a servo where it is, free it or brake it."""
    family, notes = target.model.family, target.notes
    if action == "free":
        yield from family.torque(target, on=False)
        # Most servos do not answer to that: it may have been lost.
        if target.answers is not Answers.NOTHING:
            (torque,) = yield from ask(family.read(target, [target.model.register("torque_enable")]))
            if family.torque_on(torque):
                raise BusError(f"{target}: its torque is still on")
    elif action == "brake":
        yield from family.brake(target)
    elif notes is None or not notes.held:
        yield from _hold(replace(target, notes=None))  # no limit of one step stands against stopping
    if notes is not None:
        notes.rest()


def _hold(target: Target) -> Procedure[None]:
    family = target.model.family
    try:
        stance = yield from family.stance(target)
    except BusError:
        pass  # stop it all the same
    else:
        if not stance.torque:
            return  # it moves nothing; and a goal would switch an RX-28 on
    yield from family.stop(target)


def require_torque(courses: Sequence[Course]) -> None:
    """Refuse a move that some servo would not follow. Raises TorqueOff."""
    loose = [str(target) for course in courses for target in course.loose]
    if loose:
        raise TorqueOff(f"{', '.join(loose)}: torque is off, so nothing would move; switch it on first")


def raw_goal(target: Target, angle: float) -> int:
    """Turn an angle into a raw goal the model can take. Raises BadValue."""
    if not _is_number(angle):
        raise BadValue(f"{target}: {angle!r} is not a number; an angle is in radians, such as 90 * deg")
    row = target.model.register("goal_position")
    try:
        raw = row.scale.encode(angle)
    except ValueError as error:
        raise BadValue(f"{target}: {error}") from None
    if not row.accepts(raw):
        # People give degrees as whole numbers. What was degrees once, as on the command line, is none in radians.
        forgotten = (
            abs(angle) > 2 * math.pi and float(angle).is_integer() and row.accepts(row.scale.encode(angle * deg))
        )
        hint = f" (angles are in radians: did you mean {angle:g} * deg?)" if forgotten else ""
        low, high = (row.show(row.decode(limit)) for limit in row.limits)
        raise BadValue(f"{target}: {row.show(angle)} is outside {low} .. {high}{hint}")
    return raw


def _is_number(value: object) -> bool:
    """Tell whether a value, of a caller without type checks, can be reckoned with."""
    return isinstance(value, Real)


def arrive(course: Course, *, timeout: float | None = None, tolerance: float = 3 * deg) -> Procedure[None]:
    """Wait until all servos of a move stand still near their goals.

    `timeout` is in seconds from now; the move's own duration and 2 s by default. Raises MoveTimeout, or Stopped as soon
    as one of them does not come any more: it was made safe, stopped, or its torque was switched off.
    """
    if timeout is not None and not timeout >= 0:
        raise BadValue(f"timeout {timeout} is not a number of seconds")
    left = course.duration + 2.0 if timeout is None else timeout
    begin = left - course.duration
    while left > max(begin, 0) and not any(_given_up(leg.target) for leg in course.legs):
        attend(course.legs[0].target)
        pause = min(left - max(begin, 0), ATTENTION)
        yield Pause(pause, shared=True)
        left -= pause
    for leg in sorted(course.legs, key=lambda leg: not _given_up(leg.target)):
        row = leg.target.model.register("present_position")
        while True:
            attend(leg.target)
            given_up = _given_up(leg.target)
            moving = yield from leg.target.model.family.moving(leg.target)
            (raw,) = yield from ask(leg.target.model.family.read(leg.target, [row]))
            if not moving and abs(row.decode(raw) - row.decode(leg.goal)) <= tolerance:
                break
            here, goal = row.show(row.decode(raw)), row.show(row.decode(leg.goal))
            if given_up:
                raise Stopped(
                    f"{leg.target} is at {here} and goes to {goal} no more: it was stopped or its torque switched off"
                )
            if left <= 0:
                raise MoveTimeout(f"{leg.target} is at {here} and did not reach {goal}")
            yield Pause(LOOK, shared=True)
            left -= LOOK


def attend(target: Target) -> None:
    """Say that somebody cares for a servo in motion, which feeds the watch. Raises Stopped if nothing is to move."""
    if target.notes is not None and target.notes.attend is not None:
        target.notes.attend()


def _given_up(target: Target) -> bool:
    """Tell whether something has ended its motion since it was set going."""
    return target.notes is not None and (target.notes.held or not target.notes.driven)


# Finding


@frozen
class Found:
    """A servo that answered. `model` is None if its number is of no model known here."""

    family: Family
    id: int
    baud: int
    identity: Identity
    model: type[Model] | None
    state: State | None
    """None for a servo whose registers cannot be read: an unknown model, or one that answers nothing."""
    alarms: int = 0
    """Alarm bits that stood in its answer."""


@frozen
class Trouble:
    """Something answered that made no sense."""

    family: Family
    id: int
    baud: int
    error: BusError

    def __str__(self) -> str:
        return (
            f"{self.family.title}, id {self.id} at {self.baud} baud: something answers, but not clearly ({self.error})"
        )


@frozen
class Progress:
    """How far a scan is."""

    done: int
    total: int
    family: Family
    baud: int
    id: int
    found: Found | None = None


class Survey:
    """What a scan saw."""

    def __init__(self) -> None:
        self.found: list[Found] = []
        self.troubles: list[Trouble] = []


AT_ONCE = 16
"""Ids that a scan asks before it looks at the answers."""

Watcher = Callable[[Progress], None]


def scan(
    families: Sequence[Family],
    bauds: Sequence[int] | None = None,
    ids: Iterable[int] = range(LAST_ID + 1),
    watch: Watcher | None = None,
    survey: Survey | None = None,
) -> Procedure[Survey]:
    """Ask every id of every family at every speed whether it is there. Moves nothing, changes nothing.

    `bauds` None means each family's factory speed. What is found is put into `survey` at once, so it is there even
    if the scan is broken off.
    """
    wanted = [check_id(id) for id in ids]
    rounds = [(baud, family) for family in families for baud in bauds or (family.default_baud,)]
    survey = Survey() if survey is None else survey
    done = 0
    for baud, family in sorted(rounds, key=lambda item: item[0]):
        yield SetBaud(baud)
        for start in range(0, len(wanted), AT_ONCE):
            some = wanted[start : start + AT_ONCE]
            # A scan mostly meets silence: it does not ask twice, but where something was heard.
            answers = yield Volley([family.ping(id).once() for id in some])
            for id, answer in zip(some, answers, strict=True):
                done += 1
                found = None
                if not isinstance(answer, NoReply):
                    found = yield from _met(family, id, baud, survey)
                if watch is not None:
                    watch(Progress(done, len(rounds) * len(wanted), family, baud, id, found))
    return survey


def _met(family: Family, id: int, baud: int, survey: Survey) -> Procedure[Found | None]:
    """Look closer at what may have answered, and put it into the survey."""
    try:
        ping: Exchange[Any] = family.ping(id)
        alarms = (yield ping.giving(ping.alarms)) if ping.alarms is not None else (yield ping) or 0
        found = yield from _meet(family, id, baud, alarms)
    except NoReply:
        return None
    except BusError as error:
        survey.troubles.append(Trouble(family, id, baud, error))
        return None
    survey.found.append(found)
    return found


def _meet(family: Family, id: int, baud: int, alarms: int) -> Procedure[Found]:
    """Get to know a servo that is there."""
    identity = yield from family.identify(id)
    model = registry.identified(family, identity.number)
    state = None
    if model is not None and identity.answers is not Answers.NOTHING:
        state = yield from look(Target(id, model, identity.answers))
    return Found(family, id, baud, identity, model, state, alarms)


def find(families: Sequence[Family], bauds: Sequence[int] | None, id: int) -> Procedure[Found]:
    """Look for one servo. Raises NoReply if nobody answers, BusError if it is no model known here."""
    survey = yield from scan(families, bauds, [id])
    for found in survey.found:
        if found.model is not None:
            yield SetBaud(found.baud)
            return found
        raise BusError(
            f"id {id} at {found.baud} baud answers as {found.family.title} model {found.identity.number}, "
            "which is not known here"
        )
    if survey.troubles:
        raise survey.troubles[0].error
    tried = ", ".join(f"{family.name} at {'/'.join(map(str, bauds or (family.default_baud,)))}" for family in families)
    raise NoReply(f"no servo answers to id {id} (tried {tried}); is it powered, and is that its speed?")


def identify_at(family: Family, id: int, baud: int) -> Procedure[Identity]:
    """Ask a servo who it is, at a given speed."""
    yield SetBaud(baud)
    return (yield from family.identify(id))


# What the servo may have lost


def verify(target: Target) -> Procedure[None]:
    """Compare what was set in the servo's RAM, torque included, with what it holds. Raises Restarted.

    Without anything set so far nothing can be told. A servo whose torque is off because of an alarm has not
    restarted.
    """
    notes, family = target.notes, target.model.family
    if notes is None or not notes.ram:
        return
    rows = list(notes.ram)
    raws = yield from ask(family.read(target, rows))
    lost = {row: raw for row, raw in zip(rows, raws, strict=True) if raw != notes.ram[row]}
    torque = target.model.register("torque_enable")
    if torque in lost and family.torque_on(notes.ram[torque]) and not family.torque_on(lost[torque]):
        alone = len(lost) == 1
        if alone and (yield from family.read_alarms(target)):
            return
    if not lost:
        return
    said = ", ".join(
        f"{row.name} is {_said(row, raw)}, was set to {_said(row, notes.ram[row])}" for row, raw in lost.items()
    )
    notes.forget()
    notes.restarted = True
    raise Restarted(
        f"{target} has lost what was set in it: it restarted, a write was lost, or another program changed it "
        f"({said}). Set it up again; it moves after torque_on() or rearm()"
    )


def _said(row: Register[Any], raw: int) -> str:
    try:
        return row.show(row.decode(raw))
    except ValueError:
        return f"raw {raw}"
