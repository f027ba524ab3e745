"""A server's ports, their clients, and what each of them may do: seen from the clients, and judged by the servos."""

import asyncio
import json
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import pytest

from servobus import RX28, Bus
from servobus.bus.blocking import BusServo
from servobus.errors import BusError, Held, PortError, Stopped, UnknownName, UsageError
from servobus.remote.managing import (
    CloseBus,
    Happened,
    Introduce,
    ListServos,
    OpenBus,
    Resume,
    SaveBox,
    Servos,
    StopServos,
    Subscribe,
    TakeLease,
    Telemetry,
    Traffic,
    WatchEvents,
    WatchTraffic,
)
from servobus.remote.session import RemoteSession
from servobus.server.ports.control import Place
from servobus.server.ports.served_bus import key_of
from servobus.traffic.recording import Chunk, Note, parse
from servobus.virtual.device.servo import VirtualServo
from unit.remote.hosted import PATIENCE, TOKEN, VIEWER, Owned

T = TypeVar("T")

ONE = "dynamixel:1@57600"
TWO = "dynamixel:2@57600"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Owned]:
    with Owned({"arm": "virtual:rx28@1,2"}, tmp_path / "boxes") as hosted:
        yield hosted


def truth(server: Owned, id: int) -> VirtualServo:
    """Give the servo itself."""
    servos: list[VirtualServo] = server.owner.buses["arm"].tap.servos
    return next(servo for servo in servos if servo.id == id)


def speed(server: Owned, id: int) -> float:
    """Give how fast the shaft turns, rad/s."""
    return abs(truth(server, id).shaft.velocity)


def within(condition: Callable[[], bool]) -> None:
    """Wait until something is so."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


async def until(condition: Callable[[], bool]) -> None:
    """Wait in a loop until something is so."""
    await asyncio.to_thread(within, condition)


def moving(bus: Bus, id: int) -> BusServo:
    """Have a servo move for seconds."""
    servo = bus.attach(RX28, id)
    servo.torque_on()
    servo.move(0.0, speed=0.5)
    return servo


def talk(server: Owned, work: Callable[[RemoteSession], Awaitable[T]], token: str = TOKEN, **how: Any) -> T:
    """Do something as a client of the server."""

    async def session() -> T:
        async with RemoteSession(server.address("arm"), token=token, **{"name": "Anna", **how}) as client:
            return await asyncio.wait_for(work(client), PATIENCE)

    return asyncio.run(session())


def sorted_into(telemetry: list[Telemetry], happened: list[Happened]) -> Callable[[Any], None]:
    """Give what puts messages where they belong."""

    def told(message: Any) -> None:
        if isinstance(message, Telemetry):
            telemetry.append(message)
        elif isinstance(message, Happened):
            happened.append(message)

    return told


# Who may move what


def test_servos_of_every_family_are_driven_and_let_go(tmp_path: Path) -> None:
    """Also those whose requests nobody answers: silence that was expected is no answer."""
    with (
        Owned({"all": "virtual:rx28@1,drs0602@2,lx16a@3"}, tmp_path / "boxes") as hosted,
        hosted.bus("all", models="lx16a") as bus,
    ):
        for servo in bus.scan(ids=[1, 2, 3]):
            servo.torque_on()
            assert servo.look().torque
            servo.stop()
            servo.torque_off()
            assert not servo.look().torque


def test_a_program_that_leaves_has_its_servos_made_safe_and_those_of_others_go_on(server: Owned) -> None:
    with server.bus("arm") as other:
        moving(other, 2)
        with server.bus("arm") as bus:
            moving(bus, 1)
            within(lambda: speed(server, 1) > 0.1)
        within(lambda: speed(server, 1) < 0.01)
        assert truth(server, 1).shaft.position != pytest.approx(0.0, abs=0.1)
        assert speed(server, 2) > 0.1


def test_a_servo_has_one_holder_and_the_refusal_names_it(server: Owned) -> None:
    with server.bus("arm") as mine, server.bus("arm") as other:
        moving(mine, 1)
        servo = other.attach(RX28, 1)
        assert servo.read(RX28.torque_enable)  # reading is for all
        with pytest.raises(
            Held, match=r"dynamixel:1@57600 on bus arm is held by a test: a test may read it; take the lease over"
        ):
            servo.write("led", 1)
        moving(other, 2)


def test_a_lease_is_taken_over_and_the_servo_stopped(server: Owned) -> None:
    async def over(client: RemoteSession) -> str:
        with pytest.raises(Held):
            await client.ask(TakeLease, bus="arm", servos=(ONE,))
        await client.ask(TakeLease, bus="arm", servos=(ONE,), over=True)
        listed: Servos = await client.ask(ListServos, bus="arm")
        return next(one.holder for one in listed.servos if one.key == ONE)

    with server.bus("arm") as bus:
        servo = moving(bus, 1)
        within(lambda: speed(server, 1) > 0.1)
        assert talk(server, over) == "Anna"
        within(lambda: speed(server, 1) < 0.01)
        # Anna has gone, so nobody holds it any more.
        servo.move(0.0, speed=0.5)
        within(lambda: speed(server, 1) > 0.1)


def test_who_hangs_has_its_servos_made_safe(server: Owned) -> None:
    """A page whose signs of life stop; the connection itself stands."""

    async def hang(client: RemoteSession) -> None:
        await client.ask(Introduce, bus="arm", servo=ONE, model="rx28")
        await client.ask(TakeLease, bus="arm", servos=(ONE,))
        owner = server.owner
        for _ in range(5):
            client.beat()
            await asyncio.sleep(0.05)
        assert server.told(lambda: [one.name for one in map(owner.control.leases.holder, [Place("arm", ONE)]) if one])
        await until(lambda: owner.control.leases.holder(Place("arm", ONE)) is None)

    talk(server, hang, client="page", deadman=0.3)


def test_a_viewer_only_looks(server: Owned) -> None:
    async def look(client: RemoteSession) -> None:
        for kind, fields in (
            (TakeLease, {"bus": "arm", "servos": (ONE,)}),
            (Resume, {"bus": "arm"}),
            (OpenBus, {"bus": "leg", "port": "virtual:rx28@1"}),
            (CloseBus, {"bus": "arm"}),
            (SaveBox, {"bus": "arm", "why": "asked"}),
            (Introduce, {"bus": "arm", "servo": ONE, "model": "rx28"}),
        ):
            with pytest.raises(UsageError, match="Anna may not do this: it takes the token of operator, not of viewer"):
                await client.ask(kind, **fields)
        await client.ask(ListServos, bus="arm")
        await client.ask(StopServos)  # a stop is for everybody

    talk(server, look, token=VIEWER)


def test_nobody_comes_in_without_a_token(server: Owned) -> None:
    with pytest.raises(PortError, match="the token is not one of this server"):
        talk(server, lambda _: asyncio.sleep(0), token="guess")


# Stops


def test_a_stop_is_for_everybody_and_lasts_until_it_is_lifted(server: Owned) -> None:
    with server.bus("arm") as bus:
        servo, other = moving(bus, 1), moving(bus, 2)
        within(lambda: speed(server, 1) > 0.1 < speed(server, 2))
        talk(server, lambda client: client.ask(StopServos))
        within(lambda: speed(server, 1) < 0.05 > speed(server, 2))
        with pytest.raises(Stopped, match=r"was stopped by Anna and must not move until somebody resumes it"):
            servo.write("goal_position", 0.0)
        assert servo.read(RX28.torque_enable)
        other.torque_off()  # what makes it safer is not forbidden
        talk(server, lambda client: client.ask(Resume, bus="arm"))
        servo.move(0.0, speed=0.5)
        within(lambda: speed(server, 1) > 0.1)


def test_one_servo_is_stopped_and_the_other_goes_on(server: Owned) -> None:
    with server.bus("arm") as bus:
        servo = moving(bus, 1)
        moving(bus, 2)
        within(lambda: speed(server, 1) > 0.1 < speed(server, 2))
        talk(server, lambda client: client.ask(StopServos, bus="arm", servos=(ONE,)))
        within(lambda: speed(server, 1) < 0.05)
        assert speed(server, 2) > 0.1
        with pytest.raises(Stopped):
            servo.move(0.0, speed=0.5)


def test_the_end_of_the_server_makes_all_safe(tmp_path: Path) -> None:
    with Owned({"arm": "virtual:rx28@1,2"}, tmp_path) as hosted:
        bus = hosted.bus("arm")
        moving(bus, 1)
        within(lambda: speed(hosted, 1) > 0.1)
        servo, goal = truth(hosted, 1), truth(hosted, 1).get("goal_position")
    held = servo.get("goal_position")
    assert held != goal
    assert abs(held - servo.get("present_position")) < 20  # it coasts for a moment yet
    bus.close()


# What is to be seen


def test_all_that_is_met_is_shown_and_said(server: Owned) -> None:
    told: list[Telemetry] = []
    happened: list[Happened] = []

    async def watch(client: RemoteSession) -> None:
        client.told = sorted_into(told, happened)
        await client.ask(WatchEvents)
        await client.ask(Subscribe, bus="arm", servos=(), period=0.02)
        await asyncio.to_thread(scan)
        await until(lambda: any(len(one.seen) == 2 for one in told))

    def scan() -> None:
        with server.bus("arm") as bus:
            bus.scan(family="dynamixel", bauds=57_600, ids=[1, 2, 3])

    talk(server, watch)
    last = told[-1]
    assert last.bus == "arm"
    assert {one.servo for one in last.seen} == {ONE, TWO}
    for one in last.seen:
        values = dict(one.values)
        assert values["torque_enable"] in (False, 0)
        assert 8 < float(values["present_voltage"]) < 20  # type: ignore[arg-type] # a voltage is a number
    appeared = [one for one in happened if one.what == "appeared"]
    assert {one.servo: json.loads(one.data)["model"] for one in appeared} == {ONE: "RX-28", TWO: "RX-28"}


def test_a_servo_that_falls_silent_and_comes_back_is_told(server: Owned) -> None:
    happened: list[Happened] = []

    async def watch(client: RemoteSession) -> None:
        client.told = sorted_into([], happened)
        await client.ask(WatchEvents)
        with pytest.raises(UnknownName, match="no servo dynamixel:9@57600 was met on bus arm"):
            await client.ask(TakeLease, bus="arm", servos=("dynamixel:9@57600",))
        await asyncio.to_thread(ask)
        await until(lambda: "lost" in [one.what for one in happened])

    def ask() -> None:
        with server.bus("arm") as bus:
            servo = bus.attach(RX28, 1)
            servo.ping()
            server.owner.buses["arm"].tap.inject("drop=1")
            for _ in range(3):
                with suppress(BusError):
                    servo.ping()

    talk(server, watch)
    assert [one.servo for one in happened if one.what == "lost"] == [ONE]


def test_what_nothing_answers_brings_no_servo(server: Owned) -> None:
    """Goals for several servos are one packet to all (SYNC_WRITE, RX-28 manual 3-5-7), which none answers."""
    with server.bus("arm") as bus:
        moved = [bus.attach(RX28, 1), bus.attach(RX28, 2)]
        bus.torque_on(moved)
        bus.move(dict.fromkeys(moved, 1.0), speed=0.5)
        assert server.told(lambda: sorted(servo.id for servo in server.owner.buses["arm"].bus)) == [1, 2]


def test_traffic_is_told_with_who_asked(server: Owned) -> None:
    pieces: list[Traffic] = []

    async def watch(client: RemoteSession) -> None:
        client.told = pieces.append
        await client.ask(WatchTraffic, bus="arm", on=True)
        await asyncio.to_thread(ask)
        await until(lambda: answers().endswith(bytes.fromhex("FFFF010200FC")))
        await client.ask(WatchTraffic, bus="arm", on=False)

    def ask() -> None:
        with server.bus("arm") as bus:
            bus.attach(RX28, 1).ping()

    def answers() -> bytes:
        return b"".join(one.data for one in pieces if one.direction == "<")

    talk(server, watch)
    ping = bytes.fromhex("FFFF010201FB")  # RX-28 manual 3-4: PING of id 1
    assert any(ping in one.data and one.by == "a test" for one in pieces if one.direction == ">")


def test_the_black_box_is_a_recording_with_events(server: Owned) -> None:
    with server.bus("arm") as bus:
        bus.attach(RX28, 1).torque_on()
    path = talk(server, lambda client: client.ask(SaveBox, bus="arm", why="asked")).text
    recording = parse(Path(path).read_bytes())
    assert any(isinstance(line, Chunk) for line in recording.lines)
    assert {"appeared", "lease", "moved", "stopped"} <= {one.kind for one in recording.lines if isinstance(one, Note)}


def test_buses_come_and_go_while_others_work(server: Owned) -> None:
    async def open_and_close(client: RemoteSession) -> None:
        await client.ask(OpenBus, bus="leg", port="virtual:rx28@1")
        with pytest.raises(UsageError, match="there is a bus 'leg' already"):
            await client.ask(OpenBus, bus="leg", port="virtual:rx28@1")
        with pytest.raises(PortError):
            await client.ask(OpenBus, bus="foot", port="/dev/no-such-port")
        assert (await client.ask(ListServos, bus="leg")).servos == ()
        await client.ask(CloseBus, bus="leg")
        with pytest.raises(UsageError, match="no bus 'leg' here; there are: arm"):
            await client.ask(ListServos, bus="leg")

    with server.bus("arm") as bus:
        servo = moving(bus, 1)
        talk(server, open_and_close)
        assert servo.read(RX28.torque_enable)


def test_a_new_id_goes_with_the_lease(server: Owned) -> None:
    with server.bus("arm") as bus:
        servo = bus.attach(RX28, 1)
        servo.torque_on()
        servo.torque_off()
        servo.change_id(7)
        holders = server.told(lambda: {key: str(one) for key, one in server.owner.control.leases.all().items()})
        assert list(holders) == [("arm", "dynamixel:7@57600")]


def test_a_speed_is_called_as_people_call_it(server: Owned) -> None:
    """57600 is 57143 by the divider of an RX-28 (manual 3-4-1); the servo is the same as before."""
    with server.bus("arm") as bus:
        servo = bus.attach(RX28, 1)
        servo.change_baud(115_200)
        servo.change_baud(57_600)
        assert server.told(lambda: [key_of(one) for one in server.owner.buses["arm"].bus]) == [ONE]
