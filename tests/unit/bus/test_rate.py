"""Turns at a fixed rate. Times are counted by hand."""

import asyncio

import pytest

from servobus import BadValue, Bus, UsageError
from servobus.bus.asyncio import AsyncBus
from servobus.bus.rate import Rate, Tick
from unit.scripted import Scripted


def turns(busy: list[float], period: float = 0.01) -> tuple[list[tuple[float, Tick]], Rate]:
    """Let a loop spend these times in its turns; give when each began, and what it was told."""
    port = Scripted()
    pace = Rate(Bus(port, echo=False), port.now, period)
    seen: list[tuple[float, Tick]] = []
    for tick in pace:
        seen.append((port.now(), tick))
        if len(seen) > len(busy):
            break
        port.sleep(busy[len(seen) - 1])
    return seen, pace


def test_turns_come_at_the_rate() -> None:
    seen, pace = turns([0.001, 0.009, 0.0])
    assert [time for time, _ in seen] == pytest.approx([0, 0.01, 0.02, 0.03])
    assert [(tick.number, tick.missed) for _, tick in seen] == [(0, 0), (1, 0), (2, 0), (3, 0)]
    assert (pace.ticks, pace.overruns, pace.missed) == (4, 0, 0)


def test_after_a_stall_there_is_no_burst() -> None:
    """F22: 200 ms at 100 Hz: the turns 1 to 19 are over, the 20th is due at this very moment."""
    seen, pace = turns([0.2, 0.0, 0.0])
    assert [time for time, _ in seen] == pytest.approx([0, 0.2, 0.21, 0.22])
    assert [(tick.number, tick.missed) for _, tick in seen] == [(0, 0), (20, 19), (21, 0), (22, 0)]
    assert [tick.time for _, tick in seen] == pytest.approx([0, 0.2, 0.21, 0.22])
    assert (pace.overruns, pace.missed) == (1, 19)
    assert pace.worst == pytest.approx(0.19)


@pytest.mark.parametrize(("busy", "begins", "number"), [(0.014, 0.014, 1), (0.016, 0.02, 2)])
def test_a_turn_late_by_more_than_half_a_period_is_left_out(busy: float, begins: float, number: int) -> None:
    seen, pace = turns([busy, 0.0])
    assert seen[1][0] == pytest.approx(begins)
    assert seen[1][1].number == number
    assert pace.overruns == 1


def test_async() -> None:
    async def main() -> None:
        port = Scripted()
        pace = Rate(AsyncBus(port, echo=False), port.now, 0.01)
        times = []
        async for tick in pace:
            times.append(port.now())
            if tick.number == 3:
                break
        assert times == pytest.approx([0, 0.01, 0.02, 0.03])
        with pytest.raises(UsageError, match="async for"):
            next(iter(pace))

    asyncio.run(main())


@pytest.mark.parametrize("period", [0, -1, float("nan"), float("inf")])
def test_what_is_no_period(period: float) -> None:
    port = Scripted()
    with pytest.raises(BadValue):
        Rate(Bus(port, echo=False), port.now, period)
