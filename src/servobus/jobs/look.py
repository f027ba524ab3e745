"""Looking at one servo: what it is, where it is, and whether it restarted."""

import math

from servobus.core.exchange import Procedure, SetBaud
from servobus.core.units import Raw, show
from servobus.core.values import frozen
from servobus.errors import Restarted
from servobus.families.base import Family, Identity, KnownServo, ServoRef


@frozen
class Snapshot:
    """What one wants to see of a servo first. NaN stands where the model, and so the unit, is not known."""

    position: float
    """rad"""
    voltage: float
    """V"""
    temperature: float
    """°C"""
    torque: bool
    raw: tuple[int, int, int] | None = None
    """The raw values of the first three, where one of them has no unit."""

    def __str__(self) -> str:
        values = ((self.position, "rad", "position"), (self.voltage, "V", "supply"), (self.temperature, "degC", "heat"))
        raws = self.raw or (0, 0, 0)
        said = [
            f"{what} {raw} (raw)" if math.isnan(value) else show(value, unit)
            for (value, unit, what), raw in zip(values, raws, strict=True)
        ]
        return f"{', '.join(said)}, torque {'on' if self.torque else 'off'}"


def look(target: ServoRef) -> Procedure[Snapshot]:
    """Read position, voltage, temperature and torque."""
    names = ("present_position", "present_voltage", "present_temperature", "torque_enable")
    rows = [target.model.register(name) for name in names]
    raw = yield from target.model.family.read(target, rows)
    torque = target.model.family.torque_on(raw[3])
    position, voltage, temperature = (
        math.nan if isinstance(row.scale, Raw) else row.decode(value, target)
        for row, value in zip(rows[:3], raw, strict=False)
    )
    without_unit = (raw[0], raw[1], raw[2]) if target.model.unscaled(*names[:3]) else None
    return Snapshot(position, voltage, temperature, torque, without_unit)


def identify_at(family: Family, id: int, baud: int) -> Procedure[Identity]:
    """Ask a servo who it is, at a given speed."""
    yield SetBaud(baud)
    return (yield from family.identify(id))


def verify(target: KnownServo) -> Procedure[None]:
    """Compare what was set in the servo's RAM, torque included, with what it holds. Raises Restarted.

    Without anything set so far nothing can be told. A servo whose torque is off because of an alarm has not
    restarted.
    """
    record, family = target.record, target.model.family
    if not record.ram:
        return
    rows = list(record.ram)
    raws = yield from family.read(target, rows)
    lost = {row: raw for row, raw in zip(rows, raws, strict=True) if raw != record.ram[row]}
    torque = target.model.register("torque_enable")
    if torque in lost and family.torque_on(record.ram[torque]) and not family.torque_on(lost[torque]):
        alone = len(lost) == 1
        if alone and (yield from family.read_alarms(target)):
            return
    if not lost:
        return
    said = ", ".join(
        f"{row.name} is {row.said(raw)}, was set to {row.said(record.ram[row])}" for row, raw in lost.items()
    )
    record.forget()
    record.restarted = True
    raise Restarted(
        f"{target} has lost what was set in it: it restarted, a write was lost, or another program changed it "
        f"({said}). Set it up again; it moves after torque_on() or rearm()"
    )
