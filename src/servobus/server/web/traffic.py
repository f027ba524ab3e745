"""The packets on a bus as people look at them: in words, with who asked, and what they come to servo by servo.

Bytes are taken from the owner of the ports only while somebody looks. Nobody is told of single packets: who looks asks
for those behind the last one that he has, as often as he can show them.
"""

import asyncio
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from servobus.errors import UsageError
from servobus.families.base import Family, Model
from servobus.families.explain import servo as called
from servobus.remote.managing import Traffic
from servobus.server.web.owner_link import OwnerLink
from servobus.traffic.events import EventKind, TrafficEvent
from servobus.traffic.present import event_entry, servo_entry
from servobus.traffic.recording import Chunk, Direction
from servobus.traffic.tracker import Tracker

KEPT = 2000
"""Packets that are kept, for those who filter and for those who come later."""
BEHIND = 0.3
"""s that bytes may be under way from the owner of the ports to here before silence is taken for silence."""
SERVER = "server"
"""Who asks where no client did."""
QUIET = EventKind.PROBE, EventKind.PADDING, EventKind.ECHO, EventKind.SPEED
"""What is on a line beside packets, and seldom looked for."""


@dataclass(frozen=True, slots=True)
class Seen:
    """A packet, or what else was seen on the line.

    number  grows by 1 from one to the next
    by      who asked, or whom this answers
    entry   as `servobus.traffic.present.event_entry` gives it
    """

    number: int
    by: str
    entry: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Filter:
    """Which packets are looked at.

    servo     as "dynamixel 1"; "" for all, and so below
    by        who asked
    text      what stands in the words or the bytes
    troubles  only what went wrong
    """

    servo: str = ""
    by: str = ""
    text: str = ""
    troubles: bool = False

    def lets_through(self, seen: Seen) -> bool:
        entry = seen.entry
        if entry["kind"] in QUIET and not self.text:
            return False
        if self.troubles and entry["trouble"] is None:
            return False
        if self.servo and self.servo != servo_name(entry):
            return False
        if self.by and self.by != seen.by:
            return False
        wanted = self.text.lower()
        return not wanted or wanted in entry["text"].lower() or wanted in entry["hex"].lower()

    def of(self, seen: Iterable[Seen]) -> list[Seen]:
        return [one for one in seen if self.lets_through(one)]


def servo_name(entry: dict[str, Any]) -> str:
    """Give what a servo is called in an entry of a packet or of a servo: "dynamixel 1"; "" where it is of none."""
    if entry["family"] is None or entry["id"] is None:
        return ""
    return f"{entry['family']} {called(entry['id']).removeprefix('id ')}"


class TrafficWatch:
    """The packets on one bus.

    models    gives the servos that are known: family, id, model
    missed    pieces that the owner of the ports left out, for they were not taken fast enough
    programs  who asked -> how many requests
    """

    def __init__(
        self, bus: str, owner: OwnerLink | None, models: Callable[[], Iterable[tuple[Family, int, type[Model]]]]
    ) -> None:
        self._bus, self._owner, self._models = bus, owner, models
        self._looking = 0
        self._forget()

    def _forget(self) -> None:
        self._tracker = Tracker()
        self._kept: deque[Seen] = deque(maxlen=KEPT)
        self._number = 0
        self._ahead = 0.0
        """s by which the clock of this loop is ahead of the one of the port."""
        self._asked: dict[str, str] = {}
        """Servo -> who asked it last."""
        self.missed = 0
        self.programs: Counter[str] = Counter()

    async def begin(self) -> None:
        """Look from now on; each who does ends it. Raises UsageError where the bytes are not to be had."""
        if self._owner is None:
            raise UsageError(f"the packets on {self._bus} are seen where its port is open, and here it is not")
        self._looking += 1
        if self._looking == 1:
            self._forget()
            for known in self._models():
                self._tracker.know(*known)
            await self._owner.watch_traffic(self._bus, self.take)

    async def end(self) -> None:
        """Look no more."""
        self._looking -= 1
        if self._looking == 0 and self._owner is not None:
            await self._owner.forget_traffic(self._bus)

    def take(self, traffic: Traffic) -> None:
        """Take bytes."""
        self._ahead = asyncio.get_running_loop().time() - traffic.time
        self.missed += traffic.missed
        chunk = Chunk(traffic.time, Direction(traffic.direction), traffic.data)
        self._keep(self._tracker.feed(chunk), traffic.by or SERVER)

    def after(self, number: int) -> list[Seen]:
        """Give the packets behind the one with this number, as far as they are kept."""
        for known in self._models():
            self._tracker.know(*known)
        if self._ahead:
            self._keep(self._tracker.pass_time(asyncio.get_running_loop().time() - self._ahead - BEHIND), SERVER)
        if number >= self._number:
            return []
        return [one for one in self._kept if one.number > number]

    def servos(self) -> list[dict[str, Any]]:
        """Give what each servo did; see `servobus.traffic.present.servo_entry`."""
        return [{"name": servo_name(entry := servo_entry(one)), **entry} for one in self._tracker.servos]

    def _keep(self, events: Iterable[TrafficEvent], by: str) -> None:
        for event in events:
            entry = event_entry(event)
            servo = servo_name(entry)
            if event.kind is EventKind.REQUEST:
                self._asked[servo] = by
                self.programs[by] += 1
            self._number += 1
            self._kept.append(Seen(self._number, self._asked.get(servo, by), entry))
