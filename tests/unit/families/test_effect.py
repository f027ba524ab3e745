"""What a request is said to do, compared with what the manuals say and with what virtual servos then do.

The judge of a request is the virtual servo: a copy of it that hears the request, beside one that does not.
"""

import copy
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain
from typing import Any

import pytest

import servobus
from samples import chosen, other_bauds, sample_of, slack, turning
from servobus import MODELS, Bus
from servobus.core.effect import NO_KIND, Effect, Kind
from servobus.core.framing import Corrupt, Packet
from servobus.core.registers import Register
from servobus.core.units import deg
from servobus.errors import UsageError
from servobus.families import registry
from servobus.families.base import Family, Model
from servobus.families.dynamixel.places import Address
from servobus.families.lewansoul import protocol as lewansoul
from servobus.families.lewansoul.places import Pair
from servobus.families.lewansoul.protocol import Command
from servobus.virtual.device.servo import Replies, VirtualServo
from servobus.virtual.serve.inprocess import VirtualPort

READS, WRITES, STORES = Kind.READS, Kind.WRITES, Kind.STORES
DRIVES, STOPS, RELEASES = Kind.DRIVES, Kind.STOPS, Kind.RELEASES
LOOK = 0.3
"""s that a servo is given to show what a request did."""
STILL = 1 * deg
"""Way that counts as none: compliance gives as much."""


def of(model: type[Model], packet: Packet) -> Effect:
    return model.family.effect(packet, lambda _: model)


def written(effect: Effect) -> list[dict[str, int]]:
    return [{row.name: raw for row, raw in touch.written.items()} for touch in effect.touches]


# By the manuals


D, H, L = "rx28", "drs0602", "lx16a"


@pytest.mark.parametrize(
    ("key", "code", "data", "kinds", "values"),
    [
        # RX-28 manual 3-4, 3-5
        (D, 1, (), READS, {}),
        (D, 2, (36, 2), READS, {}),
        (D, 3, (24, 1), WRITES | DRIVES, {"torque_enable": 1}),
        (D, 3, (24, 0), WRITES | RELEASES, {"torque_enable": 0}),
        (D, 3, (24, 7), WRITES | DRIVES, {"torque_enable": 7}),
        (D, 3, (25, 1), WRITES, {"led": 1}),
        (D, 3, (24, 0, 1), WRITES | RELEASES, {"torque_enable": 0, "led": 1}),
        (D, 3, (30, 0, 2), WRITES | DRIVES, {"goal_position": 512}),
        (D, 3, (30, 0), WRITES | DRIVES, {}),  # half a goal
        (D, 3, (30, 0, 2, 9, 0), WRITES | DRIVES, {"goal_position": 512, "moving_speed": 9}),
        (D, 3, (32, 0, 0), WRITES | DRIVES, {"moving_speed": 0}),  # full speed, or the end of endless turn
        (D, 3, (34, 0, 0), WRITES | RELEASES, {"torque_limit": 0}),
        (D, 3, (34, 255, 3), WRITES | DRIVES, {"torque_limit": 1023}),
        (D, 3, (6, 0, 0), STORES | DRIVES, {"cw_angle_limit": 0}),  # endless turn, with the other one 0
        (D, 3, (3, 9), STORES, {"id": 9}),
        (D, 3, (4, 1), STORES, {"baud_rate": 1}),
        (D, 3, (11, 70), STORES, {"highest_limit_temperature": 70}),
        (D, 3, (48, 9, 0), WRITES, {"punch": 9}),
        (D, 3, (47, 1), WRITES, {"lock": 1}),
        (D, 3, (60, 1), WRITES | DRIVES, {}),  # no register
        (D, 3, (), DRIVES, {}),
        (D, 4, (25, 1), WRITES | DRIVES, {"led": 1}),  # REG_WRITE
        (D, 4, (24, 0), WRITES | DRIVES, {"torque_enable": 0}),
        (D, 5, (), WRITES | DRIVES, {}),  # ACTION
        (D, 6, (), STORES, {}),  # RESET
        (D, 0x77, (1,), DRIVES, {}),
        # DRS-0602 manual 4-2, 5-1, 6
        (H, 7, (), READS, {}),
        (H, 4, (58, 2), READS, {}),
        (H, 2, (6, 1), READS, {}),
        (H, 3, (52, 1, 0x60), WRITES | DRIVES, {"torque_control": 0x60}),
        (H, 3, (52, 1, 0x40), WRITES | RELEASES, {"torque_control": 0x40}),
        (H, 3, (52, 1, 0), WRITES | RELEASES, {"torque_control": 0}),
        (H, 3, (52, 1, 0xE0), WRITES | DRIVES, {"torque_control": 0xE0}),
        (H, 3, (53, 1, 2), WRITES, {"led_control": 2}),
        (H, 3, (48, 2, 0, 0), WRITES, {"status_error": 0, "status_detail": 0}),
        (H, 3, (0, 1, 9), STORES, {"id": 9}),
        (H, 3, (1, 1, 2), WRITES, {"ack_policy": 2}),
        (H, 3, (15, 1, 9), WRITES | DRIVES, {"min_pwm": 9}),
        (H, 1, (21, 1, 9), STORES, {"min_pwm": 9}),  # EEP: acts after a restart
        (H, 1, (6, 1, 9), STORES, {"id": 9}),
        (H, 3, (60, 2, 0, 0), WRITES | DRIVES, {"absolute_position": 0}),  # can only be read
        (H, 3, (52, 2, 0x60), DRIVES, {}),  # says two bytes and has one
        (H, 5, (0, 2, 0, 7, 60), DRIVES, {"absolute_goal_position": 512}),
        (H, 5, (0, 2, 2, 7, 60), DRIVES, {}),  # infinite turn
        (H, 5, (0, 2, 1, 7, 60), STOPS, {}),
        (H, 6, (60, 0, 2, 0, 7), DRIVES, {"absolute_goal_position": 512}),
        (H, 8, (0, 0), STORES, {}),
        (H, 9, (), STORES | RELEASES, {}),
        (H, 0x0C, (), DRIVES, {}),
        # The protocol document of the LX, section 4
        (L, 28, (), READS, {}),
        (L, 28, (1,), READS, {}),  # a byte more than it has
        (L, 1, (0, 1, 0, 0), WRITES | DRIVES, {"goal_position": 256, "goal_time": 0}),
        (L, 1, (0, 1, 0, 0, 9), WRITES | DRIVES, {"goal_position": 256, "goal_time": 0}),
        (L, 1, (0, 1), DRIVES, {}),
        (L, 7, (0, 1, 0, 0), WRITES | DRIVES, {"wait_goal_position": 256, "wait_goal_time": 0}),
        (L, 11, (), WRITES | DRIVES, {}),
        (L, 12, (), STOPS, {}),
        (L, 13, (9,), STORES, {"id": 9}),
        (L, 17, (5,), WRITES | DRIVES, {"angle_offset": 5}),
        (L, 18, (), STORES, {}),
        (L, 20, (0, 0, 100, 0), STORES | DRIVES, {"min_position": 0, "max_position": 100}),
        (L, 24, (90,), STORES | DRIVES, {"max_temperature": 90}),  # the torque comes back (point 16)
        (L, 29, (1, 0, 100, 0), WRITES | DRIVES, {"mode": 1, "motor_speed": 100}),
        (L, 31, (0,), WRITES | RELEASES, {"torque_enable": 0}),
        (L, 31, (1,), WRITES | DRIVES, {"torque_enable": 1}),
        (L, 31, (9,), WRITES | DRIVES, {"torque_enable": 9}),
        (L, 33, (0,), STORES, {"led": 0}),
        (L, 99, (), DRIVES, {}),
    ],
)
def test_one_servo(key: str, code: int, data: tuple[int, ...], kinds: Kind, values: dict[str, int]) -> None:
    effect = of(MODELS[key], Packet(7, code, bytes(data)))
    assert (effect.kinds, effect.ids, written(effect)) == (kinds, (7,), [values])
    assert effect.only_reads == (kinds == READS)


def test_several_servos() -> None:
    """SYNC_WRITE to torque_enable, I_JOG with a servo left alone, BULK_READ."""
    effect = of(MODELS[D], Packet(254, 0x83, bytes([24, 1, 1, 1, 2, 0, 3, 1])))
    assert [(touch.id, touch.kinds) for touch in effect.touches] == [
        (1, WRITES | DRIVES), (2, WRITES | RELEASES), (3, WRITES | DRIVES)
    ]  # fmt: skip
    assert (effect.ids_of(DRIVES), effect.ids_of(RELEASES)) == ((1, 3), (2,))
    jogs = of(MODELS[H], Packet(254, 5, bytes([0, 2, 0, 1, 60, 0, 2, 0x20, 2, 60, 0, 2, 1, 254, 60])))
    assert [(touch.id, touch.kinds) for touch in jogs.touches] == [(1, DRIVES), (254, STOPS)]
    bulk = of(MODELS["mx28"], Packet(254, 0x92, bytes([0, 2, 1, 36, 2, 5, 36])))
    assert (bulk.ids, bulk.only_reads) == ((1, 5), True)


def test_models_differ_on_one_line() -> None:
    """Address 71 is Goal Torque of an MX-64 and nothing of an RX-28; 26 is a gain of one, compliance of the other."""
    models = {1: MODELS["rx28"], 2: MODELS["mx64"], 254: registry.GENERIC["dynamixel"]}
    effect = MODELS[D].family.effect(Packet(254, 0x83, bytes([26, 1, 1, 9, 2, 9, 3, 9])), models.get)
    assert [touch.kinds for touch in effect.touches] == [WRITES, WRITES, WRITES | DRIVES]
    assert written(effect) == [{"cw_compliance_margin": 9}, {"d_gain": 9}, {}]
    everybody = MODELS[D].family.effect(Packet(254, 3, bytes([24, 0])), models.get)
    assert (everybody.kinds, everybody.ids) == (WRITES | RELEASES, (254,))
    stranger = MODELS[D].family.effect(Packet(3, 3, bytes([24, 0])), models.get)
    assert stranger.kinds & DRIVES


# By what virtual servos do


def driven(servo: VirtualServo) -> bool:
    """Tell whether the motor drives the shaft; a brake holds it too."""
    return servo.torque and servo.get("torque_enable") == sample_of(servo.model.key()).on


def settings(servo: VirtualServo) -> dict[str, int]:
    return {name: servo.memory[row] for name, row in servo.model.registers.items() if row.writable}


def twin(servo: VirtualServo) -> VirtualServo:
    """Copy a servo, less the rows of its model, which are what they are."""
    return copy.deepcopy(servo, {id(row): row for row in servo.model.registers.values()})


def hear(servo: VirtualServo, packet: Packet, kinds: Kind) -> None:
    """Let a servo hear a request that is said to do this, and see that it does nothing else at once."""
    before, was, stored = driven(servo), settings(servo), servo.memory.bytes_stored
    servo.hear(packet, servo.time)
    said = f"{servo.model.title}: {packet} said to be {kinds}"
    assert kinds & DRIVES or driven(servo) <= before, f"{said} switches the torque on"
    assert kinds & ~READS or settings(servo) == was, f"{said} changes something"
    assert kinds & STORES or servo.memory.bytes_stored == stored, f"{said} stores something"
    assert not kinds & RELEASES or not driven(servo), f"{said} leaves the torque on"


def check_still(servo: VirtualServo, packet: Packet, kinds: Kind, deaf: VirtualServo) -> None:
    """Let a copy of a servo hear a request; compare what follows with what a deaf one does in LOOK."""
    hearing = twin(servo)
    hear(hearing, packet, kinds)
    if kinds & (DRIVES | RELEASES):  # a shaft that is let go of coasts
        return
    hearing.advance(servo.time + LOOK)
    said = f"{servo.model.title}: {packet} said to be {kinds}"
    assert driven(hearing) <= driven(servo), f"{said} lets the torque come on"
    # What moved may end sooner, never later.
    way, longest = abs(hearing.position - servo.position), abs(deaf.position - servo.position)
    assert way <= longest + STILL, f"{said} moves the shaft by {way / deg:.1f}° instead of {longest / deg:.1f}°"


def deaf_twin(servo: VirtualServo) -> VirtualServo:
    other = twin(servo)
    other.advance(servo.time + LOOK)
    return other


def raw_values(row: Register[Any]) -> list[int]:
    """Give the ends of what a register may hold, what it may hold alone, and one beyond."""
    low, high = row.limits
    first, last = row.layout.range
    return sorted({raw for raw in (low, high, *(row.allowed or ()), high + 1) if first <= raw <= last})


def writes(row: Register[Any], raw: int) -> Iterator[Packet]:
    """Give the requests of one servo that set a register where it acts, and where it is kept."""
    data = row.layout.pack(raw)
    match row.place:
        case Pair(write, _, at):
            if write is not None:
                params = bytearray(lewansoul.length_of(Command(write).params))
                params[at : at + len(data)] = data
                yield Packet(1, write, bytes(params))
        case Address(address):
            yield Packet(1, 3, bytes([address]) + data)
        case place:
            for space, address in place.locations:
                yield Packet(1, 3 if space == "ram" else 1, bytes([address, len(data)]) + data)


def lesser_writes(model: type[Model]) -> list[list[tuple[Packet, Kind]]]:
    """Give what sets registers with every kind of value and is said to be less than motion, register by register."""
    rows = ([one for raw in raw_values(row) for one in writes(row, raw)] for row in model.registers.values())
    said = ([(one, of(model, one).kinds) for one in packets] for packets in rows)
    return [[(one, kinds) for one, kinds in packets if not kinds & DRIVES] for packets in said]


@contextmanager
def arm(model: type[Model]) -> Iterator[tuple[Bus, VirtualServo]]:
    """Open a bus with one virtual servo on a virtual clock."""
    with servobus.open(f"virtual:{model.key()}@1?clock=virtual") as bus:
        port = bus.transport
        assert isinstance(port, VirtualPort)
        bus.attach(model, 1)
        yield bus, port.servos[0]


def in_state(model: type[Model], state: str) -> VirtualServo:
    """Make a servo that is limp, limp with a goal elsewhere, holds, moves to a goal, turns, or has shut down."""
    with arm(model) as (bus, real):
        wait = bus.transport.sleep
        if state == "turns":
            bus[1].torque_on()
            bus[1].turn(**turning(model))
        elif state != "limp":
            bus[1].torque_on()
            bus.move({1: real.position + 30 * deg}, speed=60 * deg)
        wait(2.0 if state == "holds" else 0.1)
        if state == "limp off its goal":
            bus[1].torque_off()
            wait(0.5)
        elif state == "has shut down":
            real.temperature = 95.0  # °C, above every limit from the factory
            wait(1.0)
            assert not real.torque
        real.advance(bus.transport.now())
        return real


@pytest.mark.parametrize("state", ["limp", "limp off its goal", "has shut down"])
@pytest.mark.parametrize("key", chosen(MODELS))
def test_less_than_motion_lets_no_torque_come_on(key: str, state: str) -> None:
    """All writes that are said to be less, one after the other, and they have done it after them all."""
    model = MODELS[key]
    servo = in_state(model, state)
    deaf = deaf_twin(servo)
    row = model.registers.get("lock")
    lock = bytes([row.place.address]) if row is not None and isinstance(row.place, Address) else b"-"
    for packet, kinds in chain.from_iterable(lesser_writes(model)):
        if not packet.data.startswith(lock):
            hear(servo, packet, kinds)
    servo.advance(servo.time + LOOK)
    assert not driven(servo)
    assert servo.position == pytest.approx(deaf.position, abs=STILL)


@pytest.mark.parametrize("key", chosen(MODELS))
def test_less_than_motion_moves_nothing_that_holds(key: str) -> None:
    """Each register has a servo of its own, which is given one value after the other."""
    servo = in_state(MODELS[key], "holds")
    for packets in lesser_writes(MODELS[key]):
        hearing = twin(servo) if packets else servo
        for packet, kinds in packets:
            hear(hearing, packet, kinds)
            hearing.advance(hearing.time + LOOK / 3)
            # Gains, margins and the like settle how near to its goal it rests.
            near = max(slack(servo.model), 4 * deg)
            assert hearing.position == pytest.approx(servo.position, abs=near), packet


# Verbs


def goal(bus: Bus) -> float:
    return float(bus[1].read("present_position")) + 20 * deg


def another_limit(bus: Bus) -> None:
    row = bus[1].model.register("min_voltage")
    bus[1].store({row: row.decode(row.limits[0] + (row.default == row.limits[0]))})


def another_speed(bus: Bus) -> None:
    if not (bauds := other_bauds(bus[1].model)):
        raise UsageError("it has one speed")
    bus[1].change_baud(bauds[0])


VERBS: dict[str, tuple[Callable[[Bus], object], Kind, Kind]] = {
    # name: what is done, what it must be said to do, what it must not
    "ping": (lambda bus: bus[1].ping(), READS, ~READS),
    "scan": (lambda bus: bus.scan(ids=(1, 2)), READS, ~READS),
    "look": (lambda bus: bus[1].look(), READS, ~READS),
    "read": (lambda bus: bus[1].read("present_position"), READS, ~READS),
    "read_all": (lambda bus: bus.read_all("present_position"), READS, ~READS),
    "alarms": (lambda bus: bus[1].read_alarms(), READS, ~READS),
    "backup": (lambda bus: bus[1].backup(), READS, ~READS),
    "torque on": (lambda bus: bus[1].torque_on(), DRIVES, STORES),
    "move": (lambda bus: bus.move({1: goal(bus)}), DRIVES, STORES | RELEASES),
    "stop": (lambda bus: bus[1].stop(), STOPS | DRIVES, STORES | RELEASES),
    "torque off": (lambda bus: bus[1].torque_off(), RELEASES, DRIVES | STORES),
    "torque on again": (lambda bus: bus.torque_on(), DRIVES, STORES),
    "turn": (lambda bus: bus[1].turn(**turning(bus[1].model)), DRIVES, RELEASES),
    "end of turn": (lambda bus: bus[1].position_mode(), READS | DRIVES, NO_KIND),
    "make safe": (lambda bus: bus.make_safe("free"), RELEASES, STORES),
    "light": (lambda bus: bus[1].led("off"), WRITES | STORES, DRIVES | RELEASES),
    "store": (another_limit, STORES, RELEASES),
    "restore": (lambda bus: bus[1].restore(bus[1].backup()), READS, DRIVES),
    "new id": (lambda bus: (bus[1].change_id(9), bus[9].change_id(1)), STORES, DRIVES),
    "new speed": (another_speed, STORES, DRIVES),
    "restart": (lambda bus: bus[1].reboot(), STORES | RELEASES, DRIVES),
    "reset": (lambda bus: bus[1].reset(), STORES, DRIVES),
}


@pytest.mark.parametrize("key", chosen(MODELS))
def test_every_verb(key: str) -> None:
    """All that the driver sends, one verb after the other; a verb that a model lacks sends nothing."""
    model = MODELS[key]
    with arm(model) as (bus, real):
        done = NO_KIND
        answer = real.hear

        def hearing(event: Packet | Corrupt, now: float) -> Replies:
            nonlocal done
            assert isinstance(event, Packet)
            real.advance(now)
            kinds = of(model, event).kinds
            done |= kinds
            if kinds & ~READS and not kinds & DRIVES:
                real.hear = answer  # type: ignore[method-assign] # or its copies would come here too
                check_still(real, event, kinds, deaf_twin(real))
                real.hear = hearing  # type: ignore[method-assign]
            return answer(event, now)

        real.hear = hearing  # type: ignore[method-assign]
        for name, (verb, must, must_not) in VERBS.items():
            done, was, before = NO_KIND, driven(real), real.position
            try:
                verb(bus)
            except UsageError:
                assert not done & ~READS, name
                continue
            bus.transport.sleep(0.5)
            real.advance(bus.transport.now())
            moved = abs(real.position - before) > STILL and name != "torque off"
            assert done & DRIVES or not (moved or driven(real) > was), f"{name} moves it, and is said to be {done}"
            assert done & must, f"{name} is said to be {done}"
            assert not done & must_not, f"{name} is said to be {done}"


def test_a_family_that_says_nothing_drives() -> None:
    class Silent(type(MODELS[D].family)):  # type: ignore[misc] # a class that is found at run time
        effect = Family.effect

    effect = Silent().effect(Packet(3, 2, bytes([36, 2])), lambda _: None)
    assert (effect.kinds, effect.ids) == (DRIVES, (3,))


@pytest.mark.parametrize("key", [D, H, L])
def test_it_never_fails(key: str) -> None:
    """Whatever a packet holds, something is said of it; of a write without a table, that it drives."""
    dice = random.Random(1)
    family, framing = MODELS[key].family, MODELS[key].family.framing
    for _ in range(3000):
        data = dice.randbytes(dice.randrange(min(40, framing.max_size - framing.overhead) + 1))
        one = Packet(dice.randrange(256), dice.randrange(256), data)
        effect = family.effect(one, lambda _: None)
        assert not effect.kinds & WRITES or effect.kinds & DRIVES, one
