"""Which questions go out as one request, by what the line has shown: no port, no clock. The link sends.

A servo whose firmware does not know such a request stays silent in its turn, and all behind it with it. One that has
done so several times running, and answered each time when it was asked alone, is asked alone from then on.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any, TypeAlias

from servobus.core.exchange import Exchange, GroupExchange, joined
from servobus.core.framing import Framing
from servobus.errors import BusError, NoReply

ENOUGH = 3
"""Turns running in which a servo must stay silent; assumption: noise does not lose as many of one servo."""

Servo: TypeAlias = tuple[Framing, int]


class Groups:
    """What a line has taught about servos that are asked together."""

    def __init__(self) -> None:
        self._suspected: set[Servo] = set()
        """Servos that were silent in their last turn."""
        self._missed: Counter[Servo] = Counter()
        """Servo -> turns running in which it was silent although it was there."""

    def make(self, exchanges: Sequence[Exchange[Any]]) -> list[GroupExchange[Any]]:
        """Make groups of those that can be joined, and have not shown that they do not answer so."""
        return joined(
            [one for one in exchanges if one.joins is not None and self._missed[one.framing, one.id] < ENOUGH]
        )

    def learn(self, group: GroupExchange[Any], outcomes: Sequence[Any]) -> None:
        """Take note of who answered in a group, and who was the first of those that did not."""
        for part, outcome in zip(group.parts, outcomes, strict=True):
            if not isinstance(outcome, BusError):
                servo = part.framing, part.id
                self._missed.pop(servo, None)
                self._suspected.discard(servo)
        first = len(group.parts) - len(group.silent(outcomes))
        if first < len(group.parts) and isinstance(outcomes[first], NoReply):
            self._suspected.add((group.framing, group.parts[first].id))

    def learn_alone(self, exchange: Exchange[Any], outcome: Any) -> None:
        """Take note of what came of a question that was asked alone."""
        servo = exchange.framing, exchange.id
        if servo in self._suspected and not isinstance(outcome, BusError):
            self._suspected.discard(servo)
            self._missed[servo] += 1
