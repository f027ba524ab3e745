"""The bench: what surrounds the virtual servos of a bus, to be looked at and changed."""

from collections.abc import Sequence

from servobus.errors import UsageError
from servobus.remote.managing import Bench, BenchServo, SetBench
from servobus.server.ports.served_bus import ServedBus
from servobus.virtual.device.motors import supply
from servobus.virtual.device.servo import VirtualServo
from servobus.virtual.physics.motor import stall_torque
from servobus.virtual.serve.inprocess import VirtualPort
from servobus.virtual.serve.spec import check_temperature, check_voltage, parse_load
from servobus.virtual.wire.faults import NO_FAULTS, Faults


def look(served: ServedBus, n: int) -> Bench:
    """Give the virtual servos of a bus, as they are now. Raises UsageError for a bus of real servos."""
    port = _port(served)
    with port.rig.lock:
        port.rig.advance(port.now())
        return _bench(port, n)


def change(served: ServedBus, asked: SetBench) -> Bench:
    """Change what surrounds virtual servos. Raises BadValue and UsageError, and has changed nothing then."""
    port = _port(served)
    rig = port.rig
    faults = None if not asked.faults else NO_FAULTS if asked.faults == "none" else Faults.parse(asked.faults)
    voltage = None if asked.voltage is None else check_voltage(asked.voltage)
    temperature = None if asked.temperature is None else check_temperature(asked.temperature)
    with rig.lock:
        now = port.now()
        rig.advance(now)
        servos = _named(rig.servos, asked.servos)
        loads = [parse_load(asked.load, servo.shaft.load) for servo in servos] if asked.load else []
        if asked.position is not None:  # first, because it alone can be refused
            for servo in sorted(servos, key=_turns_freely):  # those that refuse in front: then none is turned
                servo.turn_shaft(asked.position)
        for servo, load in zip(servos, loads, strict=False):
            if load != servo.shaft.load:
                servo.shaft.load = load
        for servo in servos:
            if voltage is not None:
                servo.voltage = voltage
            if temperature is not None:
                servo.temperature = temperature
        if asked.plugged is not None:
            (rig.plug if asked.plugged else rig.unplug)(servos, now)
        if faults is not None:
            port.inject(faults)
        return _bench(port, asked.n)


def _port(served: ServedBus) -> VirtualPort:
    port = served.tap.inner
    if not isinstance(port, VirtualPort):
        raise UsageError(f"bus {served.name} has real servos, and a bench only virtual ones: serve virtual:rx28@1-4")
    return port


def _named(servos: Sequence[VirtualServo], numbers: Sequence[int]) -> Sequence[VirtualServo]:
    """Give servos by their numbers, all where none is named. Raises UsageError."""
    for number in numbers:
        if not 0 <= number < len(servos):
            raise UsageError(f"there is no servo {number} on the bench: they are 0 .. {len(servos) - 1}")
    return [servos[number] for number in numbers] if numbers else servos


def _turns_freely(servo: VirtualServo) -> bool:
    return not (servo.powered and servo.torque)


def _bench(port: VirtualPort, n: int) -> Bench:
    rig = port.rig
    servos = tuple(_shown(number, servo) for number, servo in enumerate(rig.servos))
    return Bench(n, servos, rig.faults.text, tuple(sorted(rig.fault_counts.items())))


def _shown(number: int, servo: VirtualServo) -> BenchServo:
    shaft, model = servo.shaft, servo.model
    return BenchServo(
        number=number,
        family=model.family.name,
        id=servo.id,
        title=model.title,
        position=shaft.position,
        speed=shaft.velocity,
        current=shaft.current,
        voltage=shaft.rail.voltage,
        source=shaft.rail.source,
        nominal=supply(model)[0],
        home=servo.home,
        temperature=shaft.case,
        torque=servo.powered and servo.torque,
        led=servo.led if servo.powered else "off",
        plugged=servo.powered,
        load=shaft.load.torque,
        mass=shaft.load.mass,
        length=shaft.load.length,
        inertia=shaft.load.inertia,
        blocked=bool(shaft.load.blocked),
        stall=stall_torque(shaft.motor, shaft.rail.voltage),
    )
