"""A lock on a file, which the system releases when the process ends, however the process ends."""

import os
import sys
from contextlib import suppress
from pathlib import Path

if sys.platform != "win32":
    import fcntl


def open_locked(path: Path, flags: int) -> int:
    """Open a file and lock it; give its handle, whose closing releases the lock.

    Others may remove the file or put another in its place at any time: the lock is on what bears the name at the end.
    Where the file system has no locks, and on Windows, nothing is locked. Raises BlockingIOError if the file is locked
    already, by this process too, else OSError.
    """
    while True:
        handle = os.open(path, flags, 0o666)
        try:
            lock(handle)
            if is_at(handle, path):
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def lock(handle: int) -> None:
    """Lock an open file. Raises BlockingIOError if it is locked already."""
    if sys.platform != "win32":
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:
            pass  # a file system without locks


def is_at(handle: int, path: Path) -> bool:
    """Tell whether an open file is the one that bears this name now."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(handle), path.stat())
    return False
