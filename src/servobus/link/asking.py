"""Asking, and asking again: what a link does with a question, or a batch of them, beyond one attempt."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar

from servobus.core.exchange import Batch, Exchange, GroupExchange
from servobus.errors import BusError, NoReply
from servobus.link.groups import Groups
from servobus.link.line_clock import LineClock
from servobus.link.pipeline import Pipeline, is_lost
from servobus.link.reply_log import ReplyLog
from servobus.link.waits import Rest, Waits
from servobus.transports.base import Transport

T = TypeVar("T")

TRIES = 2
"""How often a question is asked at most."""
DEADLINE = 0.5
"""s after which a question is not asked again."""


class Attempt(Protocol):
    """Sends one or several questions once, and waits for their replies; gives a result or a BusError for each.

    Raises the BusError that kept them from being sent. `begun` is what was heard if they are sent already. The list may
    be shorter, and the rest was not sent then; so with `yields` where another job waits for the line.
    """

    def __call__(
        self,
        exchanges: Sequence[Exchange[Any]],
        begun: bytes | None = None,
        *,
        fence: bool = False,
        yields: bool = False,
    ) -> Waits[list[Any]]: ...


class Asking:
    """Asks questions by attempts, singly or several at once, and asks again what was lost where that is allowed."""

    def __init__(
        self,
        transport: Transport,
        clock: LineClock,
        log: ReplyLog,
        pipeline: Pipeline,
        attempt: Attempt,
        contended: Callable[[], bool],
        echo_known: Callable[[], bool],
    ) -> None:
        self._transport, self._clock, self._log = transport, clock, log
        self._pipeline, self._attempt, self._contended = pipeline, attempt, contended
        self._echo_known = echo_known
        self._groups = Groups()

    def until_answered(self, exchange: Exchange[T], begun: bytes | None = None) -> Waits[T]:
        """Ask, and ask again if it is repeatable and no reply was understood. Raises the BusError that came of it."""
        started = self._transport.now()
        best: Any = None
        for attempt in range(TRIES):
            if attempt:
                self._log.counts(exchange, exchange.id).retries += 1
                # A servo that takes bytes of another speed for the start of a packet would miss it again.
                if (seconds := self._clock.forgotten_at(exchange.framing) - self._transport.now()) > 0:
                    yield Rest(seconds)
            outcome = yield from self.once(exchange, begun)
            best = outcome if attempt == 0 else _better(best, outcome)
            begun = None
            if not (is_lost(outcome) and exchange.repeatable and self._transport.now() - started <= DEADLINE):
                break
        if isinstance(best, BusError):
            raise best
        if isinstance(exchange, GroupExchange) and exchange.repeatable:
            yield from self._complete(exchange.parts, best, exchange.turnless(best), again=True)
        done: T = best
        return done

    def once(self, exchange: Exchange[Any], begun: bytes | None = None, *, fence: bool = False) -> Waits[Any]:
        """Ask one question once, and give what went wrong instead of raising it."""
        try:
            (outcome,) = yield from self._attempt((exchange,), begun, fence=fence)
        except BusError as error:
            return error
        if exchange.joins is not None and not fence:
            self._groups.learn_alone(exchange, outcome)
        return outcome

    def batch(self, batch: Batch) -> Waits[list[Any]]:
        """Ask as many at once as the line allows; one by one, what did not come through.

        As long as it is unknown whether the line echoes, a question goes alone: the first one finds that out.
        """
        outcomes: list[Any] = []
        rest = batch.exchanges
        while rest and not (outcomes and batch.yields and self._contended()):
            count = self._pipeline.together(rest, self._log.doubtful) if self._echo_known() else 1
            some, rest = rest[:count], rest[count:]
            if count == 1:
                outcome = yield from self._alone(some[0], again=batch.again)
                self._pipeline.learn_alone(outcome)
                outcomes.append(outcome)
                continue
            if not batch.yields and (groups := self._groups.make(some)):
                outcomes += yield from self._grouped(some, groups, again=batch.again)
                continue
            try:
                found = yield from self._attempt(some, yields=batch.yields)
            except BusError as error:  # nothing was sent
                outcomes += [error] * count
                continue
            some, rest = some[: len(found)], [*some[len(found) :], *rest]
            yield from self._complete(some, found, again=batch.again)
            outcomes += found
        return outcomes

    def _grouped(
        self, exchanges: Sequence[Exchange[Any]], groups: Sequence[GroupExchange[Any]], *, again: bool
    ) -> Waits[list[Any]]:
        """Ask one group after the other, then the exchanges that are in none; give an outcome for each exchange."""
        outcomes: dict[Exchange[Any], Any] = {}
        for group in groups:
            try:
                (found,) = yield from self._attempt((group,))
            except BusError as error:  # nothing was sent
                outcomes.update(dict.fromkeys(group.parts, error))
                continue
            if isinstance(found, BusError):
                found = [found] * len(group.parts)
                yield from self._complete(group.parts, found, again=again)
            else:
                self._groups.learn(group, found)
                yield from self._complete(group.parts, found, group.turnless(found), again=again)
            outcomes.update(zip(group.parts, found, strict=True))
        others = [exchange for exchange in exchanges if exchange not in outcomes]
        found = yield from self.batch(Batch(others, again=again))
        outcomes.update(zip(others, found, strict=True))
        return [outcomes[exchange] for exchange in exchanges]

    def _complete(
        self, exchanges: Sequence[Exchange[Any]], outcomes: list[Any], turnless: Sequence[int] = (), *, again: bool
    ) -> Waits[None]:
        """Ask each that had no turn, and with `again` once more each whose reply was lost, if it is repeatable.

        The last one of a group comes first: a servo that still waits for its turn has then been asked something else
        before the servo that it waits for speaks.
        """
        for n, exchange in reversed(list(enumerate(exchanges))):
            if n not in turnless:
                if not (again and exchange.repeatable and is_lost(outcomes[n])):
                    continue
                self._log.counts(exchange, exchange.id).retries += 1
            outcomes[n] = yield from self._alone(exchange, again=again)

    def _alone(self, exchange: Exchange[Any], *, again: bool) -> Waits[Any]:
        if not again:
            return (yield from self.once(exchange))
        try:
            return (yield from self.until_answered(exchange))
        except BusError as error:
            return error


def _better(old: Any, new: Any) -> Any:
    """Choose between the outcomes of two tries: what was understood, and of two errors not silence, which says less."""
    if not is_lost(old) or (is_lost(new) and isinstance(new, NoReply)):
        return old
    return new
