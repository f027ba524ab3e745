"""Virtual servos behind a port of the operating system, for other people's programs.

    PtyPort    a pseudo terminal, which programs open like a serial port; with a link of your choice to it
    TcpPort    a TCP port, as of a serial device server

Both are context managers that `serve` one rig in real time until they are told to stop.
"""

import errno
import itertools
import math
import select
import socket
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from servobus.errors import PortError, UsageError
from servobus.transports.pty import PseudoTerminal
from servobus.virtual.serve.rig import Rig
from servobus.virtual.serve.run_queue import RunQueue
from servobus.virtual.serve.spec import REAL_CLOCK

PULSE = 0.02
"""s after which a request to stop is noticed, and resting servos are looked after, at the latest."""
SPARE = 0.0005
"""s that looking after servos may take at once: a request that comes meanwhile waits no longer."""
CHUNK = 4096


class Port(ABC):
    """What a client sees of a rig. `name` is what it opens. Raises UsageError for a rig on a virtual clock."""

    name: str

    def __init__(self, rig: Rig) -> None:
        if rig.clock != "real":
            raise UsageError(REAL_CLOCK)
        self.rig = rig
        self._stack = ExitStack()
        self._turns = itertools.cycle(rig.servos)

    def __enter__(self) -> Self:
        self.rig.open()
        self._appear()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
        self.rig.close()

    def serve(self, stop: threading.Event) -> None:
        """Carry bytes until `stop` is set. The rig's time 0 is now."""
        started = time.monotonic()
        kept_up = 0.0
        with RunQueue() as queue:
            while not stop.is_set():
                with self.rig.lock:
                    now = time.monotonic() - started
                    gone = self.rig.gone(now)
                    replies, look = (b"", None) if gone else (self.rig.receive(now), self.rig.next_look())
                if gone:
                    self._stay_away(stop, started)
                    continue
                if replies:
                    self._send(replies)
                waited = queue.waited()
                timeout = PULSE if look is None else min(max(look - now, 0), PULSE)
                data = self._wait(timeout)
                came = time.monotonic() - started
                if data:
                    # A servo does not answer late because the computer is busy: what ended the wait has come when this
                    # thread could have run. What came after the wait was over has come at some time since then.
                    if (could_run := came - (queue.waited() - waited)) < now + timeout:
                        came = max(could_run, now)
                    with self.rig.lock:
                        self.rig.client_baud = self._baud()
                        self.rig.send(data, came)
                elif look is None and came - kept_up >= PULSE:
                    with self.rig.lock:
                        now = time.monotonic() - started
                        self._keep_up(now)
                    kept_up = now

    def _appear(self) -> None:
        with ExitStack() as stack:
            self._open(stack)
            self._stack = stack.pop_all()

    def _stay_away(self, stop: threading.Event, started: float) -> None:
        """Be no port, as the faults ask for, and then another one under the same name. Raises PortError."""
        self._stack.close()
        while True:
            with self.rig.lock:
                now = time.monotonic() - started
                gone = self.rig.gone(now)
                self.rig.receive(now)  # does what was posted, such as to mend the fault; what servos send is lost
                more = self.rig.next_look() == -math.inf
            if not gone:
                break
            if not more and stop.wait(PULSE):
                return
        self._appear()

    def _keep_up(self, now: float) -> None:
        """While nothing is on the wire, advance servos to now: one that is asked next need not catch up first."""
        end = time.monotonic() + SPARE
        for servo in itertools.islice(self._turns, len(self.rig.servos)):
            servo.advance(now)
            if time.monotonic() > end:
                break

    @abstractmethod
    def _open(self, stack: ExitStack) -> None:
        """Open it; what must be undone goes on the stack. Sets `name`. Raises PortError."""

    @abstractmethod
    def _wait(self, timeout: float) -> bytes:
        """Wait for bytes of the client and give them; empty if none came or there is no client."""

    @abstractmethod
    def _send(self, data: bytes) -> None:
        """Give bytes to the client; they are lost if there is none, or if it does not read. Never waits."""

    @abstractmethod
    def _baud(self) -> float | None:
        """Give the speed that the client talks at; None if there is no such thing."""


class PtyPort(Port):
    """Servos behind a pseudo terminal; the client's speed setting is read, and must be right."""

    def __init__(self, rig: Rig, link: Path | None = None) -> None:
        super().__init__(rig)
        self._terminal = PseudoTerminal(rig.default_baud, link)

    def _open(self, stack: ExitStack) -> None:
        self.name = stack.enter_context(self._terminal).name

    def _wait(self, timeout: float) -> bytes:
        return self._terminal.read(timeout)

    def _send(self, data: bytes) -> None:
        self._terminal.write(data)

    def _baud(self) -> float | None:
        return self._terminal.baud()


class TcpPort(Port):
    """A TCP port for one client at a time; another may come when it has gone, and until then is hung up on.

    Port 0 takes any free one.
    """

    def __init__(self, rig: Rig, host: str = "127.0.0.1", port: int = 0) -> None:
        super().__init__(rig)
        self._address = host, port
        self._client: socket.socket | None = None

    def _open(self, stack: ExitStack) -> None:
        host, port = self._address
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        stack.callback(self._leave)  # behind the listener: who is hung up on must not get through once more
        try:
            self._listener = stack.enter_context(socket.create_server((host, port), family=family, backlog=1))
        except (OSError, OverflowError) as error:
            if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
                said = "another program listens there; end it, or take another port: 0 takes any free one"
                raise PortError(f"cannot listen on {host} port {port}: {said}") from error
            raise PortError(f"cannot listen on {host} port {port}: {error}") from error
        shown = f"[{host}]" if ":" in host else host
        self._address = host, self._listener.getsockname()[1]
        self.name = f"socket://{shown}:{self._address[1]}"

    def _wait(self, timeout: float) -> bytes:
        waiting = [self._listener] if self._client is None else [self._client, self._listener]
        ready = select.select(waiting, [], [], timeout)[0]
        if not ready:
            return b""
        if self._client is None:
            self._client, _ = self._listener.accept()
            self._client.setblocking(False)
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # A client that lost its network must not keep others out for ever.
            self._client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            return b""
        if self._client not in ready:
            # What the present client has sent, its end too, comes before the next one is looked at.
            self._listener.accept()[0].close()
            return b""
        try:
            data = self._client.recv(CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._leave()
        return data

    def _send(self, data: bytes) -> None:
        if self._client is not None:
            try:
                self._client.send(data)
            except BlockingIOError:
                pass  # the client reads nothing: a real port's buffer overruns too
            except OSError:
                self._leave()

    def _baud(self) -> float | None:
        return None

    def _leave(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None


def serve_pty(rig: Rig, link: Path | None, stop: threading.Event, ready: Callable[[str], None]) -> None:
    """Serve a rig behind a pseudo terminal until told to stop; `ready` is told its name. Raises PortError."""
    with PtyPort(rig, link) as port:
        ready(port.name)
        port.serve(stop)


def serve_tcp(rig: Rig, host: str, port: int, stop: threading.Event, ready: Callable[[str], None]) -> None:
    """Serve a rig behind a TCP port until told to stop; `ready` is told its name. Raises PortError."""
    with TcpPort(rig, host, port) as served:
        ready(served.name)
        served.serve(stop)
