"""What goes to one client: answers, telemetry, of which the newest counts, and events, of which none is left out.

A client that reads slowly loses telemetry. One that does not take its events is given up, and told why; it can join
again, and asks for what it missed.
"""

import asyncio
import time
from collections import deque
from collections.abc import Mapping
from typing import Any

from servobus.server.web.errors import TooMany

MOST_WAITING = 1000
"""Events, and answers, that wait for one client."""
MOST_FEEDS = 64
"""Clients that are served at once."""
KEPT = 200
"""Events that a client which joins can ask for."""


class Feed:
    """What waits for one client. `full` says why it is given up; "" as long as it is not."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.full = ""
        self.lost = 0
        """Samples that were replaced by newer ones before the client took them."""
        self._answers: deque[dict[str, Any]] = deque()
        self._events: deque[dict[str, Any]] = deque()
        self._newest: dict[str, dict[str, Any]] = {}
        """Bus -> its telemetry."""
        self._news = asyncio.Event()

    def tell(self, event: Mapping[str, Any]) -> None:
        """Have an event sent, in turn."""
        self._put(self._events, dict(event))

    def answer(self, message: dict[str, Any]) -> None:
        """Have an answer sent: before the events that wait."""
        self._put(self._answers, message)

    def sample(self, bus: str, values: Mapping[str, Any]) -> None:
        """Have telemetry sent: it replaces what waits."""
        if self.full:
            return
        self.lost += bus in self._newest
        self._newest[bus] = {"k": "telemetry", "bus": bus, **values, "lost": self.lost}
        self._news.set()

    async def next(self) -> list[dict[str, Any]]:
        """Wait for something to send: answers and events that wait, then the newest telemetry of each bus."""
        while not (self._answers or self._events or self._newest or self.full):
            self._news.clear()
            await self._news.wait()
        messages = [*self._answers, *self._events, *self._newest.values()]
        self._clear()
        return messages

    def _put(self, queue: deque[dict[str, Any]], message: dict[str, Any]) -> None:
        if not self.full and len(queue) >= MOST_WAITING:
            self.full = f"{MOST_WAITING} messages wait for this client: it reads too slowly"
            self._clear()
        elif not self.full:
            queue.append(message)
        self._news.set()

    def _clear(self) -> None:
        self._answers.clear()
        self._events.clear()
        self._newest.clear()


class Events:
    """Tells all clients what has happened."""

    def __init__(self) -> None:
        self._feeds: set[Feed] = set()
        self._past: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._number = 0

    def __len__(self) -> int:
        return len(self._feeds)

    def join(self, feed: Feed) -> None:
        """Have a client told from now on. Raises TooMany."""
        if len(self._feeds) >= MOST_FEEDS:
            raise TooMany(f"{MOST_FEEDS} clients are connected already: close one of them first")
        self._feeds.add(feed)

    def leave(self, feed: Feed) -> None:
        """Tell a client no more."""
        self._feeds.discard(feed)

    def tell(self, what: str, **more: Any) -> None:
        """Tell all clients."""
        self._number += 1
        event = {"k": "event", "number": self._number, "time": round(time.time(), 3), "what": what, **more}
        self._past.append(event)
        for feed in self._feeds:
            feed.tell(event)

    def past(self, after: int = 0) -> list[dict[str, Any]]:
        """Give the last events, the oldest first, of those with a higher number."""
        return [event for event in self._past if event["number"] > after]
