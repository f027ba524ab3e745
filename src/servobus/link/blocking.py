"""Letting time pass, the blocking way: how the steps of a job get their waits.

`Bus` lives on it. An `AsyncBus` comes here where its event loop may be stuck: to make its servos safe.
"""

import threading
from typing import TypeVar

from servobus.link.link import Link, Receive, Waits
from servobus.transports.base import Transport

T = TypeVar("T")

SLICE = 0.05
"""s after which one who rests looks whether the line was taken from him."""


def run_blocking(link: Link, waits: Waits[T], lock: "threading.RLock | None" = None) -> T:
    """Wait as asked until the job is done; give its result.

    `lock` is let go where others may use the line. Raises Stopped if the line was taken over meanwhile.
    """
    transport = link.transport
    heard = b""
    try:
        wait = next(waits)
        while True:
            if isinstance(wait, Receive):
                heard = transport.read(wait.seconds)
            elif lock is not None and wait.shared:
                lock.release()
                try:
                    _rest(link, transport, wait.seconds)
                finally:
                    lock.acquire()
            else:
                _rest(link, transport, wait.seconds)
            link.check()
            wait = waits.send(heard)
    except StopIteration as stop:
        done: T = stop.value
        return done
    finally:
        waits.close()


def _rest(link: Link, transport: Transport, seconds: float) -> None:
    if not transport.blocking():
        transport.sleep(seconds)
        return
    end = transport.now() + seconds
    while seconds > 0 and not link.superseded:
        transport.sleep(min(seconds, SLICE))
        seconds = end - transport.now()
