"""How a task of an event loop waits for the bytes of a port, without holding the loop up."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from servobus.errors import PortError
from servobus.transports.base import Transport
from servobus.transports.shared_reader import SharedReader


class LoopReader:
    """Reads one port for the tasks of an event loop, one task at a time.

    A port with a descriptor is watched by the loop, one without is a `SharedReader`, which a thread reads. A port on a
    virtual clock is read at once.

    port             the port
    thread_has_line  tells whether a thread beside the loop uses the port
    """

    def __init__(self, port: Transport, thread_has_line: Callable[[], bool]) -> None:
        self._port, self._thread_has_line = port, thread_has_line
        self._waiter: asyncio.Future[bytes] | None = None
        """The task that waits for bytes."""
        self._listening: tuple[asyncio.AbstractEventLoop, int] | None = None
        """The loop that tells when the port's descriptor is readable."""
        self._thread: ThreadPoolExecutor | None = None
        """The thread that reads a port without a descriptor."""
        self._read_under_way: asyncio.Future[None] | None = None

    async def read(self, timeout: float) -> bytes:  # noqa: ASYNC109 - the transport's clock
        """Wait for bytes; see `Transport.read`."""
        port = self._port
        if not port.blocking():
            return port.read(timeout)
        if isinstance(port, SharedReader):
            return await self._read_in_thread(port, timeout)
        fd = port.fileno()
        if fd is None:
            return port.read(0)  # it was closed, and says so
        loop = asyncio.get_running_loop()
        if self._listening != (loop, fd):
            loop.add_reader(fd, self._readable, loop, fd)
            self._listening = loop, fd
        waiter: asyncio.Future[bytes] = loop.create_future()
        self._waiter = waiter
        timer = loop.call_later(timeout, _end, waiter)
        try:
            return await waiter
        finally:
            timer.cancel()
            self._waiter = None

    def close(self) -> None:
        """Watch the descriptor no more, and begin no read any more. A read under way in a thread ends by itself."""
        if self._listening is not None:
            loop, fd = self._listening
            self._listening = None
            if not loop.is_closed():
                loop.remove_reader(fd)
        if self._thread is not None:
            self._thread.shutdown(wait=False)
            self._thread = None

    async def _read_in_thread(self, port: SharedReader, timeout: float) -> bytes:  # noqa: ASYNC109 - the transport's clock
        """Wait for what the one thread hears that reads. If this task is cancelled, the next finds it."""
        loop = asyncio.get_running_loop()
        end = loop.time() + timeout
        while not (heard := port.take()):
            left = max(end - loop.time(), 0.0)
            reading = self._read_under_way
            if reading is None or reading.get_loop() is not loop:
                if self._thread is None:
                    self._thread = ThreadPoolExecutor(1, "servobus reader")
                reading = self._read_under_way = loop.run_in_executor(self._thread, port.fill, left)
            done, _ = await asyncio.wait({reading}, timeout=left)
            if done:
                self._read_under_way = None
                reading.result()
            if loop.time() >= end:
                return port.take()
        return heard

    def _readable(self, loop: asyncio.AbstractEventLoop, fd: int) -> None:
        """Give bytes to the task that waits for them. If none does, stop listening: the loop would turn and turn.

        While a thread has the line, it reads by itself, to make the servos safe: what comes is for that thread, not for
        the task it interrupted. A task that stops a servo holds the line as any other task does.
        """
        waiter = self._waiter
        if waiter is None or waiter.done() or self._thread_has_line():
            loop.remove_reader(fd)
            self._listening = None
            if waiter is not None:
                _end(waiter)
            return
        try:
            waiter.set_result(self._port.read(0))
        except PortError as error:
            waiter.set_exception(error)


def _end(waiter: asyncio.Future[bytes]) -> None:
    if not waiter.done():
        waiter.set_result(b"")
