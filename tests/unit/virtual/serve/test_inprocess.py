import time
from pathlib import Path

import pytest

import servobus
from servobus.errors import BadValue, PortError, UnknownName, UsageError
from servobus.families.dynamixel.motors import RX28_MEASURED
from servobus.virtual.physics.motor import Load
from servobus.virtual.serve.inprocess import VirtualPort, connect

PING = bytes.fromhex("FF FF 01 02 01 FB")
PONG = bytes.fromhex("FF FF 01 02 00 FC")


def talk(spec: str) -> tuple[bytes, float]:
    port = connect(spec)
    heard = b""
    for id in (1, 2, 3):
        for baud in (57600, 115200):
            port.set_baud(baud)
            for request in (b"\xff\xff%c\x02\x01%c" % (id, 252 - id), b"\x55\x55%c\x03\x1c%c" % (id, 224 - id)):
                port.write(request)
                while chunk := port.read(0.05):
                    heard += chunk
    return heard, port.now()


def test_virtual_time_is_deterministic_to_the_byte() -> None:
    spec = "virtual:rx28@1,2,2,lx16a@2,3?clock=virtual"
    first = talk(spec)
    assert first == talk(spec)
    assert first[0].count(b"\xff\xff") == 2
    assert first[0].count(b"\x55\x55") == 2


def test_virtual_time_passes_only_while_one_waits() -> None:
    port = connect("virtual:rx28@1?clock=virtual&answer_time=off")
    assert (port.now(), port.blocking(), port.fileno()) == (0.0, False, None)
    port.write(PING)
    assert port.read(0) == b""
    assert port.now() == 0.0
    assert port.read(1.0) == PONG
    assert port.now() == pytest.approx(6 * 10 / 57600 + 500e-6 + 6 * 10 / 57142.857, abs=1e-9)
    port.sleep(3600)
    assert port.read(2.0) == b""
    assert port.now() > 3602


def test_discard() -> None:
    port = connect("virtual:rx28@1?clock=virtual")
    port.write(PING)
    assert port.discard() == b""
    port.sleep(0.1)
    assert port.discard() == PONG


def test_real_time() -> None:
    port = connect("virtual:rx28@1")
    assert port.blocking()
    started = time.monotonic()
    port.write(PING)
    heard = b""
    while len(heard) < 6 and time.monotonic() < started + 5:
        heard += port.read(0.1)
    assert heard == PONG
    assert time.monotonic() - started >= 0.0025
    assert port.read(0.01) == b""


def test_wrong_speed() -> None:
    port = connect("virtual:rx28@1?clock=virtual")
    port.set_baud(1_000_000)
    port.write(PING)
    assert port.read(0.1) == b""
    assert port.baud == 1_000_000
    with pytest.raises(BadValue):
        port.set_baud(0)


def test_options() -> None:
    port = connect("virtual:rx28@1?clock=virtual&voltage=12&temperature=33&baud=1000000&echo=1")
    (servo,) = port.servos
    assert (servo.voltage, servo.temperature, servo.baud) == (12.0, 33.0, 1e6)
    port.set_baud(1_000_000)
    port.write(PING)
    heard = b""
    while chunk := port.read(0.1):
        heard += chunk
    assert heard == PING + PONG


def test_speed_no_servo_of_the_family_has() -> None:
    with pytest.raises(BadValue, match="one speed"):
        connect("virtual:rx28@1,lx16a@2?baud=57600")
    with pytest.raises(BadValue):
        connect("virtual:rx28@1?baud=123")


def test_state_file(tmp_path: Path) -> None:
    spec = f"virtual:rx28@1,2?clock=virtual&state={tmp_path / 'rx.json'}"
    port = connect(spec)
    port.write(bytes.fromhex("FF FF 01 04 03 03 09 EB"))
    assert port.read(0.1) == PONG
    port.close()
    assert [servo.id for servo in connect(spec).servos] == [9, 2]
    with pytest.raises(UsageError, match="other servos"):
        connect(f"virtual:rx28@1?state={tmp_path / 'rx.json'}")


def test_closed() -> None:
    port = connect("virtual:rx28@1")
    port.close()
    port.close()
    with pytest.raises(PortError, match="closed"):
        port.write(PING)
    with pytest.raises(PortError, match="closed"):
        port.read(0)


def test_bus() -> None:
    with servobus.open("virtual:rx28@1-3?clock=virtual") as bus:
        assert [servo.id for servo in bus.scan(family="dynamixel")] == [1, 2, 3]


def test_motor_and_load() -> None:
    port = connect("virtual:rx28@1-2?clock=virtual&motor=measured&load=mass:0.2+length:0.1")
    assert [servo.shaft.motor for servo in port.servos] == [RX28_MEASURED.params] * 2
    assert [servo.shaft.load for servo in port.servos] == [Load(mass=0.2, length=0.1)] * 2
    with pytest.raises(UnknownName, match="manual"):
        connect("virtual:lx16a@1?motor=measured")


def test_a_shared_supply_is_pulled_down_by_a_stalled_neighbour() -> None:
    port = connect("virtual:lx16a@1-2,rx28@3?clock=virtual&supply_resistance=0.2&voltage=8.4&load=blocked")
    pushing, quiet, elsewhere = port.servos
    assert pushing.shaft.rail is quiet.shaft.rail is not elsewhere.shaft.rail
    assert quiet.voltage == pytest.approx(8.4, abs=0.03)
    before = elsewhere.voltage
    for packet in ("55 55 01 04 1F 01 DA", "55 55 01 07 1D 01 00 E8 03 EE"):  # load, motor mode at full output
        port.write(bytes.fromhex(packet))
        port.sleep(0.01)
    port.sleep(0.1)
    assert quiet.voltage == pytest.approx(8.4 - 0.2 * (2 * 0.05 + 8.4 / (2.9 + 0.2)), abs=0.03)
    assert port.servos[1].voltage == pushing.voltage
    assert elsewhere.voltage == before
    stiff = connect("virtual:lx16a@1-2?clock=virtual&voltage=8.4&load=blocked")
    for packet in ("55 55 01 04 1F 01 DA", "55 55 01 07 1D 01 00 E8 03 EE"):
        stiff.write(bytes.fromhex(packet))
        stiff.sleep(0.01)
    assert [servo.voltage for servo in stiff.servos] == [8.4, 8.4]


def test_tasks_are_done_one_at_a_time_between_two_events() -> None:
    port = connect("virtual:rx28@1?clock=virtual")
    done: list[tuple[int, float]] = []
    for number in range(3):
        port.rig.post(lambda now, number=number: done.append((number, now)))  # type: ignore[misc]
    assert port.read(0) == b""
    assert done == [(0, 0.0)]
    assert port.read(1.0) == b""
    assert done == [(0, 0.0), (1, 0.0), (2, 0.0)]


@pytest.mark.parametrize("look", [False, True])
def test_what_is_changed_after_a_sleep_does_not_act_on_the_time_before(look: bool) -> None:
    """At 90 °C an RX-28 shuts down (its limit is 80 °C), whether somebody looks at it before it cools or not."""
    bus = servobus.open("virtual:rx28@1?clock=virtual")
    port: VirtualPort = bus.transport  # type: ignore[assignment] # a virtual: port is one
    servo = bus.attach(servobus.RX28, 1)
    (real,) = port.servos
    servo.torque_on()
    servo.ping()
    real.temperature = 90.0
    port.sleep(1.0)
    if look:
        servo.ping()
    real.temperature = 30.0
    assert servo.read(servobus.RX28.torque_limit) == 0.0
