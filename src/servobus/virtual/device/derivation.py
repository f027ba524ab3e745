"""The motor of a model, worked out from the figures of its data sheet.

A DC motor with friction c and a gear that keeps the share l reaches, at a voltage V,

    stall torque    T = (1 - l) K V / R - c  =  a (V - V0)        a = (1 - l) K / R,  V0 = c / a
    speed           w = V / K - c / (a K)    =    (V - V0) / K
    stall current   I = V / R

So a data sheet fixes two ratios, torque to voltage and speed to voltage, and the stall current, where it is printed,
says how much of the torque the gear keeps. What a sheet does not say is taken over from a sibling:

    friction c    the share of the stall torque that it is there (at the highest voltage that is printed)
    gear loss l   as there, where no stall current is printed, or one that is less than torque and speed need
    inertia       J / (T / w) as there: then the bare shafts run up in the same time
    heat          heat capacities with the weight, thermal resistances with one over the surface, weight to the 2/3
    torque        where none is printed: it is the same motor behind another gear, so torque * speed is as there
    speed         where none is printed: that of the sibling at the highest voltage that is printed for either
    all           where neither is printed

Several points of a sheet are met by least squares of the relative errors. Points of which no motor meets all within
`TOLERANCE` contradict each other: then the motor meets as many as can be met, those nearest to the nominal voltage, and
leaves the others out.
"""

import itertools
import math
from collections.abc import Sequence

from servobus.core.values import frozen
from servobus.families.model import Performance, SpecSheet
from servobus.virtual.device.motor_set import HEAT, MotorSet, Origin, assumed, derived, motor_set, printed, taken_over
from servobus.virtual.physics.motor import MotorParams, no_load_speed, stall_torque

TOLERANCE = 0.02
"""How far, relative, a motor may be from a printed figure that it is said to meet."""
FRICTION = 0.02
"""Share of the stall torque; assumption, for a model without a sibling."""
RUN_UP = 0.010
"""s, the time constant of the bare shaft; assumption, for a model without a sibling."""

Line = tuple[float, float]
"""V, and the figure that is printed for it."""


@frozen
class Sibling:
    """A model from which something is taken over."""

    title: str
    motor: MotorSet
    voltage: float
    """The highest for which something is printed of it, or its supply, V."""
    weight: float | None
    """kg"""
    itself: bool = False
    """Whether it is the same model, of which another set is known."""
    why: str = ""
    """What makes the two alike."""

    def told(self, what: str) -> Origin:
        """Say that something is taken over from it."""
        name = f"the {self.title} itself as it was measured" if self.itself else f"the {self.title}"
        return taken_over(name + (f" ({self.why})" if self.why else ""), what)


def derive(
    title: str, sheet: SpecSheet, sibling: Sibling | None, friction: tuple[float, str] | None = None
) -> MotorSet:
    """Work out the motor of a model; friction is a share of the stall torque, and why it is assumed.

    Raises ValueError for a sheet that lacks a figure, where there is no sibling.
    """
    points = sheet.performance
    torques = [(at.voltage, at.stall_torque) for at in points if at.stall_torque is not None]
    speeds = [(at.voltage, at.speed) for at in points if at.speed is not None]
    if not torques and not speeds:
        return _all_of(title, sibling)
    top, nominal = max(volts for volts, _ in torques + speeds), sheet.supply or points[-1].voltage
    share, coulomb_from = _friction(sibling)
    if friction is not None:
        share, coulomb_from = friction[0], assumed(f"{friction[0]:.1%} of the stall torque, as {friction[1]}")
    idle = top * share / (1 + share)  # V0: what it takes to overcome the friction
    torque, torque_from = _ratio(torques, idle, nominal, "the stall torque")
    speed, speed_from = _ratio(speeds, idle, nominal, "the speed")
    if not torques:
        there = _named(title, sibling).motor.params
        # T w of the sibling, at the same voltage
        torque = stall_torque(there, top) * no_load_speed(there, top) / (speed * (top - idle) ** 2)
        torque_from = _named(title, sibling).told("torque times speed at the same voltage")
    if not speeds:
        known = _named(title, sibling)
        speed = no_load_speed(known.motor.params, known.voltage) / (top - idle)
        speed_from = known.told(f"the speed there at {known.voltage:g} V, at {top:g} V here")
    constant = 1 / speed
    gear_loss, gear_loss_from = _gear_loss(points, torque / constant, nominal, sibling)
    resistance_from = gear_loss_from if gear_loss_from.source == "derived" else torque_from
    return motor_set(
        MotorParams(
            gear_ratio=sheet.gear_ratio or 1,
            torque_constant=constant / (sheet.gear_ratio or 1),
            resistance=(1 - gear_loss) * constant / torque,
            gear_loss=gear_loss,
            coulomb=torque * idle,
            inertia=_inertia(torque * constant, sibling),
            **_heat(sheet.weight, sibling),
        ),
        "the maker's figures, through a motor that is worked out from them",
        gear_ratio=printed("the data sheet")
        if sheet.gear_ratio
        else assumed("not known; the gear is part of the torque constant"),
        torque_constant=speed_from,
        resistance=resistance_from,
        gear_loss=gear_loss_from,
        coulomb=coulomb_from,
        inertia=assumed(f"the bare shaft runs up in {RUN_UP * 1000:g} ms")
        if sibling is None
        else sibling.told("the same" if sibling.itself else "the time in which the bare shaft runs up"),
        heat=assumed("a small motor in a case of plastic")
        if sibling is None
        else sibling.told("how it warms, by the weight" if sheet.weight and sibling.weight else "how it warms"),
    )


def _named(title: str, sibling: Sibling | None) -> Sibling:
    if sibling is None:
        raise ValueError(
            f"the data sheet of the {title} lacks what a motor is made of, and no sibling is named: it takes a stall "
            "torque and a speed, or motor data of its own"
        )
    return sibling


def _all_of(title: str, sibling: Sibling | None) -> MotorSet:
    """Give the sibling's motor for a model of which no figure is known."""
    known = _named(title, sibling)
    origins = dict.fromkeys(known.motor.origins, known.told("the same"))
    return MotorSet(known.motor.params, origins, f"the motor of the {known.title}: no figure of its own is known")


def _friction(sibling: Sibling | None) -> tuple[float, Origin]:
    """Give friction as a share of the stall torque at the highest voltage."""
    if sibling is None:
        return FRICTION, assumed(f"{FRICTION:.0%} of the stall torque")
    there = sibling.motor.params
    share = there.coulomb / stall_torque(there, sibling.voltage)
    return share, sibling.told(f"the share of the stall torque, {share:.1%}")


def _gear_loss(
    points: Sequence[Performance], ideal: float, nominal: float, sibling: Sibling | None
) -> tuple[float, Origin]:
    """Give the share that the gear keeps; `ideal` is the conductance of a winding with a gear that keeps nothing."""
    currents = [(at.voltage, at.stall_current) for at in points if at.stall_current is not None]
    conductance, origin = _ratio(currents, 0.0, nominal, "the stall current")
    if currents and conductance >= ideal * (1 - TOLERANCE):
        return max(0.0, 1 - ideal / conductance), origin
    if sibling is None:
        return 0.0, assumed("a gear that keeps nothing")
    return sibling.motor.params.gear_loss, sibling.told("the same")


def _inertia(slope: float, sibling: Sibling | None) -> float:
    """Give the inertia for a slope of the line of torque over speed, N·m·s/rad."""
    if sibling is None:
        return RUN_UP * slope
    there = sibling.motor.params
    if sibling.itself:
        return there.inertia
    return there.inertia * slope / ((1 - there.gear_loss) * there.constant**2 / there.resistance)


def _heat(weight: float | None, sibling: Sibling | None) -> dict[str, float]:
    if sibling is None:
        return {}
    there = sibling.motor.params
    size = weight / sibling.weight if weight and sibling.weight else 1.0
    return {name: getattr(there, name) * (size if name.endswith("capacity") else size ** (-2 / 3)) for name in HEAT}


# Points


def met(lines: Sequence[Line], idle: float, nominal: float) -> list[Line]:
    """Give the most of these lines that one motor meets within TOLERANCE, those nearest to the nominal voltage.

    idle is the voltage at which the figure is 0: that which the friction takes.
    """
    for count in range(len(lines), 0, -1):
        fitting = [some for some in itertools.combinations(lines, count) if _spread(some, idle) <= _SPREAD]
        if fitting:
            return list(min(fitting, key=lambda some: sum(abs(volts - nominal) for volts, _ in some)))
    return []


_SPREAD = (1 + TOLERANCE) / (1 - TOLERANCE)
"""How many times the smallest the largest ratio can be, if one ratio is to be within TOLERANCE of all."""


def _spread(lines: Sequence[Line], idle: float) -> float:
    ratios = [figure / (volts - idle) for volts, figure in lines]
    return max(ratios) / min(ratios)


def _ratio(lines: Sequence[Line], idle: float, nominal: float, what: str) -> tuple[float, Origin]:
    """Give the ratio to the voltage that fits those lines best that one motor can meet, and say which these are.

    Least squares of the relative errors, and none of them beyond TOLERANCE. Without lines it is not a number.
    """
    fitting = met(lines, idle, nominal)
    if not fitting:
        return math.nan, assumed("")
    inverse = [(volts - idle) / figure for volts, figure in fitting]
    best = sum(inverse) / sum(part * part for part in inverse)
    best = min(max(best, (1 - TOLERANCE) / min(inverse)), (1 + TOLERANCE) / max(inverse))
    return best, derived(f"from {what} at {', '.join(f'{volts:g}' for volts, _ in fitting)} V")
