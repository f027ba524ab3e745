"""Files that several programs write: a lock that ends with the process, however it ends, and writing in one step."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

if sys.platform != "win32":
    import fcntl

PATIENCE = 2.0
"""s for which a program waits for another one that writes the same file."""


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


@contextmanager
def locked_beside(path: Path) -> Iterator[None]:
    """Keep other programs that ask for the same from writing a file; the lock is on a file of its own beside it.

    Raises BlockingIOError if another program keeps the lock for PATIENCE, else OSError.
    """
    lock_file = path.with_name(f".{path.name}.lock")
    handle = _open_patiently(lock_file)
    try:
        yield
    finally:
        with suppress(OSError):
            lock_file.unlink()  # others that wait for it see that it is gone, and make it anew
        os.close(handle)


def _open_patiently(path: Path) -> int:
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return open_locked(path, os.O_RDWR | os.O_CREAT)
        except BlockingIOError:
            if time.monotonic() > end:
                raise
            time.sleep(0.01)


def replace_text(path: Path, text: str) -> None:
    """Put another text in the place of a file in one step that survives a crash. Only who has the lock does this.

    The text is written as it is; a file that was there keeps its permissions.
    """
    new = path.with_name(f".{path.name}.new")
    with new.open("w", encoding="utf-8", newline="") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    with suppress(FileNotFoundError):
        new.chmod(path.stat().st_mode)
    new.replace(path)
