"""Who drives servos, and is watched while he does: a client that hangs or goes away stops what it set in motion.

A holder says that it is there with every beat. Where none comes in time, or the connection ends, its servos are
stopped, and those of others go on. It drives nothing any more until it has said that it is back.
"""

import asyncio
import secrets
import weakref
from collections.abc import Awaitable, Callable, Iterable
from typing import TypeAlias

from servobus.core.arguments import check_above_0
from servobus.errors import BadValue, Stopped

SHORTEST, LONGEST = 0.1, 5.0
"""s of a deadman: below it a page is taken for hung that draws a plot, above it nobody is guarded."""
STALE = 0.5
"""s after which a command of motion is too old in any case."""

Driven: TypeAlias = set[tuple[str, str]]
"""Bus and key of each servo."""


class Holder:
    """Someone who drives servos.

    name      for people
    deadman   s of silence after which it is taken for hung; None: it is not watched, and drives nothing for long
    lapsed    called with what it drives when it is taken for hung, or has gone
    """

    def __init__(self, name: str, lapsed: Callable[[Driven, str], Awaitable[None]]) -> None:
        self.name, self.id = name, secrets.token_hex(8)
        self.deadman: float | None = None
        self.driven: Driven = set()
        self._lapsed = lapsed
        self._loop = asyncio.get_running_loop()
        self._heard = self._loop.time()
        self._timer: asyncio.TimerHandle | None = None
        self._silent = False
        self._sequence = -1
        self._stopping: set[asyncio.Task[None]] = set()

    def watch(self, deadman: float) -> None:
        """Begin to watch. Raises BadValue."""
        seconds = check_above_0("deadman", deadman)
        if not SHORTEST <= seconds <= LONGEST:
            raise BadValue(f"deadman {seconds:g} s is not in {SHORTEST:g} .. {LONGEST:g} s")
        self.deadman = seconds
        self.beat()

    def beat(self) -> None:
        """Take note that it is there."""
        self._heard = self._loop.time()
        self._silent = False
        if self.deadman is not None and self._timer is None:
            self._timer = self._loop.call_at(self._heard + self.deadman, self._look)

    def check(self, sent: float | None = None, sequence: int | None = None) -> None:
        """Raise Stopped for a holder that is taken for hung, and for a command that comes too late or twice.

        `sent` is when the command was sent, by the clock of the server; `sequence` grows from command to command.
        """
        if self.deadman is None:
            raise Stopped(f"{self.name} is not watched: send `hold` with a deadman first")
        if self._silent:
            raise Stopped(f"nothing was heard of {self.name} for {self.deadman:g} s: beat again, then drive")
        if sent is not None and not -STALE <= self._loop.time() - sent <= min(self.deadman, STALE):
            raise Stopped(f"this command of {self.name} is too old: it was sent {self._loop.time() - sent:.2f} s ago")
        if sequence is not None:
            if sequence <= self._sequence:
                raise Stopped(f"command {sequence} of {self.name} came after command {self._sequence}")
            self._sequence = sequence

    def leave(self) -> None:
        """Stop what it drives: it has gone."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._silent = True
        self._let_go(f"{self.name} has gone")

    async def settled(self) -> None:
        """Wait until what it drove has been stopped."""
        await asyncio.gather(*self._stopping)

    def _look(self) -> None:
        self._timer = None
        if self.deadman is None:
            return
        due = self._heard + self.deadman
        if self._loop.time() < due:
            self._timer = self._loop.call_at(due, self._look)
            return
        self._silent = True
        self._let_go(f"nothing was heard of {self.name} for {self.deadman:g} s")

    def _let_go(self, why: str) -> None:
        if self.driven:
            driven, self.driven = self.driven, set()
            task = asyncio.ensure_future(self._lapsed(driven, why))
            self._stopping.add(task)
            task.add_done_callback(self._stopping.discard)


class Holders:
    """All holders that there are: each servo has one at most."""

    def __init__(self) -> None:
        self._all: weakref.WeakSet[Holder] = weakref.WeakSet()

    def add(self, holder: Holder) -> None:
        self._all.add(holder)

    def of(self, bus: str, key: str) -> Holder | None:
        """Give who holds a servo."""
        return next((holder for holder in self._all if (bus, key) in holder.driven), None)

    def free(self, bus: str, keys: Iterable[str]) -> None:
        """Have nobody hold these servos."""
        gone = {(bus, key) for key in keys}
        for holder in self._all:
            holder.driven -= gone
