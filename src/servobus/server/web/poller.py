"""Reads what clients have asked to see, again and again: the union of it, once for all of them, behind everything else.

As long as nobody asks for anything nothing is read.
"""

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from servobus.bus.asyncio import AsyncBus, AsyncBusServo
from servobus.core.operation import Priority
from servobus.core.present import si_value
from servobus.core.registers import Register
from servobus.errors import BusError, PortError, ServobusError
from servobus.server.web.feeds import Feed
from servobus.server.web.values import key_of

SHORTEST, LONGEST = 0.01, 60.0
"""s between two samples."""
AGAIN = 1.0
"""s after which it is tried again where a sample has failed by a fault of this program."""
MISSED = 3
"""Readings in a row without an answer after which a servo is said to be lost."""
OVERVIEW = (
    "present_position", "goal_position", "present_speed", "present_load", "present_voltage", "present_temperature",
    "present_current", "torque_enable", "led", "led_control", "moving",
)  # fmt: skip
"""What is read of each servo where a client asks for an overview, as far as its model has it."""

Rows = Sequence[Register[Any]]


class Subscription:
    """What one client has asked to see on one bus; `wanted` gives the registers of each servo, anew each time."""

    def __init__(self, feed: Feed, wanted: Callable[[], Mapping[AsyncBusServo, Rows]], period: float) -> None:
        self.feed, self.wanted, self.period = feed, wanted, period
        self.due = 0.0


class Poller:
    """Reads for the clients of one bus.

    tell    called with what has happened and to which servo: it was lost, it is back, its alarms have changed
    failed  called with an error of the port
    """

    def __init__(
        self,
        name: str,
        bus: AsyncBus,
        tell: Callable[[str, AsyncBusServo], None],
        failed: Callable[[PortError], None],
    ) -> None:
        self._name, self._bus, self._tell, self._failed = name, bus, tell, failed
        self._subscriptions: dict[Feed, Subscription] = {}
        self._missed: dict[AsyncBusServo, int] = {}
        self._alarms: dict[AsyncBusServo, int] = {}
        self._task: asyncio.Task[None] | None = None
        self._changed = asyncio.Event()

    def subscribe(self, feed: Feed, wanted: Callable[[], Mapping[AsyncBusServo, Rows]], period: float) -> None:
        """Read for a client, in place of what it has asked for before."""
        self._subscriptions[feed] = Subscription(feed, wanted, period)
        self._changed.set()
        if self._task is None or self._task.done():
            self._task = asyncio.ensure_future(self._run())

    def unsubscribe(self, feed: Feed) -> None:
        """Read for a client no more."""
        self._subscriptions.pop(feed, None)

    def lost(self, servo: AsyncBusServo) -> bool:
        """Tell whether a servo has not answered lately."""
        return self._missed.get(servo, 0) >= MISSED

    async def close(self) -> None:
        """Read nothing more."""
        self._subscriptions.clear()
        if self._task is not None:
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        while self._subscriptions:
            now = loop.time()
            due = [one for one in self._subscriptions.values() if one.due <= now]
            if due:
                try:
                    await self._sample(due)
                except Exception:
                    logging.getLogger("servobus").exception("%s: a sample has failed", self._name)
                    await asyncio.sleep(AGAIN)
                for one in due:
                    one.due = max(one.due + one.period, loop.time())
            self._changed.clear()
            nearest = min((one.due for one in self._subscriptions.values()), default=0.0)
            with suppress(TimeoutError):
                # At least once in a while everybody else has a turn, even where a port takes no time of its own.
                async with asyncio.timeout(max(nearest - loop.time(), 0.001)):
                    await self._changed.wait()

    async def _sample(self, due: Sequence[Subscription]) -> None:
        wanted = {one: one.wanted() for one in due}
        union: dict[AsyncBusServo, dict[Register[Any], None]] = {}
        for rows_of in wanted.values():
            for servo, rows in rows_of.items():
                union.setdefault(servo, {}).update(dict.fromkeys(rows))
        values: dict[AsyncBusServo, dict[Register[Any], int] | None] = {}
        for servo, asked in union.items():
            try:
                values[servo] = await self._read(servo, list(asked))
            except PortError as error:
                self._failed(error)
                return
        now = asyncio.get_running_loop().time()
        for one, rows_of in wanted.items():
            told = {}
            for servo, rows in rows_of.items():
                raws = values[servo]
                told[key_of(servo)] = {
                    "values": None if raws is None else {row.name: si_value(row, raws[row]) for row in rows},
                    "alarms": servo.alarm_text().split("+") if servo.alarms else [],
                }
            one.feed.sample(self._name, {"t": round(now, 4), "servos": told})

    async def _read(self, servo: AsyncBusServo, rows: Rows) -> dict[Register[Any], int] | None:
        """Read one servo; None where it does not answer."""
        try:
            job = servo.family.read(servo.target, rows)
            raws = await self._bus.do(job, servo.baud, priority=Priority.SCAN)
        except PortError:
            raise
        except (BusError, ServobusError):
            missed = self._missed[servo] = self._missed.get(servo, 0) + 1
            if missed == MISSED:
                self._tell("lost", servo)
            return None
        if self._missed.pop(servo, 0) >= MISSED:
            self._tell("appeared", servo)
        if self._alarms.get(servo, 0) != servo.alarms:
            self._alarms[servo] = servo.alarms
            self._tell("alarm", servo)
        return dict(zip(rows, raws, strict=True))
