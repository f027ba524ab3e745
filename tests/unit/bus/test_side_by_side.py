"""Jobs on several buses in one thread, on ports that answer at once through a pipe.

Bytes are the RX-28 manual's (3-5-1): a read of the temperature, and its answer of 32 °C.
"""

import os
import select
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest

from servobus import Bus, NoReply, dynamixel1
from servobus.bus.side_by_side import run_side_by_side
from servobus.core.exchange import Pause, Procedure
from servobus.core.operation import Priority
from servobus.errors import PortError, PortLost, Stopped
from servobus.link.ownership import Turn
from unit.bus.test_blocking import ANSWER
from unit.scripted import Scripted

if os.name != "posix":
    pytest.skip("Windows waits for no pipe", allow_module_level=True)

NAMES = ("left", "middle", "right")


class Piped(Scripted):
    """A scripted port with a descriptor, in real time. `events` holds what all ports were asked and gave."""

    def __init__(self, name: str, events: list[str], *script: str | None, watched: bool = True) -> None:
        super().__init__(*script, baud=1_000_000)
        self.name, self.events, self.watched = name, events, watched
        self.threads: list[int] = []
        self._out, self._in = os.pipe()

    def write(self, data: bytes) -> None:  # noqa: ARG002 - every request has the same answer
        self.events.append(f"ask {self.name}")
        self.threads.append(threading.get_ident())
        answer = self.script.pop(0) if self.script else None
        if answer is not None:
            os.write(self._in, bytes.fromhex(answer))

    def read(self, timeout: float) -> bytes:
        if self.closed:
            raise PortError(f"{self.name} is closed")
        if not select.select([self._out], [], [], timeout)[0]:
            return b""
        self.events.append(f"hear {self.name}")
        return os.read(self._out, 100)

    def pending(self) -> bool:
        return not self.closed and bool(select.select([self._out], [], [], 0)[0])

    def fileno(self) -> int | None:
        return self._out if self.watched and not self.closed else None

    def blocking(self) -> bool:
        return True

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)

    def let_go(self) -> None:
        os.close(self._out)
        os.close(self._in)


class Shop:
    """Three buses, and threads for what cannot be done by the one of the test."""

    def __init__(self) -> None:
        self.events: list[str] = []
        self.ports = {name: Piped(name, self.events, *[ANSWER] * 4) for name in NAMES}
        self.buses = {name: Bus(port, echo=False) for name, port in self.ports.items()}
        self.threads = ThreadPoolExecutor(3)

    def run(self, **jobs: Any) -> dict[str, Any]:
        def in_thread(work: Callable[[], Any]) -> "Future[Any]":
            return self.threads.submit(work)

        return run_side_by_side({name: (self.buses[name], job) for name, job in jobs.items()}, Priority.READ, in_thread)


@pytest.fixture
def shop() -> Iterator[Shop]:
    shop = Shop()
    yield shop
    assert all(bus.line.holder is None for bus in shop.buses.values())
    shop.threads.shutdown()
    for bus, port in zip(shop.buses.values(), shop.ports.values(), strict=True):
        bus.close()
        port.let_go()


def read(times: int = 2) -> Procedure[list[bytes]]:
    """Ask for the temperature of servo 1, some times."""
    seen: list[bytes] = []
    for _ in range(times):
        seen += [(yield dynamixel1.read_data(1, 43, 1))]
    return seen


WARM = [b"\x20", b"\x20"]


def test_questions_are_under_way_on_all_ports_at_once(shop: Shop) -> None:
    assert shop.run(left=read(), middle=read(), right=read()) == dict.fromkeys(NAMES, WARM)
    assert shop.events[:3] == ["ask left", "ask middle", "ask right"]
    assert {ident for port in shop.ports.values() for ident in port.threads} == {threading.get_ident()}


def test_a_port_without_a_descriptor_has_a_thread(shop: Shop) -> None:
    shop.ports["middle"].watched = False
    assert shop.run(left=read(), middle=read(), right=read()) == dict.fromkeys(NAMES, WARM)
    assert threading.get_ident() not in shop.ports["middle"].threads


def test_a_line_in_use_is_waited_for_in_a_thread(shop: Shop) -> None:
    line, turn = shop.buses["left"].line, Turn()
    held = threading.Event()

    def hold() -> None:
        line.acquire(turn)
        held.set()
        while shop.events.count("hear right") < 2:
            time.sleep(0.001)
        line.end(turn)

    holder = shop.threads.submit(hold)
    assert held.wait(30)
    assert shop.run(left=read(), right=read()) == {"left": WARM, "right": WARM}
    holder.result()
    assert shop.events.index("ask left") > shop.events.index("hear right")


def test_a_job_may_end_before_it_asks_anything(shop: Shop) -> None:
    def ends() -> Procedure[int]:
        yield from ()
        return 1

    def fails() -> Procedure[None]:
        yield from ()
        raise PortError("no")

    came = shop.run(left=ends(), middle=fails(), right=read())
    assert isinstance(came.pop("middle"), PortError)
    assert came == {"left": 1, "right": WARM}


def test_silence_on_one_port_is_no_matter_of_the_others(shop: Shop) -> None:
    shop.ports["middle"].script = []
    came = shop.run(left=read(), middle=read(), right=read())
    assert isinstance(came.pop("middle"), NoReply)
    assert came == {"left": WARM, "right": WARM}


@pytest.mark.parametrize("known", [True, False], ids=["told by reading", "told by waiting"])
def test_a_port_that_goes_away_is_lost_alone(shop: Shop, known: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    port = shop.ports["middle"]
    if known:

        def gone(_: float) -> bytes:
            raise PortLost("middle: the port went away")

        monkeypatch.setattr(port, "read", gone)

    def closes() -> Procedure[list[bytes]]:
        seen = yield from read()
        port.closed = True
        return seen

    port.script = []
    came = shop.run(left=closes(), middle=read(), right=read())
    assert isinstance(came.pop("middle"), PortError)
    assert came == {"left": WARM, "right": WARM}


def test_a_stop_that_takes_a_line_ends_the_job_on_it_alone(shop: Shop) -> None:
    left = shop.buses["left"]

    def stopped() -> Procedure[None]:
        yield Pause(60.0)

    def stops() -> Procedure[list[bytes]]:
        left.link.superseded = True  # as `supersede` does, from whatever thread
        return (yield from read())

    came = shop.run(left=stopped(), right=stops())
    assert isinstance(came["left"], Stopped)
    assert came["right"] == WARM


def test_ctrl_c_in_one_job_breaks_all_off(shop: Shop) -> None:
    closed = []

    def long() -> Procedure[None]:
        try:
            yield Pause(60.0)
        finally:
            closed.append(True)

    def interrupted() -> Procedure[None]:
        yield from read()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shop.run(left=long(), middle=interrupted(), right=long())
    assert closed == [True, True]


@pytest.mark.parametrize("asked_before", [0, 1])
def test_in_a_shared_pause_others_use_the_line(shop: Shop, asked_before: int) -> None:
    paused, used = threading.Event(), threading.Event()

    def pauses() -> Procedure[list[bytes]]:
        first = yield from read(asked_before)
        paused.set()
        while not used.is_set():
            yield Pause(0.001, shared=True)
        return [*first, *(yield from read(1))]

    def other() -> list[bytes]:
        assert paused.wait(30)
        try:
            return shop.buses["left"].do(read(1))
        finally:
            used.set()

    asked = shop.threads.submit(other)
    assert shop.run(left=pauses(), right=read()) == {"left": WARM[: asked_before + 1], "right": WARM}
    assert asked.result() == [b"\x20"]
