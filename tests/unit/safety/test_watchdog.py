"""The deadman: it acts on a program that is stuck, stopped or dead to the world (F21), and on no other."""

import asyncio
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

if sys.platform == "win32":
    pytest.skip("no pseudo terminals on Windows", allow_module_level=True)

import servobus
from samples import ONE_OF_EACH_FAMILY
from servobus import LX16A, MODELS, RX28, BadValue, Stopped, UsageError, deg
from servobus.core.exchange import Procedure
from servobus.safety.watchdog import Watchdog, awake
from unit.served import PATIENCE, Arm, frees, stops, wait_for

SOON = 0.05
"""s; a short time-out of a watch: tests wait for it to pass."""
LONG = 60.0
"""s; a time-out that no test reaches."""


@pytest.fixture(params=ONE_OF_EACH_FAMILY)
def arm(request: pytest.FixtureRequest) -> Iterator[tuple[str, Arm]]:
    with Arm(f"{request.param}@1,2") as arm:
        yield request.param, arm


@pytest.fixture
def lx() -> Iterator[Arm]:
    with Arm("lx16a@1,2") as arm:
        yield arm


# The count itself, on a clock of the test's own


class Counted:
    """A watch whose clock stands still unless the test moves it."""

    def __init__(self, timeout: float = 0.25) -> None:
        self.now = 1000.0
        self.driven = True
        self.acts = 0
        self.watch = Watchdog(timeout, self._act, lambda: self.driven, ended=lambda: None, clock=lambda: self.now)

    def _act(self) -> None:
        self.acts += 1

    def pass_(self, seconds: float) -> None:
        self.now += seconds
        with self.watch._changed:
            self.watch._changed.notify()


def test_it_trips_once_when_nobody_feeds_it() -> None:
    one = Counted()
    with one.watch as watch:
        one.pass_(0.24)
        watch.feed()
        one.pass_(0.24)
        watch.feed()
        assert not watch.wait(0)
        one.pass_(0.26)
        assert watch.wait(PATIENCE)
        assert watch.tripped
        one.pass_(100.0)
        with pytest.raises(Stopped, match=r"was not fed for 0\.25 s"):
            watch.feed()
    assert one.acts == 1


def test_it_says_how_it_stands() -> None:
    one = Counted(0.5)
    with one.watch as watch:
        one.now += 0.125
        assert repr(watch) == "<watch of 0.5 s: fed 0.125 s ago>"
        one.driven = False
        assert str(watch) == "<watch of 0.5 s: nothing is in motion>"
        one.driven = True
        watch._trip()
        assert repr(watch) == "<watch of 0.5 s: tripped, nothing moves before reset() or stop()>"
    assert repr(watch) == "<watch of 0.5 s: ended>"


def test_a_feed_that_comes_too_late_trips_it() -> None:
    """After SIGSTOP the program may run before the thread of the watch does."""
    one = Counted()
    with one.watch as watch:
        one.now += 5.0
        with pytest.raises(Stopped):
            watch.feed()
        assert watch.wait(PATIENCE)
    assert one.acts == 1


def test_while_nothing_is_driven_nothing_trips() -> None:
    one = Counted()
    one.driven = False
    with one.watch as watch:
        one.pass_(5.0)
        watch.check()
        watch.feed()
        one.driven = True
        one.pass_(0.2)
        watch.check()
        assert not watch.tripped
    assert one.acts == 0


def test_reset_begins_anew() -> None:
    one = Counted()
    with one.watch as watch:
        for count in (1, 2):
            one.pass_(1.0)
            assert watch.wait(PATIENCE)
            wait_for(lambda count=count: one.acts == count)  # type: ignore[misc]
            watch.reset()
            assert not watch.tripped
            watch.feed()
    assert one.acts == 2


def test_the_clock_never_goes_back_and_is_no_clock_of_the_day() -> None:
    first = awake()
    assert awake() >= first
    assert abs(time.time() - first) > 1e6


@pytest.mark.parametrize("timeout", [0, -1, float("nan"), float("inf")])
def test_a_time_out_that_is_none_is_refused(timeout: float) -> None:
    with pytest.raises(BadValue, match="is not a number of seconds above 0"):
        Watchdog(timeout, lambda: None, lambda: True, ended=lambda: None)


# On a bus


def going(bus: Any, key: str) -> Any:
    """Set servo 1 in motion, and look at servo 2."""
    first, other = (bus.attach(MODELS[key], id) for id in (1, 2))
    other.look()
    first.torque_on()
    first.start_move(first.look().position + 40 * deg, speed=20 * deg)
    return first


def test_a_program_that_is_stuck_has_its_servos_stopped_once(arm: tuple[str, Arm]) -> None:
    key, served = arm
    with served.open() as bus:
        servo = going(bus, key)
        served.heard.clear()
        watch = bus.watch(SOON)
        assert watch.wait(PATIENCE)  # as stuck as can be
        assert watch.tripped
        for move in (
            lambda: servo.start_move(1.0),
            servo.torque_on,
            lambda: bus.torque_on([servo]),
        ):
            with pytest.raises(Stopped, match="nothing moves before reset"):
                move()
        servo.ping()  # what does not move is allowed
        servo.look()
        servo.stop()
        watch.stop()
        servo.torque_on()
    heard = served.settled()
    # The watch and the test itself stop it; an RX-28 gets a goal from torque_on only if that was off.
    assert (stops(heard, key, 1), stops(heard, key, 2)) == (2, 0)
    assert frees(heard, key, 1) == 0


def test_a_watch_may_have_an_action_of_its_own(arm: tuple[str, Arm]) -> None:
    key, served = arm
    with served.open() as bus:
        going(bus, key)
        with bus.watch(SOON, "free") as watch:
            assert watch.wait(PATIENCE)
    heard = served.settled()
    assert (frees(heard, key, 1), frees(heard, key, 2)) == (1, 0)


def test_feeding_and_motion_keep_it_from_tripping(lx: Arm) -> None:
    with lx.open() as bus, bus.watch(LONG) as watch:
        servo = going(bus, "lx16a")
        fed = watch._fed
        servo.read(LX16A.present_position)
        assert watch._fed == fed
        servo.start_move(100 * deg, time=1.0)
        assert watch._fed > fed
        fed = watch._fed
        servo.write(LX16A.goal_position, 100 * deg)
        assert watch._fed > fed
        fed = watch._fed
        watch.feed()
        assert watch._fed > fed
        assert not watch.tripped


def test_waiting_for_a_move_feeds_it(lx: Arm) -> None:
    with lx.open() as bus, bus.watch(LONG) as watch:
        servo = bus.attach(LX16A, 1)
        servo.torque_on()
        move = servo.move(servo.look().position + 20 * deg, time=0.5)
        fed, feed = [], watch.feed

        def counted() -> None:
            fed.append(watch._fed)
            feed()

        watch.feed = counted  # type: ignore[method-assign]
        move.wait()
    # Every 0.05 s of 0.5 s, and at the look that finds that it has arrived.
    assert len(fed) >= 11


class Slow:
    """A servo under way for 100 s, longer than any of these tests."""

    @staticmethod
    def arm() -> Arm:
        return Arm("rx28@1")

    @staticmethod
    def ended(bus: Any, end: Callable[[Any], object]) -> BaseException:
        """Wait for it in a thread, end the motion in this one, and give what the waiting thread got."""
        servo = bus.attach(RX28, 1)
        servo.torque_on()
        move = servo.move(servo.look().position + 100 * deg, speed=1 * deg)
        assert move.duration == pytest.approx(100.0)
        waits, got = threading.Event(), []
        attended = servo.permit.keep_alive

        def keep_alive() -> None:
            waits.set()
            attended()

        def wait() -> None:
            try:
                move.wait()
            except BaseException as error:  # noqa: BLE001 - the test looks at it
                got.append(error)

        servo.permit.keep_alive = keep_alive
        waiter = threading.Thread(target=wait, daemon=True)
        waiter.start()
        assert waits.wait(PATIENCE)
        end(servo)
        waiter.join(PATIENCE)
        assert not waiter.is_alive()
        return got[0]


def test_who_waits_for_a_move_hears_at_once_that_the_watch_has_tripped() -> None:
    with Slow.arm() as served, served.open() as bus, bus.watch(LONG) as watch:
        error = Slow.ended(bus, lambda _: watch._trip())
        assert isinstance(error, Stopped)
        assert watch.wait(PATIENCE)


@pytest.mark.parametrize("end", ["stop", "torque_off"])
def test_who_waits_for_a_move_hears_at_once_that_another_thread_ended_it(end: str) -> None:
    with Slow.arm() as served, served.open() as bus:
        error = Slow.ended(bus, lambda servo: getattr(servo, end)())
        assert isinstance(error, Stopped)
        # From the middle, 150°, at 1°/s.
        assert re.fullmatch(r"RX-28 id 1 is at 1[4-9]\d\.\d° and goes to (249\.9|250\.\d)° no more: .*", str(error))


def test_a_move_that_arrived_and_was_stopped_then_has_arrived(lx: Arm) -> None:
    with lx.open() as bus:
        servo = bus.attach(LX16A, 1)
        servo.torque_on()
        move = servo.move(servo.look().position + 5 * deg, time=0.1)
        move.wait()
        servo.stop()
        move.wait()
        servo.torque_off()
        move.wait()


def test_a_control_cycle_that_ends_has_its_servos_stopped(arm: tuple[str, Arm]) -> None:
    """Nothing but the cycle's goals tells the bus that servo 1 moves: its torque was on before."""
    key, served = arm
    with served.open() as bus:
        bus.attach(MODELS[key], 1).torque_on()
    served.heard.clear()
    with served.open() as bus:
        servos = [bus.attach(MODELS[key], id) for id in (1, 2)]
        cycle = bus.cycle(["present_position"], servos=[1, 2])
        here = servos[0].look().position
        watch = bus.watch(LONG)
        assert not any(servo.permit.driven for servo in servos)
        for step in range(1, 4):
            fed = watch._fed
            cycle.run({1: here + step * deg})
            assert watch._fed > fed
        assert [servo.permit.driven for servo in servos] == [True, False]
        fed = watch._fed
        cycle.run()  # who only reads may be stuck in what he computes
        assert watch._fed == fed
        served.heard.clear()
        watch.timeout = SOON
        with watch._changed:
            watch._changed.notify()
        assert watch.wait(PATIENCE)
        bus.read_all("present_position")  # bytes keep their order: what was sent before has been heard
        assert (stops(served.heard, key, 1), stops(served.heard, key, 2)) == (1, 0)
        with pytest.raises(Stopped, match="was not fed"):
            cycle.run({1: here})
        cycle.run()
        watch.timeout = LONG
        watch.reset()
        cycle.run({1: here})
        assert servos[0].permit.driven


def test_a_cycle_moves_no_servo_that_was_stopped_for_its_own_good(lx: Arm) -> None:
    with lx.open() as bus:
        servo = bus.attach(LX16A, 1)
        servo.torque_on()
        cycle = bus.cycle(["present_position"])
        cycle.run({1: servo.look().position})
        servo.stop()
        cycle.run({1: servo.look().position})
        assert not servo.permit.stopped  # so a trip of the watch stops it again
        servo.permit.inhibited = "too hot"
        with pytest.raises(Stopped, match="too hot"):
            cycle.run({1: 1.0})


def test_after_reset_it_guards_again(lx: Arm) -> None:
    with lx.open() as bus:
        servo = going(bus, "lx16a")
        lx.heard.clear()
        watch = bus.watch(SOON)
        assert watch.wait(PATIENCE)
        watch.timeout = LONG
        watch.reset()
        servo.start_move(100 * deg, time=1.0)
        watch.timeout = SOON
        with watch._changed:
            watch._changed.notify()
        assert watch.wait(PATIENCE)
    assert stops(lx.settled(), "lx16a", 1) == 2


def test_it_gets_the_line_from_one_who_keeps_it(lx: Arm) -> None:
    """The program hangs in the middle of a job, with the line in its hands."""
    with lx.open() as bus:
        servo = going(bus, "lx16a")
        lx.heard.clear()
        watch = bus.watch(SOON)

        def job() -> Procedure[None]:
            yield servo.family.ping(1)
            assert watch.wait(PATIENCE)
            assert stops(lx.heard, "lx16a", 1) == 1
            yield servo.family.ping(2)

        with pytest.raises(Stopped, match="interrupted: the line was needed"):
            bus.do(job())
        assert not any((packet.id, packet.code) == (2, 14) for packet in lx.heard)
        servo.look()  # the bus is usable
        watch.stop()
        servo.start_move(100 * deg, time=1.0)


def without_end() -> Procedure[None]:
    """Ask and ask again without ever giving way."""
    while True:
        yield from LX16A.family.ping(1)


def test_it_interrupts_a_job_that_uses_the_line_without_end(lx: Arm) -> None:
    with lx.open() as bus:
        going(bus, "lx16a")
        lx.heard.clear()
        watch = bus.watch(SOON)
        with pytest.raises(Stopped):
            bus.do(without_end())
        assert watch.wait(PATIENCE)
    assert stops(lx.settled(), "lx16a", 1) == 1


def test_it_acts_while_others_read(lx: Arm) -> None:
    """Threads that only read keep no watch from tripping, and may have one read fail."""
    with lx.open() as bus:
        servo = going(bus, "lx16a")
        lx.heard.clear()
        watch = bus.watch(SOON)
        over = threading.Event()
        wrong: list[object] = []

        def read() -> None:
            while not over.is_set():
                try:
                    state = servo.look()
                except Stopped:
                    continue
                if not 0 <= state.position <= 240 * deg or not 20 <= state.temperature <= 40:
                    wrong.append(state)

        readers = [threading.Thread(target=read) for _ in range(2)]
        for reader in readers:
            reader.start()
        assert watch.wait(PATIENCE)
        over.set()
        for reader in readers:
            reader.join(PATIENCE)
        assert wrong == []
    assert stops(lx.settled(), "lx16a", 1) == 1


def test_closing_the_bus_ends_the_watch_and_stops_nothing(lx: Arm) -> None:
    with lx.open() as bus:
        going(bus, "lx16a")
        lx.heard.clear()
        watch = bus.watch(LONG)
    assert not watch._thread.is_alive()
    assert stops(lx.settled(), "lx16a", 1) == 0


def test_what_cannot_be_watched_is_refused(lx: Arm) -> None:
    with lx.open() as bus:
        bus.attach(LX16A, 1)
        with pytest.raises(UsageError, match="LX-16A id 1 cannot brake"):
            bus.watch(action="brake")
        with pytest.raises(UsageError, match="no safe action"):
            bus.watch(action="stop")  # type: ignore[arg-type]
        with pytest.raises(BadValue):
            bus.watch(0)
        bus.watch(LONG)
        with pytest.raises(UsageError, match=r"has a watch already, <watch of 60 s: .*>; `watching\.stop\(\)`"):
            bus.watch()
    with lx.open() as bus, bus.watch(LONG, "brake"), pytest.raises(UsageError, match="cannot brake"):
        bus.attach(LX16A, 2).torque_on()


def test_a_watch_that_was_thrown_away_is_found_again(lx: Arm) -> None:
    with lx.open() as bus:

        def watching() -> Watchdog | None:
            return bus.watching

        assert watching() is None
        bus.watch(LONG)
        watch = watching()
        assert watch is not None
        watch.stop()
        assert watching() is None


def test_on_a_virtual_clock_there_is_nothing_to_watch() -> None:
    with (
        servobus.open("virtual:rx28@1?clock=virtual") as bus,
        pytest.raises(UsageError, match="its clock is virtual"),
    ):
        bus.watch()


# asyncio


async def agoing(bus: Any, key: str) -> Any:
    first, other = (bus.attach(MODELS[key], id) for id in (1, 2))
    await other.look()
    await first.torque_on()
    await first.start_move((await first.look()).position + 40 * deg, speed=20 * deg)
    return first


def test_a_loop_that_is_stuck_has_its_servos_stopped_once(arm: tuple[str, Arm]) -> None:
    key, served = arm

    async def main() -> None:
        async with servobus.open_async(served.name, echo=False) as bus:
            servo = await agoing(bus, key)
            served.heard.clear()
            watch = bus.watch(SOON)
            assert watch.wait(PATIENCE)  # the loop stands still meanwhile
            with pytest.raises(Stopped):
                await servo.start_move(1.0)
            await servo.look()
            watch.stop()
            await servo.torque_on()

    asyncio.run(main())
    heard = served.settled()
    assert (stops(heard, key, 1), stops(heard, key, 2)) == (1, 0)


def test_a_task_that_waits_for_a_move_hears_at_once_that_the_watch_has_tripped() -> None:
    async def main(name: str) -> None:
        async with servobus.open_async(name, echo=False) as bus:
            servo = bus.attach(RX28, 1)
            await servo.torque_on()
            with bus.watch(LONG) as watch:
                move = await servo.move((await servo.look()).position + 100 * deg, speed=1 * deg)
                waiter = asyncio.ensure_future(move.wait())
                await asyncio.sleep(0)
                watch._trip()
                with pytest.raises(Stopped):
                    await asyncio.wait_for(waiter, PATIENCE)

    with Slow.arm() as served:
        asyncio.run(main(served.name))


def test_a_loop_that_only_reads_has_its_servos_stopped_too(arm: tuple[str, Arm]) -> None:
    key, served = arm

    async def main() -> None:
        async with servobus.open_async(served.name, echo=False) as bus:
            servo = await agoing(bus, key)
            served.heard.clear()
            watch = bus.watch(SOON)
            row = servo.model.register("present_temperature")
            while not watch.wait(0):
                try:
                    assert 20 <= await servo.read(row) <= 40
                except Stopped:
                    await asyncio.sleep(0.001)
            assert 20 <= await servo.read(row) <= 40

    asyncio.run(main())
    assert stops(served.settled(), key, 1) == 1


def test_a_loop_that_is_stuck_in_the_middle_of_a_question(lx: Arm) -> None:
    async def main() -> None:
        async with servobus.open_async(lx.name, echo=False) as bus:
            await agoing(bus, "lx16a")
            lx.heard.clear()
            watch = bus.watch(SOON)
            question = asyncio.ensure_future(bus.attach(LX16A, 77).ping())  # nobody answers it
            await asyncio.sleep(0)
            assert watch.wait(PATIENCE)
            with pytest.raises((servobus.NoReply, servobus.Stopped)):
                await question
            await bus[1].look()

    asyncio.run(main())
    assert stops(lx.settled(), "lx16a", 1) == 1


# SIGSTOP

STREAM = """
import sys, time, servobus
from servobus import RX28, deg
with servobus.open(sys.argv[1], echo=False) as bus:
    servo = bus.attach(RX28, 1)
    servo.torque_on()
    watch = bus.watch(5.0)
    print("ready", flush=True)
    sys.stdin.readline()
    try:
        while True:
            servo.write_many({RX28.goal_position: 100 * deg, RX28.moving_speed: 1.0})
    except servobus.Stopped:
        watch.wait()
        print("stopped", flush=True)
"""


def test_a_program_that_was_stopped_by_the_system_does_not_go_on_moving() -> None:
    """It streams as fast as it can, is stopped for longer than its watch allows, and goes on."""
    stream = STREAM.replace("5.0", "1.0")
    with Arm("rx28@1") as served:
        command = [sys.executable, "-c", stream, served.name]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as program:
            assert program.stdout is not None
            assert program.stdin is not None
            assert program.stdout.readline() == "ready\n"
            program.stdin.write("\n")
            program.stdin.flush()
            wait_for(lambda: len(served.heard) > 50)
            os.kill(program.pid, signal.SIGSTOP)
            time.sleep(1.5)  # longer than the watch allows; how much does not matter
            count = len(served.heard)
            os.kill(program.pid, signal.SIGCONT)
            assert program.stdout.readline() == "stopped\n"
            assert program.wait(PATIENCE) == 0
        heard = served.settled()
        goals = [packet for packet in heard[count:] if packet.code == 3 and packet.data[0] == 30]
        # At most the command in the middle of which it was stopped, and one that had passed the watch before.
        assert [len(packet.data) for packet in goals].count(3) == 1
        assert len(goals) <= 3
        assert len(goals[-1].data) == 3  # the last word is the stop
        assert served.servos[0].model is RX28


def test_a_reset_while_it_still_acts_does_not_use_up_the_next_trip() -> None:
    acts: list[int] = []

    def act() -> None:
        acts.append(1)
        time.sleep(0.2)

    watchdog = Watchdog(0.05, act, lambda: True, ended=lambda: None)
    while not acts:
        time.sleep(0.005)
    watchdog.reset()
    assert watchdog.wait(PATIENCE)
    assert len(acts) == 2
    watchdog.stop()
