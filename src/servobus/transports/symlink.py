"""A symbolic link that a running program owns.

Whether a link is still served cannot be seen by its target: the numbers of pseudo terminals are used
again, so that the link of a crashed program may point to somebody's shell. So whoever serves LINK holds a
lock on the file .LINK.lock beside it. The system releases the lock when the program ends, however it ends;
a lock file that is there but not locked says that the link beside it was left behind. A link without one
is not ours, and is only replaced if it points nowhere.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from servobus.errors import PortError

if sys.platform != "win32":
    import fcntl


@contextmanager
def claimed(link: Path, target: str) -> Iterator[None]:
    """Have a link that points to target, and take it away at the end. Raises PortError."""
    lock = link.with_name(f".{link.name}.lock")
    try:
        handle, left_behind = _lock(lock, link)
    except PortError:
        raise
    except OSError as error:
        raise _refused(link, error) from error
    try:
        _check(link, left_behind)
        _point(link, target)
        try:
            yield
        finally:
            with suppress(OSError):  # somebody may have been faster
                if str(link.readlink()) == target:
                    link.unlink()
    finally:
        with suppress(OSError):
            lock.unlink()
        os.close(handle)


def _lock(lock: Path, link: Path) -> tuple[int, bool]:
    """Lock the lock file; give its handle, and whether a program that crashed had left it."""
    if sys.platform == "win32":
        raise PortError("there are no links to pseudo terminals on Windows; use --tcp")
    while True:
        left_behind = lock.exists()
        handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(handle, 20).decode(errors="replace").strip()
            os.close(handle)
            raise PortError(f"{link} is served by another program (process {owner or 'unknown'})") from None
        # Its last owner may have removed the file between the two steps; then this lock means nothing.
        with suppress(FileNotFoundError):
            if os.fstat(handle).st_ino == lock.stat().st_ino:
                os.ftruncate(handle, 0)
                os.write(handle, b"%d\n" % os.getpid())
                return handle, left_behind
        os.close(handle)


def _check(link: Path, left_behind: bool) -> None:
    """Raise PortError unless there is no link, or one that may be replaced."""
    if link.is_symlink():
        if link.exists() and not left_behind:
            raise PortError(f"{link} points to {link.readlink()} and was not made by servobus; remove it first")
    elif link.exists():
        raise PortError(f"{link} exists and is no link; it is not touched")


def _point(link: Path, target: str) -> None:
    temporary = link.with_name(f".{link.name}.{os.getpid()}")
    try:
        temporary.symlink_to(target)
        temporary.replace(link)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink()
        raise _refused(link, error) from error


def _refused(link: Path, error: OSError) -> PortError:
    return PortError(f"{link} cannot be made: {error.strerror or error}")
