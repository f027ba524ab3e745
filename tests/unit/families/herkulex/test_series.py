"""What differs between the series of HerkuleX, in the driver and in the virtual servos.

Figures are those of the DRS-0101/0201 manual (pages named), and for the others of SmartServoFramework, pyHerkuleX and
the maker's PC tool, as docs/decisions.md has them.
"""

from typing import Any

import pytest

import servobus
from conformance.test_herkulex import ask, framed
from conformance.wire import Wire
from samples import turning
from servobus import MODELS, BadValue, UsageError, deg
from servobus.doctor.findings import Severity
from servobus.families.base import Model
from servobus.families.herkulex.firmware import HerkulexServo
from servobus.families.herkulex.protocol import StatusError
from servobus.families.registry import DRS0602
from servobus.virtual.device.servo import virtual_servo
from servobus.virtual.physics.motor import Load
from unit.doctor.test_doctor import told, visit

SMALL, X01, MAGNETIC = ("drs0101", "drs0201"), ("drs0401", "drs0601"), ("drs0402", "drs0602")
STEP = dict.fromkeys(SMALL, 0.325) | dict.fromkeys(X01, 0.163)
MIDDLE = dict.fromkeys(SMALL, 512) | dict.fromkeys(X01, 1024)
potentiometer = pytest.mark.parametrize("key", [*SMALL, *X01])
every_herkulex = pytest.mark.parametrize("key", [*SMALL, *X01, *MAGNETIC])


def made(key: str, position: float = 0.0, **how: Any) -> Wire:
    how = {"reading": "manual"} | how
    return Wire(virtual_servo(MODELS[key], 0xFD, position=position * deg, **how))


def word(wire: Wire, address: int, *, signed: bool = False) -> int:
    raw = bytes.fromhex(ask(wire, f"FD 04 {address:02X} 02"))
    return int.from_bytes(raw[4:6], "little", signed=signed)


def bus_of(key: str, **options: Any) -> tuple[Any, Any, Any]:
    """Give a bus with one servo, id 1, the driver's object and the servo itself."""
    bus: Any = servobus.open(f"virtual:{key}@1?clock=virtual", **options)
    return bus, bus.find(1), bus.transport.servos[0]


# Who it is


@pytest.mark.parametrize(
    ("key", "number", "id"),
    [
        ("drs0101", 0x0101, 253), ("drs0201", 0x0201, 253), ("drs0401", 0x0401, 253), ("drs0601", 0x0601, 253),
        ("drs0402", 0x0402, 219), ("drs0602", 0x0602, 219),
    ],
)  # fmt: skip
def test_each_says_its_number_and_has_its_id_from_the_factory(key: str, number: int, id: int) -> None:
    wire = Wire(virtual_servo(MODELS[key]))
    high, low = number.to_bytes(2)
    assert ask(wire, f"{id:02X} 02 00 02").startswith(f"{id:02X} 42 00 02 {high:02X} {low:02X}")


def test_a_scan_tells_them_apart() -> None:
    keys = ["drs0101", "drs0201", "drs0401", "drs0402", "drs0601", "drs0602"]
    port = ",".join(f"{key}@{n}" for n, key in enumerate(keys))
    with servobus.open(f"virtual:{port},drs0602@9,model_no1=1,model_no2=2?clock=virtual") as bus:
        found = {servo.id: servo.model.title for servo in bus.scan(ids=range(12))}
    assert found == {n: MODELS[key].title for n, key in enumerate(keys)} | {9: "HerkuleX servo, model 0102"}


@every_herkulex
def test_a_reset_gives_it_the_id_of_its_model(key: str) -> None:
    _, servo, real = bus_of(key)
    servo.reset()
    assert servo.id == real.id == (219 if key in MAGNETIC else 253)


@pytest.mark.parametrize("key", SMALL)
def test_the_small_ones_have_no_megabit(key: str) -> None:
    _bus, servo, real = bus_of(key)
    with pytest.raises(BadValue, match="1000000"):
        servo.change_baud(1_000_000)
    servo.change_baud(666_666)
    assert real.baud == pytest.approx(2_000_000 / 3)
    assert servo.look()


# Where it is


@pytest.mark.parametrize(("steps", "answer"), [(31, "1F 62"), (275, "13 63")])
def test_a_drs0101_answers_as_a_recorded_one(steps: int, answer: str) -> None:
    """robot-mitya/herkulex-servo, README: the answers of a real DRS-0101 at 10° and 90°, torque on."""
    wire = made("drs0101", steps * 0.325, reading="practice", options={"answer_time": "off"})
    wire.say(framed("FD 03 34 01 60"))
    recorded = {"1F 62": "FF FF 0D FD 44 B2 4C 3A 02 1F 62 00 42", "13 63": "FF FF 0D FD 44 BE 40 3A 02 13 63 00 42"}
    assert wire.say("FF FF 09 FD 04 C8 36 3A 02") == recorded[answer]


@every_herkulex
def test_flags_above_a_position_are_left_out(key: str) -> None:
    _bus, servo, real = bus_of(key)
    real.position_flags = True
    assert servo.read("present_position") == pytest.approx(0.0, abs=0.2 * deg)
    servo.torque_on()
    servo.move(20 * deg, time=0.5).wait()
    assert servo.read("present_position") == pytest.approx(20 * deg, abs=0.7 * deg)


@potentiometer
@pytest.mark.parametrize(
    ("turned", "seen"), [(0, 0), (90, 90), (-90, -90), (159, 159), (270, -90), (400, 40), (-730, -10)]
)
def test_a_potentiometer_knows_one_turn(key: str, turned: float, seen: float) -> None:
    assert word(made(key, turned), 60) == pytest.approx(MIDDLE[key] + seen / STEP[key], abs=0.6)


@potentiometer
def test_in_its_gap_it_tells_the_nearer_end(key: str) -> None:
    """EH-64"""
    last = 2 * MIDDLE[key] - 1
    assert [word(made(key, turned), 60) for turned in (170, 179, -179, -170, 182)] == [last, last, 0, 0, 0]


@potentiometer
def test_calibrated_position_stays_in_its_range(key: str) -> None:
    """EH-64: 0 to 1023 (page 25). Calibration Difference is one byte at 47, or two at 46 (EH-51)."""
    wire = made(key, 165)
    near = word(wire, 60)
    wire.say(framed("FD 03 2F 01 9C" if key in SMALL else "FD 03 2E 02 9C FF"))  # -100
    assert word(wire, 58) == min(near + 100, 2 * MIDDLE[key] - 1)
    wire.say(framed("FD 03 2F 01 32" if key in SMALL else "FD 03 2E 02 32 00"))  # 50
    assert word(wire, 58) == near - 50


@potentiometer
def test_it_holds_and_moves_within_the_turn_that_it_is_in(key: str) -> None:
    bus, servo, real = bus_of(key)
    real.turn_shaft(400 * deg)
    servo.torque_on()
    bus.transport.sleep(1.0)
    assert real.position == pytest.approx(400 * deg, abs=0.4 * deg)
    servo.move(-20 * deg, time=1.0).wait()
    assert real.position == pytest.approx(340 * deg, abs=0.7 * deg)


@potentiometer
def test_what_only_the_magnetic_ones_have_stays_reserved(key: str) -> None:
    assert not {"velocity_kp", "velocity_ki", "aux_1", "absolute_2nd_position"} & {*MODELS[key].registers}
    wire = made(key)
    for address in (34, 36, 50, 66):
        wire.say(framed(f"FD 03 {address:02X} 01 01"))
        assert bytes.fromhex(ask(wire, f"FD 04 {address:02X} 01"))[4] == 0


# How fast


@pytest.mark.parametrize("key", SMALL)
def test_the_small_ones_turn_by_output(key: str) -> None:
    """Page 48: the value of infinite turn is the desired PWM, bit 14 its sign."""
    bus, servo, real = bus_of(key)
    servo.torque_on()
    for share in (0.5, -0.25):
        servo.turn(output=share)
        bus.transport.sleep(2.0)
        assert servo.read("pwm") == pytest.approx(share, abs=0.002)
        before = real.position
        bus.transport.sleep(1.0)
        assert real.position - before == pytest.approx(share * real.top_speed, rel=0.08)
    servo.stop()
    assert servo.read("present_speed") == 0.0
    with pytest.raises(UsageError, match="no speed control; give output"):
        servo.turn(speed=1.0)


@pytest.mark.parametrize("key", [*X01, *MAGNETIC])
def test_the_others_turn_at_a_speed(key: str) -> None:
    bus, servo, real = bus_of(key)
    servo.torque_on()
    servo.turn(speed=90 * deg)
    bus.transport.sleep(2.0)
    before = real.position
    bus.transport.sleep(1.0)
    assert real.position - before == pytest.approx(90 * deg, rel=0.03)
    with pytest.raises(UsageError, match="controls its speed; give speed"):
        servo.turn(output=0.3)


@every_herkulex
def test_it_goes_on_to_a_goal_from_endless_turn(key: str) -> None:
    bus, servo, _real = bus_of(key)
    servo.torque_on()
    servo.turn(**turning(servo.model))
    bus.transport.sleep(1.7)
    servo.stop()
    servo.position_mode()
    servo.move(10 * deg, time=2.0).wait()
    assert servo.read("present_position") == pytest.approx(10 * deg, abs=0.7 * deg)


UNIT = dict.fromkeys(SMALL, 29.09) | dict.fromkeys(X01, 3.634) | dict.fromkeys(MAGNETIC, 0.62)
"""°/s of one unit of Differential Position: page 32; pyHerkuleX."""


@every_herkulex
def test_the_unit_of_the_measured_speed(key: str) -> None:
    """EH-58"""
    bus, servo, real = bus_of(key)
    servo.torque_on()
    servo.turn(**turning(servo.model))
    bus.transport.sleep(2.0)
    before = real.position
    (raw,) = servo.read_raw("present_speed")
    bus.transport.sleep(0.5)
    assert raw * UNIT[key] * deg == pytest.approx((real.position - before) / 0.5, rel=0.02, abs=1.1 * UNIT[key] * deg)


# What is wrong


@pytest.mark.parametrize("key", SMALL)
def test_a_fault_of_the_driver_is_told_and_lets_go(key: str) -> None:
    """Bit 0x20 (page 39); the policy from the factory, 0x35 (page 22), has it."""
    bus, servo, real = bus_of(key)
    servo.torque_on()
    real.driver_faulty = True
    bus.transport.sleep(0.01)
    assert servo.read_alarms() == StatusError.DRIVER_FAULT
    assert servo.alarm_text() == "driver_fault"
    assert not real.torque
    assert "shut down (driver_fault" in str(servo.look())
    real.driver_faulty = False
    servo.rearm()
    assert real.torque


@pytest.mark.parametrize("key", [*X01, *MAGNETIC])
def test_the_others_have_no_such_bit(key: str) -> None:
    """EH-22"""
    _bus, servo, real = bus_of(key)
    real.driver_faulty = True
    real.put("status_error", 0x20 | StatusError.OVERLOAD)  # as if one set it all the same
    assert servo.read_alarms() == StatusError.OVERLOAD
    assert servo.alarm_text() == "overload"
    with pytest.raises(BadValue, match="'driver_fault' is not one of"):
        servo.model.register("torque_policy").parse("driver_fault")


@pytest.mark.parametrize("key", SMALL)
def test_supply_and_heat_are_readings_of_a_converter(key: str) -> None:
    """0.074 V a unit (page 26). 128 is 25 °C, 0xDF 85 °C (page 22, and pyHerkuleX)."""
    bus, servo, real = bus_of(key)
    real.voltage, real.temperature = 7.4, 25.0
    assert servo.read_raw("present_voltage") == [100]
    assert servo.read_raw("present_temperature") == [128]
    assert servo.read("present_temperature") == pytest.approx(25.0)
    real.temperature = 85.0
    assert servo.read_raw("present_temperature") == [0xDF]
    assert servo.read("present_temperature") == pytest.approx(85.4, abs=0.1)
    bus.transport.sleep(1.0)
    assert servo.read_alarms() == StatusError.TEMPERATURE


@pytest.mark.parametrize(("celsius", "level"), [(40.0, Severity.OK), (79.0, Severity.WARN), (90.0, Severity.FAIL)])
def test_the_doctor_looks_at_the_heat(celsius: float, level: Severity) -> None:
    finding = told(visit(f"drs0101@1?clock=virtual&temperature={celsius}"))["temperature"]
    assert finding.level is level


@every_herkulex
def test_overload_lasts_as_long_as_its_unit_says(key: str) -> None:
    """150 units of 4 ms or of 11.2 ms (EH-08): 0.6 s and 1.68 s."""
    bus, servo, real = bus_of(key)
    servo.torque_on()
    real.shaft.load = Load(blocked=1.0)
    servo.start_move(60 * deg, time=0.02)
    bus.transport.sleep(0.5)
    assert not real.alarms
    bus.transport.sleep(0.3)
    assert bool(real.alarms) == (key in MAGNETIC)
    bus.transport.sleep(0.7)
    assert bool(real.alarms) == (key in MAGNETIC)
    bus.transport.sleep(0.4)
    assert real.alarms == StatusError.OVERLOAD


def test_firmware_of_all_is_one_family() -> None:
    kinds: set[type[Model]] = {model for model in MODELS.values() if model.family is DRS0602.family}
    assert len(kinds) == 6
    assert all(isinstance(virtual_servo(model), HerkulexServo) for model in kinds)
