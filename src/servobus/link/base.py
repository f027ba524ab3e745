"""What a driver asks of a link, whether it has the port itself or another process owns it."""

from abc import ABC, abstractmethod
from typing import Any, Final, TypeVar

from servobus.core.exchange import Exchange, Job, Now, Pause, SetBaud, Step
from servobus.errors import ServobusError, Stopped
from servobus.link.stats import Stats
from servobus.link.waits import Waits
from servobus.transports.base import Transport

T = TypeVar("T")

NOT_FAST: Final = object()
"""What `try_fast_receive` gives where a longer look is needed."""


class BaseLink(ABC):
    """Carries out jobs on one port as generators of waits; the driver lets time pass.

    transport   what the driver waits on
    superseded  whether a stop for safety has taken the line over: then nothing is sent here any more
    echo        whether the adapter gives back what it sends; None as long as that is not known
    """

    transport: Transport
    superseded: bool
    echo: bool | None

    @property
    @abstractmethod
    def stats(self) -> Stats:
        """What happened on this line, in numbers."""

    def run(self, job: Job[T]) -> Waits[T]:
        """Carry out a job, at the speed in use now; each SetBaud step changes it for the rest of the job.

        What else uses the line meanwhile, in a shared pause or in a callback of the job, may leave it at another speed.
        """
        if isinstance(job, Exchange):
            return (yield from self.transact(job))
        baud = self.transport.baud
        try:
            step = next(job)
            while True:
                try:
                    if isinstance(step, SetBaud):
                        baud = step.baud
                    if not isinstance(step, Pause | Now):
                        yield from self.set_baud(baud)
                    result = yield from self._step(step)
                except ServobusError as error:  # a lost port too: what was begun can say how far it came
                    step = job.throw(error)
                else:
                    step = job.send(result)
        except StopIteration as stop:
            done: T = stop.value
            return done
        finally:
            job.close()

    def check(self) -> None:
        """Raise Stopped if a stop has taken the line over."""
        if self.superseded:
            raise Stopped("interrupted: the line was needed to make the servos safe")

    @abstractmethod
    def _step(self, step: Step) -> Waits[Any]:
        """Carry out one step of a job."""

    @abstractmethod
    def transact(self, exchange: Exchange[T], begun: bytes | None = None) -> Waits[T]:
        """Ask, and ask again where that is allowed. `begun` is what was heard if it is sent already."""

    @abstractmethod
    def set_baud(self, baud: int) -> Waits[None]:
        """Talk at this speed from now on."""

    @abstractmethod
    def supersede(self) -> "BaseLink":
        """Have the exchange under way fail with Stopped, and all later ones; give a link that has the line instead."""

    @abstractmethod
    def try_fast_send(self, exchange: Exchange[Any]) -> float:
        """Send at once if nothing stands against it; give the seconds to listen, or 0 if it takes the long way."""

    @abstractmethod
    def try_fast_receive(self, exchange: Exchange[T], chunk: bytes) -> T | object:
        """Give the result if what came is the reply and nothing else; NOT_FAST if it takes more than a look."""

    @abstractmethod
    def abandon(self) -> None:
        """Say that the wait for the reply to what `try_fast_send` sent has ended: the reply may still come."""
