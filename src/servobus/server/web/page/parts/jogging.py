"""Driving by hand: what a held button does to a goal, and which messages of a page are too old to move anything.

A button that is held sends a message every BEAT. Each takes the goal a little further; where none comes for GONE, the
servo stands at the last goal, which is never further than REACH ahead. So nothing depends on the end being told.
"""

import math
from dataclasses import dataclass

BEAT = 0.06
"""s between two messages of a held button."""
REACH = 0.15
"""s of motion that one message is worth at most."""
GONE = 0.25
"""s without a message after which a button counts as released."""
LATE = 0.3
"""s that a message may have waited on its way."""


@dataclass(slots=True)
class Freshness:
    """Tells which messages waited on the way, as those do that a page sends when it wakes.

    The clocks of the page and of the server differ by an amount that nobody knows; the message that came fastest tells
    it well enough.
    """

    _least: float = math.inf
    _last: int = -1

    def fresh(self, number: int, sent: float, now: float) -> bool:
        """Take a message, numbered and with the time of the page, s; tells whether it may move something."""
        self._least = min(self._least, now - sent)
        newer = number > self._last
        self._last = max(self._last, number)
        return newer and now - sent - self._least <= LATE


@dataclass(slots=True)
class Jog:
    """A goal that a held button takes along.

    speed      rad/s
    low, high  rad: how far it may go
    """

    speed: float
    low: float
    high: float
    goal: float | None = None
    _heard: float = -math.inf

    def idle(self, now: float) -> bool:
        """Tell whether the button counts as released."""
        return now - self._heard > GONE

    def step(self, direction: int, now: float, position: float) -> float | None:
        """Take a message; gives the next goal, rad, None at the end of the way.

        `position` is where the servo is: a jog begins there.
        """
        begins = self.idle(now) or self.goal is None
        here = position if self.goal is None or begins else self.goal
        passed = BEAT if begins else min(now - self._heard, REACH)
        self._heard = now
        # A servo that was put outside its limits by hand is brought back and not further out.
        low, high = min(self.low, here), max(self.high, here)
        goal = min(max(here + math.copysign(self.speed * passed, direction), low), high)
        if goal == self.goal and not begins:
            return None
        self.goal = goal
        return goal

    def end(self) -> None:
        """Take note that the button is released."""
        self._heard, self.goal = -math.inf, None


def wheel(share: float, direction: int, most: float) -> float:
    """Give how fast a wheel turns while a button is held: `share` of `most`, to this side."""
    return math.copysign(min(max(share, 0.0), 1.0) * most, direction)
