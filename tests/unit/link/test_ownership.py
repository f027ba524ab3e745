"""Who may talk: one turn at a time, the most urgent next, whatever is cancelled or interrupted on the way."""

import asyncio
import itertools
import linecache
import random
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import pytest

from servobus.core.operation import Priority
from servobus.errors import Stopped
from servobus.link import ownership
from servobus.link.ownership import LineOwnership, Turn, TurnState, turn_for
from unit.served import wait_for

PROMPT = 5.0
"""s after which a test gives up waiting for a thread."""


def free(line: LineOwnership) -> bool:
    """Tell whether the line is free and stays usable."""
    turn = Turn()
    try:
        return line.holder is None and not line.contended and line.acquire(turn, timeout=0)
    finally:
        line.end(turn)


@contextmanager
def holding(line: LineOwnership, priority: Priority = Priority.READ) -> Iterator[Turn]:
    turn = turn_for(priority)
    try:
        line.acquire(turn)
        yield turn
    finally:
        line.end(turn)


def in_thread(work: Callable[[], object]) -> threading.Thread:
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    return thread


# The order


@pytest.mark.parametrize("order", list(itertools.permutations(Priority)))
def test_the_most_urgent_turn_is_next(order: tuple[Priority, ...]) -> None:
    line, served = LineOwnership(), list[Priority]()

    def serve(priority: Priority) -> None:
        with holding(line, priority):
            served.append(priority)

    with holding(line):
        threads = []
        for count, priority in enumerate(order, 1):
            threads.append(in_thread(lambda priority=priority: serve(priority)))  # type: ignore[misc]
            wait_for(lambda count=count: len(line._waiting) == count)  # type: ignore[misc]
    for thread in threads:
        thread.join(PROMPT)
    assert served == sorted(Priority)
    assert free(line)


def test_of_equal_turns_the_one_that_waited_longer_is_next() -> None:
    async def main() -> list[int]:
        line, served = LineOwnership(), list[int]()

        async def talk(number: int) -> None:
            turn = Turn()
            try:
                await line.acquire_async(turn)
                served.append(number)
                await asyncio.sleep(0)
            finally:
                line.end(turn)

        async with asyncio.TaskGroup() as group:
            for number in range(20):
                group.create_task(talk(number))
        assert free(line)
        return served

    assert asyncio.run(main()) == list(range(20))


def test_a_newcomer_does_not_overtake_a_turn_that_waits() -> None:
    line = LineOwnership()
    with holding(line):
        waiting, there = Turn(), threading.Event()

        def wait() -> None:
            line.acquire(waiting)
            there.wait(PROMPT)
            line.end(waiting)

        thread = in_thread(wait)
        wait_for(lambda: line.contended)
    wait_for(lambda: line.holder is waiting)
    assert not line.try_acquire(turn_for(Priority.STOP))
    there.set()
    thread.join(PROMPT)
    assert free(line)


def test_a_thread_that_has_the_line_goes_on_with_it() -> None:
    line = LineOwnership()
    with holding(line) as outer:
        with holding(line) as inner:
            assert inner.nested
            line.give_way(inner)  # of no effect: the outer job is in the middle of something
            assert line.holder is outer
        assert line.holder is outer
    assert free(line)


def talk(line: LineOwnership) -> None:
    with holding(line):
        pass


def test_a_scan_beside_busy_readers_goes_on() -> None:
    line, stop, turns = LineOwnership(), threading.Event(), [0]

    def read() -> None:
        while not stop.is_set():
            talk(line)

    def scan() -> None:
        while turns[0] < 50:
            with holding(line, Priority.SCAN):
                turns[0] += 1

    readers = [in_thread(read) for _ in range(3)]
    scanning = in_thread(scan)
    scanning.join(PROMPT)
    stop.set()
    for thread in readers:
        thread.join(PROMPT)
    assert turns[0] == 50
    assert free(line)


# Giving way


def test_a_turn_that_gives_way_takes_the_line_back() -> None:
    line, log = LineOwnership(), list[str]()

    def other() -> None:
        with holding(line):
            log.append("other")

    with holding(line) as turn:
        thread = in_thread(other)
        wait_for(lambda: line.contended)
        log.append("before")
        line.give_way(turn)
        thread.join(PROMPT)
        line.acquire(turn)
        log.append("after")
        assert line.holder is turn
    assert log == ["before", "other", "after"]
    assert free(line)


def test_a_task_cancelled_while_it_takes_the_line_back_leaves_the_others_turn_alone() -> None:
    """A cancelled task once gave back the lock of another, so that two talked at once."""

    async def main() -> None:
        line = LineOwnership()
        gave_way, other = asyncio.Event(), Turn()

        async def talk() -> None:
            turn = Turn()
            try:
                await line.acquire_async(turn)
                line.give_way(turn)
                gave_way.set()
                await asyncio.sleep(0)
                await line.acquire_async(turn)
            finally:
                line.end(turn)

        task = asyncio.create_task(talk())
        await gave_way.wait()
        await line.acquire_async(other)
        await asyncio.sleep(0.01)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert line.holder is other
        line.end(other)
        assert free(line)

    asyncio.run(main())


# A stop


def test_a_stop_waits_first_then_interrupts_then_goes_ahead() -> None:
    line, told = LineOwnership(), list[str]()
    with holding(line) as stuck:
        thread_done = threading.Event()

        def stop() -> None:
            turn = turn_for(Priority.STOP)
            try:
                line.take_over(turn, lambda: told.append("interrupted"), 0.02, 0.02)
                told.append(str(line.holder is turn))
                with pytest.raises(Stopped):
                    line.acquire(stuck)  # it has lost the line for good
                line.end(stuck)  # its end frees nothing that is not its own
                told.append(str(line.holder is turn))
            finally:
                line.end(turn)
                thread_done.set()

        in_thread(stop)
        assert thread_done.wait(PROMPT)
        assert told == ["interrupted", "True", "True"]
        assert stuck.state is TurnState.ENDED
    assert free(line)


def test_a_stop_that_gets_the_line_in_time_interrupts_nothing() -> None:
    line = LineOwnership()
    with holding(line) as turn:
        got = threading.Event()

        def stop() -> None:
            mine = turn_for(Priority.STOP)
            try:
                line.take_over(mine, lambda: pytest.fail("it had the line in time"), PROMPT, 0.0)
                got.set()
            finally:
                line.end(mine)

        in_thread(stop)
        wait_for(lambda: line.contended)
        line.give_way(turn)
        assert got.wait(PROMPT)
        line.acquire(turn)
    assert free(line)


def test_a_turn_of_a_closed_loop_is_passed_over() -> None:
    line = LineOwnership()
    with holding(line):
        loop = asyncio.new_event_loop()
        task = loop.create_task(line.acquire_async(turn_for(Priority.MOTION)))
        loop.run_until_complete(asyncio.sleep(0.01))
        loop.close()
        task._log_destroy_pending = False  # type: ignore[attr-defined]
        thread = in_thread(lambda: talk(line))
        wait_for(lambda: len(line._waiting) == 2)
    thread.join(PROMPT)
    assert not thread.is_alive()
    assert free(line)


# Broken off anywhere


class Interrupt(BaseException):
    """What Ctrl-C would raise."""


@contextmanager
def interrupted_at(line_number: int) -> Iterator[None]:
    """Raise Interrupt in this thread before the line of the module with this running number is carried out.

    Not where a `with` is left: the interpreter looks for signals after calls, so none is noticed between the body and
    the release of the mutex.
    """
    passed = [0]
    entered = set[tuple[FrameType, int]]()

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        if frame.f_code.co_filename != ownership.__file__:
            return None
        if event == "line":
            leaves = linecache.getline(ownership.__file__, frame.f_lineno).strip().startswith("with ")
            if leaves and (frame, frame.f_lineno) in entered:
                entered.remove((frame, frame.f_lineno))
                return trace
            if leaves:
                entered.add((frame, frame.f_lineno))
            passed[0] += 1
            if passed[0] == line_number:
                raise Interrupt
        return trace

    old = sys.gettrace()
    sys.settrace(trace)
    try:
        yield
    finally:
        sys.settrace(old)


@pytest.mark.parametrize("busy", [False, True])
def test_ctrl_c_at_every_line_of_a_turn_leaves_the_line_free(busy: bool) -> None:
    """From the first line that `acquire` runs to the last of `end`; the line is free, or held for a moment longer."""
    for number in range(1, 1000):
        line, held, interrupted = LineOwnership(), threading.Event(), False

        def other(line: LineOwnership = line, held: threading.Event = held) -> None:
            with holding(line):
                held.set()
                time.sleep(0.001)

        thread = in_thread(other if busy else held.set)
        assert held.wait(PROMPT)
        turn = Turn()
        with interrupted_at(number):
            try:
                try:
                    line.acquire(turn)
                    line.give_way(turn)
                    line.acquire(turn)
                finally:
                    line.end(turn)
            except Interrupt:
                interrupted = True
        line.end(turn)  # a caller's `finally` that was itself interrupted before `end` began
        thread.join(PROMPT)
        assert free(line), f"interrupted at line event {number}"
        if not interrupted:
            return
    pytest.fail("it never came to its end")


def test_ctrl_c_at_every_line_of_a_hand_over_wakes_the_other() -> None:
    """From inside `end` on: no Python code can catch what comes between a `finally` and the first statement there."""
    for number in range(2, 1000):
        line, got = LineOwnership(), threading.Event()

        def other(line: LineOwnership = line, got: threading.Event = got) -> None:
            with holding(line):
                got.set()

        interrupted = False
        turn = Turn()
        line.acquire(turn)
        thread = in_thread(other)
        wait_for(lambda line=line: line.contended)  # type: ignore[misc]
        with interrupted_at(number):
            try:
                line.end(turn)
            except Interrupt:
                interrupted = True
        assert got.wait(PROMPT), f"interrupted at line event {number}"
        thread.join(PROMPT)
        assert free(line)
        if not interrupted:
            return
    pytest.fail("it never came to its end")


@pytest.mark.parametrize("seed", range(20))
def test_tasks_that_are_cancelled_at_random_never_talk_at_once(seed: int) -> None:
    """Many tasks of one loop and two threads beside it, each cancelled or not, at any await."""
    chance = random.Random(seed)
    talking, worst = list[object](), [0]

    def enter(who: object) -> None:
        talking.append(who)
        worst[0] = max(worst[0], len(talking))

    async def main() -> LineOwnership:
        line = LineOwnership()

        async def task(pauses: int) -> None:
            turn = turn_for(chance.choice(list(Priority)))
            try:
                await line.acquire_async(turn)
                for _ in range(pauses):
                    enter(turn)
                    await asyncio.sleep(0)
                    talking.remove(turn)
                    line.give_way(turn)
                    await asyncio.sleep(0)
                    await line.acquire_async(turn)
            finally:
                if turn in talking:
                    talking.remove(turn)
                line.end(turn)

        stop = threading.Event()

        def beside() -> None:
            while not stop.is_set():
                with holding(line) as turn:
                    enter(turn)
                    talking.remove(turn)

        threads = [in_thread(beside) for _ in range(2)]
        tasks = [asyncio.create_task(task(chance.randrange(4))) for _ in range(60)]
        for victim in chance.sample(tasks, 40):
            for _ in range(chance.randrange(4)):
                await asyncio.sleep(0)
            victim.cancel()
        results = await asyncio.wait_for(asyncio.gather(*tasks, return_exceptions=True), PROMPT)
        assert {type(result) for result in results} <= {type(None), asyncio.CancelledError}
        stop.set()
        for thread in threads:
            await asyncio.to_thread(thread.join, PROMPT)
        return line

    line = asyncio.run(main())
    assert worst[0] == 1
    assert free(line)
