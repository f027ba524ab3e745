"""A deadman: it acts when it is not fed, for none of these servos has a watchdog of its own.

A thread of its own counts the time, so that it acts even while the program is stuck.
"""

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from servobus.errors import BadValue, Stopped

_CLOCK = getattr(time, "CLOCK_BOOTTIME", None)


def awake() -> float:
    """Give seconds that never go back, and go on while the computer sleeps where the system counts that."""
    return time.monotonic() if _CLOCK is None else time.clock_gettime(_CLOCK)


class Watchdog:
    """Runs `act` once if it is not fed for `timeout` s while something is `driven`; see `Bus.watch`.

    `tripped` tells that it came to that. Then `check` raises Stopped until `reset` or `stop`. Threads may share it.
    """

    def __init__(
        self,
        timeout: float,
        act: Callable[[], object],
        driven: Callable[[], bool],
        *,
        ended: Callable[[], object],
        clock: Callable[[], float] = awake,
    ) -> None:
        if not 0 < timeout <= threading.TIMEOUT_MAX:
            raise BadValue(f"timeout {timeout} of a watch is not a number of seconds above 0")
        self.timeout = timeout
        self._act, self._driven, self._ended, self._clock = act, driven, ended, clock
        self._fed = clock()
        self._tripped = self._over = False
        self._acted = threading.Event()
        self._trips = 0
        """Trips so far and resets between them: an act that was begun before a reset is not that of the next trip."""
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="servobus watch", daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        if self._over:
            state = "ended"
        elif self._tripped:
            state = "tripped, nothing moves before reset() or stop()"
        elif not self._driven():
            state = "nothing is in motion"
        else:
            state = f"fed {max(self._clock() - self._fed, 0):.3f} s ago"
        return f"<watch of {self.timeout:g} s: {state}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    @property
    def tripped(self) -> bool:
        """Whether it was not fed in time."""
        return self._tripped

    def feed(self) -> None:
        """Say that the program is alive. Raises Stopped if that comes too late; commands of motion feed it too."""
        self.check()
        self._fed = self._clock()

    def check(self) -> None:
        """Raise Stopped if it has tripped, or should have by now."""
        # After SIGSTOP the program may be here before the thread has seen how late it is.
        if not self._tripped and self._late() > 0:
            self._trip()
        if self._tripped:
            raise Stopped(
                f"the watch was not fed for {self.timeout:g} s, so the servos were made safe; "
                "nothing moves before reset() or stop() of the watch"
            )

    def reset(self) -> None:
        """Allow motion again after it has tripped, and begin to count anew."""
        with self._changed:
            self._fed, self._tripped = self._clock(), False
            self._acted.clear()
            self._trips += 1
            self._changed.notify()

    def stop(self) -> None:
        """End the watch. If it has tripped, motion is allowed again."""
        with self._changed:
            if self._over:
                return
            self._over = True
            self._changed.notify()
        if self._thread is not threading.current_thread():
            self._thread.join()
        self._ended()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it has tripped and done what it does then; tell whether it has."""
        return self._acted.wait(timeout)

    # The thread

    def _run(self) -> None:
        while (trip := self._wait_for_trip()) is not None:
            self._act()
            with self._changed:
                if trip == self._trips:
                    self._acted.set()

    def _wait_for_trip(self) -> int | None:
        """Wait until it is time to act; give the number of the trip, or None at the end of the watch."""
        with self._changed:
            while not self._over:
                if self._tripped and not self._acted.is_set():
                    return self._trips
                late = self._late()
                if not self._tripped and late > 0:
                    self._tripped = True
                else:
                    self._changed.wait(self.timeout if self._tripped or late == 0 else -late)
            return None

    def _trip(self) -> None:
        with self._changed:
            self._tripped = True
            self._changed.notify()

    def _late(self) -> float:
        """Give how many seconds it is too late by; below 0 that many are left, 0 while there is nothing to guard."""
        return self._clock() - self._fed - self.timeout if self._driven() else 0.0
