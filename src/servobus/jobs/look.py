"""Looking at one servo: what it is, where it is, and whether it restarted."""

from servobus.core.exchange import Procedure, SetBaud
from servobus.core.units import show
from servobus.core.values import frozen
from servobus.errors import Restarted
from servobus.families.base import Family, Identity, KnownServo, ServoRef, TorqueState


@frozen
class Snapshot:
    """What one wants to see of a servo first."""

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

    def __str__(self) -> str:
        torque = TorqueState(self.torque, self.shutdown)
        return f"{show(self.position, 'rad')}, {show(self.voltage, 'V')}, {show(self.temperature, 'degC')}, {torque}"


def look(target: ServoRef) -> Procedure[Snapshot]:
    """Read position, voltage, temperature and torque."""
    family, shown = target.model.family, ("present_position", "present_voltage", "present_temperature")
    raw = yield from family.read_values(target, dict.fromkeys((*shown, *family.torque_rows)))
    position, voltage, temperature = (target.model.register(name).decode(raw[name]) for name in shown)
    torque = family.torque_state(raw)
    return Snapshot(position, voltage, temperature, torque.on, torque.shutdown)


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
