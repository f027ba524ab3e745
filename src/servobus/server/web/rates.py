"""How many requests of one login are let through a second."""

import math
import time
from collections import OrderedDict
from collections.abc import Callable

from servobus.server.web.auth import Authority, Login

COMMANDS, READINGS = 50.0, 200.0
"""A second of each login, and so many at once: what changes something, and what is asked."""
MOST = 1024
"""Logins that are counted; of those that were idle longest none is remembered."""


class Bucket:
    """Holds what may still be taken: it fills by `rate` a second, up to what one second gives."""

    __slots__ = ("_at", "_left", "_now", "_rate")

    def __init__(self, rate: float, now: Callable[[], float] = time.monotonic) -> None:
        self._rate, self._left, self._now = rate, rate, now
        self._at = now()

    def take(self) -> float:
        """Take one; give the seconds until there is one, 0 if it was taken."""
        now = self._now()
        self._left = min(self._rate, self._left + (now - self._at) * self._rate)
        self._at = now
        if self._left < 1:
            return (1 - self._left) / self._rate
        self._left -= 1
        return 0.0


class Rates:
    """The buckets of all logins, by the clock of who logs them in."""

    def __init__(self, authority: Authority) -> None:
        self._authority = authority
        self._buckets: OrderedDict[tuple[str, bool], Bucket] = OrderedDict()

    def take(self, login: Login, *, changes: bool) -> int:
        """Let one request through; give the whole seconds until the next is, 0 if it is."""
        key = login.id, changes
        bucket = self._buckets.pop(key, None) or Bucket(COMMANDS if changes else READINGS, self._authority.now)
        self._buckets[key] = bucket
        if len(self._buckets) > MOST:
            self._buckets.popitem(last=False)
        return math.ceil(bucket.take())
