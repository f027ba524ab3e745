"""The steps of one connection on one bus: one after the other, with the line held between those of a procedure."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, Protocol

from servobus.bus.asyncio import AsyncBus
from servobus.core.exchange import Batch, Exchange, GroupExchange, LateAnswers, Lateness, Procedure, Step
from servobus.core.framing import Packet
from servobus.core.ids import BROADCAST
from servobus.core.operation import Priority
from servobus.errors import ServobusError, Stopped, UsageError
from servobus.link.ownership import Turn, TurnState, turn_for
from servobus.link.stats import COLUMNS, Counts
from servobus.remote.faults import fault
from servobus.remote.protocol import Answer, Counted, Failed, SentRequest
from servobus.remote.steps import SentExchange, SentLateness, exchanges_in, outcome_of, step_of
from servobus.server.ports.gate import Gate
from servobus.server.ports.leases import Holder

LAPSE = 2.0
"""s after its last step at which a procedure that says nothing more loses the line."""
MOST_WAITING = 64
"""Requests of one connection that may wait for their turn on a bus."""
FASTEST = 10_000_000
"""Highest speed that may be asked for, bit/s."""
KNOWN = 1000
"""Exchanges that are kept, so that one that comes again is not made anew."""

_numbers: Callable[[Counts], tuple[int, ...]] = attrgetter(*COLUMNS[:-1])
"""Gives the counters that grow; the last one is the worst delay."""


class Exchanges:
    """The exchanges that came, each made once: what a link has worked out for one holds when it comes again."""

    def __init__(self) -> None:
        self._made: dict[SentExchange, Exchange[Any]] = {}

    def step(self, sent: Any) -> Step:
        """Give the step that was sent. Raises UsageError."""
        if not isinstance(sent, SentExchange):
            return step_of(sent)
        made = self._made.get(sent)
        if made is None:
            if len(self._made) > KNOWN:
                self._made.clear()
            step = step_of(sent)
            assert isinstance(step, Exchange)
            made = self._made[sent] = step
        return made


class Tell(Protocol):
    """Sends a message to the client."""

    def __call__(self, message: Any) -> None: ...


class BusSteps:
    """What one connection does on one bus.

    who   on whose behalf
    name  what clients call the bus
    tell  sends an answer
    """

    def __init__(self, who: Holder, name: str, bus: AsyncBus, gate: Gate, exchanges: Exchanges, tell: Tell) -> None:
        self.bus = bus
        self._who, self._name, self._gate, self._exchanges, self._tell = who, name, gate, exchanges, tell
        self._waiting: deque[SentRequest] = deque()
        self._task: asyncio.Task[None] | None = None
        self._hold: Turn | None = None
        """The line, held between the steps of a procedure."""
        self._talking: Turn | None = None
        """The turn with which something is under way."""
        self._number = 0
        """The number of that procedure, or of the last one."""
        self._lapse: asyncio.TimerHandle | None = None
        self._worst: dict[tuple[str, int], float] = {}
        """The worst delay of a servo that was told."""
        self._echo: bool | None = None
        """What was told of the echo."""

    @property
    def busy(self) -> bool:
        """Whether a request is under way or waits for its turn."""
        return self._task is not None

    def put(self, request: SentRequest) -> bool:
        """Take a request, to be carried out in its turn; tell whether there was room for it."""
        if len(self._waiting) >= MOST_WAITING:
            return False
        self._waiting.append(request)
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._work())
        return True

    def release(self) -> None:
        """End the hold of the procedure that has the line."""
        if self._lapse is not None:
            self._lapse.cancel()
            self._lapse = None
        hold, self._hold = self._hold, None
        if hold is not None and hold is not self._talking:  # else it ends when what is under way has ended
            self.bus.line.end(hold)

    def break_off(self, why: str) -> None:
        """End what is under way, and what waits: each is answered with Stopped."""
        task, self._task = self._task, None
        waiting, self._waiting = self._waiting, deque()
        if task is not None:
            task.cancel(why)
        for request in waiting:
            self._tell(Failed(request.n, fault(Stopped(f"{self._name}: {why}"))))
        self.release()

    async def _work(self) -> None:
        me = asyncio.current_task()
        try:
            while self._waiting and self._task is me:
                await self._carry_out(self._waiting.popleft())
        finally:
            if self._task is me:
                self._task = None

    async def _carry_out(self, request: SentRequest) -> None:
        before: dict[tuple[str, int], Sequence[int]] = {}
        asked: tuple[Exchange[Any], ...] = ()
        turn: Turn | None = None
        try:
            step = self._exchanges.step(request.step)
            asked = exchanges_in(step)
            _check(request)
            if self._lapse is not None:
                self._lapse.cancel()
                self._lapse = None
            turn = self._talking = await self._turn(request)
            for exchange in asked:
                self._gate.admit(
                    self._who, self._name, exchange, request.baud, request.time, Priority(request.priority)
                )
            before = self._counters(asked, request.baud)
            came = await self._do(turn, step, request.baud)
            answer = self._answer(request, step, came, before)
            self._note(asked, request.baud, step, came)
        except asyncio.CancelledError as error:
            why = error.args[0] if error.args else "broken off"
            self._tell(Failed(request.n, fault(Stopped(f"{self._name}: {why}"))))
            raise
        except ServobusError as error:
            if turn is not None:
                for exchange in asked:
                    self._gate.carried_out(self._who, self._name, exchange, request.baud, error)
            self._tell(Failed(request.n, fault(error), self._counted(before, (), request.baud)))
        except Exception as error:  # noqa: BLE001 - a client must not end what serves the others
            log_failure(f"{self._name}: a request of {self._who.name} failed", error)
            self._tell(Failed(request.n, fault(error)))
        else:
            self._tell(answer)
        finally:
            self._leave(turn)

    async def _turn(self, request: SentRequest) -> Turn:
        """Have the line: as the procedure that has it already, or in turn with all others."""
        if request.hold and request.hold == self._number:
            if self._hold is None or self._hold.state is not TurnState.HOLDING:
                raise Stopped(f"{self._name}: this procedure has lost the line, for it said nothing for too long")
            return self._hold
        if request.hold and request.hold < self._number:
            raise Stopped(f"{self._name}: this procedure is over")
        self.release()
        turn = turn_for(Priority(request.priority))
        try:
            if not self.bus.line.try_acquire(turn):
                await self.bus.line.acquire_async(turn)
        except BaseException:
            self.bus.line.end(turn)
            raise
        if request.hold:
            self._hold, self._number = turn, request.hold
        return turn

    def _leave(self, turn: Turn | None) -> None:
        """End a turn that no procedure holds on to; count the time of one that does."""
        if turn is None:
            return
        if self._talking is turn:
            self._talking = None
        if turn is self._hold:
            self._lapse = asyncio.get_running_loop().call_later(LAPSE, self.release)
        else:
            self.bus.line.end(turn)

    async def _do(self, turn: Turn, step: Step, baud: int) -> Any:
        job: Any = step if isinstance(step, Exchange) else _one_step(step)
        return await self.bus.do_in_turn(turn, job, baud)

    def _answer(
        self, request: SentRequest, step: Step, came: Any, before: dict[tuple[str, int], Sequence[int]]
    ) -> Answer:
        lateness = None
        outcomes: list[Any] = []
        if isinstance(step, LateAnswers):
            assert isinstance(came, Lateness)
            servos = tuple(sorted((framing.name, id) for framing, id in came.servos))
            lateness = SentLateness(came.usual, servos, came.longest)
        elif isinstance(step, Batch | GroupExchange):
            outcomes = came
        elif isinstance(step, Exchange):
            outcomes = [came]
        echo = self.bus.echo if self.bus.echo is not self._echo else None
        self._echo = self.bus.echo
        return Answer(
            request.n,
            tuple(map(outcome_of, outcomes)),
            self._counted(before, outcomes, request.baud, step),
            lateness,
            echo,
        )

    def _note(self, asked: Sequence[Exchange[Any]], baud: int, step: Step, came: Any) -> None:
        outcomes = came if isinstance(step, Batch) else [came]
        for exchange, outcome in zip(asked, outcomes, strict=False):  # fewer, where the batch ended early
            self._gate.carried_out(self._who, self._name, exchange, baud, outcome)

    # What was counted

    def _counters(self, asked: Sequence[Exchange[Any]], baud: int) -> dict[tuple[str, int], Sequence[int]]:
        """Give the counters of the servos that are asked, and of what is counted for none of them."""
        counters: dict[tuple[str, int], Sequence[int]] = {}
        servo = self.bus.stats.servo
        for exchange in asked:
            name = exchange.framing.name
            parts = exchange.parts if isinstance(exchange, GroupExchange) else (exchange,)
            for id in (BROADCAST, *(part.id for part in parts)):
                if (name, id) not in counters:
                    counters[name, id] = _numbers(servo(name, id, baud))
        return counters

    def _counted(
        self, before: dict[tuple[str, int], Sequence[int]], outcomes: Sequence[Any], baud: int, step: Step | None = None
    ) -> tuple[Counted, ...]:
        """Tell what was counted beyond what the client counts by itself: a request, and a reply where one came."""
        expected: dict[tuple[str, int], list[int]] = {}
        parts = [] if step is None else _parts(step)
        for exchange, outcome in zip(parts, outcomes, strict=False):
            plain = expected.setdefault((exchange.framing.name, exchange.id), [0, 0])
            plain[0] += 1
            plain[1] += bool(exchange.replies) and isinstance(outcome, Packet)
        told = []
        for (name, id), old in before.items():
            counts = self.bus.stats.servo(name, id, baud)
            grown = tuple(new - was for new, was in zip(_numbers(counts), old, strict=True))
            sent, received, *rest = grown
            worse = counts.worst > self._worst.get((name, id), 0.0)
            if worse or any(rest) or [sent, received] != expected.get((name, id), [0, 0]):
                self._worst[name, id] = counts.worst
                told.append(Counted(name, id, grown, counts.worst))
        return tuple(told)


def _check(request: SentRequest) -> None:
    """Raise UsageError for what no bus can do."""
    if not 0 < request.baud <= FASTEST:
        raise UsageError(f"{request.baud} is not a speed in baud")
    if request.priority not in tuple(Priority):
        raise UsageError(f"there is no priority {request.priority}")


def _one_step(step: Step) -> Procedure[Any]:
    return (yield step)


def _parts(step: Step) -> Sequence[Exchange[Any]]:
    """Give the requests whose outcomes are told, in their order."""
    return step.parts if isinstance(step, GroupExchange) else exchanges_in(step)


def log_failure(what: str, error: Exception) -> None:
    """Tell the log of a fault of this program, which goes on."""
    import logging  # noqa: PLC0415 - seldom wanted

    logging.getLogger("servobus").error(what, exc_info=error)
