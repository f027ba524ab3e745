"""A key that keeps something going as long as it is held."""

import math


class HeldKey:
    """Whether a key is held, as far as a terminal tells: it repeats the key, after a pause at first.

    FIRST is longer than the usual pause of 0.25 s to 0.66 s before a terminal repeats a key, AFTER longer than three of
    the usual repeats of 30 ms; *assumption*.
    """

    FIRST, AFTER = 0.7, 0.2

    def __init__(self) -> None:
        self._last = -math.inf
        self._repeats = 0

    def pressed(self, now: float) -> None:
        """Take note that the key came, at a time in s."""
        self._repeats = self._repeats + 1 if self.held(now) else 0
        self._last = now

    def held(self, now: float) -> bool:
        """Tell whether it is still held."""
        return now - self._last <= (self.AFTER if self._repeats else self.FIRST)
