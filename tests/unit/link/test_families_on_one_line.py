"""Families that share a line and a speed do not spoil each other's requests.

A HerkuleX takes FF FF and the id of a Dynamixel packet for the header and the size of one of its own (DRS-0602 manual
4-1, RX-28 manual 3-2), and the other way round.
"""

import asyncio
from collections.abc import Iterator

import pytest

import servobus
from servobus import DRS0602, FAMILIES, LX16A, RX28, Bus, deg
from servobus.core.framing import Decoder, Framing
from servobus.families import registry
from servobus.families.base import Model
from servobus.link.overheard import Overheard
from unit.served import Arm

DYNAMIXEL, HERKULEX, LEWANSOUL = (FAMILIES[name].framing for name in ("dynamixel", "herkulex", "lewansoul"))
SPEEDS = sorted(set(registry.bauds(FAMILIES["dynamixel"])) & set(registry.bauds(FAMILIES["herkulex"])))
IDS = (0, 2, 5, 7, 20, 85, 100, 139, 219, 223, 253)
Place = tuple[type[Model], int, int]


def placed(bus: Bus, speeds: list[int]) -> set[Place]:
    """Spread the servos over the speeds; give where each is."""
    places: set[Place] = set()
    for n, servo in enumerate(bus.transport.servos):  # type: ignore[attr-defined] # a virtual port
        if servo.model is not LX16A:
            servo.store_baud(speeds[n % len(speeds)])
        near = min(servo.model.bauds, key=lambda baud: abs(baud - servo.baud))
        places.add((servo.model, servo.id, near))
    return places


def found(bus: Bus) -> set[Place]:
    return {(servo.model, servo.id, servo.baud) for servo in bus}


@pytest.fixture
def drawer() -> Iterator[Bus]:
    with servobus.open(
        "virtual:rx28@0,85,219,253,drs0602@2,7,100,219,lx16a@5,219?clock=virtual", models="lx16a"
    ) as bus:
        yield bus


def test_N1_a_scan_of_all_ids_finds_each_where_it_is(drawer: Bus) -> None:
    places = placed(drawer, [115_200])
    drawer.scan(bauds=115_200)
    assert found(drawer) == places
    assert drawer.survey.troubles == []


def test_N1_a_scan_at_several_speeds_finds_each_where_it_is() -> None:
    with servobus.open("virtual:rx28@85,219,drs0602@2,219,lx16a@5?clock=virtual", models="lx16a") as bus:
        places = placed(bus, [115_200, 57_600, 1_000_000])
        bus.scan(bauds=(57_600, 115_200, 1_000_000), ids=(2, 5, 85, 219))
        assert found(bus) == places
        assert bus.survey.troubles == []


@pytest.mark.parametrize("baud", SPEEDS)
def test_N1_all_families_at_one_speed(drawer: Bus, baud: int) -> None:
    places = {place for place in placed(drawer, [baud]) if place[2] == baud}
    drawer.scan(bauds=baud, ids=IDS)
    assert found(drawer) == places
    assert drawer.survey.troubles == []


@pytest.mark.parametrize("id", IDS)
def test_N1_find_at_a_given_speed(id: int) -> None:
    with servobus.open(f"virtual:drs0602@{id}?clock=virtual", bauds=115_200) as bus:
        assert bus.find(id).model is DRS0602
        assert bus.find(id, bauds=[115_200]) is bus[id]
        assert bus.scan(ids=[id], bauds=115_200) == [bus[id]]
        assert bus.scan(ids=[id, id], bauds=(115_200, 115_200)) == [bus[id]]


def test_N1_a_scan_at_one_speed_leaves_no_alarm() -> None:
    with servobus.open("virtual:drs0602@20,219,253?clock=virtual") as bus:
        bus.scan(bauds=115_200)
        bus.transport.sleep(1.0)  # in which a HerkuleX gives up a packet, with an alarm
        assert [servo.read_alarms() for servo in bus] == [0, 0, 0]


def test_N1_families_are_read_in_turn() -> None:
    """On the factory settings none of these requests is heard by servos of the other family without padding."""
    with servobus.open("virtual:rx28@219,drs0602@100,lx16a@5?clock=virtual") as bus:
        servos = [bus.attach(model, id, baud=115_200) for model, id in ((RX28, 219), (DRS0602, 100), (LX16A, 5))]
        bus.transport.servos[0].store_baud(115_200)  # type: ignore[attr-defined] # a virtual port
        for _ in range(30):
            for servo in servos:
                servo.read("present_position")
        assert all(bus.stats.servo(servo.family.name, servo.id, servo.baud).retries == 0 for servo in servos)


def test_N1_families_move_together() -> None:
    with servobus.open("virtual:rx28@100,219,drs0602@9,100,lx16a@5?clock=virtual") as bus:
        for real in bus.transport.servos[:2]:  # type: ignore[attr-defined] # a virtual port
            real.store_baud(115_200)
        spots = ((RX28, 100), (RX28, 219), (DRS0602, 9), (DRS0602, 100), (LX16A, 5))
        servos = [bus.attach(model, id, baud=115_200) for model, id in spots]
        with bus.torque():
            bus.move(dict.fromkeys(servos, 60 * deg), time=1.0).wait()
            for servo in servos:
                assert servo.read("present_position") == pytest.approx(60 * deg, abs=2 * deg)
        assert not any(real.torque for real in bus.transport.servos)  # type: ignore[attr-defined] # a virtual port


def test_N1_on_an_asynchronous_bus_and_the_real_clock() -> None:
    """The fast path is taken here, where nothing stands against it."""

    async def main(name: str) -> None:
        async with servobus.open_async(name, echo=False) as bus:
            servos = [bus.attach(RX28, 219, baud=115_200), bus.attach(DRS0602, 100, baud=115_200)]
            for _ in range(5):
                for servo in servos:
                    await servo.read("present_position")

    with Arm("rx28@219,drs0602@100?baud=115200") as arm:
        asyncio.run(main(arm.name))
    with Arm("rx28@219,drs0602@100?baud=115200") as arm, arm.open() as bus:
        one, other = bus.attach(RX28, 219, baud=115_200), bus.attach(DRS0602, 100, baud=115_200)
        for _ in range(5):
            for servo in (one, one, other, other):
                servo.read("present_position")


# The rule itself

PING_219 = bytes.fromhex("FF FF DB 02 01 21")
"""Dynamixel PING (RX-28 manual 3-5-5) of id 219."""
STAT_100 = bytes.fromhex("FF FF 07 64 07 64 9A")
"""HerkuleX STAT (DRS-0602 manual 6-7) of id 100."""
LX_ID_5 = bytes.fromhex("55 55 05 03 0E E9")
"""LewanSoul SERVO_ID_READ (protocol document, point 8) of id 5."""


def heard(*sent: tuple[Framing, bytes]) -> Overheard:
    overheard = Overheard()
    for n, (framing, data) in enumerate(sent):
        overheard.note(0.01 * n, framing, data)
    return overheard


@pytest.mark.parametrize(
    ("sent", "framing", "request_", "padding"),
    [
        ([], HERKULEX, STAT_100, 0),
        ([(DYNAMIXEL, PING_219)], HERKULEX, STAT_100, 0xDB - 6),
        ([(DYNAMIXEL, PING_219)], DYNAMIXEL, PING_219, 0),
        ([(HERKULEX, STAT_100)], DYNAMIXEL, PING_219, 0x64 + 4 - 7),
        ([(DYNAMIXEL, PING_219), (HERKULEX, STAT_100)], HERKULEX, STAT_100, 0),
        ([(DYNAMIXEL, bytes.fromhex("FF FF 01 02 01 FB"))], HERKULEX, STAT_100, 0),
        ([(DYNAMIXEL, PING_219)], LEWANSOUL, LX_ID_5, 0),
        # Ends with 55, so that LX servos would take 55 55 55 05 for the header of id 85: one byte is enough to end it.
        ([(DYNAMIXEL, bytes.fromhex("FF FF 01 04 02 24 7F 55"))], LEWANSOUL, LX_ID_5, 5),
    ],
)
def test_N1_padding_is_as_long_as_the_packet_that_is_waited_for(
    sent: list[tuple[Framing, bytes]], framing: Framing, request_: bytes, padding: int
) -> None:
    overheard = heard(*sent)
    filled = overheard.padding(framing, 0.02, request_)
    assert filled == bytes(padding)
    foreign = [] if framing in (kind for kind, _ in sent) else [data for _, data in sent]
    events = Decoder(framing).feed(b"".join(foreign) + filled + request_)
    assert events[-1] == framing.unframe(request_)[0]


def test_N1_a_packet_that_servos_have_given_up_needs_no_padding() -> None:
    assert heard((DYNAMIXEL, PING_219)).padding(HERKULEX, 0.2, STAT_100)
    assert not heard((DYNAMIXEL, PING_219)).padding(HERKULEX, 0.22, STAT_100)
