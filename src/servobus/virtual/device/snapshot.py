"""What can be seen of a virtual servo at one moment, for what shows or records it."""

from dataclasses import dataclass

from servobus.core.units import Flags
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.physics.motor import CLOSED


@dataclass(frozen=True, slots=True)
class VirtualSnapshot:
    """One servo at one moment, in rad, rad/s, A, degC and V."""

    title: str
    family: str
    id: int
    powered: bool
    angle: float
    speed: float
    duty: float | None
    """-1 .. 1 of the supply; None while the motor is let go of."""
    current: float
    temperature: float
    voltage: float
    torque: bool
    led: str
    errors: tuple[str, ...]


def take_snapshot(servo: VirtualServo) -> VirtualSnapshot:
    """Look at a servo. It shows the time up to which it was advanced."""
    shaft = servo.shaft
    return VirtualSnapshot(
        title=servo.model.title,
        family=servo.model.family.title,
        id=servo.id,
        powered=servo.powered,
        angle=shaft.position,
        speed=shaft.velocity,
        duty=shaft.duty if shaft.closed == CLOSED else None,
        current=shaft.current,
        temperature=servo.temperature,
        voltage=servo.voltage,
        torque=servo.powered and servo.torque,
        led=servo.led,
        errors=errors(servo),
    )


def errors(servo: VirtualServo) -> tuple[str, ...]:
    """Name what a servo has to complain about."""
    flags = servo.alarms
    return tuple(Flags(type(flags)).show(flags).replace("_", " ").split("+")) if flags else ()
