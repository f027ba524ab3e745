"""What clients want to see: read once, at the lowest priority, and shared out at the rate of each."""

import asyncio
from collections.abc import Hashable, Mapping
from typing import Any

import pytest

import servobus
from servobus.bus.asyncio import AsyncBus
from servobus.bus.servo import Servo
from servobus.connect import transport
from servobus.core.operation import Priority
from servobus.errors import BadValue, UnknownName
from servobus.server.ports.telemetry import Subscriptions, Telemetry, Values, Wish, check_wish, overview, share, union
from servobus.transports.base import Transport


def test_the_union_asks_each_register_once() -> None:
    wishes = [
        Wish({"a": ("x", "y"), "b": ("x",)}, 0.1),
        Wish({"a": ("y", "z")}, 0.2),
    ]
    assert union(wishes) == {"a": ("x", "y", "z"), "b": ("x",)}


def test_each_is_given_what_it_wanted() -> None:
    seen = {"a": {"x": 1, "y": 2}, "b": {"x": 3}}
    assert share(Wish({"a": ("y",), "c": ("x",)}, 1.0), seen) == {"a": {"y": 2}}


def test_each_has_its_own_rate_and_missed_turns_are_not_made_up_for() -> None:
    subscriptions: Subscriptions[str] = Subscriptions()
    assert subscriptions.next_due() is None
    fast, slow = Wish({"a": ("x",)}, 0.1), Wish({"a": ("y",)}, 1.0)
    subscriptions.set("fast", fast, 10.0)
    subscriptions.set("slow", slow, 10.0)
    assert subscriptions.take_due(10.0) == {"fast": fast, "slow": slow}
    assert subscriptions.next_due() == pytest.approx(10.1)
    assert subscriptions.take_due(10.1) == {"fast": fast}
    assert subscriptions.take_due(10.65) == {"fast": fast}
    assert subscriptions.next_due() == pytest.approx(10.65)
    assert set(subscriptions.take_due(11.05)) == {"fast", "slow"}
    subscriptions.drop("fast")
    subscriptions.drop("fast")
    assert len(subscriptions) == 1


def test_a_new_wish_replaces_the_old() -> None:
    subscriptions: Subscriptions[str] = Subscriptions()
    subscriptions.set("one", Wish({"a": ("x",)}, 0.1), 0.0)
    subscriptions.set("one", Wish({"b": ("x",)}, 0.5), 0.0)
    assert subscriptions.take_due(0.0) == {"one": Wish({"b": ("x",)}, 0.5)}


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan"), float("inf"), 0.001, 61.0])
def test_periods_that_no_client_can_have(period: float) -> None:
    with pytest.raises(BadValue, match=r"of telemetry is not within 0\.005 \.\. 60 s"):
        Subscriptions[str]().set("one", Wish({}, period), 0.0)


Delivered = list[tuple[Hashable, Mapping[Servo, Values], Mapping[Servo, str]]]


def served(spec: str, wish: Any, *, turns: int = 2) -> Delivered:
    """Have the telemetry of virtual servos run until a client was shown so much."""
    told: Delivered = []

    async def run() -> None:
        async with servobus.open_async(f"virtual:{spec}") as bus:
            await bus.scan(ids=range(10))
            enough = asyncio.Event()

            def deliver(client: Hashable, _: float, seen: Any, lost: Any) -> None:
                told.append((client, seen, lost))
                if len(told) >= turns:
                    enough.set()

            telemetry = Telemetry(bus, deliver)
            reading = asyncio.create_task(telemetry.run())
            telemetry.subscribe("page", wish(bus))
            await asyncio.wait_for(enough.wait(), 10)
            reading.cancel()

    asyncio.run(run())
    return told


def test_servos_of_all_families_are_shown_in_their_units() -> None:
    def wish(bus: AsyncBus) -> Wish[Servo]:
        return Wish({servo: overview(servo) for servo in bus}, 0.05)

    here = {}

    def wish_and_look(bus: AsyncBus) -> Wish[Servo]:
        here.update({servo.id: servo.state.position for servo in bus if servo.state is not None})
        return wish(bus)

    told = served("rx28@1,drs0602@2,lx16a@3", wish_and_look)
    client, seen, lost = told[-1]
    assert client == "page"
    assert not lost
    assert [servo.id for servo in seen] == [1, 2, 3]
    for servo, values in seen.items():
        assert set(values) == set(overview(servo))
        assert values["present_position"] == pytest.approx(here[servo.id], abs=0.01)  # as the scan has seen it
        assert values["torque_enable"] in (False, 0)


def test_one_that_is_silent_is_told_and_the_others_go_on() -> None:
    def wish(bus: AsyncBus) -> Wish[Servo]:
        gone = bus.attach("rx28", 7, baud=bus[1].baud)
        return Wish({bus[1]: ("present_position",), gone: ("present_position",)}, 0.02)

    told = served("rx28@1", wish, turns=3)
    for _, seen, lost in told:
        assert [servo.id for servo in seen] == [1]
        assert [servo.id for servo in lost] == [7]
        assert "id 7" in next(iter(lost.values()))


class CountedBus(AsyncBus):
    """Counts the jobs of the lowest priority."""

    def __init__(self, transport: Transport) -> None:
        self._counted = 0
        super().__init__(transport)

    async def do(self, job: Any, baud: int | None = None, *, priority: Priority = Priority.READ) -> Any:
        if priority is Priority.SCAN:
            self._counted += 1
        return await super().do(job, baud, priority=priority)

    @property
    def counted(self) -> int:
        return self._counted


def test_commands_come_before_telemetry() -> None:
    """While the telemetry of 20 servos is read at full rate, a command waits for a few of them at most."""

    async def run() -> None:
        async with CountedBus(transport("virtual:rx28@1-20")) as bus:
            servos = [bus.attach("rx28", id) for id in range(1, 21)]
            seen = asyncio.Event()
            telemetry = Telemetry(bus, lambda *_: seen.set())
            reading = asyncio.create_task(telemetry.run())
            telemetry.subscribe("page", Wish(dict.fromkeys(servos, ("present_position",)), 0.005))
            await asyncio.wait_for(seen.wait(), 10)
            for _ in range(10):
                await asyncio.sleep(0.003)
                before = bus.counted
                await bus[20].read("present_voltage")
                assert bus.counted - before <= 1
            reading.cancel()

    asyncio.run(run())


def test_registers_that_cannot_be_shown_are_named() -> None:
    async def run() -> None:
        async with servobus.open_async("virtual:rx28@1") as bus:
            (servo,) = await bus.scan(ids=[1])
            assert check_wish(servo, ["present_position", "present_position"]) == ("present_position",)
            with pytest.raises(UnknownName, match="no_such"):
                check_wish(servo, ["no_such"])

    asyncio.run(run())
