"""What ends a command before it is through: signals, and questions that nobody answers."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

import click

from servobus.errors import UsageError
from servobus.safety.signals import ENDING


@contextlib.contextmanager
def unless_nobody_answers(otherwise: str) -> Iterator[None]:
    """Say which option answers a question in place of a person, where no person is there to answer."""
    try:
        yield
    except click.Abort as abort:
        if isinstance(abort.__context__, EOFError):
            click.echo(err=True)  # the question stands on a line of its own
            raise UsageError(f"nobody is there to answer, and nothing was changed: {otherwise}") from abort
        raise


@contextlib.contextmanager
def signals_as_interrupt() -> Iterator[None]:
    """Let what ends a program raise KeyboardInterrupt, as Ctrl-C does, so that servos are made safe.

    That is SIGTERM, SIGHUP (the terminal was closed) and SIGQUIT; not one that is ignored, as SIGHUP is under nohup.
    """

    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    old: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():  # no other gets signals
        old = {number: signal.getsignal(number) for number in ENDING}
        old = {number: handler for number, handler in old.items() if handler not in (None, signal.SIG_IGN)}
    try:
        for number in old:
            signal.signal(number, stop)
        yield
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)


def stop_on_signals() -> threading.Event:
    """Give an event that Ctrl-C, SIGTERM and the end of the terminal set, for commands that run until then.

    A signal that is ignored stays so, as SIGHUP under nohup.
    """
    stop = threading.Event()

    def handle(_signal: int, _frame: FrameType | None) -> None:
        stop.set()

    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handle)
    return stop
