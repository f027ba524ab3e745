"""Control loops on a line that goes wrong: a chain that is cut, a computer that stalls (F15, F22)."""

import itertools
from collections.abc import AsyncIterator
from typing import Any

from faults.rig import FaultRig
from samples import sample_models
from servobus import deg
from servobus.bus.cycle import Cycle
from unit.lossy import ASYNC, DRIVERS

PERIOD = 0.05
"""s; long enough for three servos of any family at their factory speed."""


def cycle_of(rig: FaultRig) -> Any:
    """Prepare a cycle that reads and writes positions."""
    cycle: Cycle = rig.bus.cycle(read=("present_position",), write=("goal_position",))
    return cycle


@DRIVERS
@sample_models
def test_F15_all_behind_the_cut_are_told_together(key: str, driver: str) -> None:
    """Servos 3 to 5 of a cable go: the cycle brings the values of 1 and 2, and says where to look."""
    rig = FaultRig(key, driver, ids="1-5")
    cycle = cycle_of(rig)
    assert not rig.do(lambda _: cycle.run()).lost
    rig.inject("unplug@3-5#1-")
    result = rig.do(lambda _: cycle.run())
    assert sorted(result.lost.by_id()) == [3, 4, 5]
    assert sorted(result.by_id()) == [1, 2]
    assert "after id 2" in result.diagnosis


@DRIVERS
@sample_models
def test_F22_a_stall_is_counted_and_brings_no_burst_of_old_goals(key: str, driver: str) -> None:
    """A loop of 20 Hz stands still for 200 ms in one turn: three turns are left out and counted, and each goal that
    goes out afterwards is that of its own time."""
    rig = FaultRig(key, driver)
    rig.do(lambda bus: bus.torque_on([bus[1]]))
    cycle = cycle_of(rig)
    pace = cycle.every(PERIOD)
    home = rig.bus[1].model.register("present_position").decode(rig.read(1))
    sent: list[tuple[int, float]] = []

    def turn(tick: Any) -> dict[int, float]:
        sent.append((tick.number, rig.port.now()))
        if tick.number == 2:
            rig.port.sleep(0.200 + PERIOD / 10)
        return {1: home + tick.time * deg}

    if driver == ASYNC:

        async def loop(_: Any) -> None:
            turns: AsyncIterator[Any] = aiter(pace)
            async for tick in turns:
                await cycle.run(turn(tick))
                if tick.number >= 9:
                    break

        rig.do(loop)
    else:
        for tick in pace:
            cycle.run(turn(tick))
            if tick.number >= 9:
                break
    # Turn 2 begins at 0.1 s and ends after 0.305 s: 3, 4 and 5 are over, 6 is 5 ms late or more, by what a cycle takes.
    assert [number for number, _ in sent] in ([0, 1, 2, 6, 7, 8, 9], [0, 1, 2, 7, 8, 9])
    assert pace.missed == 10 - len(sent)
    assert pace.overruns >= 1
    gaps = [later - earlier for (_, earlier), (_, later) in itertools.pairwise(sent)]
    assert min(gaps) > PERIOD / 2 - 1e-9
    first = sent[0][1]
    assert all(abs(time - first - number * PERIOD) < PERIOD / 2 + 1e-9 for number, time in sent)


def test_F22_an_answer_that_came_while_the_computer_stood_still_is_taken() -> None:
    """The driver's own stalls: an answer that came while the computer stood still is taken, not asked for again."""
    rig = FaultRig("rx28")
    before = rig.bus.stats[1].retries
    write = rig.port.write

    def stalled(data: bytes) -> None:
        write(data)
        rig.port.sleep(0.2)

    rig.port.write = stalled  # type: ignore[method-assign]
    assert rig.try_position(1) == "right"
    assert rig.bus.stats[1].retries == before
