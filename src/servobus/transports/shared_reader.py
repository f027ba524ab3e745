"""A port without a descriptor, for an event loop: its reads happen in a thread, one at a time.

No thread that reads can be cancelled. If the task that wanted the bytes is, the read goes on, and takes what was meant
for the next question. So what such a read hears is kept, and the next one begins with it.
"""

import threading

from servobus.transports.base import Transport


class SharedReader(Transport):
    """Another transport whose reads may come from several threads; everything else is passed on."""

    def __init__(self, inner: Transport) -> None:
        self._inner = inner
        self.name, self.timed = inner.name, inner.timed
        self._reading = threading.Lock()
        """Held while a thread reads."""
        self._kept = b""
        """Bytes whose reader was given up."""

    @property
    def baud(self) -> int:  # type: ignore[override] # that of the port
        return self._inner.baud

    @property
    def has_speed(self) -> bool:  # type: ignore[override] # that of the port
        return self._inner.has_speed

    @property
    def latency(self) -> float:  # type: ignore[override] # that of the port
        return self._inner.latency

    @property
    def lasting_name(self) -> str:
        return self._inner.lasting_name

    def write(self, data: bytes) -> None:
        self._inner.write(data)

    def read(self, timeout: float) -> bytes:
        """See `Transport.read`. A read that another thread has begun comes first: its end is waited for."""
        self.fill(timeout)
        return self.take()

    def fill(self, timeout: float) -> None:
        """Read in this thread, and keep what comes for whatever reads next."""
        if not self._reading.acquire(timeout=timeout + 1.0):
            return  # the port is stuck; its own error is told to the thread that waits for it
        try:
            if not self._kept:
                self._kept += self._inner.read(timeout)
        finally:
            self._reading.release()

    def take(self) -> bytes:
        """Give what was kept, without waiting."""
        kept, self._kept = self._kept, b""
        return kept

    def discard(self) -> bytes:
        """See `Transport.discard`. What a read still under way will hear is not among it."""
        dropped = self.take()
        if self._reading.acquire(blocking=False):
            try:
                dropped += self._inner.discard()
            finally:
                self._reading.release()
        return dropped

    def set_baud(self, baud: int) -> None:
        self._inner.set_baud(baud)

    def close(self) -> None:
        self._inner.close()

    def reopen(self) -> None:
        self._inner.reopen()
        self.take()

    def pending(self) -> bool:
        return bool(self._kept) or self._inner.pending()

    def blocking(self) -> bool:
        return self._inner.blocking()

    def now(self) -> float:
        return self._inner.now()

    def sleep(self, seconds: float) -> None:
        self._inner.sleep(seconds)
