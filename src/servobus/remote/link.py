"""The link to a port that another process owns: exchanges go there as values, and packets come back.

The process that owns the port has the `Link` with its retries, fences and late replies; here an answer is only
interpreted, and what it tells is noted. A procedure of several steps holds the line there as it does here.
"""

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from itertools import count
from typing import Any, TypeVar

from servobus.core.exchange import (
    Batch,
    Exchange,
    GroupExchange,
    Job,
    LateAnswers,
    Now,
    Pause,
    SetBaud,
    Settle,
    Step,
)
from servobus.core.framing import Packet
from servobus.core.operation import Priority
from servobus.errors import BusError, PortError
from servobus.link.base import NOT_FAST, BaseLink
from servobus.link.stats import COLUMNS, Stats
from servobus.link.waits import Receive, Rest, Waits
from servobus.remote.faults import error_of
from servobus.remote.messages import encode, text
from servobus.remote.port import LOOK, RemotePort
from servobus.remote.protocol import Answer, Counted, Failed, Release
from servobus.remote.steps import LONGEST_PAUSE, Outcome, SentPacket, lateness_of, packet_of, sent
from servobus.transports.base import Transport

T = TypeVar("T")

PIECE = 32
"""Exchanges of a batch that are sent at once where another job may want the line."""
MANY = 1000
"""Exchanges whose text is kept; a program that makes its questions anew each time needs none of them."""


class _Hold:
    """A procedure that holds the line. Each time it takes the line it has another number."""

    __slots__ = ("number",)

    def __init__(self, number: int) -> None:
        self.number = number


Heard = Callable[[Exchange[Any], Packet], None]


class RemoteLink(BaseLink):
    """A bus of another process, in use.

    heard     is told of a reply with alarm bits, and of every reply as long as `alarmed` is not empty
    alarmed   servos whose last reply had an alarm in it: that it is over must be told too
    stats     counters to go on with
    priority  tells how urgent the job is that has the line here
    contended  tells whether another job waits for the line here
    """

    def __init__(
        self,
        port: RemotePort,
        *,
        heard: Heard,
        alarmed: Collection[object],
        stats: Stats | None,
        priority: Callable[[], Priority],
        contended: Callable[[], bool],
    ) -> None:
        self.transport = self._port = port
        self.superseded = False
        self.echo: bool | None = None
        self._heard, self._alarmed, self._priority, self._contended = heard, alarmed, priority, contended
        self._stats = Stats() if stats is None else stats
        self._texts: dict[Exchange[Any], str] = {}
        self._begun = 0
        """Number of the request that the fast path has sent."""
        self._hold: _Hold | None = None
        """The procedure that holds the line."""
        self._nested = 0
        """Jobs that callbacks of that procedure run."""
        self._numbers = count(1)

    @property
    def stats(self) -> Stats:
        return self._stats

    def run(self, job: Job[T]) -> Waits[T]:
        """Carry out a job; see `BaseLink.run`. The line is held for it until it ends."""
        if isinstance(job, Exchange):
            return (yield from self.transact(job))
        if self._hold is not None:  # a callback of the job that holds the line
            self._nested += 1
            try:
                return (yield from super().run(job))
            finally:
                self._nested -= 1
        hold = self._hold = _Hold(next(self._numbers))
        try:
            return (yield from super().run(job))
        finally:
            if self._hold is hold:  # else it was closed while others used the line
                self._release()

    def transact(self, exchange: Exchange[T], begun: bytes | None = None) -> Waits[T]:
        n, self._begun = self._begun if begun is not None else self._send(exchange), 0
        answer = yield from self._answer(n)
        (result,) = self._results((exchange,), answer)
        if isinstance(result, BusError):
            raise result
        return result  # type: ignore[no-any-return] # it is a T

    def set_baud(self, baud: int) -> Waits[None]:
        """Talk at this speed from now on: each request says at which it goes."""
        self._port.set_baud(baud)
        yield from ()

    def supersede(self) -> "RemoteLink":
        """Have all that goes through this link fail with Stopped, in the other process too; see `BaseLink`."""
        self.superseded = True
        self._port.supersede()
        link = RemoteLink(
            self._port,
            heard=self._heard,
            alarmed=self._alarmed,
            stats=self._stats,
            priority=self._priority,
            contended=self._contended,
        )
        link.echo, link._numbers = self.echo, self._numbers
        return link

    def try_fast_send(self, exchange: Exchange[Any]) -> float:
        if self.superseded or exchange.reply is None:
            return 0.0
        self._begun = self._send(exchange)
        return LOOK

    def try_fast_receive(self, exchange: Exchange[T], chunk: bytes) -> T | object:  # noqa: ARG002 - it is sorted already
        answer = self._port.take(self._begun)
        if answer is None:
            return NOT_FAST
        (result,) = self._results((exchange,), self._checked(answer))
        if isinstance(result, BusError):
            raise result
        return result  # type: ignore[no-any-return] # it is a T

    def abandon(self) -> None:
        self._break_off(self._begun)
        self._begun = 0

    def _break_off(self, n: int) -> None:
        """Wait for this answer no more, and have the other process end what it does for it."""
        self._port.forget(n)
        if not self.superseded:
            self._port.supersede()

    # The steps of jobs

    def _step(self, step: Step) -> Waits[Any]:
        if isinstance(step, Exchange):
            return (yield from self.transact(step))
        if isinstance(step, SetBaud):
            return self._port.baud_elsewhere
        if isinstance(step, Now):
            return self._port.now()
        if isinstance(step, Pause) and step.shared and not self._nested:
            return (yield from self._let_others(step))
        if isinstance(step, Batch):
            return (yield from self._batch(step))
        if isinstance(step, Pause):
            return (yield from self._pause(step.seconds))
        answer = yield from self._answer(self._send(step))
        return None if answer.lateness is None else lateness_of(answer.lateness)

    def _batch(self, batch: Batch) -> Waits[list[Any]]:
        """Have a batch asked; one that yields goes in pieces, so that what waits here need not wait for all of it."""
        results: list[Any] = []
        size = PIECE if batch.yields else len(batch.exchanges)
        while len(results) < len(batch.exchanges) and not (results and batch.yields and self._contended()):
            some = batch.exchanges[len(results) : len(results) + size]
            answer = yield from self._answer(self._send(Batch(some, batch.again, batch.yields)))
            results += self._results(some[: len(answer.outcomes)], answer)
            if len(answer.outcomes) < len(some):
                break
        return results

    def _pause(self, seconds: float) -> Waits[None]:
        """Have the other process let time pass while it holds the line."""
        while seconds > LONGEST_PAUSE:
            yield from self._answer(self._send(Pause(LONGEST_PAUSE)))
            seconds -= LONGEST_PAUSE
        yield from self._answer(self._send(Pause(max(seconds, 0.0))))

    def _let_others(self, pause: Pause) -> Waits[None]:
        """Let others use the line for a while, here and in the other process."""
        hold = self._hold
        self._release()
        yield Rest(pause.seconds, shared=True)
        if hold is not None:
            hold.number = next(self._numbers)
        self._hold = hold

    def _release(self) -> None:
        if self._hold is not None and not self.superseded:
            with suppress(PortError):  # the next request says so
                self._port.write(encode(Release(self._port.about.name)))
        self._hold = None

    # Requests and answers

    def _send(self, step: Exchange[Any] | Batch | Pause | Settle | LateAnswers) -> int:
        """Send a request; give its number."""
        self.check()
        if isinstance(step, Exchange):
            said = self._texts.get(step)
            if said is None:
                if len(self._texts) > MANY:
                    self._texts.clear()
                said = self._texts[step] = text(sent(step))
        else:
            said = text(sent(step))
        port = self._port
        hold = 0 if self._hold is None else self._hold.number
        # As `text` would write a SentRequest, of which most is the same each time.
        rest = (
            f',"bus":{port.quoted},"baud":{port.baud},"priority":{int(self._priority())},'
            f'"hold":{hold},"time":{port.server_time():.6f},"step":{said}}}'
        )
        return port.request(lambda n: f'{{"k":"step","n":{n}{rest}', self.check)

    def _answer(self, n: int) -> Waits[Answer]:
        """Wait for the answer to a request. Raises the error that came instead."""
        port = self._port
        try:
            while (answer := port.take(n)) is None:
                yield Receive(LOOK)
        except GeneratorExit:
            self._break_off(n)
            raise
        finally:
            port.forget(n)
        return self._checked(answer)

    def _checked(self, answer: Answer | Failed) -> Answer:
        if isinstance(answer, Failed):
            self._count(answer.counts)
            raise error_of(answer.fault)
        if answer.echo is not None:
            self.echo = answer.echo
        return answer

    def _results(self, exchanges: Sequence[Exchange[Any]], answer: Answer) -> list[Any]:
        """Give for each exchange its result, or the BusError that came of it; see `ReplyCollector.outcomes`."""
        told = self._count(answer.counts)
        outcomes = iter(answer.outcomes)
        results: list[Any] = []
        for exchange in exchanges:
            if isinstance(exchange, GroupExchange):
                results.append([self._result(part, next(outcomes), told) for part in exchange.parts])
            else:
                results.append(self._result(exchange, next(outcomes), told))
        return results

    def _result(self, exchange: Exchange[Any], outcome: Outcome, told: Collection[tuple[str, int]]) -> Any:
        packet = packet_of(outcome) if isinstance(outcome, SentPacket) else None
        if (exchange.framing.name, exchange.id) not in told:
            counts = self._stats.servo(exchange.framing.name, exchange.id, self._port.baud)
            counts.sent += 1
            counts.received += packet is not None and bool(exchange.replies)
        if packet is None:
            return error_of(outcome)  # type: ignore[arg-type] # it is a fault
        if exchange.replies and exchange.alarms is not None and (exchange.alarms(packet) or self._alarmed):
            self._heard(exchange, packet)
        try:
            return exchange.interpret(packet)
        except BusError as error:
            return error

    def _count(self, counted: Sequence[Counted]) -> set[tuple[str, int]]:
        """Take over what the other process has counted; give the servos of which it told."""
        for one in counted:
            counts = self._stats.servo(one.family, one.id, self._port.baud)
            for name, more in zip(COLUMNS, one.grown, strict=False):
                setattr(counts, name, getattr(counts, name) + more)
            counts.worst = max(counts.worst, one.worst)
        return {(one.family, one.id) for one in counted}


def remote_link(
    transport: Transport,
    *,
    heard: Heard,
    alarmed: Collection[object],
    stats: Stats | None,
    priority: Callable[[], Priority],
    contended: Callable[[], bool],
) -> RemoteLink:
    """Make the link of a port that another process owns."""
    assert isinstance(transport, RemotePort)
    return RemoteLink(transport, heard=heard, alarmed=alarmed, stats=stats, priority=priority, contended=contended)
