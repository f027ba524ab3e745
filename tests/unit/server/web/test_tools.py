"""What stands behind the pages of packets, of the doctor and of the bench: no browser, no page."""

import asyncio
from collections.abc import Callable
from typing import Any, cast

import pytest

from servobus import RX28
from servobus.core.effect import Kind
from servobus.errors import BadValue, Stopped, UsageError
from servobus.remote.managing import BenchServo, Traffic
from servobus.server.web.composer import compose, read_bytes, send, template
from servobus.server.web.mending import Mend, carry_out, mend_of
from servobus.server.web.owner_link import OwnerLink
from servobus.server.web.page.parts.surroundings import faults_text, load_text, read_faults, torque_span
from servobus.server.web.served_bus import Actor
from servobus.server.web.traffic import SERVER, Filter, TrafficWatch
from unit.server.web.rig import KEYS, rig

ANNA = Actor("Anna")
PING = bytes.fromhex("FF FF 01 02 01 FB")
"""RX-28 manual, 3-5-5, example: PING to id 1."""
PONG = bytes.fromhex("FF FF 01 02 00 FC")
"""Its answer without an error."""


class Line:
    """An owner of ports that tells what the test says."""

    def __init__(self) -> None:
        self.told: Callable[[Traffic], object] | None = None

    async def watch_traffic(self, _: str, told: Callable[[Traffic], object]) -> None:
        self.told = told

    async def forget_traffic(self, _: str) -> None:
        self.told = None


def test_packets_are_seen_while_somebody_looks() -> None:
    async def look() -> None:
        line = Line()
        watch = TrafficWatch("arm", cast("OwnerLink", line), lambda: [(RX28.family, 1, RX28)])
        await watch.begin()
        await watch.begin()  # another page
        watch.take(Traffic("arm", 1.0, ">", PING, "Anna"))
        watch.take(Traffic("arm", 1.002, "<", PONG, "Anna", 3))
        watch.take(Traffic("arm", 1.5, ">", PING))
        first, second, third = watch.after(0)
        assert (first.by, first.entry["kind"], first.entry["text"]) == ("Anna", "request", "PING id 1")
        assert (second.by, second.entry["kind"], second.entry["direction"]) == ("Anna", "answer", "<")
        assert third.by == SERVER
        assert [one.number for one in watch.after(second.number)] == [third.number]
        assert watch.programs == {"Anna": 1, SERVER: 1}
        assert watch.missed == 3
        (servo,) = watch.servos()
        assert (servo["name"], servo["requests"], servo["answers"]) == ("dynamixel 1", 2, 1)
        assert Filter(by="Anna").of(watch.after(0)) == [first, second]
        assert Filter(text="fc").of(watch.after(0)) == [second]
        assert Filter(text="ping").of(watch.after(0))[0] == first
        assert Filter(servo="dynamixel 2").of(watch.after(0)) == []
        assert Filter(troubles=True).of(watch.after(0)) == []
        await watch.end()
        assert line.told is not None
        await watch.end()
        assert line.told is None

    asyncio.run(look())


def test_the_registers_of_servos_that_are_known_have_names() -> None:
    async def look() -> None:
        watch = TrafficWatch("arm", cast("OwnerLink", Line()), lambda: [(RX28.family, 1, RX28)])
        await watch.begin()
        # RX-28 manual, 3-5-2: READ_DATA of the present temperature, address 43.
        watch.take(Traffic("arm", 1.0, ">", bytes.fromhex("FF FF 01 04 02 2B 01 CC"), "Anna"))
        assert "present_temperature" in watch.after(0)[0].entry["text"]

    asyncio.run(look())


def test_nobody_looks_where_the_port_is_elsewhere() -> None:
    with pytest.raises(UsageError, match="seen where its port is open"):
        asyncio.run(TrafficWatch("arm", None, list).begin())


@pytest.mark.parametrize("text", ["1E 00 02", "0x1e, 0, 2", "1E0002", " 1e 0 02 "])
def test_bytes_as_people_type_them(text: str) -> None:
    assert read_bytes(text) == b"\x1e\x00\x02"


def test_no_bytes() -> None:
    with pytest.raises(BadValue, match="write them in hexadecimal"):
        read_bytes("1G")


def test_a_packet_gets_its_header_its_length_and_its_checksum() -> None:
    async def work() -> None:
        async with rig() as made:
            bus = made.service.bus("bench")
            ping = compose(bus, "dynamixel", 1, "01", "")
            assert (ping.raw, ping.text, ping.does) == (PING, "PING id 1", ["only asks"])
            assert "id 1" in await send(bus, ANNA, ping, 57_600)
            assert template(bus, KEYS[0]) == ("01", "")
            code, data = template(bus, KEYS[0], "present_temperature")
            assert (code, data) == ("02", "2B 01")  # RX-28 manual, 3-5-2
            for bad in (("dynamixel", 1, "0102", ""), ("dynamixel", 1, "", ""), ("dynamixel", 255, "01", "")):
                with pytest.raises(BadValue):
                    compose(bus, *bad)

    asyncio.run(work())


def test_a_packet_that_moves_needs_somebody_who_is_watched_and_no_stop() -> None:
    async def work() -> None:
        async with rig() as made:
            bus = made.service.bus("bench")
            goal = compose(bus, "dynamixel", 1, "03", "1E 00 02")  # RX-28 manual: goal position, address 30
            assert goal.effect.kinds & Kind.DRIVES
            assert "may move a servo" in goal.does
            with pytest.raises(UsageError, match="heartbeat"):
                await send(bus, ANNA, goal, 57_600)
            holder = made.service.holder("Anna")
            holder.watch(5.0)
            watched = Actor("Anna", holder)
            await send(bus, watched, goal, 57_600)
            assert bus.servo(KEYS[0]).permit.driven
            bus.latch(ANNA)
            with pytest.raises(Stopped):
                await send(bus, watched, goal, 57_600)

    asyncio.run(work())


@pytest.mark.parametrize(
    ("command", "mend"),
    [
        ("servobus rearm /dev/ttyUSB0 3", ("rearm", (3,), (), {})),
        ("for id in 1 4; do servobus torque p $id off; done", ("torque", (1, 4), ("off",), {})),
        ("servobus set-id p 1 5 --baud 1000000", ("set-id", (1,), ("5",), {"baud": "1000000"})),
        (
            "servobus set-baud p 2 57600 --family dynamixel --baud 1000000",
            ("set-baud", (2,), ("57600",), {"family": "dynamixel", "baud": "1000000"}),
        ),
        (
            "servobus write p 1 status_error=0 status_detail=0",
            ("write", (1,), ("status_error=0", "status_detail=0"), {}),
        ),
    ],
)
def test_commands_that_can_be_carried_out_from_here(command: str, mend: tuple[Any, ...]) -> None:
    found = mend_of(command)
    assert (found.verb, found.ids, found.words, found.options) == mend
    assert found.label
    assert found.question


@pytest.mark.parametrize(
    "command",
    [
        "kill 4711",
        "sudo tee /etc/x",
        "servobus torque p 1 on",
        "servobus remember p 1 MODEL",
        "servobus write p 1",
        "'",
    ],
)
def test_commands_that_are_to_be_typed(command: str) -> None:
    assert mend_of(command) == Mend(command)


def test_a_finding_is_mended() -> None:
    async def work() -> None:
        async with rig() as made:
            bus = made.service.bus("bench")
            await carry_out(bus, ANNA, mend_of("servobus set-id p 2 9 --family dynamixel"))
            assert {one.id for one in bus.bus if one.family.name == "dynamixel"} == {1, 9}
            await carry_out(bus, ANNA, mend_of("servobus write p 9 led=on"))
            assert (await bus.read("9", ["led"]))["led"]["value"] is True

    asyncio.run(work())


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("", {}),
        ("mute=0.05,latency=16ms", {"mute": 5.0, "latency": 16.0}),
        ("flip=2%", {"flip": 2.0}),
        ("mute#10", None),
        ("unplug@3", None),
        ("latency=2", None),
    ],
)
def test_faults_of_sliders(text: str, faults: dict[str, float] | None) -> None:
    assert read_faults(text) == faults
    if faults is not None:
        assert read_faults(faults_text(faults).replace("none", "")) == faults


def test_no_fault_is_none() -> None:
    assert faults_text({"mute": 0.0}) == "none"


def test_what_hangs_on_a_shaft() -> None:
    servo = BenchServo(
        0, "dynamixel", 1, "RX-28", 0, 0, 0, 12, 12, 14.4, 2.6, 25, False, "off", True, 0, 0, 0, 0, False, 2.8
    )  # fmt: skip
    assert load_text(servo, "torque", -0.5) == "torque=-0.5"
    assert load_text(servo, "mass", 0.2) == "mass=0.2,length=0.1"
    assert torque_span(servo) == 4.2
