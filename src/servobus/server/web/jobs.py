"""What takes longer than an answer may: scans, examinations, moves. Each has a state, can be watched and broken off."""

import asyncio
import itertools
import logging
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, Literal, TypeAlias

from servobus.errors import ServobusError, UnknownName, UsageError
from servobus.server.web.errors import TooMany, error_entry
from servobus.server.web.feeds import Events

MOST_RUNNING, KEPT = 16, 100
"""Jobs that run at once, and that are remembered after their end."""
ALONE = ("scan", "doctor")
"""Kinds of jobs of which one runs on a bus at a time."""
TELL = 0.1
"""s between two events that tell how far a job is."""

State: TypeAlias = Literal["running", "done", "failed", "cancelled"]


class ServerJob:
    """One job.

    done, total   how much of it is done, and how much there is; 0 of 0 where that is not known
    text          what it does now
    found         what it has found so far, and what came of it at the end
    """

    def __init__(self, id: str, kind: str, bus: str, by: str) -> None:
        self.id, self.kind, self.bus, self.by = id, kind, bus, by
        self.state: State = "running"
        self.done = self.total = 0
        self.text = ""
        self.found: list[Any] = []
        self.result: Any = None
        self.error: dict[str, Any] | None = None
        self.began = time.time()
        self.ended: float | None = None
        self.task: asyncio.Task[None] | None = None
        self.on_cancel: Callable[[], Awaitable[object]] | None = None
        """What has to be done when it is broken off, such as stopping what moves."""

    def entry(self) -> dict[str, Any]:
        """Give it for JSON."""
        return {
            "id": self.id,
            "kind": self.kind,
            "bus": self.bus,
            "by": self.by,
            "state": self.state,
            "done": self.done,
            "total": self.total,
            "text": self.text,
            "found": list(self.found),
            "result": self.result,
            "error": self.error,
            "began": round(self.began, 3),
            "ended": None if self.ended is None else round(self.ended, 3),
        }


class Jobs:
    """The jobs of the server, the newest last."""

    def __init__(self, events: Events) -> None:
        self._events = events
        self._jobs: OrderedDict[str, ServerJob] = OrderedDict()
        self._numbers = itertools.count(1)
        self._told: dict[str, float] = {}

    def __getitem__(self, id: str) -> ServerJob:
        """Give a job. Raises UnknownName."""
        if id not in self._jobs:
            raise UnknownName(f"no job {id[:40]!r} is known; jobs are forgotten some time after their end")
        return self._jobs[id]

    def entries(self) -> list[dict[str, Any]]:
        return [job.entry() for job in reversed(self._jobs.values())]

    def start(self, kind: str, bus: str, by: str, run: Callable[[ServerJob], Awaitable[Any]]) -> ServerJob:
        """Begin a job. Raises TooMany, and UsageError where one of those that have a port to themselves runs there."""
        running = [job for job in self._jobs.values() if job.state == "running"]
        if kind in ALONE and any((job.kind, job.bus) == (kind, bus) for job in running):
            raise UsageError(f"a {kind} of {bus} is running already: wait for it, or cancel it")
        if len(running) >= MOST_RUNNING:
            raise TooMany(f"{MOST_RUNNING} jobs are running already: wait for one of them, or cancel it")
        job = ServerJob(f"{next(self._numbers)}", kind, bus, by)
        self._jobs[job.id] = job
        for old in [one.id for one in self._jobs.values() if one.state != "running"][: max(0, len(self._jobs) - KEPT)]:
            del self._jobs[old]
        job.task = asyncio.ensure_future(self._run(job, run))
        job.task.add_done_callback(partial(self._ended, job))
        return job

    def progress(self, job: ServerJob, done: int, total: int, text: str) -> None:
        """Say how far a job is."""
        job.done, job.total, job.text = done, total, text
        now = time.monotonic()
        if now - self._told.get(job.id, 0.0) >= TELL:
            self._told[job.id] = now
            self._events.tell("progress", bus=job.bus, job=job.id, kind=job.kind, done=done, total=total, text=text)

    async def cancel(self, id: str) -> ServerJob:
        """Break a job off, and wait until it has ended. One that has ended stays as it is. Raises UnknownName."""
        job = self[id]
        if job.task is not None and not job.task.done():
            job.task.cancel()
            await asyncio.wait((job.task,))
            await asyncio.sleep(0)  # its end is noted then
            if job.on_cancel is not None:
                await job.on_cancel()
        return job

    def break_off(self, bus: str | None) -> None:
        """Break off what runs on a bus, or all, without waiting: a stop goes before everything."""
        for job in self._jobs.values():
            if job.task is not None and not job.task.done() and bus in (None, job.bus):
                job.task.cancel()

    async def close(self) -> None:
        """Break everything off."""
        self.break_off(None)
        tasks = [job.task for job in self._jobs.values() if job.task is not None]
        if tasks:
            await asyncio.wait(tasks)

    async def _run(self, job: ServerJob, run: Callable[[ServerJob], Awaitable[Any]]) -> None:
        try:
            job.result = await run(job)
        except ServobusError as error:
            job.error = error_entry(error)
        except Exception:
            logging.getLogger("servobus").exception("job %s has failed", job.kind)
            job.error = {
                "type": "InternalError",
                "message": "this job has failed by a fault of the server; see its log",
            }

    def _ended(self, job: ServerJob, task: asyncio.Task[None]) -> None:
        """Take note of the end, also of a job that was broken off before its first step."""
        job.state = "cancelled" if task.cancelled() else "failed" if job.error is not None else "done"
        job.ended = time.time()
        self._told.pop(job.id, None)
        self._events.tell("job", bus=job.bus, job=job.id, kind=job.kind, state=job.state)
