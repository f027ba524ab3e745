"""How long a thread has waited for a processor.

On a busy computer a thread whose bytes have come may run some milliseconds later. Linux counts that time for each
thread, in ns: the second number of /proc/thread-self/schedstat (proc_pid_schedstat(5), scheduler statistics).
"""

import os
from contextlib import suppress
from typing import Self

COUNTS = "/proc/thread-self/schedstat"


class RunQueue:
    """The waiting time of the thread that opens this by `with`; always 0 where the system does not count it."""

    def __init__(self) -> None:
        self._file = -1

    def __enter__(self) -> Self:
        with suppress(OSError):
            self._file = os.open(COUNTS, os.O_RDONLY)
        return self

    def __exit__(self, *_: object) -> None:
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def waited(self) -> float:
        """Give for how long in all, in s, the thread could have run and did not."""
        if self._file < 0:
            return 0.0
        return int(os.pread(self._file, 64, 0).split()[1]) * 1e-9
