"""A geared brushed DC motor with its load, its supply and its heat: numbers in, numbers out.

    frame     everything is seen at the output shaft: positions, speeds, torques, inertias
    sign      positive speed, current, duty and torque turn the shaft towards larger positions; a torque is positive
              if it pushes that way, whatever exerts it
    units     rad, rad/s, N·m, kg·m², V, A, ohm, s, degC, K/W, J/K; duty is -1 .. 1 of the supply voltage

    current       i = (duty * supply - K w) / R          K = gear ratio * torque constant; inductance is neglected
    motion        J dw/dt = K i - viscous w - friction + gravity + torque
    friction      at most  coulomb + stiction / (1 + (w / stribeck)²) + gear_loss |K i|,  against the motion, and no
                  more than stops it: a shaft at rest stays there, to the last bit, until more than that pushes
    gravity       -mass g length cos(tilt) sin(position - down)
    heat          i² R -> winding -> case -> ambient; R grows with the winding's temperature

The gear takes its share of the motor's torque in both directions: a motor that drives gives K i (1 - gear_loss) to
the shaft, a motor that is driven holds back K i (1 + gear_loss). So a loss never feeds the motion.

What is slow (exponentials, settings) is in `prepare`, what every tick costs is in `step`. The step has no branch on
data: it picks coefficients from tables and cuts with abs() and copysign(), so that arrays can take the place of
numbers.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from math import copysign, sin
from typing import TypeAlias

GRAVITY = 9.80665
"""m/s²"""
REFERENCE = 25.0
"""degC at which the resistance of a winding is given."""
COPPER = 0.0039
"""1/K: how the resistance of copper grows, from REFERENCE."""

OPEN, CLOSED = 0, 1
"""What the bridge does with the winding: leaves it open (a free shaft), or closes it through the bridge, which
drives at its duty, and brakes at duty 0 because both ends of the winding then meet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorParams:
    """What is in the case. Everything but gear ratio and torque constant is as seen at the output shaft."""

    gear_ratio: float
    torque_constant: float  # N·m/A of the motor alone; V·s/rad is the same
    resistance: float  # ohm at REFERENCE, of winding, brushes and bridge
    inertia: float  # kg·m² of the rotor, through the gear
    coulomb: float = 0.0  # N·m of friction that does not depend on speed or load
    viscous: float = 0.0  # N·m·s/rad
    stiction: float = 0.0  # N·m more than `coulomb` at rest
    stribeck: float = 0.1  # rad/s at which half of `stiction` is left
    gear_loss: float = 0.0  # share of the motor's torque that the gear keeps, 0 .. below 1
    backlash: float = 0.0  # rad that the output can turn while the gear stands
    low_stop: float = -math.inf  # rad
    high_stop: float = math.inf  # rad
    winding_to_case: float = 10.0  # K/W
    case_to_ambient: float = 30.0  # K/W
    winding_capacity: float = 0.5  # J/K
    case_capacity: float = 9.0  # J/K
    copper: float = COPPER  # 1/K; 0 keeps the resistance constant

    def __post_init__(self) -> None:
        if min(self.gear_ratio, self.torque_constant, self.resistance, self.inertia) <= 0:
            raise ValueError("gear ratio, torque constant, resistance and inertia must be positive")
        if not 0 <= self.gear_loss < 1:
            raise ValueError("the gear can keep a share from 0 to below 1 of the torque")
        if min(self.coulomb, self.viscous, self.stiction, self.backlash) < 0 or self.stribeck <= 0:
            raise ValueError("friction and backlash cannot be negative")
        if self.low_stop >= self.high_stop:
            raise ValueError("the low stop must be below the high one")

    @property
    def constant(self) -> float:
        """Torque constant at the output, N·m/A, which is also its back-emf in V·s/rad."""
        return self.gear_ratio * self.torque_constant

    def resistance_at(self, winding: float) -> float:
        """Resistance in ohm with the winding at a temperature in degC."""
        return self.resistance * (1 + self.copper * (winding - REFERENCE))


@dataclass(slots=True)
class MotorState:
    """What changes. `step` and `warm` change it in place, because 254 of them are stepped every millisecond."""

    position: float = 0.0  # rad, of the last wheel of the gear; counted on beyond full turns
    velocity: float = 0.0  # rad/s
    current: float = 0.0  # A, through the winding
    winding: float = REFERENCE  # degC
    case: float = REFERENCE  # degC, what the sensor of a servo measures
    heat: float = 0.0  # J put into the winding since `warm` last took them
    play: float = 0.0  # rad by which the output is ahead of the gear, at most half the backlash either way

    @property
    def output(self) -> float:
        """Position of the horn, and of a sensor on the output shaft, rad."""
        return self.position + self.play


@dataclass(frozen=True, slots=True)
class Load:
    """What hangs on the shaft: an inertia, an arm with a mass at its end, a torque, or a vice."""

    inertia: float = 0.0  # kg·m², the arm's mass not counted
    mass: float = 0.0  # kg, at the end of the arm
    length: float = 0.0  # m, from the axis to the mass
    down: float = 0.0  # rad, where the shaft is when the arm hangs straight down
    tilt: float = 0.0  # rad between the axis and the horizontal: 0 lets gravity pull in full, pi/2 not at all
    torque: float = 0.0  # N·m from outside
    blocked: float = 0.0  # 1 holds the shaft where it is, 0 lets it turn

    @property
    def pull(self) -> float:
        """Largest torque of gravity, N·m."""
        return self.mass * GRAVITY * self.length * math.cos(self.tilt)

    @property
    def total_inertia(self) -> float:
        """kg·m², with the mass on the arm."""
        return self.inertia + self.mass * self.length**2


NOTHING = Load()
"""A bare shaft."""

TINY = 1e-300
"""Counts only beside a plain 0: keeps 0 / 0 at 0."""

Side: TypeAlias = tuple[float, float, float, float, float]
"""decay, gain, share of the motor's torque that arrives, weights of the old and the new velocity in the way."""
Circuit: TypeAlias = tuple[
    float, float, float, float, tuple[Side, Side], tuple[tuple[float, float], tuple[float, float]],
    float, float, float, float, float, float, float, float, MotorParams, bool,
]  # fmt: skip
"""What `step` unpacks, in its order."""


@dataclass(frozen=True, slots=True)
class MotionPlan:
    """What `step` needs to know; good until the parameters, the load, dt or the winding's temperature change."""

    circuits: tuple[Circuit, Circuit]  # with the winding OPEN and CLOSED
    resistance: float  # ohm, at the winding's temperature
    constant: float  # N·m/A; times the velocity it is the back-emf


def prepare(params: MotorParams, load: Load = NOTHING, *, dt: float, winding: float = REFERENCE) -> MotionPlan:
    """Work out the coefficients of `step` for steps of dt seconds and a winding at a temperature in degC."""
    resistance = params.resistance_at(winding)
    opened, closed = _circuit(params, load, dt, 0.0, 0.0), _circuit(params, load, dt, 1 / resistance, resistance)
    return MotionPlan((opened, closed), resistance, params.constant)


def _circuit(params: MotorParams, load: Load, dt: float, conductance: float, resistance: float) -> Circuit:
    constant, inertia, loose = params.constant, params.inertia + load.total_inertia, 1 - load.blocked
    damping = constant * constant * conductance
    driving = _exponential(1 - params.gear_loss, damping, params.viscous, inertia, dt, loose)
    driven = _exponential(1 + params.gear_loss, damping, params.viscous, inertia, dt, loose)
    # Where gravity is felt: halfway, as if nothing but the motor and the oil slowed the shaft.
    half = dt / 2 * _slope((damping + params.viscous) / inertia * dt / 2) * loose
    confined = params.backlash > 0 or not math.isinf(params.low_stop) or not math.isinf(params.high_stop)
    return (
        conductance, constant, constant * conductance, damping, (driving, driven), (driving[1:3], driven[1:3]),
        half, load.pull, load.down, load.torque, params.coulomb, params.stiction, 1 / params.stribeck,
        resistance * dt, params, confined,
    )  # fmt: skip


def _slope(z: float) -> float:
    """Give (1 - exp(-z)) / z."""
    return -math.expm1(-z) / z if z else 1.0


def _exponential(share: float, damping: float, viscous: float, inertia: float, dt: float, loose: float) -> Side:
    """Solve J dw/dt = torque - (share damping + viscous) w over dt, for any constant torque.

    The velocity becomes  decay w0 + gain torque, and the way is  early w0 + late w1, whatever the torque was.
    The weights are the trapezium's, 1/2 and 1/2, for a slow decay and lean towards w1 for a fast one. Having the way
    from the velocities alone is what makes a shaft whose velocity was 0 and stays 0 not move at all.
    """
    z = (share * damping + viscous) / inertia * dt
    # Below 0.02 the difference of two large numbers is worse than three terms of its series.
    late = 1 / 2 + z / 12 - z**3 / 720 if z < 0.02 else -1 / math.expm1(-z) - 1 / z
    decay, gain = math.exp(-z), _slope(z) * dt / inertia
    return (
        decay * loose,
        gain * loose,
        share,
        (1 - late) * dt * loose,
        late * dt * loose,
    )


def step(
    plan: MotionPlan, state: MotorState, duty: float, voltage: float, closed: int = CLOSED, torque: float = 0.0
) -> None:
    """Let the plan's dt pass, in place.

    duty     -1 .. 1, of the supply voltage; 0 brakes
    voltage  of the supply, V
    closed   CLOSED or OPEN
    torque   on the shaft during this step, N·m, on top of the load's

    Damping, Coulomb friction and gear loss are exact while no direction changes, and of second order where one does.
    Gravity acts as drift, kick, drift, which neither gains nor loses energy in the long run.
    """
    (
        conductance, constant, fall, damping, sides, starts,
        half, pull, down, push, coulomb, stiction, sharpness, heating, params, confined,
    ) = plan.circuits[closed]  # fmt: skip
    before, start = state.velocity, state.position
    stalled = duty * voltage * conductance
    drive = constant * stalled
    load = push + torque - pull * sin(start + half * before - down)
    slip = sharpness * before
    friction = coulomb + stiction / (1.0 + slip * slip)
    # On in the same sense; from rest, in that of what pushes. The positive part of x is (x + |x|) / 2.
    sense, speed = copysign(1.0, before + TINY * (drive + load)), abs(before)
    decay, gain, share, early, late = sides[(drive - damping * before) * sense < 0]
    ahead = decay * speed + gain * (sense * (share * drive + load) - friction)
    kept = 0.5 * (ahead + abs(ahead))
    # If that is below 0 the shaft stopped on the way. For what is left of the step it may start the other way, against
    # friction that has turned too; if that is too hard as well, it rests.
    missing = kept - ahead
    left = missing / (missing + decay * speed + TINY)
    gain, share = starts[drive * sense > 0]
    back = gain * (-sense * (share * drive + load) - friction)
    back = 0.5 * left * (back + abs(back))
    after = sense * (kept - back)
    end = start + early * before * (1.0 - left) + late * sense * (kept - left * back)
    if confined:
        end, after = _confine(params, state, end, after)
    state.position = end
    state.velocity = after
    state.current = current = stalled - fall * after
    state.heat += heating * current * current


def _confine(params: MotorParams, state: MotorState, end: float, velocity: float) -> tuple[float, float]:
    """Let hard stops, without bounce, and backlash act on a step to a position; give position and velocity.

    Within the play the load stays where it is, by friction of its own, until the gear takes it along. Its inertia is
    felt by the motor all the same (assumption: the play is small against any move).
    """
    there = min(max(end, params.low_stop), params.high_stop)
    half = params.backlash / 2
    state.play = min(max(state.play - (there - state.position), -half), half)
    return there, velocity * (there == end)


# Heat


def temperatures(
    params: MotorParams, winding: float, case: float, power: float, ambient: float, dt: float
) -> tuple[float, float]:
    """Give the temperatures in degC of winding and case after dt seconds with a constant power in W into the winding.

    Exact for any dt. The heat of friction is left out: it is small, and arises in the gear.
    """
    inner, outer = params.winding_to_case, params.case_to_ambient
    a, b = 1 / (inner * params.winding_capacity), 1 / (inner * params.case_capacity)
    c = b + 1 / (outer * params.case_capacity)
    # Eigenvalues of the rate matrix ((-a, a), (b, -c)), both negative and never equal, as a b > 0.
    middle, spread = (a + c) / 2, math.sqrt(((a - c) / 2) ** 2 + a * b)
    slow, fast = (a * c - a * b) / (middle + spread), middle + spread
    u, v = math.exp(-slow * dt), math.exp(-fast * dt)
    end_case = ambient + power * outer
    end_winding = end_case + power * inner
    x, y = winding - end_winding, case - end_case
    same, other = (u * (fast - middle) + v * (middle - slow)) / (fast - slow), (u - v) / (fast - slow)
    return (
        end_winding + same * x + other * ((middle - a) * x + a * y),
        end_case + same * y + other * (b * x + (middle - c) * y),
    )


def warm(params: MotorParams, state: MotorState, ambient: float, dt: float) -> None:
    """Let the heat of the last dt seconds flow, in place: every tenth of a second will do.

    The resistance follows with the next `prepare`.
    """
    power, state.heat = state.heat / dt, 0.0
    state.winding, state.case = temperatures(params, state.winding, state.case, power, ambient, dt)


# Supply


def line_voltage(source: float, resistance: float, conductance: float, fed: float) -> float:
    """Give the voltage in V on a line: sums over its motors of duty²/resistance (1/ohm) and of what they feed back (A).

    Never negative, and never above the source's.
    """
    return max(0.0, min((source + resistance * fed) / (1 + resistance * conductance), source))


@dataclass(frozen=True, slots=True)
class Supply:
    """A battery or power supply that all servos of a line share."""

    source: float  # V without load
    resistance: float = 0.0  # ohm: inside, and of the wires

    def voltage(self, motors: Iterable[tuple[float, float, float]], standby: float = 0.0) -> float:
        """Give the voltage in V on the line for (duty, back-emf in V, resistance in ohm) of every closed winding.

        A bridge draws duty * current, and the current is linear in the voltage, so that this needs no iteration.
        standby is what the electronics draw, A. Current that is fed back serves the other motors; what they do not
        want the source swallows, without a rise of its voltage. The voltage is never negative either.
        """
        conductance, fed = 0.0, -standby
        for duty, emf, resistance in motors:
            share = duty / resistance
            conductance += share * duty
            fed += share * emf
        return line_voltage(self.source, self.resistance, conductance, fed)


# Steady state: the line on the motor's data sheet


def stall_torque(params: MotorParams, voltage: float, winding: float = REFERENCE) -> float:
    """Torque in N·m with which a shaft that is held pushes, at a voltage (duty * supply)."""
    return shaft_torque(params, voltage / params.resistance_at(winding))


def no_load_speed(params: MotorParams, voltage: float, winding: float = REFERENCE) -> float:
    """Speed in rad/s of a shaft with nothing on it, at a voltage (duty * supply)."""
    return operating_point(params, voltage, winding=winding)[0]


def operating_point(
    params: MotorParams, voltage: float, torque: float = 0.0, winding: float = REFERENCE
) -> tuple[float, float]:
    """Steady speed in rad/s and current in A at a voltage (duty * supply) under a constant torque from outside.

    A torque against the motor has the other sign than the voltage. Away from rest `stiction` is taken as gone.
    """
    constant, stalled = params.constant, voltage / params.resistance_at(winding)
    damping = constant**2 / params.resistance_at(winding)
    idle = voltage / constant  # the speed without current
    for sense in (1.0, -1.0):
        # What is left at the idle speed tells whether the motor will have to drive, or is driven beyond it.
        driven = sense * (torque - params.viscous * idle) > params.coulomb
        share = 1 + params.gear_loss if driven else 1 - params.gear_loss
        push = share * constant * stalled + torque - sense * params.coulomb
        if sense * push > 0:
            speed = push / (share * damping + params.viscous)
            return speed, stalled - damping * speed / constant
    return 0.0, stalled


def shaft_torque(params: MotorParams, current: float, speed: float = 0.0) -> float:
    """Torque in N·m that arrives at the shaft with a current in A: what a firmware can know of its load.

    At rest friction could be anything up to its limit: what is left if it all acts against the motor is given.
    """
    motor = params.constant * current
    if not speed:
        return copysign(max(0.0, abs(motor) * (1 - params.gear_loss) - params.coulomb), motor)
    sense = copysign(1.0, speed)
    return motor - sense * (params.gear_loss * abs(motor) + params.coulomb) - params.viscous * speed
