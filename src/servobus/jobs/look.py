"""Looking at one servo: what it is, where it is, and whether it restarted."""

import math
from typing import Any

from servobus.core.exchange import Procedure, SetBaud
from servobus.core.registers import Register
from servobus.core.units import Raw, show
from servobus.core.values import frozen
from servobus.errors import NoReply, Refused, Restarted
from servobus.families.base import Family, Identity, KnownServo, ServoRef, TorqueState


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
    """Whether it is driven."""
    shutdown: str = ""
    """What keeps its torque off until it is rearmed; "" if nothing does."""
    raw: tuple[int, int, int] | None = None
    """The raw values of the first three, where one of them has no unit."""

    @property
    def place(self) -> str:
        """Where the shaft is, such as "150.0°"; the raw value, such as "511 (raw)", where the unit is not known."""
        if self.raw is not None and math.isnan(self.position):
            return f"{self.raw[0]} (raw)"
        return show(self.position, "rad")

    def __str__(self) -> str:
        values = ((self.position, "rad", "position"), (self.voltage, "V", "supply"), (self.temperature, "degC", "heat"))
        raws = self.raw or (0, 0, 0)
        said = [
            f"{what} {raw} (raw)" if math.isnan(value) else show(value, unit)
            for (value, unit, what), raw in zip(values, raws, strict=True)
        ]
        return f"{', '.join(said)}, {TorqueState(self.torque, self.shutdown)}"


def look(target: ServoRef) -> Procedure[Snapshot]:
    """Read position, voltage, temperature and torque."""
    family, shown = target.model.family, ("present_position", "present_voltage", "present_temperature")
    raw = yield from family.read_values(target, dict.fromkeys((*shown, *family.torque_rows)))
    torque = family.torque_state(raw)
    rows = {name: target.model.register(name) for name in shown}
    position, voltage, temperature = (
        math.nan if isinstance(row.scale, Raw) else row.decode(raw[name], target) for name, row in rows.items()
    )
    first, second, third = (raw[name] for name in shown)
    without_unit = (first, second, third) if target.model.unscaled(*shown) else None
    return Snapshot(position, voltage, temperature, torque.on, torque.shutdown, without_unit)


def read_table(target: ServoRef) -> Procedure[dict[Register[Any], int | None]]:
    """Read every register that can be read, raw; None for one that this servo lacks, for there are such.

    They are read one by one where reading them together fails. Raises NoReply or Refused if none could be read.
    """
    rows = [row for row in target.model.registers.values() if row.readable]
    family = target.model.family
    try:
        return dict(zip(rows, (yield from family.read(target, rows)), strict=True))
    except (NoReply, Refused) as error:
        first = error
    raws: dict[Register[Any], int | None] = {}
    for row in rows:
        try:
            (raws[row],) = yield from family.read(target, [row])
        except (NoReply, Refused):
            raws[row] = None
    if all(raw is None for raw in raws.values()):
        raise first
    return raws


def identify_at(family: Family, id: int, baud: int) -> Procedure[Identity]:
    """Ask a servo at a given speed what it is, and how it answers."""
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
