"""The settings of a robot's servos: what they should be by its file, and what they are. Nothing is written here.

    wanted    what the file asks of a servo: [joint.NAME.registers], and its limits where `limits_in_servo` is true
    plan      what the servos hold, compared with that

Limits stand in the file as angles of the joint. Those of a servo are worked out from them: the lower one first whatever
the direction, and rounded inwards, so that no servo takes a goal which its joint must not go to.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from servobus.bus import several
from servobus.core.exchange import Procedure, SetBaud
from servobus.core.present import change_entry, value_text
from servobus.core.registers import Area, Register
from servobus.core.units import show, shown
from servobus.core.values import frozen
from servobus.errors import BusError, ServobusError, UsageError
from servobus.families.base import KnownServo, Model
from servobus.families.change import said
from servobus.robots.axis import Axis
from servobus.robots.file.entries import JointEntry, ServoEntry, raw_setting
from servobus.robots.file.reading import ROUNDING
from servobus.robots.joints.joint import Joint, Part
from servobus.robots.steps import RobotJob, each

INSIDE = 1e-6
"""Steps of a register by which a limit may be missed by reckoning."""


def limits_wanted(model: type[Model], axis: Axis, limits: tuple[float, float]) -> dict[Register[Any], int]:
    """Give the raw position limits of a servo that keep its joint within these angles, rad: rounded inwards."""
    low, high = model.register("min_position"), model.register("max_position")
    least, most = axis.range_to_servo(*limits)
    step = low.scale.decode(1) - low.scale.decode(0)
    zero = low.scale.decode(0)
    return {
        low: low.check(math.ceil((least - zero) / step - INSIDE)),
        high: high.check(math.floor((most - zero) / step + INSIDE)),
    }


def wanted(entry: JointEntry, servo: ServoEntry) -> dict[Register[Any], int]:
    """Give what the file asks of one servo of a joint: register -> raw value."""
    values = {servo.model.register(name): value for name, value in entry.registers.items()}
    raws = {row: raw_setting(row, value) for row, value in values.items()}
    if entry.limits_in_servo and entry.limits is not None:
        raws |= limits_wanted(servo.model, servo.axis, entry.limits)
    return raws


@frozen
class Setting:
    """One register of a servo, raw: what it is, and what the file asks for; `wanted` is None where the file is silent.

    `kept` is whether changing it writes to the EEPROM.
    """

    row: Register[Any]
    now: int
    wanted: int | None
    kept: bool

    @property
    def differs(self) -> bool:
        """Whether it is not what the file asks for."""
        return self.wanted is not None and not self.row.took(self.wanted, self.now)

    def __str__(self) -> str:
        if self.wanted is None or not self.differs:
            return f"{self.row.name}: {value_text(self.row, self.now)}"
        return f"{self.row.name}: {value_text(self.row, self.now)} -> {value_text(self.row, self.wanted)}"


@frozen
class ServoSettings:
    """What one servo holds, compared with the file.

    settings    the registers that the file names, and those that its limits are kept in
    offset      the register that shifts the angles which are read, where the model has one. It belongs to the servo as
                the zero of the file belongs to the joint: changing it is a step of its own
    impossible  name of a register -> why the servo cannot have what the file asks for
    driven      whether its torque is on
    outside     angle of the joint, rad, where it stands outside limits that its servo would get; else None
    problem     why it could not be compared; "" if it could
    """

    joint: str
    port: str
    servo: KnownServo
    limits: tuple[float, float] | None
    settings: tuple[Setting, ...]
    offset: Setting | None = None
    impossible: Mapping[str, str] = MappingProxyType({})
    driven: bool = False
    outside: float | None = None
    problem: str = ""

    @property
    def changes(self) -> tuple[Setting, ...]:
        """What differs and can be written, but for the offset."""
        return tuple(one for one in self.settings if one.differs and one.row.name not in self.impossible)

    def to_write(self, *, offsets: bool = False) -> tuple[Setting, ...]:
        """Give what is to be written: the offset only where that is asked for."""
        shifted = self.offset is not None and self.offset.differs and self.offset.row.name not in self.impossible
        return self.changes + ((self.offset,) if offsets and shifted and self.offset is not None else ())

    @property
    def who(self) -> str:
        """The servo, for people: joint, model, id and port."""
        return f"{self.joint} ({self.servo} on {self.port})"

    def entry(self) -> dict[str, Any]:
        """Give it for programs."""
        return {
            "joint": self.joint,
            "port": self.port,
            "model": self.servo.model.key(),
            "id": self.servo.id,
            "torque": self.driven,
            "outside": None if self.outside is None else round(shown(self.outside, "rad")[0], 4),
            "changes": {one.row.name: _entry(one) for one in self.changes},
            "offset": None if self.offset is None else {self.offset.row.name: _entry(self.offset)},
            "impossible": dict(self.impossible),
            "problem": self.problem or None,
        }


def _entry(one: Setting) -> dict[str, Any]:
    new = one.now if one.wanted is None else one.wanted
    return {**change_entry(one.row, one.now, new), "eeprom": one.kept}


@frozen
class Plan:
    """What `apply_settings` would write: the settings of all servos, compared with the file."""

    name: str
    servos: tuple[ServoSettings, ...]

    def changes(self, *, offsets: bool = False) -> int:
        """Count the values that differ and can be written."""
        return sum(len(one.to_write(offsets=offsets)) for one in self.servos)

    def eeprom_writes(self, *, offsets: bool = False) -> int:
        """Count the values among them that go to the EEPROM of a servo."""
        return sum(setting.kept for one in self.servos for setting in one.to_write(offsets=offsets))

    @property
    def problems(self) -> tuple[str, ...]:
        """What keeps a servo from being as the file says, a sentence each."""
        return tuple(
            sentence
            for one in self.servos
            for sentence in (
                *([f"{one.who}: {one.problem}"] if one.problem else []),
                *(f"{one.who}: {why}" for why in one.impossible.values()),
            )
        )

    @property
    def driven(self) -> tuple[ServoSettings, ...]:
        """The servos whose torque is on although something of them is to be written."""
        return tuple(one for one in self.servos if one.driven and one.to_write(offsets=True))

    def __str__(self) -> str:
        return self.text()

    def text(self, *, offsets: bool = False) -> str:
        """Say it for people: joint by joint, register by register; `offsets` as for `apply_settings`."""
        lines = []
        for one in self.servos:
            told = _lines(one, offsets=offsets)
            if one.driven and one.to_write(offsets=offsets):
                told.append("  its torque is on: it has to go off before anything is written")
            if one.outside is not None:
                told.append(
                    f"  it stands at {show(one.outside, 'rad')}, outside its new limits: turn it inside by hand, or it "
                    "gets no torque then"
                )
            lines += [f"{one.who}:", *told] if told else [f"{one.who}: as the file says"]
        count, kept = self.changes(offsets=offsets), self.eeprom_writes(offsets=offsets)
        lines.append(
            f"{self.name}: {count} value{'s' * (count != 1)} to write, {kept} of them to the EEPROM"
            if count
            else f"{self.name}: nothing to write"
        )
        return "\n".join(lines)

    def entry(self) -> dict[str, Any]:
        """Give it for programs."""
        return {
            "file": self.name,
            "changes": self.changes(),
            "eeprom_writes": self.eeprom_writes(),
            "servos": [one.entry() for one in self.servos],
        }


def _lines(one: ServoSettings, *, offsets: bool) -> list[str]:
    if one.problem:
        return [f"  {one.problem}"]
    names = (
        () if one.limits is None else tuple(one.servo.model.register(n).name for n in ("min_position", "max_position"))
    )
    lines = []
    for setting in one.settings:
        why = one.impossible.get(setting.row.name)
        if not setting.differs:
            continue
        where = "EEPROM" if setting.kept else "RAM"
        joint = ""
        if one.limits is not None and setting.row.name in names:
            low, high = one.limits
            joint = f", for {show(low, 'rad')} .. {show(high, 'rad')} of the joint"
        lines.append(f"  {setting}   [{where}{joint}]" if why is None else f"  {setting.row.name} stays: {why}")
    if one.offset is not None:
        lines += _offset_lines(one, one.offset, offsets=offsets)
    return lines


def _offset_lines(one: ServoSettings, offset: Setting, *, offsets: bool) -> list[str]:
    if offset.row.name in one.impossible:
        return [f"  {offset.row.name} stays: {one.impossible[offset.row.name]}"]
    if offset.differs:
        when = "" if offsets else ": written with --offsets alone"
        return [f"  {offset}   [EEPROM, shifts the angles of the joint{when}]"]
    if offset.wanted is None and offset.now != 0:
        return [f"  {offset}   [the servo's own offset: the zero of the file counts on it; the file does not name it]"]
    return []


def plan(name: str, joints: Sequence[Joint], unusable: Mapping[str, str]) -> RobotJob[Plan]:
    """Compare what the servos of these joints hold with the file. Writes nothing.

    unusable  joints of which a servo is not the one of the file, name -> why: nothing is asked of their servos
    """
    parts = [(joint, n, part) for joint in joints for n, part in enumerate(joint.parts)]
    asked: dict[str, list[tuple[Joint, int, Part]]] = {}
    for one in parts:
        if one[0].name not in unusable:
            asked.setdefault(one[2].port, []).append(one)
    outcomes = yield from each({port: _compare_all(there) for port, there in asked.items()})
    found = []
    for joint, n, part in parts:
        if joint.name in unusable:
            found.append(_unread(joint, part, unusable[joint.name]))
            continue
        outcome = outcomes[part.port]
        found.append(
            _unread(joint, part, str(outcome)) if isinstance(outcome, ServobusError) else outcome[joint.name, n]
        )
    return Plan(name, tuple(found))


def limits_alone(joints: Sequence[Joint]) -> list[Joint]:
    """Give joints of whose settings the file asks for their limits, and for nothing else."""
    return [Joint(replace(joint.entry, registers={}, limits_in_servo=True), joint.parts) for joint in joints]


def check_inside(plan: Plan, joints: Sequence[Joint]) -> RobotJob[None]:
    """Raise UsageError where a servo stands outside the limits that a plan would give it; it would be driven there."""
    changed = {one.servo for one in plan.servos if one.changes}
    parts = [(joint, part) for joint in joints for part in joint.parts if part.servo.target in changed]
    asked: dict[str, list[Part]] = {}
    for _, part in parts:
        asked.setdefault(part.port, []).append(part)
    outcomes = yield from each(
        {port: several.read([part.servo for part in there], "present_position") for port, there in asked.items()}
    )
    outside = []
    for joint, part in parts:
        outcome = outcomes[part.port]
        if isinstance(outcome, ServobusError):
            raise outcome
        if (angle := _outside(joint.entry, part, outcome[part.servo])) is not None:
            outside.append(f"{joint.name} at {show(angle, 'rad')}")
    if outside:
        raise UsageError(
            f"{plan.name}: outside the limits stands {', '.join(outside)}: turn it inside by hand, or change `limits` "
            "in the file; nothing was written"
        )


def _outside(entry: JointEntry, part: Part, here: float) -> float | None:
    """Give the angle of a joint whose servo is here, rad, if that is outside the limits the servo is to have."""
    if entry.limits is None:
        return None
    low, high = (row.decode(raw) for row, raw in limits_wanted(part.servo.model, part.axis, entry.limits).items())
    return None if low - ROUNDING <= here <= high + ROUNDING else part.axis.to_joint(here)


def _unread(joint: Joint, part: Part, problem: str) -> ServoSettings:
    return ServoSettings(joint.name, part.port, part.servo.target, None, (), problem=problem)


def _compare_all(parts: Iterable[tuple[Joint, int, Part]]) -> Procedure[dict[tuple[str, int], ServoSettings]]:
    found: dict[tuple[str, int], ServoSettings] = {}
    for joint, n, part in parts:
        try:
            found[joint.name, n] = yield from compare(joint, n)
        except (BusError, UsageError) as error:
            found[joint.name, n] = _unread(joint, part, str(error))
    return found


def compare(joint: Joint, n: int) -> Procedure[ServoSettings]:
    """Compare one servo of a joint, by its number, with the file."""
    part, entry = joint.parts[n], joint.entry
    target, model = part.servo.target, part.servo.model
    yield SetBaud(target.baud)
    asked = wanted(entry, entry.servos[n])
    family, shift = model.family, model.optional("calibration")
    rows = list(dict.fromkeys([*asked, *([shift] if shift is not None else []), *_pair_rows(model, asked)]))
    kept = [row for row in rows if row.area is Area.EEPROM]
    stored = dict(zip(kept, (yield from family.read_stored(target, kept)), strict=True)) if kept else {}
    acting = dict(zip(rows, (yield from family.read(target, rows)), strict=True)) if rows else {}
    torque = yield from family.read_torque(target)
    settings = {row: _setting(row, asked.get(row), stored, acting) for row in rows}
    limits = entry.limits if entry.limits_in_servo else None
    outside = None
    if limits is not None and any(settings[row].differs for row in limits_wanted(model, part.axis, limits)):
        place = model.register("present_position")
        (raw,) = yield from family.read(target, [place])
        outside = _outside(entry, part, place.decode(raw))
    return ServoSettings(
        joint.name,
        part.port,
        target,
        limits,
        tuple(settings[row] for row in asked if row is not shift),
        None if shift is None else settings[shift],
        _impossible(model, asked, {row: one.now for row, one in settings.items()}),
        torque.on,
        outside,
    )


def _setting(
    row: Register[Any], asked: int | None, stored: Mapping[Register[Any], int], acting: Mapping[Register[Any], int]
) -> Setting:
    """Compare what is stored, and where that is as it should be what acts, which may be another copy in RAM."""
    now = stored.get(row, acting[row])
    if row in stored and asked is not None and row.took(asked, now) and not row.took(asked, acting[row]):
        return Setting(row, acting[row], asked, kept=False)
    return Setting(row, now, asked, kept=row in stored)


def _pair_rows(model: type[Model], asked: Mapping[Register[Any], int]) -> list[Register[Any]]:
    """List the registers that belong together with what is asked for: one limit of a pair tells of the other."""
    return [
        row for pair in model.limit_pairs for row in pair.rows(model) if any(one in asked for one in pair.rows(model))
    ]


def _impossible(
    model: type[Model], asked: Mapping[Register[Any], int], now: Mapping[Register[Any], int]
) -> dict[str, str]:
    """Tell which limits would cross, name of the register -> why: the servo would refuse them."""
    why = {}
    after = {**now, **asked}
    for pair in model.limit_pairs:
        low, high = pair.rows(model)
        if (low in asked or high in asked) and not pair.fits(after[low], after[high]):
            for row in (low, high):
                if row in asked:
                    why[row.name] = f"{said(low, after[low])} would not be below {said(high, after[high])}"
    return why
