"""Control cycles on virtual servos. Packets are the manuals', figures counted from them."""

import asyncio
import math
from typing import Any

import pytest

import servobus
from samples import sample_models
from servobus import DRS0602, LX16A, MODELS, BadValue, Bus, NoReply, TorqueOff, UnknownName, UsageError, deg
from servobus.bus.cycle import diagnose

POSITION = ("present_position",)


def bus_of(key: str, count: int) -> Any:
    bus = servobus.open(f"virtual:{key}@1-{count}?clock=virtual")
    for id in range(1, count + 1):
        bus.attach(MODELS[key], id)
    return bus


@sample_models
def test_goals_arrive_and_positions_come_back(key: str) -> None:
    bus = bus_of(key, 3)
    cycle = bus.cycle(read=POSITION, time=0.0)
    bus.torque_on(list(bus))
    goals = {id: (20 + 10 * id) * deg for id in (1, 2, 3)}
    for _ in cycle.every(0.05):
        seen = cycle.run(goals)
        if abs(seen[3]["present_position"] - goals[3]) < 2 * deg:
            break
        assert bus.transport.now() < 5
    bus.transport.sleep(1.0)
    seen = cycle.run()
    assert seen.lost == {}
    assert {servo.id: value["present_position"] for servo, value in seen.items()} == pytest.approx(goals, abs=2 * deg)


def test_plan_counts_the_bits() -> None:
    """20 goals: 8 + 20 * 3 bytes (3-5-7); 20 reads of 8 and 6 + 6 bytes: 468 bytes of 10 bits."""
    text = bus_of("rx28", 20).cycle().plan()
    assert text.splitlines()[0] == "cycle of 20 servos: 81.25 ms of wire, at most 12 a second"
    assert "    68     -" in text
    assert text.count("8    12    3.47  READ_DATA id") == 20


def test_many_goals_take_as_many_packets_as_their_size_needs() -> None:
    """143 bytes hold (143 - 8) / 3 = 45 servos; S_JOG holds 53 (HerkuleX 5-1)."""
    assert bus_of("rx28", 46).cycle().plan().count("SYNC_WRITE") == 2
    assert bus_of("rx28", 45).cycle().plan().count("SYNC_WRITE") == 1
    assert bus_of("drs0602", 53).cycle().plan().count("S_JOG") == 1
    assert bus_of("lx16a", 1).cycle(read=POSITION).plan().count("MOVE_START") == 0
    assert bus_of("lx16a", 2).cycle(read=POSITION).plan().count("MOVE_START") == 1


def test_one_lost_answer_loses_one_servo_once() -> None:
    bus = bus_of("rx28", 5)
    cycle = bus.cycle()
    cycle.run()
    bus.transport.inject("mute#3")
    seen = cycle.run()
    assert sorted(seen.by_id()) == [1, 2, 4, 5]
    assert isinstance(seen.lost[3], NoReply)
    assert sorted(cycle.run().by_id()) == [1, 2, 3, 4, 5]


@sample_models
def test_a_cut_chain_is_told_and_costs_little_until_it_is_mended(key: str) -> None:
    """F15"""
    bus = bus_of(key, 6)
    cycle = bus.cycle(read=POSITION)
    cycle.run()
    start = bus.transport.now()
    bus.transport.inject(f"unplug@4-6#{start + 0.001}s-{start + 2}s")
    bus.transport.sleep(0.01)
    for _ in range(2):
        seen = cycle.run()
        assert sorted(seen.by_id()) == [1, 2, 3]
        assert seen.diagnosis == "all after id 3 do not answer: cable or power between 3 and 4?"
    before = bus.transport.now()
    cycle.run()
    lost = bus.transport.now() - before
    bus.transport.sleep(4)
    for _ in range(2):
        seen = cycle.run()
    assert sorted(seen.by_id()) == [1, 2, 3, 4, 5, 6]
    before = bus.transport.now()
    cycle.run()
    assert lost <= bus.transport.now() - before


def test_diagnosis() -> None:
    chain = [3, 1, 2, 7]
    assert diagnose(chain, []) == ""
    assert diagnose(chain, [2, 7]) == "all after id 1 do not answer: cable or power between 1 and 2?"
    assert diagnose(chain, [1]) == "id 1 alone does not answer: its plug or its power?"
    assert diagnose(chain, chain).startswith("no servo answers")
    assert diagnose(chain, [3, 2]).startswith("ids 3, 2 do not answer, others behind")


@pytest.mark.parametrize("goal", [math.nan, math.inf, 301 * deg, -1.0])
def test_a_goal_that_cannot_be_sends_nothing(goal: float) -> None:
    bus = bus_of("rx28", 2)
    cycle = bus.cycle()
    with pytest.raises(BadValue):
        cycle.run({1: 100 * deg, 2: goal})
    assert bus.stats.total.sent == 0


def test_goals_that_would_not_be_followed() -> None:
    bus = bus_of("rx28", 2)
    cycle = bus.cycle()
    with pytest.raises(TorqueOff, match="RX-28 id 1"):
        cycle.run({1: 150 * deg})
    bus.torque_on(list(bus))
    cycle.run({1: 150 * deg})
    bus[1].max_step = 10 * deg
    with pytest.raises(BadValue, match="max_step"):
        cycle.run({1: 170 * deg})
    bus[1].torque_off()
    with pytest.raises(TorqueOff):
        cycle.run({1: 150 * deg})
    with pytest.raises(UnknownName, match="no servo with id 9 is in this cycle"):
        cycle.run({9: 0.0})
    with pytest.raises(UsageError, match="only reads"):
        bus.cycle(write=()).run({1: 1.0})


def test_what_cannot_be_prepared() -> None:
    bus = bus_of("lx16a", 2)
    with pytest.raises(UnknownName, match="LX-16A id 1"):
        bus.cycle()
    with pytest.raises(UsageError, match="goal_position"):
        bus.cycle(read=POSITION, write=["led"])
    with pytest.raises(UsageError):
        bus.cycle(read=(), write=())
    with pytest.raises(BadValue):
        bus.cycle(read=POSITION, time=31)
    with pytest.raises(UsageError, match="twice"):
        bus.cycle(read=POSITION, servos=[1, 1])


def test_several_families_and_a_new_id() -> None:
    bus: Bus = servobus.open("virtual:drs0602@1,lx16a@2?clock=virtual")
    bus.attach(DRS0602, 1)
    bus.attach(LX16A, 2)
    cycle = bus.cycle(read=POSITION)
    assert sorted(cycle.run().by_id()) == [1, 2]
    bus[1].change_id(5)
    assert sorted(cycle.run().by_id()) == [2, 5]


def test_async() -> None:
    async def main() -> None:
        async with servobus.open_async("virtual:rx28@1-2?clock=virtual") as bus:
            await bus.scan(ids=range(3))
            cycle = bus.cycle()
            async for tick in cycle.every(0.02):
                assert sorted((await cycle.run()).by_id()) == [1, 2]
                if tick.number == 3:
                    break

    asyncio.run(main())


def test_goals_are_judged_by_the_mode_that_a_servo_has_by_now() -> None:
    """An MX-28 takes goals beyond a turn in multi-turn mode alone, and none as a wheel; an LX-16A none as a motor."""
    bus = servobus.open("virtual:mx28@1,lx16a@2?clock=virtual", models={2: LX16A})
    bus.scan(ids=[1, 2])
    bus.torque_on()
    turns, cycle = bus[1], bus.cycle(read=POSITION)
    cycle.run({1: 170 * deg, 2: 100 * deg})
    turns.position_mode(multi_turn=True)
    cycle.run({1: 400 * deg})
    bus.transport.sleep(2.0)
    assert abs(cycle.run()[1]["present_position"] - 400 * deg) < 3 * deg
    cycle.run({1: 170 * deg})
    bus.transport.sleep(2.0)
    turns.position_mode()
    with pytest.raises(BadValue, match="outside the limits"):
        cycle.run({1: 400 * deg})
    cycle.run({1: 180 * deg})
    bus.transport.sleep(1.0)
    turns.write_many({"max_position": 200 * deg})
    with pytest.raises(BadValue, match="outside the limits"):
        cycle.run({1: 210 * deg})
    turns.turn(speed=5 * deg)
    bus[2].turn(output=0.1)
    for id in (1, 2):
        with pytest.raises(UsageError, match="turns without end"):
            cycle.run({id: 100 * deg})
