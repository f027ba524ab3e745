"""The public figures of the LX-16A, measured as a user would: by packets, a clock and weights.

At 7.4 V the product pages have 60 degrees in 0.16 s and 19.5 kgf·cm. (Their torque at 6 V contradicts that;
see servobus.families.lewansoul.motors.)
"""

import pytest

from conformance.wire import Wire
from servobus.core.framing import Packet
from servobus.families.lewansoul.models.lx import LX16A
from servobus.families.lewansoul.protocol import FRAMING, Command
from servobus.virtual.device.servo import virtual_servo
from servobus.virtual.physics.motor import Load

KGF_CM = 9.80665e-2
"""N·m"""


def servo(volts: float | None = None) -> Wire:
    """Give a servo that answers at once, so that a position is as old as its packet is long."""
    return Wire(virtual_servo(LX16A, 1, voltage=volts, options={"answer_time": "off"}))


def tell(wire: Wire, command: Command, data: str) -> None:
    assert wire.say(FRAMING.frame(Packet(1, command, bytes.fromhex(data))), listen=0) == ""


def position(wire: Wire) -> int:
    """Ask for the position, in units of 0.24 degrees."""
    reply = wire.say(FRAMING.frame(Packet(1, Command.SERVO_POS_READ, b"")), listen=0.002)
    assert reply.bytes, "it did not answer within 2 ms"
    return int.from_bytes(reply.bytes[5:7], "little", signed=True)


def at(wire: Wire, goal: int) -> Wire:
    """Switch the torque on, go to a goal, and wait until it is there."""
    tell(wire, Command.SERVO_LOAD_OR_UNLOAD_WRITE, "01")
    tell(wire, Command.SERVO_MOVE_TIME_WRITE, goal.to_bytes(2, "little").hex() + "0000")
    wire.wait(1.0)
    assert position(wire) == goal
    return wire


def per_60_degrees(volts: float) -> float:
    """Time the middle of a move over the whole range, as fast as possible: s."""
    wire = servo(volts)
    tell(wire, Command.SERVO_VIN_LIMIT_WRITE, "94 11 E0 2E")  # from 4.5 V, so that it works at 6 V
    at(wire, 0)
    tell(wire, Command.SERVO_MOVE_TIME_WRITE, "E8 03 00 00")
    passed = []
    for beyond in (500, 750):
        while (seen := position(wire)) < beyond:
            pass
        passed.append((wire.now, seen))
    (start, here), (end, there) = passed
    return (end - start) * 250 / (there - here)  # 250 units are 60 degrees


def lifts(volts: float, torque: float) -> bool:
    """Tell whether it turns on against a torque (N·m), as fast as possible to the other end of its range."""
    wire = at(servo(volts), 500)
    wire.servo.shaft.load = Load(torque=-torque)
    tell(wire, Command.SERVO_MOVE_TIME_WRITE, "E8 03 00 00")
    wire.wait(0.2)
    before = position(wire)
    wire.wait(0.5)
    return position(wire) > before


def stall_torque(volts: float) -> float:
    """The largest torque that it still lifts, N·m."""
    low, high = 0.0, 5.0
    while high - low > 0.001:
        middle = (low + high) / 2
        low, high = (middle, high) if lifts(volts, middle) else (low, middle)
    return low


def test_60_degrees_take_160_ms_at_7_4_V() -> None:
    assert per_60_degrees(7.4) == pytest.approx(0.16, rel=0.01)


def test_stall_torque_is_19_5_kgf_cm_at_7_4_V() -> None:
    assert stall_torque(7.4) == pytest.approx(19.5 * KGF_CM, rel=0.01)


def test_60_degrees_take_200_ms_at_6_V() -> None:
    assert per_60_degrees(6.0) == pytest.approx(0.20, rel=0.01)


def test_a_blocked_shaft_draws_what_the_torque_needs() -> None:
    wire = at(servo(), 500)
    wire.servo.shaft.load = Load(blocked=1.0)
    tell(wire, Command.SERVO_MOVE_TIME_WRITE, "E8 03 00 00")
    wire.wait(0.1)
    assert position(wire) == 500
    assert wire.servo.shaft.duty == 1
    # The energy that comes out at the best point of any such motor bounds the current: torque * speed / volts.
    assert wire.servo.shaft.current > 19.5 * KGF_CM * 6.545 / 7.4
