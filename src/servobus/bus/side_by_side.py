"""Jobs on several buses, carried out side by side by one thread, which waits for all of their ports at once.

A thread for each would spend more time on handing the interpreter over than on the answers.
"""

import select
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from time import monotonic
from typing import Any

from servobus.bus.blocking import Bus
from servobus.core.exchange import Job
from servobus.core.operation import Priority
from servobus.errors import PortError, ServobusError
from servobus.link.base import BaseLink
from servobus.link.blocking import SLICE, run_blocking
from servobus.link.ownership import turn_for
from servobus.link.waits import Receive, Rest, Waits

HIGHEST = 1024
"""Descriptors from here on are beyond what `select` takes (FD_SETSIZE of Linux and macOS)."""


class _Running:
    """A job on one bus, carried out wait by wait.

    over     whether it has ended, and `outcome` is its result or its ServobusError
    wait     what it waits for, until `due`, s of `time.monotonic`; on `descriptor` come the bytes
    """

    waits: Waits[Any]
    link: BaseLink
    wait: Receive | Rest

    def __init__(self, bus: Bus, job: Job[Any], priority: Priority) -> None:
        self.bus, self.job, self.priority = bus, job, priority
        self.turn = turn_for(priority)
        self.begun = self.over = False
        self.outcome: Any = None
        self.descriptor = -1
        self.due = 0.0

    def begin(self) -> bool:
        """Begin, and go on to the first wait; False where a thread must do it, which may wait for the line."""
        descriptor = self.bus.transport.fileno()
        if descriptor is None or descriptor >= HIGHEST or not self.bus.line.acquire(self.turn, 0.0):
            return False
        self.descriptor, self.link = descriptor, self.bus.link
        self.waits = self.link.run(self.job)
        self.begun = True
        self._go_on(None)
        return True

    def attend(self, *, ready: bool) -> None:
        """Go on if the wait is over: bytes are there, time is up, or a stop has taken the line over."""
        if not ready and monotonic() < self.due and not self.link.superseded:
            return
        heard = b""
        if type(self.wait) is Receive:
            try:
                heard = self.bus.transport.read(0.0)
            except PortError as error:
                self._go_on(error)
                return
        self._go_on(heard)

    def _go_on(self, what: bytes | PortError | None) -> None:
        try:
            if isinstance(what, PortError):
                self.wait = self.waits.throw(what)
            else:
                self.link.check()
                self.wait = self.waits.send(what)  # type: ignore[arg-type] # None begins it
            self.due = monotonic() + self.wait.seconds
        except StopIteration as stop:
            self._end(stop.value)
        except ServobusError as error:
            self._end(error)

    def _end(self, outcome: Any) -> None:
        self.outcome, self.over = outcome, True
        self.drop()

    def drop(self) -> None:
        """Break it off if it has not ended, and leave the line."""
        if self.begun:
            self.waits.close()
        self.bus.line.end(self.turn)

    def alone(self) -> Any:
        """Carry it out, or what is left of it, in this thread; give its result or its ServobusError."""
        try:
            if not self.begun:
                return self.bus.do(self.job, priority=self.priority)
            return run_blocking(self.link, self.waits, self.bus.line, self.turn, self.wait)
        except ServobusError as error:
            return error
        finally:
            self.bus.line.end(self.turn)


def run_side_by_side(
    jobs: Mapping[str, tuple[Bus, Job[Any]]],
    priority: Priority,
    in_thread: Callable[[Callable[[], Any]], "Future[Any]"],
) -> dict[str, Any]:
    """Carry out a job on each bus; give name -> its result, or the ServobusError that it raised.

    A thread of its own has a job that must wait for its line, at first or after a pause in which others may use the
    line, and one whose port has no descriptor. Whatever else is raised here breaks the other jobs of this thread off.
    """
    running = {name: _Running(bus, job, priority) for name, (bus, job) in jobs.items()}
    elsewhere: dict[str, Future[Any]] = {}
    here = dict(running)
    try:
        for name, run in running.items():
            if not run.begin():
                elsewhere[name] = in_thread(here.pop(name).alone)
        while True:
            for name, run in list(here.items()):
                if run.over:
                    del here[name]
                elif type(run.wait) is Rest and run.wait.shared:
                    run.bus.line.give_way(run.turn)  # at once: all threads may be waiting for this very line
                    elsewhere[name] = in_thread(here.pop(name).alone)
            if not here:
                break
            ready = _wait(list(here.values()))
            for run in here.values():
                run.attend(ready=run.descriptor in ready)
    finally:
        for run in here.values():
            run.drop()
    return {name: elsewhere[name].result() if name in elsewhere else run.outcome for name, run in running.items()}


def _wait(here: list[_Running]) -> list[int]:
    """Wait until a wait of one of them may be over; give the descriptors on which bytes are."""
    seconds = min([SLICE, *(run.due - monotonic() for run in here)])
    listening = [run.descriptor for run in here if type(run.wait) is Receive]
    try:
        return select.select(listening, (), (), max(seconds, 0.0))[0]
    except OSError:  # a port was closed meanwhile
        return [run.descriptor for run in here if run.bus.transport.fileno() != run.descriptor]
