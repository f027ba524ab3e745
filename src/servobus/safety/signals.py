"""What ends a program from outside or by accident, so that the servos of its open buses are made safe.

SIGTERM, SIGHUP (the terminal was closed) and SIGQUIT end Python without any cleaning up. While a bus is open they are
caught, if nothing else has a handler for them and they are not ignored, as SIGHUP is under nohup. A signal that comes
while no servo is driven does what it always does. Else a thread makes the servos safe at once, whatever the main thread
does, and SystemExit is raised in that. Only the main thread can catch signals: see `catch_signals`.

At the very end of a program what was left undone is done. A main thread that ends by an exception, as by Ctrl-C, has it
done before Python waits for the other threads.
"""

import atexit
import contextlib
import os
import signal
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any, Protocol

ENDING = [number for name in ("SIGTERM", "SIGHUP", "SIGQUIT") if (number := getattr(signal, name, None)) is not None]
"""Signals that are caught; Windows has the first alone."""
GRACE = 1.0
"""s after the end of the main thread until a program is ended that other threads keep alive."""


class Ending(Protocol):
    """What is asked here of the safety of an open bus."""

    def drives(self) -> bool: ...
    def end(self, *, safe: bool) -> object: ...


_open: weakref.WeakSet[Ending] = weakref.WeakSet()
"""Of the buses that are open."""
_armed: set[Ending] = set()
"""Of those that have set something in motion: they are kept, for they must be made safe."""
_registered = False
"""Whether Python tells of the end of this program."""
_stopping: threading.Thread | None = None
"""The thread that a signal has begun."""
_warned = False


def catch_signals() -> bool:
    """Catch the signals that end a program, as long as a bus is open; tell whether they are caught.

    Opening a bus does it by itself. A program that opens its buses in other threads calls it in the main thread first,
    for no other thread can.
    """
    if threading.current_thread() is not threading.main_thread():
        return any(signal.getsignal(number) is _handle for number in ENDING)
    for number in ENDING:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _handle)
    return True


def opened(bus: Ending) -> None:
    """Take note that a bus is open, on a port whose servos outlive this process."""
    global _registered  # noqa: PLW0603 - once for the whole process
    if not _registered:
        _registered = True
        atexit.register(_make_all_safe)
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=_leave_all_alone)
        # Before Python waits for threads; `atexit` comes after that.
        register: Callable[[Callable[[], Any]], Any] | None = getattr(threading, "_register_atexit", None)
        if register is not None:
            with contextlib.suppress(RuntimeError):  # the program is ending
                register(_main_thread_ended)
    _open.add(bus)
    catch_signals()


def closed(bus: Ending) -> None:
    """Take note that a bus is closed."""
    global _stopping  # noqa: PLW0603 - as above
    _open.discard(bus)
    _armed.discard(bus)
    if not _open and threading.current_thread() is threading.main_thread():
        _stopping = None
        _catch_no_more()


def about_to_move(bus: Ending) -> None:
    """Take note that a bus sets something in motion. Warns once if no signal can be caught that ends this program."""
    _armed.add(bus)
    global _warned  # noqa: PLW0603 - once for the whole process
    if _warned or threading.current_thread() is threading.main_thread():
        return
    free = [signal.Signals(number).name for number in ENDING if signal.getsignal(number) is signal.SIG_DFL]
    if free:
        _warned = True
        import logging  # noqa: PLC0415 - slow to import, and seldom wanted

        logging.getLogger("servobus").warning(
            "%s would end this program with its servos in motion: the bus was opened in a thread that is not the main "
            "one, where no signal can be caught; open it in the main thread, or call servobus.catch_signals() there",
            " and ".join(free),
        )


@contextlib.contextmanager
def undisturbed(*, ending: bool) -> Iterator[None]:
    """Put off signals that come inside: what makes servos safe is not broken off.

    They are obeyed at the end; but a Ctrl-C is not if the program is `ending` anyhow: the error that ends it is the one
    that comes out.
    """
    if threading.current_thread() is not threading.main_thread():  # only that one gets signals
        yield
        return
    _put_off.begin()
    try:
        yield
    finally:
        for number in _put_off.end():
            if number != signal.SIGINT or not ending:
                signal.raise_signal(number)


class _PutOff:
    """Signals that are put off while any of several blocks of code lasts: tasks of a loop may be in some at once."""

    def __init__(self) -> None:
        self._blocks = 0
        self._handlers: dict[int, Any] = {}
        self._came: list[int] = []

    def begin(self) -> None:
        self._blocks += 1
        if self._blocks > 1:
            return
        for number in (signal.SIGINT, *ENDING):
            handler = signal.getsignal(number)
            if handler not in (None, signal.SIG_IGN):  # None could not be set again
                self._handlers[number] = handler
                signal.signal(number, self._note)

    def end(self) -> list[int]:
        """End a block; behind the last one, give the signals that came."""
        self._blocks -= 1
        if self._blocks:
            return []
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        came = list(dict.fromkeys(self._came))
        self._handlers.clear()
        self._came.clear()
        return came

    def _note(self, number: int, _frame: FrameType | None) -> None:
        self._came.append(number)


_put_off = _PutOff()


def _handle(number: int, _frame: FrameType | None) -> None:
    """Make the servos safe beside the main thread, which may have the line at this moment, and end that."""
    global _stopping  # noqa: PLW0603 - there is one end of a program
    if _stopping is not None and _stopping.is_alive() and threading.main_thread().is_alive():
        return  # the stop is under way
    if _stopping is not None or not any(bus.drives() for bus in list(_armed)):
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)
        return
    _stopping = threading.Thread(target=_stop_and_end, args=[number], name="servobus stop", daemon=True)
    _stopping.start()
    raise SystemExit(128 + number)  # as shells tell it


def _stop_and_end(number: int) -> None:
    _make_all_safe()
    threading.main_thread().join()
    time.sleep(GRACE)
    os.kill(os.getpid(), number)  # threads that are no daemons would keep the program alive


def _main_thread_ended() -> None:
    if getattr(sys, "last_value", None) is not None:  # by an exception
        _make_all_safe()


def _make_all_safe() -> None:
    """Make the servos safe that are still driven when the program ends."""
    for bus in list(_armed):
        bus.end(safe=True)


def _leave_all_alone() -> None:
    """Forget the buses in a fork of the program that opened them: their servos belong to that program."""
    _open.clear()
    _armed.clear()
    _catch_no_more()


def _catch_no_more() -> None:
    for number in ENDING:
        if signal.getsignal(number) is _handle:
            signal.signal(number, signal.SIG_DFL)
