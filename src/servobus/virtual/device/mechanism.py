"""Servos that move the links of one arm, so that each feels the others.

The servos of a mechanism live in step, tick by tick: before each tick every shaft is told what it bears, which follows
from where all of them are and how they move (`servobus.virtual.physics.linkage`). They may be on several ports: whoever
brings one of them up to now brings all of them, and so the threads that serve these ports share a lock, see
`servobus.virtual.serve.rig`. Servos without supply fall as limp ones do.

What a joint feels of the acceleration of another one has to be known before both take their tick. So all first foresee
theirs, one after the other, and then take it in the same order: two rounds of the method of Gauss and Seidel, which
comes closer to the answer with each, from tick to tick too, because the matrix of inertias is symmetric and positive.
Gravity and what speeds do are taken from the middle of the tick.

Several servos on one joint are held together by a stiff spring with damping between their horns, and share its link.

On a virtual clock ports are used one after the other, each from the same moment. All servos live in step up to where
the port is that is last; a servo that is asked later than that goes ahead, and the others catch up.
"""

import math
from collections.abc import Callable, Sequence

from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.physics.linkage import Felt, Link, Linkage

STEP = 0.002
"""s in which all take a tick; the ticks of servos are of 2 and of 2.8 ms."""
EXACT = 1e-6
"""Share of a step that a time may miss by rounding."""
STANDING = 25
"""Steps that servos which all stand still take at once, if something may start to move by itself."""
CLOSE = 0.01
"""Share by which an inertia may change before a shaft is prepared for another one; the rest is felt as a torque."""
STIFFNESS = 0.25
"""Square of the phase in rad by which two bare rotors, coupled by their spring, go on in a step: below 1 it is stable.
Assumption: real horns are stiffer, and nobody could tell."""
DAMPING = 2.0
"""Steps in which the damping between two horns does what their spring does: the rotors are damped by half."""
ALONE = (0.0,)


class Seat:
    """A servo in a mechanism.

    port  whatever names its port: servos of one port are asked at one time
    zero  angle of the servo, rad, where the joint is at 0
    gear  rad of the servo for one of the joint, negative where it turns the other way round
    """

    def __init__(self, servo: VirtualServo, port: str, *, zero: float = 0.0, gear: float = 1.0) -> None:
        self.servo, self.port, self.zero, self.gear = servo, port, zero, gear
        self.shaft = servo.shaft
        self.acceleration = 0.0
        """Of the joint in the latest tick of this servo, rad/s²."""
        self._borne = 0.0

    @property
    def angle(self) -> float:
        """Angle of the joint as this servo has it, rad."""
        return (self.shaft.position - self.zero) / self.gear

    @property
    def speed(self) -> float:
        """Speed of the joint as this servo has it, rad/s."""
        return self.shaft.velocity / self.gear

    @property
    def rotor(self) -> float:
        """Inertia of the motor as the joint feels it, kg·m²."""
        return self.shaft.motor.inertia * self.gear**2

    def bear(self, inertia: float, torque: float) -> None:
        """Feel an inertia and a torque at the joint."""
        gear, shaft = self.gear, self.shaft
        turned = inertia / (gear * gear)
        if abs(turned - self._borne) > CLOSE * (turned + shaft.motor.inertia):
            self._borne = turned
        shaft.bear(self._borne, torque / gear - (turned - self._borne) * self.acceleration * gear)

    def foresee(self) -> None:
        """Find out how the joint will be accelerated in the next tick."""
        self.acceleration = self.shaft.foresee() / self.gear

    def live(self, before: float, now: float) -> None:
        """Let time pass."""
        servo, shaft = self.servo, self.shaft
        speed = shaft.velocity
        if servo.powered:
            ticks = servo.live(now)
        elif ticks := math.floor(now / servo.tick + EXACT) - math.floor(before / servo.tick + EXACT):
            shaft.tick(ticks)
        if ticks:
            self.acceleration = (shaft.velocity - speed) / (ticks * servo.tick * self.gear)


class Mechanism:
    """Joints with their links, and the one or more servos of each; each joint stands behind its parent.

    `in_turn` tells that the clocks of the ports stand still while another port is used.
    """

    def __init__(self, links: Sequence[Link], seats: Sequence[Sequence[Seat]], *, in_turn: bool) -> None:
        self._linkage = Linkage(links)
        self._joints = [list(joint) for joint in seats]
        self._seats = [seat for joint in self._joints for seat in joint]
        self._ports = {seat.servo: seat.port for seat in self._seats}
        self._in_turn = in_turn
        self._told = dict.fromkeys(self._ports.values(), 0.0)
        """Port -> time up to which it has been used."""
        self._accelerations = [0.0] * len(self._joints)
        self._steps = 0
        for servo in self._ports:
            servo.company = self
        self._round(self._feel(), Seat.foresee)

    @property
    def time(self) -> float:
        """Time up to which all have lived in step, s."""
        return self._steps * STEP

    def advance(self, servo: VirtualServo, now: float) -> None:
        """Bring a servo up to now, and the others as far as their ports are."""
        self.let_pass(servo, now)
        if now - self.time >= STEP:
            servo.live(now)

    def let_pass(self, servo: VirtualServo, now: float) -> None:
        """Let time pass on the port of a servo."""
        port = self._ports[servo]
        self._told[port] = max(self._told[port], now)
        end = math.floor((min(self._told.values()) if self._in_turn else now) / STEP + EXACT)
        while self._steps < end:
            self._step(end - self._steps)

    def _step(self, most: int) -> None:
        """Take one step, or up to so many at once while all stand still."""
        felt = self._feel()
        before = self.time
        if not self._standing:
            self._steps += 1
            self._round(felt, Seat.foresee)
        else:
            self._steps += min(most, STANDING) if self._loaded else most
        now = self.time
        self._round(felt, lambda seat: seat.live(before, now))

    def _feel(self) -> Felt:
        """Find out what the joints will feel in the middle of the next tick."""
        angles, speeds = [], []
        for seats, acceleration in zip(self._joints, self._accelerations, strict=True):
            speed = sum([seat.speed for seat in seats]) / len(seats)
            angles.append(sum([seat.angle for seat in seats]) / len(seats) + STEP / 2 * speed)
            speeds.append(speed + STEP / 2 * acceleration)
        return self._linkage.feel(angles, speeds)

    def _round(self, felt: Felt, act: Callable[[Seat], None]) -> None:
        """Let each joint in its turn feel what all others do, and act."""
        accelerations = self._accelerations
        for joint, (seats, row) in enumerate(zip(self._joints, felt.inertia, strict=True)):
            torque = felt.torque[joint] + row[joint] * accelerations[joint]
            for inertia, acceleration in zip(row, accelerations, strict=True):
                torque -= inertia * acceleration
            share = len(seats)
            for seat, spring in zip(seats, _springs(seats), strict=True):
                seat.bear(row[joint] / share, torque / share + spring)
            for seat in seats:
                act(seat)
            accelerations[joint] = sum([seat.acceleration for seat in seats]) / share

    @property
    def _standing(self) -> bool:
        return all(seat.shaft.at_rest and not seat.acceleration for seat in self._seats)

    @property
    def _loaded(self) -> bool:
        """Whether the motor of any is on, whose firmware may do something by itself."""
        return any(seat.servo.powered and seat.servo.torque for seat in self._seats)


def _springs(seats: Sequence[Seat]) -> Sequence[float]:
    """Give the torques between the horns of servos on one joint, at the joint, N·m."""
    if len(seats) == 1:
        return ALONE
    first, second = seats
    stiffness = STIFFNESS / STEP**2 * first.rotor * second.rotor / (first.rotor + second.rotor)
    apart = first.angle - second.angle + DAMPING * STEP * (first.speed - second.speed)
    return [-stiffness * apart, stiffness * apart]
