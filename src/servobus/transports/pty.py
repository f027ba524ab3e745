"""A pseudo terminal, which a program opens like a serial port, and a symbolic link with a name of your choice to it.

Virtual servos are served on one, and `servobus sniff --app` stands between an application and a real port with one.

Whether a link is still served cannot be seen by its target: the numbers of pseudo terminals are used again, so that
the link of a crashed program may point to the shell of another user. So the process that serves LINK holds a lock on
the file .LINK.lock beside it. The system releases the lock when the process ends, however it ends; a lock file that is
there but not locked says that the link beside it was left behind. A link without one was not made by servobus, and is
only replaced if it points nowhere.
"""

import errno
import os
import select
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Self

from servobus.errors import PortError
from servobus.transports.file_lock import open_locked

if sys.platform != "win32":
    import fcntl
    import termios
    import tty

LOOK_PERIOD = 0.005
"""s between two looks whether a client has opened the terminal: until then it cannot be waited for."""
CHUNK = 4096


class PseudoTerminal:
    """A pseudo terminal for one client at a time. Opened by `with`.

    name   what the client opens: the link if there is one, else the terminal itself
    baud   speed in bit/s that a client finds, until it sets another one

    `read` and `write` pass bytes at once, as they are. Opening raises PortError where there are no pseudo terminals,
    and for a link that belongs to another program.
    """

    name: str

    def __init__(self, baud: int, link: Path | None = None) -> None:
        self._link = link
        self._master = -1
        self._has_client = False
        self._first_baud = baud
        self._last_baud: float = baud
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._open(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def has_client(self) -> bool:
        """Whether a client has the terminal open, as far as the last `read` could tell."""
        return self._has_client

    def fileno(self) -> int:
        """Give a descriptor that turns readable when the client sends; it is always readable without a client."""
        return self._master

    def read(self, timeout: float = 0.0) -> bytes:
        """Wait up to `timeout` s for bytes of the client; empty if none came or there is no client."""
        if not select.select([self._master], [], [], timeout)[0]:
            self._has_client = True  # without one, the terminal is readable at once
            return b""
        try:
            data = os.read(self._master, CHUNK)
        except BlockingIOError:
            return b""  # the client took back what it had written (tcflush)
        except OSError as error:
            if error.errno != errno.EIO:
                raise PortError(f"{self.name}: {error.strerror or error}") from error
            data = b""
        if data:
            self._has_client = True
            return data
        if self._has_client:
            self._has_client = False
            self._drop_unread()
        time.sleep(min(timeout, LOOK_PERIOD))
        return b""

    def write(self, data: bytes) -> None:
        """Give bytes to the client; they are lost if there is none, or if it does not read. Never waits."""
        if not self._has_client:
            return
        try:
            os.write(self._master, data)
        except BlockingIOError:
            pass  # the client reads nothing: a real port's buffer overruns too
        except OSError as error:
            if error.errno != errno.EIO:
                raise PortError(f"{self.name}: {error.strerror or error}") from error

    def baud(self) -> float:
        """Give the speed that the client set last, bit/s."""
        baud = _terminal_baud(self._master)
        if baud:  # 0 means hang up
            self._last_baud = baud
        return self._last_baud

    def _open(self, stack: ExitStack) -> None:
        if sys.platform == "win32":
            raise PortError("there are no pseudo terminals on Windows; use --tcp")
        try:
            self._master, slave = os.openpty()
        except OSError as error:
            raise PortError(f"no pseudo terminal: {error.strerror or error}; use --tcp") from error
        self._has_client = False
        stack.callback(os.close, self._master)
        stack.callback(os.close, slave) if not _TELLS_LEAVING else None
        os.set_blocking(self._master, False)
        self._terminal = self.name = os.ttyname(slave)
        self._prepare(slave)
        if _TELLS_LEAVING:
            os.close(slave)
        if self._link is not None:
            stack.enter_context(owned_symlink(self._link, self._terminal))
            self.name = str(self._link)

    def _prepare(self, slave: int) -> None:
        """Pass bytes as they are, at the first speed for clients that set none."""
        if sys.platform != "win32":
            tty.setraw(slave)  # no echo, no line ends, no signals
            settings = termios.tcgetattr(slave)
            settings[4] = settings[5] = getattr(termios, f"B{self._first_baud}", settings[4])
            termios.tcsetattr(slave, termios.TCSANOW, settings)

    def _drop_unread(self) -> None:
        """Drop what a client that has left did not read.

        Its settings stay, as on a real port. The next client may be there already: it has been sent nothing yet, but
        what it has sent or set must not be touched.
        """
        if sys.platform != "win32":
            slave = os.open(self._terminal, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                termios.tcflush(slave, termios.TCIFLUSH)
            finally:
                os.close(slave)


_TELLS_LEAVING = sys.platform == "linux"
"""Whether reading fails while no client has the terminal open, and the settings outlive the clients.

Elsewhere the terminal would go back to its cooked state with each client that leaves, so it is held open.
"""

_TCGETS2 = 0x802C542A
"""Linux ioctl (asm-generic/termbits.h): the settings with the speeds as plain numbers, any speed."""
_TERMIOS2_SIZE = 44


def _terminal_baud(terminal: int) -> float:
    """Read the speed set on a terminal; 0 if there is none."""
    if sys.platform == "win32":
        return 0.0
    if sys.platform == "linux":
        settings = bytearray(_TERMIOS2_SIZE)
        try:
            fcntl.ioctl(terminal, _TCGETS2, settings)
        except OSError:
            pass  # an architecture with another number: the standard speeds must do
        else:
            return float(int.from_bytes(settings[-4:], sys.byteorder))
    speed = termios.tcgetattr(terminal)[5]
    for name in dir(termios):
        if name[:1] == "B" and name[1:].isdigit() and getattr(termios, name) == speed:
            return float(name[1:])
    return 0.0


# The link


@contextmanager
def owned_symlink(link: Path, target: str) -> Iterator[None]:
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
            with suppress(OSError):  # another program may have removed it first
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
    left_behind = lock.exists()
    try:
        handle = open_locked(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW)
    except BlockingIOError:
        owner = lock.read_text(errors="replace").strip() if lock.exists() else ""
        raise PortError(f"{link} is served by another program (process {owner or 'unknown'})") from None
    os.ftruncate(handle, 0)
    os.write(handle, b"%d\n" % os.getpid())
    return handle, left_behind


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
