"""Blocking work in a thread beside an event loop, which no cancellation ends halfway."""

import asyncio
import threading
from collections.abc import Awaitable, Callable, Generator
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, TypeVar

T = TypeVar("T")


class Done(Awaitable[T]):
    """An awaitable of something that is done already."""

    def __init__(self, result: T) -> None:
        self._result = result

    def __await__(self) -> Generator[Any, None, T]:
        yield from ()
        return self._result


def begin_in_thread(work: Callable[[], T]) -> Future[T]:
    """Begin work at once, in a thread of its own."""
    job: Future[T] = Future()

    def run() -> None:
        try:
            job.set_result(work())
        except BaseException as error:  # noqa: BLE001 - it is raised where the work is waited for
            job.set_exception(error)

    threading.Thread(target=run, name="servobus stop").start()
    return job


def awaited(job: Future[T], loop: asyncio.AbstractEventLoop) -> asyncio.Future[T]:
    """Give what a loop can wait for of a job in another thread; the job goes on whatever becomes of the loop."""
    done: asyncio.Future[T] = loop.create_future()

    def tell() -> None:
        if done.done():
            return
        error = job.exception()
        if error is not None:
            done.set_exception(error)
        else:
            done.set_result(job.result())

    def told(_: Future[T]) -> None:
        with suppress(RuntimeError):  # the loop may be closed by now
            loop.call_soon_threadsafe(tell)

    job.add_done_callback(told)
    return done


async def to_its_end(work: Awaitable[T]) -> T:
    """Wait for work that must be finished: a cancellation is raised when it is."""
    if not isinstance(work, asyncio.Future):
        return await work
    cancelled: asyncio.CancelledError | None = None
    while not work.done():
        try:
            await asyncio.wait({work})
        except asyncio.CancelledError as error:
            cancelled = error
    if cancelled is not None:
        raise cancelled
    done: T = work.result()
    return done


def running_loop() -> asyncio.AbstractEventLoop | None:
    """Give the event loop that runs in this thread; None if none does."""
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None
