"""The printed figures of every model, measured on a bench: a servo on a bus, a tachometer and weights on its horn."""

from collections.abc import Iterator

import pytest

import extent
import servobus
from samples import has, turning
from servobus import MODELS
from servobus.core.units import Quantity
from servobus.families.base import Model
from servobus.families.model import Performance
from servobus.virtual.device.motors import motor
from servobus.virtual.device.servo import virtual_servo
from servobus.virtual.physics.motor import Load, no_load_speed, stall_torque
from servobus.virtual.serve.inprocess import VirtualPort
from servobus.virtual.serve.rig import Rig
from servobus.virtual.wire.line import VirtualLine

WITHIN = 0.02
"""How far a motor may be from a printed figure."""


def measured() -> list[str]:
    """Give all models with `--all`; else the one of each series of which the most is printed."""
    keys = [key for key, model in MODELS.items() if model.firmware]
    if extent.everything:
        return keys
    best: dict[tuple[str, str], str] = {}
    for key in sorted(keys, key=lambda key: -printed(MODELS[key])):
        best.setdefault((MODELS[key].family.name, MODELS[key].series), key)
    return list(best.values())


def printed(model: type[Model]) -> int:
    """Count the figures that are printed of a model."""
    return sum((at.stall_torque is not None) + (at.speed is not None) for at in model.sheet.performance)


def points() -> Iterator[tuple[str, Performance]]:
    """Give the lines of the data sheets of these models."""
    for key in measured():
        yield from ((key, at) for at in MODELS[key].sheet.performance)


def label(point: tuple[str, Performance]) -> str:
    return f"{point[0]}-{point[1].voltage:g}V"


def near(figure: float, reached: float) -> bool:
    return abs(reached / figure - 1) <= WITHIN


# Figures that contradict others of their sheet are left out: tests/unit/virtual/device/test_motors.py shows that no
# motor meets them too.
SPEEDS = [
    (key, at)
    for key, at in points()
    if at.speed is not None and near(at.speed, no_load_speed(motor(MODELS[key]), at.voltage))
]
TORQUES = [
    (key, at)
    for key, at in points()
    if at.stall_torque is not None and near(at.stall_torque, stall_torque(motor(MODELS[key]), at.voltage))
]


class Bench:
    """One servo at a supply that it takes for good, on a virtual clock."""

    def __init__(self, model: type[Model], volts: float) -> None:
        self.model = model
        low, high = model.register("min_voltage"), model.register("max_voltage")
        settings = {low.name: low.limits[0], high.name: high.limits[1]}
        if has(model, "overload_detection_period"):
            settings["overload_detection_period"] = 0  # for these full output is an overload, even without a load
        if has(model, "max_torque"):
            settings["max_torque"] = model.register("max_torque").limits[1]  # some give less from the factory
        self.real = virtual_servo(model, 1, voltage=volts, memory=settings, position=self.low_end)
        self.port = VirtualPort("virtual:", Rig([VirtualLine([self.real])]), real=False)
        self.arm = servobus.Bus(self.port, echo=False).attach(model, 1)

    @property
    def low_end(self) -> float:
        row = self.model.register("min_position")
        return float(row.decode(row.default or 0))

    def drive(self) -> None:
        """Give all there is, towards larger positions."""
        self.arm.torque_on()
        if self.turns:
            self.arm.turn(**turning(self.model, self.most))
            return
        # A goal far away, at the speed 0, which is uncontrolled full speed.
        self.arm.write(self.model.register("goal_speed"), 0.0)
        row = self.model.register("max_position")
        self.arm.write(self.model.register("goal_position"), row.decode(row.default or 0))

    @property
    def turns(self) -> bool:
        return getattr(self.model, "turns", True)

    @property
    def most(self) -> float:
        """The highest speed or output that the servo can be told."""
        if not self.model.turns_at_speed():
            return 1.0
        scale = self.model.turn_scale
        assert isinstance(scale, Quantity)
        return 1023 * scale.step

    def speed(self) -> tuple[float, float]:
        """Give what the tachometer shows when the servo has run up, and how much that changes still, rad/s."""
        run_up, watched = (0.6, 0.2) if self.turns else (0.25, 0.1)  # s
        self.drive()
        for _ in range(50):
            if self.real.shaft.duty == 1 or not self.turns:
                break
            self.port.sleep(0.02)  # a controller of the speed needs time until it gives all there is
        self.port.sleep(run_up)
        there = self.real.shaft.position
        self.port.sleep(watched)
        return (self.real.shaft.position - there) / watched, self.real.shaft.velocity

    def lifts(self, torque: float) -> bool:
        """Tell whether it moves a load: the horn is held until it pushes in full, and the motor is still cold then."""
        self.real.shaft.load = Load(blocked=1)
        self.drive()
        self.port.sleep(0.3)
        self.real.shaft.soak(25.0)
        self.real.shaft.load = Load(torque=-torque)
        there = self.real.shaft.position
        self.port.sleep(0.02)
        return self.real.shaft.position > there


@pytest.mark.parametrize("point", SPEEDS, ids=map(label, SPEEDS))
def test_without_load_it_turns_as_fast_as_printed(point: tuple[str, Performance]) -> None:
    key, at = point
    bench = Bench(MODELS[key], at.voltage)
    speed, in_the_end = bench.speed()
    assert speed == pytest.approx(at.speed, rel=WITHIN)
    assert in_the_end == pytest.approx(at.speed, rel=WITHIN)
    if has(bench.model, "present_speed"):
        row = bench.model.register("present_speed")
        assert isinstance(row.scale, Quantity)
        most = row.scale.decode(row.limits[1])
        assert bench.arm.read(row) == pytest.approx(min(speed, most), abs=WITHIN * speed + row.scale.step)


@pytest.mark.parametrize("point", TORQUES, ids=map(label, TORQUES))
def test_it_lifts_what_is_just_below_the_printed_torque_and_no_more(point: tuple[str, Performance]) -> None:
    key, at = point
    assert at.stall_torque is not None
    assert Bench(MODELS[key], at.voltage).lifts(at.stall_torque * (1 - WITHIN))
    assert not Bench(MODELS[key], at.voltage).lifts(at.stall_torque * (1 + WITHIN))
