"""Single keys of a terminal, as they are pressed."""

import os
import sys
import time
from types import TracebackType
from typing import Any, Self

SPACE, ESCAPE = " ", "\x1b"


class Keys:
    """Gives the keys that were pressed, in a `with`; none where no terminal is. Ctrl-C stays what it is.

    there   whether there is a terminal to press keys on
    """

    def __init__(self) -> None:
        self.there = _is_ours()
        self._before: Any = None

    def __enter__(self) -> Self:
        if self.there and sys.platform != "win32":
            import termios  # noqa: PLC0415 - Windows has none
            import tty  # noqa: PLC0415

            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._before is not None and sys.platform != "win32":
            import contextlib  # noqa: PLC0415
            import termios  # noqa: PLC0415 - see above

            with contextlib.suppress(termios.error, OSError):  # a terminal that is gone
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def pressed(self) -> str:
        """Give the keys pressed since it was asked last; "" for none. Never waits."""
        return self.wait(0.0)

    def wait(self, seconds: float) -> str:
        """Give the keys pressed since it was asked last, or the next one; "" if none comes within so many s."""
        if not self.there:
            return ""
        if sys.platform == "win32":
            import msvcrt  # noqa: PLC0415 - only Windows has it

            keys, end = "", time.monotonic() + seconds
            while not msvcrt.kbhit() and time.monotonic() < end:
                time.sleep(0.005)
            while msvcrt.kbhit():
                keys += msvcrt.getwch()
            return keys
        import select  # noqa: PLC0415 - only terminals need it

        try:
            if not select.select([sys.stdin], [], [], seconds)[0]:
                return ""
            data = os.read(sys.stdin.fileno(), 1024)
        except OSError:
            data = b""
        if not data:
            self.there = False  # the terminal is gone
        keys = data.decode(errors="replace")
        return "" if keys.startswith(ESCAPE) else keys  # an arrow or the like, which is several characters


def _is_ours() -> bool:
    """Tell whether there is a terminal for this program to read from: not that of a program in the foreground."""
    try:
        if not sys.stdin.isatty():
            return False
        handle = sys.stdin.fileno()
    except (AttributeError, ValueError, OSError):  # closed, or something that a test put there
        return False
    try:
        return sys.platform == "win32" or os.tcgetpgrp(handle) == os.getpgrp()
    except OSError:  # a terminal, but not the one that this program belongs to: nobody else reads from it
        return True
