"""Several servos read by one request: BULK_READ of the MX series, beside servos that are asked alone."""

from typing import Any

import pytest

from drivers import result_of
from faults.rig import Port
from samples import models_that
from servobus import DRS0602, BadValue, Bus, Refused, UsageError, dynamixel1
from servobus.bus.asyncio import AsyncBus
from servobus.families.base import Answers, Model
from servobus.families.dynamixel.models.ax import AX12A
from servobus.families.dynamixel.models.mx import MX28, MX64
from unit.lossy import ASYNC, DRIVERS

FAST = 1_000_000
EIGHT = ("present_position", "present_speed", "present_load", "present_voltage", "present_temperature")
"""Address 36 to 43 of an MX-28: 8 bytes."""
BULK_READ, READ_DATA = 0x92, 0x02


class Alone(MX28):
    """The same servo, never asked along with others."""

    answers_together = False


def opened(spec: str, driver: str = "sync", faults: str = "", model: type[Model] | None = None) -> tuple[Any, Port]:
    """Open a bus that knows all these servos, at 1 Mbit/s; as `model`, if it is given."""
    port = Port(f"virtual:{spec}?clock=virtual&baud={FAST}" + (f"&faults={faults}" if faults else ""))
    bus: Any = (AsyncBus if driver == ASYNC else Bus)(port, echo=False)
    for real in port.servos:
        bus.attach(model or real.model, real.id, baud=FAST)
    port.set_baud(FAST)
    port.sent.clear()
    return bus, port


def codes(port: Port) -> list[int]:
    """Give the instructions that were sent, and send no more of them."""
    sent = [request[4] for request in port.sent]
    port.sent.clear()
    return sent


@DRIVERS
@models_that(lambda model: model.answers_together)
def test_read_all_asks_all_at_once(key: str, driver: str) -> None:
    bus, port = opened(f"{key}@1-3", driver)
    for real, angle in zip(port.servos, (0.5, 1.0, 1.5), strict=True):
        real.turn_shaft(angle)
    seen = result_of(bus.read_all("present_position"))
    assert seen.by_id() == pytest.approx({1: 0.5, 2: 1.0, 3: 1.5}, abs=0.005)
    # ROBOTIS e-manual, Protocol 1.0, Bulk Read: FE, length 3n + 3, 92, 00, then length, id and address of each.
    body = bytes.fromhex("FE 0C 92 00 02 01 24 02 02 24 02 03 24")
    assert port.sent == [b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))]


@DRIVERS
def test_a_mixed_line_asks_the_others_alone(driver: str) -> None:
    bus, port = opened("mx28@1,ax12a@2,mx64@3,ax12a@4,mx28@5", driver)
    seen = result_of(bus.read_all("present_temperature"))
    assert seen == dict.fromkeys((1, 2, 3, 4, 5), 25.0)
    assert [servo.model for servo in seen] == [MX28, AX12A, MX64, AX12A, MX28]
    assert codes(port) == [BULK_READ, READ_DATA, READ_DATA]
    cycle = bus.cycle(EIGHT, write=())
    for _ in range(3):
        seen = result_of(cycle.run())
        assert seen.lost == {}
        assert [seen[id]["present_voltage"] for id in (1, 3, 5)] == [12.0] * 3
        assert [seen[id]["present_voltage"] for id in (2, 4)] == pytest.approx([11.1] * 2)
        assert codes(port) == [BULK_READ, READ_DATA, READ_DATA]


def test_another_family_on_the_line_is_asked_as_before() -> None:
    bus, port = opened("mx28@1-2,drs0602@3")
    assert bus.read_all("present_position").lost == {}
    assert sum(request[4] == BULK_READ for request in port.sent) == 1
    assert [servo.model for servo in bus.cycle(EIGHT[:1], write=()).run()] == [MX28, MX28, DRS0602]


def test_one_alone_is_read_alone() -> None:
    bus, port = opened("mx28@1,ax12a@2")
    assert bus.read_all("present_position").lost == {}
    assert codes(port) == [READ_DATA, READ_DATA]


def test_registers_far_apart_take_two_requests_each_of_all() -> None:
    bus, port = opened("mx28@1-3")
    cycle = bus.cycle(("torque_limit", "firmware_version"), write=())
    assert cycle.run().lost == {}
    assert codes(port) == [BULK_READ, BULK_READ]
    assert cycle.plan().count("BULK_READ ids 1, 2, 3") == 2


def test_a_packet_holds_45_and_the_rest_go_in_the_next() -> None:
    """143 bytes of the receive buffer: 6 of frame, one 00, and 3 for each servo."""
    bus, port = opened("mx28@1-50")
    cycle = bus.cycle("present_position", write=())
    assert len(cycle.run()) == 50
    assert [len(request) for request in port.sent] == [142, 22]
    assert cycle.plan().count("BULK_READ") == 2
    with pytest.raises(BadValue, match="does not fit"):
        dynamixel1.bulk_read(dict.fromkeys(range(46), (36, 2)))


def test_a_servo_that_answers_no_reads_is_left_out() -> None:
    bus, port = opened("mx28@1-3")
    port.servos[1].memory.store(MX28.status_return_level, 0)
    port.servos[1].power_on(0.0)
    bus.attach(MX28, 2, baud=FAST, answers=Answers.NOTHING)
    seen = bus.read_all("present_position")
    assert (sorted(servo.id for servo in seen), isinstance(seen.lost[2], UsageError)) == ([1, 3], True)
    assert codes(port) == [BULK_READ]


def test_the_instruction_by_hand() -> None:
    """Each its own bytes; what one refuses is its own."""
    bus, port = opened("mx28@1-3")
    job = dynamixel1.bulk_read({3: (0, 2), 1: (200, 1), 2: (3, 1)})
    number, refused, id = bus.do(job)
    assert (number, id) == (b"\x1d\x00", b"\x02")
    assert isinstance(refused, Refused)
    assert codes(port) == [BULK_READ]


def test_alarms_and_counters_are_those_of_each() -> None:
    bus, port = opened("mx28@1-3")
    port.servos[1].temperature = 110.0
    port.sleep(0.1)
    bus.read_all("present_position")
    assert [bool(bus[id].alarms) for id in (1, 2, 3)] == [False, True, False]
    assert [(bus.stats[id].sent, bus.stats[id].received) for id in (1, 2, 3)] == [(1, 1)] * 3


@pytest.mark.parametrize("delay", [0, 250], ids=["return delay 0", "return delay from the factory"])
@pytest.mark.parametrize(("latency", "times"), [("", 1.04), ("latency=1ms", 2.0)], ids=["no latency", "adapter 1 ms"])
def test_it_is_faster_than_asking_each(latency: str, times: float, delay: int) -> None:
    """8 bytes of six MX-28: (7 + 3 * 6) + 6 * 14 bytes in place of 6 * (8 + 14), and the adapter's delay once."""
    took: dict[bool, float] = {}
    for together in (True, False):
        bus, port = opened("mx28@1-6", faults=latency, model=None if together else Alone)
        for real in port.servos:
            real.memory[MX28.return_delay_time] = delay
        cycle = bus.cycle(EIGHT, write=())
        for _ in range(20):
            cycle.run()
        codes(port)
        began = port.now()
        for _ in range(10):
            assert cycle.run().lost == {}
        took[together] = port.now() - began
        assert codes(port) == ([BULK_READ] if together else [READ_DATA] * 6) * 10
    assert took[False] / took[True] > times


@pytest.mark.parametrize("odd", [1, 3, 6])
def test_a_servo_that_does_not_know_the_request_after_all(odd: int) -> None:
    """An AX-12A stands for a firmware without BULK_READ: it is found out, and nobody's values fail any more."""
    spec = ",".join(f"{'ax12a' if id == odd else 'mx28'}@{id}" for id in range(1, 7))
    bus, port = opened(spec, model=MX28)
    cycle = bus.cycle("present_temperature", write=())
    lost = [id for _ in range(8) for id in cycle.run().lost.by_id()]
    assert lost == [odd] * (0 if odd == 1 else 3)  # once in two cycles; where none answers, all are asked alone
    codes(port)
    for _ in range(5):
        assert cycle.run().lost == {}
    assert codes(port) == [BULK_READ, READ_DATA] * 5
    assert bus.read_all("present_temperature").lost == {}


def test_a_servo_that_is_away_is_asked_alone_and_the_others_together() -> None:
    bus, port = opened("mx28@1-6")
    cycle = bus.cycle(EIGHT, write=())
    assert cycle.run().lost == {}
    port.inject("unplug@3#1-")
    for _ in range(3):
        seen = cycle.run()
    assert list(seen.lost.by_id()) == [3]
    assert sorted(servo.id for servo in seen) == [1, 2, 4, 5, 6]
    codes(port)
    cycle.run()
    assert codes(port) == [BULK_READ]
    port.inject(None)
    port.sleep(1.0)
    cycle.run()
    cycle.run()
    assert cycle.run().lost == {}
    assert codes(port)[-1] == BULK_READ
