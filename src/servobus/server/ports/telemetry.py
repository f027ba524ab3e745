"""What everybody looks at, read once: the union of what the clients of a port want to see.

Each client says which registers of which servos it wants, and how often. The port reads the union as control cycles of
a few servos each, at the lowest priority, so that commands and the programs of others come in between. Each client is
given its own part, at its own rate; one that is slow gets the newest values, and misses older ones.

`Subscriptions` decides what is read when and who gets what; `Telemetry` reads.
"""

import asyncio
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, Generic, TypeAlias, TypeVar

from servobus.bus.asyncio import AsyncBus
from servobus.bus.cycle import Cycle
from servobus.bus.servo import Servo
from servobus.core.exchange import Job
from servobus.core.operation import Priority
from servobus.core.values import frozen
from servobus.errors import BadValue, PortError, ServobusError, UsageError

K = TypeVar("K", bound=Hashable)

OVERVIEW = (
    "present_position", "present_speed", "present_load", "present_voltage", "present_temperature", "torque_enable",
    "led", "goal_position",
)  # fmt: skip
"""Registers that an overview of servos shows, of those that a model has."""
SHORTEST, LONGEST = 0.005, 60.0
"""s between two readings of one client: 200 a second are more than a page can show."""
TOGETHER = 4
"""Servos that are read before others may use the line. Assumption: at 57 600 bit/s they take about 8 ms."""
IDLE = 0.5
"""s after which a port is looked at again that has nothing to read, or is gone."""

Values: TypeAlias = dict[str, Any]
"""Register -> value in its unit."""
Deliver: TypeAlias = Callable[[Hashable, float, Mapping[Servo, Values], Mapping[Servo, str]], object]


@frozen
class Wish(Generic[K]):
    """What a client wants to see.

    servos    servo -> names of its registers
    period    s between two readings
    everyone  whether an overview of all servos comes with it, also of those that are met later
    """

    servos: Mapping[K, tuple[str, ...]]
    period: float
    everyone: bool = False


class _Subscription(Generic[K]):
    def __init__(self, wish: Wish[K], now: float) -> None:
        self.wish, self.due = wish, now


class Subscriptions(Generic[K]):
    """Who wants to see what on one port: one wish for each client, a new one in place of the old."""

    def __init__(self) -> None:
        self._clients: dict[Hashable, _Subscription[K]] = {}

    def __len__(self) -> int:
        return len(self._clients)

    def set(self, client: Hashable, wish: Wish[K], now: float) -> None:
        """Take what a client wants from now on. Raises BadValue for a period that is not to be had."""
        if not SHORTEST <= wish.period <= LONGEST:
            raise BadValue(f"period {wish.period:g} s of telemetry is not within {SHORTEST:g} .. {LONGEST:g} s")
        self._clients[client] = _Subscription(wish, now)

    def drop(self, client: Hashable) -> None:
        """Forget what a client wanted, if it wanted anything."""
        self._clients.pop(client, None)

    def next_due(self) -> float | None:
        """Give the time at which something is to be read; None if nobody wants to see anything."""
        return min((one.due for one in self._clients.values()), default=None)

    def take_due(self, now: float) -> dict[Hashable, Wish[K]]:
        """Give the clients whose time has come, with what they want; their next turn is a period later.

        A turn that was missed is not made up for: the line is busier than they can see.
        """
        due = {}
        for client, one in self._clients.items():
            if one.due <= now:
                due[client] = one.wish
                one.due = max(one.due + one.wish.period, now)
        return due


def union(wishes: Iterable[Wish[K]]) -> dict[K, tuple[str, ...]]:
    """Give all registers that any of these wants of each servo, in the order in which they are first named."""
    wanted: dict[K, dict[str, None]] = {}
    for wish in wishes:
        for servo, names in wish.servos.items():
            wanted.setdefault(servo, {}).update(dict.fromkeys(names))
    return {servo: tuple(names) for servo, names in wanted.items()}


def share(wish: Wish[K], seen: Mapping[K, Values]) -> dict[K, Values]:
    """Give the part of what was read that one client wants."""
    return {servo: {name: seen[servo][name] for name in names} for servo, names in wish.servos.items() if servo in seen}


def overview(servo: Servo) -> tuple[str, ...]:
    """Give the registers of a servo that an overview shows."""
    model = servo.model
    return tuple(name for name in OVERVIEW if model.aliases.get(name, name) in model.registers)


def check_wish(servo: Servo, names: Sequence[str]) -> tuple[str, ...]:
    """Give the names, each once, if the servo's model has such registers. Raises UnknownName, UsageError."""
    if unreadable := [name for name in names if not servo.model.register(name).readable]:
        raise UsageError(f"{servo.target}: {', '.join(unreadable)} cannot be read")
    return tuple(dict.fromkeys(names))


class Telemetry:
    """Reads what the clients of one port want to see, until it is cancelled.

    bus      the port
    deliver  is given a client, the time in s of the port's clock, servo -> values, and servo -> error of the silent
    sent_as  puts a mark on what this sends
    """

    def __init__(
        self,
        bus: AsyncBus,
        deliver: Deliver,
        sent_as: Callable[[Any], Job[Any]] = lambda job: job,
    ) -> None:
        self._bus, self._deliver, self._sent_as = bus, deliver, sent_as
        self.subscriptions: Subscriptions[Servo] = Subscriptions()
        self._changed = asyncio.Event()
        self._cycles: dict[tuple[tuple[Servo, ...], tuple[str, ...]], Cycle] = {}
        """Control cycles that were prepared; they keep which servos are silent."""

    def subscribe(self, client: Hashable, wish: Wish[Servo]) -> None:
        """Show a client what it wants from now on, in place of what it wanted before. Raises BadValue."""
        self.subscriptions.set(client, wish, self._bus.transport.now())
        self._changed.set()

    def unsubscribe(self, client: Hashable) -> None:
        """Show a client nothing more."""
        self.subscriptions.drop(client)
        self._changed.set()

    async def run(self) -> None:
        """Read and deliver, for ever. A port that is gone is tried again after a while."""
        while True:
            due = self.subscriptions.next_due()
            now = self._bus.transport.now()
            if due is None or due > now:
                await self._wait(None if due is None else due - now)
                continue
            try:
                await self._turn(self.subscriptions.take_due(now))
            except PortError:
                await asyncio.sleep(IDLE)

    async def _wait(self, seconds: float | None) -> None:
        self._changed.clear()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), seconds)

    async def _turn(self, due: Mapping[Hashable, Wish[Servo]]) -> None:
        seen: dict[Servo, Values] = {}
        lost: dict[Servo, str] = {}
        known = dict.fromkeys(self._bus)
        due = {client: self._filled(wish) for client, wish in due.items()}
        wanted: dict[Servo, tuple[str, ...]] = {
            servo: names for servo, names in union(due.values()).items() if servo in known and names
        }
        for cycle in self._prepared(wanted):
            try:
                result = await self._bus.do(self._sent_as(cycle.run()), priority=Priority.SCAN)
            except PortError:
                raise
            except ServobusError as error:  # a stop took the line, or these servos can be asked nothing
                lost.update(dict.fromkeys(cycle.servos, str(error)))
            else:
                seen.update(result)
                lost.update((servo, str(error)) for servo, error in result.lost.items())
        now = self._bus.transport.now()
        for client, wish in due.items():
            mine = {servo: text for servo, text in lost.items() if servo in wish.servos}
            self._deliver(client, now, share(wish, seen), mine)

    def _filled(self, wish: Wish[Servo]) -> Wish[Servo]:
        if not wish.everyone:
            return wish
        return Wish({servo: overview(servo) for servo in self._bus} | dict(wish.servos), wish.period)

    def _prepared(self, wanted: Mapping[Servo, tuple[str, ...]]) -> Iterator[Cycle]:
        """Give control cycles of a few servos of one kind each, for the same registers."""
        alike: dict[tuple[str, int, tuple[str, ...]], list[Servo]] = {}
        for servo, names in wanted.items():
            alike.setdefault((servo.family.name, servo.baud, names), []).append(servo)
        used = {}
        for (_, _, names), servos in alike.items():
            for at in range(0, len(servos), TOGETHER):
                key = tuple(servos[at : at + TOGETHER]), names
                used[key] = self._cycles.get(key) or Cycle(self._bus.transport, key[0], names, (), 0.0)
        self._cycles = used
        yield from used.values()
