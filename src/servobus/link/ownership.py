"""What may talk on a line: one turn at a time, and the most urgent of those that wait comes next.

Threads, tasks of an event loop and a stop for safety share one port. Two requests that overlap on the wire spoil each
other's answers, so whatever talks needs a `Turn` first:

    turn = turn_for(Priority.READ)
    try:
        line.acquire(turn)              # or: await line.acquire_async(turn)
        ...                             # talk
        line.give_way(turn)             # a pause in which others may talk
        line.acquire(turn)              # take the line back
    finally:
        line.end(turn)

A turn is in one of four states:

    state     meaning                     acquire           give_way  end    handed over  taken over
    IDLE      has not asked, or gave way  HOLDING, WAITING  -         ENDED  -            -
    WAITING   another turn holds          -                 -         ENDED  HOLDING      -
    HOLDING   may talk                    HOLDING           IDLE      ENDED  -            ENDED
    ENDED     is over, or lost the line   Stopped           -         ENDED  -            -

`end` is right in every state and as often as it is called. So a caller that is cancelled or interrupted anywhere, even
while it waits to take the line back, neither keeps the line nor gives away one that another turn holds.

A line that becomes free is handed to the next turn in the same step. It is never free in between, so that a newcomer
cannot overtake a more urgent turn that waits.
"""

import threading
from collections.abc import Callable
from enum import Enum
from threading import get_ident

from servobus.core.operation import Priority
from servobus.errors import Stopped

AGEING = 8
"""Hand-overs after which a waiting turn counts as one step more urgent: else busy readers would keep a scan waiting for
ever. Assumption: so a scan beside them gets about a tenth of the line."""


class TurnState(Enum):
    """Where a turn stands; see the table at the head of this module."""

    IDLE = "idle"
    WAITING = "waiting"
    HOLDING = "holding"
    ENDED = "ended"


IDLE, WAITING, HOLDING, ENDED = TurnState


class Turn:
    """One claim to a line.

    priority   how urgent it is; of two equally urgent turns the one that asked first comes first
    state      where it stands
    nested     whether its thread held the line already: then that turn keeps the line when this one ends
    overtaken  hand-overs for which it has waited
    thread     thread that holds the line with this turn; 0 for a task, which shares its thread with other tasks
    """

    # Defaults of the class and no `__init__`: a turn is made for every read, and most never need another value.
    priority = Priority.READ
    state = IDLE
    nested = False
    overtaken = 0
    thread = 0
    _wake: Callable[[], bool] | None = None
    """Tells the waiting side that it has the line now; False if there is no such side any more."""

    def __repr__(self) -> str:
        return f"<turn for {self.priority.name}: {self.state.value}>"


def turn_for(priority: Priority) -> Turn:
    """Make a turn of this priority."""
    turn = Turn()
    turn.priority = priority
    return turn


class LineOwnership:
    """Decides which turn may talk. Its methods may be called from any thread, and may be broken off anywhere."""

    def __init__(self) -> None:
        self._mutex = threading.Lock()
        """Guards the two below. Nothing waits while it has the mutex."""
        self._holder: Turn | None = None
        self._waiting: list[Turn] = []
        """In the order in which they asked."""

    def __repr__(self) -> str:
        return f"<line: {self._holder or 'free'}, {len(self._waiting)} waiting>"

    @property
    def holder(self) -> Turn | None:
        """The turn that may talk now."""
        return self._holder

    def priority(self) -> Priority:
        """Tell how urgent the job is that has the line."""
        holder = self._holder
        return Priority.READ if holder is None else holder.priority

    @property
    def contended(self) -> bool:
        """Whether a turn waits for the line: a long job should give way soon."""
        return bool(self._waiting)

    def try_acquire(self, turn: Turn) -> bool:
        """Take the line if it is free and nothing waits for it; tell whether the turn has it."""
        with self._mutex:
            if self._holder is not None or self._waiting or turn.state is not IDLE:
                return False
            self._holder, turn.state = turn, HOLDING
            return True

    # The blocking face

    def acquire(self, turn: Turn, timeout: float | None = None) -> bool:
        """Wait until the turn has the line; tell whether it has, after `timeout` s at most.

        A thread that has the line already goes on with it: a callback of a job may use the bus. Raises Stopped if the
        line was taken from this turn.
        """
        turn.thread = get_ident()
        with self._mutex:  # as `try_acquire`, without a call: this is the way of every read
            if self._holder is None and not self._waiting and turn.state is IDLE:
                self._holder, turn.state = turn, HOLDING
                return True
        if self._nested(turn):
            return True
        granted = threading.Event()

        def wake() -> bool:
            granted.set()
            return True

        if self._ask(turn, wake):
            return True
        try:
            while granted.wait(timeout) and not self._holds(turn):
                granted.clear()  # the hand-over was broken off, and will be repeated
        finally:
            held = self._holds_or_withdraws(turn)
        return held

    # The asynchronous face

    async def acquire_async(self, turn: Turn) -> None:
        """Wait until the turn has the line, without holding the event loop. Raises Stopped; see `acquire`."""
        if self.try_acquire(turn):
            return
        import asyncio  # noqa: PLC0415 - slow to import; whatever awaits has imported it already

        loop, me = asyncio.get_running_loop(), get_ident()
        granted = asyncio.Event()

        def wake() -> bool:
            try:
                if get_ident() == me:
                    granted.set()
                else:
                    loop.call_soon_threadsafe(granted.set)
            except RuntimeError:  # the loop is closed: its tasks are gone, and this one will never end its turn
                return False
            return True

        if not self._ask(turn, wake):
            try:
                while not self._holds(turn):
                    await granted.wait()
                    granted.clear()  # where the hand-over was broken off it will be repeated
            finally:
                self._holds_or_withdraws(turn)

    # Both

    def give_way(self, turn: Turn) -> None:
        """Let others talk until the turn acquires the line again. A nested turn keeps it: the outer job goes on."""
        if not turn.nested:
            self._leave(turn, IDLE)

    def end(self, turn: Turn) -> None:
        """End a turn, whatever its state."""
        try:
            with self._mutex:
                if self._holder is turn and not self._waiting:
                    self._holder, turn.state = None, ENDED
                    return
            self._leave(turn, ENDED)
        except BaseException:
            self._leave(turn, ENDED)  # Ctrl-C came in the middle: what is done twice does no harm
            raise

    def take_over(self, turn: Turn, interrupt: Callable[[], object], polite: float, firm: float) -> None:
        """Give a turn the line for a stop, whatever holds it, within `polite` + `firm` s.

        After `polite` s `interrupt` is called, which makes the job that has the line fail at its next step. If that
        job is stuck, its turn is ended without it: it must not send anything more once `interrupt` was called.
        """
        if polite > 0 and self.acquire(turn, polite):
            return
        interrupt()
        if firm > 0 and self.acquire(turn, firm):
            return
        with self._mutex:
            lost, self._holder = self._holder, turn
            if turn in self._waiting:
                self._waiting.remove(turn)
            turn.state = HOLDING
            if lost is not None and lost is not turn:
                lost.state = ENDED

    # The steps: each leaves everything right, and may be repeated

    def _ask(self, turn: Turn, wake: Callable[[], bool]) -> bool:
        """Wait in line; tell whether the turn has the line at once."""
        with self._mutex:
            if turn.state is ENDED:
                raise Stopped("interrupted: the line was needed to make the servos safe")
            if turn.state is HOLDING:
                return True
            turn._wake, turn.state = wake, WAITING
            self._waiting.append(turn)
            self._hand_over()
            return turn.state is HOLDING

    def _nested(self, turn: Turn) -> bool:
        """Let a turn talk whose thread has the line already."""
        with self._mutex:
            outer = self._holder
            if outer is None or outer is turn or outer.thread != turn.thread or turn.state is ENDED:
                return False
            turn.nested, turn.state = True, HOLDING
            return True

    def _holds(self, turn: Turn) -> bool:
        with self._mutex:
            return turn.state is HOLDING

    def _holds_or_withdraws(self, turn: Turn) -> bool:
        with self._mutex:
            if turn.state is WAITING:
                self._waiting.remove(turn)
                turn.state = IDLE
            return turn.state is HOLDING

    def _leave(self, turn: Turn, state: TurnState) -> None:
        with self._mutex:
            if turn.state is not ENDED:
                turn.state = state
            if turn in self._waiting:
                self._waiting.remove(turn)
            if self._holder is turn:
                self._holder = None
            if self._waiting:
                self._hand_over()

    def _hand_over(self) -> None:
        """Give a free line to the next turn. One that cannot be woken is passed over.

        It is woken first and looks at its state when the mutex is free: if Ctrl-C comes in between, it waits on, and
        the repetition of this step wakes it again.
        """
        while self._holder is None and self._waiting:
            turn = min(self._waiting, key=_urgency)
            for other in self._waiting:
                other.overtaken += 1
            if turn._wake is None or turn._wake():
                self._holder, turn.state = turn, HOLDING
            else:
                turn.state = ENDED
            self._waiting.remove(turn)


def _urgency(turn: Turn) -> int:
    """Give how urgent a turn is now: one that waited long counts as more urgent, but never as a stop."""
    return max(turn.priority - turn.overtaken // AGEING, min(turn.priority, Priority.MOTION))
