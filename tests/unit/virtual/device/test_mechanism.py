"""Servos that move the links of one arm: each feels the others, tick by tick."""

import math
from collections.abc import Sequence

import pytest

from servobus import MODELS, RX28
from servobus.core.units import deg
from servobus.virtual.device.mechanism import STEP, Mechanism, Seat
from servobus.virtual.device.servo import VirtualServo, virtual_servo
from servobus.virtual.physics.linkage import Link

G = 9.80665
MIDDLE = 150 * deg
M1, L1, M2, L2 = 0.25, 0.15, 0.15, 0.12
ROTOR = 0.0032  # kg·m², as the motor data of the RX-28 say


class TwoLinks:
    """A limp arm of two RX-28, whose joints are at 0 in the middle of the servos' range, where it hangs down."""

    def __init__(self, angles: tuple[float, float], *, motor: str = "manual", gears: Sequence[float] = (1, 1)) -> None:
        self.gears = gears
        self.servos = [
            virtual_servo(RX28, n + 1, position=MIDDLE + gear * angle, motor_set=motor)
            for n, (angle, gear) in enumerate(zip(angles, gears, strict=True))
        ]
        self.mechanism = Mechanism(
            [Link(mass=M1, length=L1, down=0.0), Link(mass=M2, length=L2, down=0.0, parent=0)],
            [[Seat(servo, "a", zero=MIDDLE, gear=gear)] for servo, gear in zip(self.servos, gears, strict=True)],
            in_turn=False,
        )

    def let_pass(self, seconds: float) -> None:
        self.servos[0].advance(self.mechanism.time + seconds)

    @property
    def angles(self) -> list[float]:
        return [(servo.position - MIDDLE) / gear for servo, gear in zip(self.servos, self.gears, strict=True)]

    @property
    def energy(self) -> float:
        """Of links and rotors, J; 0 where it lies level and still."""
        a, b = self.angles
        v, w = (servo.shaft.velocity / gear for servo, gear in zip(self.servos, self.gears, strict=True))
        outer = v + w
        speed = (L1 * v) ** 2 + (L2 * outer) ** 2 + 2 * L1 * v * L2 * outer * math.cos(b)
        rotors = ROTOR * (self.gears[0] ** 2 * v * v + self.gears[1] ** 2 * w * w) / 2
        height = -M1 * L1 * math.cos(a) - M2 * (L1 * math.cos(a) + L2 * math.cos(a + b))
        return M1 * (L1 * v) ** 2 / 2 + M2 * speed / 2 + rotors + G * height


def pendulum(state: list[float]) -> list[float]:
    """Give the rates of angles and speeds of a double pendulum with rotors, as textbooks have it."""
    a, b, v, w = state
    coupling, h = M2 * L1 * L2 * math.cos(b), M2 * L1 * L2 * math.sin(b)
    m11 = ROTOR + (M1 + M2) * L1**2 + M2 * L2**2 + 2 * coupling
    m12, m22 = M2 * L2**2 + coupling, ROTOR + M2 * L2**2
    outer = M2 * G * L2 * math.sin(a + b)
    f1 = h * (2 * v * w + w * w) - (M1 + M2) * G * L1 * math.sin(a) - outer
    f2 = -h * v * v - outer
    whole = m11 * m22 - m12 * m12
    return [v, w, (m22 * f1 - m12 * f2) / whole, (m11 * f2 - m12 * f1) / whole]


def swing(state: list[float], seconds: float, dt: float = 0.0005) -> list[float]:
    """Let it swing, by the rule of Runge and Kutta."""

    def ahead(rate: list[float], step: float) -> list[float]:
        return [one + step * by for one, by in zip(state, rate, strict=True)]

    for _ in range(round(seconds / dt)):
        one = pendulum(state)
        two = pendulum(ahead(one, dt / 2))
        three = pendulum(ahead(two, dt / 2))
        four = pendulum(ahead(three, dt))
        state = ahead([(p + 2 * q + 2 * r + s) / 6 for p, q, r, s in zip(one, two, three, four, strict=True)], dt)
    return state


def test_limp_servos_without_losses_swing_as_a_double_pendulum_does() -> None:
    arm = TwoLinks((1.2, 0.6), motor="lossless")
    arm.let_pass(0.6)
    assert arm.angles == pytest.approx(swing([1.2, 0.6, 0.0, 0.0], 0.6)[:2], abs=2e-3)


@pytest.mark.parametrize(("motor", "gained"), [("manual", 0.0), ("lossless", 1e-4)])
def test_the_energy_of_a_falling_arm_never_grows(motor: str, gained: float) -> None:
    arm = TwoLinks((1.5, 0.9), motor=motor)
    began = last = arm.energy
    for _ in range(500):
        arm.let_pass(STEP)
        assert arm.energy <= last + gained  # without losses it swings between the two forms, with an error of the step
        last = arm.energy
    assert last <= began + 10 * gained
    assert last < began - 0.3 or motor == "lossless"


def test_a_limp_arm_falls_and_settles_hanging_down_within_its_friction() -> None:
    arm = TwoLinks((1.4, 0.8))
    arm.let_pass(6.0)
    assert [servo.shaft.velocity for servo in arm.servos] == [0.0, 0.0]
    a, b = arm.angles
    outer = M2 * G * L2 * math.sin(a + b)
    inner = (M1 + M2) * G * L1 * math.sin(a) + outer
    assert max(abs(inner), abs(outer)) <= 0.05  # N·m, the friction of the RX-28's motor data
    assert abs(a) < 10 * deg
    before = arm.angles
    arm.let_pass(3600.0)
    assert arm.angles == before


def test_the_direction_and_the_ratio_of_a_servo_are_respected() -> None:
    # Through a gear of 2 the rotor is felt four times over; a servo that turns the other way sees the mirror image.
    plain = TwoLinks((1.2, 0.0), motor="lossless")
    turned = TwoLinks((1.2, 0.0), motor="lossless", gears=(-1, -1))
    geared = TwoLinks((0.8, 0.0), motor="lossless", gears=(-2, 1))
    began = geared.energy
    for arm in (plain, turned, geared):
        arm.let_pass(0.3)
    assert turned.angles == pytest.approx(plain.angles, abs=1e-9)
    assert geared.energy == pytest.approx(began, abs=1e-4)
    assert geared.angles[0] < 0.75  # it falls


def test_how_finely_time_is_cut_makes_no_difference() -> None:
    whole, cut = TwoLinks((1.2, 0.6)), TwoLinks((1.2, 0.6))
    whole.let_pass(0.5)
    for n in range(1, 1001):
        cut.servos[n % 2].advance(n * 0.0005)
    assert cut.angles == whole.angles


def test_a_servo_without_supply_falls_as_a_limp_one_does() -> None:
    arm, cut = TwoLinks((1.2, 0.6)), TwoLinks((1.2, 0.6))
    for servo in cut.servos:
        servo.power_off()
    for one in (arm, cut):
        one.let_pass(0.4)
    assert cut.angles == pytest.approx(arm.angles)
    assert arm.angles[0] < 1.0


def test_ports_that_are_used_in_turn_live_in_step_up_to_the_last() -> None:
    servos = [virtual_servo(RX28, 1, position=MIDDLE + angle) for angle in (1.0, 0.5)]
    links = [Link(mass=M1, length=L1, down=0.0), Link(mass=M2, length=L2, down=0.0, parent=0)]
    seats = [[Seat(servo, port, zero=MIDDLE)] for servo, port in zip(servos, "ab", strict=True)]
    mechanism = Mechanism(links, seats, in_turn=True)
    servos[0].let_pass(0.1)
    assert (mechanism.time, servos[0].position) == (0.0, MIDDLE + 1.0)
    servos[0].advance(0.1)  # it is asked: now it goes ahead
    assert mechanism.time == 0.0
    assert servos[0].position < MIDDLE + 1.0
    assert servos[1].position == MIDDLE + 0.5
    servos[1].let_pass(0.1)
    assert mechanism.time == pytest.approx(0.1)
    assert servos[1].position < MIDDLE + 0.5


def pair(gap: float = 0.0) -> list[VirtualServo]:
    """Give two servos on one joint, the second one turned round."""
    servos = [virtual_servo(RX28, 1, position=MIDDLE + gap), virtual_servo(RX28, 2, position=MIDDLE)]
    seats = [Seat(servo, "a", zero=MIDDLE, gear=gear) for servo, gear in zip(servos, (1, -1), strict=True)]
    Mechanism([Link(mass=M1, length=L1, down=0.0)], [seats], in_turn=False)
    return servos


def test_two_servos_on_one_joint_turn_together() -> None:
    first, second = pair()
    for n in range(250):
        first.shaft.drive(0.3)  # the other one is limp
        first.shaft.tick()
        second.advance(n * STEP)
    turned, followed = first.position - MIDDLE, MIDDLE - second.position
    assert abs(turned) > 10 * deg
    assert turned == pytest.approx(followed, abs=1 * deg)


def test_what_pulls_two_servos_together_comes_to_rest() -> None:
    first, second = pair(gap=3 * deg)
    first.advance(1.0)
    assert abs((first.position - MIDDLE) - (MIDDLE - second.position)) < 0.1 * deg
    assert first.shaft.velocity == second.shaft.velocity == 0.0


@pytest.mark.parametrize("key", ["rx28", "mx64", "lx16a", "drs0602", "drs0101"])
def test_every_family_falls(key: str) -> None:
    servo = virtual_servo(MODELS[key], 1)
    zero = servo.position - 80 * deg
    Mechanism([Link(mass=1.0, length=0.2, down=0.0)], [[Seat(servo, "a", zero=zero)]], in_turn=False)
    servo.advance(0.3)
    assert servo.position - zero < 70 * deg
