"""Single keys of a terminal, as they are pressed, and a key that is held down."""

import os
import sys
from types import TracebackType
from typing import Any, Self

SPACE, ESCAPE = " ", "\x1b"
FIRST = 0.75
"""s from the first of a key that is held to the second; *assumption*: 660 ms in X11, less elsewhere."""
NEXT = 0.3
"""s from one to the next of a key that is held; *assumption*: 20 to 40 ms, and more over a slow connection."""


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
        if not self.there:
            return ""
        if sys.platform == "win32":
            import msvcrt  # noqa: PLC0415 - only Windows has it

            keys = ""
            while msvcrt.kbhit():
                keys += msvcrt.getwch()
            return keys
        import select  # noqa: PLC0415 - only terminals need it

        try:
            if not select.select([sys.stdin], [], [], 0)[0]:
                return ""
            data = os.read(sys.stdin.fileno(), 1024)
        except OSError:
            data = b""
        if not data:
            self.there = False  # the terminal is gone
        keys = data.decode(errors="replace")
        return "" if keys.startswith(ESCAPE) else keys  # an arrow or the like, which is several characters


class HeldKey:
    """Tells whether a key is held down, from its repetitions: a terminal says nothing when a key is let go."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._patience = FIRST

    def seen(self, now: float) -> None:
        """Take note that it came, at a time in s."""
        self._patience = NEXT if self.held(now) else FIRST
        self._last = now

    def held(self, now: float) -> bool:
        """Tell whether it is held; for NEXT after it was let go, and for FIRST after a single stroke, it seems so."""
        return self._last is not None and now - self._last < self._patience


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
